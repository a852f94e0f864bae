# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nonlinear Gauss-Seidel sped up by Anderson's mixing (Anderson 1965; Walker and Ni 2011).

Some sweeps are a map r -> G(r) that is linear as long as no point changes its branch; the last
images are mixed (`nscd/algebra/anderson_mixing.py`). That needs nothing of a law or of w but the
sweep. Mixed impulses need not obey their laws; the next sweep makes them.

**How many sweeps.** Each fourth is mixed on meshed bodies, as Pratapa, Suryanarayana and Pask 2016
alternate mixing with Jacobi's iterations: half as many images reach twice as far back, and most
sweeps cost no mixing. `benchmarks/half_broken.py` takes 1400 sweeps so, and 1000 where each is
mixed with eight images, in 0.5 to 0.7 of the time.

**Safeguard.** Where a map from mixed impulses leaves more than `_GROWTH` times the least f so
far, points have changed branch: what was remembered is forgotten, and plain sweeps go on from the
best impulses known.

**When it stops.** By the same bound as `nlgs.py`; the error is estimated from f times the ratio
|dr| / |df| of the step that mixing made, and at least f. Sweeps give up that lead to and fro, f
being that of several. Contacts of rigid bodies are judged by velocities as there.

Ranks that share points sweep together and sum their scalar products; each mixes its own impulses.
"""

from __future__ import annotations

import numpy as np

from xper_fx.nscd.algebra.anderson_mixing import AndersonMixing
from xper_fx.nscd.algebra.krylov import norm
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.solvers.solver import SolveOptions, Solver, SolveReport
from xper_fx.nscd.solvers.sweeps import ROUNDING, RUNAWAY, prepare_sweep, sweep_ranks

# Sweeps from one mixing to the next, and images remembered: of points of meshed bodies, and of
# packings of rigid ones, whose visits cost more.
_MESHED, _RIGID = (4, 4), (1, 8)
# Images that are known before any is mixed.
_PLAIN = 3
# Growth of what a sweep changes, over the least so far, at which mixing starts again.
_GROWTH = 3.0
# What one sweep changes, over the tolerance, beyond which sweeps go to and fro that change nothing
# together.
_TO_AND_FRO = 10.0
# Sweeps after which |w H r| is looked at again.
_CHECK_EVERY = 8


class AcceleratedSweeps(Solver):
    """Gauss-Seidel sweeps whose impulses are mixed with those of the sweeps before."""

    name = "accelerated"

    def solve(
        self, interactions: Interactions, velocity: np.ndarray, options: SolveOptions
    ) -> SolveReport:
        """Find the impulses of the step, as `Solver.solve` says."""
        free, groups = velocity.copy(), interactions.groups
        sweep = prepare_sweep(interactions, velocity, options)
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

        def length(x: np.ndarray) -> float:
            return float(np.sqrt(interactions.total(norm(x) ** 2)))

        by_velocities, energy = interactions.uses_velocity_criterion, 0.0
        every, kept = _RIGID if by_velocities else _MESHED
        memory = AndersonMixing(ends[-1], kept, _PLAIN, interactions.total)
        # r, G(r), f; r and f of the map before; G(r) of the best one
        r, swept, f, old_r, old_f, best = np.zeros((6, ends[-1]))
        read_impulses(r)
        set_impulses(r)
        floor = interactions.rounding(free) / tolerance
        least, error, restarts, first = np.inf, np.inf, 0, 0.0
        amplification, follows = np.inf, False
        sweeps = 0
        while sweeps < max_sweeps:
            # the first are looked at one by one: they may be enough
            if sweeps == _PLAIN and every > 1:
                memory.forget()
                follows, least = False, np.inf
            for _ in range(min(every if sweeps >= _PLAIN else 1, max_sweeps - sweeps)):
                sweep_ranks(interactions, sweep, velocity)
                sweeps += 1
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
                left = np.sqrt(sweep.stats[:, 0].sum())
                if left <= tolerance * energy or sweeps % _CHECK_EVERY == 1:
                    energy, rounding = interactions.impulse_energy_norm(free, velocity)
                    energy = max(energy, rounding / tolerance)
                error = left / energy if energy > 0.0 else (np.inf if left > 0.0 else 0.0)
            else:
                error = change * amplification if change > ROUNDING else change
            first = first or scale
            if error <= tolerance and scale > RUNAWAY * first:
                break
            if error <= tolerance and every > 1:
                moved = np.sqrt(interactions.total(sweep.stats[:, 0].sum()))
                if moved > _TO_AND_FRO * tolerance * scale:
                    break
            if error <= tolerance:
                interactions.refresh_ghosts(velocity)
                if interactions.evolve(velocity) <= tolerance:
                    most = interactions.largest(sweep.largest_change())
                    traction = np.sqrt(most) / interactions.step_size
                    reason = f"{restarts} restarts"
                    return SolveReport(True, sweeps, error, traction, "accelerated", reason)
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
        interactions.refresh_ghosts(velocity)
        return SolveReport(False, sweeps, error, np.inf, "accelerated", f"{restarts} restarts")
