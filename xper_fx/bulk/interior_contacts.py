# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Who is in contact, by an interior point: where Newton's method goes in circles on dry contacts.

The path of `nscd/solvers/central_path.py` on the unknowns of a monolithic step. Of each point that
may touch, x = (mu r_N, r_T) and z = (u~_N / mu, u~_T) stay within their cones while x . z falls to
zero, and each iteration solves

    (A + H K H^T) dv = R + H (r + g)

with the springs K and sources g of that path, for its predictor and again for its corrector. Points
of other laws have the springs that Newton's method would give them. So no point changes its branch
at once: where a Newton iteration takes turns between a point that is open, and is pushed in, and
one that slips, and is pulled, it sticks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np

from xper_fx.bulk.coupled_step import CoupledStep
from xper_fx.bulk.sparse_direct import SingularMatrixError
from xper_fx.nscd.friction.interior_point import cone_kernels
from xper_fx.nscd.solvers.central_path import _ClosedPoints, _law, _point_kernels

# x . z at the end, relative to the first one, from which Newton's method goes on, and at which it
# may, at last.
_SHARE, _USEFUL = 1e-12, 1e-3
_MAX_ITERATIONS = 40
# Lengths of steps of which so many in a row lead nowhere.
_SHORT, _JAMS = 0.05, 3
# Sizes of x and z at first that are tried, beside those that they are thought to have.
_STARTS = (1.0, 100.0, 10.0)
# p of the springs of points of other laws.
_PROXIMAL = 1e-3


def find_contacts_inside(step: CoupledStep, begin: Callable[[], None]) -> Iterator[None]:
    """Bring velocities and impulses of a step near to its solution, on one path after another.

    Args:
        step: its load is given.
        begin: takes it to its start.

    Yields:
        Where one is near. None is where no point may touch, or bonds soften.
    """
    if step.growth is not None or step.softens or not step.ranks.alone:
        return
    for start in _STARTS:
        begin()
        laws = {}
        for number, g in enumerate(step.interactions.groups):
            if g.kernels.coulomb is not None:
                points = g.kernels.coulomb(g.terms, g.details, g.parameters)
                if np.any(points.bound) or np.any(points.tip):
                    return
                laws[number] = _law(g, points)
        if not laws:
            return
        if _Path(step, laws, start).run():
            yield


class _Path:
    """x, z and velocities on their way.

    Args:
        step: at its start.
        laws: of the groups that may touch, see `_law`.
        start: how large x and z are at first, beside what impulses and velocities are.
    """

    def __init__(self, step: CoupledStep, laws: dict[int, tuple[np.ndarray, ...]], start: float):
        self._step = step
        groups, dim = step.interactions.groups, step.interactions.dim
        ends = np.cumsum([0] + [len(law[0]) for law in laws.values()])
        arrays = np.zeros((7, ends[-1], dim))
        self._x, self._z, self._missing, self._g, self._dx, self._dz, self._unused = arrays
        self._scaling, room = np.empty((ends[-1], dim + 1)), np.empty(dim)
        own = self._x, self._z, self._scaling, self._missing, self._g, self._dx
        bounds = pairwise(ends.tolist())
        self._closed = {
            number: _ClosedPoints(*law, *(a[first:last] for a in own), room)
            for (first, last), (number, law) in zip(bounds, laws.items(), strict=True)
        }
        self._cones = cone_kernels(dim)
        impulse = self._impulse()
        speeds = 0.0
        slots = step.present().reshape(-1, dim)
        for number, points in self._closed.items():
            g = groups[number]
            u = g.points.relative(slots)[points.at, 0]
            speeds += float(np.sum((u - points.least) ** 2))
            speeds += float(np.sum((g.compliance[points.at, 0] * impulse) ** 2))
        speed = np.sqrt(speeds / max(ends[-1], 1))
        impulse, speed = start * impulse, start * speed
        for points in self._closed.values():
            points.x[:, 0], points.z[:, 0] = impulse * points.mu, speed / points.mu

    def _impulse(self) -> float:
        """How large impulses are: as in the last step, or what bodies have to bear."""
        squares, count = 0.0, 0
        for number, points in self._closed.items():
            impulses = self._step.interactions.groups[number].impulse[points.at, 0]
            squares, count = squares + float(impulses @ impulses), count + len(impulses)
        if squares == 0.0:
            return self._step.size() / np.sqrt(max(count, 1))
        return np.sqrt(squares / count)

    def run(self) -> bool:
        """Descend; whether it led somewhere."""
        first = gap = self._gap()
        if first == 0.0:  # nothing moves, or nothing touches
            return False
        self._linearise()
        short = 0
        for _ in range(_MAX_ITERATIONS):
            try:
                length = self._advance(gap)
            except SingularMatrixError:
                break
            self._linearise()
            gap, short = self._gap(), 0 if length > _SHORT else short + 1
            if gap <= _SHARE * first or short == _JAMS:
                break
        return gap <= _USEFUL * first

    def _advance(self, gap: float) -> float:
        """Go nearly as far along the corrector as the cones allow; how far."""
        step = self._step
        step.take_springs()
        step.corrections += 1
        np.negative(self._z, out=self._g)
        self._correction()
        self._cones.correct(
            self._scaling, self._x, self._z, self._dx, self._dz, gap, self._missing, self._g,
            self._unused,
        )  # fmt: skip
        correction = self._correction()
        if not (np.isfinite(correction.velocity).all() and np.isfinite(self._dz).all()):
            return 0.0
        length = self._cones.advance(self._x, self._z, self._dx, self._dz)
        step.move(step.velocity + length * correction.velocity, step.loading.time)
        for number, g in enumerate(step.interactions.groups):
            if number not in self._closed:
                g.impulse += length * correction.impulses[number]
        return length

    def _gap(self) -> float:
        return float(np.vdot(self._x, self._z))

    def _linearise(self) -> None:
        """Take impulses, K and what is missing."""
        step, tangents = self._step, self._step.tangents
        step.linearise(_PROXIMAL)
        slots = step.present()
        for number, points in self._closed.items():
            g, k = step.interactions.groups[number], tangents.stiffness[number]
            if g.turning is not None:
                _, *law = _law(g, g.kernels.coulomb(g.terms, g.details, g.parameters))
                for own, now in zip(points[1:6], law, strict=True):
                    own[:] = now
            k[:], g.impulse[:], tangents.source[number][:] = 0.0, 0.0, 0.0
            _point_kernels(g.sides)[0](slots, g.couplings, points, g.impulse, k)

    def _correction(self):
        """dv, dx and dz for g_x."""
        step = self._step
        self._answer(np.zeros_like(step.slots))
        found = step.along_springs()
        self._answer(step.motions.slots(found.velocity, 0.0 * step.loading.driven))
        self._cones.to_dz(self._scaling, self._g, self._dx, self._dz)
        return found

    def _answer(self, change: np.ndarray) -> None:
        """dx, and its impulses as the source g of the points, for a change of velocities."""
        for number, points in self._closed.items():
            g = self._step.interactions.groups[number]
            source = self._step.tangents.source[number]
            _point_kernels(g.sides)[1](change, g.couplings, points, source)
