# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Adhesion, viscosity, unilateral contact and friction (Raous, Cangemi and Cocou 1999; MAC_CZM).

The lips touch without penetration and rub, and adhesion of intensity a in [0, 1] holds them, with
the stiffness a^2 C, C = diag(C_N, C_T, C_T) and with the free energy and evolution

    a^2 e - w a,   e = <U>.C.<U> / 2,    b da/dt = -<2 a e - w>+.

The damage of this package is beta = a^2. Without viscosity a follows w / (2 e): in a direction of
stiffness k = C_N cos^2 + C_T sin^2 that is the curve

    g(x) = 1 for x <= d0,   (d0 / x)^4 beyond,    w = k d0^2,

a traction that falls from the strength sqrt(k w) as 1 / x^3, with the area w in every direction.
With viscosity b damage lags behind it (`viscous_damage.py`), and the traction at a large speed of
opening is larger. Adhesion never ends in this model; the curve ends at `_END` d0, where a is 1e-4,
and d0 is such that the area up to there is w: 5e-5 of w.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_INNER
from xper_fx.nscd.laws.bond import Bond
from xper_fx.nscd.laws.curves.curve import CurveFunctions
from xper_fx.nscd.laws.damage_curve import BETA0, C_N, C_T, DAMAGE, shape_column, stiffness_along
from xper_fx.nscd.laws.parameters import take_parameters
from xper_fx.nscd.laws.weakening import Weakening, falls_below, one_curve

# End of the curve beside d0, and its area up to there beside k d0^2.
_END = 100.0
_AREA = 1.0 - 0.5 / _END**2


@dataclass(frozen=True)
class Adhesion(Bond):
    """Adhesion with viscosity, beside contact and friction.

    Parameters are numbers or fields (`xper_fx/nscd/laws/fields.py`).

    Args:
        normal_stiffness: C_N (Pa/m).
        adhesion_energy: w (J/m^2), what it costs to part the lips slowly, in any direction.
        viscosity: b (J s/m^2); 0 for adhesion that does not depend on the speed.
        tangential_stiffness: C_T (Pa/m); C_N if not given.
        friction: Coulomb's mu of the lips.
        initial_damage: beta0 in (0, 1], the square of the intensity at the start.
        damage: as of `CohesiveZone`.
        friction_grows: whether mu grows from 0 to `friction` as adhesion is lost, mu (1 - a^2 /
            beta0); else lips rub from the start.

    Raises:
        ValueError: a number out of range.
    """

    normal_stiffness: Any
    adhesion_energy: Any
    viscosity: Any = 0.0
    tangential_stiffness: Any = None
    friction: Any = 0.0
    initial_damage: Any = 1.0
    damage: str = "auto"
    friction_grows: bool = False

    def __post_init__(self) -> None:
        self._check_options()
        take_parameters(
            self,
            positive=("normal_stiffness", "adhesion_energy"),
            optional=("tangential_stiffness",),
            non_negative=("viscosity", "friction"),
            shares=("initial_damage",),
        )

    @property
    def elastic_opening(self) -> Any:
        """d0 (m), the normal opening at which damage starts."""
        return self.shape()[0]

    @property
    def critical_opening(self) -> Any:
        """dc (m), the normal opening at which the bond is broken."""
        return self.shape()[1]

    @property
    def strength(self) -> Any:
        """Largest normal traction (Pa) of a slow opening."""
        return self.normal_stiffness * self.elastic_opening

    @property
    def fracture_energy(self) -> Any:
        """w (J/m^2)."""
        return self.adhesion_energy

    @property
    def softening_slope(self) -> Any:
        """Steepest descent of the traction in any direction (Pa/m)."""
        return 3.0 * np.maximum(*self.stiffnesses())

    def weakening(self) -> Weakening:
        """See `Bond`."""
        return _in_any_direction(self._rubs)

    def shape(self) -> tuple:
        """d0, dc (m), along the normal."""
        d0 = np.sqrt(self.adhesion_energy / (_AREA * self.normal_stiffness))
        return d0, _END * d0


@njit(**LEAN_INNER)
def _fall(x, p):
    return (p[0] / x) ** 4


@njit(**LEAN_INNER)
def _area(a, b, g, p):
    return 0.5 * (b - a) * (b + a) * (p[0] * p[0] / (a * b)) ** 2


@cache
def _in_any_direction(friction: bool) -> Weakening:
    """The curve whose energy is the same in all directions, and damage its only history."""
    first = shape_column(friction)

    @njit(**LEAN_INNER)
    def shape(i, jump, parameters):
        c_n, c_t = parameters[i, C_N], parameters[i, C_T]
        d0 = parameters[i, first] * np.sqrt(c_n / stiffness_along(jump, c_n, c_t))
        return d0, _END * d0

    @njit(**LEAN_INNER)
    def limit(i, parameters, state):
        c_n, c_t = parameters[i, C_N], parameters[i, C_T]
        share = state[i, DAMAGE] / parameters[i, BETA0]
        return parameters[i, first] * np.sqrt(c_n / (max(c_n, c_t) * np.sqrt(share)))

    @njit(**LEAN_INNER)
    def reach(limit, share, p):
        return p[0] / np.sqrt(np.sqrt(share))

    def spent(parameters: np.ndarray, state: np.ndarray) -> np.ndarray:
        left = state[:, DAMAGE] / parameters[:, BETA0]
        return np.where(left > 0.0, (1.0 - np.sqrt(left)) / _AREA, 1.0)

    curve = CurveFunctions(_fall, _area)
    own = {"shape": shape, "limit": limit, "weakens": falls_below(curve), "reach": reach}
    return one_curve(curve, 2, friction)._replace(**own, spent=spent)
