# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton's linear problem over ranks: its product, its corrections, and the matrix factored."""

import sys
from pathlib import Path
from unittest.mock import patch

import numpy as np
from mpi4py import MPI

sys.path.insert(0, str(Path(__file__).parents[2] / "demos"))
from notched_plate import notched_plate

import xper_fx.parallel.border as border
from xper_fx.nscd.solvers.shared_tangent import SharedProblem
from xper_fx.parallel.launch import run_together
from xper_fx.simulation.simulation import Simulation


def main() -> None:
    """All; said when nothing has failed."""
    simulation = Simulation(notched_plate(20, "weak"), 2e-9, scheme="implicit", num_threads=1)
    for _ in simulation.steps(2 * simulation.step_size):
        pass
    interactions = simulation.interactions
    problem = SharedProblem(interactions)
    rng = np.random.default_rng(interactions.halo.ranks.rank)
    velocity = 1e-3 * rng.normal(size=interactions.inverse.num_slots * 2)
    interactions.refresh_ghosts(velocity)
    problem.linearise(velocity)
    assert problem.regular and problem.solvable and problem.held > 0.9
    n = len(problem._left)
    r = rng.normal(size=n)
    problem.hold(r)
    z, y, product = np.empty((3, n))

    # the pass that gives z gives A z, without the correction of all clusters moving as one and with
    assert problem._first(r, z, y)
    problem._apply(z, product)
    near(interactions, y, product, 1e-11)
    problem._precondition(r, z, y)
    problem._apply(z, product)
    near(interactions, y, product, 1e-9)

    # P^T (w^-1 z - r) = 0 in every direction that is not left out
    as_one, moved = problem._clusters_as_one(), np.empty(n)
    assert as_one.there and problem._cut.border.count > 10
    as_one.solve(r, moved)
    problem.momentum(moved, product)
    left = over_clusters(problem, product - r)
    assert left.max() < 1e-9 * over_clusters(problem, r).max()

    # MUMPS solves the border of many ranks
    border._EVERYWHERE = 0
    again = np.empty(n)
    problem._clusters_as_one().solve(r, again)
    near(interactions, again, moved, 1e-9)
    as_one = problem._clusters_as_one()
    as_one.solve(np.nan * r, again)  # raises nothing: the step is cut
    assert np.isnan(again).any()
    with patch.object(border, "PETSc") as petsc:  # without MUMPS
        petsc.Sys.hasExternalPackage.return_value = False
        problem._clusters_as_one().solve(r, again)
    near(interactions, again, moved, 1e-12)

    problem._direct = problem._fresh = True
    problem.linearise(velocity)
    assert problem.solvable
    problem._precondition(r, z, y)
    near(interactions, y, r, 1e-8)
    if MPI.COMM_WORLD.rank == 0:
        print("linearised", flush=True)


def near(interactions, found, expected, tolerance):
    apart, size = interactions.total(np.array([norm2(found - expected), norm2(expected)]))
    assert apart <= tolerance**2 * size, (apart / size) ** 0.5


def norm2(x):
    return float(x @ x)


def over_clusters(problem, forces):
    """|P^T f| at clusters of this rank's, those that are cut with the nodes of all ranks."""
    cut, clusters = problem._cut, problem._cut.clusters
    whole = np.zeros(len(clusters.cluster) * 2)
    whole[: len(forces)] = forces
    at_cut = clusters.nodes[: clusters.offsets[cut.cut]]
    whole.reshape(-1, 2)[at_cut] = problem._told(forces).reshape(-1, 2)
    sums = np.zeros((len(cut.opened), 2))
    np.add.at(sums, clusters.cluster, whole.reshape(-1, 2))
    free = ~np.repeat(cut.opened[:, None], 2, axis=1)
    slot, axis = np.nonzero(problem._fixed.reshape(-1, 2))
    free[clusters.cluster[slot], axis] = False
    return np.abs(sums[: cut.own] * free[: cut.own])


run_together(main)
