# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nonlinear Gauss-Seidel over interaction points (Jean 1999; Perales et al. 2010, section 3.4).

**When it stops.** The change of the impulses in one sweep, |dr| / |r|, understates the error:
with sweeps that contract by rho the error left is about |dr| rho / (1 - rho). rho is measured on
the last sweeps, and it is this estimate that `tolerance` bounds. Beside it stands the largest
change of traction in the last sweep, in Pa.

**Where it sweeps.** Tiles of points whose impulses no longer change, and whose bodies no neighbour
moves, are passed over; a sweep over all of them comes now and then and before the end, so that the
error is always that of the whole.

**Internal variables** (damage) stand still while impulses are sought, and follow when these are
found to ten times the tolerance; the last solve, to the tolerance, is with variables at rest.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from numba import get_num_threads, njit

from xper_fx.nscd.exchange import Couplings, push_kernel, sweep_kernel
from xper_fx.nscd.interactions import Interactions, PointGroup
from xper_fx.nscd.ordering import TileBodies, mark_moved, mark_tiles

# Sweeps over which the contraction is measured.
_WINDOW = 4
# A tile is left alone while its share of the error is below this fraction of what is wanted, and is
# visited all the same every so many sweeps, and before the end.
_NEGLIGIBLE, _REVISIT = 0.1, 16
# Relative change of the impulses that is rounding.
ROUNDING = 16.0 * np.finfo(float).eps
# Factor on the tolerance while internal variables still move.
LOOSE = 10.0


class SolveReport(NamedTuple):
    """How a solve ended.

    Attributes:
        converged: whether the estimated error is within the tolerance.
        sweeps: sweeps made.
        residual: estimated relative error of the impulses (module docstring).
        traction_change: largest change of a traction in the last sweep (Pa).
        solver: name of the solver that found the impulses.
        reason: why this solver, and what else it did; empty if there was no choice.
        contraction: of the last sweeps, a sweep; 1 if unknown.
    """

    converged: bool
    sweeps: int
    residual: float
    traction_change: float
    solver: str = "nlgs"
    reason: str = ""
    contraction: float = 1.0


class SweepPass(NamedTuple):
    """A sweep over the points of a group: `kernel(*arguments)` visits the marked tiles."""

    kernel: Callable
    arguments: tuple
    tile_bodies: TileBodies
    marked: np.ndarray
    stats: np.ndarray


def _sweep_pass(
    group: PointGroup, dim: int, couplings: Couplings, block_size: int, velocity: np.ndarray,
    relaxation: float, num_threads: int | None,
) -> SweepPass:  # fmt: skip
    """A sweep over a group that exchanges velocities of `dim` dimensions."""
    parallel = (num_threads or get_num_threads()) > 1
    kernel = sweep_kernel(group.kernels, dim, couplings.start.shape[2], block_size, parallel)
    tiles = len(group.ordering.tile_offsets) - 1
    marked, stats = np.ones(tiles, np.bool_), np.zeros((tiles, 3))
    arguments = (
        group.ordering.tile_offsets, group.ordering.color_offsets, marked, stats, velocity,
        couplings, group.impulse, group.compliance, group.inverse_area, group.parameters,
        group.terms, group.details, relaxation,
    )  # fmt: skip
    return SweepPass(kernel, arguments, group.tile_bodies, marked, stats)


def sweep_passes(
    interactions: Interactions, velocity: np.ndarray, relaxation: float, num_threads: int | None
) -> list[SweepPass]:
    """What a sweep consists of, all tiles marked; arguments as those of `solve`."""
    dim = interactions.dim
    return [
        _sweep_pass(g, dim, g.couplings, g.block_size, velocity, relaxation, num_threads)
        for g in interactions.groups
    ]


@njit
def contraction(changes):
    """Factor of the relative changes from a sweep to the next, over the last sweeps."""
    window = min(_WINDOW, len(changes) - 1)
    return (changes[-1] / changes[-1 - window]) ** (1.0 / window) if window > 0 else 1.0


@njit
def amplification(changes):
    """Error left, relative to the last change, from the relative changes of the sweeps so far."""
    if changes[-1] == 0.0:
        return 1.0
    rho = contraction(changes)
    return max(1.0, rho / (1.0 - rho)) if rho < 1.0 else np.inf


@cache
def _over_groups(kernels: tuple[Callable, ...]):
    """Kernels over passes `(arguments, tile bodies, marked, stats)`, one a group.

    A sweep, which gives [sum |dr|^2, sum |r|^2, whether all was visited]; the marking of bodies
    that moved; the marking of tiles that touch one.
    """
    kernel, last = kernels[0], len(kernels) == 1
    rest = (None, None, None) if last else _over_groups(kernels[1:])
    sweep_rest, moved_rest, tiles_rest = rest

    @njit(nogil=True)
    def sweep(passes):
        arguments, _, marked, stats = passes[0]
        kernel(*arguments)
        changed, total, everywhere = 0.0, 0.0, True
        for tile in range(len(marked)):
            changed += stats[tile, 0]
            total += stats[tile, 1]
            everywhere = everywhere and marked[tile]
        if not last:
            x, y, z = sweep_rest(passes[1:])
            changed, total, everywhere = changed + x, total + y, everywhere and z
        return changed, total, everywhere

    @njit
    def moved_bodies(passes, moved, threshold):
        _, bodies, _, stats = passes[0]
        mark_moved(moved, bodies, stats, threshold)
        if not last:
            moved_rest(passes[1:], moved, threshold)

    @njit
    def touched_tiles(passes, moved):
        _, bodies, marked, stats = passes[0]
        mark_tiles(marked, bodies, moved)
        for tile in range(len(marked)):
            if not marked[tile]:
                stats[tile, 0] = 0.0
        if not last:
            tiles_rest(passes[1:], moved)

    return sweep, moved_bodies, touched_tiles


@cache
def _spell_kernel(kernels: tuple[Callable, ...]):
    """Kernel that sweeps until the error is within a bound, all points visited last.

    `changes[:known]` are the relative changes of the last sweeps.
    """
    sweep, moved_bodies, touched_tiles = _over_groups(kernels)

    @njit(nogil=True)
    def spell(passes, moved, changes, known, count, max_sweeps, wanted, num_tiles):
        factor, error, verifying = np.inf, np.inf, False
        while count < max_sweeps:
            count += 1
            changed, total, everywhere = sweep(passes)
            if not np.isfinite(changed):
                return False, count, known, error
            change = np.sqrt(changed / total) if total > 0.0 else np.sqrt(changed)
            if not verifying:
                if known == len(changes):
                    changes[:-1] = changes[1:].copy()
                    known -= 1
                changes[known] = change
                known += 1
                factor = amplification(changes[:known])
            error = change * factor if change > ROUNDING else change
            if error <= wanted and everywhere:
                return True, count, known, error
            # What moves still gets the next sweep; when that has come to rest, all do.
            verifying = error <= wanted
            moved[:] = verifying or count % _REVISIT == 0
            negligible = _NEGLIGIBLE * wanted / factor if np.isfinite(factor) else 0.0
            moved_bodies(passes, moved, negligible**2 * total / num_tiles)
            touched_tiles(passes, moved)
        return False, count, known, error

    return spell


def solve(
    interactions: Interactions,
    velocity: np.ndarray,
    *,
    tolerance: float = 1e-4,
    max_sweeps: int = 10_000,
    relaxation: float = 1.0,
    num_threads: int | None = None,
) -> SolveReport:
    """Find the impulses of the step; `velocity` becomes the end velocity.

    Args:
        interactions: points after `begin_step`, whose impulses are the first guess.
        velocity: shape (num_slots * dim,), the free velocity on entry, v_free + w H r on return.
        tolerance: bound on the estimated relative error of the impulses.
        max_sweeps: sweeps after which to give up.
        relaxation: factor on the change of an impulse where its law is locally linear, in (0, 2).
        num_threads: threads to use; all that Numba has if not given. Results do not depend on it
            beyond the rounding of the residual.

    Returns:
        The report; not converged is reported, not raised.
    """
    groups = interactions.groups
    if len(groups) == 1 and groups[0].normal is not None:
        (group,) = groups
        normal = group.normal
        sides = normal.of(velocity)
        push_kernel(1, 1, 1, normal.block_size)(sides, normal.couplings, group.impulse)
        sweeps = _sweep_pass(
            group, 1, normal.couplings, normal.block_size, sides, relaxation, num_threads
        )
        report = _sweep([sweeps], interactions, velocity, tolerance, max_sweeps)
        interactions.add_velocity(velocity)
        return report
    passes = sweep_passes(interactions, velocity, relaxation, num_threads)
    interactions.add_velocity(velocity)
    return _sweep(passes, interactions, velocity, tolerance, max_sweeps)


def _sweep(
    passes: list[SweepPass], interactions: Interactions, velocity: np.ndarray, tolerance: float,
    max_sweeps: int,
) -> SolveReport:  # fmt: skip
    """Sweep until impulses and internal variables have arrived."""
    if not passes:
        return SolveReport(True, 1, 0.0, 0.0)
    spell = _spell_kernel(tuple(p.kernel for p in passes))
    arguments = tuple(tuple(p[1:]) for p in passes)
    num_tiles = sum(len(p.marked) for p in passes)
    moved = np.zeros(len(interactions.inverse.node_offsets) - 1, np.bool_)
    changes, known, count, wanted = np.zeros(_WINDOW + 1), 0, 0, LOOSE * tolerance
    while True:
        arrived, count, known, error = spell(
            arguments, moved, changes, known, count, max_sweeps, wanted, num_tiles
        )
        if not arrived:
            rate = contraction(changes[:known])
            return SolveReport(False, count, error, np.inf, contraction=rate)
        if interactions.evolve(velocity) > tolerance:
            known, wanted = 0, LOOSE * tolerance
        elif error <= tolerance:
            largest = max(p.stats[:, 2].max(initial=0.0) for p in passes)
            return SolveReport(True, count, error, np.sqrt(largest) / interactions.step_size)
        else:
            wanted = tolerance
