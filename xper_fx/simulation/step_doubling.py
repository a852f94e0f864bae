# SPDX-License-Identifier: LGPL-3.0-or-later
"""What plastic flow and static contact leave, from a step of twice the size now and then.

Backward Euler leaves an error of c h^2 a step. One step of 2 h leaves 4 c h^2 where two of h leave
2 c h^2: the difference is what the two leave (Richardson 1911; Hairer, Norsett and Wanner 1993,
section II.4). It is taken of the works of a step and spread over the steps since the last one that
was doubled, with its sign: a path that turns to and fro makes up for some of its error.

The long step is tried before the two and is not kept. One in `_EVERY` steps costs 1 / `_EVERY` of
a run.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from xper_fx.simulation.energy_ledger import BulkEnergies

# Steps between those that are doubled.
_EVERY = 6
# Difference over the works of both steps above which they have come to another state.
_ANOTHER_STATE = 0.2


def works(energies: BulkEnergies) -> np.ndarray:
    """External work, gains of kinetic and elastic energy, dissipation of the bulk (J; 2D: J/m)."""
    return np.array(
        [
            energies.work,
            energies.kinetic_change,
            energies.elastic_change,
            energies.plastic + energies.viscous,
        ]
    )


@dataclass
class StepDoubling:
    """Compares steps with one of twice the size.

    Attributes:
        left: by the steps made, of each of the works (J; 2D: J/m), shape (4,).
        local: by a step, the largest of the works (J; 2D: J/m).
        size: of the steps that are being compared (s), 0 without.
        difference: of the long step's works to those made since, shape (4,).
        moved: sum of the sizes of their works (J; 2D: J/m).
        made, since: steps made of the two, and since the last that were compared.
    """

    left: np.ndarray = field(default_factory=lambda: np.zeros(4))
    local: float = 0.0
    size: float = 0.0
    difference: np.ndarray = field(default_factory=lambda: np.zeros(4))
    moved: float = 0.0
    made: int = 0
    since: int = _EVERY

    @property
    def error(self) -> float:
        """The largest of what was left (J; 2D: J/m)."""
        return float(np.abs(self.left).max())

    @property
    def is_due(self) -> bool:
        """Whether the next step should be tried at twice its size first."""
        return self.size == 0.0 and self.since >= _EVERY

    def begin(self, size: float, long: BulkEnergies | None) -> None:
        """Take a step of twice the size; None if it did not converge.

        Args:
            size: of the steps to come (s).
            long: of the long step.
        """
        if long is None:
            self.since = 0
        else:
            self.size, self.difference, self.made, self.moved = size, works(long), 0, 0.0

    def take(self, size: float, energies: BulkEnergies) -> bool:
        """Take a step that was made; whether two were compared now.

        Args:
            size: of the step (s).
            energies: of the step.
        """
        self.since += 1
        if self.size == 0.0:
            return False
        if abs(size - self.size) > 1e-6 * self.size:
            self.size = 0.0  # the steps to come are others; a long one is due again
            return False
        self.difference = self.difference - works(energies)
        self.moved += float(np.abs(works(energies)).sum())
        self.made += 1
        if self.made < 2:
            return False
        if float(np.abs(self.difference).sum()) > _ANOTHER_STATE * self.moved:
            self.size, self.since = 0.0, 0  # another state, as friction may have several
            return False
        self.left = self.left + self.difference * (0.5 * self.since)
        self.local = 0.5 * float(np.abs(self.difference).max())
        self.size, self.since = 0.0, 0
        return True

    def saved(self) -> dict:
        """All of it."""
        return dict(vars(self))

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave."""
        vars(self).update({k: np.copy(v) if np.ndim(v) else v for k, v in saved.items()})
