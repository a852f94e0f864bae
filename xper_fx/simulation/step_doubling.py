# SPDX-License-Identifier: LGPL-3.0-or-later
"""What plastic flow and static contact leave, from a step of twice the size now and then.

Backward Euler leaves an error of c h^2 a step. One step of 2 h leaves 4 c h^2 where two of h leave
2 c h^2: the difference is what the two leave (Richardson 1911; Hairer, Norsett and Wanner 1993,
section II.4). It is taken of the works of a step and spread over the steps since the last one that
was doubled, with its sign: a path that turns to and fro makes up for some of its error.

Stresses that err go on to the next steps, until flow forgets them. A deviator s that flows changes
by s' = 2 G (e' - n (n : e')) with n = s / |s|, so that two deviators near each other approach each
other at the rate 2 G |e_p'| / |s|: the plastic power over twice the elastic energy s : s / (4 G),
which is taken to be half of all elastic energy, as pressures have theirs. In a static run of a
material that flows

- the error of the elastic energy falls at that rate, and the dissipation takes what it loses;
- the error of the power of the supports, which the long step shows at its end, falls at the same
  rate and goes with their velocity, and what it does meanwhile is an error of the external work and
  of the dissipation.

With inertia the forces of supports are waves, and friction has its own memory: what is left counts
twice there.

The long step is tried before the two and is not kept: one step in six. In a static run of a
material that flows, steps in which nothing flows leave nothing, and are neither doubled nor
counted; where flow begins, the step after the next is doubled.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from xper_fx.simulation.energy_ledger import BulkEnergies

# Steps from one that is doubled to the next, of which the two are no part; those from the first
# that flows to one that is doubled; those in which flow begins.
_EVERY, _FIRST, _BEGINNING = 4, 1, 5
# Error of global quantities over what steps leave, where it is not followed.
_OTHERWISE = 2.0
# Plastic work of a step over the elastic energy below which nothing flows but by rounding.
_LITTLE = 1e-9
# Times as fast as in the step before that supports move at most, for errors of power: where forces
# turn, powers hardly tell.
_FASTER = 2.0
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
    """Compares steps with one of twice the size."""

    follows: bool  #: whether errors of stresses are followed: of static flow
    #: by the steps made, of each of the works (J; 2D: J/m), shape (4,)
    left: np.ndarray = field(default_factory=lambda: np.zeros(4))
    power: float = 0.0  #: error of the power of the supports (W; 2D: W/m)
    #: by a step, the largest of the works; of the external one with what the error of the power is
    #: still to do (J; 2D: J/m)
    local: float = 0.0
    size: float = 0.0  #: of the steps that are being compared (s), 0 without
    #: of the long step's works to those made since, shape (4,)
    difference: np.ndarray = field(default_factory=lambda: np.zeros(4))
    last: float = 0.0  #: power of the supports at the end of the long step (W; 2D: W/m)
    moved: float = 0.0  #: sum of the sizes of their works (J; 2D: J/m)
    made: int = 0  #: of the two steps
    #: steps since the last that were compared, of static flow those that flowed
    since: int = _EVERY
    wait: int = 0  #: steps until the next that is doubled
    flowed: int = 0  #: how many of the last steps did in a row

    def __post_init__(self) -> None:
        if self.follows:
            self.since = 0

    @property
    def error(self) -> float:
        """Of the works, as global quantities err by it (J; 2D: J/m)."""
        return (1.0 if self.follows else _OTHERWISE) * float(np.abs(self.left).max())

    @property
    def is_due(self) -> bool:
        """Whether the next step should be tried at twice its size first."""
        return self.size == 0.0 and self.wait <= 0 and (self.flowed > 0 or not self.follows)

    @property
    def begins(self) -> bool:
        """Whether static flow begins, or has not begun."""
        return self.follows and self.flowed < _BEGINNING

    def begin(self, size: float, long: BulkEnergies | None) -> None:
        """Take a step of twice the size; None if it did not converge.

        Args:
            size: of the steps to come (s).
            long: of the long step.
        """
        if long is None:
            self.wait = _EVERY
        else:
            self.size, self.difference, self.made, self.moved = size, works(long), 0, 0.0
            self.last = long.power

    def take(self, size: float, energies: BulkEnergies, rest: float) -> bool:
        """Take a step that was made; whether two were compared now.

        Args:
            size: of the step (s).
            energies: of the step.
            rest: of the run after it (s).
        """
        flows = energies.plastic > _LITTLE * energies.elastic > 0.0
        self.flowed = self.flowed + 1 if flows else 0
        if self.follows and energies.power != 0.0:  # supports at rest do no work
            self._go_on(size, energies)
        self.since += flows or not self.follows
        self.wait = _FIRST if self.follows and self.flowed == 1 else self.wait - 1
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
            self.size, self.wait = 0.0, _EVERY  # another state, as friction may have several
            return False
        # both forces at the motion of the long step, the mean of those of the two
        erred = self.last - 0.5 * (energies.power_before + energies.power)
        self.left = self.left + self.difference * (0.5 * self.since)
        self.power += erred * (0.5 * self.since)
        local = np.abs(self.difference)
        if self.follows and flows:
            lasts = min(size * energies.elastic / energies.plastic, rest)
            local[0] = abs(self.difference[0] + erred * lasts)
        self.local = 0.5 * float(local.max())
        self.size, self.since, self.wait = 0.0, 0, _EVERY
        return True

    def _go_on(self, size: float, energies: BulkEnergies) -> None:
        """What earlier errors of the stresses do in a step."""
        kept = math.exp(-energies.plastic / energies.elastic) if self.flowed > 0 else 1.0
        self.power *= kept
        if energies.power_before != 0.0:
            self.power *= min(max(energies.power / energies.power_before, -_FASTER), _FASTER)
        done, forgotten = self.power * size, (1.0 - kept) * self.left[2]
        self.left = self.left + np.array([done, 0.0, -forgotten, done + forgotten])

    def saved(self) -> dict:
        """All of it."""
        return dict(vars(self))

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave."""
        vars(self).update({k: np.copy(v) if np.ndim(v) else v for k, v in saved.items()})
