# SPDX-License-Identifier: LGPL-3.0-or-later
"""The slab of the demo, small: it breaks, its pieces meet again, the ledger closes."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "demos"))
import impact_fragmentation as demo

from xper_fx.output.connectivity import find_fragments
from xper_fx.output.contact_forces import find_contact_forces
from xper_fx.output.cracks import broken_points

pytestmark = pytest.mark.demos

SMALL = "--cells 6 --speed 6.0 --end-time 0.12 --step-size 4e-4 --threads 1 --quiet".split()


@pytest.fixture(scope="module")
def broken(tmp_path_factory):
    """A coarse slab a short way above the floor, until its pieces have met there."""
    out = tmp_path_factory.mktemp("impact")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demo, "HEIGHT", 0.1)
        # cells that shared a vertex count, too: few others meet, and rounding decides which
        patch.setattr(demo, "neighbours", lambda scene: set())
        return demo.main([*SMALL, "--fields", "2", "--out", str(out)]), out


def test_slab_breaks_into_pieces(broken):
    result, out = broken
    summary = json.loads((out / "summary.json").read_text())
    simulation, rows = result["simulation"], demo.pieces(result)
    cells = result["fragments"].bodies[rows]
    assert summary["fragments"] == len(rows) > 5
    assert cells.sum() == simulation.scene.bodies.num_bodies
    assert np.all(np.diff(cells) <= 0)
    assert result["history"]["fragments"][-1] == len(rows) + 1  # the ball is one
    # lips that the search has taken over count as broken still
    points = len(broken_points(simulation))
    gone = points - sum(
        len(g) for g in simulation.interactions.groups
        if "damage" in g.kernels.state_names
    )  # fmt: skip
    assert 0 < gone <= np.count_nonzero(broken_points(simulation))
    figures, series = ("frames", "sizes", "energies"), ("rigid", "bulk", "interfaces")
    for name in [f"{n}.png" for n in figures] + [f"{n}.xdmf" for n in series]:
        assert (out / name).stat().st_size > 0


def test_bonds_without_a_stiffness_break_where_they_must(tmp_path):
    """The explicit bulk, whose vertices split one by one beside ball and supports."""
    rigid = [*SMALL, "--bonds", "rigid", "--end-time", "0.06", "--no-plot", "--out", str(tmp_path)]
    result = demo.main(rigid)
    simulation, e = result["simulation"], result["simulation"].ledger.energies
    split = simulation.interactions.fused.split
    assert 0 < len(split) < simulation.interactions.fused.graphs.num_vertices
    assert len(demo.pieces(result)) > 3
    assert e.dissipated_cohesion > 20.0
    assert abs(simulation.ledger.closure) < 1e-3 * e.kinetic
    assert abs(e.dissipated_numerical) < 0.01 * e.kinetic


def test_fragments_are_what_bonds_connect(broken):
    """Grow every fragment from its first cell by standing bonds, one after the other."""
    simulation = broken[0]["simulation"]
    facets = simulation.scene.bodies.facets
    held = ~broken_points(simulation).reshape(len(facets), -1).all(axis=1)
    fragment = find_fragments(simulation)[: simulation.scene.bodies.num_bodies]
    assert np.all(fragment[facets.bodies[held, 0]] == fragment[facets.bodies[held, 1]])
    for label in np.unique(fragment):
        own = np.flatnonzero(fragment == label)
        reached, grew = {own[0]}, True
        while grew:
            before = len(reached)
            for a, b in facets.bodies[held].tolist():
                if a in reached or b in reached:
                    reached |= {a, b}
            grew = len(reached) > before
        assert reached == set(own.tolist())


def test_pieces_meet_again(broken):
    assert len(broken[0]["met"]) > 5


def test_penetration_stays_small(broken):
    # half a cell is 83 mm; deepest where lips that turned went over to the search
    assert broken[0]["deepest"] < 0.15 * demo.THICKNESS


def test_energy_closes(broken):
    history = broken[0]["history"]
    held = history["kinetic"][0] + history["external_work"][-1]
    assert np.abs(history["closure"]).max() < 5e-3 * held
    assert history["dissipated_cohesion"][-1] > 0.01 * held
    # bonds whose points the search has taken over count with their whole energy
    table = broken[0]["fragments"]
    lost = table.border.sum() + table.inside.sum()
    assert lost == pytest.approx(history["dissipated_cohesion"][-1], rel=0.02)
    kinetic = (table.translation + table.rotation + table.vibration).sum()
    assert kinetic == pytest.approx(history["kinetic"][-1], rel=1e-9)
    assert table.elastic.sum() == pytest.approx(history["elastic"][-1], rel=1e-9)
    assert np.all(np.diff(history["dissipated_cohesion"]) >= 0.0)
    for name in ("dissipated_friction", "dissipated_impact"):
        assert history[name][-1] > 0.01 * held
    # where a step turns a slip round its friction gains what the normal impulses lose; together
    # a contact that leaves and is pressed back in one step may gain, of the order of the step
    lost = history["dissipated_friction"] + history["dissipated_impact"]
    assert np.diff(lost).min() > -5e-3 * held


def test_momentum_is_what_gravity_and_ground_give(broken):
    """Some steps more: bonds, and contacts among pieces and ball, change no momentum."""
    simulation = broken[0]["simulation"]
    mass, ball = simulation.bulk.mass, simulation.rigid.bodies.mass[0]
    weight = -demo.GRAVITY * (mass.reshape(-1, 2)[:, 1].sum() + ball)
    first_ground = simulation.scene.bodies.num_bodies + 1

    def momentum() -> np.ndarray:
        return (mass * simulation.state.velocity).reshape(-1, 2).sum(
            0
        ) + simulation.rigid.momentum()

    before, pushed = momentum(), 0.0
    for step in simulation.steps(simulation.time + 10 * simulation.step_size):
        contacts = find_contact_forces(simulation)
        side = (contacts.bodies >= first_ground) @ np.array([-1.0, 1.0])
        from_ground = side @ contacts.force
        pushed += step.size * abs(from_ground[1])
        after = momentum()
        expected = step.size * (from_ground + (0.0, weight))
        assert after - before == pytest.approx(expected, abs=1e-9 * np.abs(before).max())
        before = after
    assert pushed > 0.0
