# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nonlinear Gauss-Seidel sped up by Anderson's mixing (Anderson 1965; Walker and Ni 2011).

A sweep is a map r -> G(r) that is linear as long as no point changes its branch. From the last m
sweeps, with f = G(r) - r, dF their differences of f and dG those of G(r),

    r_next = G(r) - dG gamma,   gamma = argmin |f - dF gamma|,

which is GMRES where G is linear. It needs nothing of a law or of w but the sweep. Mixed impulses
need not obey their laws; the next sweep makes them.

**Safeguard.** Where a sweep from mixed impulses leaves more than `_GROWTH` times the least f so
far, points have changed branch: what was remembered is forgotten, and plain sweeps go on from the
best impulses known.

**When it stops.** By the same bound as `nlgs.py`; the error is estimated from f times the ratio
|dr| / |df| of the step that mixing made, and at least f. Contacts of rigid bodies are judged by
velocities as there.

Ranks that share points sweep together and sum their scalar products; each mixes its own impulses.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.reductions import largest, refresh_ghosts, total
from xper_fx.nscd.solvers.krylov import add_combination, norm, products
from xper_fx.nscd.solvers.solver import SolveOptions, Solver, SolveReport
from xper_fx.nscd.solvers.sweeps import ROUNDING, sweep, sweep_passes

# Sweeps remembered, and plain sweeps before any is mixed.
_MEMORY, _PLAIN = 8, 3
# Growth of what a sweep changes, over the least so far, at which mixing starts again.
_GROWTH = 3.0
# Sweeps after which |w H r| is looked at again.
_CHECK_EVERY = 8
# Relative size of a singular value of dF that is left out.
_RANK = 1e-12


class _Memory:
    """Differences of the last sweeps; vectors of its own, nothing allocated as it goes on.

    Args:
        size: of the vectors.
        summed: sum over the ranks that have parts of them.
    """

    def __init__(self, size: int, summed: Callable):
        self._summed = summed
        self._df, self._dg = np.zeros((_MEMORY, size)), np.zeros((_MEMORY, size))
        self._f, self._g = np.zeros((2, size))
        self._gram = np.zeros((_MEMORY, _MEMORY))
        self.forget()

    def forget(self) -> None:
        """Start again."""
        self._count, self._started = 0, False

    def mix(self, f: np.ndarray, g: np.ndarray, r: np.ndarray) -> bool:
        """Set the next impulses r from f and G(r) of a sweep; False if they are G(r) itself."""
        if self._started:
            slot = self._count % _MEMORY
            np.subtract(f, self._f, out=self._df[slot])
            np.subtract(g, self._g, out=self._dg[slot])
            self._count += 1
            known = min(self._count, _MEMORY)
            row = np.empty(known)
            products(self._df, known, self._df[slot], row)
            self._gram[slot, :known] = self._gram[:known, slot] = self._summed(row)
        self._started = True
        self._f[:], self._g[:] = f, g
        known = min(self._count, _MEMORY)
        r[:] = g
        if known < _PLAIN:
            return False
        scale = 1.0 / np.sqrt(np.maximum(np.diag(self._gram)[:known], np.finfo(float).tiny))
        normal = self._gram[:known, :known] * scale[:, None] * scale
        right = np.empty(known)
        products(self._df, known, f, right)
        right = self._summed(right)
        gamma = scale * np.linalg.lstsq(normal, scale * right, rcond=_RANK)[0]
        add_combination(self._dg, known, -gamma, r)
        return True


class AcceleratedSweeps(Solver):
    """Gauss-Seidel sweeps whose impulses are mixed with those of the sweeps before."""

    name = "accelerated"

    def solve(
        self, interactions: Interactions, velocity: np.ndarray, options: SolveOptions
    ) -> SolveReport:
        """Find the impulses of the step, as `Solver.solve` says."""
        free, groups = velocity.copy(), interactions.groups
        passes = sweep_passes(interactions, velocity, options)
        tolerance, max_sweeps = options.tolerance, options.max_sweeps
        ends = np.cumsum([0] + [g.impulse.size for g in groups])

        def read_impulses(r: np.ndarray) -> None:
            for g, first, last in zip(groups, ends[:-1], ends[1:], strict=True):
                r[first:last] = g.impulse.reshape(-1)

        def set_impulses(r: np.ndarray) -> None:
            for g, first, last in zip(groups, ends[:-1], ends[1:], strict=True):
                g.impulse.reshape(-1)[:] = r[first:last]
            velocity[:] = free
            interactions.add_velocity(velocity)

        summed = partial(total, interactions)

        def length(x: np.ndarray) -> float:
            return float(np.sqrt(summed(norm(x) ** 2)))

        memory = _Memory(ends[-1], summed)
        # r of the sweep, G(r), f; r and f of the sweep before; G(r) of the best sweep
        r, swept, f, old_r, old_f, best = np.zeros((6, ends[-1]))
        read_impulses(r)
        set_impulses(r)
        floor = interactions.rounding(free) / tolerance
        least, error, restarts = np.inf, np.inf, 0
        amplification, follows = np.inf, False
        by_velocities, energy = interactions.uses_velocity_criterion, 0.0
        for count in range(1, max_sweeps + 1):
            sweep(interactions, passes, velocity)
            read_impulses(swept)
            np.subtract(swept, r, out=f)
            size, scale = length(f), max(length(swept), floor)
            change = size / scale if scale > 0.0 else size
            if not np.isfinite(change):
                break
            if follows:
                old_r -= r
                old_f -= f
                slope = length(old_f)
                amplification = max(1.0, length(old_r) / slope) if slope > 0.0 else 1.0
            follows = False
            if by_velocities:
                left = np.sqrt(sum(p.stats[:, 0].sum() for p in passes))
                if left <= tolerance * energy or count % _CHECK_EVERY == 1:
                    energy, rounding = interactions.impulse_energy_norm(free, velocity)
                    energy = max(energy, rounding / tolerance)
                error = left / energy if energy > 0.0 else (np.inf if left > 0.0 else 0.0)
            else:
                error = change * amplification if change > ROUNDING else change
            if error <= tolerance:
                refresh_ghosts(interactions, velocity)
                if interactions.evolve(velocity) <= tolerance:
                    most = max((p.stats[:, 2].max(initial=0.0) for p in passes), default=0.0)
                    traction = np.sqrt(largest(interactions, most)) / interactions.step_size
                    reason = f"{restarts} restarts"
                    return SolveReport(True, count, error, traction, "accelerated", reason)
                memory.forget()
                least, amplification = np.inf, np.inf
                r[:] = swept
                continue
            if change > _GROWTH * least:
                memory.forget()
                restarts, least = restarts + 1, np.inf
                r[:] = best
                set_impulses(r)
                continue
            if change < least:
                least = change
                best[:] = swept
            old_r[:], old_f[:], follows = r, f, True
            if memory.mix(f, swept, r):
                set_impulses(r)
        refresh_ghosts(interactions, velocity)
        return SolveReport(
            False, count, error, np.inf, "accelerated", f"{restarts} restarts"
        )  # fmt: skip
