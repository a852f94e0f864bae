# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Motion of rigid bodies in runs without inertia: punches and rollers, whose motions are given.

With the prescribed velocity v(t) a static step from t0 to t1 moves a body by the integral of v over
it, by Gauss's rule with three points, whatever theta says. The step's velocity is their quotient

    v_h = 1/h \int_{t0}^{t1} v dt.

Contacts push linearly in the time from p0 at the start of the step to p1 at its end, as those of
supports do in the ledger: the drive does the work -h v_h . (p0 + p1) / 2.

Masses are left out: a driven body has no weight, and no momentum.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from xper_fx.nscd.rigid.bodies import RigidBodies
from xper_fx.nscd.rigid.motion import RigidMotion, RigidWork

# Gauss's rule on [0, 1]: places and weights.
_PLACES = 0.5 + np.sqrt(0.15) * np.array([-1.0, 0.0, 1.0])
_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0
# How often a time is cut in which bodies move too far.
_CUTS = 20


class DrivenMotion(RigidMotion):
    """As `RigidMotion`, of bodies whose every degree of freedom is prescribed, without inertia.

    Attributes:
        pushed: forces and torques of contacts at the committed state, shape (n, 2 dim), N, N m.
    """

    def __init__(self, bodies: RigidBodies):
        bodies = copy.copy(bodies)
        bodies.mass, bodies.inertia = np.zeros_like(bodies.mass), np.zeros_like(bodies.inertia)
        super().__init__(bodies)
        self.pushed = self._pushed = np.zeros((len(bodies), 2 * bodies.dim))

    def _given(self, step: float, time: float) -> np.ndarray:
        """As of `RigidMotion`, by which bodies move in the step."""
        return self._moved(time, time + step) / step

    def velocities(self, step: float, since: float, until: float) -> np.ndarray:
        """By which bodies move in a step (s) as from one time to another, shape (2 n, dim).

        Along a path a step of a given size may end at any time.
        """
        return (self._moved(since, until) / step).reshape(-1, self.bodies.dim)

    def time_within(self, distance: float, since: float, longest: float) -> float:
        """Time (s) in which no point of a body moves by more than a distance (m).

        Not by how fast bodies were: one may stand still until now, and one that turns has arms.

        Args:
            distance: m, may be infinite.
            since: time at which it begins (s).
            longest: what is asked for at most (s).
        """
        bodies, dim = self.bodies, self.bodies.dim
        arms = np.where(bodies.shapes.ball_radius > 0.0, 0.0, bodies.bounding_radius)
        arms[np.isinf(arms)] = 0.0  # of walls
        for _ in range(_CUTS):
            moved = self._moved(since, since + longest)
            turned = np.linalg.norm(moved[:, dim:], axis=1) * arms
            far = float((np.linalg.norm(moved[:, :dim], axis=1) + turned).max(initial=0.0))
            if far <= distance:
                break
            longest *= max(distance / far, 0.1)
        return longest

    def _moved(self, since: float, until: float) -> np.ndarray:
        """Integrals of the prescribed velocities over a time (s), shape (n, 2 dim)."""
        if not self._motions:
            return (until - since) * self._constant_motion
        rule = zip(_WEIGHTS, since + (until - since) * _PLACES, strict=True)
        return (until - since) * sum(weight * self._given_at(time) for weight, time in rule)

    def work(self, contacts: npt.ArrayLike) -> RigidWork:
        """As of `RigidMotion`, by the mean of what contacts do at the start and the end."""
        step, work = self._at[0], super().work(contacts)
        self._pushed = np.reshape(contacts, self.pushed.shape) / step
        done = 0.5 * step * float(np.vdot(self._kicked, self.pushed + self._pushed))
        change = 0.5 * step * float(np.vdot(self._kicked, self.pushed - self._pushed))
        return work._replace(contacts=done, prescribed=-done - work.loads, change=change)

    def commit(self) -> None:
        """As of `RigidMotion`."""
        super().commit()
        self.pushed = self._pushed

    def saved(self) -> dict[str, np.ndarray]:
        """As of `RigidMotion`, with what contacts do."""
        return super().saved() | {"pushed": self.pushed}

    def restore(self, saved: Mapping[str, np.ndarray]) -> None:
        """As of `RigidMotion`."""
        super().restore(saved)
        self.pushed = saved["pushed"]
