# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Initially rigid bond with strengths and energies of its own in opening and in shear.

While the bond is sound it has no jump, and its traction is any with

    (<R_N>+ / s_N)^2 + |R_T|^2 / s_T^2 <= 1      (R_N > 0 pulls),
    |R_T| <= s_T + mu |R_N|                       under pressure.

What no such traction holds opens and weakens as `modes_apart.py` says, over a step as
`rigid_cohesive_zone.py` does: a bond that opens in a constant direction spends G of its share of
shear, whatever the step, and no mean traction leaves the ellipse.

**Direction.** Along the jump x (cos a, sin a) the tractions start at the point of the ellipse that
has the jump as its normal,

    (R_N, R_T) = (s_N^2 cos a, s_T^2 sin a) / s(a),    s(a)^2 = s_N^2 cos^2 a + s_T^2 sin^2 a,

as in the law of Camacho and Ortiz 1996, which is this one with the linear curve and equal energies:
C_N : C_T = s_N^2 : s_T^2. Of all admissible tractions those dissipate most. So what some admissible
tractions can hold is held (the lower bound theorem of limit analysis); with another ratio vertices
would open at up to a tenth less than what they bear. (Friction is not associated; what it helps to
hold may open earlier.) Then the traction falls along the curve of strength s(a) and energy G(B),
with B = (R_T / s_T)^2 at the start, the share of shear.

**Viscosity** drags lips by eta g (U1 - U0) / h, as in `rigid_cohesive_zone.py`, with g the share of
its strength that the curve of pure opening has left at the present damage.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from xper_fx.nscd.laws.curves.curve import Curve
from xper_fx.nscd.laws.curves.linear import Linear
from xper_fx.nscd.laws.modes_apart import ModesApart, modes_apart
from xper_fx.nscd.laws.parameters import take_parameters
from xper_fx.nscd.laws.rigid_bond import RigidBond, stiffness_of
from xper_fx.nscd.laws.weakening import Weakening


@dataclass(frozen=True)
class RigidMixedMode(RigidBond, ModesApart):
    """Bond without compliance whose strength and fracture energy depend on how it is loaded.

    Where it can be used, and what it costs, is as of `RigidCohesiveZone`. Parameters are numbers or
    fields (`xper_fx/nscd/laws/fields.py`).

    Args:
        strengths: s_N and s_T (Pa), of pure opening and pure shear.
        fracture_energies: w_I and w_II (J/m^2), of pure opening and pure shear.
        exponent: m of the criterion.
        criterion: of the energies of mixtures, "benzeggagh-kenane" or "power" (`modes_apart.py`).
        friction, friction_grows, restitution, curve, viscosity, damage: as of `RigidCohesiveZone`.

    Raises:
        TypeError: strengths or energies that are no pairs, something that is no curve.
        ValueError: a number out of range, a curve that starts with a stiffness of its own.
    """

    strengths: tuple[Any, Any]
    fracture_energies: tuple[Any, Any]
    exponent: Any
    criterion: str = "benzeggagh-kenane"
    friction: Any = 0.0
    friction_grows: bool = False
    restitution: Any = 0.0
    curve: Curve = field(default_factory=Linear)
    viscosity: Any = 0.0
    damage: str = "auto"
    modes_apart: ClassVar[bool] = True

    def __post_init__(self) -> None:
        self._check_options()
        self._check_criterion()
        self._check_curve()
        known = take_parameters(
            self,
            positive=("exponent",),
            positive_pairs=("strengths", "fracture_energies"),
            non_negative=("friction", "restitution", "viscosity"),
        )
        if known:
            self._check_contact()
            self._check_shapes()

    @property
    def least_strength(self) -> Any:
        """See `RigidBond`."""
        return np.minimum(*self.strengths)

    def stiffnesses(self) -> tuple:
        """C_N and C_T (Pa/m), next to rigid."""
        first, second = self.fracture_energies
        energy = np.sqrt(first) * np.sqrt(second)
        return tuple(stiffness_of(strength, energy) for strength in self.strengths)

    def weakening(self) -> Weakening:
        """See `Bond`."""
        numbers = len(self.curve.constants), self.criterion, self._rubs
        return modes_apart(type(self.curve), *numbers, self.starts_rigid)
