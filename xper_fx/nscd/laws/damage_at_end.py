# SPDX-License-Identifier: LGPL-3.0-or-later
r"""A cohesive zone whose damage is that of the end of the step: for the monolithic solver.

Over a step the bond pulls with

    r_b = -h A g(x1) C [(1 - theta) U0 + theta U1],    x1 = max(|U1|, largest opening so far),

with the openings of `cohesive_zone.py`, so that in a static run (theta = 1) the traction at the end
lies on the curve whatever the step was. The mean damage of a step spends exactly w but holds more
than the curve at its end: 26, 13 and 4 % too large a peak in 10, 40 and 160 static steps.

**Answer.** `solve` gives the bond as a function of the velocity alone, so that Newton's method sees
the tangent of the curve, softening included, and what is not the bond's, rhat = r - r_b, as a
multiplier of the contact:

    rhat_N - rho (U_N1 / (h theta)) > 0:  closed,  rhat = P_C(rhat - rho u),

P_C being the projection on Coulomb's disc of the normal part. Whether the lips are closed is told
with the bond of lips that just close, r_N of an open one being a pull whatever u is. rho is the
stiffness of the bond or the bulk at the point, the larger one: softer ones serve without friction,
and stick and slip then change for ever.

**Energy.** What damage costs is the state function of the curve, area below it less what the bond
holds, exact at any step; the difference to the work of r_b is the scheme's and booked as numerical,
of third order in smooth steps. A bond that snaps in a step leaves there what was not dissipated.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.kernel_options import LEAN_INNER
from xper_fx.nscd.laws.contact_losses import contact_losses
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
    LawKernels,
)
from xper_fx.nscd.laws.weakening import Weakening

# Part of an impulse that is not the bond's, above which the lips press: less is rounding.
_PRESSED = 1e-9
# Share of the critical opening at which what is left of a bond counts for nothing.
_SPENT = 0.999


@cache
def end_kernels(dim: int, friction: Friction, viscous: bool, weakening: Weakening) -> LawKernels:
    """The kernels of a bond; see `mean_kernels`."""
    algebra = for_dimension(dim)
    dot, add, subtract, scale = algebra.dot, algebra.add, algebra.subtract, algebra.scale
    part, tangent_part, with_normal = algebra.part, algebra.tangent_part, algebra.with_normal
    rubs, friction_of = friction is not Friction.NONE, friction_by_damage(friction)
    diagonal, book_losses = algebra.multiply_diagonal, contact_losses(dim, rubs)

    shape, reach = weakening.shape, weakening.reach
    limit, lengths = weakening.limit, weakening.lengths
    damage, _, dissipated, _ = damage_functions(weakening.curve)

    terms_of, details_of, others = Columns(), Columns(), Columns()
    others.take("cohesion", 2)  # C
    others.take("damage", 3)  # beta0, state
    for effect, count in weakening.effects:
        others.take(effect, count)
    # Velocities are relative to jump_h / (h theta).
    middle = terms_of.take("unilateral contact", dim)  # jump_h / (h theta)
    push = terms_of.take("cohesion", dim)  # P / k
    spring = terms_of.take("cohesion", 2)  # k
    start = details_of.take("damage")  # damage at the start
    safe = details_of.take("damage")  # opening up to which it stays
    h_theta = details_of.take("cohesion")
    if rubs:
        others.take("friction")  # mu
        shift = details_of.take("friction", dim - 1)  # slip at the start
    if viscous:
        from xper_fx.nscd.laws.viscous_damage import lagging_damage

        followed = lagging_damage(weakening.curve).followed
        viscosity = shape_column(rubs) + sum(count for _, count in weakening.effects)
        others.take("viscous bonds")  # b
        drag = details_of.take("viscous bonds")  # b / h
        jump_start = details_of.take("viscous bonds")  # opening at the start

    def growth(parameters: np.ndarray, state: np.ndarray):
        d0, dc = lengths(parameters)
        reached = np.maximum(state[:, OPENING_MAX], d0)
        whole = (state[:, DAMAGE] > 0.0) & (reached < _SPENT * dc)
        return reached, dc - d0, whole

    @njit(inline="always")
    def opening(jump):
        return np.sqrt(dot(jump, jump) - jump[0] * jump[0] + max(jump[0], 0.0) ** 2)

    @njit(**LEAN_INNER)
    def prepare(i, jump, velocity, w, area, step, theta, parameters, state, terms, details):
        scaled = step * theta
        for j in range(dim):
            jump_h = jump[j] + step * (1.0 - theta) * velocity[j]
            terms[i, middle + j] = jump_h / scaled
            terms[i, push + j] = ((1.0 - theta) * jump[j] + theta * jump_h) / (scaled * theta)
        terms[i, spring] = scaled * scaled * area * parameters[i, C_N]
        terms[i, spring + 1] = scaled * scaled * area * parameters[i, C_T]
        details[i, start] = state[i, DAMAGE]
        details[i, safe] = limit(i, parameters, state)
        details[i, h_theta] = scaled
        if viscous:
            details[i, drag] = parameters[i, viscosity] / step
            details[i, jump_start] = opening(jump)
        if rubs:
            for j in range(1, dim):
                details[i, shift + j - 1] = (1.0 - theta) / theta * velocity[j]

    if viscous:

        @njit(**LEAN_INNER)
        def on_curve(i, x, jump, parameters, details):
            """The opening (m) at which the curve has the damage of a jump."""
            share, p = details[i, start] / parameters[i, BETA0], shape(i, jump, parameters)
            x_max = reach(details[i, safe], share, p)
            q = details[i, drag] / stiffness_along(jump, parameters[i, C_N], parameters[i, C_T])
            x_c, _ = followed(details[i, jump_start], x, x_max, share, q, p)
            return x_c
    else:

        @njit(inline="always")
        def on_curve(i, x, jump, parameters, details):
            return x

    @njit(inline="always")
    def damage_at(i, jump, parameters, details):
        """Damage with a jump (m)."""
        x = opening(jump)
        far = max(x, details[i, jump_start]) if viscous else x
        if far <= details[i, safe] or details[i, start] == 0.0:
            return details[i, start]
        x = on_curve(i, x, jump, parameters, details)
        fresh = damage(x, shape(i, jump, parameters), parameters[i, BETA0])
        return min(details[i, start], fresh)

    @njit(inline="always")
    def bond_at(i, u, parameters, terms, details):
        """The bond's impulse."""
        jump = scale(details[i, h_theta], add(part(terms, i, middle), u))
        beta = damage_at(i, jump, parameters, details)
        k = (beta * terms[i, spring], beta * terms[i, spring + 1])
        return scale(-1.0, diagonal(k[0], k[1], add(part(terms, i, push), u)))

    @njit(inline="always")
    def closing(i, u, terms):
        """The velocity with which the lips would just close."""
        return with_normal(u, -terms[i, middle])

    @njit(inline="always")
    def damage_closing(i, u, parameters, terms, details):
        jump = scale(details[i, h_theta], add(part(terms, i, middle), closing(i, u, terms)))
        return damage_at(i, jump, parameters, details)

    @njit(**LEAN_INNER)
    def solve(i, u, r, w, parameters, terms, details):
        bond = bond_at(i, closing(i, u, terms), parameters, terms, details)
        rho = terms[i, spring]
        if w[i, 0] * rho < 1.0 and w[i, 0] > 0.0:
            rho = 1.0 / w[i, 0]
        hat = subtract(r, bond)
        normal = hat[0] - rho * (terms[i, middle] + u[0])
        if normal <= 0.0:
            return bond_at(i, u, parameters, terms, details), True
        # closed: the lips are together, and only their slip opens the bond
        if not rubs:
            return with_normal(bond, bond[0] + normal), True
        slip = add(u, (0.0,) + tangent_part(details, i, shift))
        trial = with_normal(subtract(hat, scale(rho, slip)), 0.0)
        size = np.sqrt(dot(trial, trial))
        beta = damage_closing(i, u, parameters, terms, details)
        bound = friction_of(i, beta, parameters) * normal
        if size > bound:
            trial = scale(bound / size, trial)
        return add(bond, with_normal(trial, normal)), True

    @njit(**LEAN_INNER)
    def cost(i, jump0, jump, area, parameters, details):
        """What the bond dissipates in a step from a jump to a jump (m): J."""
        c_n, c_t = parameters[i, C_N], parameters[i, C_T]
        old, beta0, p = details[i, start], parameters[i, BETA0], shape(i, jump, parameters)
        if damage_at(i, jump, parameters, details) >= old:
            return 0.0
        x = on_curve(i, opening(jump), jump, parameters, details)
        before = dissipated(reach(details[i, safe], old / beta0, p), p, beta0)
        stiffness = stiffness_along(jump, c_n, c_t)
        if opening(jump0) > 0.0:
            stiffness = 0.5 * (stiffness + stiffness_along(jump0, c_n, c_t))
        return area * stiffness * (dissipated(x, p, beta0) - before)

    @njit(**LEAN_INNER)
    def commit(i, jump0, jump1, u, r, area, step, theta, parameters, state, terms, details, energy):
        c_n, c_t = parameters[i, C_N], parameters[i, C_T]
        bond = bond_at(i, closing(i, u, terms), parameters, terms, details)
        jump = scale(details[i, h_theta], add(part(terms, i, middle), u))
        pressing = r[0] - bond[0] > _PRESSED * np.sqrt(dot(r, r))
        if pressing:
            jump = with_normal(jump, 0.0)
        else:
            bond = bond_at(i, u, parameters, terms, details)
        hat, moved = subtract(r, bond), subtract(jump1, jump0)
        x1, old = opening(jump), details[i, start]
        new = damage_at(i, jump, parameters, details)
        e0 = 0.5 * area * dot(jump0, diagonal(c_n, c_t, jump0))
        e1 = 0.5 * area * dot(jump1, diagonal(c_n, c_t, jump1))
        spent = cost(i, jump0, jump, area, parameters, details)
        work, x_c = 0.0, x1
        if viscous:
            x_c = min(x1, details[i, safe])
            if new < old:
                x_c = on_curve(i, x1, jump, parameters, details)
                work = area * details[i, drag] * (np.sqrt(old) - np.sqrt(new)) ** 2
            energy[i, VISCOUS] = work
        energy[i, STORED] = new * e1
        energy[i, COHESION] = spent
        state[i, OPENING_MAX] = max(state[i, OPENING_MAX], x_c)
        state[i, DAMAGE] = new
        numerical = -dot(bond, moved) / step - (new * e1 - old * e0) - spent - work
        mu = friction_of(i, new, parameters)
        return book_losses(i, hat, moved, step, pressing, numerical, mu, energy)

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
        commit=commit,
        num_terms=terms_of.count,
        num_details=details_of.count,
        state_names=("opening_max", "damage"),
        energies=ALL_ENERGIES if viscous else ENERGIES,
        growth=growth,
        spent=weakening.spent,
        stored=stored,
        cost=cost,
    )
