# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kernels of bonds whose damage over a step is its mean, as `cohesive_zone.py` derives them."""

from __future__ import annotations

from functools import cache

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.kernel_options import ENTRY, LEAN_INNER, MERGED, MERGED_ENTRY
from xper_fx.nscd.laws.contact_losses import contact_losses
from xper_fx.nscd.laws.contact_solver import contact_solver
from xper_fx.nscd.laws.damage_curve import (
    BETA0,
    C_N,
    C_T,
    DAMAGE,
    OPENING_MAX,
    damage_functions,
    shape_column,
    stiffness_along,
)
from xper_fx.nscd.laws.friction_of_lips import Friction, friction_by_damage
from xper_fx.nscd.laws.law import (
    ALL_ENERGIES,
    COHESION,
    ENERGIES,
    STORED,
    VISCOUS,
    Columns,
    CoulombPoints,
    LawKernels,
)
from xper_fx.nscd.laws.weakening import Weakening


@cache
def mean_kernels(
    dim: int, friction: Friction, lagged: bool, viscous: bool, weakening: Weakening
) -> LawKernels:
    """The kernels of a bond.

    Args:
        friction: of the lips.
        lagged: whether damage is frozen during a step.
        viscous: whether it lags behind its curve (`viscous_damage.py`).
        weakening: how openings weaken the bond.
    """
    algebra = for_dimension(dim)
    sym_row = algebra.sym_row
    dot, add, subtract, scale = algebra.dot, algebra.add, algebra.subtract, algebra.scale
    diagonal, sym_vector = algebra.multiply_diagonal, algebra.sym_vector
    part, tangent_part, sym_part = algebra.part, algebra.tangent_part, algebra.sym_part
    soften = algebra.compliance_with_springs
    rubs, friction_of = friction is not Friction.NONE, friction_by_damage(friction)
    contact, book_losses = contact_solver(dim, rubs), contact_losses(dim, rubs)
    num_sym = dim * (dim + 1) // 2

    shape, weakens, reach = weakening.shape, weakening.weakens, weakening.reach
    first_limit = weakening.limit
    damage, mean_damage, dissipated, _ = damage_functions(weakening.curve)

    terms_of, details_of, others = Columns(), Columns(), Columns()
    others.take("cohesion", 2)  # C
    others.take("damage", 3)  # beta0, state
    for effect, count in weakening.effects:
        others.take(effect, count)
    # Velocities are relative to jump_h / (h theta).
    limit = terms_of.take("damage")  # squared speed beyond which damage may grow
    middle = terms_of.take("unilateral contact", dim)  # jump_h / (h theta)
    push = terms_of.take("cohesion", dim)  # P / k
    spring = terms_of.take("cohesion", 2)  # beta_m k
    soft = terms_of.take("cohesion", num_sym)  # packed W~
    mean, start, jump_start, h_theta = (details_of.take("damage") for _ in range(4))
    k_n, k_t = details_of.take("cohesion"), details_of.take("cohesion")
    if rubs:
        others.take("friction")  # mu
        shift = details_of.take("friction", dim - 1)
    if viscous:
        from xper_fx.nscd.laws.viscous_damage import lagging_damage

        lagging = lagging_damage(weakening.curve)
        viscosity = shape_column(rubs) + sum(count for _, count in weakening.effects)
        others.take("viscous bonds")  # b
        reached = details_of.take("viscous bonds")  # opening up to which the damage is safe
        drag = details_of.take("viscous bonds")  # b / h

    @njit(inline="always")
    def opening(jump):
        x = max(jump[0], 0.0) ** 2 + jump[1] * jump[1]
        if dim == 3:
            x += jump[2] * jump[2]
        return x

    @njit(inline="always")
    def set_damage(i, beta, s, terms, details):
        details[i, mean] = beta
        terms[i, spring] = beta * details[i, k_n]
        terms[i, spring + 1] = beta * details[i, k_t]
        for j in range(num_sym):
            terms[i, soft + j] = s[j]

    @njit(**MERGED)
    def prepare(i, jump, velocity, w, area, step, theta, parameters, state, terms, details):
        scaled = step * theta
        for j in range(dim):
            jump_h = jump[j] + step * (1.0 - theta) * velocity[j]
            terms[i, middle + j] = jump_h / scaled
            terms[i, push + j] = ((1.0 - theta) * jump[j] + theta * jump_h) / (scaled * theta)
        if rubs:
            for j in range(1, dim):
                details[i, shift + j - 1] = (1.0 - theta) / theta * velocity[j]
        beta = state[i, DAMAGE]
        safe = first_limit(i, parameters, state) / scaled
        details[i, start] = beta
        details[i, jump_start] = np.sqrt(opening(jump))
        if viscous:
            details[i, drag] = parameters[i, viscosity] / step
            details[i, reached] = first_limit(i, parameters, state)
            if details[i, jump_start] > details[i, reached]:  # weakens whether it opens on or not
                safe = 0.0
        terms[i, limit] = np.inf if (beta == 0.0 or lagged) else safe * safe
        details[i, h_theta] = scaled
        details[i, k_n] = scaled * scaled * area * parameters[i, C_N]
        details[i, k_t] = scaled * scaled * area * parameters[i, C_T]
        s = soften(sym_row(w, i), beta * details[i, k_n], beta * details[i, k_t])
        set_damage(i, beta, s, terms, details)

    @njit(inline="always")
    def bonded(k, p, u):
        """Impulse beta_m (P + k u) with which the bond pulls the lips together."""
        return diagonal(k[0], k[1], add(p, u))

    @njit(inline="always")
    def with_contact(free, s, k, p, least, slipped, mu):
        """Velocity and impulse when the bond alone would let the lips interpenetrate."""
        hat, _ = contact(free, s, least, slipped, mu, 0.0)
        new = add(free, sym_vector(s, hat))
        return new, subtract(hat, bonded(k, p, new))

    @njit(**MERGED_ENTRY)
    def solve(i, u, r, w, parameters, terms, details):
        jump_h, p = part(terms, i, middle), part(terms, i, push)
        k = (terms[i, spring], terms[i, spring + 1])
        s = sym_part(terms, i, soft)
        new = subtract(u, sym_vector(s, add(r, bonded(k, p, u))))
        if new[0] >= -jump_h[0]:
            return scale(-1.0, bonded(k, p, new)), True
        if rubs:
            new, impulse = with_contact(
                new,
                s,
                k,
                p,
                -jump_h[0],
                tangent_part(details, i, shift),
                friction_of(i, details[i, mean], parameters),
            )
        else:
            new, impulse = with_contact(new, s, k, p, -jump_h[0], (0.0,), 0.0)
        return impulse, r[0] > 0.0 and impulse[0] > 0.0

    # Of a step that ends with a jump of opening x1 (m): `weakened` has its mean damage, the damage
    # at its end, and the openings of the old and the new damage on the curve; `mean_of_step` the
    # first of them.
    if viscous:

        @njit(**LEAN_INNER)
        def weakened(i, jump, x1, safe, parameters, details):
            p, old, beta0 = shape(i, jump, parameters), details[i, start], parameters[i, BETA0]
            x0, share = details[i, jump_start], old / beta0
            x_max = reach(details[i, reached], share, p)
            q = details[i, drag] / stiffness_along(jump, parameters[i, C_N], parameters[i, C_T])
            x_c, m = lagging.followed(x0, x1, x_max, share, q, p)
            if x_c <= x_max:
                return old, old, x_max, x_max
            new = min(old, damage(x_c, p, beta0))
            return lagging.mean(x0, x1, x_max, x_c, old, new, m, p, beta0), new, x_max, x_c

        @njit(inline="always")
        def mean_of_step(i, jump, x1, safe, parameters, details):
            return weakened(i, jump, x1, safe, parameters, details)[0]

        @njit(**LEAN_INNER)
        def cost_of(i, jump, x_max, x_c, parameters):
            """What a damage has cost (J/m^2)."""
            p, beta0 = shape(i, jump, parameters), parameters[i, BETA0]
            spent = dissipated(x_c, p, beta0) - dissipated(x_max, p, beta0)
            return stiffness_along(jump, parameters[i, C_N], parameters[i, C_T]) * spent
    else:

        @njit(inline="always")
        def mean_on(p, i, x1, safe, parameters, details):
            old, beta0 = details[i, start], parameters[i, BETA0]
            share = old / beta0
            if not weakens(x1, safe, share, p):
                return old
            return mean_damage(x1, details[i, jump_start], reach(safe, share, p), old, p, beta0)

        @njit(inline="always")
        def mean_of_step(i, jump, x1, safe, parameters, details):
            p = shape(i, jump, parameters)
            return mean_on(p, i, x1, safe, parameters, details)

        @njit(inline="always")
        def weakened(i, jump, x1, safe, parameters, details):
            p = shape(i, jump, parameters)
            mean = mean_on(p, i, x1, safe, parameters, details)
            return mean, damage(x1, p, parameters[i, BETA0]), x1, x1

    @njit(**MERGED)
    def evolve(i, u, w, parameters, terms, details):
        speed = opening(add(part(terms, i, middle), u))
        if speed <= terms[i, limit]:
            lost = details[i, start] - details[i, mean]
            return -lost / details[i, start] if lost > 0.0 else 0.0
        velocity, scaled = add(part(terms, i, middle), u), details[i, h_theta]
        x1, safe = scaled * np.sqrt(speed), scaled * np.sqrt(terms[i, limit])
        # what an earlier step has lost beyond the curve does not come back
        beta = mean_of_step(i, velocity, x1, safe, parameters, details)
        fall = details[i, mean] - min(beta, details[i, start])
        if fall <= 0.0:
            return fall / details[i, start]
        s = soften(sym_row(w, i), beta * details[i, k_n], beta * details[i, k_t])
        set_damage(i, beta, s, terms, details)
        return fall / details[i, start]

    @njit(**MERGED)
    def commit(i, jump0, jump1, u, r, area, step, theta, parameters, state, terms, details, energy):
        c_n, c_t = parameters[i, C_N], parameters[i, C_T]
        old, beta = details[i, start], details[i, mean]
        x1, safe, new = np.sqrt(opening(jump1)), first_limit(i, parameters, state), beta
        x_max = x_c = min(x1, safe) if viscous else x1
        far = max(x1, details[i, jump_start]) if viscous else x1
        if far > safe and old > 0.0:
            mean_of_step, at_end, x_max, x_c = weakened(i, jump1, x1, safe, parameters, details)
            if not lagged:
                beta = min(beta, mean_of_step)
            new = min(beta, at_end)
        k = (beta * details[i, k_n], beta * details[i, k_t])
        hat = add(r, bonded(k, part(terms, i, push), u))
        moved = subtract(jump1, jump0)
        e0 = 0.5 * area * dot(jump0, diagonal(c_n, c_t, jump0))
        e1 = 0.5 * area * dot(jump1, diagonal(c_n, c_t, jump1))
        # The lips are closed when they push harder than they would part (natural map). What rhat
        # works at an open or sticking point, or with the wrong sign, is the solver's tolerance.
        pressing = hat[0] * terms[i, soft] > u[0] + terms[i, middle]
        energy[i, STORED] = new * e1
        energy[i, COHESION] = (beta - new) * e1 + (old - beta) * e0
        if viscous:
            cost = 0.0
            if x_c > x_max:
                cost = min(area * cost_of(i, jump1, x_max, x_c, parameters), energy[i, COHESION])
            energy[i, VISCOUS] = energy[i, COHESION] - cost
            energy[i, COHESION] = cost
        state[i, OPENING_MAX] = max(state[i, OPENING_MAX], x_c)
        state[i, DAMAGE] = new
        numerical = (theta - 0.5) * beta * area * dot(moved, diagonal(c_n, c_t, moved))
        mu = friction_of(i, beta, parameters)
        return book_losses(i, hat, moved, step, pressing, numerical, mu, energy)

    @njit(**ENTRY)
    def frictions(details, parameters):
        mu = np.empty(len(details))
        for i in range(len(mu)):
            mu[i] = friction_of(i, details[i, mean], parameters)
        return mu

    def coulomb(terms, details, parameters):
        none = np.zeros(len(terms))
        lag = details[:, shift : shift + dim - 1] if rubs else np.zeros((len(terms), dim - 1))
        springs = terms[:, [spring, *[spring + 1] * (dim - 1)]]
        least, mu = -terms[:, middle], frictions(details, parameters)
        return CoulombPoints(least, lag, mu, none, none, springs, terms[:, push : push + dim])

    @njit(inline="always")
    def stored(i, jump, area, parameters, state):
        tractions = diagonal(parameters[i, C_N], parameters[i, C_T], jump)
        return 0.5 * area * state[i, DAMAGE] * dot(jump, tractions)

    return LawKernels(
        name="cohesive zone with friction" if rubs else "cohesive zone",
        effects=Columns.effects(others, terms_of, details_of),
        components=dim,
        prepare=prepare,
        solve=solve,
        evolve=None if lagged else evolve,
        commit=commit,
        num_terms=terms_of.count,
        num_details=details_of.count,
        state_names=("opening_max", "damage"),
        energies=ALL_ENERGIES if viscous else ENERGIES,
        spent=weakening.spent,
        stored=stored,
        coulomb=coulomb,
    )
