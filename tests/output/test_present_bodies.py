# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid bodies that go from one scene into another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import xper_fx as xf

STEP = 1e-3


def run(scene, end, **options):
    simulation = xf.Simulation(scene, STEP, **({"tolerance": 1e-9} | options))
    for _ in simulation.steps(end):
        pass
    return simulation


@pytest.mark.parametrize("dim", [2, 3])
def test_bodies_in_flight_go_on(dim):
    """Turned, spinning, pushed and driven by functions of time: as one uninterrupted run."""
    if dim == 2:
        shape, turned = xf.rigid.Polygon.box((1.0, 0.4)), {"angle": 0.3, "spin": 2.0}
    else:
        shape = xf.rigid.Polyhedron.box((1.0, 0.4, 0.6))
        turned = {"rotation": (0.1, 0.2, 0.3, 0.9), "spin": (1.0, 2.0, -3.0)}
    flying = xf.RigidBody(
        shape, (0.0,) * dim, "bodies", density=10.0, **turned,
        force=lambda t: (30.0 * t, *(0.0,) * (dim - 1)),
    )  # fmt: skip
    driven = xf.RigidBody(
        shape, (5.0,) * dim, "bodies", density=10.0, prescribed={0: lambda t: np.sin(20.0 * t)}
    )
    contacts = [xf.Contact(("bodies", "bodies"), xf.laws.SignoriniCoulomb())]
    scene = xf.Scene(rigid=[flying, driven], contacts=contacts)
    whole, first = run(scene, 0.2), run(scene, 0.1)
    second = run(replace(scene, rigid=xf.output.rigid_bodies_now(first)), 0.1)
    for name in ("position", "velocity"):
        np.testing.assert_allclose(
            getattr(second.rigid.state, name), getattr(whole.rigid.state, name), atol=1e-12
        )
    np.testing.assert_allclose(
        second.rigid.state.turn.rotation, whole.rigid.state.turn.rotation, atol=1e-12
    )


@pytest.mark.slow
def test_a_deposit_starts_the_next_scene():
    """Discs settle in a box; then a side is taken away, and they run out through it."""
    grains = xf.assemblies.packing(
        np.random.default_rng(0).uniform(0.04, 0.05, 24), (0.5, np.inf), density=1000.0, seed=1
    )
    law = xf.laws.SignoriniCoulomb(friction=0.3)
    scene = xf.Scene(
        rigid=[*grains, *xf.assemblies.box((0.5, 2.0))],
        contacts=[xf.Contact(("grains", group), law) for group in ("grains", "box")],
        loads=[xf.Gravity((0.0, -9.81))],
    )
    settled = run(scene, 0.6, tolerance=1e-3)
    now = xf.output.rigid_bodies_now(settled)
    opened = replace(scene, rigid=now[:-1], resolve_overlaps=True)
    start = opened.rigid_bodies.position
    assert np.abs(start - settled.rigid.state.position[:-1]).max() < 5e-3
    assert start[:24, 0].max() < 0.5
    flowing = run(opened, 0.3, tolerance=1e-3)
    assert flowing.rigid.state.position[:24, 0].max() > 0.6
    assert np.isfinite(flowing.ledger.energies.kinetic)


def test_whole_turns_are_left_out(caplog):
    """A body that has turned often goes on without the warning of angles in degrees."""
    contacts = [xf.Contact(("bodies", "bodies"), xf.laws.SignoriniCoulomb())]
    disc = xf.RigidBody(xf.rigid.Disc(1.0), (0.0, 0.0), "bodies", density=1.0, spin=100.0)
    scene = xf.Scene(rigid=[disc], contacts=contacts)
    (now,) = xf.output.rigid_bodies_now(run(scene, 0.2))
    assert now.angle == pytest.approx(20.0 - 6.0 * np.pi)
    run(replace(scene, rigid=[now]), STEP)
    assert not caplog.records


def test_a_scene_without_rigid_bodies():
    scene = xf.Scene(
        xf.explode(xf.crossed_rectangle((0.0, 0.0), (1.0, 1.0), (1, 1)), np.zeros(4, int)),
        {1: xf.materials.LinearElastic(young=1e6, poisson=0.3, density=1.0)},
    )
    with pytest.raises(ValueError, match="no rigid bodies"):
        xf.output.rigid_bodies_now(xf.Simulation(scene, 1e-4))
