# SPDX-License-Identifier: LGPL-3.0-or-later
"""Perfect bond: the two sides move together, dU = 0.

With this law NonSmooth Contact Dynamics is a dual Schur domain decomposition (Perales et al.
2010, section 3.3). The bond holds the velocity; what the solver's tolerance has let the lips
drift apart is taken back, dU = -jump0 / h, so that the jump never accumulates. A direction in
which W vanishes (both sides prescribed) carries no impulse.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.kernel_options import LEAN_INNER
from xper_fx.nscd.laws.law import LawKernels

# Ratio of eigenvalues below which a compliance counts as singular.
_SINGULAR = 1e-12


@dataclass(frozen=True)
class PerfectBond:
    """Both sides move together; any traction is carried."""

    def kernels(self, dim: int) -> LawKernels:
        """See `Law`."""
        return _kernels(dim)

    def parameters(self) -> tuple[float, ...]:
        """A perfect bond has no parameters."""
        return ()

    def initial_state(self) -> tuple[float, ...]:
        """A perfect bond has no history."""
        return ()


@njit(**LEAN_INNER)
def _pseudo_inverse_plane(s):
    """Moore-Penrose inverse of a symmetric positive semi-definite matrix."""
    trace, det = s[0] + s[2], s[0] * s[2] - s[1] * s[1]
    if trace <= 0.0:
        return 0.0, 0.0, 0.0
    if det > _SINGULAR * trace * trace:
        return s[2] / det, -s[1] / det, s[0] / det
    c = 1.0 / (trace * trace)  # rank one: W = a a^T, whose inverse is W / |a|^4
    return c * s[0], c * s[1], c * s[2]


@njit(**LEAN_INNER)
def _pseudo_inverse_space(s):
    """Moore-Penrose inverse of a symmetric positive semi-definite matrix."""
    trace = s[0] + s[3] + s[5]
    if trace <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    c00, c11, c22 = s[3] * s[5] - s[4] ** 2, s[0] * s[5] - s[2] ** 2, s[0] * s[3] - s[1] ** 2
    c01, c02 = s[2] * s[4] - s[1] * s[5], s[1] * s[4] - s[2] * s[3]
    c12 = s[1] * s[2] - s[0] * s[4]
    minors = c00 + c11 + c22
    if minors <= _SINGULAR * trace * trace:
        # Rank one: W = a a^T, whose inverse is W / |a|^4.
        d = 1.0 / (trace * trace)
        return d * s[0], d * s[1], d * s[2], d * s[3], d * s[4], d * s[5]
    det = s[0] * c00 + s[1] * c01 + s[2] * c02
    if det > _SINGULAR * minors * trace:
        d = 1.0 / det
        return d * c00, d * c01, d * c02, d * c11, d * c12, d * c22
    # Rank two: the polynomial in W that is 1 / x at its eigenvalues and 0 at 0.
    d = 1.0 / (minors * minors)
    a, b = d * (trace * trace - minors), -d * trace
    return (
        a * s[0] + b * (s[0] * s[0] + s[1] * s[1] + s[2] * s[2]),
        a * s[1] + b * (s[0] * s[1] + s[1] * s[3] + s[2] * s[4]),
        a * s[2] + b * (s[0] * s[2] + s[1] * s[4] + s[2] * s[5]),
        a * s[3] + b * (s[1] * s[1] + s[3] * s[3] + s[4] * s[4]),
        a * s[4] + b * (s[1] * s[2] + s[3] * s[4] + s[4] * s[5]),
        a * s[5] + b * (s[2] * s[2] + s[4] * s[4] + s[5] * s[5]),
    )


@cache
def _kernels(dim: int) -> LawKernels:
    algebra = for_dimension(dim)
    sym_row, add, subtract = algebra.sym_row, algebra.add, algebra.subtract
    row, set_row = algebra.row, algebra.set_row
    scale, sym_part, sym_vector = algebra.scale, algebra.sym_part, algebra.sym_vector
    pseudo_inverse = _pseudo_inverse_plane if dim == 2 else _pseudo_inverse_space
    num_sym = dim * (dim + 1) // 2

    @njit(**LEAN_INNER)
    def prepare(i, jump, velocity, w, area, step, theta, parameters, state, terms, details):
        set_row(terms, i, scale(-1.0 / step, jump))
        inverse = pseudo_inverse(sym_row(w, i))
        for j in range(num_sym):
            terms[i, dim + j] = inverse[j]

    @njit(inline="always")
    def solve(i, u, r, w, parameters, terms, details):
        missing = subtract(row(terms, i), u)
        return add(r, sym_vector(sym_part(terms, i, dim), missing)), True

    @njit(**LEAN_INNER)
    def commit(i, jump0, jump1, u, r, area, step, theta, parameters, state, terms, details, energy):
        work = 0.0
        for j in range(dim):
            work += r[j] * (jump1[j] - jump0[j]) / step
        energy[i, 0] = -work
        return 1

    return LawKernels(
        name="perfect bond",
        effects=(("perfect bond", dim + num_sym),),
        components=dim,
        prepare=prepare,
        solve=solve,
        commit=commit,
        num_terms=dim + num_sym,
        energies=("numerical",),
        no_jump=True,
    )
