# SPDX-License-Identifier: LGPL-3.0-or-later
"""Unilateral contact with Coulomb or Tresca friction and Newton's restitution.

Velocity level (Moreau 1988), right for impacts: a point whose mid-step gap
jump_h = jump0 + h (1 - theta) dU0 is closed obeys

    dU_N + e dU0_N >= 0,  r_N >= 0,  complementary;   friction acts on the end velocity dU_T.

That holds for a point that was opening too (dU0_N > 0) and that another impact pushes back: with
one e for all points (v+ + e v-) / (1 + e) is then the projection of v- on the motions that open
them, and an impact without friction loses (1 - e) / (1 + e) of the kinetic energy of v+ - v-.
Asking such a point for dU_N >= 0 would give it energy, a third of a bouncing stack's in one step.

**Along the tangent** restitution may act too, e_T = e (Moreau 1988; Fremond 1995). Signorini and
Coulomb then hold for the mean velocity V = (dU + e dU0) / (1 + e) as a whole: friction opposes V_T,
and an impact that sticks ends with dU_T = -e dU0_T. With dU - dU0 = W r over all points the work of
the impulses,

    r . (theta dU + (1 - theta) dU0) = r . V - (1/(1 + e) - theta) r . W r,

is never positive while theta <= 1 / (1 + e), for r . V <= 0 by the law, whatever the number of
points and their coupling. With e_T != e no such form is known: r . D W r, D the diagonal of the
two numbers (1 - e) / (1 + e), is of either sign where W couples normal and tangent. That holds for
e_T = 0 beside e > 0 as well, the default: an impact that turns the slip round may gain energy
(Kane and Levinson 1985).

It rests without bouncing, at a constant penetration of at most |dU0| h / 2. A point that pushed
in the last step also counts as closed while its gap is below 1e-3 of what the speed it gave,
W_NN r_N, covers in a step: else what a solver leaves of a gap would let it fall for a step. Facets
that touch but for rounding are closed, too (`law_loops.py`).

A point that arrives loses r_N (1 - e) |dU0_N| / 2, whatever theta is (`stepped_points.py`). One
that was leaving (dU0_N > 0) and is pressed back gains at most r_N dU0_N / 2, and one whose slip a
force turns round in the step (1 - theta) |r_T| |dU0_T|, of the order of the step.

Position level, right for lips that were bonded: jump1_N >= 0 at the end of the step, that is
dU_N >= -jump_h,N / (h theta), and friction acts on the mean slip (jump1_T - jump0_T) / h, that is
on dU_T + (1 - theta) / theta dU0_T, so that it never does positive work whatever theta. Nothing
interpenetrates; an impact, however, is conserved by theta = 1/2 and rebounds at each element.

Without friction a point has its normal alone: impulses, jumps, compliances of one number, a frame
of one row, no tangential solve. What slides past is not followed: jumps and velocities read zero
along the tangent.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.kernel_options import LEAN_INNER
from xper_fx.nscd.laws.contact_solver import contact_solver
from xper_fx.nscd.laws.law import CoulombPoints, LawKernels
from xper_fx.nscd.laws.parameters import Values, acts, is_field, refuse_where, take_parameters

# Columns of terms; all but the first are there with friction alone.
_V_MIN, _MU, _BOUND, _SHIFT = 0, 1, 2, 3
_IMPACT_WORK, _FRICTION_WORK = 0, 1  # columns of energy


@dataclass(frozen=True)
class SignoriniCoulomb:
    """Contact without penetration, with Coulomb friction.

    Parameters are numbers or fields (`xper_fx/nscd/laws/fields.py`).

    Args:
        friction: Coulomb's mu >= 0; with 0 a point has no tangential component at all.
        restitution: Newton's e in [0, 1], dU_N+ = -e dU_N- (velocity level only).
        contact: "velocity" (impacts) or "position" (bonded lips); see the module docstring.
        tangential_restitution: e_T, dU_T+ = -e_T dU_T- of an impact that sticks, 0 or equal to the
            restitution.
        rolling: mu_r >= 0, of contacts of discs or spheres at the velocity level: the couple
            against their relative spin is at most mu_r R r_N, R the effective radius
            (`rolling.py`).

    Raises:
        ValueError: a number negative or not finite, e outside [0, 1], restitution or rolling
            resistance at position level, rolling resistance without friction, two restitutions
            that differ.
    """

    friction: Any = 0.0
    restitution: Any = 0.0
    contact: str = "velocity"
    tangential_restitution: Any = 0.0
    rolling: Any = 0.0

    def __post_init__(self) -> None:
        names = ("friction", "restitution", "tangential_restitution", "rolling")
        if take_parameters(self, non_negative=names):
            check_contact(self.contact, self.restitution)
        self._check_tangential_restitution()
        if acts(self.rolling) and not (acts(self.friction) and self.contact == "velocity"):
            raise ValueError(
                f"Rolling resistance (rolling={self.rolling}) goes with friction at the velocity "
                f'level: give friction > 0 and contact="velocity", got friction={self.friction}, '
                f"contact={self.contact!r}."
            )

    def _check_tangential_restitution(self) -> None:
        e, along = self.restitution, self.tangential_restitution
        if not acts(along):
            return
        e, along = (x.values if isinstance(x, Values) else x for x in (e, along))
        if is_field(e) or is_field(along):
            same = e == along
        else:
            same = np.all(np.equal(e, along))
        if not same:
            raise ValueError(
                "tangential_restitution should be 0 or equal to restitution: with two that differ "
                "an impact with friction may gain energy, with one the law on the mean velocity "
                f"(dU+ + e dU-) / (1 + e) never does. Got {along} and {e}."
            )
        if acts(self.rolling):
            raise ValueError(
                "tangential_restitution and rolling exclude each other: the couple acts on the "
                "spin at the end of an impact, not on its mean, and the impact may gain energy."
            )
        if not acts(self.friction):
            raise ValueError(
                f"tangential_restitution ({along}) needs friction: without it nothing acts along "
                "the tangent. Give friction > 0."
            )

    def kernels(self, dim: int) -> LawKernels:
        """See `Law`."""
        return contact_kernels(
            dim,
            acts(self.friction),
            self.contact,
            acts(self.tangential_restitution),
            acts(self.rolling),
        )

    def parameters(self) -> tuple:
        """See `_parameters`; then mu_r with rolling resistance."""
        given = _parameters(self.contact, self.restitution, self.friction, 0.0)
        return (*given, self.rolling) if acts(self.rolling) else given

    def initial_state(self) -> tuple[float, ...]:
        """See `_initial_state`."""
        return _initial_state(self.contact)


@dataclass(frozen=True)
class Tresca:
    """Contact without penetration, with a fixed bound on the tangential stress.

    Parameters are numbers or fields (`xper_fx/nscd/laws/fields.py`).

    Args:
        bound: largest tangential stress (Pa) while the point is closed.
        restitution: Newton's e in [0, 1] (velocity level only).
        contact: "velocity" or "position".

    Raises:
        ValueError: bound negative or not finite, e outside [0, 1], restitution at position level.
    """

    bound: Any
    restitution: Any = 0.0
    contact: str = "velocity"

    def __post_init__(self) -> None:
        if take_parameters(self, non_negative=("bound", "restitution")):
            check_contact(self.contact, self.restitution)

    def kernels(self, dim: int) -> LawKernels:
        """See `Law`."""
        return contact_kernels(dim, acts(self.bound), self.contact)

    def parameters(self) -> tuple:
        """See `_parameters`."""
        return _parameters(self.contact, self.restitution, 0.0, self.bound)

    def initial_state(self) -> tuple[float, ...]:
        """See `_initial_state`."""
        return _initial_state(self.contact)


def _parameters(contact: str, restitution: Any, mu: Any, bound: Any) -> tuple:
    """Newton's e at velocity level; with friction Coulomb's mu and Tresca's bound (Pa)."""
    impact = (restitution,) if contact == "velocity" else ()
    return (*impact, mu, bound) if acts(mu) or acts(bound) else impact


def _initial_state(contact: str) -> tuple[float, ...]:
    """At velocity level the normal impulse of the last step (N s)."""
    return (0.0,) if contact == "velocity" else ()


def check_contact(contact: str, restitution: Any) -> None:
    """Raise a ValueError unless level and restitution of a contact go together."""
    if contact not in ("velocity", "position"):
        raise ValueError(f'contact should be "velocity" or "position", got {contact!r}.')
    refuse_where(
        np.asarray(restitution) > 1.0,
        lambda at: f"Newton's restitution should lie in [0, 1], got {at(restitution)}.",
    )
    if contact == "position" and np.any(restitution):
        raise ValueError(
            f"Restitution {restitution} is a velocity jump: use contact='velocity' with it."
        )


@cache
def contact_kernels(
    dim: int, friction: bool, contact: str, rebounds_along: bool = False, rolls: bool = False
) -> LawKernels:
    """The kernels of unilateral contact, compiled for what the arguments call for."""
    components = dim if friction else 1
    algebra = for_dimension(dim, components)
    sym_row, sym_vector = algebra.sym_row, algebra.sym_vector
    subtract, tangent_part = algebra.subtract, algebra.tangent_part
    local = contact_solver(components, friction)
    impact = contact == "velocity"
    if impact:
        from xper_fx.nscd.laws.impact import least_speed
    # parameters: Newton's e with impact; mu and Tresca's bound with friction
    e, mu = 0, int(impact)
    tresca = mu + 1
    rolling = None
    if rolls:
        from xper_fx.nscd.laws.rolling import rolling_kernels

        rolling = rolling_kernels(dim, tresca + 1)

    @njit(**LEAN_INNER)
    def prepare(i, jump, velocity, w, area, step, theta, parameters, state, terms, details):
        middle = jump[0] + step * (1.0 - theta) * velocity[0]
        if impact:
            pushed = w[i, 0] * state[i, 0]
            terms[i, _V_MIN] = least_speed(middle, velocity[0], step, pushed, parameters[i, e])
        else:
            terms[i, _V_MIN] = -middle / (step * theta)
        if friction:
            terms[i, _MU] = parameters[i, mu]
            terms[i, _BOUND] = step * area * parameters[i, tresca]
            lag = 0.0 if impact else (1.0 - theta) / theta
            if rebounds_along:
                lag = parameters[i, e]
            for j in range(1, dim):
                terms[i, _SHIFT + j - 1] = lag * velocity[j]

    @njit(inline="always")
    def solve(i, u, r, w, parameters, terms, details):
        wi = sym_row(w, i)
        b = subtract(u, sym_vector(wi, r))
        if friction:
            shift = tangent_part(terms, i, _SHIFT)
            r_new, _ = local(b, wi, terms[i, _V_MIN], shift, terms[i, _MU], terms[i, _BOUND])
        else:
            r_new, _ = local(b, wi, terms[i, _V_MIN], (0.0,), 0.0, 0.0)
        return r_new, False

    @njit(**LEAN_INNER)
    def commit(i, jump0, jump1, u, r, area, step, theta, parameters, state, terms, details, energy):
        energy[i, _IMPACT_WORK] = -r[0] * (jump1[0] - jump0[0]) / step
        if impact:
            state[i, 0] = r[0]
        if not friction:
            return 2 if r[0] > 0.0 else 0
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

    def coulomb(terms, details, parameters):
        none = np.zeros(len(terms))
        if not friction:
            return CoulombPoints(terms[:, _V_MIN], np.zeros((len(terms), dim - 1)), *[none] * 3)
        shift = terms[:, _SHIFT : _SHIFT + dim - 1]
        return CoulombPoints(terms[:, _V_MIN], shift, terms[:, _MU], terms[:, _BOUND], none)

    name = "contact with friction" if friction else "frictionless contact"
    effects = [("unilateral contact", 1)]
    if impact:
        effects += [("impact", 2)]
    if friction:
        effects += [("friction", dim + 3)]
    if rolls:
        name += " and rolling resistance"
        effects += [("rolling resistance", 1)]
    return LawKernels(
        name=name,
        effects=tuple(effects),
        components=components,
        prepare=prepare,
        solve=solve,
        commit=commit,
        num_terms=_SHIFT + dim - 1 if friction else 1,
        state_names=("pushed",) if impact else (),
        energies=("impact", "friction") if friction else ("impact",),
        coulomb=None if rolls else coulomb,
        rolling=rolling,
    )
