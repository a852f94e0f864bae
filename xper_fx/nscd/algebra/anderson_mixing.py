# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Anderson's mixing of the images of a fixed-point map (Anderson 1965; Walker and Ni 2011).

Of a map r -> G(r), with f = G(r) - r, and dF and dG the differences of the last f and G(r),

    r_next = G(r) - dG gamma,   gamma = argmin |f - dF gamma|,

which is GMRES where G is linear. It needs no factorisation, and a few vectors of memory.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from xper_fx.nscd.algebra.krylov import add_combination, products

# Relative size of a singular value of dF that is left out.
_RANK = 1e-12


def _alone(value: np.ndarray) -> np.ndarray:
    """The sum over the only rank."""
    return value


class AndersonMixing:
    """Differences of the last images; vectors of its own, nothing allocated as it goes on.

    Args:
        size: of the vectors.
        memory: how many differences are kept.
        plain: how many are known before any is mixed.
        summed: sum over the ranks that have parts of the vectors.
    """

    def __init__(self, size: int, memory: int, plain: int, summed: Callable = _alone):
        self._memory, self._plain, self._summed = memory, plain, summed
        self._df, self._dg = np.zeros((memory, size)), np.zeros((memory, size))
        self._f, self._g = np.zeros((2, size))
        self._gram = np.zeros((memory, memory))
        self.forget()

    def forget(self) -> None:
        """Start again."""
        self._count, self._started = 0, False

    def mix(self, f: np.ndarray, g: np.ndarray, r: np.ndarray) -> bool:
        """Set the next r from f = G(r) - r and g = G(r); False if it is g itself.

        So it is too where squares of what was changed are beyond the range of floats.

        Args:
            f, g: shape (size,).
            r: set, shape (size,).
        """
        if self._started:
            slot = self._count % self._memory
            np.subtract(f, self._f, out=self._df[slot])
            np.subtract(g, self._g, out=self._dg[slot])
            self._count += 1
            known = min(self._count, self._memory)
            row = np.empty(known)
            products(self._df, known, self._df[slot], row)
            self._gram[slot, :known] = self._gram[:known, slot] = self._summed(row)
        self._started = True
        self._f[:], self._g[:] = f, g
        known = min(self._count, self._memory)
        r[:] = g
        if known < self._plain:
            return False
        right = np.empty(known)
        products(self._df, known, f, right)
        right, gram = self._summed(right), self._gram[:known, :known]
        if not (np.all(np.isfinite(gram)) and np.all(np.isfinite(right))):
            self.forget()
            return False
        scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
        normal = gram * scale[:, None] * scale
        gamma = scale * np.linalg.lstsq(normal, scale * right, rcond=_RANK)[0]
        add_combination(self._dg, known, -gamma, r)
        return True
