# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Initially rigid bonds whose traction is that of the end of the step: for static runs.

Without inertia (theta = 1) an equilibrium is of the end of a step, and the traction there lies on
the curve of the bond or on the secant to the largest opening so far:

    U1 = 0   and   R in the set of tractions that the bond bears,   while it is sound;
    R = beta1 C U1,   beta1 = beta(max(x1, largest opening so far)),   once it has opened,

with the openings, damage, contact and friction of `rigid_cohesive_zone.py`, contact at position
level.

**Answer.** With y = U1 / h and p = h^2 A C, the law relates y and the impulse r by

    r = rhat - beta1 p y - c (y - U0 / h),    c = h A eta g,
    y_N >= 0,  rhat_N >= 0,  complementary,   |rhat_T| <= mu rhat_N  against y_T - U0_T / h,

c being the viscous drag of `rigid_cohesive_zone.py` with g, the share of the strength that the
curve has left, at beta1. The solution (y, r) of the law on the line y - omega r = b, where

    b = u + U0 / h - omega r

for the velocity and the impulse given, is the proximal map of the law, for any omega > 0 (Lorentz
2008 has it for cohesive elements). What it leaves unchanged obeys the law whatever omega is. A
sound bond answers r = -b / omega as long as it bears that, so that its impulse is a multiplier and
its lips are one, as those of a perfect bond; so does the stiff secant of a bond that has hardly
opened. An open bond has, with a drag c(beta),

    y(beta) = (I + omega (beta p + c))^-1 (b + omega c U0 / h),    beta = beta1(y(beta)),

found in s = 1 / (1 + omega p beta), in (0, 1]: the larger s is the further the bond opens and the
less damage is left. There is one solution if omega is below one over h^2 A times the steepest
descent of the curve; omega is a quarter of that at most, else the compliance of the bulk at the
point, by which gaps and impulses weigh alike (`nscd/point_tangents.py`).

Pressed lips (b_N + omega c U0_N / h < 0) have y_N = 0 and rhat_N from b_N, and slip along
e = b_T + omega c U0_T / h - (1 + omega (beta p_T + c)) U0_T / h by
(|e| - omega mu rhat_N) / (1 + omega (beta p_T + c)) where that is positive.

**Where the bond weakens** `solve` keeps the direction of that y, and takes how far it opens from u,
but at least to where it begins to weaken. Both are the same where the law is obeyed. With the
opening of the map the answer, asked again at the same u, would be weaker than what a sound bond
bears: Newton's method, which sees answers, would never find that the bond opens.

**Energy** is booked as in `damage_at_end.py`: damage costs the area under the curve less what the
bond holds, exactly w once it is broken, and the difference to the work of the tractions of the end
is the scheme's, numerical. The drag loses c |U1 - U0|^2 / h^2, apart from w.

Lorentz, E. (2008) A mixed interface finite element for cohesive zone models. Comput. Methods Appl.
Mech. Engrg. 198, 302-317.
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
    NUMERICAL,
    STORED,
    VISCOUS,
    Columns,
    LawKernels,
)
from xper_fx.nscd.laws.rigid_strength import RigidKernels, strength_of
from xper_fx.nscd.laws.weakening import Weakening

# omega times the steepest descent of the curve, at most.
_SOFT = 0.25
# Iterations for the damage; error of s, relative, and a difference of neighbouring floats.
_MOST, _CLOSE, _NEIGHBOURS = 200, 1e-14, 4e-16
# Opening that is none, relative to the critical one: of a solver's tolerance, or of a bond at its
# strength, which the next step finds anew. (Rings of bonds, one of which has hardly opened and the
# others not at all, took hundreds of iterations.)
_LEFT = 1e-6


@cache
def rigid_end_kernels(
    dim: int, friction: Friction, viscous: bool, weakening: Weakening
) -> LawKernels:
    """The kernels of a bond; see `bond_kernels.mean_kernels`."""
    algebra = for_dimension(dim)
    dot, add, subtract, scale = algebra.dot, algebra.add, algebra.subtract, algebra.scale
    diagonal, part, with_normal = algebra.multiply_diagonal, algebra.part, algebra.with_normal
    rubs, friction_of = friction is not Friction.NONE, friction_by_damage(friction)
    book_losses = contact_losses(dim, rubs)
    opening, bears = strength_of(dim, friction, weakening)
    shape, reach, first_limit = weakening.shape, weakening.reach, weakening.limit
    damage, _, dissipated, opening_with = damage_functions(weakening.curve)
    viscosity = shape_column(rubs) + sum(count for _, count in weakening.effects)
    steepest = viscosity + viscous
    energies = ALL_ENERGIES if viscous else ENERGIES

    terms_of, details_of, others = Columns(), Columns(), Columns()
    others.take("cohesion", 3)  # C, steepest descent
    others.take("damage", 3)  # beta0, state
    for effect, count in weakening.effects:
        others.take(effect, count)
    if rubs:
        others.take("friction")  # mu
    start = terms_of.take("cohesion", dim)  # U0 / h
    spring = terms_of.take("cohesion", 2)  # p
    compliance = terms_of.take("cohesion")  # omega
    old, limit, rigid = (details_of.take("damage") for _ in range(3))
    step_size = details_of.take("cohesion")
    if viscous:
        others.take("viscous bonds")  # eta
        whole_drag = details_of.take("viscous bonds")  # h A eta
        open_lips = (1.0,) + (0.0,) * (dim - 1)

    @njit(inline="always")
    def at_start(i, terms):
        return part(terms, i, start)

    @njit(**LEAN_INNER)
    def prepare(i, jump, velocity, w, area, step, theta, parameters, state, terms, details):
        for j in range(dim):
            terms[i, start + j] = jump[j] / step
        whole = step * step * area
        terms[i, spring] = whole * parameters[i, C_N]
        terms[i, spring + 1] = whole * parameters[i, C_T]
        omega = _SOFT / (whole * parameters[i, steepest])
        own = w[i, 0]
        terms[i, compliance] = min(omega, own) if own > 0.0 else omega
        details[i, old] = state[i, DAMAGE]
        details[i, limit] = first_limit(i, parameters, state)
        details[i, rigid] = 1.0 if state[i, OPENING_MAX] == 0.0 else 0.0
        details[i, step_size] = step
        if viscous:
            details[i, whole_drag] = step * area * parameters[i, viscosity]

    @njit(inline="always")
    def drag_of(i, beta, parameters, details):
        """c of a damage."""
        if not viscous:
            return 0.0
        left = beta / parameters[i, BETA0]
        if left == 0.0:
            return 0.0
        p = shape(i, open_lips, parameters)
        return details[i, whole_drag] * left * opening_with(left, p) / p[0]

    @njit(inline="always")
    def respond(i, beta, b, parameters, terms, details):
        """y and rhat with a damage."""
        omega, drag = terms[i, compliance], drag_of(i, beta, parameters, details)
        if viscous:
            b = add(b, scale(omega * drag, at_start(i, terms)))
        soft_n = 1.0 / (1.0 + omega * (beta * terms[i, spring] + drag))
        soft_t = 1.0 / (1.0 + omega * (beta * terms[i, spring + 1] + drag))
        if b[0] >= 0.0:
            return diagonal(soft_n, soft_t, b), scale(0.0, b)
        normal = -b[0] / omega
        if not rubs:
            return with_normal(scale(soft_t, b), 0.0), with_normal(scale(0.0, b), normal)
        stuck = with_normal(at_start(i, terms), 0.0)
        drive = subtract(with_normal(b, 0.0), scale(1.0 / soft_t, stuck))
        size = np.sqrt(dot(drive, drive))
        bound = omega * friction_of(i, beta, parameters) * normal
        if size <= bound:
            return stuck, with_normal(scale(-1.0 / omega, drive), normal)
        y = add(stuck, scale(soft_t * (size - bound) / size, drive))
        return y, with_normal(scale(-bound / (omega * size), drive), normal)

    @njit(inline="always")
    def damage_after(i, y, parameters, details):
        """Damage of a step that ends with y."""
        jump, beta = scale(details[i, step_size], y), details[i, old]
        p, beta0 = shape(i, jump, parameters), parameters[i, BETA0]
        x = opening(jump)
        if x <= reach(details[i, limit], beta / beta0, p):
            return beta
        return min(beta, damage(x, p, beta0))

    @njit(**LEAN_INNER)
    def following(i, s, kappa, b, parameters, terms, details):
        """The damage after the step that is found with s."""
        y, _ = respond(i, (1.0 / s - 1.0) / kappa, b, parameters, terms, details)
        return damage_after(i, y, parameters, details)

    @njit(**LEAN_INNER)
    def damage_of_step(i, b, parameters, terms, details):
        """Damage of the end of the step."""
        beta = details[i, old]
        if beta == 0.0:
            return 0.0
        kappa = terms[i, compliance] * max(terms[i, spring], terms[i, spring + 1])
        low = 1.0 / (1.0 + kappa * beta)
        beta = following(i, low, kappa, b, parameters, terms, details)
        above = 1.0 / (1.0 + kappa * beta) - low
        if above <= _CLOSE * low:
            return beta
        high = 1.0
        beta = following(i, high, kappa, b, parameters, terms, details)
        below = 1.0 / (1.0 + kappa * beta) - 1.0
        if below == 0.0:
            return beta
        # Illinois
        side = 0
        for _ in range(_MOST):
            s = (low * below - high * above) / (below - above)
            if not low < s < high:
                s = 0.5 * (low + high)
            beta = following(i, s, kappa, b, parameters, terms, details)
            error = 1.0 / (1.0 + kappa * beta) - s
            if abs(error) <= _CLOSE * s or high - low <= _NEIGHBOURS * high:
                break
            if error > 0.0:
                low, above = s, error
                below *= 0.5 if side == 1 else 1.0
                side = 1
            else:
                high, below = s, error
                above *= 0.5 if side == -1 else 1.0
                side = -1
        return beta

    @njit(inline="always")
    def line_of(i, u, r, terms):
        """b of a velocity and an impulse."""
        return subtract(add(u, at_start(i, terms)), scale(terms[i, compliance], r))

    @njit(**LEAN_INNER)
    def solve(i, u, r, w, parameters, terms, details):
        b = line_of(i, u, r, terms)
        if details[i, rigid] == 1.0:
            hold = scale(-1.0 / terms[i, compliance], b)
            step_area = terms[i, spring] / (details[i, step_size] * parameters[i, C_N])
            if bears(i, hold, step_area, parameters):
                return hold, True
        beta = damage_of_step(i, b, parameters, terms, details)
        y, hat = respond(i, beta, b, parameters, terms, details)
        if beta < details[i, old]:
            y = as_far_as(i, u, y, parameters, terms, details)
            beta = damage_after(i, y, parameters, details)
        pull = diagonal(beta * terms[i, spring], beta * terms[i, spring + 1], y)
        if viscous:
            drag = drag_of(i, beta, parameters, details)
            pull = add(pull, scale(drag, subtract(y, at_start(i, terms))))
        return subtract(hat, pull), True

    @njit(inline="always")
    def as_far_as(i, u, y, parameters, terms, details):
        """In the direction of y, the opening of u, or the one from which the bond weakens."""
        along = with_normal(y, max(y[0], 0.0))
        size = np.sqrt(dot(along, along))
        p = shape(i, along, parameters)
        share = details[i, old] / parameters[i, BETA0]
        least = reach(details[i, limit], share, p) / details[i, step_size]
        moved = dot(add(u, at_start(i, terms)), along) / size
        return scale(max(moved, least) / size, along)

    @njit(inline="always")
    def energy_with(i, jump, area, parameters):
        """Energy of a jump, over the damage (J)."""
        return 0.5 * area * dot(jump, diagonal(parameters[i, C_N], parameters[i, C_T], jump))

    @njit(inline="always")
    def lost(i, jump, x, area, parameters):
        """What a bond has dissipated that has opened to x (m) along a jump: J."""
        along = stiffness_along(jump, parameters[i, C_N], parameters[i, C_T])
        return area * along * dissipated(x, shape(i, jump, parameters), parameters[i, BETA0])

    @njit(**LEAN_INNER)
    def commit(i, jump0, jump1, u, r, area, step, theta, parameters, state, terms, details, energy):
        b, moved = line_of(i, u, r, terms), subtract(jump1, jump0)
        x1, p, beta0 = opening(jump1), shape(i, jump1, parameters), parameters[i, BETA0]
        if details[i, rigid] == 1.0 and x1 <= _LEFT * p[1]:  # it is sound still
            for j in range(len(energies)):
                energy[i, j] = 0.0
            energy[i, NUMERICAL] = -dot(r, moved) / step
            return 1
        before = details[i, old]
        new = damage_of_step(i, b, parameters, terms, details)
        y, hat = respond(i, new, b, parameters, terms, details)
        jump = scale(details[i, step_size], y)
        e1 = new * energy_with(i, jump, area, parameters)
        e0, spent = 0.0, 0.0
        if details[i, rigid] == 0.0:  # a jump that tolerances have left holds nothing
            e0 = before * energy_with(i, jump0, area, parameters)
        if new < before:
            x0 = reach(details[i, limit], before / beta0, shape(i, jump, parameters))
            spent = lost(i, jump, opening(jump), area, parameters) - lost(
                i, jump, x0, area, parameters
            )
        energy[i, STORED], energy[i, COHESION] = e1, spent
        state[i, OPENING_MAX] = max(state[i, OPENING_MAX], opening(jump))
        state[i, DAMAGE] = new
        numerical = -dot(subtract(r, hat), moved) / step - (e1 - e0) - spent
        if viscous:
            drag = drag_of(i, new, parameters, details)
            energy[i, VISCOUS] = drag * dot(moved, moved) / (step * step)
            numerical -= energy[i, VISCOUS]
        mu = friction_of(i, new, parameters)
        return book_losses(i, hat, moved, step, hat[0] > 0.0, numerical, mu, energy)

    @njit(inline="always")
    def stored(i, jump, area, parameters, state):
        if state[i, OPENING_MAX] == 0.0:
            return 0.0
        return state[i, DAMAGE] * energy_with(i, jump, area, parameters)

    return LawKernels(
        name="initially rigid bond with friction" if rubs else "initially rigid bond",
        effects=Columns.effects(others, terms_of, details_of),
        components=dim,
        prepare=prepare,
        solve=solve,
        commit=commit,
        num_terms=terms_of.count,
        num_details=details_of.count,
        state_names=("opening_max", "damage"),
        energies=energies,
        spent=weakening.spent,
        stored=stored,
        rigid=RigidKernels(bears),
    )
