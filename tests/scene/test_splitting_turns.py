# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vertices that split at finite strain: bodies turn, and break as they do."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import LEFT, RIGHT, box_bodies

import xper_fx as xf

SOFT = xf.materials.SaintVenantKirchhoff(young=1.0, poisson=0.3, density=1.0)
UNBREAKABLE = xf.laws.RigidCohesiveZone(1e3, 1e3, friction=0.3)
TOUGH = xf.laws.RigidCohesiveZone(1e-2, 1e-3, friction=0.3)
BOXES = {2: ("crossed", (2.0, 1.0), (4, 2)), 3: ("tetrahedron", (2.0, 1.0, 1.0), (2, 1, 1))}
SPIN = 0.1
in_both = pytest.mark.parametrize("dim", [2, 3])


def box(dim, law, label=None, step=None, **options):
    kind, lengths, cells = BOXES[dim]
    bodies = box_bodies(lengths, cells, kind, label)
    scene = xf.Scene(bodies, {1: SOFT}, default_interaction=law, **options)
    return xf.Simulation(scene, step, scheme="explicit", num_threads=1)


def spinning(stretch):
    """A field that makes a body spin about the axis (1, 1/2), and tears it apart."""
    return lambda x: np.array(
        [stretch * np.sin(2.0 * x[0]) - SPIN * (x[1] - 0.5), SPIN * (x[0] - 1.0), 0.0 * x[0]]
    )


def positions(simulation):
    dim = simulation.bulk.dim
    x = simulation.forms.V.tabulate_dof_coordinates()[:, :dim]
    return x, x + simulation.state.displacement.reshape(-1, dim)


def angular_momentum(simulation):
    x = positions(simulation)[1]
    p = (simulation.bulk.mass * simulation.state.velocity).reshape(x.shape)
    return np.sum(x[:, 0] * p[:, 1] - x[:, 1] * p[:, 0])


@in_both
def test_a_body_whose_vertices_hold_turns_as_one_piece(dim):
    """So do the normals of its bonds, which have no points."""
    start = {"initial_velocity": lambda x: spinning(0.0)(x)[:dim]}
    split = box(dim, UNBREAKABLE, **start)
    normals = split.interactions.fused.graphs.normal.copy()
    one = box(dim, None, 0, split.step_size, **start)
    for simulation in (split, one):
        list(simulation.steps(16.0))
    (x, now), (x1, now1) = positions(split), positions(one)
    place = np.array([np.argmin(np.sum((x1 - p) ** 2, axis=1)) for p in x])
    assert np.abs(now - now1[place]).max() < 1e-12
    assert all(len(group) == 0 for group in split.interactions.groups)
    # by some 1.6 rad, less what the body is strained
    turned = np.einsum("qd,qd->q", normals, split.interactions.fused.graphs.normal)
    about = np.abs(normals[:, :2]).max(axis=1) > 0.99
    assert np.abs(turned[about]).max() < 0.2


@in_both
def test_a_body_that_softens_as_it_turns_keeps_its_angular_momentum(dim):
    """The couples of open bonds act on clusters."""
    simulation = box(dim, TOUGH, initial_velocity=lambda x: spinning(0.03)(x)[:dim])
    start = angular_momentum(simulation)
    fused = simulation.interactions.fused
    for _ in simulation.steps(5.0):  # points that have just come about have turned as others have
        frame = fused.groups[0].couplings.frame[fused.rows[fused.rows >= 0], 0]
        assert np.abs(frame - fused.graphs.normal[fused.rows >= 0]).max(initial=0.0) < 1e-12
    e = simulation.ledger.energies
    assert e.cohesive > 1e-5 and e.dissipated_cohesion > 1e-5
    assert abs(angular_momentum(simulation) - start) < 1e-9 * abs(start)
    assert abs(e.dissipated_numerical) < 1e-2 * e.dissipated_cohesion


def test_reactions_balance_what_bonds_hand_on_to_driven_cells():
    """The upper half of a side is driven, and bonds below it open; cells hang on driven ones."""
    weak = lambda x: np.where((x[0] > 1.4) & (x[1] < 0.45), 1.0, 100.0) * 1e-2  # noqa: E731
    mesh = xf.crossed_rectangle((0.0, 0.0), (2.0, 1.0), (4, 2))
    sides = {LEFT: lambda x: x[0] < 1e-9, RIGHT: lambda x: (x[0] > 1.999) & (x[1] > 0.499)}
    loads = [xf.PrescribedVelocity(LEFT, axis, 0.0) for axis in (0, 1)]
    loads += [xf.PrescribedVelocity(RIGHT, axis, 0.1) for axis in (0, 1)]
    scene = xf.Scene(
        xf.explode(mesh, facet_tags=xf.tag_facets(mesh, sides)), {1: SOFT}, loads=loads,
        default_interaction=xf.laws.RigidCohesiveZone(weak, 1e-3),
    )  # fmt: skip
    simulation = xf.Simulation(scene, scheme="explicit", num_threads=1)
    mass, couples = simulation.bulk.mass, 0.0
    before = simulation.state.velocity
    for _ in simulation.steps(2.5):
        change = (mass * (simulation.state.velocity - before)).reshape(-1, 2).sum(axis=0)
        before = simulation.state.velocity
        reaction = simulation.last.reactions.reshape(-1, 2).sum(axis=0)
        assert np.abs(change - reaction).max() < 1e-13
        given = simulation.interactions.couples()[simulation.interactions.fused.graphs.corner]
        couples = max(couples, np.abs(given).max())
    assert couples > 1e-7
