# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts, coordination and overlap in the history, against packings counted by hand."""

from __future__ import annotations

import numpy as np
import pytest

import xper_fx as xf


def recorded(rigid, folder, steps=5, **options):
    law = xf.laws.SignoriniCoulomb(friction=0.5)
    scene = xf.Scene(
        rigid=rigid, loads=[xf.Gravity((0.0, -10.0))],
        contacts=[xf.Contact(("discs", group), law) for group in ("discs", "floor")],
    )  # fmt: skip
    simulation = xf.Simulation(scene, step=1e-3, tolerance=1e-9)
    end = steps * 1e-3
    recorder = xf.Recorder(simulation, folder, end_time=end, **options)
    for _ in xf.recorded_steps(recorder, end, "packing", quiet=True):
        pass
    return xf.read_history(recorder.folder / "history.csv")


def disc(x, y, **options):
    return xf.RigidBody(xf.rigid.Disc(0.5), (x, y), "discs", density=1000.0, **options)


FLOOR = xf.rigid.wall((0.0, 0.0), (0.0, 1.0), "floor")


def test_a_column_of_three(tmp_path):
    """Three contacts; partners 2, 2 and 1 of the three discs."""
    history = recorded([FLOOR, *(disc(0.0, 0.5 + n) for n in range(3))], tmp_path)
    np.testing.assert_array_equal(history["contacts"], 3.0)
    np.testing.assert_allclose(history["coordination"], 5.0 / 3.0)
    assert history["overlap"].max() < 1e-12


def test_a_box_touches_at_two_points_one_partner(tmp_path):
    shape = xf.rigid.Polygon.box((1.0, 1.0))
    history = recorded([FLOOR, xf.RigidBody(shape, (0.0, 0.5), "discs", density=1.0)], tmp_path)
    np.testing.assert_array_equal(history["contacts"], 2.0)
    np.testing.assert_array_equal(history["coordination"], 1.0)


def test_overlap_that_an_impact_leaves(tmp_path):
    """Contacts are found in the middle of the step: what comes in until then stays."""
    history = recorded([FLOOR, disc(0.0, 0.5 + 1e-4, velocity=(0.0, -1.0))], tmp_path, steps=3)
    assert history["overlap"][-1] == pytest.approx(4e-4, rel=1e-2)


def test_bodies_that_do_not_touch(tmp_path):
    history = recorded([FLOOR, disc(0.0, 5.0), disc(3.0, 5.0)], tmp_path)
    assert not history["contacts"].any() and not history["coordination"].any()
