# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Frictional cohesive zone (Perales et al. 2010, eqs 33-37; the curve of LMGC90's MP3_CZM).

The stress R between the lips is Rhat - Rcoh with Rcoh = beta C U pulling them together,
C = diag(C_N, C_T, C_T), and Rhat obeying Signorini-Coulomb at position level. Damage beta falls
from beta0 to 0 with the largest opening reached, x = sqrt(<U_N>+^2 + |U_T|^2), along a curve of
`curves/`, beta = beta0 g(x). That of the paper is

    g(x) = 1                                           x <= d0
         = (d0 / x) (1 - ((x - d0) / (dc - d0))^2)     d0 < x < dc
         = 0                                           x >= dc
    d0 = (Rmax / 2)(1 / C_N + 1 / C_T),   dc = (3/2)(w / Rmax + d0 / 6),

and any other one has the stiffness k = Rmax / d0, the strength Rmax and the area w.

**Over a step** the cohesive stress is a secant one, with a single mean damage,

    Rcoh = beta_m C U_theta,   U_theta = theta U1 + (1 - theta) U0,
    beta_m (x1^2 - x0^2) / 2 = integral of beta x dx from x0 to x1 along the loading path.

With e = U.C.U / 2 its work over the step is beta_m (e1 - e0) + (theta - 1/2) beta_m dU.C.dU, so
what it dissipates, (beta_m - beta1) e1 + (beta0 - beta_m) e0 + (theta - 1/2) beta_m dU.C.dU, is
never negative, because beta1 <= beta_m <= beta0 for a mean of a falling function; and when
C_N = C_T a bond that opens spends exactly the area under its curve, whatever the step (a damage
frozen at its old value spends more, the trapezoidal rule on the end values less, even below zero).

**The point's problem.** With k = h^2 theta^2 A C and P = h A C [(1 - theta) U0 + theta U_h] the
total impulse is r = rhat - beta_m k (P / k + dU). For a given beta_m, W~ = (I + W beta_m k)^-1 W
and b~ = u - W~ [r + beta_m k (P / k + u)] turn it into plain contact, dU = b~ + W~ rhat.

beta_m is the fixed point of a map that only falls: it starts from the damage at the start of the
step; each time the interactions are solved with it, `evolve` lowers it to the mean that the new
opening asks for. So of the states that a step may admit (beyond the softening number of
`simulation/cohesive_scales.py` a bond may or may not snap within the step) the least damaged
one is found, and the iteration cannot cycle.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from xper_fx.nscd.laws.bond import Bond
from xper_fx.nscd.laws.curves.curve import Curve, check_curve
from xper_fx.nscd.laws.curves.parabolic import Parabolic
from xper_fx.nscd.laws.parameters import refuse_where, take_parameters
from xper_fx.nscd.laws.weakening import Weakening, one_curve


@dataclass(frozen=True)
class CohesiveZone(Bond):
    """Bond that weakens, breaks, and leaves unilateral contact with friction.

    Parameters are numbers or fields (`xper_fx/nscd/laws/fields.py`).

    Args:
        normal_stiffness: C_N (Pa/m); None with a curve that has a stiffness of its own.
        fracture_energy: w (J/m^2), the area under the normal curve when C_N = C_T.
        strength: Rmax (Pa), the largest normal stress.
        tangential_stiffness: C_T (Pa/m); C_N if not given.
        friction: Coulomb's mu of the lips; 0 compiles no friction.
        initial_damage: beta0 in (0, 1], 1 for a sound bond.
        damage: "mean" (module docstring); "lagged", damage frozen during the step: cheaper,
            and spends too much energy when the step is not small beside the softening time; "end"
            (`damage_at_end.py`), for the monolithic solver alone; or "auto": "end" in static runs
            of that solver, else "mean".
        curve: how traction falls with the opening, of `xper_fx/nscd/laws/curves`.
        friction_grows: whether mu grows from 0 to `friction` as the bond weakens, mu (1 - beta /
            beta0), as what is bonded does not rub; else lips rub from the start.
        viscosity: b (J s/m^2), with which damage lags behind its curve, as the adhesion of Raous,
            Cangemi and Cocou does (`viscous_damage.py`); 0 compiles none.

    Raises:
        ValueError: a number out of range, or w <= Rmax d0 / 2: the bond would have to break
            before its peak.
    """

    normal_stiffness: Any
    fracture_energy: Any
    strength: Any
    tangential_stiffness: Any = None
    friction: Any = 0.0
    initial_damage: Any = 1.0
    damage: str = "auto"
    friction_grows: bool = False
    curve: Curve = field(default_factory=Parabolic)
    viscosity: Any = 0.0

    def __post_init__(self) -> None:
        self._check_options()
        self._check_curve()
        known = take_parameters(
            self,
            positive=("fracture_energy", "strength"),
            optional=("normal_stiffness", "tangential_stiffness"),
            non_negative=("friction", "viscosity"),
            shares=("initial_damage",),
        )
        if known:
            self._check_shape()

    def _check_curve(self) -> None:
        curve = self.curve
        check_curve(curve)
        free = curve.own_stiffness(1.0, 1.0) is None
        if free and self.normal_stiffness is None:
            raise ValueError(f"normal_stiffness is None (Pa/m), and {curve!r} leaves it free.")
        if not free and self.normal_stiffness is not None:
            raise ValueError(
                f"{curve!r} has a stiffness of its own, told by strength and fracture_energy: "
                f"give normal_stiffness=None, got {self.normal_stiffness!r}."
            )

    def _check_shape(self) -> None:
        w, strength, d0, dc = (
            self.fracture_energy,
            self.strength,
            self.elastic_opening,
            self.critical_opening,
        )
        least = 0.5 * strength * d0
        refuse_where(
            w <= least,
            lambda at: (
                f"fracture_energy {at(w):g} J/m^2 should exceed Rmax d0 / 2 = {at(least):g} J/m^2, "
                "the energy at the peak; raise it or the stiffness, or lower the strength "
                f"{at(strength):g} Pa."
            ),
        )
        shape = self.shape()
        ordered = np.isfinite(dc) & (dc > 0.0)
        if self.normal_stiffness is not None:
            ordered = ordered & (d0 > 0.0)
        refuse_where(
            ~ordered,
            lambda at: (
                f"The strength {at(strength):g} Pa, the stiffness {at(self.stiffnesses()[0]):g} "
                f"Pa/m and the fracture_energy {at(w):g} J/m^2 give openings d0 = {at(d0):g} m and "
                f"dc = {at(dc):g} m, beyond the range of floats; take other units."
            ),
        )
        for knee in (shape[number] for number in self.curve.knees):
            refuse_where(
                knee <= d0,
                lambda at, knee=knee: (
                    f"The curve {self.curve!r} bends at {at(knee):g} m, before the bond weakens, "
                    f"d0 = {at(d0):g} m: raise the fracture_energy {at(w):g} J/m^2 or the "
                    f"stiffness, or lower the strength {at(strength):g} Pa."
                ),
            )

    @property
    def elastic_opening(self) -> Any:
        """d0 (m), the opening at which damage starts."""
        return self.shape()[0]

    @property
    def critical_opening(self) -> Any:
        """dc (m), the opening at which the bond is broken."""
        return self.shape()[1]

    @property
    def softening_slope(self) -> Any:
        """Steepest descent of the traction curve (Pa/m)."""
        return self.curve.steepest(self.shape(), self._stiffness)

    @property
    def _stiffness(self) -> Any:
        """k (Pa/m) of the curve, Rmax / d0."""
        c_n, c_t = self.stiffnesses()
        return c_n if c_t is c_n else 2.0 / (1.0 / c_n + 1.0 / c_t)

    def weakening(self) -> Weakening:
        """See `Bond`."""
        count = len(self.curve.shape(1.0, 1.0, 1.0, *self.curve.constants))
        return one_curve(self.curve.functions, count, self._rubs)

    def stiffnesses(self) -> tuple:
        """C_N and C_T (Pa/m)."""
        c_n, c_t = self.normal_stiffness, self.tangential_stiffness
        if c_n is None:
            c_n = self.curve.own_stiffness(self.strength, self.fracture_energy)
        return c_n, c_n if c_t is None else c_t

    def shape(self) -> tuple:
        """d0, dc (m), and what else the curve has."""
        numbers = self._stiffness, self.strength, self.fracture_energy
        return self.curve.shape(*numbers, *self.curve.constants)
