# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Who is in contact, by an interior point: where Newton's method goes in circles on dry contacts.

The path of `nscd/solvers/central_path.py` on the unknowns of a monolithic step. Of each point that
may touch, x and z of `nscd/solvers/cone_points.py` stay within their cones while x . z falls to
zero, and each iteration solves

    (A + H K H^T) dv = R + H (r + g)

with the springs K and sources g given there, for its predictor and again for its corrector. Points
of other laws have the springs that Newton's method would give them. So no point changes its branch
at once: where a Newton iteration takes turns between a point that is open, and is pushed in, and
one that slips, and is pulled, it sticks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from xper_fx.bulk.coupled_step import Correction, CoupledStep
from xper_fx.bulk.sparse_direct import SingularMatrixError
from xper_fx.nscd.solvers.cone_points import ConePoints, coulomb_points

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
        step: its load is given, and no bond softens.
        begin: takes it to its start.

    Yields:
        Where one is near. None is where no point may touch.
    """
    for start in _STARTS:
        begin()
        if _Path(step, start).run():
            yield


class _Path:
    """x, z and velocities on their way.

    Args:
        step: at its start.
        start: how large x and z are at first, beside what impulses and velocities are.
    """

    def __init__(self, step: CoupledStep, start: float):
        self._step, self._groups = step, step.interactions.groups
        points = {number: coulomb_points(g) for number, g in enumerate(self._groups)}
        points = {number: given for number, given in points.items() if given is not None}
        groups = {number: self._groups[number] for number in points}
        self._cones = ConePoints(groups, points, step.interactions.dim, step.ranks)
        closed, size = self._cones.of_group, self._cones.root_mean_square
        impulse = size(
            float(np.sum(self._groups[number].impulse[own.at, 0] ** 2))
            for number, own in closed.items()
        )
        if impulse == 0.0:  # the first step
            impulse = step.size()
        slots = step.present().reshape(-1, step.interactions.dim)
        speeds = []
        for number, own in closed.items():
            g = groups[number]
            u = g.points.relative(slots)[own.at, 0]
            speeds.append(float(np.sum((u - own.least) ** 2)))
            speeds.append(float(np.sum((g.compliance[own.at, 0] * impulse) ** 2)))
        self._cones.begin(start * impulse, start * size(speeds))

    def run(self) -> bool:
        """Descend; whether it led somewhere."""
        first, short = self._cones.gap, 0
        if first == 0.0:  # nothing moves, or nothing touches
            return False
        self._linearise()
        for _ in range(_MAX_ITERATIONS):
            try:
                length = self._advance()
            except SingularMatrixError:
                break
            self._linearise()
            short = 0 if length > _SHORT else short + 1
            if self._cones.gap <= _SHARE * first or short == _JAMS:
                break
        return self._cones.gap <= _USEFUL * first

    def _linearise(self) -> None:
        """Take impulses, K and what is missing."""
        step, cones = self._step, self._cones
        step.linearise(_PROXIMAL)
        slots = step.present()
        for number in cones.of_group:
            g, k = self._groups[number], step.tangents.stiffness[number]
            k[:], g.impulse[:], step.tangents.source[number][:] = 0.0, 0.0, 0.0
            if g.turning is not None:
                cones.renew(number)
            cones.linearise(number, slots, k)

    def _advance(self) -> float:
        """Go nearly as far along the corrector as the cones allow; how far."""
        step, cones = self._step, self._cones
        step.take_springs()
        step.corrections += 1
        cones.predict()
        self._correction()
        cones.correct()
        correction = cones.recentred(self._correction, self._correction())
        if not (step.ranks.all(np.isfinite(correction.velocity).all()) and cones.finite):
            return 0.0
        length = cones.advance()
        step.move(step.velocity + length * correction.velocity, step.loading.time)
        for number, g in enumerate(self._groups):
            if number not in cones.of_group:
                g.impulse += length * correction.impulses[number]
        return length

    def _correction(self) -> Correction:
        """dv, dx and dz for g_x."""
        step = self._step
        self._answer(np.zeros_like(step.slots))
        found = step.along_springs()
        self._answer(step.motions.slots(found.velocity, 0.0 * step.loading.driven))
        self._cones.follow()
        return found

    def _answer(self, change: np.ndarray) -> None:
        """dx, and its impulses as the source g of the points, for a change of velocities."""
        for number in self._cones.of_group:
            self._cones.answer(number, change, self._step.tangents.source[number])
