# SPDX-License-Identifier: LGPL-3.0-or-later
"""The kernels of friction and joints that slip weakens (`weakening_friction.py`)."""

from __future__ import annotations

from collections import namedtuple
from functools import cache

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.kernel_options import LEAN_INNER, MERGED, MERGED_ENTRY
from xper_fx.nscd.laws.contact_solver import contact_solver
from xper_fx.nscd.laws.law import Columns, CoulombPoints, LawKernels

# Speed of opening, beside the one that the tension alone gives, at which a joint has opened.
_OPENED = 1e-4
# Speed of opening beside that of slip at which a point counts as closed while it slides.
_CLOSED = 1e-3
# Opening beside the slip distance that rounding and tolerances may leave of a joint that is whole.
_LEFT = 1e-6
# Columns of energy.
_IMPACT, _FRICTION, _COHESION = range(3)

WeakeningKernels = namedtuple("WeakeningKernels", "law columns share mean_share set_share slip_of")
"""The kernels of a law, where its columns are, and compiled functions of a point."""

WeakeningColumns = namedtuple(
    "WeakeningColumns",
    "mu_s mu_d length cohesion tension slipped damage pushed "
    "v_min mu bound shift pull start left area_time",
)
"""Columns of parameters, state, terms and details; -1 of those that a law does not have."""


@cache
def weakening_kernels(dim: int, contact: str, joint: bool) -> WeakeningKernels:
    """The kernels of slip weakening, with `joint` those of Mohr-Coulomb."""
    algebra = for_dimension(dim)
    sym_row, sym_vector, subtract = algebra.sym_row, algebra.sym_vector, algebra.subtract
    tangent_part, with_normal = algebra.tangent_part, algebra.with_normal
    local, impact = contact_solver(dim, True), contact == "velocity"
    if impact:
        from xper_fx.nscd.laws.impact import least_speed

    cohesion = tension = damage = pull = area_time = pushed = -1
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

    @njit(inline="always")
    def holds(i, parameters, state):
        """Whether a bond holds the lips."""
        if not joint or parameters[i, tension] == 0.0:
            return False
        return share(state[i, slipped], parameters[i, length]) > 0.0

    @njit(**LEAN_INNER)
    def prepare(i, jump, velocity, w, area, step, theta, parameters, state, terms, details):
        gap = jump[0] + step * (1.0 - theta) * velocity[0]
        terms[i, v_min] = -gap / (step * theta)
        f = share(state[i, slipped], parameters[i, length])
        if joint:
            details[i, area_time] = step * area
        if impact and not holds(i, parameters, state):
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
        b = subtract(u, sym_vector(wi, with_normal(r, r[0] + held)))
        lag = tangent_part(terms, i, shift)
        new, _ = local(b, wi, terms[i, v_min], lag, terms[i, mu], terms[i, bound])
        return with_normal(new, new[0] - held), False

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
            opened = jump1[0] > max(jump0[0], _LEFT * parameters[i, length])
            parted = lifted <= 0.0 and opened
            if parted or (lost and details[i, left] == 0.0):
                state[i, slipped] = max(state[i, slipped], parameters[i, length])
            state[i, damage] = share(state[i, slipped], parameters[i, length])
        if impact:
            state[i, pushed] = r[0]
        if lifted <= 0.0 and size == 0.0:
            return 0
        return 2 if size >= (1.0 - 1e-12) * limit * limit else 1

    def coulomb(terms, details, parameters):
        tip = terms[:, pull] if joint else np.zeros(len(terms))
        lag = terms[:, shift : shift + dim - 1]
        return CoulombPoints(terms[:, v_min], lag, terms[:, mu], terms[:, bound], tip)

    names = ["slip"] + ["damage"] * joint + ["pushed"] * impact
    law = LawKernels(
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
        holds=holds if joint else None,
    )
    columns = WeakeningColumns(
        mu_s, mu_d, length, cohesion, tension, slipped, damage, pushed,
        v_min, mu, bound, shift, pull, start, left, area_time,
    )  # fmt: skip
    return WeakeningKernels(law, columns, share, mean_share, set_share, slip_of)
