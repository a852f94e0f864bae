# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gauss-Seidel sweeps over all points, and what their changes say of the error.

`nlgs.py` sweeps until it has converged; `distributed.py` does so where ranks share points.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.couplings import sweep_kernel
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.kernel_calls import bind_calls, make_call
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.nscd.ordering import TileBodies, join_tiles
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


class Sweep(NamedTuple):
    """A sweep over points: calls that visit the marked tiles, and what is known of all tiles."""

    calls: np.ndarray | list  #: one a group of points, for `make_call`
    tile_bodies: TileBodies  #: the bodies that each tile touches, group after group
    marked: np.ndarray  #: shape (num_tiles,), whether a sweep visits the tile
    #: shape (num_tiles, 3), of a tile's last visit: sum |dr|^2, sum |r|^2, max |dr|^2 / area^2
    stats: np.ndarray
    arguments: list[tuple]  #: of the calls, whose arrays are held here

    def largest_change(self) -> float:
        """Largest (|dr| / area)^2 of the last visits, in (N s/m^2)^2."""
        return self.stats[:, 2].max(initial=0.0)


def prepare_sweep(interactions: Interactions, velocity: np.ndarray, options: SolveOptions) -> Sweep:
    """The sweep over all points, all tiles marked; arguments as those of `Solver.solve`."""
    groups = interactions.groups
    ends = np.cumsum([0, *(len(g.ordering.tile_offsets) - 1 for g in groups)])
    threads = worth_taking(ends[-1], _MANY_TILES, options.num_threads) > 1
    marked, stats = np.ones(ends[-1], np.bool_), np.zeros((ends[-1], 3))
    kernels, arguments = [], []
    for g, first, last in zip(groups, ends[:-1], ends[1:], strict=True):
        by_velocity = interactions.uses_velocity_criterion
        kernels.append(sweep_kernel(g.kernels, g.sides, g.blocks, threads, by_velocity))
        arguments.append(
            (
                g.ordering.tile_offsets, g.ordering.color_offsets, marked[first:last],
                stats[first:last], velocity, g.couplings, g.impulse, g.compliance, g.inverse_area,
                g.parameters, g.terms, g.details, options.relaxation,
            )
        )  # fmt: skip
    bodies = join_tiles([g.tile_bodies for g in groups])
    return Sweep(bind_calls(kernels, arguments), bodies, marked, stats, arguments)


def sweep_ranks(
    interactions: Interactions, sweep: Sweep, velocity: np.ndarray, first: bool = False
) -> None:
    """One sweep over the marked tiles of all points; all ranks call it together.

    Velocities go on from rank to rank after each phase; those of ghosts lag behind afterwards.

    Args:
        sweep: over them.
        velocity: shape (num_slots * dim,), that of the sweep.
        first: whether ghosts have the velocities of their owners, as before the first sweep.
    """
    halo = interactions.halo
    exchanges = () if halo is None else halo.turns
    phases = [g.phase for g in interactions.groups]
    for phase, exchange in enumerate(exchanges):
        if phase > 0:
            _sweep_phase(sweep, phases, phase)
        if phase > 0 or not first:
            exchange.forward(velocity)
    _sweep_phase(sweep, phases, 0)
    if halo is not None and halo.copies > 1:
        halo.settle(velocity)


def _sweep_phase(sweep: Sweep, phases: list[int], phase: int) -> None:
    for number, its_phase in enumerate(phases):
        if its_phase == phase:
            make_call(sweep.calls, number)


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
