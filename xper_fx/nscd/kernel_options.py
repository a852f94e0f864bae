# SPDX-License-Identifier: LGPL-3.0-or-later
"""How kernels are compiled so that little is compiled: options for `numba.njit`.

A function costs Numba 10 ms however short it is, and as much again for each of the two wrappers
that it gets unless told otherwise: one that takes Python objects, one for C. No kernel is called
from C, and many are called by other kernels alone. What can raise (a division by zero) or allocate
costs more: every test and every count of references is compiled.

A number written out as an argument (`f(x, 0)`) makes a version of `f` of its own, and so does an
array of another layout.
"""

# Called from Python; may allocate.
ENTRY = {"error_model": "numpy", "no_cfunc_wrapper": True}
# The same without counts of references: for what neither allocates nor returns an array.
LEAN_ENTRY = ENTRY | {"_nrt": False}
# Called by kernels alone.
LEAN_INNER = LEAN_ENTRY | {"no_cpython_wrapper": True}
# A few lines that kernels call in many places: typed once, and merged into the callers by LLVM.
# (With inline="always" they are typed in each place, and take the caller's fastmath.) So is what a
# loop calls with a dozen arrays: LLVM leaves long functions apart, and to pass the arrays can cost
# more than what is done with them.
MERGED = LEAN_INNER | {"forceinline": True}
# The same for what one looks at by itself as well, such as a law's `solve`: Python may call it.
MERGED_ENTRY = LEAN_ENTRY | {"forceinline": True}
