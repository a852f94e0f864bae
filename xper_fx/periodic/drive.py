# SPDX-License-Identifier: LGPL-3.0-or-later
"""What drives a periodic cell: each component of Fbar or of Pibar as a function of time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from xper_fx.forms.loads import Value, value_at
from xper_fx.support.checks import refuse_expression


@dataclass(frozen=True)
class MacroscopicDrive:
    r"""Components of the macroscopic gradient or of the macroscopic stress, freely mixed.

    Components are named "11", "12", ... with the row first: Fbar_ij = d x_i / d X_j, averaged over
    the cell, jumps included. Each of the dim^2 components is given exactly once.

    Args:
        gradient: Fbar_ij as a number or function of time; it starts from the identity.
        rate: d Fbar_ij / dt (1/s).
        stress: Pibar_ij (Pa), the mean first Piola-Kirchhoff stress, held at the end of each step.

    Raises:
        ValueError: a component given twice or of no such name.
    """

    gradient: Mapping[str, Value] = field(default_factory=dict)
    rate: Mapping[str, Value] = field(default_factory=dict)
    stress: Mapping[str, Value] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("gradient", "rate", "stress"):
            part = getattr(self, name)
            if not isinstance(part, Mapping):
                raise TypeError(f'{name} should be a mapping such as {{"11": 1.0}}, got {part!r}.')
        given = [name for part in (self.gradient, self.rate, self.stress) for name in part]
        for name in given:
            if not isinstance(name, str) or len(name) != 2 or not set(name) <= set("123"):
                raise ValueError(f'There is no component {name!r}; components are "11", "12", ...')
            if given.count(name) > 1:
                raise ValueError(
                    f"Component {name} is given more than once; drive it by `gradient`, by `rate` "
                    "or by `stress`."
                )

    def check(self, dim: int) -> None:
        """Raise a ValueError unless the drive fits a cell of a dimension.

        Every component is given once, and of F_ij and F_ji at least one, for with the fluctuation
        free in every body stresses do not determine the spin.
        """
        axes = "123"[:dim]
        names = {i + j for i in axes for j in axes}
        given = {*self.gradient, *self.rate, *self.stress}
        if given != names:
            raise ValueError(
                f"Components {sorted(names - given)} are not given and {sorted(given - names)} do "
                f"not exist in {dim}D; give each of {sorted(names)} by `gradient`, `rate` or "
                "`stress`."
            )
        for name in sorted(self.stress):
            i, j = name
            if i < j and j + i in self.stress:
                raise ValueError(
                    f"P{i}{j} and P{j}{i} are both given, so that the spin F{i}{j} - F{j}{i} is "
                    f'free; prescribe one, say gradient={{"{j}{i}": 0.0}}.'
                )
        for part, letter in ((self.gradient, "F"), (self.rate, "dF/dt "), (self.stress, "P")):
            for name, value in part.items():
                refuse_expression(f"{letter}{name}", value, "a number or a function of time (s)")
                start = value(0.0) if callable(value) else value
                refuse_expression(f"{letter}{name} at the start", start, "a number")
                if np.asarray(start).dtype.kind not in "biuf" or np.size(start) != 1:
                    raise TypeError(f"{letter}{name} is {start!r} at the start; give a number.")
                if not np.all(np.isfinite(start)):
                    raise ValueError(
                        f"{letter}{name} is {start} at the start; give finite numbers or functions "
                        "of time that are finite."
                    )
        for name, value in self.gradient.items():
            start, rest = value_at(value, 0.0), float(name[0] == name[1])
            if rest and not start > 0.0:
                raise ValueError(
                    f"F{name} is {start}; `gradient` holds Fbar, which is 1 at rest, not a strain."
                )
            if callable(value) and abs(start - rest) > 1e-12:
                raise ValueError(
                    f"F{name} is {start} at the start, where the cell is at rest with {rest}; give "
                    "a function of time that starts there."
                )

    def place(self, name: str, dim: int) -> int:
        """Where a component stands among the dim^2 macroscopic unknowns, column by column."""
        i, j = int(name[0]) - 1, int(name[1]) - 1
        return j * dim + i

    def kinematic(self, dim: int) -> np.ndarray:
        """Which macroscopic unknowns are driven by Fbar, shape (dim^2,), bool."""
        out = np.ones(dim * dim, bool)
        out[[self.place(name, dim) for name in self.stress]] = False
        return out

    def rates(
        self,
        dim: int,
        gradient: np.ndarray,
        time: float,
        step: float,
        elapsed: float | None = None,
    ) -> np.ndarray:
        """Mean rates of the driven components over a step that ends at `time`.

        Args:
            gradient: Fbar - I at the start of the step, column by column, shape (dim^2,).
            time: end of the step (s).
            step: h (s).
            elapsed: time that the step takes (s), h if not given.

        Returns:
            Shape (dim^2,), 1/s; zero for components driven by stress. `rate` is taken in the
            middle of the step, which is of second order.

        Raises:
            ValueError: the cell would have no volume, or be inside out.
        """
        out = np.zeros(dim * dim)
        elapsed = step if elapsed is None else elapsed
        for name, value in self.gradient.items():
            place = self.place(name, dim)
            end = value_at(value, time) - float(name[0] == name[1])
            out[place] = (end - gradient[place]) / step
        for name, value in self.rate.items():
            mean = value_at(value, time - 0.5 * elapsed)
            out[self.place(name, dim)] = mean * (elapsed / step)
        self._require_volume(np.eye(dim) + (gradient + step * out).reshape(dim, dim).T, time)
        return out

    def _require_volume(self, end: np.ndarray, time: float) -> None:
        """Raise a ValueError if what is driven of Fbar turns the cell inside out.

        Stretches that follow from stresses are not driven, and taken as 1.
        """
        if any(i != j for i, j in self.stress):
            return
        for i, j in self.stress:
            end[int(i) - 1, int(j) - 1] = 1.0
        if not np.linalg.det(end) > 0.0:
            raise ValueError(
                f"Fbar is driven to {np.round(end, 6).tolist()} at t = {time:g} s, where the cell "
                "has no volume or is inside out; look at the signs and sizes in the drive and at "
                "the time."
            )

    def stresses(self, dim: int, time: float) -> np.ndarray:
        """Pibar of the components driven by it, column by column, shape (dim^2,), Pa."""
        out = np.zeros(dim * dim)
        for name, value in self.stress.items():
            out[self.place(name, dim)] = value_at(value, time)
        return out
