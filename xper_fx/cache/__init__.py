# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled kernels, kept between processes: `njit` is Numba's, and what it compiles stays.

A process that needs a kernel which some process on this machine has compiled before loads it, in
milliseconds instead of up to seconds. `python3 -m xper_fx.cache` shows what is kept and clears it.

Numba's own `njit(cache=True)` finds nothing again of kernels that close over other kernels: its key
is made from their identities, which are random in each process (Numba issue 6264).
"""

from xper_fx.cache.dispatch import njit
from xper_fx.cache.folder import CacheFolder, kernel_folder

__all__ = ["CacheFolder", "kernel_folder", "njit"]
