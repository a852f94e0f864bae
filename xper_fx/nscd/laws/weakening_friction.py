# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Friction and cohesion that are lost by slip: slip weakening, and Mohr-Coulomb's joints.

With the slip s that a closed point has made, and the share f(s) = <1 - s / D>+ that is left,

    r_N >= -f sigma_t h A,    |r_T| <= mu r_N + f c h A,    mu = mu_d + (mu_s - mu_d) f,

which is Coulomb's cone with a bound, cut off at the tension sigma_t <= c / mu_s. Without c and
sigma_t it is the friction of faults (Ida 1972, Andrews 1976), with them the joint of masonry
(Lourenco and Rots 1997, whose softening is exponential). The flow is not associated: lips slide
without opening.

**Over a step** f is its mean f_m over the slip of the step, so that what slip weakening costs,
(mu_s - mu_d) sigma D / 2 with a constant pressure and c D / 2 for cohesion, is spent at any step.
f_m is found as the damage of bonds is (`cohesive_zone.py`): it starts from f at the start of the
step, and each time the interactions are solved with it, `evolve` lowers it to what the slip found
asks for. Every force opposes the slip, so that each step dissipates.

A point whose tension gives way, that opens, loses all at once: f = 0. A joint is held like a bond,
at the position level; once it is broken, contact is at the level asked for. Contacts that are found
after the start are born broken.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from xper_fx.nscd.laws.law import Law, LawKernels
from xper_fx.nscd.laws.parameters import refuse_where, take_parameters
from xper_fx.nscd.laws.signorini_coulomb import check_contact
from xper_fx.nscd.laws.weakening_in_statics import WeakeningInStatics
from xper_fx.nscd.laws.weakening_kernels import weakening_kernels


@dataclass(frozen=True)
class SlipWeakening:
    """Contact whose friction falls with the slip that it has made.

    Parameters are numbers or fields (`xper_fx/nscd/laws/fields.py`).

    Args:
        static_friction: mu_s, before any slip.
        dynamic_friction: mu_d <= mu_s, left after the slip D.
        slip_distance: D (m).
        restitution: Newton's e in [0, 1] (velocity level only).
        contact: "velocity" or "position", as of `SignoriniCoulomb`.

    Raises:
        ValueError: a number out of range, friction that grows.
    """

    static_friction: Any
    dynamic_friction: Any
    slip_distance: Any
    restitution: Any = 0.0
    contact: str = "velocity"

    def __post_init__(self) -> None:
        names = ("dynamic_friction", "restitution")
        if take_parameters(self, positive=("static_friction", "slip_distance"), non_negative=names):
            check_contact(self.contact, self.restitution)
            _check_friction(self.static_friction, self.dynamic_friction)

    def kernels(self, dim: int) -> LawKernels:
        """See `Law`."""
        return weakening_kernels(dim, self.contact, False).law

    def in_statics(self) -> Law:
        """The law that a static run of the monolithic solver takes for this one."""
        return WeakeningInStatics(self, joint=False)

    def parameters(self) -> tuple:
        """mu_s, mu_d, D (m); at velocity level Newton's e."""
        numbers = self.static_friction, self.dynamic_friction, self.slip_distance
        return (*numbers, self.restitution) if self.contact == "velocity" else numbers

    def initial_state(self) -> tuple:
        """Slip (m); at velocity level the normal impulse of the last step (N s)."""
        return (0.0, 0.0) if self.contact == "velocity" else (0.0,)


@dataclass(frozen=True)
class MohrCoulomb:
    """Joint with friction, cohesion and a tension cut-off, which slip and opening destroy.

    Parameters are numbers or fields (`xper_fx/nscd/laws/fields.py`).

    Args:
        friction: mu of the sound joint.
        cohesion: c (Pa), shear that it carries without pressure.
        tension: sigma_t (Pa), at most c / mu.
        slip_distance: D (m), after which the cohesion is lost; c D / 2 is the energy of sliding.
        residual_friction: mu_d of the broken joint; that of the sound one if not given.
        restitution: Newton's e in [0, 1] of the broken joint (velocity level only).
        contact: of the broken joint, "velocity" or "position", as of `SignoriniCoulomb`.

    Raises:
        ValueError: a number out of range, friction that grows, a tension beyond the cone's apex.
    """

    friction: Any
    cohesion: Any
    tension: Any
    slip_distance: Any
    residual_friction: Any = None
    restitution: Any = 0.0
    contact: str = "velocity"

    def __post_init__(self) -> None:
        names = ["tension", "restitution"]
        if self.residual_friction is not None:
            names.append("residual_friction")
        positive = ("friction", "cohesion", "slip_distance")
        if not take_parameters(self, positive=positive, non_negative=names):
            return
        check_contact(self.contact, self.restitution)
        _check_friction(self.friction, self._residual)
        apex = self.cohesion / self.friction
        refuse_where(
            self.tension > apex,
            lambda at: (
                f"tension {at(self.tension):g} Pa should be at most cohesion / friction = "
                f"{at(apex):g} Pa, the apex of the cone."
            ),
        )

    @property
    def _residual(self) -> Any:
        return self.friction if self.residual_friction is None else self.residual_friction

    def kernels(self, dim: int) -> LawKernels:
        """See `Law`."""
        return weakening_kernels(dim, self.contact, True).law

    def in_statics(self) -> Law:
        """The law that a static run of the monolithic solver takes for this one."""
        return WeakeningInStatics(self, joint=True)

    def parameters(self) -> tuple:
        """mu_s, mu_d, D (m), c, sigma_t (Pa); at velocity level Newton's e."""
        numbers = self.friction, self._residual, self.slip_distance, self.cohesion, self.tension
        return (*numbers, self.restitution) if self.contact == "velocity" else numbers

    def initial_state(self) -> tuple:
        """Slip (m), damage; at velocity level the normal impulse of the last step (N s)."""
        return (0.0, 1.0, 0.0) if self.contact == "velocity" else (0.0, 1.0)

    def later_state(self) -> tuple:
        """History of a contact that is found after the start: a broken joint."""
        state = (self.slip_distance, 0.0)
        return (*state, 0.0) if self.contact == "velocity" else state


def _check_friction(static: Any, dynamic: Any) -> None:
    refuse_where(
        np.asarray(dynamic > static),
        lambda at: f"Friction should fall with slip, got {at(static):g} and then {at(dynamic):g}.",
    )
