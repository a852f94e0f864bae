# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nonlinear Gauss-Seidel over interaction points (Jean 1999; Perales et al. 2010, section 3.4).

**When it stops.** The change of the impulses in one sweep, |dr| / |r|, understates the error:
with sweeps that contract by rho the error left is about |dr| rho / (1 - rho). rho is measured on
the last sweeps, and it is this estimate that `tolerance` bounds. Beside it stands the largest
change of traction in the last sweep, in Pa.

Impulses that move the bodies by less than the rounding of their velocities have arrived: bodies
that fly side by side push each other by nothing else.

**Contacts of rigid bodies** are judged by velocities. Where there are more than the bodies need to
be held, impulses have no one value; combinations that move nearly nothing converge last or, with
friction, never, long after what they do to the bodies is known. With dr_a what the law of point a
still asks for, the bodies at that moment taken as they are, W_aa dr_a is by how much the velocity
at the point breaks the law, and the stop is

    sum_a dr_a . W_aa dr_a <= tolerance^2 p . w p,    p = H r,

violations in the norm of the kinetic energy beside the change of the velocities that all impulses
make. Bodies at rest under gravity g have (p . w p)^(1/2) = g h (sum m)^(1/2): the tolerance bounds
the rate of penetration in units of g h, however high the heap. No error is estimated from it:
velocities and impulses solve exactly the problem whose free relative velocities differ by
W_aa dr_a.

**Where it sweeps.** Tiles of points whose impulses no longer change, and whose bodies no neighbour
moves, are passed over; a sweep over all of them comes now and then and before the end, so that the
error is always that of the whole.

Points that several ranks share are swept by `distributed.py`.

**Internal variables** (damage) stand still while impulses are sought, and follow when these are
found to the tolerance, never before: damage only falls, so what an impulse too large breaks stays
broken. (Following at ten times the tolerance took 20 % less time, and moved the dissipation of a
plate, at three times its critical step and a tolerance of 1e-3, by 17 % instead of 0.3 %.)
"""

from __future__ import annotations

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.kernel_calls import make_call
from xper_fx.nscd.kernel_options import LEAN_ENTRY, MERGED
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
)


@njit(**MERGED)
def _append(changes, known, change):
    """Put a change behind the known ones, of which the first makes room; how many there are."""
    if known == len(changes):
        known -= 1
        for n in range(known):
            changes[n] = changes[n + 1]
    changes[known] = change
    return known + 1


@njit(**MERGED)
def _sweep(calls, marked, stats):
    """One sweep: sum |dr|^2, sum |r|^2, whether all tiles were visited."""
    for number in range(len(calls)):
        make_call(calls, number)
    changed, total, everywhere = 0.0, 0.0, True
    for tile in range(len(marked)):
        changed += stats[tile, 0]
        total += stats[tile, 1]
        everywhere = everywhere and marked[tile]
    return changed, total, everywhere


@njit(**LEAN_ENTRY)
def _until_tolerance(sweep, moved, changes, tolerance, least, sweeps, max_sweeps):
    """Sweep until the error is within the tolerance, all points visited last.

    `sweep` is a `Sweep` up to its `stats`. Changes are relative to |r| or to `least`, whichever is
    larger. `changes` has room for those of the sweeps that `contraction` looks at.

    Returns:
        Whether it arrived, sweeps made so far, error, and how many of `changes` are set.
    """
    calls, tile_bodies, marked, stats = sweep
    known, factor, error, verifying = 0, np.inf, np.inf, False
    for count in range(sweeps + 1, max_sweeps + 1):
        changed, total, everywhere = _sweep(calls, marked, stats)
        if not np.isfinite(changed):
            return False, count, error, known
        total = max(total, least * least)
        change = np.sqrt(changed / total) if total > 0.0 else np.sqrt(changed)
        if not verifying:
            known = _append(changes, known, change)
            factor = amplification(changes[:known])
        error = change * factor if change > ROUNDING else change
        if error <= tolerance and everywhere:
            return True, count, error, known
        # What moves still gets the next sweep; when that has come to rest, all do.
        verifying = error <= tolerance
        moved[:] = verifying or count % REVISIT == 0
        negligible = NEGLIGIBLE * tolerance / factor if np.isfinite(factor) else 0.0
        mark_next(marked, stats, tile_bodies, moved, negligible**2 * total / len(marked))
    return False, max_sweeps, error, known


@njit(**LEAN_ENTRY)
def _until_goal(sweep, moved, changes, goal, most):
    """Sweep until sum dr . W_aa dr is within a goal, all points visited last.

    Returns:
        Whether it arrived, sweeps made, and how many of `changes` are set, the last ones.
    """
    calls, tile_bodies, marked, stats = sweep
    known, verifying = 0, False
    for count in range(1, most + 1):
        changed, _, everywhere = _sweep(calls, marked, stats)
        if not np.isfinite(changed):
            changes[0] = np.inf
            return False, count, 1
        if not verifying:
            known = _append(changes, known, np.sqrt(changed))
        verifying = changed <= goal
        if verifying and everywhere:
            changes[known - 1] = np.sqrt(changed)
            return True, count, known
        moved[:] = verifying or count % REVISIT == 0
        mark_next(marked, stats, tile_bodies, moved, NEGLIGIBLE**2 * goal / len(marked))
    return False, most, known


def _solve_by_velocities(
    interactions: Interactions, velocity: np.ndarray, options: SolveOptions
) -> SolveReport:
    """`solve` of contacts of rigid bodies."""
    tolerance, max_sweeps = options.tolerance, options.max_sweeps
    free = velocity.copy()
    sweep = prepare_sweep(interactions, velocity, options)
    interactions.add_velocity(velocity)
    moved = np.zeros(len(interactions.inverse.node_offsets) - 1, np.bool_)
    changes, sweeps, most = np.zeros(WINDOW + 1), 0, FIRST_BATCH
    size, rounding = interactions.impulse_energy_norm(free, velocity)
    while True:
        goal = max(tolerance * size, rounding)
        arrived, count, known = _until_goal(
            sweep[:4], moved, changes, goal**2, min(most, max_sweeps - sweeps)
        )
        sweeps += count
        size, rounding = interactions.impulse_energy_norm(free, velocity)
        left = changes[known - 1]
        residual = left / size if size > 0.0 else left
        if arrived and left <= max(tolerance * size, rounding):
            traction = np.sqrt(sweep.largest_change()) / interactions.step_size
            return SolveReport(True, sweeps, residual, traction)
        if sweeps >= max_sweeps or not np.isfinite(left):
            rate = contraction(changes[:known])
            return SolveReport(False, sweeps, residual, np.inf, contraction=rate)
        sweep.marked[:] = True
        most *= 2


class NonlinearGaussSeidel(Solver):
    """Sweeps over all points, one after another, until they agree."""

    name = "nlgs"

    def solve(
        self, interactions: Interactions, velocity: np.ndarray, options: SolveOptions
    ) -> SolveReport:
        """Find the impulses of the step, as `Solver.solve` says."""
        if interactions.halo is not None:
            from xper_fx.nscd.solvers.distributed import DistributedSweeps

            return DistributedSweeps().solve(interactions, velocity, options)
        if interactions.uses_velocity_criterion:
            return _solve_by_velocities(interactions, velocity, options)
        interactions.add_velocity(velocity)
        if not interactions.groups:
            return SolveReport(True, 1, 0.0, 0.0)
        sweep = prepare_sweep(interactions, velocity, options)
        tolerance = options.tolerance
        moved = np.zeros(len(interactions.inverse.node_offsets) - 1, np.bool_)
        least = interactions.rounding(velocity) / tolerance
        changes, sweeps, arrived = np.zeros(WINDOW + 1), 0, True
        while arrived:
            arrived, sweeps, error, known = _until_tolerance(
                sweep[:4], moved, changes, tolerance, least, sweeps, options.max_sweeps
            )
            if arrived and interactions.evolve(velocity) <= tolerance:
                traction = np.sqrt(sweep.largest_change()) / interactions.step_size
                return SolveReport(True, sweeps, error, traction)
        return SolveReport(False, sweeps, error, np.inf, contraction=contraction(changes[:known]))
