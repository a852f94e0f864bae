# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sweeps over points that several ranks share.

A sweep of all ranks together is a Gauss-Seidel sweep in another order, so that it converges where
`nlgs.py` does. Points between bodies of two ranks come first, phase by phase: in a phase a rank
meets one other at most, the owner of their points takes the velocities of the other's bodies,
visits the points, and gives the velocities back, while nobody else moves these bodies. Then each
rank visits the points between its own bodies, all ranks at once.

The error is estimated as in `nlgs.py`, from changes summed over all ranks. Where vertices are
solved alone (`vertex_blocks.py`) each is on one rank: velocities go to the ghosts before, and back
after, once a step.
"""

from __future__ import annotations

import numpy as np

from xper_fx.nscd import vertex_blocks
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.nlgs import (
    ROUNDING,
    SolveReport,
    SweepPass,
    amplification,
    contraction,
    sweep_passes,
)

# Sweeps over which the contraction is measured.
_WINDOW = 4


def sweep(interactions: Interactions, passes: list[SweepPass], velocity: np.ndarray) -> None:
    """One sweep over all points; all ranks call it together.

    Ghosts that no point of the last phase moved lag behind their owners afterwards.

    Args:
        interactions: the points.
        passes: over their groups, all tiles marked.
        velocity: shape (num_slots * dim,), that of the passes.
    """
    exchanges = () if interactions.halo is None else interactions.halo.phases
    pairs = list(zip(interactions.groups, passes, strict=True))
    for phase, exchange in enumerate(exchanges, start=1):
        exchange.forward(velocity)
        for group, one in pairs:
            if group.phase == phase:
                one.kernel(*one.arguments)
        exchange.back(velocity)
    for group, one in pairs:
        if group.phase == 0:
            one.kernel(*one.arguments)


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
        changes = [*changes[-_WINDOW:], change]
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


def _solve_vertices(interactions: Interactions, velocity: np.ndarray, **options) -> SolveReport:
    """`vertex_blocks.solve` of this rank's vertices between two exchanges."""
    halo = interactions.halo
    halo.everywhere.forward(velocity)
    report = vertex_blocks.solve(interactions, velocity, **options)
    halo.everywhere.back(velocity)
    numbers = np.array([report.sweeps, report.residual, report.traction_change])
    sweeps, residual, traction = halo.ranks.max(numbers).tolist()
    converged = halo.ranks.all(report.converged)
    return SolveReport(converged, int(sweeps), residual, traction, "distributed")
