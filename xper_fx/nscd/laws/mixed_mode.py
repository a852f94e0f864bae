# SPDX-License-Identifier: LGPL-3.0-or-later
r"""An elastic bond with strengths and energies of its own in opening and in shear.

Onset, energy and history are those of `modes_apart.py`. The criterion of Alfano and Crisfield 2001
with exponent 2 is the linear curve with the power law of exponent 1 where both modes have the same
ratio of final to elastic opening.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from xper_fx.nscd.laws.curves.curve import Curve, check_curve
from xper_fx.nscd.laws.curves.linear import Linear
from xper_fx.nscd.laws.modes_apart import ModesApart
from xper_fx.nscd.laws.parameters import take_parameters


@dataclass(frozen=True)
class MixedMode(ModesApart):
    """Bond whose strength and fracture energy depend on how it is loaded.

    Parameters are numbers or fields (`xper_fx/nscd/laws/fields.py`).

    Args:
        normal_stiffness: C_N (Pa/m).
        strengths: of pure opening and pure shear (Pa).
        fracture_energies: of pure opening and pure shear (J/m^2).
        exponent: m of the criterion.
        criterion: "benzeggagh-kenane" or "power" (`modes_apart.py`).
        tangential_stiffness: C_T (Pa/m); C_N if not given.
        friction: Coulomb's mu of the lips.
        initial_damage: beta0 in (0, 1].
        damage, friction_grows, viscosity: as of `CohesiveZone`.
        curve: of `xper_fx/nscd/laws/curves`, one whose stiffness is free.

    Raises:
        ValueError: a number out of range, or an energy that some mixture of modes would have spent
            before its peak.
    """

    normal_stiffness: Any
    strengths: tuple[Any, Any]
    fracture_energies: tuple[Any, Any]
    exponent: Any
    criterion: str = "benzeggagh-kenane"
    tangential_stiffness: Any = None
    friction: Any = 0.0
    initial_damage: Any = 1.0
    damage: str = "auto"
    friction_grows: bool = False
    curve: Curve = field(default_factory=Linear)
    viscosity: Any = 0.0

    def __post_init__(self) -> None:
        self._check_options()
        self._check_criterion()
        check_curve(self.curve)
        if self.curve.own_stiffness(1.0, 1.0) is not None:
            raise ValueError(
                f"{self.curve!r} has a stiffness of its own in each mode: take another curve, "
                "whose stiffness is free."
            )
        known = take_parameters(
            self,
            positive=("normal_stiffness", "exponent"),
            optional=("tangential_stiffness",),
            positive_pairs=("strengths", "fracture_energies"),
            non_negative=("friction", "viscosity"),
            shares=("initial_damage",),
        )
        if known:
            self._check_shapes()
