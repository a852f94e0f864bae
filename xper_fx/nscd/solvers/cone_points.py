# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The points of an interior point on velocities: x and z of all that may touch, in their cones.

In the coordinates of `nscd/friction/interior_point.py`, x = (mu r'_N, r'_T) and z = (u~_N / mu,
u~_T), both within L = {x_0 >= |x_T|}. With r' = D x, r = r' - k (push + u) (`CoulombPoints`),
D = diag(1 / mu, 1),

    z = D (u - least n + shift) + |z_T| e_0,   C = I - e_0 d^T,  d = z_T / |z_T|,
    dx = M (C g_x + m - D H^T dv),   dz = g_x - Theta dx,   M = Theta^-1 C^-1,
    K = D M D + k,   g = D M (C g_x + m),

m being what is missing in the first of them, and g_x the predictor's or the corrector's of Mehrotra
(Acary, Armand, Nguyen and Shpakovych 2023); K and g are springs and sources as of
`nscd/point_tangents.py`. Points that no impulse can open (least = -inf) are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cache
from itertools import pairwise
from typing import NamedTuple, TypeVar

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.couplings import Sides, point_velocity
from xper_fx.nscd.friction.interior_point import (
    ALONE,
    LEAST_FRICTION,
    TINY,
    centre_of,
    cone_kernels,
    go_along,
)
from xper_fx.nscd.halo_protocol import Reductions
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.nscd.laws.law import CoulombPoints
from xper_fx.nscd.point_group import PointGroup

# A direction is changed so often at most, and no more once the step is longer than `_FAR`; each
# change tries for a step that is `_FARTHER` longer, and is taken if it gains `_GAIN`.
_RECENTRINGS, _FAR, _FARTHER, _GAIN = 2, 0.95, 0.3, 0.02

_Found = TypeVar("_Found")


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


def _law(group: PointGroup, points: CoulombPoints, at: np.ndarray) -> tuple[np.ndarray, ...]:
    """Least, shift, mu, spring and push of `_ClosedPoints`."""
    none = np.zeros((len(group), group.kernels.components))
    spring, push = (none if a is None else a for a in (points.spring, points.push))
    mu = np.maximum(points.friction, LEAST_FRICTION)
    if group.kernels.components == 1:
        mu = np.ones(len(group))
    law = points.least, points.shift, mu, spring, push
    return tuple(np.ascontiguousarray(a[at]) for a in law)


def coulomb_points(group: PointGroup) -> CoulombPoints | None:
    """The constants of a group's law, None where it is of another kind than cones can take."""
    if group.kernels.coulomb is None:
        return None
    points = group.kernels.coulomb(group.terms, group.details, group.parameters)
    return None if np.any(points.bound) or np.any(points.tip) else points


class ConePoints:
    """x and z of the points of some groups.

    Args:
        groups: by their numbers.
        points: constants of their laws.
        ranks: that have the points.

    Attributes:
        gap: x . z.
        of_group: of each group, by its number.
    """

    def __init__(
        self,
        groups: Mapping[int, PointGroup],
        points: Mapping[int, CoulombPoints],
        dim: int,
        ranks: Reductions = ALONE,
    ):
        self._groups, self._ranks = groups, ranks
        closed = {number: np.flatnonzero(np.isfinite(p.least)) for number, p in points.items()}
        ends = np.cumsum([0] + [len(at) for at in closed.values()])
        arrays = np.zeros((7, ends[-1], dim))
        self._x, self._z, self._missing, self._g, self._dx, self._dz, self._unused = arrays
        self._scaling, room = np.empty((ends[-1], dim + 1)), np.empty(dim)
        own = self._x, self._z, self._scaling, self._missing, self._g, self._dx
        bounds = pairwise(ends.tolist())
        self.of_group = {
            number: _ClosedPoints(
                at, *_law(groups[number], points[number], at), *(a[first:last] for a in own), room
            )
            for (first, last), (number, at) in zip(bounds, closed.items(), strict=True)
        }
        self._cones, self.gap, self._centre = cone_kernels(dim), 0.0, 0.0

    def begin(self, impulse: float, speed: float) -> None:
        """Take x and z of a size: of impulses (N s) and of velocities (m/s)."""
        for points in self.of_group.values():
            points.x[:, 0], points.z[:, 0] = impulse * points.mu, speed / points.mu
        self._measure()

    def _measure(self) -> None:
        self.gap = self._ranks.sum(float(np.vdot(self._x, self._z)))

    def root_mean_square(self, squares: Iterable[float]) -> float:
        """Of sums of squares over the points of each group."""
        count = self._ranks.sum(len(self._x))
        return np.sqrt(self._ranks.sum(sum(squares)) / count) if count else 0.0

    def renew(self, number: int) -> None:
        """Take the constants of a group's law anew, whose frames have turned.

        Points that have opened since keep the least velocity that they had: who is in the cones
        stays as it was.
        """
        group, own = self._groups[number], self.of_group[number]
        least, *law = _law(group, coulomb_points(group), own.at)
        np.copyto(own.least, least, where=np.isfinite(least))
        for old, now in zip(own[2:6], law, strict=True):
            old[:] = now

    def linearise(self, number: int, velocity: np.ndarray, stiffness: np.ndarray) -> None:
        """Take the impulses of a group, its K and what is missing.

        Args:
            number: of the group.
            velocity: shape (num_slots * dim,), m/s.
            stiffness: shape (n, components, components), zero where points are open.
        """
        group = self._groups[number]
        kernel, _ = _point_kernels(group.sides)
        kernel(velocity, group.couplings, self.of_group[number], group.impulse, stiffness)

    def predict(self) -> None:
        """Take g_x of the predictor."""
        np.negative(self._z, out=self._g)

    def correct(self) -> None:
        """Take g_x of the corrector, from the predictor's dx and dz."""
        x, z, dx, dz = self._x, self._z, self._dx, self._dz
        self._centre = centre_of(self._cones, x, z, dx, dz, self.gap, self._ranks)
        self._cones.correct(
            self._scaling, x, z, dx, dz, self._centre, self._missing, self._g, self._unused
        )

    def recentred(self, solve: Callable[[], _Found], found: _Found) -> _Found:
        """Change g_x as long as dx and dz then lead farther (Gondzio 1996).

        x o z after a step that is longer than the cones allow is looked at in its eigenvalues:
        those far from the centre's are brought nearer to it. Another right-hand side costs little
        beside another matrix.

        Args:
            solve: takes dx and dz for the g_x of now, and returns the change that they go with.
            found: the change for the g_x of before.

        Returns:
            The change that dx and dz go with in the end.
        """
        length = self._room
        for _ in range(_RECENTRINGS):
            if length > _FAR:
                break
            before = self._dx.copy(), self._dz.copy()
            self._cones.recentre(
                self._scaling, self._x, self._z, self._dx, self._dz,
                min(1.0, length + _FARTHER), self._centre, self._g,
            )  # fmt: skip
            other = solve()
            longer = self._room
            if longer < length + _GAIN:
                self._dx[:], self._dz[:] = before
                break
            found, length = other, longer
        return found

    @property
    def _room(self) -> float:
        """The longest step that the cones of all ranks allow, at most 1."""
        longest = self._cones.longest(self._x, self._z, self._dx, self._dz)
        return min(1.0, -self._ranks.max(-longest))

    def answer(self, number: int, change: np.ndarray, source: np.ndarray) -> None:
        """Take dx of a group for a change of velocities, and its impulses as the source g.

        Args:
            number: of the group.
            change: of `velocity` (m/s).
            source: shape (n, components), N s.
        """
        group = self._groups[number]
        kernel = _point_kernels(group.sides)[1]
        kernel(change, group.couplings, self.of_group[number], source)

    def follow(self) -> None:
        """Take dz after all groups' dx."""
        self._cones.to_dz(self._scaling, self._g, self._dx, self._dz)

    @property
    def finite(self) -> bool:
        """Whether dz is, on all ranks."""
        return self._ranks.all(np.isfinite(self._dz).all())

    def advance(self) -> float:
        """Go along dx and dz nearly as far as the cones allow; how far."""
        step = go_along(self._cones, self._x, self._z, self._dx, self._dz, self._ranks)
        self._measure()
        return step
