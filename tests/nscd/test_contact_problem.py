# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts of scenes as a `FrictionProblem`: W, q, and its solvers in the time loop."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

import xper_fx as xf
from xper_fx.nscd.local_solvers import LOCAL_SOLVERS
from xper_fx.nscd.solvers import AssembledContacts, InteriorPoint, UnsuitableSolverError
from xper_fx.nscd.solvers.contact_problem import ContactProblem

ASSEMBLED = ("friction_problem", "interior_point", "proximal_point")
GRAVITY = 9.81


def box(x, y, group="blocks", size=(0.4, 0.2), **options):
    options = {"density": 2000.0} | options
    return xf.RigidBody(xf.rigid.Polygon.box(size), (x, y), group, **options)


def pile_of_blocks(law, gravity=(0.0, -GRAVITY), rows=4):
    """Blocks in a pyramid on a floor."""
    floor = xf.rigid.wall((0.0, 0.0), (0.0, 1.0), "floor")
    bodies = [
        box(0.4 * i - 0.2 * (rows - row), 0.1 + 0.2 * row)
        for row in range(rows)
        for i in range(rows - row)
    ]
    return xf.Scene(
        rigid=[*bodies, floor],
        contacts=[xf.Contact(("blocks", group), law) for group in ("blocks", "floor")],
        loads=[xf.Gravity(gravity)],
    )


def spheres_in_a_corner(law):
    corner = [xf.rigid.wall((0, 0, 0), n, "walls") for n in ((0, 0, 1), (1, 0, 0), (0, 1, 0.2))]
    places = [(0.5, 0.6, 0.5), (1.4, 0.7, 0.5), (0.9, 0.7, 1.3), (0.6, 1.6, 0.45)]
    bodies = [xf.RigidBody(xf.rigid.Sphere(0.5), p, "balls", density=1000.0) for p in places]
    return xf.Scene(
        rigid=[*bodies, *corner],
        contacts=[xf.Contact(("balls", group), law, reach=0.2) for group in ("balls", "walls")],
        loads=[xf.Gravity((0.0, 0.3, -GRAVITY))],
        resolve_overlaps=True,
    )


def after(scene, steps, step=1e-3, **options):
    simulation = xf.Simulation(scene, step=step, **({"tolerance": 1e-9} | options))
    for _ in simulation.steps(steps * step):
        pass
    return simulation


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("contact", ["velocity", "position"])
def test_assembled_as_bodies_move(dim, contact):
    """W r + q is what the points read off the bodies after these impulses have moved them."""
    law = xf.laws.SignoriniCoulomb(0.5, contact=contact)
    scene = spheres_in_a_corner(law) if dim == 3 else pile_of_blocks(law, gravity=(9.0, -GRAVITY))
    simulation = after(scene, 3, solver="nlgs")
    simulation.interactions.prepare()
    interactions = simulation.interactions
    rng = np.random.default_rng(3)
    free = rng.normal(size=interactions.inverse.num_slots * dim)
    free[-2 * dim :] = 0.0  # the ground
    assembled = ContactProblem(interactions, free)
    problem = assembled.problem
    r = rng.normal(size=problem.q.shape)
    assembled.take(r)
    np.testing.assert_array_equal(assembled.impulses(), r)
    velocity = free.copy()
    interactions.add_velocity(velocity)
    read = []
    for group, closed in zip(interactions.groups, assembled.closed, strict=True):
        wanted = group.kernels.coulomb(group.terms, group.details, group.parameters)
        u = group.points.relative(velocity.reshape(-1, dim))
        u[:, 0] -= wanted.least
        u[:, 1:] += wanted.shift
        read.append(u[closed].ravel())
    expected = np.concatenate(read)
    assert len(expected) > 10
    np.testing.assert_allclose(
        problem.W @ r + problem.q, expected, rtol=0.0, atol=1e-12 * np.abs(expected).max()
    )


def discs_in_a_corner(law):
    corner = [xf.rigid.wall((0, 0), n, "walls") for n in ((0, 1), (1, 0))]
    places = [(0.5, 0.5), (1.5, 0.5), (1.0, 0.5 + 0.75**0.5), (2.5, 0.5)]
    bodies = [
        xf.RigidBody(xf.rigid.Disc(0.5), p, "balls", density=1000.0, spin=1.0) for p in places
    ]
    return xf.Scene(
        rigid=[*bodies, *corner],
        contacts=[xf.Contact(("balls", group), law, reach=0.2) for group in ("balls", "walls")],
        loads=[xf.Gravity((1.0, -GRAVITY))],
        resolve_overlaps=True,
    )


@pytest.mark.slow
@pytest.mark.parametrize("dim", [2, 3])
def test_every_local_solver_gives_the_same_motion(dim, monkeypatch):
    results, own = [], xf.FrictionProblem.solve
    monkeypatch.setattr(
        xf.FrictionProblem, "solve", lambda *a, **o: results.append(own(*a, **o)) or results[-1]
    )
    law = xf.laws.SignoriniCoulomb(0.3)
    scene = discs_in_a_corner(law) if dim == 2 else spheres_in_a_corner(law)
    sweeps = after(scene, 10, solver="nlgs").rigid.state
    assert np.abs(sweeps.turn.spin).max() > 0.05
    for name in LOCAL_SOLVERS[dim]:
        facets = 64 if (dim, name) == (3, "lcp") else None
        solver = AssembledContacts(local_solver=name, facets=facets)
        state = after(scene, 10, solver=solver).rigid.state
        assert {result.local_solver for result in results} == {name} and len(results) >= 10
        assert facets or all(result.solver == "nlgs" for result in results)
        results.clear()
        np.testing.assert_allclose(state.velocity, sweeps.velocity, atol=1e-6, err_msg=name)
        np.testing.assert_allclose(state.turn.spin, sweeps.turn.spin, atol=1e-6, err_msg=name)


def test_local_solvers_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match="should be one of auto, explicit, graph"):
        AssembledContacts(local_solver="exactly")
    with pytest.raises(ValueError, match="makes no sweeps over contacts"):
        InteriorPoint(local_solver="exact")
    friction, rolling = xf.laws.SignoriniCoulomb(0.5), xf.laws.SignoriniCoulomb(0.5, rolling=0.1)
    with pytest.raises(ValueError, match='"explicit" wants diagonal blocks'):
        after(pile_of_blocks(friction), 1, solver=AssembledContacts(local_solver="explicit"))
    with pytest.raises(ValueError, match="should be one of auto, explicit, graph, bipotential"):
        after(pile_of_blocks(friction), 1, solver=AssembledContacts(local_solver="exact"))
    with pytest.raises(UnsuitableSolverError, match="rolling resistance"):
        after(discs_in_a_corner(rolling), 1, solver=AssembledContacts(local_solver="graph"))


class Pushed(NamedTuple):
    """Positions of a pile at first, and in the end."""

    start: np.ndarray
    position: np.ndarray


@cache
def pushed_aside(law, solver: str, tolerance: float) -> Pushed:
    """A pile of blocks, after 25 steps."""
    scene = pile_of_blocks(law, gravity=(6.0, -GRAVITY))
    rigid = after(scene, 25, solver=solver, tolerance=tolerance).rigid
    return Pushed(rigid.start.position, rigid.state.position)


@pytest.mark.slow
@pytest.mark.parametrize("solver", ASSEMBLED)
@pytest.mark.parametrize(
    "law",
    [
        xf.laws.SignoriniCoulomb(0.5),
        xf.laws.SignoriniCoulomb(0.5, contact="position"),
        xf.laws.SignoriniCoulomb(),
        xf.laws.SlipWeakening(0.6, 0.3, 1e-4),
        xf.laws.MohrCoulomb(0.5, cohesion=100.0, tension=200.0, slip_distance=1e-4),
    ],
    ids=["friction", "position", "frictionless", "weakening", "joint"],
)
def test_the_same_motion_as_by_sweeps(solver, law):
    """A pile pushed aside, part of which slides: positions agree to the tolerance."""
    # rounding ends the interior point near 1e-9
    tolerance = 1e-8 if solver == "interior_point" and law.kernels(2).evolve is None else 1e-9
    mine, sweeps = pushed_aside(law, solver, tolerance), pushed_aside(law, "nlgs", 1e-9)
    moved = mine.position - sweeps.start
    assert np.abs(moved).max() > 1e-5
    np.testing.assert_allclose(
        mine.position, sweeps.position, rtol=0.0, atol=2e-4 * np.abs(moved).max()
    )


@pytest.mark.parametrize("solver", ASSEMBLED)
def test_spheres_by_every_solver(solver):
    scene = spheres_in_a_corner(xf.laws.SignoriniCoulomb(0.4))
    mine, sweeps = (after(scene, 60, solver=name) for name in (solver, "nlgs"))
    np.testing.assert_allclose(
        mine.rigid.state.position, sweeps.rigid.state.position, rtol=0.0, atol=1e-7
    )


def test_restitution_goes_into_the_problem():
    """A disc that falls on the floor at 1 m/s leaves it at e of that."""
    law = xf.laws.SignoriniCoulomb(restitution=0.7)
    floor = xf.rigid.wall((0.0, 0.0), (0.0, 1.0), "floor")
    disc = xf.RigidBody(xf.rigid.Disc(0.5), (0.0, 0.5), "disc", density=1.0, velocity=(0.0, -1.0))
    contacts = [xf.Contact(("disc", "floor"), law)]
    simulation = after(xf.Scene(rigid=[disc, floor], contacts=contacts), 1, solver="interior_point")
    assert simulation.rigid.state.velocity[0, 1] == pytest.approx(0.7, abs=1e-8)


def test_a_lid_that_slides_along_its_walls():
    """Bodies guided along a line: what cannot move carries nothing, the rest is solved."""
    law = xf.laws.SignoriniCoulomb(friction=0.3)
    lid = box(0.0, 1.1, "lid", (1.0, 0.2), mass=5.0, density=None, prescribed={0: 0.0, 2: 0.0})
    sides = [xf.rigid.wall((x, 0.0), (-x, 0.0), "walls") for x in (-0.5, 0.5)]
    grain = xf.RigidBody(xf.rigid.Disc(0.5), (0.0, 0.5), "grain", mass=2.0)
    floor = xf.rigid.wall((0.0, 0.0), (0.0, 1.0), "walls")
    pairs = [("lid", "walls"), ("lid", "grain"), ("grain", "walls")]
    scene = xf.Scene(
        rigid=[lid, grain, *sides, floor], contacts=[xf.Contact(pair, law) for pair in pairs],
        loads=[xf.Gravity((0.0, -10.0))],
    )  # fmt: skip
    simulation = after(scene, 5, solver="interior_point")
    assert np.abs(simulation.rigid.state.velocity).max() < 1e-9
    assert simulation.reaction_of("walls")[1] == pytest.approx(70.0, rel=1e-6)


def test_the_problem_of_the_next_step():
    """It is solved as the step is, and asking for it changes no bit of the run."""
    scene = pile_of_blocks(xf.laws.SignoriniCoulomb(0.5), gravity=(3.0, -GRAVITY))
    asked, plain = (xf.Simulation(scene, step=1e-3, solver="interior_point") for _ in range(2))
    problem = asked.contact_problem()
    result = problem.solve()
    assert result.converged
    for simulation in (asked, plain):
        for _ in simulation.steps(5e-3):
            pass
    for name in ("position", "velocity"):
        mine, theirs = (getattr(s.rigid.state, name) for s in (asked, plain))
        np.testing.assert_array_equal(mine, theirs)
    once = after(scene, 1, solver="interior_point")
    velocity = np.concatenate([group.velocity.ravel() for group in once.interactions.contacts])
    np.testing.assert_allclose(
        result.velocity, velocity, rtol=0.0, atol=1e-7 * np.abs(problem.q).max()
    )


@pytest.mark.slow
def test_a_tower_stands_by_default():
    """Fifty blocks, two seconds: sweeps alone, within the same tolerance, lean by 0.2 m."""
    floor = xf.rigid.wall((0.0, 0.0), (0.0, 1.0), "floor")
    blocks = [box(0.0, 0.5 + i, size=(1.0, 1.0)) for i in range(50)]
    law = xf.laws.SignoriniCoulomb(friction=0.5)
    contacts = [xf.Contact(("blocks", group), law) for group in ("blocks", "floor")]
    scene = xf.Scene(rigid=[*blocks, floor], contacts=contacts, loads=[xf.Gravity((0, -GRAVITY))])
    simulation = after(scene, 400, step=5e-3, tolerance=None)
    moved = simulation.rigid.state.position - simulation.rigid.start.position
    assert np.abs(moved).max() < 1e-4


def test_laws_of_another_kind_are_refused():
    simulation = xf.Simulation(pile_of_blocks(xf.laws.Tresca(bound=100.0)), step=1e-3)
    with pytest.raises(UnsuitableSolverError, match="bound on friction"):
        simulation.contact_problem()
    mesh = xf.crossed_rectangle((0.0, 0.0), (1.0, 1.0), (2, 2))
    bonded = xf.Scene(
        xf.explode(mesh, np.arange(16) % 2),
        {1: xf.materials.LinearElastic(young=1e6, poisson=0.3, density=1.0)},
        default_interaction=xf.laws.PerfectBond(),
    )
    simulation = xf.Simulation(bonded, step=1e-4, solver="interior_point")
    with pytest.raises(UnsuitableSolverError, match="not that of a FrictionProblem"):
        next(simulation.steps(1e-4))


def test_no_closed_contact_is_said():
    law = xf.laws.SignoriniCoulomb()
    apart = xf.Scene(
        rigid=[box(0.0, 5.0), xf.rigid.wall((0.0, 0.0), (0.0, 1.0), "floor")],
        contacts=[xf.Contact(("blocks", "floor"), law)],
    )
    with pytest.raises(ValueError, match="No contact is closed"):
        xf.Simulation(apart, step=1e-3).contact_problem()
