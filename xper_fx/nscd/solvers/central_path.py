# SPDX-License-Identifier: LGPL-3.0-or-later
r"""An interior point on the velocities of the bodies, for points with springs.

Newton's method (`newton.py`) goes round in circles where many contacts could be open, stick or
slip: which they are changes all at once. An interior point has no branches. In the coordinates of
`nscd/friction/interior_point.py`, x = (mu r'_N, r'_T), z = (u~_N / mu, u~_T), both within
L = {x_0 >= |x_T|}, it follows x o z = s e while s falls to zero, in some 12 to 20 iterations
whatever the size is. There W is assembled and factorised; here each iteration is the problem of
`tangent.py`,

    (w^-1 + H K H^T) dv = H (r + g) - w^-1 (v - v_free),

solved by its GMRES, whose blocks of facing nodes hold the springs of the points however stiff they
have become. With r' = D x, r = r' - k (push + u) (`CoulombPoints`), D = diag(1 / mu, 1),

    z = D (u - least n + shift) + |z_T| e_0,   C = I - e_0 d^T,  d = z_T / |z_T|,
    dx = M (C g_x + m - D H^T dv),   dz = g_x - Theta dx,   M = Theta^-1 C^-1,
    K = D M D + k,   g = D M (C g_x + m),

m being what is missing in the first of them, and g_x the predictor's or the corrector's of Mehrotra
(Acary, Armand, Nguyen and Shpakovych 2023). Points that no impulse can open (least = -inf) are left
out.

**How well.** GMRES leaves a share of what bodies bear that falls with x . z: rough velocities
would do for the first iterations, and only the last are worth its time.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.krylov import norm
from xper_fx.nscd.couplings import Sides, point_velocity, spread_kernel
from xper_fx.nscd.friction.interior_point import LEAST_FRICTION, TINY, cone_kernels
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.nscd.laws.law import CoulombPoints
from xper_fx.nscd.point_group import PointGroup
from xper_fx.nscd.solvers.tangent import LinearisedProblem

# What GMRES leaves, relative to |H r|, for x . z as it was at first; and the least of x . z for it.
_FORCING, _LEAST_GAP = 0.03, 3e-5
_MAX_ITERATIONS, _MAX_GMRES = 40, 200
# Steps shorter than this end the descent; x . z at which it has led somewhere.
_SHORTEST, _USEFUL = 1e-3, 1e-3
# x . z at the end, relative to the first one, for a tolerance of 1.
_SHARE = 3e-3


@cache
def _point_kernels(sides: Sides):
    """Kernels over the closed points of a group; arrays in x and z have `dim` columns."""
    dim, m = sides.dim, sides.components
    cones = cone_kernels(dim)
    size_t, scale = cones.size_t, cones.scale
    read = point_velocity(sides)

    @njit(inline="always")
    def inverse(scaling, z, a, t):
        """t = M t: Theta^-1 = eta^2 (2 w w^T - J)."""
        slip, square = max(size_t(z, a), TINY), scaling[a, dim] * scaling[a, dim]
        for j in range(1, m):
            t[0] += z[a, j] / slip * t[j]
        along = 0.0
        for j in range(m):
            along += scaling[a, j] * t[j]
        for j in range(m):
            t[j] = square * (2.0 * scaling[a, j] * along + (t[j] if j > 0 else -t[j]))

    @njit(**LEAN_ENTRY)
    def linearise(v, c, points, impulse, stiffness):
        at, least, shift, mu, spring, push, x, z, scaling, missing, _, _, t = points
        for a in range(len(at)):
            i = at[a]
            u = read(v, c, i)
            scale(x, z, a, scaling)
            for j in range(m):
                pull = spring[a, j] * (push[a, j] + u[j])
                if j == 0:
                    missing[a, 0] = z[a, 0] - (u[0] - least[a]) / mu[a] - size_t(z, a)
                    impulse[i, 0] = x[a, 0] / mu[a] - pull
                else:
                    missing[a, j] = z[a, j] - u[j] - shift[a, j - 1]
                    impulse[i, j] = x[a, j] - pull
            for j in range(m):
                for k in range(m):
                    t[k] = 0.0
                t[j] = 1.0 / mu[a] if j == 0 else 1.0
                inverse(scaling, z, a, t)
                for k in range(m):
                    stiffness[i, k, j] = t[k] / mu[a] if k == 0 else t[k]
                stiffness[i, j, j] += spring[a, j]

    @njit(**LEAN_ENTRY)
    def answer(dv, c, points, source):
        at, _, _, mu, _, _, _, z, scaling, missing, g, dx, t = points
        for a in range(len(at)):
            i = at[a]
            du = read(dv, c, i)
            slip = max(size_t(z, a), TINY)
            for j in range(m):
                t[j] = g[a, j] + missing[a, j] - (du[j] / mu[a] if j == 0 else du[j])
            for j in range(1, m):
                t[0] -= z[a, j] / slip * g[a, j]
            inverse(scaling, z, a, t)
            for j in range(m):
                dx[a, j] = t[j]
                source[i, j] = t[j] / mu[a] if j == 0 else t[j]

    return linearise, answer


class _ClosedPoints(NamedTuple):
    """The n points of a group that may carry impulses, and where the path is at them.

    Attributes:
        at: which they are.
        least, shift, mu, spring, push: their law, as of `CoulombPoints`.
        x, z, missing, g, dx: shape (n, dim), see the module docstring.
        scaling: shape (n, dim + 1), of `ConeKernels`.
        room: dim numbers.
    """

    at: np.ndarray
    least: np.ndarray
    shift: np.ndarray
    mu: np.ndarray
    spring: np.ndarray
    push: np.ndarray
    x: np.ndarray
    z: np.ndarray
    scaling: np.ndarray
    missing: np.ndarray
    g: np.ndarray
    dx: np.ndarray
    room: np.ndarray


def _law(group: PointGroup, points: CoulombPoints) -> tuple[np.ndarray, ...]:
    """What a path begins with: `at`, least, shift, mu, spring and push of `_ClosedPoints`."""
    at = np.flatnonzero(np.isfinite(points.least))
    none = np.zeros((len(group), group.kernels.components))
    spring, push = (none if a is None else a for a in (points.spring, points.push))
    mu = np.maximum(points.friction, LEAST_FRICTION)
    if group.kernels.components == 1:
        mu = np.ones(len(group))
    law = points.least, points.shift, mu, spring, push
    return (at, *(np.ascontiguousarray(a[at]) for a in law))


def _laws(interactions: Interactions) -> list[tuple[np.ndarray, ...]] | None:
    """Of each group, see `_law`; None where a law is of another kind."""
    found = []
    for g in interactions.groups:
        if g.kernels.coulomb is None:
            return None
        points = g.kernels.coulomb(g.terms, g.details, g.parameters)
        if np.any(points.bound) or np.any(points.tip):
            return None
        found.append(_law(g, points))
    return found


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
    laws = _laws(interactions)
    if laws is None:
        return 0
    path = _Path(interactions, free, problem, laws)
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
        laws: list[tuple[np.ndarray, ...]],
    ):
        self._interactions, self._free, self._problem = interactions, free, problem
        dim = interactions.dim
        ends = np.cumsum([0] + [len(law[0]) for law in laws])
        arrays = np.zeros((7, ends[-1], dim))
        self._x, self._z, self._missing, self._g, self._dx, self._dz, self._unused = arrays
        self._scaling, room = np.empty((ends[-1], dim + 1)), np.empty(dim)
        own = self._x, self._z, self._scaling, self._missing, self._g, self._dx
        self._closed = [
            _ClosedPoints(*law, *(a[first:last] for a in own), room)
            for (first, last), law in zip(pairwise(ends.tolist()), laws, strict=True)
        ]
        self._cones = cone_kernels(dim)
        self._velocity = free.copy()
        interactions.add_velocity(self._velocity)
        self._none, self._force, self._own, self._step = np.zeros((4, len(free)))
        speeds, impulses = 0.0, 0.0
        slots = free.reshape(-1, dim)
        for g, points in zip(interactions.groups, self._closed, strict=True):
            u = g.points.relative(slots)[points.at]
            speeds += float(np.sum((u[:, 0] - points.least) ** 2))
            if u.shape[1] > 1:
                speeds += float(np.sum((points.mu[:, None] * (u[:, 1:] + points.shift)) ** 2))
            impulses += float(np.sum(g.impulse[points.at, 0] ** 2))
        self.begins = speeds > 0.0 and impulses > 0.0
        if self.begins:
            speed, impulse = np.sqrt(np.array([speeds, impulses]) / ends[-1])
            for points in self._closed:
                points.x[:, 0], points.z[:, 0] = impulse * points.mu, speed / points.mu

    def run(self, least: float) -> int:
        """Descend to a share of the first x . z; the number of iterations."""
        groups, problem = self._interactions.groups, self._problem
        before = [g.impulse.copy() for g in groups]
        first, count, step, iterations = self._gap(), 0, 1.0, 0
        gap = first
        for g, _, springs in self._groups():
            g.impulse[:], springs.stiffness[:], springs.source[:] = 0.0, 0.0, 0.0
        while True:
            self._linearise()
            if gap <= least * first or count == _MAX_ITERATIONS or step < _SHORTEST:
                break
            problem.heed(iterations)
            problem.take_springs()
            if not problem.solvable:
                break
            share = min(max(gap / first, _LEAST_GAP), 1.0)
            bound = _FORCING * share * norm(self._own)
            self._own -= self._left()
            self._step[:] = 0.0
            np.negative(self._z, out=self._g)
            iterations = self._solve(bound)
            self._cones.correct(
                self._scaling, self._x, self._z, self._dx, self._dz, gap, self._missing, self._g,
                self._unused,
            )  # fmt: skip
            iterations = max(iterations, self._solve(bound))
            if not (np.isfinite(self._step).all() and np.isfinite(self._dz).all()):
                break
            step = self._cones.advance(self._x, self._z, self._dx, self._dz)
            self._velocity += step * self._step
            count, gap = count + 1, self._gap()
        problem.tangents.forget()
        if not gap <= _USEFUL * first:
            for g, old in zip(groups, before, strict=True):
                g.impulse[:] = old
        return count

    def _gap(self) -> float:
        return float(np.vdot(self._x, self._z))

    def _linearise(self) -> None:
        """Take impulses, K and what is missing; `_own` becomes H r."""
        self._own[:] = 0.0
        for g, points, springs in self._groups():
            linearise, _ = _point_kernels(g.sides)
            linearise(self._velocity, g.couplings, points, g.impulse, springs.stiffness)
            spread_kernel(g.sides)(self._own, g.couplings, g.impulse)

    def _groups(self):
        groups, tangents = self._interactions.groups, self._problem.tangents.groups
        return zip(groups, self._closed, tangents, strict=True)

    def _left(self) -> np.ndarray:
        """w^-1 (v - v_free)."""
        self._problem.momentum(self._velocity - self._free, self._force)
        return self._force

    def _solve(self, bound: float) -> int:
        """dv, dx and dz for g_x, from the dv of before; iterations."""
        self._answer(self._none)
        problem, interactions = self._problem, self._interactions
        problem.tangents.spread_source(interactions, self._force)
        self._force += self._own
        problem.hold(self._force)
        iterations = problem.improve(self._force, self._step, bound, _MAX_GMRES)
        self._answer(self._step)
        self._cones.to_dz(self._scaling, self._g, self._dx, self._dz)
        return iterations

    def _answer(self, change: np.ndarray) -> None:
        """dx, and its impulses as the source g of the points, for a change of velocities."""
        for g, points, springs in self._groups():
            _point_kernels(g.sides)[1](change, g.couplings, points, springs.source)
