# SPDX-License-Identifier: LGPL-3.0-or-later
r"""A bond with a curve of one's own, from the traction of a monotone opening.

The user's T(x) is the traction of a bond that opens and never closes. With the stiffness k of the
sound bond

    T_bond(x) = min(k x, T(x)),   g(x) = T_bond(x) / (k x),   d0: where k x = T(x),

so T may have the elastic part or leave it out. All else is that of `cohesive_zone.py`: damage, its
mean over a step, unloading along the secant, contact, friction, energies. What is dissipated needs
the integral of T alone, taken by `curves/quadrature.py` between the kinks that the user names, or
exactly for a table.
"""

from __future__ import annotations

import inspect
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np
from numba import types

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import ENTRY, LEAN_INNER
from xper_fx.nscd.laws.bond import Bond
from xper_fx.nscd.laws.curves.curve import CurveFunctions
from xper_fx.nscd.laws.curves.quadrature import panel_sum
from xper_fx.nscd.laws.curves.table import Table
from xper_fx.nscd.laws.parameters import refuse_where, take_parameters
from xper_fx.nscd.laws.weakening import Weakening, one_curve, take_columns
from xper_fx.support.checks import require_number, require_numbers

# Panels of the quadrature on a curve, if nothing is known of its shape.
_PANELS = 16
# Samples of a curve that is examined.
_SAMPLES = 1000
# Rise of g from sample to sample that is none; the same of an energy by panels half as long.
_ROUNDING = 1e-9
_UNSMOOTH = 1e-11


class _Examined(NamedTuple):
    """What a curve is like, each of shape (num_points,)."""

    elastic_opening: np.ndarray  # d0 (m)
    strength: np.ndarray  # largest traction (Pa)
    energy: np.ndarray  # area (J/m^2)
    slope: np.ndarray  # steepest descent (Pa/m)
    wrong_at: np.ndarray  # opening (m) where T is negative or not finite, or -1
    hardens_at: np.ndarray  # opening (m) where g rises, or -1
    unsmooth: np.ndarray  # difference of the area by panels half as long, relative


@dataclass(frozen=True)
class CohesiveCurve(Bond):
    """Bond that follows a curve of the user's.

    Parameters are numbers or fields (`xper_fx/nscd/laws/fields.py`), `values` too.

    Args:
        traction: T(x, *values) in Pa of the opening x (m), compiled by `xper_fx.njit`; or a table,
            a pair of lists: openings (m) and tractions (Pa), joined by straight lines.
        values: by name what the traction takes after x, in its order.
        end: opening (m) at which the bond is broken, or a function of the values that gives it; of
            a table its last opening.
        normal_stiffness: k = C_N (Pa/m); of a table that starts at (0, 0) the first slope if not
            given.
        tangential_stiffness: C_T (Pa/m); C_N if not given.
        kinks: openings (m) between d0 and `end` at which the slope of T jumps, in order, or a
            function of the values that gives them; of a table none are needed.
        friction: Coulomb's mu of the lips.
        initial_damage: beta0 in (0, 1].
        damage, friction_grows, viscosity: as of `CohesiveZone`.

    Raises:
        TypeError: a traction that is neither compiled nor a table, or gives no number; functions
            that do not take the values.
        ValueError: a number out of range, a traction that is negative, not finite or stiffens, or
            that is not smooth between the kinks; kinks that do not rise; a table that does not go
            forward.
    """

    traction: Any
    values: Mapping[str, Any] = field(default_factory=dict)
    end: float | Callable[..., Any] | None = None
    normal_stiffness: Any = None
    tangential_stiffness: Any = None
    kinks: Sequence[float] | Callable[..., Any] = ()
    friction: Any = 0.0
    initial_damage: Any = 1.0
    damage: str = "auto"
    friction_grows: bool = False
    viscosity: Any = 0.0

    def __post_init__(self) -> None:
        self._check_options()
        self._take_traction()
        known = take_parameters(
            self,
            positive=("normal_stiffness",),
            optional=("tangential_stiffness",),
            non_negative=("friction", "viscosity"),
            shares=("initial_damage",),
            numbers="values",
        )
        if known:
            self._check_curve()

    def _take_traction(self) -> None:
        """Turn a table into what is worked with; complain of what is missing."""
        if isinstance(self.traction, list | tuple):
            if self.values or self.end is not None or self.kinks:
                raise ValueError("A table has no values, no end and no kinks beside its own.")
            table = Table.of(*self.traction)
            object.__setattr__(self, "traction", table)
            object.__setattr__(self, "end", table.openings[-1])
        if isinstance(self.traction, Table):
            if self.normal_stiffness is None:
                object.__setattr__(self, "normal_stiffness", self.traction.first_slope())
        elif not hasattr(self.traction, "py_func"):
            raise TypeError(
                "traction should be a function compiled by xper_fx.njit, or a table of openings "
                f"and tractions, got {self.traction!r}."
            )
        elif self.end is None:
            raise ValueError("end (m), the opening at which the bond is broken, is missing.")
        else:
            self._check_functions()
        if self.normal_stiffness is None:
            raise ValueError("normal_stiffness (Pa/m), that of the sound bond, is missing.")

    def _check_functions(self) -> None:
        """Complain of functions that do not take the values, or give no number."""
        _require_arguments("traction", self.traction.py_func, ("x", *self.values))
        for name in ("end", "kinks"):
            given = getattr(self, name)
            if callable(given):
                _require_arguments(name, given, tuple(self.values))
            elif name == "end":
                object.__setattr__(self, name, require_number(name, given))
            elif require_numbers(name, given).ndim != 1:
                raise ValueError(f"kinks should be a list of openings (m), got {given!r}.")
        arguments = (types.float64,) * (1 + len(self.values))
        self.traction.compile(arguments)
        result = self.traction.overloads[arguments].signature.return_type
        if not isinstance(result, types.Float | types.Integer):
            raise TypeError(f"traction should return a number (Pa), it returns {result}.")

    def _check_curve(self) -> None:
        kinks = self._of_values(self.kinks)
        for earlier, later in itertools.pairwise(kinks):
            refuse_where(
                ~(later > earlier),
                lambda at, a=earlier, b=later: (
                    f"kinks should rise, got {at(a):g} m and then {at(b):g} m."
                ),
            )
        found, dc = self._examined, self._of_values(self.end)
        refuse_where(
            ~(np.isfinite(dc) & (dc > 0.0)),
            lambda at: f"end should be an opening (m) above zero, got {at(dc)}.",
        )
        refuse_where(
            found.elastic_opening >= dc,
            lambda at: (
                f"Up to its end, {at(dc):g} m, the bond is elastic: its stiffness "
                f"{at(self.normal_stiffness):g} Pa/m is too low for the curve."
            ),
        )
        refuse_where(
            found.wrong_at >= 0.0,
            lambda at: (
                f"The traction at an opening of {at(found.wrong_at):g} m is negative or not finite."
            ),
        )
        refuse_where(
            found.hardens_at >= 0.0,
            lambda at: (
                f"The secant T(x) / x rises at an opening of {at(found.hardens_at):g} m: a bond "
                "does not heal or harden as it opens."
            ),
        )
        refuse_where(
            found.unsmooth > _UNSMOOTH,
            lambda at: (
                f"The curve is not smooth: its area differs by {at(found.unsmooth):.1e} with the "
                "rule. Name the openings at which its slope jumps in `kinks`, or give a table."
            ),
        )

    def _of_values(self, given: Any) -> Any:
        return np.asarray(given(*self.values.values()) if callable(given) else given, float)

    def _numbers(self) -> tuple:
        """dc, k, the kinks and the values: what tells the curve of a point."""
        kinks = self._of_values(self.kinks)
        rows = kinks if np.ndim(kinks) else ()
        k = self._stiffness
        return (self._of_values(self.end), k, *rows, *self.values.values())

    @property
    def _stiffness(self) -> Any:
        c_n, c_t = self.stiffnesses()
        return c_n if c_t is c_n else 2.0 / (1.0 / c_n + 1.0 / c_t)

    @property
    def _functions(self) -> CurveFunctions:
        if isinstance(self.traction, Table):
            return self.traction.functions()
        return _functions(self.traction, self._num_kinks)

    @property
    def _num_kinks(self) -> int:
        if not callable(self.kinks):
            return len(self.kinks)
        return len(self.kinks(*(1.0 for _ in self.values)))

    @cached_property
    def _examined(self) -> _Examined:
        numbers = np.broadcast_arrays(*self._numbers())
        rows = np.column_stack([np.zeros(numbers[0].size), *(np.ravel(n) for n in numbers)])
        traction = self.traction
        if isinstance(traction, Table):
            traction = traction.compiled()
        examine = _examination(traction, self._num_kinks, len(self.values), self._functions)
        found = examine(np.ascontiguousarray(rows, float))
        if numbers[0].ndim == 0:
            return _Examined(*found[0])
        return _Examined(*found.T)

    @property
    def elastic_opening(self) -> Any:
        """d0 (m), the opening at which damage starts."""
        return self._examined.elastic_opening

    @property
    def critical_opening(self) -> Any:
        """dc (m), the opening at which the bond is broken."""
        return self._numbers()[0]

    @property
    def strength(self) -> Any:
        """Largest traction (Pa)."""
        return self._examined.strength

    @property
    def fracture_energy(self) -> Any:
        """Area below the curve (J/m^2)."""
        return self._examined.energy

    @property
    def softening_slope(self) -> Any:
        """Steepest descent of the traction (Pa/m)."""
        return self._examined.slope

    def weakening(self) -> Weakening:
        """See `Bond`."""
        count = 3 + self._num_kinks + len(self.values)
        return one_curve(self._functions, count, self._rubs)

    def shape(self) -> tuple:
        """d0, dc (m), k (Pa/m), kinks (m), values."""
        return (self._examined.elastic_opening, *self._numbers())


def _require_arguments(name: str, function: Callable[..., Any], wanted: tuple[str, ...]) -> None:
    try:
        inspect.signature(function).bind(*wanted)
    except TypeError:
        raise TypeError(
            f"{name} should be a function of ({', '.join(wanted)}), what `values` names in its "
            f"order, got one of {inspect.signature(function)}."
        ) from None


@cache
def _functions(traction, num_kinks: int) -> CurveFunctions:
    """The compiled functions of a curve, on shapes d0, dc, k, kinks, values."""
    first = 3 + num_kinks

    @njit(**LEAN_INNER)
    def traction_of(x, p):
        return traction(x, *p[first:])

    panels = panel_sum(traction_of)

    @njit(**LEAN_INNER)
    def fall(x, p):
        return max(0.0, min(1.0, traction_of(x, p) / (p[2] * x)))

    @njit(**LEAN_INNER)
    def area(a, b, g, p):
        length, total, start = (p[1] - p[0]) / _PANELS, 0.0, a
        for j in range(num_kinks):
            kink = p[3 + j]
            if start < kink < b:
                total += panels(start, kink, length, p)
                start = kink
        return (total + panels(start, b, length, p)) / p[2]

    return CurveFunctions(fall, area)


@cache
def _examination(traction, num_kinks: int, num_values: int, functions: CurveFunctions):
    """The compiled `examine(rows)`; rows are shapes whose d0 is to be found."""
    take, area = take_columns(0, 3 + num_kinks + num_values), functions.area
    first = 3 + num_kinks

    @njit(**LEAN_INNER)
    def pull(x, p):
        return traction(x, *p[first:])

    @njit(**LEAN_INNER)
    def elastic_end(p):
        """d0: where k x exceeds T for the first time."""
        dc, k, low = p[1], p[2], 0.0
        for j in range(1, _SAMPLES + 1):
            x = dc * j / _SAMPLES
            if k * x > pull(x, p) * (1.0 + _ROUNDING):
                high = x
                break
            low = x
        else:
            return dc
        for _ in range(60):
            middle = 0.5 * (low + high)
            if k * middle > pull(middle, p) * (1.0 + _ROUNDING):
                high = middle
            else:
                low = middle
        return 0.0 if high < 1e-12 * dc else high

    @njit(**ENTRY)
    def examine(rows):
        found = np.empty((len(rows), 7))
        for i in range(len(rows)):
            rows[i, 0] = 0.0
            rows[i, 0] = elastic_end(take(i, rows))
            p = take(i, rows)
            d0, dc, k = p[0], p[1], p[2]
            peak, slope, wrong, hardens = k * d0, 0.0, -1.0, -1.0
            old_t, old_g = k * d0, 1.0
            for j in range(1, _SAMPLES + 1):
                x = d0 + (dc - d0) * (j / _SAMPLES) * (1.0 - 1e-12)
                t = pull(x, p)
                if wrong < 0.0 and not (t >= 0.0 and t < np.inf):
                    wrong = x
                g = t / (k * x)
                if hardens < 0.0 and g > old_g + _ROUNDING:
                    hardens = x
                peak = max(peak, t)
                slope = max(slope, (old_t - t) * _SAMPLES / (dc - d0))
                old_t, old_g = t, g
            whole = area(d0, dc, 1.0, p) if d0 < dc else 0.0
            halves = whole
            if d0 < dc:
                part = (dc - d0) / 41.0
                halves = 0.0
                for j in range(41):
                    halves += area(d0 + j * part, d0 + (j + 1) * part, 1.0, p)
            found[i, 0], found[i, 1] = d0, peak
            found[i, 2] = 0.5 * k * d0 * d0 + k * whole
            found[i, 3], found[i, 4], found[i, 5] = slope, wrong, hardens
            found[i, 6] = abs(halves - whole) / whole if whole > 0.0 else 0.0
        return found

    return examine
