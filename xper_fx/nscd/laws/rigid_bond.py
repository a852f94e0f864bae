# SPDX-License-Identifier: LGPL-3.0-or-later
"""What laws of initially rigid bonds share (`rigid_cohesive_zone.py` derives them).

A bond of strength s and fracture energy w has a stiffness after all, of an opening of 1e-9 w / s
at the strength: numbers of `curves/curve.py` then serve as they are. No bond is ever seen with it,
as one that would open by less is held.

The mean traction of a step that opens a sound bond to x takes the bond for rigid all the same: over
its elastic part d0 it bears s, not what rises to s. That is the mean of the curve and s d0 / (2 x)
more, which leaves

    s x / (2 d0)  up to x = 2 d0,  and from there on the mean of a curve that begins at s.

Without it a bond that opens by little would bear less than a sound one, and where a vertex is at
its limit, with bonds that just open, no state would obey the law. So that w stays exact, the area
below the curve is s d0 / 2 less. (Up to that much, 5e-10 of w, is not spent where the first opening
ends below 2 d0.)
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from xper_fx.nscd.laws.bond import Bond
from xper_fx.nscd.laws.curves.curve import Curve, check_curve
from xper_fx.nscd.laws.damage_curve import shape_column
from xper_fx.nscd.laws.law import LawKernels
from xper_fx.nscd.laws.parameters import refuse_where
from xper_fx.nscd.laws.signorini_coulomb import check_contact

# Opening of a bond at its strength, over w / s: nothing.
_ELASTIC = 1e-9


class RigidBond(Bond):
    """A bond whose lips are one until no admissible traction holds them.

    A class of it is one of `Bond`, with `restitution` and `curve`, and has `least_strength` and
    `softening_slope`.
    """

    restitution: Any
    curve: Curve
    modes_apart: ClassVar[bool] = False
    initial_damage: ClassVar[float] = 1.0
    damage_options: ClassVar[tuple[str, ...]] = ("auto", "mean", "end")

    @property
    def starts_rigid(self) -> bool:
        """Whether a step that opens the bond takes it for rigid (module docstring)."""
        return self.damage != "end"

    @property
    def least_strength(self) -> Any:
        """The smallest traction that the bond may not bear (Pa)."""
        raise NotImplementedError

    def _check_curve(self) -> None:
        check_curve(self.curve)
        if self.curve.own_stiffness(1.0, 1.0) is not None:
            raise ValueError(
                f"{self.curve!r} rises with a stiffness of its own, and an initially rigid bond "
                "has none: take a curve that starts at the strength, as Linear(), or CohesiveZone."
            )

    def _check_contact(self) -> None:
        check_contact("velocity", self.restitution)

    def kernels(self, dim: int) -> LawKernels:
        """See `Law`."""
        weakening = self.weakening()
        if self.damage == "end":
            from xper_fx.nscd.laws.rigid_at_end import rigid_end_kernels

            return rigid_end_kernels(dim, self._friction, self._viscous, weakening)
        from xper_fx.nscd.laws.rigid_kernels import rigid_kernels

        shape = sum(count for _, count in weakening.effects)
        restitution = shape_column(self._rubs) + shape + self._viscous
        return rigid_kernels(
            dim, self._friction, self._viscous, self.modes_apart, weakening, restitution
        )

    def parameters(self) -> tuple:
        """Those of any bond, and Newton's e; or the steepest descent, with damage of the end."""
        last = self.softening_slope if self.damage == "end" else self.restitution
        return (*super().parameters(), last)

    def initial_state(self) -> tuple:
        """Those of any bond, and the normal impulse of the last step (N s) once it is broken.

        Statics need no impulse.
        """
        return super().initial_state() + (() if self.damage == "end" else (0.0,))


def stiffness_of(strength: Any, energy: Any) -> Any:
    """The stiffness, next to rigid, of a strength (Pa) and an energy (J/m^2), Pa/m."""
    stiffness = strength * strength / (_ELASTIC * energy)
    refuse_where(
        ~(np.isfinite(stiffness) & (stiffness > 0.0)),
        lambda at: (
            f"The strength {at(strength):g} Pa and the fracture_energy {at(energy):g} J/m^2 give "
            "openings beyond the range of floats; take other units."
        ),
    )
    return stiffness
