# SPDX-License-Identifier: LGPL-3.0-or-later
"""Return to von Mises' yield surface along the trial deviator.

From a trial deviator s* with q* = sqrt(3/2 s* : s*) and the accumulated plastic strain alpha,

    q* <= K(alpha):  p = 0,    s = s*,
    else             p from q* - m p = K(alpha + p),    s = (1 - m p / q*) s*,

with m = 3 mu at small strain. The new accumulated plastic strain is alpha + p.

A committed state that has flowed has q* = K up to rounding, which would choose at random, point by
point, whether the first tangent of the next step is the elastic or the plastic one; Newton then
starts from nonsense. States within a relative 1e-11 of the surface therefore count as flowing (p =
0 to rounding): the first tangent is that of going on as before.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import ufl

from xper_fx.materials.hardening import Curve
from xper_fx.materials.material import Expression

# Relative to K; far above the rounding of q*, far below anything measured.
_BAND = 1e-11


class Return(NamedTuple):
    """What the return gives, in UFL."""

    stress: Any  #: the deviator s (Pa)
    increment: Any  #: p


def radial_return(trial: Expression, m: Expression, alpha: Expression, curve: Curve) -> Return:
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
    flows = ufl.gt(q, (1.0 - _BAND) * curve.stress(alpha))
    p = curve.increment(q, m, alpha)
    kept = ufl.conditional(flows, 1.0 - m * p / q, 1.0)
    return Return(kept * trial, ufl.conditional(ufl.And(flows, ufl.gt(p, 0.0)), p, 0.0))
