# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Friction and joints that slip weakens, in static runs: for the monolithic solver.

As of `weakening_friction.py`, but with the share f of the end of the step,

    f = <1 - (s0 + |slip of the step|) / D>+,

so that tractions lie on the curve whatever the step was, and `solve` gives f from the velocity, so
that Newton's method sees the descent. A point is asked by a projection. With the cone's tip, which
tension lifts, r'_N = r_N + f sigma_t h A, and the compliances w_N and w_T of the point,

    r'_N = <r'_N - (u_N - v_min) / w_N>+,
    r_T  = P(r_T - (u_T + shift) / w_T),    |r_T| <= mu r'_N + f (c - mu sigma_t) h A,

whose fixed points are the law's answers, whatever the compliances. It is continuous: at the tip a
joint opens with its last shear. That a joint which opens loses all at once is no part of it. Else
balance may open a point that bears tension and shear, and close it without them, and iterations go
in circles. So the joint loses all where a balance is found in which it opens (`evolve`), and
another balance is looked for.

A sound joint keeps the distance that its lips have, which earlier steps leave near zero: to close
the gaps of all facets around a vertex that stick, each to rounding, they would have to slip.

**Growth.** Along a path the slip of the step is what is bounded, relative to D: a joint that is
sheared to and fro weakens by all its slip, not by how far it has got. Loss by tension is sudden and
bounds nothing.

**Energy.** What a slip costs is the limit at the mean of f over it, with the pressure at its end;
what the tractions at the end do less is the scheme's, and booked as numerical. It vanishes with the
step.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.kernel_options import LEAN_INNER, MERGED, MERGED_ENTRY
from xper_fx.nscd.laws.law import LawKernels
from xper_fx.nscd.laws.weakening_kernels import weakening_kernels

# Speed of opening, beside the one that the tension alone gives, at which a joint has opened: less
# is the error of a balance; and one beyond rounding, with which it is lost for the next step.
_OPENED, _PARTS = 1e-3, 1e-8
# Columns of energy.
_IMPACT, _FRICTION, _NUMERICAL, _COHESION = range(4)


@dataclass(frozen=True)
class WeakeningInStatics:
    """A law of `weakening_friction.py` in a static run."""

    law: Any  #: for runs with inertia, which has the parameters and the history
    joint: bool  #: whether it has cohesion

    def kernels(self, dim: int) -> LawKernels:
        """See `Law`."""
        return static_kernels(dim, self.law.contact, self.joint)

    def parameters(self) -> tuple:
        """Those of the law."""
        return self.law.parameters()

    def initial_state(self) -> tuple:
        """That of the law."""
        return self.law.initial_state()

    def later_state(self) -> tuple:
        """That of the law."""
        return self.law.later_state() if self.joint else self.law.initial_state()


@cache
def static_kernels(dim: int, contact: str, joint: bool) -> LawKernels:
    """The kernels of slip weakening, with `joint` those of Mohr-Coulomb."""
    law, columns, share, mean_share, set_share, slip_of = weakening_kernels(dim, contact, joint)
    algebra, impact = for_dimension(dim), contact == "velocity"
    dot, add, scale, subtract = algebra.dot, algebra.add, algebra.scale, algebra.subtract
    tangent_part, with_normal = algebra.tangent_part, algebra.with_normal
    mu_s, mu_d, length = columns.mu_s, columns.mu_d, columns.length
    cohesion, tension, area_time = columns.cohesion, columns.tension, columns.area_time
    v_min, mu, bound, shift, pull = (
        columns.v_min, columns.mu, columns.bound, columns.shift, columns.pull
    )  # fmt: skip
    start, left = columns.start, columns.left
    parting = law.num_details  # whether a joint opens, of those that have cohesion
    law_prepare = law.prepare
    slipped, damage, pushed = columns.slipped, columns.damage, columns.pushed

    def growth(parameters: np.ndarray, state: np.ndarray):
        slip, distance = state[:, slipped], parameters[:, length]
        return slip, distance, slip < distance

    @njit(inline="always")
    def across(w, i):
        """Compliance along the tangents, the larger one."""
        return w[i, 2] if dim == 2 else max(w[i, 3], w[i, 5])

    @njit(**LEAN_INNER)
    def prepare(i, jump, velocity, w, area, step, theta, parameters, state, terms, details):
        law_prepare(i, jump, velocity, w, area, step, theta, parameters, state, terms, details)
        details[i, parting] = 0.0
        if details[i, left] > 0.0:
            terms[i, v_min] = 0.0

    @njit(**MERGED)
    def share_at(i, u, parameters, details):
        """f at the end of a step with a velocity."""
        if details[i, left] == 0.0:
            return 0.0
        return share(details[i, start] + slip_of(i, u, details), parameters[i, length])

    @njit(**MERGED_ENTRY)
    def solve(i, u, r, w, parameters, terms, details):
        f = share_at(i, u, parameters, details)
        friction = parameters[i, mu_d] + (parameters[i, mu_s] - parameters[i, mu_d]) * f
        held = limit = 0.0
        if joint:
            whole = f * details[i, area_time]
            held = whole * parameters[i, tension]
            limit = whole * parameters[i, cohesion] - friction * held
        w_n, w_t = w[i, 0], across(w, i)
        normal = 0.0
        if w_n > 0.0:
            normal = max(0.0, r[0] + held - (u[0] - terms[i, v_min]) / w_n)
        limit += friction * normal
        if w_t <= 0.0 or limit <= 0.0:
            return with_normal(scale(0.0, r), normal - held), True
        slip = add(u, (0.0,) + tangent_part(terms, i, shift))
        trial = with_normal(subtract(r, scale(1.0 / w_t, slip)), 0.0)
        size = np.sqrt(dot(trial, trial))
        if size > limit:
            trial = scale(limit / size, trial)
        return with_normal(trial, normal - held), True

    @njit(inline="always")
    def evolve(i, u, w, parameters, terms, details):
        f = share_at(i, u, parameters, details)
        if not joint or f == 0.0:
            return 0.0
        strength = parameters[i, tension]
        if strength == 0.0:
            strength = parameters[i, cohesion]
        most = w[i, 0] * strength * details[i, area_time]
        opening = u[0] - terms[i, v_min]
        details[i, parting] = 1.0 if opening > _PARTS * most else 0.0
        if opening <= _OPENED * most:
            return 0.0
        details[i, left] = 0.0
        return f

    @njit(**LEAN_INNER)
    def commit(i, jump0, jump1, u, r, area, step, theta, parameters, state, terms, details, energy):
        work, size, slip = 0.0, 0.0, 0.0
        for j in range(1, dim):
            work -= r[j] * (jump1[j] - jump0[j]) / step
            size += r[j] * r[j]
            slip += (jump1[j] - jump0[j]) ** 2
        slip, s0, distance = np.sqrt(slip), details[i, start], parameters[i, length]
        parts = details[i, left] < share(s0, distance)
        mean = 0.0 if parts else mean_share(s0, s0 + slip, distance)
        set_share(i, share_at(i, u, parameters, details), parameters, terms, details)
        lifted = r[0] + terms[i, pull] if joint else r[0]
        limit = terms[i, mu] * lifted + terms[i, bound]
        slides = size > 0.0 and size >= (1.0 - 1e-12) * limit * limit
        if joint:
            parts |= lifted <= 0.0 and details[i, parting] > 0.0
        energy[i, _IMPACT] = -r[0] * (jump1[0] - jump0[0]) / step
        friction = parameters[i, mu_d] + (parameters[i, mu_s] - parameters[i, mu_d]) * mean
        rubbed = slip if slides else 0.0
        energy[i, _FRICTION] = friction * max(r[0], 0.0) / step * rubbed
        work -= energy[i, _FRICTION]
        if joint:
            borne = mean * parameters[i, cohesion] * area - friction * max(-r[0], 0.0) / step
            energy[i, _COHESION] = max(borne, 0.0) * rubbed
            work -= energy[i, _COHESION]
        energy[i, _NUMERICAL] = work
        if lifted > 0.0 or size > 0.0:
            state[i, slipped] += slip
        if joint:
            if parts:
                state[i, slipped] = max(state[i, slipped], distance)
            state[i, damage] = share(state[i, slipped], distance)
        if impact:
            state[i, pushed] = r[0]
        if lifted <= 0.0 and size == 0.0:
            return 0
        return 2 if slides else 1

    energies = ("impact", "friction", "numerical")
    return law._replace(
        prepare=prepare if joint else law.prepare,
        solve=solve,
        num_details=law.num_details + joint,
        evolve=evolve if joint else None,
        commit=commit,
        energies=(*energies, "cohesion") if joint else energies,
        growth=growth,
        slips=True,
        coulomb=None,
    )
