# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Initially rigid cohesive zone: lips that are one until no admissible traction holds them.

The law is set-valued at the start (Doyen, Ern and Piperno 2013): while the bond is sound,

    U = 0   and   R in the set of tractions that it bears,

which is |R| <= s, s the strength, and under pressure |R_T| <= s + mu |R_N|. What no such traction
holds together opens and follows a curve of `curves/` that starts at the strength: damage, mean
traction of a step, unloading along the secant, contact and friction are those of
`cohesive_zone.py`, and a bond spends exactly its fracture energy whatever the step.

**Over a step** the bond pulls with its mean damage at the mean jump, whatever theta is,

    Rcoh = beta_m C (U0 + U1) / 2,   of work beta_m (e1 - e0),   e = U.C.U / 2,

so that no mean traction exceeds s: as a bond opens from U0 = 0 it is the mean of its curve from 0
to U1, where weights theta and 1 - theta would make it 2 theta times as large.

**The kernels** work with y = (U0 + U1) / (h theta), which a sound bond leaves exactly zero, where
velocities are differences of nearly equal numbers. As U1 = U0 + h theta u1 + h (1 - theta) u0, with
z = 2 U0 / (h theta), b = u - W r and k = h^2 theta A C / 2,

    y = b + z + (1 - theta) / theta u0 + W r,    r = rhat - beta_m k y,    U1 = h theta (y - z / 2).

beta_m hangs on y, and is found at each visit: s = 1 / (1 + k w beta_m) in (0, 1], w the mean
compliance, is a root of 1 - s (1 + k w beta_m(y(s))), which is nearly straight in s:
from the damage at the start upwards the least damaged state is met first. Where the step is so long
that the bond has several (a softening number above 1), that one is taken.

**Viscosity.** A bond that breaks at the speed v = (x1 - x0) / h bears more than its curve,

    |Rcoh| = T (1 + eta v / s),

T its mean traction in the step: the overstress falls with the curve, so that what it works is
finite, and a bond starts to open at s, whatever the rate. As a vector it is a drag,
eta g (U1 - U0) / h, on lips that part, close or slip, with g = T(x_m) / s the share of the strength
that the curve has left at x_m, the opening of which beta_m is the damage. (With a linear curve
s g is T to the last digit.) It loses eta g |U1 - U0|^2 / h >= 0, booked apart from w. In impulses,
with c = h theta A eta g,

    r = rhat - beta_m k y - c (y - z),

where c falls with the damage as beta_m does: the least damaged state is found as without.

**Lips that close again** touch at position level while something bonds them, as in
`cohesive_zone.py`, and at velocity level once nothing does, with Newton's restitution, as in
`signorini_coulomb.py`: a piece that strikes another rebounds by e, whatever the step.

**Static runs** take the traction of the end of a step: `rigid_at_end.py`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from xper_fx.nscd.laws.curves.curve import Curve
from xper_fx.nscd.laws.curves.linear import Linear
from xper_fx.nscd.laws.parameters import take_parameters
from xper_fx.nscd.laws.rigid_bond import RigidBond, stiffness_of
from xper_fx.nscd.laws.weakening import Weakening, one_curve


@dataclass(frozen=True)
class RigidCohesiveZone(RigidBond):
    """Bond without compliance, that weakens, breaks, and leaves contact with friction.

    With nodal points and each cell a body, beside an explicit bulk or in one system with the bulk,
    facets that hold cost no more than the elements of one mesh (`nscd/splitting`); other runs carry
    a point on each from the start.

    Parameters are numbers or fields (`xper_fx/nscd/laws/fields.py`).

    Args:
        strength: s (Pa), the largest traction in whatever direction.
        fracture_energy: w (J/m^2), the area under the curve.
        friction: Coulomb's mu of the lips; 0 compiles no friction.
        friction_grows: whether mu grows from 0 to `friction` as the bond weakens.
        restitution: Newton's e in [0, 1] of lips that nothing bonds any more.
        curve: how traction falls with the opening, of `xper_fx/nscd/laws/curves`; one that has no
            stiffness of its own.
        viscosity: eta (Pa s/m), the overstress of a bond at its strength over the speed at which
            its lips part; 0 compiles none. Not the b of elastic bonds, by which damage lags.
        damage: "mean" of the step (module docstring); "end" of it (`rigid_at_end.py`), for static
            runs alone; or "auto": "end" in static runs, else "mean".

    Raises:
        ValueError: a number out of range, a curve that starts with a stiffness of its own.
    """

    strength: Any
    fracture_energy: Any
    friction: Any = 0.0
    friction_grows: bool = False
    restitution: Any = 0.0
    curve: Curve = field(default_factory=Linear)
    viscosity: Any = 0.0
    damage: str = "auto"

    def __post_init__(self) -> None:
        self._check_options()
        self._check_curve()
        known = take_parameters(
            self,
            positive=("strength", "fracture_energy"),
            non_negative=("friction", "restitution", "viscosity"),
        )
        if known:
            self._check_contact()
            self.stiffnesses()

    @property
    def least_strength(self) -> Any:
        """See `RigidBond`."""
        return self.strength

    @property
    def critical_opening(self) -> Any:
        """dc (m), the opening at which the bond is broken."""
        return self.shape()[1]

    @property
    def softening_slope(self) -> Any:
        """Steepest descent of the traction curve (Pa/m)."""
        return self.curve.steepest(self.shape(), self.stiffnesses()[0])

    def weakening(self) -> Weakening:
        """See `Bond`."""
        count = len(self.curve.shape(1.0, 1.0, 1.0, *self.curve.constants))
        return one_curve(self.curve.functions, count, self._rubs)

    def stiffnesses(self) -> tuple:
        """C_N and C_T (Pa/m), next to rigid."""
        stiffness = stiffness_of(self.strength, self.fracture_energy)
        return stiffness, stiffness

    def shape(self) -> tuple:
        """d0, dc (m), and what else the curve has."""
        stiffness, strength, energy = self.stiffnesses()[0], self.strength, self.fracture_energy
        if self.starts_rigid:
            energy = energy - 0.5 * strength**2 / stiffness
        numbers = stiffness, strength, energy
        return self.curve.shape(*numbers, *self.curve.constants)
