# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sweeps over points that several ranks share.

A sweep of all ranks together is a Gauss-Seidel sweep in another order, so that it converges where
`nlgs.py` does. Points between bodies of two ranks come first, phase by phase (`turns.py`): in a
phase one rank at most moves a body, which then goes on to the next that does, and home at last.
Then each rank visits the points between its own bodies, all ranks at once.

The error is estimated as in `nlgs.py`, from changes summed over all ranks, and contacts of rigid
bodies are judged by velocities, as there: the points that two ranks share are visited one after
another like all others, so that what is summed is the same violation. Where vertices are
solved alone (`vertex_blocks.py`, `splitting/`) each is on one rank: velocities go to the ghosts
before, and back after, once a step. Where contacts touch vertices that split, ranks exchange what
moves as one in each turn besides (`touching/shared_clusters.py`).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from xper_fx.nscd.algebra.small import sym_indices
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.ordering import mark_next
from xper_fx.nscd.solvers.solver import SolveOptions, Solver, SolveReport
from xper_fx.nscd.solvers.sweeps import (
    FIRST_BATCH,
    NEGLIGIBLE,
    REVISIT,
    ROUNDING,
    WINDOW,
    amplification,
    contraction,
    prepare_sweep,
    sweep_ranks,
)

# Sweeps after which ranks tell each other how they go, if they are likely to take so many; of those
# made one in so many may be made in vain before the next look.
_FIRST_LOOK, _A_LOOK = 8, 32
# Least of the changes of some sweeps, beside the largest, where they are steady; by how many
# tolerances steps before may have left gaps that contradict each other.
_STEADY, _LEFT = 0.9, 10.0


class DistributedSweeps(Solver):
    """Sweeps over points that several ranks share; all ranks call it together."""

    name = "distributed"

    def __init__(self) -> None:
        self._vertices: Solver | None = None

    def solve(
        self, interactions: Interactions, velocity: np.ndarray, options: SolveOptions
    ) -> SolveReport:
        """Find the impulses of the step, as `Solver.solve` says."""
        if interactions.ordering == "vertices":
            return self._solve_vertices(interactions, velocity, options)
        if interactions.uses_velocity_criterion:
            return _solve_by_velocities(interactions, velocity, options)
        tolerance, max_sweeps = options.tolerance, options.max_sweeps
        halo, free = interactions.halo, velocity.copy()
        interactions.add_velocity(velocity)
        sweep = prepare_sweep(interactions, velocity, options)
        bodies = _Bodies(interactions, free)
        speed, least = float(np.abs(velocity).max(initial=0.0)), None
        changes: list[float] = []
        # |dr|^2 and |r|^2 of sweeps since ranks have looked, and when they look again
        untold: list[np.ndarray] = []
        early = options.likely_sweeps - 1
        look = min(early, _FIRST_LOOK)
        for count in range(1, max_sweeps + 1):
            sweep_ranks(interactions, sweep, velocity, first=count == 1)
            untold.append(sweep.stats[:, :2].sum(axis=0))
            if count < min(look, max_sweeps):
                continue
            if least is None:
                squares, speed = halo.ranks.sum_and_max(np.array(untold), speed)
                least = interactions.rounding_at(speed) / tolerance
            else:
                squares = halo.ranks.sum(np.array(untold))
            untold, look = [], max(count + 1 + count // _A_LOOK, min(2 * count, early))
            if not np.isfinite(squares[:, 0]).all():
                return SolveReport(False, count, np.inf, np.inf, "distributed")
            for changed, total in squares.tolist():
                total = max(total, least * least)
                change = (changed / total) ** 0.5 if total > 0.0 else changed**0.5
                changes = [*changes[-WINDOW:], change]
            error = change
            if change > ROUNDING:
                error *= amplification(np.array(changes))
            if error > tolerance:
                rest = change <= tolerance and bodies.rest(velocity, changed, changes, tolerance)
                if not rest:
                    continue
                error = change  # what it would grow to is infinite, and moves no body
            halo.everywhere.forward(velocity)
            evolved, largest = interactions.evolve_and_compare(velocity, sweep.largest_change())
            if evolved <= tolerance:
                traction = np.sqrt(largest) / interactions.step_size
                return SolveReport(True, count, error, traction, "distributed")
        rate = contraction(np.array(changes))
        halo.everywhere.forward(velocity)
        return SolveReport(False, max_sweeps, error, np.inf, "distributed", contraction=rate)

    def _solve_vertices(
        self, interactions: Interactions, velocity: np.ndarray, options: SolveOptions
    ) -> SolveReport:
        """Each vertex alone, between two exchanges; the report is of this rank's vertices."""
        if self._vertices is None:
            self._vertices = _vertex_solver(interactions)
        halo = interactions.halo
        halo.everywhere.forward(velocity)
        report = self._vertices.solve(interactions, velocity, options)
        halo.corners.back(velocity)
        return report._replace(solver="distributed")

    def kept(self) -> list[object]:
        """What is kept of vertices."""
        return [] if self._vertices is None else self._vertices.kept()

    def saved(self, interactions: Interactions) -> dict[str, dict[str, np.ndarray]]:
        """What is kept of vertices."""
        return {} if self._vertices is None else self._vertices.saved(interactions)

    def restore(self, interactions: Interactions, saved: Mapping[str, Mapping]) -> None:
        """Take what `saved` gave."""
        if saved:
            self._vertices = _vertex_solver(interactions)
            self._vertices.restore(interactions, saved)


class _Bodies:
    """Whether bodies rest from sweep to sweep while their impulses change.

    Where closed lips make a ring around a vertex, what the last of them asks of the velocities
    follows from what the others ask, but for what steps before have left of their gaps: no impulses
    meet all of it to the last digit. Each sweep then adds the same dr around the ring, for ever,
    and moves no body. Such impulses have arrived where |dr| is within the tolerance, and breaks the
    laws by a few tolerances in velocities, which are measured as those of rigid bodies (`nlgs.py`):
    sum_a dr_a . W_aa dr_a beside p . w p. Beside this, bonds that contradict each other break them
    by as much however large their impulses grow.

    Args:
        free: shape (num_slots * dim,), velocities without impulses (m/s).
    """

    def __init__(self, interactions: Interactions, free: np.ndarray):
        self._interactions, self._free = interactions, free
        self._last: np.ndarray | None = None
        self._moves: list[float] = []

    def rest(
        self, velocity: np.ndarray, changed: float, changes: list[float], tolerance: float
    ) -> bool:
        """Look at them after a sweep; all ranks call it together.

        Args:
            velocity: of the sweep.
            changed: sum |dr|^2 of the sweep, over all ranks.
            changes: relative changes of the last sweeps.
        """
        if len(changes) <= WINDOW or min(changes) < _STEADY * max(changes):
            self._last, self._moves = None, []
            return False
        points, last = self._interactions, self._last
        points.refresh_ghosts(velocity)
        self._last = velocity.copy()
        if last is None:
            return False
        squares = [np.vdot(v, v) for v in (velocity - last, velocity, velocity - self._free)]
        move, size, push = np.sqrt(points.total(np.array(squares))).tolist()
        self._moves = [*self._moves[-WINDOW:], move]
        if move > ROUNDING * size and (
            len(self._moves) == 1 or move * amplification(np.array(self._moves)) > tolerance * push
        ):
            return False
        traces = [g.compliance[:, np.equal(*sym_indices(g.kernels.components))].sum(axis=1)
                  for g in points.groups]  # fmt: skip
        most = points.largest(max((t.max(initial=0.0) for t in traces), default=0.0))
        energy, rounding = points.impulse_energy_norm(self._free, velocity)
        return (changed * most) ** 0.5 <= max(_LEFT * tolerance * energy, rounding)


def _solve_by_velocities(
    interactions: Interactions, velocity: np.ndarray, options: SolveOptions
) -> SolveReport:
    """`solve` of contacts of rigid bodies, which stops as `nlgs.py` says.

    Tiles at rest are passed over as there; bodies that another rank may have moved count as moved.
    """
    halo, ranks = interactions.halo, interactions.halo.ranks
    tolerance, max_sweeps = options.tolerance, options.max_sweeps
    sweep = prepare_sweep(interactions, velocity, options)
    free = velocity.copy()
    interactions.add_velocity(velocity)
    size, rounding = interactions.impulse_energy_norm(free, velocity)
    num_tiles = max(1.0, ranks.sum(len(sweep.marked)))
    moved = np.zeros(len(interactions.inverse.node_offsets) - 1, np.bool_)
    changes: list[float] = []
    looked_at, batch, verifying = 0, FIRST_BATCH, False
    for count in range(1, max_sweeps + 1):
        sweep_ranks(interactions, sweep, velocity)
        changed, resting = ranks.sum(
            np.array([sweep.stats[:, 0].sum(), np.count_nonzero(~sweep.marked)])
        ).tolist()
        left = changed**0.5
        if not verifying:
            changes = [*changes[-WINDOW:], left]
        goal = max(tolerance * size, rounding)
        arrived = left <= goal and resting == 0
        if arrived or count == looked_at + batch or not np.isfinite(left):
            # the size of the impulses' effect is looked at now and then, and before the end
            halo.everywhere.forward(velocity)
            size, rounding = interactions.impulse_energy_norm(free, velocity)
            looked_at, batch = count, 2 * batch
            goal = max(tolerance * size, rounding)
            arrived = arrived and left <= goal
        if arrived:
            traction = np.sqrt(ranks.max(sweep.largest_change())) / interactions.step_size
            residual = left / size if size > 0.0 else left
            return SolveReport(True, count, residual, traction, "distributed")
        if not np.isfinite(left):
            return SolveReport(False, count, np.inf, np.inf, "distributed")
        verifying = left <= goal
        moved[:] = verifying or count % REVISIT == 0
        moved[halo.cut] = True
        threshold = (NEGLIGIBLE * goal) ** 2 / num_tiles
        mark_next(sweep.marked, sweep.stats, sweep.tile_bodies, moved, threshold)
    halo.everywhere.forward(velocity)
    rate, residual = contraction(np.array(changes)), left / size if size > 0.0 else left
    return SolveReport(False, max_sweeps, residual, np.inf, "distributed", contraction=rate)


def _vertex_solver(interactions: Interactions) -> Solver:
    if interactions.fused is not None:
        from xper_fx.nscd.splitting.splitting_vertices import SplittingVertices

        return SplittingVertices()
    from xper_fx.nscd.solvers.vertex_blocks import VertexBlocks

    return VertexBlocks()
