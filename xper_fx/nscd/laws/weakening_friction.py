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
from functools import cache
from typing import Any

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.kernel_options import LEAN_INNER, MERGED, MERGED_ENTRY
from xper_fx.nscd.laws.contact_solver import contact_solver
from xper_fx.nscd.laws.law import Columns, CoulombPoints, LawKernels
from xper_fx.nscd.laws.parameters import refuse_where, take_parameters
from xper_fx.nscd.laws.signorini_coulomb import check_contact

# Speed of opening, beside the one that the tension alone gives, at which a joint has opened.
_OPENED = 1e-4
# Speed of opening beside that of slip at which a point counts as closed while it slides.
_CLOSED = 1e-3
# Columns of energy.
_IMPACT, _FRICTION, _COHESION = range(3)


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
        return _kernels(dim, self.contact, False)

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
        return _kernels(dim, self.contact, True)

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


@cache
def _kernels(dim: int, contact: str, joint: bool) -> LawKernels:
    """The kernels of slip weakening, with `joint` those of Mohr-Coulomb."""
    algebra = for_dimension(dim)
    sym_row, sym_vector, subtract = algebra.sym_row, algebra.sym_vector, algebra.subtract
    local, impact = contact_solver(dim, True), contact == "velocity"
    if impact:
        from xper_fx.nscd.laws.impact import least_speed

    parameters_of, state_of, terms_of, details_of = (Columns() for _ in range(4))
    mu_s, mu_d, length = (parameters_of.take("friction") for _ in range(3))
    slipped = state_of.take("friction")
    v_min = terms_of.take("unilateral contact")
    mu = terms_of.take("friction")
    bound = terms_of.take("friction")
    shift = terms_of.take("friction", dim - 1)
    left = details_of.take("friction")  # f_m
    start = details_of.take("friction")  # slip at the start
    scaled = details_of.take("friction")  # h theta
    moved = details_of.take("friction", dim - 1)  # h (1 - theta) v0
    if joint:
        cohesion, tension = parameters_of.take("cohesion"), parameters_of.take("cohesion")
        damage = state_of.take("damage")
        pull = terms_of.take("cohesion")  # f sigma_t h A
        area_time = details_of.take("cohesion")  # h A
    if impact:
        e, pushed = parameters_of.take("impact"), state_of.take("impact")

    @njit(inline="always")
    def share(s, distance):
        return max(0.0, 1.0 - s / distance)

    @njit(inline="always")
    def mean_share(s0, s1, distance):
        """Mean of f over the slip from s0 to s1."""
        if s1 <= s0:
            return share(s0, distance)
        top = max(s0, min(s1, distance))
        return (top - s0) / (s1 - s0) * 0.5 * (share(s0, distance) + share(top, distance))

    @njit(inline="always")
    def set_share(i, f, parameters, terms, details):
        details[i, left] = f
        friction = parameters[i, mu_d] + (parameters[i, mu_s] - parameters[i, mu_d]) * f
        terms[i, mu] = friction
        terms[i, bound] = 0.0
        if joint:
            held = f * details[i, area_time]
            terms[i, pull] = held * parameters[i, tension]
            terms[i, bound] = held * parameters[i, cohesion] - friction * terms[i, pull]

    @njit(**LEAN_INNER)
    def prepare(i, jump, velocity, w, area, step, theta, parameters, state, terms, details):
        gap = jump[0] + step * (1.0 - theta) * velocity[0]
        terms[i, v_min] = -gap / (step * theta)
        f = share(state[i, slipped], parameters[i, length])
        held = False
        if joint:
            details[i, area_time] = step * area
            held = f > 0.0 and parameters[i, tension] > 0.0
        if impact and not held:
            last = w[i, 0] * state[i, pushed]
            terms[i, v_min] = least_speed(gap, velocity[0], step, last, parameters[i, e])
        lag = 0.0 if impact else (1.0 - theta) / theta
        for j in range(1, dim):
            terms[i, shift + j - 1] = lag * velocity[j]
            details[i, moved + j - 1] = step * (1.0 - theta) * velocity[j]
        details[i, start], details[i, scaled] = state[i, slipped], step * theta
        set_share(i, f, parameters, terms, details)

    @njit(inline="always")
    def pull_of(i, terms):
        if joint:
            return terms[i, pull]
        return 0.0

    @njit(**MERGED_ENTRY)
    def solve(i, u, r, w, parameters, terms, details):
        wi, held = sym_row(w, i), pull_of(i, terms)
        # the cone's tip is at r_N = -f sigma_t h A
        lifted = (r[0] + held, r[1]) if dim == 2 else (r[0] + held, r[1], r[2])
        b = subtract(u, sym_vector(wi, lifted))
        if dim == 2:
            lag = (terms[i, shift],)
        else:
            lag = (terms[i, shift], terms[i, shift + 1])
        new, _ = local(b, wi, terms[i, v_min], lag, terms[i, mu], terms[i, bound])
        return ((new[0] - held, new[1]) if dim == 2 else (new[0] - held, new[1], new[2])), False

    @njit(inline="always")
    def slip_of(i, u, details):
        """Slip of the step (m)."""
        total = 0.0
        for j in range(1, dim):
            total += (details[i, moved + j - 1] + details[i, scaled] * u[j]) ** 2
        return np.sqrt(total)

    @njit(**MERGED)
    def share_of_step(i, u, w, parameters, terms, details):
        """f_m that a velocity asks for."""
        s0, distance = details[i, start], parameters[i, length]
        opening, old = u[0] - terms[i, v_min], share(s0, distance)
        if old == 0.0:
            return 0.0
        if joint:
            most = w[i, 0] * parameters[i, tension] * details[i, area_time]
            if parameters[i, tension] > 0.0 and opening > _OPENED * most:
                return 0.0
        slip = slip_of(i, u, details)
        if opening * details[i, scaled] > _CLOSED * slip:
            return old
        return mean_share(s0, s0 + slip, distance)

    @njit(inline="always")
    def evolve(i, u, w, parameters, terms, details):
        old = share(details[i, start], parameters[i, length])
        if old == 0.0:
            return 0.0
        fall = details[i, left] - share_of_step(i, u, w, parameters, terms, details)
        if fall > 0.0:
            set_share(i, details[i, left] - fall, parameters, terms, details)
        return fall / old

    @njit(**LEAN_INNER)
    def commit(i, jump0, jump1, u, r, area, step, theta, parameters, state, terms, details, energy):
        held, work, size, slip = pull_of(i, terms), 0.0, 0.0, 0.0
        for j in range(1, dim):
            work -= r[j] * (jump1[j] - jump0[j]) / step
            size += r[j] * r[j]
            slip += (jump1[j] - jump0[j]) ** 2
        lifted = r[0] + held
        energy[i, _IMPACT] = -r[0] * (jump1[0] - jump0[0]) / step
        limit = terms[i, mu] * lifted + terms[i, bound]
        # of the shear that is carried at most, what does not come from the pressure is cohesion
        pressure = terms[i, mu] * max(r[0], 0.0)
        bonded = max(0.0, 1.0 - pressure / limit) if limit > 0.0 else 0.0
        energy[i, _FRICTION] = (1.0 - bonded) * work
        if joint:
            energy[i, _COHESION] = bonded * work
        if lifted > 0.0 or size > 0.0:
            state[i, slipped] += np.sqrt(slip)
        if joint:
            lost = details[i, left] < share(details[i, start], parameters[i, length])
            parted = lifted <= 0.0 and jump1[0] > jump0[0]
            if parted or (lost and details[i, left] == 0.0):
                state[i, slipped] = max(state[i, slipped], parameters[i, length])
            state[i, damage] = share(state[i, slipped], parameters[i, length])
        if impact:
            state[i, pushed] = r[0]
        if lifted <= 0.0 and size == 0.0:
            return 0
        return 2 if size >= (1.0 - 1e-12) * limit * limit else 1

    def coulomb(terms):
        tip = terms[:, pull] if joint else np.zeros(len(terms))
        lag = terms[:, shift : shift + dim - 1]
        return CoulombPoints(terms[:, v_min], lag, terms[:, mu], terms[:, bound], tip)

    names = ["slip"] + ["damage"] * joint + ["pushed"] * impact
    return LawKernels(
        name="joint" if joint else "contact with slip weakening",
        effects=Columns.effects(parameters_of, state_of, terms_of, details_of),
        components=dim,
        prepare=prepare,
        solve=solve,
        evolve=evolve,
        commit=commit,
        num_terms=terms_of.count,
        num_details=details_of.count,
        state_names=tuple(names),
        energies=("impact", "friction", "cohesion") if joint else ("impact", "friction"),
        coulomb=coulomb,
    )
