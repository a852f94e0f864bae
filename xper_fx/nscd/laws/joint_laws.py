# SPDX-License-Identifier: LGPL-3.0-or-later
"""Laws of the rows of joints between rigid bodies: held, stop, sliding friction, elastic wire.

A row (`nscd/rigid/joint_rows.py`) is a point with a normal alone. Its gap g is read in the middle
of the step, and U_N = dg/dt; with G = jump0 + h (1 - theta) U0 the gap there, that of the middle of
the next step is, to first order in the angle by which bodies turn in a step,

    g_next = G + h U1.

**Held**: g_next = 0, that is U1 = -G / h, whatever impulse it takes. With the bend of the path that
`simulation/jointed_bodies.py` adds to G this is SHAKE (Ryckaert, Ciccotti and Berendsen 1977) in
the middles of the steps, where Moreau's drift, kick, drift is a leapfrog: exact at the position
level, symplectic and symmetric in time for theta = 1/2, so that neither gaps nor energy drift.

**Stop** (the end of a joint's travel, an inextensible wire): g_next >= 0, r >= 0, complementary. A
row that arrives, G + h U0 <= 0, with a restitution e > 0 ends at U1 >= -e U0. One that was taut in
the last step, r > 0 at a gap below 1e-3 h W r, arrives no more: what is left of its U0 is the bend
of its path, and not an impact.

**Sliding friction**: |r| <= h B against the end velocity, B in N or N m.

**Elastic wire**: the energy Phi(g) = k min(g, 0)^2 / 2 is convex, and the impulse is its mean slope
over the step (a discrete gradient, Gonzalez 1996),

    r = -h [Phi(g1) - Phi(g0)] / (g1 - g0),   g0 = jump0,  g1 = g0 + h [theta U1 + (1 - theta) U0],

so that its work is the change of Phi to rounding, where it becomes taut or slack in the step too.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_INNER
from xper_fx.nscd.laws.law import LawKernels

# Gap at which a pulling row counts as taut, relative to h W r.
_TAUT = 1e-3
_EFFECT = "joints"


@dataclass(frozen=True)
class Held:
    """The gap stays zero."""

    def kernels(self, dim: int) -> LawKernels:
        """See `Law`."""
        return _held()

    def parameters(self) -> tuple[float, ...]:
        """None."""
        return ()

    def initial_state(self) -> tuple[float, ...]:
        """None."""
        return ()


@dataclass(frozen=True)
class Stop:
    """The gap does not become negative."""

    restitution: float = 0.0  #: Newton's e in [0, 1]

    def kernels(self, dim: int) -> LawKernels:
        """See `Law`."""
        return _stop()

    def parameters(self) -> tuple[float, ...]:
        """Newton's e."""
        return (self.restitution,)

    def initial_state(self) -> tuple[float, ...]:
        """Whether it was taut in the last step."""
        return (0.0,)


@dataclass(frozen=True)
class SlidingFriction:
    """A bounded force against the velocity."""

    bound: float  #: N; N m of a rotation

    def kernels(self, dim: int) -> LawKernels:
        """See `Law`."""
        return _sliding_friction()

    def parameters(self) -> tuple[float, ...]:
        """The bound."""
        return (self.bound,)

    def initial_state(self) -> tuple[float, ...]:
        """None."""
        return ()


@dataclass(frozen=True)
class ElasticWire:
    """A spring in tension alone, whose elongation is -g."""

    stiffness: float  #: k, N/m
    tension: float  #: at the start, N; negative: k times the slack

    def kernels(self, dim: int) -> LawKernels:
        """See `Law`."""
        return _elastic_wire()

    def parameters(self) -> tuple[float, ...]:
        """The stiffness."""
        return (self.stiffness,)

    def initial_state(self) -> tuple[float, ...]:
        """The energy stored (J)."""
        return (0.5 * max(self.tension, 0.0) ** 2 / self.stiffness,)


def _kernels(name, prepare, solve, commit, num_terms, states, energies) -> LawKernels:
    return LawKernels(
        name=name,
        effects=((_EFFECT, num_terms + len(states)),),
        components=1,
        prepare=prepare,
        solve=solve,
        commit=commit,
        num_terms=num_terms,
        state_names=states,
        energies=energies,
    )


@cache
def _held() -> LawKernels:
    @njit(**LEAN_INNER)
    def prepare(i, jump, velocity, w, area, step, theta, parameters, state, terms, details):
        terms[i, 0] = -(jump[0] + step * (1.0 - theta) * velocity[0]) / step

    @njit(inline="always")
    def solve(i, u, r, w, parameters, terms, details):
        if w[i, 0] <= 0.0:  # both sides are driven
            return (0.0,), True
        return (r[0] + (terms[i, 0] - u[0]) / w[i, 0],), True

    @njit(**LEAN_INNER)
    def commit(i, jump0, jump1, u, r, area, step, theta, parameters, state, terms, details, energy):
        energy[i, 0] = -r[0] * (jump1[0] - jump0[0]) / step
        return 1

    return _kernels("held joint", prepare, solve, commit, 1, (), ("numerical",))


@cache
def _stop() -> LawKernels:
    @njit(**LEAN_INNER)
    def prepare(i, jump, velocity, w, area, step, theta, parameters, state, terms, details):
        gap = jump[0] + step * (1.0 - theta) * velocity[0]
        arrives = state[i, 0] == 0.0 and velocity[0] < 0.0 and gap + step * velocity[0] <= 0.0
        if arrives and parameters[i, 0] > 0.0:
            terms[i, 0] = -parameters[i, 0] * velocity[0]
        else:
            terms[i, 0] = -gap / step
        terms[i, 1] = w[i, 0]

    @njit(inline="always")
    def solve(i, u, r, w, parameters, terms, details):
        if w[i, 0] <= 0.0:
            return (0.0,), False
        return (max(0.0, r[0] + (terms[i, 0] - u[0]) / w[i, 0]),), False

    @njit(**LEAN_INNER)
    def commit(i, jump0, jump1, u, r, area, step, theta, parameters, state, terms, details, energy):
        lost = -r[0] * (jump1[0] - jump0[0]) / step
        energy[i, 0] = 0.0 if state[i, 0] > 0.0 else lost
        energy[i, 1] = lost if state[i, 0] > 0.0 else 0.0
        gap = jump1[0] - step * theta * u[0]
        state[i, 0] = 0.0
        if r[0] > 0.0 and gap <= _TAUT * step * terms[i, 1] * r[0]:
            state[i, 0] = 1.0
        return 2 if r[0] > 0.0 else 0

    return _kernels(
        "stop of a joint", prepare, solve, commit, 2, ("taut",), ("impact", "numerical")
    )


@cache
def _sliding_friction() -> LawKernels:
    @njit(**LEAN_INNER)
    def prepare(i, jump, velocity, w, area, step, theta, parameters, state, terms, details):
        terms[i, 0] = step * parameters[i, 0]

    @njit(inline="always")
    def solve(i, u, r, w, parameters, terms, details):
        if w[i, 0] <= 0.0:
            return (0.0,), False
        bound = terms[i, 0]
        return (min(bound, max(-bound, r[0] - u[0] / w[i, 0])),), False

    @njit(**LEAN_INNER)
    def commit(i, jump0, jump1, u, r, area, step, theta, parameters, state, terms, details, energy):
        energy[i, 0] = -r[0] * (jump1[0] - jump0[0]) / step
        return 2 if abs(r[0]) >= terms[i, 0] else 1

    return _kernels("friction of a joint", prepare, solve, commit, 1, (), ("friction",))


@cache
def _elastic_wire() -> LawKernels:
    @njit(**LEAN_INNER)
    def prepare(i, jump, velocity, w, area, step, theta, parameters, state, terms, details):
        terms[i, 0] = jump[0]
        terms[i, 1] = jump[0] + step * (1.0 - theta) * velocity[0]
        terms[i, 2] = step * theta
        terms[i, 3] = 0.5 * step * parameters[i, 0]

    @njit(inline="always")
    def solve(i, u, r, w, parameters, terms, details):
        start, stiffness = terms[i, 0], terms[i, 3]
        # g1 = free + rate r
        rate = terms[i, 2] * w[i, 0]
        free = terms[i, 1] + terms[i, 2] * u[0] - rate * r[0]
        kappa = rate * stiffness
        if start >= 0.0:
            if free >= 0.0:
                return (0.0,), False
            # taut at the end: (1 + kappa) g1^2 - (g0 + free) g1 + g0 free = 0, of which g1 < 0
            b = start + free
            root = np.sqrt(b * b - 4.0 * (1.0 + kappa) * start * free)
            end = 0.5 * (b - root) / (1.0 + kappa)
            return (stiffness * end * end / (start - end),), False
        if free - kappa * start <= 0.0:  # taut throughout
            return (-stiffness * (start + free) / (1.0 + kappa),), False
        # slack at the end: (g1 - free) (g1 - g0) = kappa g0^2, of which g1 > 0
        difference = free - start
        end = 0.5 * (free + start + np.sqrt(difference * difference + 4.0 * kappa * start * start))
        return (stiffness * start * start / (end - start),), False

    @njit(**LEAN_INNER)
    def commit(i, jump0, jump1, u, r, area, step, theta, parameters, state, terms, details, energy):
        stored = 0.5 * parameters[i, 0] * min(jump1[0], 0.0) ** 2
        energy[i, 0] = stored
        energy[i, 1] = state[i, 0] - stored - r[0] * (jump1[0] - jump0[0]) / step
        state[i, 0] = stored
        return 1 if r[0] > 0.0 else 0

    return _kernels("elastic wire", prepare, solve, commit, 4, ("stored",), ("stored", "numerical"))
