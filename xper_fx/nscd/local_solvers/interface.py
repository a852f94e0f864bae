# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a local solver is, and how its kernels are compiled.

All of them solve the same problem at one point: with b the relative velocity without this point's
impulse (m/s), W its compliance (m/s per N s), find the impulse r (N s, compression positive) with

    u = b + W r,   0 <= u_N  _|_  r_N >= 0,
    |r_T| <= mu r_N,   r_T = -mu r_N u_T / |u_T| where u_T != 0.

Where b_N >= 0, r = 0 solves it. Strong coupling (mu |W_NT| > W_NN) may then allow closed solutions
too: every solver takes the open one. Where b_N < 0 the point closes; in 2D the solution is then
unique whatever mu, in 3D it may not be when mu |W_NT| / W_NN is large or W_TT far from isotropic.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY, LEAN_INNER, MERGED_ENTRY

# No reference counts (see exchange.py), no exceptions, products and sums fused.
KERNEL = njit(fastmath={"contract"}, **LEAN_ENTRY)
# The same for what only kernels call.
INNER_KERNEL = njit(fastmath={"contract"}, **LEAN_INNER)
# The same, merged into the caller by LLVM: a dozen numbers passed on the stack would cost more than
# an open point does.
INLINE_KERNEL = njit(fastmath={"contract"}, **MERGED_ENTRY)


class LocalSolver(NamedTuple):
    """Kernels of one local solver. Nothing is allocated; for finite input the result is no NaN.

    Attributes:
        name: its name in `LOCAL_SOLVERS`.
        num_factors: floats a point keeps from sweep to sweep.
        prepare: `prepare(w, mu, factors, i)` fills `factors[i]` with the constants of w and mu:
            once a point, and again when either changes.
        solve: `solve(b, w, factors, i, mu, r) -> r`; w and mu as they were prepared, r the impulse
            of the visit before (a warm start, which some use). May write to `factors[i]`.

    `b` and `r` are tuples `(n, t)` or `(n, t1, t2)`, m/s and N s; `w` is the packed symmetric tuple
    of `small.py`, m/s per N s; `mu >= 0`; `factors` has shape (num_points, num_factors), float64.
    Powers are formed, unscaled: |b|, |w| and |b| / |w| should be 0 or within 1e-50 and 1e50.
    """

    name: str
    num_factors: int
    prepare: Callable
    solve: Callable
