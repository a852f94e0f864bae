# SPDX-License-Identifier: LGPL-3.0-or-later
"""Laws from outside the package, kernels and all: a bond that softens linearly, and a weld.

The traction of the first is R = beta k U (k in Pa/m, the same along the normal and along the
tangent) with a damage beta that makes it fall on a straight line from the strength s to zero:

    beta(x) = 1                                  x <= d0 = s / k,
            = (d0 / x) (df - x) / (df - d0)      d0 < x < df = 2 w / s,
            = 0                                  x >= df,

x = sqrt(<U_N>+^2 + |U_T|^2) being the largest opening reached (Camacho and Ortiz 1996). The area
under the curve is w. Lips touch without friction and do not penetrate.

Over a step the traction is taken at U_theta = theta U1 + (1 - theta) U0 with the mean damage

    beta_m = 2 / (x1^2 - x0^2) int beta x dx from x0 to x1,

so that a bond that opens spends w whatever the step.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

import xper_fx as xf
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.laws.contact_solver import contact_solver
from xper_fx.nscd.laws.law import LawKernels
from xper_fx.support.checks import require_positive


@dataclass(frozen=True)
class LinearSoftening:
    """Bond whose traction falls linearly.

    Args:
        stiffness: k (Pa/m).
        strength: s (Pa).
        fracture_energy: w (J/m^2).

    Raises:
        ValueError: a number that is not positive, or df <= d0.
    """

    stiffness: float
    strength: float
    fracture_energy: float

    def __post_init__(self):
        for name in ("stiffness", "strength", "fracture_energy"):
            require_positive(name, getattr(self, name))
        least = 0.5 * self.strength**2 / self.stiffness
        if self.fracture_energy <= least:
            raise ValueError(
                f"fracture_energy {self.fracture_energy:g} J/m^2 should exceed s^2 / (2 k) = "
                f"{least:g} J/m^2, the energy at the peak; raise it or the stiffness."
            )

    def kernels(self, dim: int) -> LawKernels:
        """See `Law`."""
        return softening_kernels(dim, damage, mean_damage, spent)

    def parameters(self) -> tuple[float, ...]:
        """k (Pa/m), d0, df (m)."""
        d0, df = self.strength / self.stiffness, 2.0 * self.fracture_energy / self.strength
        return self.stiffness, d0, df

    def initial_state(self) -> tuple[float, ...]:
        """Largest opening so far (m) and damage."""
        return 0.0, 1.0


K, D0, DF = range(3)  # columns of parameters
REACHED, DAMAGE = range(2)  # columns of state


@xf.njit
def damage(x, d0, df):
    """Damage of a bond opened monotonically to x (m)."""
    if x <= d0:
        return 1.0
    return 0.0 if x >= df else d0 / x * (df - x) / (df - d0)


@xf.njit
def mean_damage(x1, x0, reached, beta, d0, df):
    """Mean over x^2 from x0 to x1 (m) of a bond that had reached an opening, and damage beta."""
    start, top = max(reached, d0), min(x1, df)
    if x1 <= start or beta == 0.0:
        return beta  # on the secant
    spent = beta * (start * start - x0 * x0)
    if top > start:
        spent += d0 / (df - d0) * (top - start) * (2.0 * df - top - start)
    return spent / (x1 * x1 - x0 * x0)


def spent(parameters, state):
    """1 - T / s, as w - T df / 2 is spent where the traction is T."""
    d0, df = parameters[:, D0], parameters[:, DF]
    return np.clip((state[:, REACHED] - d0) / (df - d0), 0.0, 1.0)


@cache
def softening_kernels(dim: int, damage, mean_damage, spent) -> LawKernels:
    """The kernels of a bond that softens by `damage`, as that above; parameters k and two more."""
    algebra = for_dimension(dim)
    dot, add, subtract, scale = algebra.dot, algebra.add, algebra.subtract, algebra.scale
    sym_row, sym_vector = algebra.sym_row, algebra.sym_vector
    row, soften = algebra.row, algebra.compliance_with_springs
    contact = contact_solver(dim, False)
    num_sym = dim * (dim + 1) // 2

    # Columns of terms: P / (k beta_m), the least normal velocity, k beta_m, W~.
    least, spring, soft = dim, dim + 1, dim + 2
    # Columns of details: the jump in the middle of the step, the mean damage, damage and opening
    # at the start, the largest opening before, h theta, and h^2 theta^2 A k.
    mean, old, start, reached, scaled, sound = range(dim, dim + 6)

    @xf.njit(inline="always")
    def opening(jump):
        return np.sqrt(dot(jump, jump) - min(jump[0], 0.0) ** 2)

    @xf.njit(inline="always")
    def compliance_of(terms, i):
        if dim == 2:
            return terms[i, soft], terms[i, soft + 1], terms[i, soft + 2]
        return (
            terms[i, soft], terms[i, soft + 1], terms[i, soft + 2],
            terms[i, soft + 3], terms[i, soft + 4], terms[i, soft + 5],
        )  # fmt: skip

    @xf.njit(inline="always")
    def set_damage(i, beta, w, terms, details):
        details[i, mean] = beta
        terms[i, spring] = beta * details[i, sound]
        softened = soften(sym_row(w, i), terms[i, spring], terms[i, spring])
        for j in range(num_sym):
            terms[i, soft + j] = softened[j]

    @xf.njit(forceinline=True)
    def prepare(i, jump, velocity, w, area, step, theta, parameters, state, terms, details):
        h_theta = step * theta
        for j in range(dim):
            middle = jump[j] + step * (1.0 - theta) * velocity[j]
            details[i, j] = middle
            terms[i, j] = ((1.0 - theta) * jump[j] + theta * middle) / (h_theta * theta)
        terms[i, least] = -details[i, 0] / h_theta
        details[i, old], details[i, reached] = state[i, DAMAGE], state[i, REACHED]
        details[i, start] = opening(jump)
        details[i, scaled], details[i, sound] = h_theta, h_theta**2 * area * parameters[i, K]
        set_damage(i, state[i, DAMAGE], w, terms, details)

    @xf.njit(inline="always")
    def bonded(i, u, terms):
        """Impulse with which the bond pulls the lips together."""
        return scale(terms[i, spring], add(row(terms, i), u))

    @xf.njit(inline="always")
    def solve(i, u, r, w, parameters, terms, details):
        s = compliance_of(terms, i)
        free = subtract(u, sym_vector(s, add(r, bonded(i, u, terms))))
        if free[0] >= terms[i, least]:
            return scale(-1.0, bonded(i, free, terms)), True
        push, _ = contact(free, s, terms[i, least], (0.0,), 0.0, 0.0)
        new = add(free, sym_vector(s, push))
        return subtract(push, bonded(i, new, terms)), False

    @xf.njit(inline="always")
    def mean_of(i, x1, parameters, details):
        return mean_damage(
            x1, details[i, start], details[i, reached], details[i, old],
            parameters[i, D0], parameters[i, DF],
        )  # fmt: skip

    @xf.njit(inline="always")
    def evolve(i, u, w, parameters, terms, details):
        if details[i, old] == 0.0:
            return 0.0
        x1 = opening(add(row(details, i), scale(details[i, scaled], u)))
        fall = (details[i, mean] - mean_of(i, x1, parameters, details)) / details[i, old]
        if fall > 0.0:
            set_damage(i, details[i, mean] - fall * details[i, old], w, terms, details)
        return fall

    @xf.njit(forceinline=True)
    def commit(i, jump0, jump1, u, r, area, step, theta, parameters, state, terms, details, energy):
        x1 = opening(jump1)
        beta = min(details[i, mean], mean_of(i, x1, parameters, details))
        state[i, REACHED] = max(state[i, REACHED], x1)
        new = min(beta, damage(state[i, REACHED], parameters[i, D0], parameters[i, DF]))
        state[i, DAMAGE] = new
        push = add(r, bonded(i, u, terms))
        moved = subtract(jump1, jump0)
        stiffness = area * parameters[i, K]
        e0, e1 = 0.5 * stiffness * dot(jump0, jump0), 0.5 * stiffness * dot(jump1, jump1)
        energy[i, 0] = new * e1  # stored
        energy[i, 1] = (beta - new) * e1 + (details[i, old] - beta) * e0  # cohesion
        energy[i, 2] = (theta - 0.5) * beta * stiffness * dot(moved, moved)  # numerical
        energy[i, 2] -= dot(push, moved) / step
        return 2 if push[0] > 0.0 else 0

    @xf.njit(inline="always")
    def stored(i, jump, area, parameters, state):
        return 0.5 * area * parameters[i, K] * state[i, DAMAGE] * dot(jump, jump)

    return LawKernels(
        name="linear softening",
        effects=(("linear softening", dim + 2 + num_sym + dim + 6 + 3 + 2),),
        components=dim,
        prepare=prepare,
        solve=solve,
        evolve=evolve,
        commit=commit,
        num_terms=dim + 2 + num_sym,
        num_details=dim + 6,
        state_names=("opening_max", "damage"),
        energies=("stored", "cohesion", "numerical"),
        spent=spent,
        stored=stored,
    )


@dataclass(frozen=True)
class Weld:
    """Lips that never part: the jump at the end of a step is zero."""

    def kernels(self, dim: int) -> LawKernels:
        """See `Law`."""
        return _weld(dim)

    def parameters(self) -> tuple[float, ...]:
        """There are none."""
        return ()

    def initial_state(self) -> tuple[float, ...]:
        """There is none."""
        return ()


@cache
def _weld(dim: int) -> LawKernels:
    algebra = for_dimension(dim)
    row, set_row, add, scale = algebra.row, algebra.set_row, algebra.add, algebra.scale
    subtract, dot, sym_row, sym_solve = (
        algebra.subtract, algebra.dot, algebra.sym_row, algebra.sym_solve,
    )  # fmt: skip

    @xf.njit
    def prepare(i, jump, velocity, w, area, step, theta, parameters, state, terms, details):
        set_row(terms, i, scale(-1.0 / step, jump))  # the velocity that closes the lips

    @xf.njit(inline="always")
    def solve(i, u, r, w, parameters, terms, details):
        missing = subtract(row(terms, i), u)
        if dot(missing, missing) == 0.0:  # held on both sides, W = 0, or solved
            return r, True
        return add(r, sym_solve(sym_row(w, i), missing)), True

    @xf.njit
    def commit(i, jump0, jump1, u, r, area, step, theta, parameters, state, terms, details, energy):
        energy[i, 0] = -dot(r, subtract(jump1, jump0)) / step
        return 1

    return LawKernels(
        name="weld",
        effects=(("weld", dim),),
        components=dim,
        prepare=prepare,
        solve=solve,
        evolve=None,
        commit=commit,
        num_terms=dim,
        num_details=0,
        state_names=(),
        energies=("numerical",),
        no_jump=True,
    )
