# SPDX-License-Identifier: LGPL-3.0-or-later
"""The linearised problem of each scene, kept from call to call.

That of points which several ranks share is imported where there are such points.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.tangent import LinearisedProblem

if TYPE_CHECKING:
    from xper_fx.nscd.shared_tangent import SharedProblem

_problems: WeakKeyDictionary[Interactions, LinearisedProblem | SharedProblem] = WeakKeyDictionary()


def kept(interactions: Interactions) -> LinearisedProblem | SharedProblem | None:
    """The linearised problem that is held for a scene, if any."""
    return _problems.get(interactions)


def linearised_problem(interactions: Interactions) -> LinearisedProblem | SharedProblem:
    """The linearised problem of a scene, from the last call where w is the same."""
    problem = _problems.get(interactions)
    if problem is None or problem.renewals != interactions.renewals:
        kind: type[LinearisedProblem | SharedProblem] = LinearisedProblem
        if interactions.halo is not None:
            kind = import_module("xper_fx.nscd.shared_tangent").SharedProblem
        problem = _problems[interactions] = kind(interactions)
    else:
        problem.renew()
    return problem


def saved(interactions: Interactions) -> dict[str, np.ndarray]:
    """What the linearised problem keeps from step to step, if there is one and it is kept."""
    problem = kept(interactions)
    # contacts that are found make the problem a new one in each step
    return {} if problem is None or interactions.renewals else problem.tangents.saved(interactions)


def restore(interactions: Interactions, memory: Mapping[str, np.ndarray]) -> None:
    """Take what `saved` gave, for the same points and w."""
    linearised_problem(interactions).tangents.restore(interactions, memory)
