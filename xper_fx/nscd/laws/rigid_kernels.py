# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kernels of initially rigid bonds, as `rigid_cohesive_zone.py` derives them.

Beside the kernels of any law (`law.py`) there are those of `RigidKernels`, for points i that are
rigid still, or may be:

    bears(i, r, step_area, parameters) -> bool
        whether a bond bears an impulse r in a step, `step_area` being h A
    held(i, u, r, parameters, terms, details) -> bool
        whether nothing opens that has velocity u with impulse r
    insist(i, u, for_good, parameters, terms, details)
        from now on in this step, of the states that the bond may have, the most damaged one is
        taken if velocity u breaks it; with `for_good` the bond is no sounder than u leaves it
    rest(i, details), rests(i, details) -> bool
        in place of `prepare`, for lips that are one, have not moved and bear no impulse; whether
        that was so
"""

from __future__ import annotations

from functools import cache

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.kernel_options import LEAN_INNER
from xper_fx.nscd.laws.contact_losses import contact_losses
from xper_fx.nscd.laws.contact_solver import contact_solver
from xper_fx.nscd.laws.damage_curve import BETA0, C_N, C_T, DAMAGE, OPENING_MAX, damage_functions
from xper_fx.nscd.laws.friction_of_lips import Friction, friction_by_damage
from xper_fx.nscd.laws.impact import least_speed
from xper_fx.nscd.laws.law import (
    ALL_ENERGIES,
    COHESION,
    ENERGIES,
    FRICTION,
    IMPACT,
    NUMERICAL,
    STORED,
    VISCOUS,
    Columns,
    LawKernels,
)
from xper_fx.nscd.laws.rigid_strength import RigidKernels, strength_of
from xper_fx.nscd.laws.weakening import Weakening

PUSHED = 2  # column of the state, after those of all bonds

# Iterations for the mean damage: steps in one direction, then with a bracket.
_MONOTONE, _MOST = 40, 200
# Error of the balance of s, and a difference of neighbouring floats.
_CLOSE, _NEIGHBOURS = 1e-14, 4e-16
# Opening that a solver's tolerance may leave a bond that holds, relative to the critical one, and
# what holding it would take beyond the strength, relative.
_LEFT, _OVER = 1e-6, 1e-6
# Difference of the squares of friction and its bound, relative, at which lips slide.
_SLIDES = 1e-12
# In the column of what is rigid: lips that are one, for which no constants are set.
_RESTS = 2.0
# What is added to compliances to tell the impulse that holds, relative, and where both lips are
# driven: whatever parts them opens the bond.
_REGULAR, _DRIVEN = 1e-12, 1e-200


@cache
def rigid_kernels(
    dim: int,
    friction: Friction,
    viscous: bool,
    modes_apart: bool,
    weakening: Weakening,
    restitution: int,
) -> LawKernels:
    """The kernels of a bond; see `bond_kernels.mean_kernels`.

    Args:
        dim, friction, weakening: as there.
        viscous: whether lips that part are dragged.
        modes_apart: whether C_N and C_T differ.
        restitution: column of Newton's e among the parameters, after that of the viscosity.
    """
    algebra = for_dimension(dim)
    dot, add, subtract, scale = algebra.dot, algebra.add, algebra.subtract, algebra.scale
    sym_row, sym_vector, sym_solve = algebra.sym_row, algebra.sym_vector, algebra.sym_solve
    soften, diagonal = algebra.compliance_with_springs, algebra.multiply_diagonal
    part, tangent_part, sym_part = algebra.part, algebra.tangent_part, algebra.sym_part
    rubs, friction_of = friction is not Friction.NONE, friction_by_damage(friction)
    stiffens = viscous or friction is Friction.GROWING
    contact, book_losses = contact_solver(dim, rubs), contact_losses(dim, rubs)
    num_sym = dim * (dim + 1) // 2
    diagonal_of = (0, 2) if dim == 2 else (0, 3, 5)
    opening, bears = strength_of(dim, friction, weakening)
    shape, reach, first_limit = weakening.shape, weakening.reach, weakening.limit
    damage, mean_damage, _, opening_with = damage_functions(weakening.curve)
    energies = ALL_ENERGIES if viscous else ENERGIES

    terms_of, details_of, others = Columns(), Columns(), Columns()
    others.take("cohesion", 2)  # C
    others.take("damage", 3)  # beta0, state
    for effect, count in weakening.effects:
        others.take(effect, count)
    push = terms_of.take("cohesion", dim)  # P
    start_at = terms_of.take("cohesion", dim)  # z
    closed_at = terms_of.take("unilateral contact")  # least y_N
    old, jump_start, limit, rigid, soundest, snapped = (details_of.take("damage") for _ in range(6))
    h_theta = details_of.take("cohesion")
    spring = details_of.take("cohesion", 2)  # k of C_N and C_T
    compliance = details_of.take("cohesion", num_sym)
    others.take("impact", 2)  # Newton's e, impulse of the last step
    if rubs:
        others.take("friction")  # mu
        slip = terms_of.take("friction", dim - 1)  # what y_T is less than the slip
    if viscous:
        others.take("viscous bonds")  # eta
        whole_drag = details_of.take("viscous bonds")  # h theta A eta

    @njit(inline="always")
    def slipped(i, terms):
        if not rubs:
            return (0.0,)
        return tangent_part(terms, i, slip)

    @njit(inline="always")
    def mean_of(w):
        return 0.5 * (w[0] + w[2]) if dim == 2 else (w[0] + w[3] + w[5]) / 3.0

    @njit(inline="always")
    def stiffened(k, w):
        """I + k W."""
        if dim == 2:
            return 1.0 + k * w[0], k * w[1], 1.0 + k * w[2]
        return 1.0 + k * w[0], k * w[1], k * w[2], 1.0 + k * w[3], k * w[4], 1.0 + k * w[5]

    @njit(inline="always")
    def held_back(free, w, k_n, k_t):
        """(I + W k)^-1 free, k = diag(k_n, k_t), without differences of large numbers."""
        if not modes_apart or k_n == k_t:
            return sym_solve(stiffened(k_n, w), free)
        # with c^2 = k_t / k_n, (I + k_n c W c) c y = c free is symmetric
        c = np.sqrt(k_t / k_n)
        if dim == 2:
            scaled = (w[0], c * w[1], c * c * w[2])
        else:
            scaled = (w[0], c * w[1], c * w[2], c * c * w[3], c * c * w[4], c * c * w[5])
        return diagonal(1.0, 1.0 / c, sym_solve(stiffened(k_n, scaled), diagonal(1.0, c, free)))

    @njit(inline="always")
    def holds(i, parameters, state):
        return state[i, DAMAGE] > 0.0

    @njit(**LEAN_INNER)
    def prepare(i, jump, velocity, w, area, step, theta, parameters, state, terms, details):
        scaled = step * theta
        for j in range(dim):
            z = 2.0 * jump[j] / scaled
            terms[i, start_at + j] = z
            terms[i, push + j] = z + (1.0 - theta) / theta * velocity[j]
        broken = not holds(i, parameters, state)
        if broken:
            gap = jump[0] + step * (1.0 - theta) * velocity[0]
            pushed = w[i, 0] * state[i, PUSHED]
            slowest = least_speed(gap, velocity[0], step, pushed, parameters[i, restitution])
            terms[i, closed_at] = slowest + terms[i, push]
        else:
            terms[i, closed_at] = 0.5 * terms[i, start_at]
        if rubs:
            for j in range(1, dim):
                terms[i, slip + j - 1] = -terms[i, push + j if broken else start_at + j]
        details[i, old] = details[i, soundest] = state[i, DAMAGE]
        sound = state[i, OPENING_MAX] == 0.0
        details[i, rigid] = 1.0 if sound else 0.0
        if broken:  # contact asks for no more
            return
        details[i, limit] = first_limit(i, parameters, state)
        details[i, jump_start] = 0.0 if sound else opening(jump)
        details[i, snapped] = 0.0
        details[i, h_theta] = scaled
        details[i, spring] = 0.5 * step * scaled * area * parameters[i, C_N]
        details[i, spring + 1] = 0.5 * step * scaled * area * parameters[i, C_T]
        if viscous:
            details[i, whole_drag] = scaled * area * parameters[i, restitution - 1]
        w_i = sym_row(w, i)
        least = max(_REGULAR * mean_of(w_i), _DRIVEN)
        for j in range(num_sym):
            details[i, compliance + j] = w_i[j] + (least if j in diagonal_of else 0.0)

    @njit(inline="always")
    def holding(i, u, r, terms, details):
        """The impulse that leaves no jump at the end of the step."""
        w = sym_part(details, i, compliance)
        free = add(subtract(u, sym_vector(w, r)), part(terms, i, push))
        return sym_solve(w, subtract(scale(0.5, part(terms, i, start_at)), free))

    @njit(**LEAN_INNER)
    def held_but(i, over, u, r, parameters, terms, details):
        """As `held`, for a strength that is higher by a share `over`."""
        if details[i, rigid] == 0.0 or details[i, soundest] < details[i, old]:
            return False
        if details[i, snapped] == 1.0:
            return False
        hold = scale(1.0 - over, holding(i, u, r, terms, details))
        step_area = details[i, spring] / (0.5 * details[i, h_theta] * parameters[i, C_N])
        return bears(i, hold, step_area, parameters)

    @njit(**LEAN_INNER)
    def held(i, u, r, parameters, terms, details):
        return held_but(i, 0.0, u, r, parameters, terms, details)

    if viscous:
        open_lips = (1.0,) + (0.0,) * (dim - 1)

        @njit(**LEAN_INNER)
        def drag_of(i, beta, parameters, details):
            """c of a mean damage."""
            left = beta / parameters[i, BETA0]
            if left == 0.0:
                return 0.0
            p = shape(i, open_lips, parameters)
            return details[i, whole_drag] * left * opening_with(left, p) / p[0]

    @njit(inline="always")
    def touching(i, beta, y, soft, parameters, terms):
        """Impulse of the contact of lips that would end with y, given way to by `soft`."""
        mu = friction_of(i, beta, parameters) if rubs else 0.0
        hat, _ = contact(y, soft, terms[i, closed_at], slipped(i, terms), mu, 0.0)
        return hat

    @njit(inline="always")
    def respond(i, beta, free, w, parameters, terms, details):
        """y, and the impulse of the contact, for a mean damage; `free` is y without any impulse."""
        k_n, k_t = beta * details[i, spring], beta * details[i, spring + 1]
        if viscous:
            drag = drag_of(i, beta, parameters, details)
            free = add(free, sym_vector(w, scale(drag, part(terms, i, start_at))))
            k_n, k_t = k_n + drag, k_t + drag
        y = held_back(free, w, k_n, k_t)
        if y[0] >= terms[i, closed_at]:
            return y, scale(0.0, y)
        soft = soften(w, k_n, k_t)
        hat = touching(i, beta, y, soft, parameters, terms)
        return add(y, sym_vector(soft, hat)), hat

    @njit(inline="always")
    def pulled(i, beta, y, parameters, terms, details):
        """The impulse with which the bond pulls its lips together, for a mean damage."""
        pull = diagonal(beta * details[i, spring], beta * details[i, spring + 1], y)
        if viscous:
            moved = subtract(y, part(terms, i, start_at))
            pull = add(pull, scale(drag_of(i, beta, parameters, details), moved))
        return pull

    @njit(inline="always")
    def jump_after(i, y, terms, details):
        """Jump at the end of a step that ends with y (m)."""
        at_start = scale(0.5, part(terms, i, start_at))
        return scale(details[i, h_theta], subtract(y, at_start))

    @njit(inline="always")
    def mean_with(i, x1, pull, p, parameters, details):
        """Mean damage of a step that ends with an opening x1 (m) on a curve of shape p.

        `pull` is U0 + U1 (m), along which the bond pulls. Of a sound bond U0 is what tolerances
        have left: its mean traction is that of a bond that opens from 0, of the strength it has
        along `pull`.
        """
        beta, beta0 = details[i, old], parameters[i, BETA0]
        x_max = reach(details[i, limit], beta / beta0, p)
        mean = mean_damage(x1, details[i, jump_start], x_max, beta, p, beta0)
        both = opening(pull)
        if details[i, rigid] == 1.0 and both > 0.0:
            x, along = max(x1, x_max), shape(i, pull, parameters)
            whole = (mean + beta * (p[0] / x) ** 2) * x / both
            mean = min(beta, whole * along[0] / p[0])
        return mean

    @njit(inline="always")
    def mean_after(i, y, parameters, terms, details):
        """Mean damage of a step that ends with y."""
        jump, pull = jump_after(i, y, terms, details), scale(details[i, h_theta], y)
        p = shape(i, jump, parameters)
        return mean_with(i, opening(jump), pull, p, parameters, details)

    @njit(**LEAN_INNER)
    def following(i, s, kappa, free, w, parameters, terms, details):
        """The mean damage after the step that is found with s."""
        y, _ = respond(i, (1.0 / s - 1.0) / kappa, free, w, parameters, terms, details)
        return mean_after(i, y, parameters, terms, details)

    @njit(**LEAN_INNER)
    def damage_from(i, s, kappa, free, w, parameters, terms, details):
        """The mean damage at the first root that is met from s on, up to 1 or down to the least.

        Steps are safe ones, or secants that are longer; a root that was passed is bracketed. With
        the impulse of a sound bond, k w beta_m s, falling in s those are s <- 1 - k w beta_m s;
        friction that grows or a drag may hold it before, and then s <- 1 / (1 + k w beta_m).
        """
        falls = details[i, rigid] == 1.0 and not stiffens
        least = 1.0 / (1.0 + kappa * details[i, soundest])
        last, before, rises, end, count = s, 0.0, True, s, 0
        while True:
            beta = following(i, s, kappa, free, w, parameters, terms, details)
            error = 1.0 - s * (1.0 + kappa * beta)
            if abs(error) <= _CLOSE:
                return beta
            if count == 0:
                rises = error > 0.0
                end = 1.0 if rises else least
            if (error > 0.0) != rises:
                break
            if s == end:
                return beta
            further = error if falls else error / (1.0 + kappa * beta)
            if abs(before) > abs(error):
                secant = (s - last) * error / (before - error)
                further = secant if abs(secant) > abs(further) else further
            last, before, count = s, error, count + 1
            s = min(1.0, max(least, s + further)) if count < _MONOTONE else end
        # Illinois
        other, beyond, side = s, error, 0
        for _ in range(_MOST):
            s = (last * beyond - other * before) / (beyond - before)
            if not min(last, other) < s < max(last, other):
                s = 0.5 * (last + other)
            beta = following(i, s, kappa, free, w, parameters, terms, details)
            error = 1.0 - s * (1.0 + kappa * beta)
            if abs(error) <= _CLOSE or abs(last - other) <= _NEIGHBOURS * last:
                break
            if (error > 0.0) == rises:
                last, before = s, error
                beyond *= 0.5 if side == 1 else 1.0
                side = 1
            else:
                other, beyond = s, error
                before *= 0.5 if side == -1 else 1.0
                side = -1
        return beta

    @njit(**LEAN_INNER)
    def mean_of_step(i, free, w, parameters, terms, details):
        """Mean damage of the step, from `free`, y without any impulse."""
        kappa = details[i, spring] * mean_of(w)
        if kappa == 0.0:
            return mean_after(i, free, parameters, terms, details)
        least = 1.0 / (1.0 + kappa * details[i, soundest])
        start = 1.0 if details[i, snapped] == 1.0 else least
        beta = damage_from(i, start, kappa, free, w, parameters, terms, details)
        return min(beta, details[i, soundest])

    @njit(**LEAN_INNER)
    def solve(i, u, r, w, parameters, terms, details):
        if details[i, rigid] == 1.0 and held(i, u, r, parameters, terms, details):
            return holding(i, u, r, terms, details), True
        w_i = sym_row(w, i)
        free = add(subtract(u, sym_vector(w_i, r)), part(terms, i, push))
        if details[i, soundest] == 0.0:
            return touching(i, 0.0, free, w_i, parameters, terms), False
        beta = mean_of_step(i, free, w_i, parameters, terms, details)
        y, hat = respond(i, beta, free, w_i, parameters, terms, details)
        return subtract(hat, pulled(i, beta, y, parameters, terms, details)), False

    @njit(inline="always")
    def energy_with(i, jump, area, parameters):
        """Energy of a jump, over the damage (J)."""
        return 0.5 * area * dot(jump, diagonal(parameters[i, C_N], parameters[i, C_T], jump))

    @njit(**LEAN_INNER)
    def book_impact(i, r, moved, step, parameters, energy):
        """Energies of lips that nothing bonds; returns their status."""
        energy[i, IMPACT] = -r[0] * moved[0] / step
        energy[i, FRICTION] = (r[0] * moved[0] - dot(r, moved)) / step
        if r[0] <= 0.0:
            return 0
        bound = friction_of(i, 0.0, parameters) * r[0]
        return 2 if dot(r, r) - r[0] * r[0] >= (1.0 - _SLIDES) * bound * bound else 1

    @njit(**LEAN_INNER)
    def commit(i, jump0, jump1, u, r, area, step, theta, parameters, state, terms, details, energy):
        for j in range(len(energies)):
            energy[i, j] = 0.0
        # lips that are one, for which a vertex sets no constants
        if state[i, OPENING_MAX] == 0.0 and dot(jump1, jump1) + dot(r, r) == 0.0:
            return 1
        if details[i, old] == 0.0:
            state[i, PUSHED] = r[0]
            return book_impact(i, r, subtract(jump1, jump0), step, parameters, energy)
        x1, p = opening(jump1), shape(i, jump1, parameters)
        if x1 <= _LEFT * p[1] and held_but(i, _OVER, u, r, parameters, terms, details):
            energy[i, NUMERICAL] = -dot(r, subtract(jump1, jump0)) / step  # of the tolerance
            return 1
        state[i, PUSHED] = 0.0
        beta0 = parameters[i, BETA0]
        beta = mean_with(i, x1, jump1, p, parameters, details)
        new = min(beta, damage(x1, p, beta0))
        moved = subtract(jump1, jump0)
        e0 = energy_with(i, jump0, area, parameters)
        e1 = energy_with(i, jump1, area, parameters)
        y = add(u, part(terms, i, push))
        pulls = mean_with(i, x1, add(jump0, jump1), p, parameters, details)
        hat = add(r, pulled(i, pulls, y, parameters, terms, details))
        closed = hat[0] * mean_of(sym_part(details, i, compliance))
        pressing = closed > u[0] + terms[i, push] - 0.5 * terms[i, start_at]
        state[i, OPENING_MAX] = max(state[i, OPENING_MAX], x1)
        state[i, DAMAGE] = new
        if details[i, rigid] == 1.0:  # a jump that tolerances have left holds nothing
            e0 = 0.0
        energy[i, STORED] = new * e1
        energy[i, COHESION] = (beta - new) * e1 + (details[i, old] - beta) * e0
        mu = friction_of(i, beta, parameters)
        status = book_losses(i, hat, moved, step, pressing, 0.0, mu, energy)
        taken = energy[i, COHESION] + energy[i, FRICTION] + energy[i, IMPACT]
        taken += energy[i, STORED] - details[i, old] * e0
        if viscous:
            drag = drag_of(i, beta, parameters, details)
            energy[i, VISCOUS] = drag * dot(moved, moved) / (details[i, h_theta] * step)
            taken += energy[i, VISCOUS]
        energy[i, NUMERICAL] = -dot(r, moved) / step - taken
        return status

    @njit(**LEAN_INNER)
    def insist(i, u, for_good, parameters, terms, details):
        if details[i, soundest] == 0.0:
            return
        y = add(u, part(terms, i, push))
        if for_good:
            beta = mean_after(i, y, parameters, terms, details)
            details[i, soundest] = min(details[i, soundest], beta)
            return
        jump = jump_after(i, y, terms, details)
        if opening(jump) >= shape(i, jump, parameters)[1]:
            details[i, snapped] = 1.0

    @njit(inline="always")
    def rest(i, details):
        details[i, rigid] = _RESTS

    @njit(inline="always")
    def rests(i, details):
        return details[i, rigid] == _RESTS

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
        state_names=("opening_max", "damage", "pushed"),
        energies=energies,
        spent=weakening.spent,
        stored=stored,
        rigid=RigidKernels(bears, held, insist, rest, rests),
        holds=holds,
    )
