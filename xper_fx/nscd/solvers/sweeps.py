# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gauss-Seidel sweeps over all points, and what their changes say of the error.

`nlgs.py` sweeps until it has converged; `distributed.py` does so where ranks share points.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.couplings import sweep_kernel
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.nscd.ordering import TileBodies
from xper_fx.nscd.solvers.solver import SolveOptions
from xper_fx.support.threads import worth_taking

# Sweeps over which the contraction is measured.
WINDOW = 4
# A tile is left alone while its share of the error is below this fraction of what is wanted, and is
# visited all the same every so many sweeps, and before the end.
NEGLIGIBLE, REVISIT = 0.1, 16
# Sweeps after which |w H r| is first looked at again, twice as many each time.
FIRST_BATCH = 16
# Tiles from which threads are taken unasked: fewer, a few dozen microseconds a sweep, never pay for
# the kernel with threads, which takes longer to compile.
_MANY_TILES = 8
# Relative change of the impulses that is rounding.
ROUNDING = 16.0 * np.finfo(float).eps
# Growth of all impulses since the first sweep beyond which a small relative error means nothing:
# they run away along what moves no body, as of perfect bonds that contradict each other.
RUNAWAY = 1e6


class SweepPass(NamedTuple):
    """A sweep over the points of a group: `kernel(*arguments)` visits the marked tiles."""

    kernel: Callable
    arguments: tuple
    tile_bodies: TileBodies
    marked: np.ndarray
    stats: np.ndarray


def sweep_passes(
    interactions: Interactions, velocity: np.ndarray, options: SolveOptions
) -> list[SweepPass]:
    """What a sweep consists of, all tiles marked; arguments as those of `Solver.solve`."""
    num_tiles = sum(len(g.ordering.tile_offsets) - 1 for g in interactions.groups)
    num_threads = worth_taking(num_tiles, _MANY_TILES, options.num_threads)
    passes = []
    for g in interactions.groups:
        kernel = sweep_kernel(
            g.kernels, g.sides, g.blocks, num_threads > 1, interactions.uses_velocity_criterion
        )
        tiles = len(g.ordering.tile_offsets) - 1
        marked, stats = np.ones(tiles, np.bool_), np.zeros((tiles, 3))
        arguments = (
            g.ordering.tile_offsets, g.ordering.color_offsets, marked, stats, velocity,
            g.couplings, g.impulse, g.compliance, g.inverse_area, g.parameters, g.terms, g.details,
            options.relaxation,
        )  # fmt: skip
        passes.append(SweepPass(kernel, arguments, g.tile_bodies, marked, stats))
    return passes


def sweep(interactions: Interactions, passes: list[SweepPass], velocity: np.ndarray) -> None:
    """One sweep over the marked tiles of all points; all ranks call it together.

    Ghosts that no point of the last phase moved lag behind their owners afterwards.

    Args:
        interactions: the points.
        passes: over their groups.
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


@njit(inline="always", **LEAN_ENTRY)
def contraction(changes):
    """Factor of the relative changes from a sweep to the next, over the last sweeps."""
    window = min(WINDOW, len(changes) - 1)
    return (changes[-1] / changes[-1 - window]) ** (1.0 / window) if window > 0 else 1.0


@njit(inline="always", **LEAN_ENTRY)
def amplification(changes):
    """Error left, relative to the last change, from the relative changes of the sweeps so far."""
    if changes[-1] == 0.0:
        return 1.0
    rho = contraction(changes)
    return max(1.0, rho / (1.0 - rho)) if rho < 1.0 else np.inf
