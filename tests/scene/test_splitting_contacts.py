# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pieces of bodies whose vertices split, and contacts that a search finds between them."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import box_bodies

import xper_fx as xf
from xper_fx.support.compat import geometry_dofmap

ELASTIC = xf.materials.LinearElastic(young=1.0, poisson=0.3, density=1.0)
LIPS = xf.laws.SignoriniCoulomb(0.3)
UNBREAKABLE = xf.laws.RigidCohesiveZone(1e3, 1e3, friction=0.3)
BRITTLE = xf.laws.RigidCohesiveZone(1e-2, 1e-5, friction=0.3)
BOXES = {2: ("crossed", (2.0, 1.0), (4, 2)), 3: ("tetrahedron", (2.0, 1.0, 1.0), (2, 1, 1))}
in_both = pytest.mark.parametrize("dim", [2, 3])


def blocks(dim, law, speed, label=None):
    """Two blocks that fly at each other, off centre so that no nodes face each other."""
    kind, lengths, cells = BOXES[dim]
    bodies = box_bodies(lengths, cells, kind, label, {2: lambda x: x[0] > 1.0 - 1e-9})
    second = geometry_dofmap(bodies.mesh)[bodies.material_of_cell == 2]
    bodies.mesh.geometry.x[np.unique(second), :dim] += (1e-3, 0.23, 0.17)[:dim]
    pairs = [("a", "b"), ("a", "a"), ("b", "b")]
    return xf.Scene(
        bodies, {1: ELASTIC, 2: ELASTIC}, interactions={(1, 2): None}, default_interaction=law,
        surfaces={"a": (1,), "b": (2,)}, contacts=[xf.Contact(pair, LIPS) for pair in pairs],
        initial_velocity={
            tag: lambda x, v=v: np.outer(np.eye(dim)[0], np.full(x.shape[1], v))
            for tag, v in ((1, speed), (2, -speed))
        },
    )  # fmt: skip


def simulated(scene, step=None, tolerance=1e-4):
    options = {"tolerance": tolerance, "num_threads": 1, "forgiving": True}
    return xf.Simulation(scene, step, scheme="explicit", **options)


def displacements(simulation):
    """Those of the corners of the cells, and where these were; of the first block, then of the
    second."""
    V, dim = simulation.forms.V, simulation.bulk.dim
    u = simulation.bulk.unknowns.expand(simulation.state.displacement).reshape(-1, dim)
    x, cells = V.tabulate_dof_coordinates()[:, :dim], V.dofmap.list
    material = simulation.scene.bodies.material_of_cell
    return [(x[cells[material == tag]], u[cells[material == tag]]) for tag in (1, 2)]


@in_both
def test_blocks_whose_vertices_hold_strike_each_other_as_blocks_of_one_piece(dim):
    """Nodes of whole vertices have the mass of all their cells, in contacts too."""
    split = simulated(blocks(dim, UNBREAKABLE, 0.05), tolerance=1e-11)
    step = split.step_size
    label = lambda x: (x[0] > 1.0).astype(int)  # noqa: E731
    one = simulated(blocks(dim, None, 0.05, label), step, tolerance=1e-11)
    assert split.interactions.fused is not None and one.interactions.fused is None
    for simulation in (split, one):
        sweeps = [simulation.last.sweeps for _ in simulation.steps(25 * step)]
        assert 1 < max(sweeps) < 150  # with the masses of cells alone 200 to 400
    energies = [simulation.ledger.energies for simulation in (split, one)]
    for name in ("kinetic", "dissipated_impact", "dissipated_friction"):
        found, exact = (getattr(e, name) for e in energies)
        assert exact > 1e-7
        assert found == pytest.approx(exact, rel=1e-9)
    for (x, u), (x1, u1) in zip(displacements(split), displacements(one), strict=True):
        for p, moved in zip(x.reshape(-1, dim), u.reshape(-1, dim), strict=True):
            same = np.abs(x1 - p).max(axis=-1) < 1e-12
            assert np.abs(u1[same] - moved).max() < 1e-9 * np.abs(u1).max()
    assert len(split.interactions.fused.split) == 0


@pytest.mark.slow
@in_both
def test_pieces_meet_where_their_bonds_have_retired(dim):
    """Momentum and ledger to rounding, w for each bond; the search takes over the open facets."""
    simulation = simulated(blocks(dim, BRITTLE, 0.1))
    points, mass = simulation.interactions, simulation.bulk.mass.reshape(-1, dim)
    size = np.abs(mass * simulation.state.velocity.reshape(-1, dim)).sum()
    held, within, lost = simulation.ledger.energies.kinetic, 0, 0.0
    block = np.repeat(simulation.scene.bodies.material_of_cell, dim + 1)  # node after node
    block = block[np.argsort(simulation.forms.V.dofmap.list.ravel())][simulation.model.slot_nodes]
    for _ in simulation.steps(4.0):
        e = simulation.ledger.energies
        assert abs(simulation.ledger.closure) < 1e-12 * held
        now = e.dissipated_impact + e.dissipated_friction
        assert now > lost - 1e-5 * held  # the tolerance
        lost = now
        for group in points.contacts:
            blocks_of = block[group.points.nodes[group.impulse[:, 0] > 0.0]].reshape(-1, 2 * dim)
            within += np.count_nonzero(np.all(blocks_of == blocks_of[:, :1], axis=1))
    momentum = (mass * simulation.state.velocity.reshape(-1, dim)).sum(axis=0)
    assert np.abs(momentum).max() < 1e-13 * size
    spent, area = points.gather("spent"), points.gather("area")
    energy = BRITTLE.fracture_energy * (spent @ area)
    assert e.dissipated_cohesion == pytest.approx(energy, rel=1e-10)
    retired = points.fused.graphs.point[points.fused.group_of < 0]
    assert len(retired) > 0 and np.all(spent[retired] == 1.0)
    assert sum(map(len, points.groups[:1])) + len(retired) + len(points.fused.asleep) == len(points)
    assert within > 2  # contacts between pieces of one block
