# SPDX-License-Identifier: LGPL-3.0-or-later
"""The packing of the demo, small: soft grains, a rigid disc and a pentagon under a lid."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "demos"))
import granular_packing as demo

from xper_fx.output.contact_forces import find_contact_forces

pytestmark = pytest.mark.demos


@pytest.fixture(scope="module")
def packed(tmp_path_factory):
    """Nine grains, three of them rigid."""
    out = tmp_path_factory.mktemp("packing")
    options = f"--columns 3 --rows 3 --rings 2 --packing 0.84 --threads 1 --quiet --out {out}"
    return demo.main(options.split()), out


def test_grains_of_the_start_fill_what_they_should():
    scene = demo.packing(3, 3, 0.34, 4, 0.5, 0.3, 1)
    area, width = demo.fractions(scene)
    hard = [body for body in scene.rigid if body.group == "hard"]
    assert len(hard) == 3 and scene.bodies.num_bodies == 6
    assert len({type(body.shape).__name__ for body in hard}) == 2
    # a soft disc is a polygon of 6 sides a ring
    sides = 24
    share = sides / (2 * np.pi) * np.sin(2 * np.pi / sides)
    x = scene.bodies.mesh.geometry.x[:, :2]
    body = np.empty(len(x), int)
    body[demo.xf.geometry_dofmap(scene.bodies.mesh)] = scene.bodies.body_of_cell[:, None]
    radius = [0.5 * np.ptp(x[body == b, 0]) for b in range(6)]
    soft = share * np.pi * np.square(radius).sum()
    assert area == pytest.approx(soft + sum(b.shape.mass_properties(1.0).mass for b in hard))
    assert width == pytest.approx(3 * demo.SPACING)


def test_lid_jams_the_grains(packed):
    result, out = packed
    _, fraction, pressure = result["curve"].T
    assert fraction[-1] == pytest.approx(0.84, abs=2e-3)
    assert np.all(np.diff(fraction) > 0.0)
    loose = pressure[fraction < 0.6]
    assert pressure[-20:].mean() > 20.0 * np.abs(loose).mean()
    summary = json.loads((out / "summary.json").read_text())
    assert 0.55 < summary["jammed_at"] < 0.84
    for name in ("packing.png", "pressure.png", "energies.png", "rigid.xdmf", "bulk.xdmf"):
        assert (out / name).stat().st_size > 0


def test_energy_and_pressure_agree(packed):
    """The lid's work is that of its pressure, and is found again in the grains."""
    result, _ = packed
    history, (time, _, pressure) = result["history"], result["curve"].T
    width = 3 * demo.SPACING
    work = np.cumsum(pressure * width * 0.5 * np.diff(time, prepend=0.0))
    assert work[-1] == pytest.approx(history["external_work"][-1], rel=1e-6)
    assert np.abs(history["closure"]).max() < 2e-3 * history["external_work"][-1]
    for name in ("dissipated_friction", "dissipated_impact"):
        assert history[name][-1] > 0.0


def test_penetration_stays_small(packed):
    simulation = packed[0]["simulation"]
    gaps = np.concatenate([g.jump[:, 0] for g in simulation.interactions.contacts])
    # contacts act on velocities: what has come in while grains turned and slid stays in; heaps part
    # by rounding, and radii that differ by 1e-12 have 0.05 to 0.10 of them here
    assert gaps.min() > -0.15 * demo.RADIUS
    forces = find_contact_forces(simulation)
    assert len(forces.force) > 9
    towards = np.einsum("nd,nd->n", forces.force, forces.normal)
    size = np.linalg.norm(forces.force, axis=1)
    assert np.all(towards >= size / np.hypot(1.0, 0.3) * (1.0 - 1e-9))
