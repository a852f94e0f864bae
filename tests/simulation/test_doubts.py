# SPDX-License-Identifier: LGPL-3.0-or-later
"""Warnings of steps: once, with a count at the end."""

import numpy as np
import pytest

import xper_fx as xf
from xper_fx.nscd.stepped_points import StepWork
from xper_fx.simulation.doubts import BROKEN_FOR_NOTHING, STRAINED, UNSEEN, Doubts
from xper_fx.simulation.energy_ledger import BulkEnergies


def test_a_doubt_is_told_once_and_counted(caplog):
    doubts = Doubts()
    with caplog.at_level("WARNING", logger="xper_fx"):
        for number in (3, 4, 8):
            doubts.tell(BROKEN_FOR_NOTHING, number, 0.1)
        doubts.tell(UNSEEN, 5, 0.1)
        told = [r.getMessage() for r in caplog.records]
        assert told == [
            f"step 3 at h = 0.1 s: {BROKEN_FOR_NOTHING}",
            f"step 5 at h = 0.1 s: {UNSEEN}",
        ]
        caplog.clear()
        doubts.sum_up()
        doubts.sum_up()
    (told,) = (r.getMessage() for r in caplog.records)
    assert told == f"3 steps: {BROKEN_FOR_NOTHING}"


def test_what_is_rounding_beside_the_run_is_no_snap(caplog):
    """Bodies that have parted: 1e-30 J of friction and 3e-30 J that are freed."""
    doubts, bulk = Doubts(), BulkEnergies(0.0, 0.0, 1.0, 0.0, 0.0)
    nothing = StepWork(0.0, 0.0, 0.0, 0.0, 0.0)
    doubts.tell_snap(nothing._replace(friction=0.1), bulk, 1, 1.0)
    for kind in ("friction", "cohesion"):
        work = nothing._replace(numerical=3e-30, **{kind: 1e-30})
        doubts.tell_snap(work, bulk._replace(elastic=0.0), 2, 1.0)
    assert not caplog.records
    doubts.tell_snap(nothing._replace(cohesion=0.1, numerical=0.1), bulk, 3, 1.0)
    assert "the load snaps" in caplog.records[0].message


def test_bodies_that_let_go_of_each_other_are_told(caplog):
    """Neither friction nor bonds take what that frees."""
    work, bulk = StepWork(0.0, 0.0, 0.0, 0.0, 0.0), BulkEnergies(0.0, 0.0, 1.0, 0.0, 0.0)
    with caplog.at_level("WARNING", logger="xper_fx"):
        Doubts().tell_snap(work._replace(numerical=0.1, friction=1e-9), bulk, 1, 1.0)
        Doubts().tell_snap(work._replace(numerical=5e-4), bulk, 1, 1.0)
    (told,) = caplog.records
    assert "let go of each other" in told.message and told.message.endswith(": 0.1 J")


def test_bonds_that_break_for_energy_that_nothing_gave_are_told(caplog):
    """Friction whose trapezoids err in a first step is no such thing."""
    work, bulk = StepWork(0.0, 0.0, 0.0, 0.0, 0.0), BulkEnergies(0.0, 0.0, 1.0, 0.0, 0.0)
    with caplog.at_level("WARNING", logger="xper_fx"):
        doubts = Doubts()
        doubts.tell_snap(work._replace(numerical=-0.2, cohesion=0.1, friction=0.3), bulk, 1, 1.0)
        doubts.tell_snap(work._replace(numerical=-0.1, cohesion=0.5), bulk, 2, 1.0)
        doubts.tell_snap(work._replace(numerical=-0.4, friction=-1e-3), bulk, 2, 1.0)  # no bonds
        assert not caplog.records
        doubts.tell_snap(work._replace(numerical=-0.4, cohesion=0.5), bulk, 3, 1.0)
    (told,) = caplog.records
    assert "energy that nothing gave" in told.message and "0.4 J" in told.message


def test_a_disc_that_meets_a_block_within_a_step_frees_nothing(caplog):
    """The gap that closes in the first step is no snap, though its impact is booked.

    It is 0.04 facets.
    """
    mesh = xf.crossed_rectangle((0.0, 0.0), (0.04, 0.03), (4, 3))
    below = xf.tag_facets(mesh, {1: lambda x: x[1] < 1e-9})
    one = [0] * mesh.topology.index_map(2).size_local
    punch = {0: 0.0, 1: -1e-2, 2: 0.0}
    scene = xf.Scene(
        xf.explode(mesh, one, facet_tags=below),
        {1: xf.materials.LinearElastic(3e9, 0.3, 1200.0)},
        surfaces={"block": (1,)},
        rigid=[xf.RigidBody(xf.rigid.Disc(0.01), (0.02, 0.0404), "punch", prescribed=punch)],
        contacts=[xf.Contact(("block", "punch"), xf.laws.SignoriniCoulomb(contact="position"))],
        loads=[xf.PrescribedDisplacement(1, 0, 0.0), xf.PrescribedDisplacement(1, 1, 0.0)],
    )
    simulation = xf.Simulation(scene, 0.05, inertia=False, num_threads=1)
    with caplog.at_level("WARNING", logger="xper_fx"):
        *_, step = simulation.steps(0.05)
    held = 4e-4 * -simulation.reaction_of("punch")[1]
    assert held > 0.0
    np.testing.assert_allclose(step.energies["dissipated_impact"], held, rtol=1e-3)
    np.testing.assert_allclose(step.energies["dissipated_numerical"], -0.5 * held, rtol=1e-3)
    assert not caplog.records


@pytest.mark.parametrize(
    "material, shear, told",
    [
        (xf.materials.LinearElastic(1e9, 0.3, 1000.0), 0.25, True),
        (xf.materials.LinearElastic(1e9, 0.3, 1000.0), 0.15, False),
        (xf.materials.NeoHookean(1e9, 0.3, 1000.0), 0.25, False),
    ],
)
def test_cells_that_turn_beyond_small_strain_in_a_static_run_are_told(
    material, shear, told, caplog
):
    mesh = xf.crossed_rectangle((0.0, 0.0), (1.0, 1.0), (2, 2))
    sides = xf.tag_facets(mesh, {1: lambda x: x[1] < 1e-9, 2: lambda x: x[1] > 1.0 - 1e-9})
    loads = [xf.PrescribedDisplacement(side, 1, 0.0) for side in (1, 2)]
    loads += [xf.PrescribedDisplacement(1, 0, 0.0)]
    loads += [xf.PrescribedDisplacement(2, 0, lambda t: shear * t)]
    scene = xf.Scene(xf.explode(mesh, [0] * 16, facet_tags=sides), {1: material}, loads=loads)
    simulation = xf.Simulation(scene, 0.5, inertia=False, num_threads=1)
    with caplog.at_level("WARNING", logger="xper_fx"):
        for _ in simulation.steps(1.0):
            pass
    assert [STRAINED in record.getMessage() for record in caplog.records] == [True] * told
    for record in caplog.records:
        assert float(record.getMessage().split()[-1]) == pytest.approx(shear, rel=0.1)


def shifted(path: list, held: bool) -> xf.Simulation:
    """A static run of a square whose right side follows a path; its left side is held or free."""
    mesh = xf.crossed_rectangle((0.0, 0.0), (1.0, 1.0), (6, 6))
    sides = {1: lambda x: x[0] < 1e-9, 2: lambda x: x[0] > 1.0 - 1e-9}
    bodies = xf.explode(mesh, np.zeros(144, int), facet_tags=xf.tag_facets(mesh, sides))
    follow = [lambda t, by=by: by * float(np.interp(t, range(len(path)), path)) for by in (1, 0.7)]
    loads = [xf.PrescribedDisplacement(2, i, follow[i]) for i in (0, 1)]
    loads += [xf.PrescribedDisplacement(1, i, 0.0) for i in (0, 1) if held]
    steel = xf.materials.LinearElastic(1e9, 0.3, 1e3)
    return xf.Simulation(xf.Scene(bodies, {1: steel}, loads=loads), 0.02, inertia=False)


@pytest.mark.parametrize(
    ("path", "held"), [([0.0, 1.5], False), ([0.0, 1e-3, 0.0], True)], ids=["moved", "released"]
)
def test_a_ledger_of_rounding_alone_is_not_told(path, held, caplog, monkeypatch):
    """A body that is moved as it is, and one that is stretched and let go."""
    monkeypatch.setattr("xper_fx.simulation.doubts._UNBALANCED", 0.01)
    simulation = shifted(path, held)
    with caplog.at_level("WARNING", logger="xper_fx"):
        for _ in simulation.steps(len(path) - 1.0):
            pass
        ledger = simulation.ledger
        assert ledger.from_nowhere > 0.01 and ledger.is_rounding(simulation.state.displacement)
        assert not caplog.records
