# SPDX-License-Identifier: LGPL-3.0-or-later
"""The linearised problem of a scene, kept from call to call.

What it keeps of the points belongs to the w of the last step, the only one that a restarted run
knows. Where another w came since the last call, as of steps of another size that sweeps alone have
solved, nothing is kept, although the w of that call may have come back.

That of points which several ranks share is imported where there are such points.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.solvers.tangent import LinearisedProblem

if TYPE_CHECKING:
    from xper_fx.nscd.solvers.shared_tangent import SharedProblem


class Linearised:
    """The linearised problem of the points that were last asked for."""

    def __init__(self) -> None:
        self._problem: LinearisedProblem | SharedProblem | None = None
        self._interactions: Interactions | None = None
        self._renewals = self._exchanges = -1

    def problem(self, interactions: Interactions) -> LinearisedProblem | SharedProblem:
        """The linearised problem of a scene: that of the last call if points and w are the same."""
        exchanges, self._exchanges = self._exchanges, interactions.exchanges
        if self._interactions is interactions and self._renewals == interactions.renewals:
            if exchanges != interactions.exchanges:
                self._problem.renew()
            return self._problem
        self._interactions, self._renewals = interactions, interactions.renewals
        kind: type[LinearisedProblem | SharedProblem] = LinearisedProblem
        if interactions.halo is not None:
            from xper_fx.nscd.solvers.shared_tangent import SharedProblem as kind
        self._problem = kind(interactions)
        return self._problem

    def kept(self) -> list[object]:
        """The problem, if there is one."""
        return [] if self._problem is None else [self._problem]

    def saved(self, interactions: Interactions) -> dict[str, dict[str, np.ndarray]]:
        """What the problem keeps from step to step, if there is one and it is kept."""
        # contacts that are found make the problem a new one in each step
        if self._exchanges != interactions.exchanges or interactions.renewals:
            return {}
        return {"linearised": self._problem.tangents.saved(interactions)}

    def restore(self, interactions: Interactions, saved: Mapping[str, Mapping]) -> None:
        """Take what `saved` gave, for the same points and w."""
        if "linearised" in saved:
            self.problem(interactions).tangents.restore(interactions, saved["linearised"])
