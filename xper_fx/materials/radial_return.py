# SPDX-License-Identifier: LGPL-3.0-or-later
"""Return to von Mises' yield surface along the trial deviator.

From a trial deviator s* with q* = sqrt(3/2 s* : s*) and the accumulated plastic strain alpha,

    q* <= K(alpha):  p = 0,    s = s*,
    else             p from q* - m p = K(alpha + p),    s = (1 - m p / q*) s*,

with m = 3 mu at small strain. The new accumulated plastic strain is alpha + p.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import ufl

from xper_fx.materials.hardening import Curve


class Return(NamedTuple):
    """What the return gives, in UFL.

    Attributes:
        stress: the deviator s (Pa).
        increment: p.
    """

    stress: Any
    increment: Any


def radial_return(trial, m, alpha, curve: Curve) -> Return:
    """The return from a trial deviator.

    Every quotient by q* stands inside the plastic branch, so that neither the stress nor its
    derivative is ever divided by zero.

    Args:
        trial: s* (Pa), 3 x 3 and traceless.
        m: slope of the equivalent stress against p (Pa).
        alpha: accumulated plastic strain at the start of the step.
        curve: the hardening law.
    """
    q = ufl.sqrt(1.5 * ufl.inner(trial, trial))
    flows = ufl.gt(q, curve.stress(alpha))
    p = curve.increment(q, m, alpha)
    kept = ufl.conditional(flows, 1.0 - m * p / q, 1.0)
    return Return(kept * trial, ufl.conditional(flows, p, 0.0))
