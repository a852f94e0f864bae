# SPDX-License-Identifier: LGPL-3.0-or-later
"""Simulations that go on from the state of another one, in the same scene or in another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import restart_scenes

import xper_fx as xf

# Scenes that go on: what they carry, and half of their time.
CARRIED = {
    "falling_bodies": {"step": 5e-3},
    "tumbling_boxes": {"step": 5e-3},
    "mechanism": {"step": 5e-3},
    "cohesive_bar": {"step": 0.1, "theta": 0.6},
    "ductile_cells": {"step": 0.1},
    "fragments": {"step": 0.05},
    "splitting_plate": {"accuracy": 1e-2},
}


def left(simulation) -> dict:
    """All that a simulation saves, flat."""

    def flat(tree, at=""):
        for name, value in tree.items():
            if isinstance(value, dict):
                yield from flat(value, f"{at}{name}.")
            else:
                yield at + name, np.asarray(value)

    return dict(flat(simulation.saved_in_order()))


def advanced(simulation, end):
    for _ in simulation.steps(end):
        pass
    return simulation


def again(simulation, changes=None, **options):
    """The same scene, with changes, after the present state."""
    scene = replace(simulation.scene, after=simulation.snapshot(), **(changes or {}))
    return xf.Simulation(scene, num_threads=1, **options)


@pytest.mark.slow
@pytest.mark.parametrize("name", CARRIED)
def test_the_same_scene_goes_on_with_the_same_bits(name):
    scene = getattr(restart_scenes, name)
    end, _ = restart_scenes.SCENES[scene]
    first = advanced(scene(), 0.5 * end)
    other = again(first, **CARRIED[name])
    assert other.time == first.time and other.step_number == first.step_number
    advanced(first, end)
    advanced(other, end)
    whole, parts = left(first), left(other)
    assert set(whole) == set(parts)
    for what, values in whole.items():
        np.testing.assert_equal(values, parts[what], what)


def heap(*more, **options):
    """Discs on each other and on the ground."""
    rigid = [xf.rigid.wall((0.0, 0.0), (0.0, 1.0), "ground")]
    for i in range(4):
        place = (0.21 * (i % 2) + 0.1 * (i // 2), 0.1 + 0.19 * (i // 2))
        rigid.append(xf.RigidBody(xf.rigid.Disc(0.1), place, "grains", density=100.0))
    law = options.pop("law", xf.laws.SignoriniCoulomb(friction=0.4))
    return xf.Scene(
        rigid=[*rigid, *more],
        contacts=[xf.Contact(("grains", group), law) for group in ("grains", "ground")],
        loads=[xf.Gravity((0.2, -9.81))],
    )


STEP = 2e-3


def test_a_body_far_away_changes_nothing():
    first = advanced(xf.Simulation(heap(), STEP, num_threads=1), 0.1)
    flying = xf.RigidBody(xf.rigid.Disc(0.1), (50.0, 50.0), "grains", density=100.0)
    other = again(first, {"rigid": [*first.scene.rigid, flying]}, step=STEP)
    advanced(first, 0.2)
    advanced(other, 0.2)
    for name in ("position", "velocity"):
        own, carried = (getattr(run.rigid.state, name) for run in (first, other))
        np.testing.assert_array_equal(carried[:-1], own)
    np.testing.assert_allclose(other.rigid.state.velocity[-1], np.array([0.2, -9.81]) * 0.1)
    assert other.ledger.closure == pytest.approx(first.ledger.closure, abs=1e-12)


def test_contacts_go_on_beside_bodies_that_come_and_go():
    """In its first step a heap at rest knows the impulses of contacts whose bodies stay."""
    square = np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]])
    corner = xf.rigid.Cluster(
        [xf.rigid.Polygon(square + shift) for shift in ((0.0, 0.0), (0.1, 0.0), (0.0, 0.1))]
    )
    angle = xf.RigidBody(corner, (2.0, 0.1), "grains", density=100.0)
    first = advanced(xf.Simulation(heap(angle), STEP, num_threads=1, tolerance=1e-8), 1.0)
    new = [
        xf.RigidBody(xf.rigid.Disc(0.05), (x, 0.05), "grains", density=100.0) for x in (-3.0, -4.0)
    ]
    ground, *grains = first.scene.rigid
    other = again(first, {"rigid": [ground, *new, *grains[:3], angle]}, step=STEP, tolerance=1e-8)

    def impulses(simulation, name_of):
        history = simulation.interactions.saved()["contacts"]
        body = simulation.scene.rigid_bodies.shapes.body
        part = np.arange(len(body)) - np.searchsorted(body, body)
        keys, impulse = (np.concatenate([r[what] for r in history.values()])
                         for what in ("keys", "impulse"))  # fmt: skip
        pairs = np.divmod(keys[:, 0], len(body))
        return {
            (name_of[body[i]], part[i], name_of[body[j]], part[j], feature): tuple(values)
            for i, j, feature, values in zip(*pairs, keys[:, 1], impulse.tolist(), strict=True)
        }

    known = impulses(first, range(6))
    carried = impulses(other, [0, None, None, 1, 2, 3, 5])
    assert carried == {key: value for key, value in known.items() if 4 not in (key[0], key[2])}
    assert len(carried) < len(known) and any(key[2] == 5 and key[3] == 1 for key in carried)
    assert not other.rigid.state.velocity[1].any()
    advanced(other, 1.1)
    assert other.ledger.closure == pytest.approx(0.0, abs=1e-12)


def test_step_tolerance_loads_and_laws_change():
    """A block that rests on a slope slides once the law's friction is less, at g (sin - mu cos)."""
    slope, before, after = 0.3, 0.5, 0.1
    block = xf.RigidBody(xf.rigid.Polygon.box((0.4, 0.2)), (0.0, 0.1), "grains", density=100.0)
    ground = xf.rigid.wall((0.0, 0.0), (0.0, 1.0), "ground")
    scene = xf.Scene(
        rigid=[block, ground],
        contacts=[xf.Contact(("grains", "ground"), xf.laws.SignoriniCoulomb(friction=before))],
        loads=[xf.Gravity((9.81 * np.sin(slope), -9.81 * np.cos(slope)))],
    )
    first = advanced(xf.Simulation(scene, 1e-3, num_threads=1), 0.1)
    assert np.abs(first.rigid.state.velocity).max() < 1e-6
    law = xf.laws.SignoriniCoulomb(friction=after)
    changes = {"contacts": [xf.Contact(("grains", "ground"), law)]}
    other = advanced(again(first, changes, step=5e-3, tolerance=1e-9), 0.3)
    rate = 9.81 * (np.sin(slope) - after * np.cos(slope))
    assert other.rigid.state.velocity[0, 0] == pytest.approx(0.2 * rate, rel=1e-6)
    still = again(other, {"loads": []}, step=1e-3)
    assert still.time == pytest.approx(0.3) and still.ledger.energies == other.ledger.energies
    advanced(still, 0.4)
    assert still.rigid.state.velocity[0, 0] == pytest.approx(0.2 * rate, rel=1e-3)
    assert still.ledger.closure == pytest.approx(0.0, abs=1e-12)


def test_loads_of_meshed_bodies_change_at_once():
    """A block in free flight has g1 t1 + g2 t2, whatever the step: half a step has no old load."""
    scene = xf.Scene(
        xf.explode(xf.crossed_rectangle((0.0, 0.0), (1.0, 1.0), (1, 1)), np.zeros(4, int)),
        {1: xf.materials.LinearElastic(young=1e6, poisson=0.3, density=1.0)},
        loads=[xf.Gravity((0.0, -10.0))],
    )
    first = advanced(xf.Simulation(scene, 0.1), 0.2)
    other = advanced(again(first, {"loads": [xf.Gravity((2.0, 0.0))]}, step=0.05), 0.4)
    velocity = other.state.velocity.reshape(-1, 2)
    np.testing.assert_allclose(velocity, np.broadcast_to((0.4, -2.0), velocity.shape), atol=1e-9)


@pytest.mark.slow
def test_joints_go_on_as_they_were_placed():
    """A wire leaves with its energy, a weld comes; a hinge with limits is where it was placed."""
    bar = xf.RigidBody(xf.rigid.Polygon.box((1.0, 0.1)), (0.5, 0.0), "bars", density=10.0)
    ball = xf.RigidBody(xf.rigid.Disc(0.1), (3.0, 0.0), "bars", density=10.0)
    hinge = xf.Hinge((None, bar), (0.0, 0.0), limits=(-2.0, 0.5))
    wire = xf.Tendon((None, ball), ((3.0, 1.0), (3.0, 0.1)), stiffness=100.0, prestress=5.0)
    scene = xf.Scene(rigid=[bar, ball], joints=[wire, hinge], loads=[xf.Gravity((0.0, -9.81))])
    first = advanced(xf.Simulation(scene, 4e-3, num_threads=1), 0.3)
    other = again(first, {"joints": [hinge, xf.Weld((None, ball), (3.0, 0.0))]}, step=4e-3)
    assert first.ledger.energies.cohesive > 0.05
    assert other.ledger.energies.cohesive == pytest.approx(0.0, abs=1e-15)
    assert other.ledger.closure == pytest.approx(first.ledger.closure, abs=1e-12)
    held = other.rigid.state.position[1].copy()
    advanced(other, 1.0)
    advanced(first, 1.0)
    own, carried = first.rigid.state.position, other.rigid.state.position
    np.testing.assert_allclose(carried[0], own[0], atol=2e-5)
    np.testing.assert_allclose(carried[1], held, atol=4e-3)
    assert other.ledger.closure == pytest.approx(0.0, abs=1e-10)


def test_what_a_run_overlaps_by_is_healed_on_request():
    """And only then; a new body that overlaps is refused all the same."""
    law = xf.laws.SignoriniCoulomb()
    disc = xf.rigid.Disc(0.1)
    ball = xf.RigidBody(disc, (0.0, 0.1005), "grains", density=1.0, velocity=(0.0, -1.0))
    ground = xf.rigid.wall((0.0, 0.0), (0.0, 1.0), "ground")
    scene = xf.Scene(
        rigid=[ball, ground],
        contacts=[xf.Contact(("grains", group), law) for group in ("grains", "ground")],
    )
    first = advanced(xf.Simulation(scene, 2e-3, num_threads=1, healing=False), 0.02)
    deep = first.rigid.state.position[0, 1]
    assert deep < 0.1 - 1e-4
    state = first.snapshot()
    assert replace(scene, after=state).rigid_bodies.position[0, 1] == deep
    healed = xf.Simulation(replace(scene, after=state, resolve_overlaps=True), 2e-3)
    assert healed.rigid.state.position[0, 1] == pytest.approx(0.1, abs=1e-6)
    new = xf.RigidBody(disc, (0.05, 0.2), "grains", density=1.0)
    with pytest.raises(ValueError, match="overlap at the start: 0 and 2"):
        replace(scene, rigid=[*scene.rigid, new], after=state)


def test_what_cannot_go_on_is_refused():
    first = xf.Simulation(heap(), STEP, num_threads=1)
    state, (ground, *grains) = first.snapshot(), first.scene.rigid
    with pytest.raises(ValueError, match="in its order"):
        replace(first.scene, rigid=[ground, *grains[::-1]], after=state)
    with pytest.raises(TypeError, match="after should be a Snapshot"):
        replace(first.scene, after=first)
    bar = restart_scenes.cohesive_bar()
    with pytest.raises(ValueError, match="the same Bodies object"):
        replace(first.scene, after=bar.snapshot())
    with pytest.raises(ValueError, match="of another kind"):
        replace(
            bar.scene, default_interaction=xf.laws.SignoriniCoulomb(), after=bar.snapshot()
        )  # fmt: skip
    with pytest.raises(ValueError, match="with the `order` of the run"):
        replace(bar.scene, order=2, after=bar.snapshot())
    with pytest.raises(ValueError, match="with the scheme of the run"):
        again(bar, scheme="explicit")


def test_rigid_bonds_go_on_where_all_have_points_and_back():
    """As on several ranks at finite strain: sound bonds of whole vertices have no arrays on one."""
    scene = restart_scenes.splitting_plate
    first = advanced(scene(), 0.5 * restart_scenes.SCENES[scene][0])
    fused = first.interactions.fused
    assert 0 < len(fused.split) < fused.graphs.num_vertices
    others = [
        xf.Simulation(first.scene, first.step_size, scheme=scheme, solver=solver, num_threads=1)
        for scheme, solver in (("implicit", "nlgs"), ("explicit", "auto"))
    ]
    assert others[0].interactions.fused is None
    for before, other in zip((first, others[0]), others, strict=True):
        other.interactions.restore(before.saved_in_order()["interactions"])
        for name in ("damage", "jump", "spent", "energy"):
            np.testing.assert_array_equal(
                other.interactions.gather(name), first.interactions.gather(name)
            )
    worn = (first.interactions.gather("spent") > 0.0)[fused.graphs.point]
    split = np.flatnonzero(np.logical_or.reduceat(worn, fused.graphs.bond_offsets[:-1]))
    np.testing.assert_array_equal(np.sort(others[1].interactions.fused.split), split)
