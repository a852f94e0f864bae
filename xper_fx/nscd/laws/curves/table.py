# SPDX-License-Identifier: LGPL-3.0-or-later
"""A curve given by points and straight lines between them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_INNER
from xper_fx.nscd.laws.curves.curve import CurveFunctions
from xper_fx.support.checks import require_numbers


@dataclass(frozen=True)
class Table:
    """Tractions at openings."""

    openings: tuple[float, ...]  #: rising (m)
    tractions: tuple[float, ...]  #: of the same length (Pa)

    @classmethod
    def of(cls, *given: Any) -> Table:
        """A table of two lists.

        Raises:
            TypeError: no lists of numbers.
            ValueError: not two of the same length, openings that do not rise, a negative traction.
        """
        if len(given) != 2:
            raise ValueError(f"A table is a pair, openings and tractions, got {len(given)} lists.")
        x, t = require_numbers("openings", given[0]), require_numbers("tractions", given[1])
        if x.ndim != 1 or x.shape != t.shape or len(x) < 2:
            raise ValueError(
                "openings and tractions of a table should be as many, two or more, got shapes "
                f"{x.shape} and {t.shape}."
            )
        back = np.flatnonzero(~(np.diff(x) > 0.0))
        if len(back) or not (np.isfinite(x[-1]) and x[0] >= 0.0):
            at = int(back[0]) if len(back) else 0
            raise ValueError(
                f"The openings of a table should rise from zero or above, got {x[at]:g} m and then "
                f"{x[at + 1]:g} m, entries {at} and {at + 1}."
            )
        bad = np.flatnonzero(~(np.isfinite(t) & (t >= 0.0)))
        if len(bad):
            raise ValueError(
                f"The tractions of a table should be finite, zero or above, got {t[bad[0]]} Pa, "
                f"entry {bad[0]}."
            )
        return cls(tuple(x.tolist()), tuple(t.tolist()))

    def first_slope(self) -> float | None:
        """Stiffness (Pa/m) of a table that starts at (0, 0), else None."""
        if self.openings[0] > 0.0 or self.tractions[0] > 0.0:
            return None
        return self.tractions[1] / self.openings[1]

    def compiled(self):
        """The compiled traction T(x)."""
        return _table_functions(self)[0]

    def functions(self) -> CurveFunctions:
        """The compiled functions of a curve, on shapes d0, dc, k."""
        return _table_functions(self)[1]


@cache
def _table_functions(table: Table):
    xs, ts, last = np.array(table.openings), np.array(table.tractions), len(table.openings) - 1

    @njit(**LEAN_INNER)
    def segment(x):
        low, high = 0, last
        while high - low > 1:
            middle = (low + high) // 2
            if xs[middle] <= x:
                low = middle
            else:
                high = middle
        return low

    @njit(**LEAN_INNER)
    def on_segment(j, x):
        return ts[j] + (ts[j + 1] - ts[j]) * (x - xs[j]) / (xs[j + 1] - xs[j])

    @njit(**LEAN_INNER)
    def traction(x):
        return ts[0] if x <= xs[0] else on_segment(segment(x), x)

    @njit(**LEAN_INNER)
    def fall(x, p):
        return min(1.0, traction(x) / (p[2] * x))

    @njit(**LEAN_INNER)
    def area(a, b, g, p):
        total, start = 0.0, a
        if start < xs[0]:
            top = min(b, xs[0])
            total += ts[0] * (top - start)
            start = top
        j = segment(start)
        while start < b:
            top = b if j == last - 1 else min(b, xs[j + 1])
            total += (top - start) * on_segment(j, 0.5 * (start + top))
            start = top
            j += 1
        return total / p[2]

    return traction, CurveFunctions(fall, area)
