# SPDX-License-Identifier: LGPL-3.0-or-later
"""What laws of bonds share: their kernels, parameters and history."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar, Self

from xper_fx.nscd.laws.friction_of_lips import Friction
from xper_fx.nscd.laws.law import LawKernels
from xper_fx.nscd.laws.parameters import acts
from xper_fx.nscd.laws.weakening import Weakening
from xper_fx.support.checks import require_flag


class Bond:
    """A law whose lips are bonded by springs that weaken, then touch and rub.

    A class of it is a frozen dataclass with `friction`, `friction_grows`, `initial_damage`,
    `damage` and `viscosity`, and has `weakening`, `shape` and, unless there are
    `normal_stiffness` and `tangential_stiffness`, `stiffnesses`.
    """

    friction: Any
    friction_grows: bool
    initial_damage: Any
    damage: str
    viscosity: Any
    normal_stiffness: Any
    tangential_stiffness: Any
    damage_options: ClassVar[tuple[str, ...]] = ("auto", "mean", "lagged", "end")

    def _check_options(self) -> None:
        require_flag("friction_grows", self.friction_grows)
        if self.damage not in self.damage_options:
            *others, last = (f'"{name}"' for name in self.damage_options)
            wanted = f"{', '.join(others)} or {last}"
            raise ValueError(f"damage should be {wanted}, got {self.damage!r}.")

    @property
    def _rubs(self) -> bool:
        return acts(self.friction)

    @property
    def _friction(self) -> Friction:
        if not self._rubs:
            return Friction.NONE
        return Friction.GROWING if self.friction_grows else Friction.WHOLE

    @property
    def _viscous(self) -> bool:
        return acts(self.viscosity)

    def in_statics(self) -> Self:
        """The law that a static run of the monolithic solver takes for this one."""
        return replace(self, damage="end") if self.damage == "auto" else self

    def kernels(self, dim: int) -> LawKernels:
        """See `Law`."""
        weakening = self.weakening()
        if self.damage == "end":
            from xper_fx.nscd.laws.damage_at_end import end_kernels

            return end_kernels(dim, self._friction, self._viscous, weakening)
        from xper_fx.nscd.laws.bond_kernels import mean_kernels

        return mean_kernels(dim, self._friction, self.damage == "lagged", self._viscous, weakening)

    def parameters(self) -> tuple:
        """C_N, C_T (Pa/m), beta0; with friction mu; what `weakening` has; viscosity b (J s/m^2)."""
        bond = (*self.stiffnesses(), self.initial_damage)
        bond = (*bond, self.friction, *self.shape()) if self._rubs else (*bond, *self.shape())
        return (*bond, self.viscosity) if self._viscous else bond

    def initial_state(self) -> tuple:
        """Largest opening so far (m) and damage."""
        return 0.0, self.initial_damage

    def weakening(self) -> Weakening:
        """How openings weaken the bond, compiled."""
        raise NotImplementedError

    def stiffnesses(self) -> tuple:
        """C_N and C_T (Pa/m)."""
        c_n, c_t = self.normal_stiffness, self.tangential_stiffness
        return c_n, c_n if c_t is None else c_t

    def shape(self) -> tuple:
        """The parameters that the weakening takes."""
        raise NotImplementedError
