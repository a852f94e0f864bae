# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The step below which an explicit bulk is stable, which falls as cells are flattened.

Central differences are stable for h < 2 / omega_max, omega_max^2 being the largest eigenvalue of
M^-1 K. Viscous forces C v are those of the velocity at the start of the step. Of a mode with
C = c M, v1 = (1 - h c - s) v0 - h omega^2 q0 and q1 = q0 + h (v0 + v1) / 2 with s = (h omega)^2 / 2
have the determinant 1 - h c and the trace 2 - h c - 2 s, and no eigenvalue beyond one for

    (h omega)^2 + 2 h c <= 4,   h <= 4 / (c + sqrt(c^2 + 4 omega^2)).

At finite strain K is that of the present configuration: a cell squeezed to a third of its
height vibrates some three times as fast. Beyond the limit the fastest vibration grows by a factor
in each step, and takes its energy from nowhere.

K costs some ten times as much as forces, so it is assembled again only where it may have changed
enough. A cell strained by e since then vibrates up to 1 / (1 - e) times as fast, and a
material that stiffens does so too. K is assembled again once e exceeds half of the margin, one less
h over the stable step; `strain_watch.py` sees it in the step after, whatever crushes a cell.

Matter that has flowed counts as flowing on, with a tangent that is soft along the flow; as soon as
it vibrates it is as stiff as it is where nothing flows, without being strained. K of such a bulk is
therefore that of a place a little back on the way it came, in no time.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping

import numpy as np

from xper_fx.bulk.bulk import Bulk
from xper_fx.bulk.strain_watch import StrainWatch
from xper_fx.support.saved_rows import Rows

logger = logging.getLogger(__name__)

# Least margin of the strain. A step at its limit may be beyond it by as much before K is assembled
# again: the fastest vibration then grows by less than a tenth a step, and soon is a larger strain.
_LEAST = 1e-3
# Part of a step by which matter that flows goes back, so that it is elastic.
_BACK = 1e-3
# Share of the present stable step that a step may be once that one has fallen.
SAFE = 0.97


def stable_step(bulk: Bulk, displacement: np.ndarray | None = None) -> float:
    """Largest step (s) at which an explicit bulk is stable, with its damping; at rest or not."""
    critical = bulk.critical_step(displacement)
    if bulk.damping is None:
        return critical
    omega = 2.0 / critical
    rate = bulk.damping.rate(omega)
    return 4.0 / (rate + np.hypot(rate, 2.0 * omega))


class UnstableStepError(FloatingPointError):
    """The step is too long for the present configuration."""


class StableStep:
    """Follows the stable step of a bulk along a run.

    Args:
        bulk: at finite strain, as it is at rest.

    Attributes:
        step: the shortest stable step so far (s). It does not rise again: an explicit step that
            goes up and down near it feeds the fastest vibrations.
    """

    def __init__(self, bulk: Bulk):
        self._bulk = bulk
        self.step = self._at_rest = stable_step(bulk)
        points, _ = bulk.forms.quadrature
        self._watch = StrainWatch(bulk.forms.V, points)

    def require(self, size: float, displacement: np.ndarray, velocity: np.ndarray) -> None:
        """Raise an UnstableStepError if a step of size h (s) from a state is not stable."""
        if self._bears(size):
            place = self._bulk.unknowns.expand(displacement).reshape(-1, self._bulk.dim)
            bound = max(0.5 * (1.0 - size / self.step), _LEAST)
            if self._bulk.ranks.max(self._watch.largest(place, bound)) > bound:
                self._watch.count_from(place)
                self._assemble(size, displacement, velocity)
        if not self._bears(size):
            raise UnstableStepError(
                f"Cells are flattened, or have stiffened, so far that the explicit bulk is stable "
                f"below {self.step:.3g} s alone, {self._at_rest:.3g} s at rest: look at the last "
                'output, and take a smaller step, scheme="implicit", or coarser cells there.'
            )

    def _bears(self, size: float) -> bool:
        """Whether a step is below the stable one as it is known."""
        return size <= (self._at_rest if self.step == self._at_rest else SAFE * self.step)

    def _assemble(self, size: float, displacement: np.ndarray, velocity: np.ndarray) -> None:
        """Look at K."""
        bulk = self._bulk
        bulk.forms.set_step(0.0)
        back = _BACK * size * velocity if bulk.forms.flows else 0.0
        now = stable_step(bulk, displacement - back)
        if now < self.step:
            self.step = now
            logger.info(
                "the stable step of the bulk has fallen from %.3g to %.3g s, as cells are "
                "flattened or stiffen", self._at_rest, now,
            )  # fmt: skip

    def saved(self) -> dict:
        """What steps to come depend on."""
        number = self._bulk.forms.bodies.parent_cell
        return {"step": self.step, "inverses": Rows(number, self._watch.inverses)}

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave, its rows in order."""
        self.step = saved["step"]
        self._watch.take(saved["inverses"][self._bulk.forms.bodies.parent_cell])
