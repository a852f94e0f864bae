# SPDX-License-Identifier: LGPL-3.0-or-later
"""Unilateral contact with Coulomb or Tresca friction and Newton's restitution.

Velocity level (Moreau 1988), right for impacts: a point whose mid-step gap
jump_h = jump0 + h (1 - theta) dU0 is closed obeys

    dU_N + e dU0_N >= 0,  r_N >= 0,  complementary;   friction acts on the end velocity dU_T.

It rests without bouncing, at a constant penetration of at most |dU0| h / 2. A point that pushed
in the last step also counts as closed while its gap is below 1e-3 of what the speed it gave,
W_NN r_N, covers in a step: else the rounding of a gap of zero would let it fall for a step.

Position level, right for lips that were bonded: jump1_N >= 0 at the end of the step, that is
dU_N >= -jump_h,N / (h theta), and friction acts on the mean slip (jump1_T - jump0_T) / h, that is
on dU_T + (1 - theta) / theta dU0_T, so that it never does positive work whatever theta. Nothing
interpenetrates; an impact, however, is conserved by theta = 1/2 and rebounds at each element.

Without friction a point has its normal alone: impulses, jumps, compliances of one number, a frame
of one row, no tangential solve. What slides past is not followed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numba import njit

from xper_fx.nscd.checks import require_non_negative
from xper_fx.nscd.coulomb import contact_solver
from xper_fx.nscd.laws.law import LawKernels
from xper_fx.nscd.small import for_dimension

_V_MIN, _MU, _BOUND, _SHIFT = 0, 1, 2, 3
_RESTITUTION, _FRICTION, _TRESCA = 0, 1, 2  # parameters; without friction the first alone
_IMPACT_WORK, _FRICTION_WORK = 0, 1

# Gap at which a pushing point stays closed, relative to h W_NN r_N of the last step.
_STILL_CLOSED = 1e-3


@dataclass(frozen=True)
class SignoriniCoulomb:
    """Contact without penetration, with Coulomb friction.

    Args:
        friction: Coulomb's mu >= 0; with 0 a point has no tangential component at all.
        restitution: Newton's e in [0, 1], dU_N+ = -e dU_N- (velocity level only).
        contact: "velocity" (impacts) or "position" (bonded lips); see the module docstring.

    Raises:
        ValueError: mu negative or not finite, e outside [0, 1], restitution at position level.
    """

    friction: float = 0.0
    restitution: float = 0.0
    contact: str = "velocity"

    def __post_init__(self):
        require_non_negative("friction", self.friction)
        _check_contact(self.contact, self.restitution)

    def kernels(self, dim: int) -> LawKernels:
        """See `Law`."""
        return contact_kernels(dim, self.friction > 0.0, self.contact)

    def parameters(self) -> tuple[float, ...]:
        """Newton's e, and with friction Coulomb's mu, Tresca's bound (Pa)."""
        return (self.restitution, self.friction, 0.0)[: 3 if self.friction > 0.0 else 1]

    def initial_state(self) -> tuple[float, ...]:
        """Normal impulse of the last step (N s), which the velocity level alone asks for."""
        return _initial_state(self.contact)


@dataclass(frozen=True)
class Tresca:
    """Contact without penetration, with a fixed bound on the tangential stress.

    Args:
        bound: largest tangential stress (Pa) while the point is closed.
        restitution: Newton's e in [0, 1] (velocity level only).
        contact: "velocity" or "position".

    Raises:
        ValueError: bound negative or not finite, e outside [0, 1], restitution at position level.
    """

    bound: float
    restitution: float = 0.0
    contact: str = "velocity"

    def __post_init__(self):
        require_non_negative("bound", self.bound)
        _check_contact(self.contact, self.restitution)

    def kernels(self, dim: int) -> LawKernels:
        """See `Law`."""
        return contact_kernels(dim, self.bound > 0.0, self.contact)

    def parameters(self) -> tuple[float, ...]:
        """Newton's e, and with friction Coulomb's mu, Tresca's bound (Pa)."""
        return (self.restitution, 0.0, self.bound)[: 3 if self.bound > 0.0 else 1]

    def initial_state(self) -> tuple[float, ...]:
        """Normal impulse of the last step (N s), which the velocity level alone asks for."""
        return _initial_state(self.contact)


def _initial_state(contact: str) -> tuple[float, ...]:
    return () if contact == "position" else (0.0,)


def _check_contact(contact: str, restitution: float) -> None:
    if contact not in ("velocity", "position"):
        raise ValueError(f'contact should be "velocity" or "position", got {contact!r}.')
    if not 0.0 <= restitution <= 1.0:
        raise ValueError(f"Newton's restitution should lie in [0, 1], got {restitution}.")
    if contact == "position" and restitution > 0.0:
        raise ValueError(
            f"Restitution {restitution} is a velocity jump: use contact='velocity' with it."
        )


@cache
def contact_kernels(dim: int, friction: bool, contact: str) -> LawKernels:
    """The kernels of unilateral contact, compiled for what the arguments call for."""
    position = contact == "position"
    state_names = () if position else ("pushed",)

    @njit(inline="always")
    def least(i, jump, velocity, w, step, theta, parameters, state):
        """Normal velocity that the point has to have at least (m/s)."""
        middle = jump[0] + step * (1.0 - theta) * velocity[0]
        if position:
            return -middle / (step * theta)
        if middle <= _STILL_CLOSED * step * (w[i, 0] * state[i, 0]):
            return -parameters[i, _RESTITUTION] * min(velocity[0], 0.0)
        return -np.inf

    @njit(inline="always")
    def commit_normal(i, jump0, jump1, r, step, state, energy):
        energy[i, _IMPACT_WORK] = -r[0] * (jump1[0] - jump0[0]) / step
        if not position:
            state[i, 0] = r[0]

    if not friction:
        prepare, solve, commit = _normal_kernels(least, commit_normal)
        return LawKernels(
            name="frictionless contact",
            effects=("unilateral contact",),
            components=1,
            prepare=prepare,
            solve=solve,
            evolve=None,
            commit=commit,
            num_terms=1,
            num_details=0,
            state_names=state_names,
            energies=("impact",),
        )

    algebra = for_dimension(dim)
    sym_row, sym_vector = algebra.sym_row, algebra.sym_vector
    subtract = algebra.subtract
    local = contact_solver(dim, friction)

    @njit
    def prepare(i, jump, velocity, w, area, step, theta, parameters, state, terms, details):
        terms[i, _V_MIN] = least(i, jump, velocity, w, step, theta, parameters, state)
        terms[i, _MU] = parameters[i, _FRICTION]
        terms[i, _BOUND] = step * area * parameters[i, _TRESCA]
        lag = (1.0 - theta) / theta if position else 0.0
        for j in range(1, dim):
            terms[i, _SHIFT + j - 1] = lag * velocity[j]

    @njit(inline="always")
    def solve(i, u, r, w, parameters, terms, details):
        wi = sym_row(w, i)
        b = subtract(u, sym_vector(wi, r))
        shift = (terms[i, _SHIFT],) if dim == 2 else (terms[i, _SHIFT], terms[i, _SHIFT + dim - 2])
        r_new, _ = local(b, wi, terms[i, _V_MIN], shift, terms[i, _MU], terms[i, _BOUND])
        return r_new, False

    @njit
    def commit(i, jump0, jump1, u, r, area, step, theta, parameters, state, terms, details, energy):
        commit_normal(i, jump0, jump1, r, step, state, energy)
        work_t = 0.0
        size = 0.0
        for j in range(1, dim):
            work_t += r[j] * (jump1[j] - jump0[j]) / step
            size += r[j] * r[j]
        energy[i, _FRICTION_WORK] = -work_t
        if r[0] <= 0.0 and size == 0.0:
            return 0
        limit = terms[i, _MU] * r[0] + terms[i, _BOUND]
        return 2 if size >= (1.0 - 1e-12) * limit * limit else 1

    return LawKernels(
        name="contact with friction",
        effects=("unilateral contact", "friction"),
        components=dim,
        prepare=prepare,
        solve=solve,
        evolve=None,
        commit=commit,
        num_terms=_SHIFT + dim - 1,
        num_details=0,
        state_names=state_names,
        energies=("impact", "friction"),
    )


def _normal_kernels(least, commit_normal):
    """`prepare`, `solve` and `commit` of contact without friction, in the normal component."""

    @njit
    def prepare(i, jump, velocity, w, area, step, theta, parameters, state, terms, details):
        terms[i, _V_MIN] = least(i, jump, velocity, w, step, theta, parameters, state)

    @njit(inline="always")
    def solve(i, u, r, w, parameters, terms, details):
        compliance, v_min = w[i, 0], terms[i, _V_MIN]
        b = u[0] - compliance * r[0]
        # a compliance of zero: both sides are prescribed
        if b >= v_min or compliance == 0.0:
            return (0.0,), False
        return ((v_min - b) / compliance,), False

    @njit
    def commit(i, jump0, jump1, u, r, area, step, theta, parameters, state, terms, details, energy):
        commit_normal(i, jump0, jump1, r, step, state, energy)
        return 2 if r[0] > 0.0 else 0

    return prepare, solve, commit
