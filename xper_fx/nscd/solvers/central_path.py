# SPDX-License-Identifier: LGPL-3.0-or-later
r"""An interior point on the velocities of the bodies, for points with springs.

Newton's method (`newton.py`) goes round in circles where many contacts could be open, stick or
slip: which they are changes all at once. An interior point has no branches. For x and z of
`cone_points.py`, within their cones, it follows x o z = s e while s falls to zero, in some 12 to 20
iterations whatever the size is. In `nscd/friction/interior_point.py` W is assembled and factorised;
here each iteration is the problem of `tangent.py`,

    (w^-1 + H K H^T) dv = H (r + g) - w^-1 (v - v_free),

solved by its iterations, whose blocks of facing nodes hold the springs of the points however stiff
they have become.

**How well.** They leave a share of what bodies bear that falls with x . z: rough velocities
would do for the first iterations, and only the last are worth its time.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from xper_fx.nscd.algebra.krylov import norm
from xper_fx.nscd.couplings import spread_kernel
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.laws.law import CoulombPoints
from xper_fx.nscd.solvers.cone_points import ConePoints, coulomb_points
from xper_fx.nscd.solvers.tangent import LinearisedProblem

# What iterations leave, relative to |H r|, for x . z as it was at first; and the least of x . z.
_FORCING, _LEAST_GAP = 0.03, 3e-5
_MAX_ITERATIONS, _MAX_LINEAR = 40, 200
# Steps shorter than this end the descent; x . z at which it has led somewhere.
_SHORTEST, _USEFUL = 1e-3, 1e-3
# x . z at the end, relative to the first one, for a tolerance of 1.
_SHARE = 3e-2


def follow_path(
    interactions: Interactions, free: np.ndarray, problem: LinearisedProblem, tolerance: float
) -> int:
    """Bring the impulses of all points near to their solution.

    Args:
        interactions: points, whose impulses tell how large they are; they stay as they are where
            nothing comes of it.
        free: shape (num_slots * dim,), free velocities (m/s).
        problem: of these points, with the present w and frames.
        tolerance: bound on the error of velocities and impulses, relative.

    Returns:
        Iterations made; 0 where a law is of another kind or no point is closed.
    """
    points = [coulomb_points(g) for g in interactions.groups]
    if any(p is None for p in points):
        return 0
    path = _Path(interactions, free, problem, points)
    return path.run(_SHARE * tolerance) if path.begins else 0


class _Path:
    """x, z and velocities on their way.

    Attributes:
        begins: whether there is something to solve.
    """

    def __init__(
        self,
        interactions: Interactions,
        free: np.ndarray,
        problem: LinearisedProblem,
        laws: list[CoulombPoints],
    ):
        self._interactions, self._free, self._problem = interactions, free, problem
        groups, slots = interactions.groups, free.reshape(-1, interactions.dim)
        self._cones = ConePoints(dict(enumerate(groups)), dict(enumerate(laws)), interactions.dim)
        self._velocity = free.copy()
        interactions.add_velocity(self._velocity)
        self._left, self._force, self._own, self._step = np.zeros((4, len(free)))
        closed = list(zip(groups, self._cones.of_group.values(), strict=True))
        speeds = []
        for g, points in closed:
            u = g.points.relative(slots)[points.at]
            speeds.append(float(np.sum((u[:, 0] - points.least) ** 2)))
            if u.shape[1] > 1:
                speeds.append(float(np.sum((points.mu[:, None] * (u[:, 1:] + points.shift)) ** 2)))
        size = self._cones.root_mean_square
        impulse = size(float(np.sum(g.impulse[points.at, 0] ** 2)) for g, points in closed)
        self._cones.begin(impulse, size(speeds))
        self.begins = self._cones.gap > 0.0

    def run(self, least: float) -> int:
        """Descend to a share of the first x . z; the number of iterations."""
        groups, problem = self._interactions.groups, self._problem
        before = [g.impulse.copy() for g in groups]
        cones = self._cones
        first, count, step, iterations = cones.gap, 0, 1.0, 0
        for g, springs in self._groups():
            g.impulse[:], springs.stiffness[:] = 0.0, 0.0
        while True:
            self._linearise()
            if cones.gap <= least * first or count == _MAX_ITERATIONS or step < _SHORTEST:
                break
            problem.heed(iterations)
            problem.take_springs()
            if not problem.solvable:
                break
            share = min(max(cones.gap / first, _LEAST_GAP), 1.0)
            bound = _FORCING * share * norm(self._own)
            self._left += self._own
            self._step[:] = 0.0
            cones.predict()
            iterations = self._solve(bound)
            cones.correct()
            iterations = max(iterations, self._solve(bound))
            self._step[:] = cones.recentred(partial(self._again, bound), self._step.copy())
            if not (np.isfinite(self._step).all() and cones.finite):
                break
            step = cones.advance()
            self._velocity += step * self._step
            count += 1
        problem.tangents.forget()
        if not cones.gap <= _USEFUL * first:
            for g, old in zip(groups, before, strict=True):
                g.impulse[:] = old
        return count

    def _linearise(self) -> None:
        """Take impulses, K and what is missing; `_own` becomes H r, `_left` w^-1 (v_free - v)."""
        self._problem.momentum(self._free - self._velocity, self._left)
        self._own[:] = 0.0
        for number, (g, springs) in enumerate(self._groups()):
            self._cones.linearise(number, self._velocity, springs.stiffness)
            springs.source[:] = 0.0
            spread_kernel(g.sides)(self._own, g.couplings, g.impulse)

    def _groups(self):
        return zip(self._interactions.groups, self._problem.tangents.groups, strict=True)

    def _solve(self, bound: float) -> int:
        """dv, dx and dz for g_x of now, from those for g_x of before; iterations."""
        problem, force = self._problem, self._force
        for number, (_, springs) in enumerate(self._groups()):
            before = springs.source.copy()
            self._cones.answer(number, self._step, springs.source)
            np.subtract(springs.source, before, out=springs.source)
        problem.tangents.spread_source(self._interactions, force)
        self._left += force
        problem.hold(self._left)
        iterations = problem.improve(self._left, self._step, bound, _MAX_LINEAR)
        for number, (_, springs) in enumerate(self._groups()):
            self._cones.answer(number, self._step, springs.source)
        self._cones.follow()
        return iterations

    def _again(self, bound: float) -> np.ndarray:
        self._solve(bound)
        return self._step.copy()
