# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps of central differences (`explicit.py`) of linear simplices, in one pass through memory.

What a step ends with and the next one begins with is found cell by cell, while the numbers of a few
cells are in cache: displacements, forces, and velocities that nothing changes but these forces.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from xper_fx.bulk.cell_forces import CellForces, forces_kernel
from xper_fx.bulk.state import State
from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY, LEAN_INNER
from xper_fx.support.threads import in_ranges, num_ranges

# Cells whose steps are ended together: they stay in cache.
_TILE = 64


class EndedStep(NamedTuple):
    """The end of a step."""

    displacement: np.ndarray  #: at the end, shape (num_dofs,), m
    forces: np.ndarray | tuple[np.ndarray, np.ndarray]  #: as of `State`
    ahead: np.ndarray | None  #: internal forces half a step later, if the bulk is linear
    #: of what internal forces change by in the second half of the step, on this rank (W; 2D: W/m)
    power: float
    #: kinetic and elastic energy on this rank where they come along (J; 2D: J/m), else None
    held: tuple[float, float] | None = None
    #: velocities at the end of a next step of the same size in which nothing but internal forces
    #: acts, first in room for those of all slots (m/s), where they come along
    free: np.ndarray | None = None


class _Arrays(NamedTuple):
    """What the pass reads and writes: of cells, of dofs at the start of a step, at its end."""

    gradients: np.ndarray
    moduli: np.ndarray
    mass: np.ndarray
    w: np.ndarray
    q0: np.ndarray
    v0: np.ndarray
    v1: np.ndarray
    halfway: np.ndarray
    q1: np.ndarray
    ahead: np.ndarray
    by_cell: np.ndarray
    free: np.ndarray


@njit(**LEAN_INNER)
def _move(first, last, half, q0, v0, v1, q1, ahead):
    """Displacements at the end of a step, and half a step later, of a range of dofs."""
    for i in range(np.uintp(first), np.uintp(last)):
        q1[i] = half * v1[i] + (half * v0[i] + q0[i])
        ahead[i] = half * v1[i] + q1[i]


@njit(fastmath={"reassoc", "contract"}, **LEAN_INNER)
def _sum_up(first, last, mass, q1, v1, halfway, ahead):
    """What `EndedStep` has sums of, of a range of dofs.

    That is the power, and twice both energies.
    """
    power = moving = strained = 0.0
    for i in range(np.uintp(first), np.uintp(last)):
        mean = 0.5 * (halfway[i] + ahead[i])
        power += v1[i] * (mean - halfway[i])
        moving += mass[i] * v1[i] * v1[i]
        strained += q1[i] * mean
    return power, moving, strained


@njit(**LEAN_INNER)
def _push(first, last, step, w, v, force, free):
    """Velocities at the end of a step in which internal forces alone act, of a range of dofs."""
    for i in range(np.uintp(first), np.uintp(last)):
        impulse = -step * force[i]
        free[i] = w[i] * impulse + v[i]


@njit(**LEAN_INNER)
def _exact_sum(row):
    high = low = 0.0
    for x in row:
        total = high + x
        part = total - high
        low += (high - (total - part)) + (x - part)
        high = total
    return high + low


@njit(**LEAN_ENTRY)
def _sum_of_tiles(sums):
    """Sums of three rows, carried with twice the digits (Knuth's two-sum; Dekker 1971)."""
    return _exact_sum(sums[0]), _exact_sum(sums[1]), _exact_sum(sums[2])


@cache
def _step_kernel(dim: int):
    """Kernel that ends a step of a range of tiles: their dofs stay in cache."""
    forces, size = forces_kernel(dim), dim * (dim + 1)

    @njit(nogil=True, **LEAN_ENTRY)
    def end_step(first, last, step, a, sums):
        for tile in range(first, last):
            low, high = tile * _TILE, min((tile + 1) * _TILE, len(a.gradients))
            at, to = size * low, size * high
            _move(at, to, 0.5 * step, a.q0, a.v0, a.v1, a.q1, a.ahead)
            forces(low, high, a.gradients, a.moduli, a.by_cell, a.by_cell)
            sums[0, tile], sums[1, tile], sums[2, tile] = _sum_up(
                at, to, a.mass, a.q1, a.v1, a.halfway, a.ahead
            )
            _push(at, to, step, a.w, a.v1, a.ahead, a.free)

    return end_step


class StepByCell:
    """Ends steps of linear simplices.

    Args:
        mass: shape (num_dofs,), kg (2D: kg/m).
        w: one over it, zero where motions are given.
    """

    def __init__(self, forces: CellForces, mass: np.ndarray, w: np.ndarray):
        self._forces, self._mass, self._w = forces, mass, w

    def end(
        self, state: State, velocity: np.ndarray, halfway: np.ndarray, step: float, room: int
    ) -> EndedStep:
        """End a step.

        Args:
            state: at its start.
            velocity: at its end, shape (num_dofs,), m/s.
            halfway: internal forces in its middle, N (2D: N/m).
            step: h (s).
            room: length of `free`.
        """
        q0, forces = state.displacement, self._forces
        q1, ahead, free = np.empty_like(q0), np.empty_like(q0), np.empty(room)
        num_cells = len(forces.arrays[0])
        sums = np.empty((3, -(-num_cells // _TILE)))
        arrays = _Arrays(
            *forces.arrays, self._mass, self._w, q0, state.velocity, velocity, halfway, q1, ahead,
            ahead.reshape(num_cells, -1), free,
        )  # fmt: skip
        spaces = [sums] * num_ranges(num_cells)
        in_ranges(_step_kernel(forces.dim), sums.shape[1], step, arrays, spaces=spaces)
        power, moving, strained = _sum_of_tiles(sums)
        held = 0.5 * moving, 0.5 * strained
        return EndedStep(q1, (halfway, ahead), ahead, power, held, free)
