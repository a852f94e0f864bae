# SPDX-License-Identifier: LGPL-3.0-or-later
"""Perfect bond: the two sides move together, dU = 0.

With this law NonSmooth Contact Dynamics is a dual Schur domain decomposition (Perales et al.
2010, section 3.3). The bond holds the velocity; what the solver's tolerance has let the lips
drift apart is taken back, dU = -jump0 / h, so that the jump never accumulates.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from numba import njit

from xper_fx.nscd.laws.law import NUMERICAL, LawKernels
from xper_fx.nscd.small import for_dimension

# Compliance added, relative to the point's own, so that prescribed directions can be inverted.
_REGULARISATION = 1e-14


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


@cache
def _kernels(dim: int) -> LawKernels:
    algebra = for_dimension(dim)
    sym_row, add, subtract = algebra.sym_row, algebra.add, algebra.subtract
    row, set_row = algebra.row, algebra.set_row
    scale = algebra.scale

    @njit
    def prepare(i, jump, velocity, w, area, step, theta, parameters, state, terms, details):
        set_row(terms, i, scale(-1.0 / step, jump))

    @njit(inline="always")
    def solve(i, u, r, w, parameters, terms, details):
        missing = subtract(row(terms, i), u)
        s = sym_row(w, i)
        if dim == 2:
            tiny = _REGULARISATION * (s[0] + s[2])
            a, c = s[0] + tiny, s[2] + tiny
            det = a * c - s[1] * s[1]
            if det <= 0.0:
                return r, True
            change = (
                (c * missing[0] - s[1] * missing[1]) / det,
                (a * missing[1] - s[1] * missing[0]) / det,
            )
            return add(r, change), True
        tiny = _REGULARISATION * (s[0] + s[3] + s[5])
        a, d, f = s[0] + tiny, s[3] + tiny, s[5] + tiny
        c00 = d * f - s[4] * s[4]
        c01 = s[2] * s[4] - s[1] * f
        c02 = s[1] * s[4] - s[2] * d
        c11 = a * f - s[2] * s[2]
        c12 = s[1] * s[2] - a * s[4]
        c22 = a * d - s[1] * s[1]
        det = a * c00 + s[1] * c01 + s[2] * c02
        if det <= 0.0:
            return r, True
        change = (
            (c00 * missing[0] + c01 * missing[1] + c02 * missing[2]) / det,
            (c01 * missing[0] + c11 * missing[1] + c12 * missing[2]) / det,
            (c02 * missing[0] + c12 * missing[1] + c22 * missing[2]) / det,
        )
        return add(r, change), True

    @njit
    def commit(
        i, jump0, jump1, u, r, area, step, theta, parameters, state, terms, details, energy
    ):
        work = 0.0
        for j in range(dim):
            work += r[j] * (jump1[j] - jump0[j]) / step
        energy[i, NUMERICAL] = -work
        return 1

    return LawKernels(prepare, solve, commit, dim, 0, ())
