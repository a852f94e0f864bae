# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Frictional cohesive zone (Perales et al. 2010, eqs 33-37; the curve of LMGC90's MP3_CZM).

The stress R between the lips is Rhat - Rcoh with Rcoh = beta C U pulling them together,
C = diag(C_N, C_T, C_T), and Rhat obeying Signorini-Coulomb at position level. Damage beta falls
from beta0 to 0 with the largest opening reached, x = sqrt(<U_N>+^2 + |U_T|^2):

    g(x) = beta0                                             x <= d0
         = beta0 (d0 / x) (1 - ((x - d0) / (dc - d0))^2)     d0 < x < dc
         = 0                                                 x >= dc
    d0 = (Rmax / 2)(1 / C_N + 1 / C_T),   dc = (3/2)(w / Rmax + d0 / 6).

**Over a step** the cohesive stress is a secant one, with a single mean damage,

    Rcoh = beta_m C U_theta,   U_theta = theta U1 + (1 - theta) U0,
    beta_m (x1^2 - x0^2) / 2 = integral of beta x dx from x0 to x1 along the loading path.

With e = U.C.U / 2 its work over the step is beta_m (e1 - e0) + (theta - 1/2) beta_m dU.C.dU, so
what it dissipates, (beta_m - beta1) e1 + (beta0 - beta_m) e0 + (theta - 1/2) beta_m dU.C.dU, is
never negative, because beta1 <= beta_m <= beta0 for a mean of a falling function; and when
C_N = C_T a bond that opens spends exactly the area under its curve, whatever the step (a damage
frozen at its old value spends more, the trapezoidal rule on the end values less, even below zero).

**The point's problem.** With k = h^2 theta^2 A C and P = h A C [(1 - theta) U0 + theta U_h] the
total impulse is r = rhat - beta_m k (P / k + dU). For a given beta_m, W~ = (I + W beta_m k)^-1 W
and b~ = u - W~ [r + beta_m k (P / k + u)] turn it into plain contact, dU = b~ + W~ rhat.

beta_m is the fixed point of a map that only falls: it starts from the damage at the start of the
step; each time the interactions are solved with it, `evolve` lowers it to the mean that the new
opening asks for. So of the states that a step may admit (beyond the softening number of
`simulation/cohesive_scales.py` a bond may or may not snap within the step) the least damaged
one is found, and the iteration cannot cycle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.kernel_options import LEAN_INNER
from xper_fx.nscd.laws.contact_losses import contact_losses
from xper_fx.nscd.laws.contact_solver import contact_solver
from xper_fx.nscd.laws.damage_curve import (
    BETA0,
    C_N,
    C_T,
    D0,
    DAMAGE,
    DC,
    MU,
    OPENING_MAX,
    damage,
    mean_damage,
    spent_share,
)
from xper_fx.nscd.laws.law import COHESION, ENERGIES, STORED, LawKernels
from xper_fx.support.checks import require_non_negative, require_positive, take_numbers


@dataclass(frozen=True)
class CohesiveZone:
    """Bond that weakens, breaks, and leaves unilateral contact with friction.

    Args:
        normal_stiffness: C_N (Pa/m).
        fracture_energy: w (J/m^2), the area under the normal curve when C_N = C_T.
        strength: Rmax (Pa), the largest normal stress.
        tangential_stiffness: C_T (Pa/m); C_N if not given.
        friction: Coulomb's mu of the lips; 0 compiles no friction.
        initial_damage: beta0 in (0, 1], 1 for a sound bond.
        damage: "mean" (module docstring); "lagged", damage frozen during the step: cheaper,
            and spends too much energy when the step is not small beside the softening time; "end"
            (`damage_at_end.py`), for the monolithic solver alone; or "auto": "end" in static runs
            of that solver, else "mean".

    Raises:
        ValueError: a number out of range, or w <= Rmax d0 / 2: the bond would have to break
            before its peak.
    """

    normal_stiffness: float
    fracture_energy: float
    strength: float
    tangential_stiffness: float | None = None
    friction: float = 0.0
    initial_damage: float = 1.0
    damage: str = "auto"

    def __post_init__(self) -> None:
        take_numbers(
            self, "normal_stiffness", "fracture_energy", "strength", "friction", "initial_damage"
        )
        require_positive("normal_stiffness", self.normal_stiffness)
        require_positive("fracture_energy", self.fracture_energy)
        require_positive("strength", self.strength)
        if self.tangential_stiffness is not None:
            take_numbers(self, "tangential_stiffness")
            require_positive("tangential_stiffness", self.tangential_stiffness)
        require_non_negative("friction", self.friction)
        if not 0.0 < self.initial_damage <= 1.0:
            raise ValueError(f"initial_damage should lie in (0, 1], got {self.initial_damage}.")
        if self.damage not in ("auto", "mean", "lagged", "end"):
            raise ValueError(
                f'damage should be "auto", "mean", "lagged" or "end", got {self.damage!r}.'
            )
        least = 0.5 * self.strength * self.elastic_opening
        if self.fracture_energy <= least:
            raise ValueError(
                f"fracture_energy {self.fracture_energy:g} J/m^2 should exceed Rmax d0 / 2 = "
                f"{least:g} J/m^2, the energy at the peak; raise it or the stiffness, or lower the "
                f"strength {self.strength:g} Pa."
            )
        if not (self.elastic_opening > 0.0 and np.isfinite(self.critical_opening)):
            raise ValueError(
                f"The strength {self.strength:g} Pa, the stiffness {self.normal_stiffness:g} Pa/m "
                f"and the fracture_energy {self.fracture_energy:g} J/m^2 give openings d0 = "
                f"{self.elastic_opening:g} m and dc = {self.critical_opening:g} m, beyond the "
                "range of floats; take other units."
            )

    @property
    def elastic_opening(self) -> float:
        """d0 (m), the opening at which damage starts."""
        c_t = self.tangential_stiffness or self.normal_stiffness
        return 0.5 * self.strength * (1.0 / self.normal_stiffness + 1.0 / c_t)

    @property
    def critical_opening(self) -> float:
        """dc (m), the opening at which the bond is broken."""
        return 1.5 * (self.fracture_energy / self.strength + self.elastic_opening / 6.0)

    @property
    def softening_slope(self) -> float:
        """Steepest descent of the traction curve (Pa/m): 2 Rmax / (dc - d0)."""
        return 2.0 * self.strength / (self.critical_opening - self.elastic_opening)

    def in_statics(self) -> CohesiveZone:
        """The law that a static run of the monolithic solver takes for this one."""
        return replace(self, damage="end") if self.damage == "auto" else self

    def kernels(self, dim: int) -> LawKernels:
        """See `Law`."""
        if self.damage == "end":
            from xper_fx.nscd.laws.damage_at_end import end_kernels

            return end_kernels(dim, self.friction > 0.0)
        return _kernels(dim, self.friction > 0.0, self.damage == "lagged")

    def parameters(self) -> tuple[float, ...]:
        """C_N, C_T (Pa/m), d0, dc (m), beta0; with friction mu."""
        c_t = self.tangential_stiffness or self.normal_stiffness
        bond = (
            self.normal_stiffness, c_t, self.elastic_opening, self.critical_opening,
            self.initial_damage,
        )  # fmt: skip
        return (*bond, self.friction) if self.friction > 0.0 else bond

    def initial_state(self) -> tuple[float, ...]:
        """Largest opening so far (m) and damage."""
        return 0.0, self.initial_damage


@cache
def _kernels(dim: int, friction: bool, lagged: bool) -> LawKernels:
    algebra = for_dimension(dim)
    sym_row = algebra.sym_row
    dot, add, subtract, scale = algebra.dot, algebra.add, algebra.subtract, algebra.scale
    diagonal, sym_vector = algebra.multiply_diagonal, algebra.sym_vector
    soften = algebra.compliance_with_springs
    contact, book_losses = contact_solver(dim, friction), contact_losses(dim, friction)
    num_sym = dim * (dim + 1) // 2

    # Columns of terms, with velocities relative to jump_h / (h theta): the squared speed beyond
    # which damage grows, jump_h / (h theta), P / k, beta_m k, and the packed W~.
    limit, middle = 0, 1
    push = middle + dim
    spring = push + dim
    soft = spring + 2
    num_terms = soft + num_sym
    # Columns of details.
    mean, start, jump_start, h_theta, k_n, k_t, shift = range(7)
    num_details = shift + dim - 1 if friction else shift

    @njit(inline="always")
    def opening(jump):
        x = max(jump[0], 0.0) ** 2 + jump[1] * jump[1]
        if dim == 3:
            x += jump[2] * jump[2]
        return x

    @njit(inline="always")
    def part(terms, i, first):
        if dim == 2:
            return terms[i, first], terms[i, first + 1]
        return terms[i, first], terms[i, first + 1], terms[i, first + 2]

    @njit(inline="always")
    def shift_of(details, i):
        if dim == 2:
            return (details[i, shift],)
        return details[i, shift], details[i, shift + 1]

    @njit(inline="always")
    def compliance_of(terms, i):
        if dim == 2:
            return terms[i, soft], terms[i, soft + 1], terms[i, soft + 2]
        return (
            terms[i, soft], terms[i, soft + 1], terms[i, soft + 2],
            terms[i, soft + 3], terms[i, soft + 4], terms[i, soft + 5],
        )  # fmt: skip

    @njit(inline="always")
    def set_damage(i, beta, s, terms, details):
        details[i, mean] = beta
        terms[i, spring] = beta * details[i, k_n]
        terms[i, spring + 1] = beta * details[i, k_t]
        for j in range(num_sym):
            terms[i, soft + j] = s[j]

    @njit(**LEAN_INNER)
    def prepare(i, jump, velocity, w, area, step, theta, parameters, state, terms, details):
        scaled = step * theta
        for j in range(dim):
            jump_h = jump[j] + step * (1.0 - theta) * velocity[j]
            terms[i, middle + j] = jump_h / scaled
            terms[i, push + j] = ((1.0 - theta) * jump[j] + theta * jump_h) / (scaled * theta)
        if friction:
            for j in range(1, dim):
                details[i, shift + j - 1] = (1.0 - theta) / theta * velocity[j]
        beta = state[i, DAMAGE]
        reach = max(state[i, OPENING_MAX], parameters[i, D0]) / scaled
        terms[i, limit] = np.inf if (beta == 0.0 or lagged) else reach * reach
        details[i, start] = beta
        details[i, jump_start] = np.sqrt(opening(jump))
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

    @njit(inline="always")
    def solve(i, u, r, w, parameters, terms, details):
        jump_h, p = part(terms, i, middle), part(terms, i, push)
        k = (terms[i, spring], terms[i, spring + 1])
        s = compliance_of(terms, i)
        new = subtract(u, sym_vector(s, add(r, bonded(k, p, u))))
        if new[0] >= -jump_h[0]:
            return scale(-1.0, bonded(k, p, new)), True
        if friction:
            new, impulse = with_contact(
                new, s, k, p, -jump_h[0], shift_of(details, i), parameters[i, MU]
            )
        else:
            new, impulse = with_contact(new, s, k, p, -jump_h[0], (0.0,), 0.0)
        return impulse, r[0] > 0.0 and impulse[0] > 0.0

    @njit(inline="always")
    def evolve(i, u, w, parameters, terms, details):
        speed = opening(add(part(terms, i, middle), u))
        if speed <= terms[i, limit]:
            lost = details[i, start] - details[i, mean]
            return -lost / details[i, start] if lost > 0.0 else 0.0
        x_max = max(details[i, h_theta] * np.sqrt(terms[i, limit]), parameters[i, D0])
        beta = mean_damage(
            details[i, h_theta] * np.sqrt(speed), details[i, jump_start], x_max,
            details[i, start], parameters[i, D0], parameters[i, DC], parameters[i, BETA0],
        )  # fmt: skip
        fall = details[i, mean] - beta
        if fall <= 0.0:
            return fall / details[i, start]
        s = soften(sym_row(w, i), beta * details[i, k_n], beta * details[i, k_t])
        set_damage(i, beta, s, terms, details)
        return fall / details[i, start]

    @njit(**LEAN_INNER)
    def commit(i, jump0, jump1, u, r, area, step, theta, parameters, state, terms, details, energy):
        c_n, c_t = parameters[i, C_N], parameters[i, C_T]
        d0, dc, beta0 = parameters[i, D0], parameters[i, DC], parameters[i, BETA0]
        old = details[i, start]
        x1 = np.sqrt(opening(jump1))
        reached = max(state[i, OPENING_MAX], x1)
        new = min(old, damage(reached, d0, dc, beta0))
        beta = old
        if not lagged:
            x_max = max(state[i, OPENING_MAX], d0)
            beta = mean_damage(x1, details[i, jump_start], x_max, old, d0, dc, beta0)
            beta = min(beta, details[i, mean])
            new = min(new, beta)
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
        state[i, OPENING_MAX] = reached
        state[i, DAMAGE] = new
        numerical = (theta - 0.5) * beta * area * dot(moved, diagonal(c_n, c_t, moved))
        return book_losses(i, hat, moved, step, pressing, numerical, parameters, energy)

    @njit(inline="always")
    def stored(i, jump, area, parameters, state):
        tractions = diagonal(parameters[i, C_N], parameters[i, C_T], jump)
        return 0.5 * area * state[i, DAMAGE] * dot(jump, tractions)

    effects = [
        ("cohesion", 6 + dim + num_sym),  # C, P / k, beta_m k, W~, k
        ("damage", 10),  # d0, dc, beta0, state, limit, mean to h_theta
        ("unilateral contact", dim),  # jump_h / (h theta)
    ]
    if friction:
        effects += [("friction", dim)]  # mu, shift
    return LawKernels(
        name="cohesive zone with friction" if friction else "cohesive zone",
        effects=tuple(effects),
        components=dim,
        prepare=prepare,
        solve=solve,
        evolve=None if lagged else evolve,
        commit=commit,
        num_terms=num_terms,
        num_details=num_details,
        state_names=("opening_max", "damage"),
        energies=ENERGIES,
        spent=spent_share,
        stored=stored,
    )
