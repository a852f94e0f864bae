# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sweeps over points that several ranks share.

A sweep of all ranks together is a Gauss-Seidel sweep in another order, so that it converges where
`nlgs.py` does. Points between bodies of two ranks come first, phase by phase: in a phase a rank
meets one other at most, the owner of their points takes the velocities of the other's bodies,
visits the points, and gives the velocities back, while nobody else moves these bodies. Then each
rank visits the points between its own bodies, all ranks at once.

The error is estimated as in `nlgs.py`, from changes summed over all ranks, and contacts of rigid
bodies are judged by velocities, as there: the points that two ranks share are visited one after
another like all others, so that what is summed is the same violation. Where vertices are
solved alone (`vertex_blocks.py`) each is on one rank: velocities go to the ghosts before, and back
after, once a step.
"""

from __future__ import annotations

import numpy as np

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.ordering import mark_moved, mark_tiles
from xper_fx.nscd.solve_report import SolveReport
from xper_fx.nscd.sweeps import (
    FIRST_SPELL,
    NEGLIGIBLE,
    REVISIT,
    ROUNDING,
    WINDOW,
    amplification,
    contraction,
    sweep,
    sweep_passes,
)


def solve(
    interactions: Interactions,
    velocity: np.ndarray,
    *,
    tolerance: float = 1e-4,
    max_sweeps: int = 10_000,
    relaxation: float = 1.0,
    num_threads: int | None = None,
) -> SolveReport:
    """Find the impulses of the step; all ranks call it together.

    Arguments are those of `nlgs.solve`; `velocity` becomes the end velocity of this rank's nodes
    and of its ghosts.

    Returns:
        The report, the same on all ranks.
    """
    if interactions.ordering == "vertices":
        return _solve_vertices(
            interactions, velocity, tolerance=tolerance, max_sweeps=max_sweeps,
            relaxation=relaxation, num_threads=num_threads,
        )  # fmt: skip
    if interactions.judged_by_velocities:
        return _solve_by_velocities(
            interactions, velocity, tolerance, max_sweeps, relaxation, num_threads
        )
    halo = interactions.halo
    interactions.add_velocity(velocity)
    passes = sweep_passes(interactions, velocity, relaxation, num_threads)
    least = interactions.rounding(velocity) / tolerance
    changes: list[float] = []
    for count in range(1, max_sweeps + 1):
        sweep(interactions, passes, velocity)
        changed, total = halo.ranks.sum(
            sum((one.stats[:, :2].sum(axis=0) for one in passes), np.zeros(2))
        ).tolist()
        if not np.isfinite(changed):
            return SolveReport(False, count, np.inf, np.inf, "distributed")
        total = max(total, least * least)
        change = (changed / total) ** 0.5 if total > 0.0 else changed**0.5
        changes = [*changes[-WINDOW:], change]
        error = change
        if change > ROUNDING:
            error *= amplification(np.array(changes))
        if error > tolerance:
            continue
        halo.everywhere.forward(velocity)
        if interactions.evolve(velocity) <= tolerance:
            largest = max((one.stats[:, 2].max(initial=0.0) for one in passes), default=0.0)
            traction = np.sqrt(halo.ranks.max(largest)) / interactions.step_size
            return SolveReport(True, count, error, traction, "distributed")
    rate = contraction(np.array(changes))
    halo.everywhere.forward(velocity)
    return SolveReport(False, max_sweeps, error, np.inf, "distributed", contraction=rate)


def _solve_by_velocities(
    interactions: Interactions, velocity, tolerance, max_sweeps, relaxation, num_threads
) -> SolveReport:
    """`solve` of contacts of rigid bodies, which stops as `nlgs.py` says.

    Tiles at rest are passed over as there; bodies that another rank may have moved count as moved.
    """
    halo, ranks = interactions.halo, interactions.halo.ranks
    passes = sweep_passes(interactions, velocity, relaxation, num_threads)
    free = velocity.copy()
    interactions.add_velocity(velocity)
    size, rounding = interactions.kick(free, velocity)
    num_tiles = max(1.0, ranks.sum(sum(len(one.marked) for one in passes)))
    moved = np.zeros(len(interactions.inverse.node_offsets) - 1, np.bool_)
    changes: list[float] = []
    looked_at, spell, verifying = 0, FIRST_SPELL, False
    for count in range(1, max_sweeps + 1):
        sweep(interactions, passes, velocity)
        changed, resting = ranks.sum(
            np.array(
                [
                    sum(one.stats[:, 0].sum() for one in passes),
                    sum(np.count_nonzero(~one.marked) for one in passes),
                ]
            )
        ).tolist()
        left = changed**0.5
        if not verifying:
            changes = [*changes[-WINDOW:], left]
        goal = max(tolerance * size, rounding)
        arrived = left <= goal and resting == 0
        if arrived or count == looked_at + spell or not np.isfinite(left):
            # the size of the impulses' effect is looked at now and then, and before the end
            halo.everywhere.forward(velocity)
            size, rounding = interactions.kick(free, velocity)
            looked_at, spell = count, 2 * spell
            goal = max(tolerance * size, rounding)
            arrived = arrived and left <= goal
        if arrived:
            largest = max((one.stats[:, 2].max(initial=0.0) for one in passes), default=0.0)
            traction = np.sqrt(ranks.max(largest)) / interactions.step_size
            residual = left / size if size > 0.0 else left
            return SolveReport(True, count, residual, traction, "distributed")
        if not np.isfinite(left):
            return SolveReport(False, count, np.inf, np.inf, "distributed")
        verifying = left <= goal
        moved[:] = verifying or count % REVISIT == 0
        moved[halo.cut] = True
        for one in passes:
            mark_moved(moved, one.tile_bodies, one.stats, (NEGLIGIBLE * goal) ** 2 / num_tiles)
        for one in passes:
            mark_tiles(one.marked, one.tile_bodies, moved)
            one.stats[~one.marked, 0] = 0.0
    halo.everywhere.forward(velocity)
    rate, residual = contraction(np.array(changes)), left / size if size > 0.0 else left
    return SolveReport(False, max_sweeps, residual, np.inf, "distributed", contraction=rate)


def _solve_vertices(interactions: Interactions, velocity: np.ndarray, **options) -> SolveReport:
    """`vertex_blocks.solve` of this rank's vertices between two exchanges."""
    from xper_fx.nscd import vertex_blocks

    halo = interactions.halo
    halo.everywhere.forward(velocity)
    report = vertex_blocks.solve(interactions, velocity, **options)
    halo.everywhere.back(velocity)
    numbers = np.array([report.sweeps, report.residual, report.traction_change])
    sweeps, residual, traction = halo.ranks.max(numbers).tolist()
    converged = halo.ranks.all(report.converged)
    return SolveReport(converged, int(sweeps), residual, traction, "distributed")
