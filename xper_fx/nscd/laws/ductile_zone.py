# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Cohesive zone of a ductile metal, from the growth of its voids under a triaxiality.

A layer of thickness t0 of perfectly plastic metal with the porosity f is drawn out under
axisymmetric stresses of a constant triaxiality H = sigma_m / sigma_eq, as cells are to find the
numbers of a cohesive zone (Siegmund and Brocks 1999). It yields by Gurson 1977 and Tvergaard 1981,

    s^2 + 2 q1 f* cosh(3 q2 H s / 2) = 1 + (q1 f*)^2,    s = sigma_eq / sigma_0,
    f* = f for f <= f_c,   f_c + (1 / q1 - f_c) (f - f_c) / (f_F - f_c) beyond,

f* being that of Tvergaard and Needleman 1984, and flows along the normal of that surface,

    tr D / D_eq = r = (3/2) q1 q2 f* sinh(3 q2 H s / 2) / s,    D_N = D_eq + tr D / 3,
    df/dt = (1 - f) tr D.

Its traction (H + 2/3) s sigma_0 falls from that of the porosity f_0, the strength, to zero at f_F.
Its opening is t0 (e^eps - 1), eps the integral of D_N, and the area below is the fracture energy. A
larger triaxiality makes a small porosity grow sooner: the strength is larger, the energy smaller.
The bond takes them along a curve of `curves/`, as the cohesive zones of Siegmund and Brocks do.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from xper_fx.nscd.laws.cohesive_zone import CohesiveZone
from xper_fx.nscd.laws.curves.bilinear import Trapezoidal
from xper_fx.nscd.laws.curves.curve import Curve
from xper_fx.nscd.laws.parameters import refuse_where, take_parameters

# q1, q2 (Tvergaard 1981), f_c, f_F (Tvergaard and Needleman 1984).
_Q1, _Q2, _CRITICAL, _FINAL = 1.5, 1.0, 0.15, 0.25
# Triaxiality beyond all that metals see.
_LARGEST = 10.0
# Panels of Simpson's rule, over ln f up to f_c and over f beyond.
_PANELS = 24
# Error of s.
_SMALL = 1e-13


@dataclass(frozen=True)
class DuctileZone(CohesiveZone):
    """Bond of a ductile metal, whose strength and energy follow from a triaxiality.

    Parameters are numbers or fields (`xper_fx/nscd/laws/fields.py`).

    **Limitation.** The triaxiality is given, and stays: it is not read from the stresses beside the
    bond. What is found for it holds in all modes.

    Args:
        normal_stiffness: C_N (Pa/m).
        yield_stress: sigma_0 (Pa).
        porosity: f_0 in (0, 0.15).
        thickness: t0 (m), of the layer in which voids grow: about their distance.
        triaxiality: H > 0: 1/3 in uniaxial tension, 2 to 3 ahead of a crack.
        tangential_stiffness, friction, initial_damage, damage, friction_grows, viscosity: as of
            `CohesiveZone`.
        curve: of `xper_fx/nscd/laws/curves`, one whose stiffness is free.

    Attributes:
        strength: Rmax (Pa).
        fracture_energy: w (J/m^2).

    Raises:
        ValueError: a number out of range, or an energy that would be spent before the peak.
    """

    fracture_energy: Any = field(init=False, default=None)
    strength: Any = field(init=False, default=None)
    curve: Curve = field(default_factory=Trapezoidal)
    yield_stress: Any = field(kw_only=True)
    porosity: Any = field(kw_only=True)
    thickness: Any = field(kw_only=True)
    triaxiality: Any = field(kw_only=True)

    def __post_init__(self) -> None:
        self._check_options()
        self._check_curve()
        if self.curve.own_stiffness(1.0, 1.0) is not None:
            raise ValueError(f"{self.curve!r} has a stiffness of its own: take another curve.")
        known = take_parameters(
            self,
            positive=("normal_stiffness", "yield_stress", "thickness", "triaxiality"),
            optional=("tangential_stiffness",),
            non_negative=("friction", "viscosity"),
            shares=("initial_damage", "porosity"),
        )
        if known:
            refuse_where(
                np.asarray(self.porosity >= _CRITICAL),
                lambda at: (
                    f"porosity should be below {_CRITICAL}, at which voids join, got "
                    f"{at(self.porosity):g}."
                ),
            )
            refuse_where(
                np.asarray(self.triaxiality > _LARGEST),
                lambda at: (
                    f"triaxiality should be at most {_LARGEST:g}, got {at(self.triaxiality):g}."
                ),
            )
            traction, work = drawn_out(self.porosity, self.triaxiality)
            object.__setattr__(self, "strength", self.yield_stress * traction)
            energy = self.yield_stress * self.thickness * work
            object.__setattr__(self, "fracture_energy", energy)
            self._check_shape()


def drawn_out(porosity: Any, triaxiality: Any) -> tuple[Any, Any]:
    """Largest traction over the yield stress, and work of the layer over that and its thickness."""
    h = 1.5 * _Q2 * triaxiality
    s = np.ones_like(h * porosity)
    eps = work = strength = 0.0
    # over ln f until voids join, over f beyond
    parts = ((np.log(porosity), np.log(_CRITICAL), np.exp), (_CRITICAL, _FINAL, np.positive))
    for low, high, porosity_at in parts:
        step = (high - low) / _PANELS
        for panel in range(_PANELS):
            rate, traction = [], []
            for at in (panel, panel + 0.5, panel + 1.0):
                f = porosity_at(low + at * step)
                s, stretch = _flow(f, h, s)
                rate.append(stretch * (f if porosity_at is np.exp else 1.0))
                traction.append((triaxiality + 2.0 / 3.0) * s)
            strength = np.maximum(strength, traction[0])
            middle = eps + step / 24.0 * (5.0 * rate[0] + 8.0 * rate[1] - rate[2])
            end = eps + step / 6.0 * (rate[0] + 4.0 * rate[1] + rate[2])
            work = work + step / 6.0 * (
                traction[0] * rate[0] * np.exp(eps)
                + 4.0 * traction[1] * rate[1] * np.exp(middle)
                + traction[2] * rate[2] * np.exp(end)
            )
            eps = end
    return strength, work


def _flow(f: Any, h: Any, s: Any) -> tuple[Any, Any]:
    """s of a porosity, from that of a smaller one, and d eps / df."""
    steeper = (1.0 / _Q1 - _CRITICAL) / (_FINAL - _CRITICAL) - 1.0
    x = _Q1 * (f + steeper * np.maximum(f - _CRITICAL, 0.0))
    change = np.inf
    while np.max(np.abs(change)) > _SMALL:  # a convex function, from above its root
        slope = 2.0 * s + 2.0 * x * h * np.sinh(h * s)
        value = s * s + 4.0 * x * np.sinh(0.5 * h * s) ** 2 - (1.0 - x) ** 2
        change = value / np.maximum(slope, _SMALL)
        s = np.maximum(s - change, 0.0)
    small = np.maximum(h * s, _SMALL)
    r = 1.5 * _Q2 * x * h * np.sinh(small) / small
    return s, (1.0 + r / 3.0) / ((1.0 - f) * r)
