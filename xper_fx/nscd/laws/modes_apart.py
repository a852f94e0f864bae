# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Bonds with strengths and energies of their own in opening (I) and in shear (II and III).

Along a jump of direction a, U = x (cos a, sin a), the bond has the stiffness
k(a) = C_N cos^2 a + C_T sin^2 a against x, and one curve of `curves/` with

    onset:   (T_N / s_N)^2 + (T_T / s_T)^2 = 1, which is at x = d0(a),
    energy:  G(a), a function of the share B = C_T sin^2 a / k of shear in the energy,
             Benzeggagh and Kenane 1996:  G = G_I + (G_II - G_I) B^m
             power law (Whitcomb 1984):   ((1 - B) G / G_I)^m + (B G / G_II)^m = 1,

so that its shape is curve(k, k d0, G). Damage is one number for both modes, R = beta C U, and it
falls to what the curve of the present direction asks for, never rises: beta is the history,
whatever path led to it (Turon et al. 2006 take a threshold for the same purpose). Whatever the path
of mixity, what a step dissipates is then not negative, and along a straight path it sums up to
G(a).

Modes II and III are not told apart: a point does not know which way a crack runs. As in the
elements of Camanho and Davila 2002, the length of the tangential jump counts.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_INNER
from xper_fx.nscd.laws.bond import Bond
from xper_fx.nscd.laws.curves.curve import Curve
from xper_fx.nscd.laws.damage_curve import BETA0, C_N, C_T, DAMAGE, damage_functions, shape_column
from xper_fx.nscd.laws.parameters import refuse_where
from xper_fx.nscd.laws.weakening import Weakening, falls_below, take_columns

# Columns after those of a bond.
_D_N, _D_T, _G_I, _G_II, _EXPONENT, _CONSTANTS = range(6)
# Shares of shear at which the numbers of a law are examined.
_SHARES = np.linspace(0.0, 1.0, 41)


def _benzeggagh_kenane(share, first, second, exponent):
    return first + (second - first) * share**exponent


def _power_law(share, first, second, exponent):
    parts = ((1.0 - share) / first) ** exponent + (share / second) ** exponent
    return parts ** (-1.0 / exponent)


_CRITERIA = {"benzeggagh-kenane": _benzeggagh_kenane, "power": _power_law}


class ModesApart(Bond):
    """A bond whose strength and fracture energy depend on how it is loaded.

    A class of it is one of `Bond`, with `strengths`, `fracture_energies`, `exponent`, `criterion`
    and `curve`, and has `stiffnesses`.
    """

    strengths: tuple[Any, Any]
    fracture_energies: tuple[Any, Any]
    exponent: Any
    criterion: str
    curve: Curve

    def _check_criterion(self) -> None:
        if self.criterion not in _CRITERIA:
            wanted = " or ".join(f'"{name}"' for name in _CRITERIA)
            raise ValueError(f"criterion should be {wanted}, got {self.criterion!r}.")

    def _check_shapes(self) -> None:
        for share in _SHARES:
            stiffness, strength, energy = self._along(share)
            least = 0.5 * strength**2 / stiffness
            refuse_where(
                energy <= least,
                lambda at, b=share, g=energy, e=least: (
                    f"With {100.0 * b:.0f} % of shear the fracture energy, {at(g):g} J/m^2, should "
                    f"exceed {at(e):g} J/m^2, the energy at the peak: raise it or the stiffness, "
                    "or lower the strengths."
                ),
            )
            shape = self.curve.shape(stiffness, strength, energy, *self.curve.constants)
            for knee in self.curve.knees:
                refuse_where(
                    shape[knee] <= shape[0],
                    lambda at, b=share: (
                        f"With {100.0 * b:.0f} % of shear the curve {self.curve!r} bends before "
                        "the bond weakens: raise the fracture energies or the stiffness."
                    ),
                )

    def _along(self, share: float) -> tuple[Any, Any, Any]:
        """k, strength against x and energy of a share of shear in the energy."""
        c_n, c_t = self.stiffnesses()
        # sin^2 a from the share C_T sin^2 a / k
        shear = share / (share + (1.0 - share) * c_t / c_n)
        stiffness = c_n * (1.0 - shear) + c_t * shear
        onset = (c_n / self.strengths[0]) ** 2 * (1.0 - shear)
        onset = (onset + (c_t / self.strengths[1]) ** 2 * shear) ** -0.5
        energy = _CRITERIA[self.criterion](share, *self.fracture_energies, self.exponent)
        return stiffness, stiffness * onset, energy

    @property
    def strength(self) -> Any:
        """In pure opening (Pa)."""
        return self.strengths[0]

    @property
    def fracture_energy(self) -> Any:
        """In pure opening (J/m^2)."""
        return self.fracture_energies[0]

    @property
    def softening_slope(self) -> Any:
        """Steepest descent of the traction in any mixture of modes (Pa/m)."""
        most = 0.0
        for share in _SHARES:
            stiffness, strength, energy = self._along(share)
            shape = self.curve.shape(stiffness, strength, energy, *self.curve.constants)
            most = np.maximum(most, self.curve.steepest(shape, stiffness))
        return most

    def weakening(self) -> Weakening:
        """See `Bond`."""
        curve = type(self.curve)
        return modes_apart(curve, len(self.curve.constants), self.criterion, self._rubs)

    def shape(self) -> tuple:
        """Openings of onset (m), energies (J/m^2), exponent, constants of the curve."""
        (c_n, c_t), (s_n, s_t) = self.stiffnesses(), self.strengths
        energies = self.fracture_energies
        return (s_n / c_n, s_t / c_t, *energies, self.exponent, *self.curve.constants)


@cache
def modes_apart(
    curve: type[Curve], num_constants: int, criterion: str, friction: bool, rigid: bool = False
) -> Weakening:
    """A curve whose shape hangs on the direction of the jump.

    Args:
        num_constants: that it has.
        criterion: of the energies of mixtures.
        friction: whether lips rub.
        rigid: whether the bond bears its strength from the start (`RigidBond.starts_rigid`).
    """
    first, functions = shape_column(friction), curve.functions
    num_columns = _CONSTANTS + num_constants
    constants = take_columns(first + _CONSTANTS, num_constants)
    make_shape = njit(**LEAN_INNER)(curve.shape)
    energy_of = njit(**LEAN_INNER)(_CRITERIA[criterion])
    damage_of = damage_functions(functions)
    dissipated, opening_with = damage_of.dissipated, damage_of.opening_with

    @njit(**LEAN_INNER)
    def along(i, shear, parameters):
        """Shape of the curve along a jump with sin^2 a = shear."""
        c_n, c_t = parameters[i, C_N], parameters[i, C_T]
        d_n, d_t = parameters[i, first + _D_N], parameters[i, first + _D_T]
        stiffness = c_n * (1.0 - shear) + c_t * shear
        onset = d_n * d_t / np.sqrt(d_t * d_t * (1.0 - shear) + d_n * d_n * shear)
        energy = energy_of(
            c_t * shear / stiffness,
            parameters[i, first + _G_I],
            parameters[i, first + _G_II],
            parameters[i, first + _EXPONENT],
        )
        if rigid:
            energy -= 0.5 * stiffness * onset * onset
        return make_shape(stiffness, stiffness * onset, energy, *constants(i, parameters))

    @njit(**LEAN_INNER)
    def shape(i, jump, parameters):
        normal = max(jump[0], 0.0) ** 2
        tangential = 0.0
        for part in jump[1:]:
            tangential += part * part
        both = normal + tangential
        return along(i, tangential / both if both > 0.0 else 0.0, parameters)

    @njit(**LEAN_INNER)
    def limit(i, parameters, state):
        if state[i, DAMAGE] < parameters[i, BETA0]:
            return 0.0  # another direction may have its end anywhere
        return min(parameters[i, first + _D_N], parameters[i, first + _D_T])

    @njit(**LEAN_INNER)
    def reach(limit, share, p):
        return opening_with(share, p)

    @njit
    def spent_loop(parameters, state, share):
        for i in range(len(share)):
            if state[i, DAMAGE] > 0.0:
                p, beta0 = along(i, 0.0, parameters), parameters[i, BETA0]
                x = opening_with(state[i, DAMAGE] / beta0, p)
                share[i] = dissipated(x, p, beta0) / dissipated(p[1], p, beta0)

    def spent(parameters: np.ndarray, state: np.ndarray) -> np.ndarray:
        share = np.ones(len(state))
        spent_loop(parameters, state, share)
        return share

    def lengths(parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        columns = parameters[:, first : first + num_columns].T
        stiffness, energy = parameters[:, C_N], columns[_G_I]
        strength = stiffness * columns[_D_N]
        return curve.shape(stiffness, strength, energy, *columns[_CONSTANTS:])[:2]

    effects = (("mixed modes", num_columns),)
    weakens = falls_below(functions)
    return Weakening(effects, functions, shape, limit, weakens, reach, spent, lengths)
