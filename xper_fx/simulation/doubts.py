# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a run goes on with although it may be wrong: told at the first step, counted to the end."""

from __future__ import annotations

import logging
from collections import Counter

import numpy as np

from xper_fx.nscd.stepped_points import StepWork
from xper_fx.simulation.energy_ledger import BulkEnergies, EnergyLedger

logger = logging.getLogger(__name__)

BROKEN_FOR_NOTHING = "bonds broke that stay closed, for no energy; take a smaller step or tolerance"
UNSEEN = "bodies move so far that they may pass through each other unseen; take a smaller step"
STRAYED = (
    "broken lips that have slid press along the directions that they had, and their bodies have "
    "turned on; name a contact between the bodies' surfaces (Scene(contacts=...))"
)
SUNK = (
    "bodies that touch have moved into each other within a step; take a smaller step, or in slow "
    'runs laws with contact="position"'
)
OVERLAP = "bodies overlap at the start; place them apart"
STRAINED = "cells stretch or turn beyond what small strain bears; take a material at finite strain"
TURNED = "bonds turn beyond what small strain bears; take a material at finite strain"
_SNAPS = (
    "the load snaps, as it frees energy that no bond takes up; with path=xf.GrowthControl() the "
    "load is found that the structure bears, if its bonds are not initially rigid ones"
)
_SLIDES = (
    "the load snaps, as bodies slide and free energy that friction does not take up, and no state "
    "on the way is in balance; give the bodies inertia to see what happens there"
)
_LETS_GO = (
    "the load snaps, as bodies let go of each other and free energy that nothing takes up; take "
    'smaller steps and laws with contact="position", whose lips do not sink in, or give the bodies '
    "inertia to see what happens there"
)
_CLIMBED = (
    "a static step breaks bonds for energy that nothing gave, as where it ends beyond a state that "
    "would need more load, or passes by the largest load; take smaller steps, or "
    "path=xf.GrowthControl()"
)
_PASSED = (
    "a step along the path breaks more than it follows and loses energy, as where it passes by a "
    "snap-back; take a smaller growth or energy of the path"
)
# Depth beside the size of a point's share of a facet, from which on it is told.
_DEEP = 0.2
# Energy from nowhere, relative to what a run was given and holds, above which a user is told; not
# in the first steps, in which energies are as small as their errors.
_UNBALANCED, _FIRST_STEPS = 0.1, 50
# Energy that nothing accounts for beside what a static step dissipates, above which it has snapped.
_SNAPPED = 0.5
# Energy lost in a step along a path beside all that bonds have dissipated, above which it is told.
_LOST = 0.1
# Energy beside the largest that a step held or took, below which nothing has happened.
_NOTHING = 1e-6
# Energy that a slide frees, beside df . du / 2 of loads and beside what is held, above
# which it is a snap (`Doubts.tell_snap`).
_STEEP, _MUCH = 10.0, 1e-3


class Doubts:
    """Doubts about the steps of a run."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._told_balance, self._load, self._most = False, 0.0, 0.0

    def tell(self, doubt: str, number: int, size: float, detail: str = "") -> None:
        """Warn of a step's doubt if it is the first of its kind.

        Args:
            doubt: what is doubted and what to do.
            number: of the step.
            size: h (s).
            detail: of this step, to end the sentence.
        """
        self._counts[doubt] += 1
        if self._counts[doubt] == 1:
            logger.warning("step %d at h = %.3g s: %s%s", number, size, doubt, detail)

    def tell_snap(self, work: StepWork, bulk: BulkEnergies, number: int, size: float) -> None:
        """Warn of a static step that jumped to a state in which bonds are broken, or bodies slid.

        From forces in balance at both ends a linear bulk takes up du . K du / 2 = F + L, beside
        the work of friction by its forces at the end: F = (r1 - r0) . dU / 2, freed where friction
        falls while lips slide, and L = (f1 - f0) . du / 2 of loads and tools. Both go with the
        square of the step where states on the way are in balance, and F / L is then how steeply
        lips follow the load. In a snap L goes to nothing with the step, and F does not. As L
        vanishes where the load is largest, it is at least half of that of the step before, scaled.
        Bonds dissipate less than is freed in a snap if F is more than L, too: joints that slip
        weakens have little left to dissipate in their last step. Where neither friction nor bonds
        take any of it, bodies have let go of each other: a corner that had sunk into another body
        has slid off, or bodies fall that nothing holds. A gap g that closes in the step is booked
        as an impact, r1 g, and F has -r1 g / 2 of it; a force that grows from nothing as lips meet
        frees neither, so that half of the impacts is added to F. Where bonds take more than
        friction and F is much below zero, iterations have gone over a barrier on the way.

        Args:
            work: of the interactions in the step.
            bulk: energies of the bulk in it.
            number, size: as of `tell`.
        """
        self._load = max(0.5 * self._load, bulk.change_work / size**2)
        freed = work.numerical + 0.5 * work.impact
        held = bulk.elastic + work.stored + work.friction + work.cohesion
        self._most = max(self._most, held)
        if -freed > _UNBALANCED * self._most and work.cohesion > max(work.friction, 0.0):
            told = f": bonds dissipate {work.cohesion:.3g} J, {-freed:.3g} J of it from nowhere"
            self.tell(_CLIMBED, number, size, told)
            return
        steep = freed > max(_STEEP * self._load * size**2, _MUCH * held, _NOTHING * self._most)
        if steep and work.friction > max(work.cohesion, _MUCH * freed):
            told = f": friction takes {work.friction:.3g} J, {freed:.3g} J more is freed"
            self.tell(_SLIDES, number, size, told)
            return
        if steep and work.cohesion < _MUCH * freed:
            self.tell(_LETS_GO, number, size, f": {freed:.3g} J")
            return
        snapped = work.numerical > _SNAPPED * work.cohesion > 0.0
        if snapped and work.numerical > max(self._load * size**2, _NOTHING * self._most):
            told = f": bonds dissipate {work.cohesion:.3g} J, {work.numerical:.3g} J more is freed"
            self.tell(_SNAPS, number, size, told)

    def tell_passed(self, work: StepWork, cohesion: float, number: int, size: float) -> None:
        """Warn of a step along a path between whose ends there are states that it has left out.

        Args:
            work: of the interactions in the step.
            cohesion: what bonds have dissipated so far (J).
            number, size: as of `tell`.
        """
        passed = work.numerical > _SNAPPED * work.cohesion > 0.0
        if passed and work.numerical > _LOST * cohesion:
            self.tell(_PASSED, number, size, f": {work.numerical:.3g} J of {cohesion:.3g} J")

    def tell_depth(self, share: float, depth: float, number: int, size: float) -> None:
        """Warn of bodies that are in each other.

        Args:
            share, depth: as `deepest` of the contacts gives them.
            number, size: as of `tell`.
        """
        if share > _DEEP:
            self.tell(SUNK, number, size, f": by up to {depth:.3g} m")

    def tell_balance(self, ledger: EnergyLedger, displacement: np.ndarray, number: int) -> None:
        """Warn once of energies that do not balance.

        Args:
            ledger: of the run.
            displacement: at the end of the last step (m).
            number: of the step.
        """
        from_nowhere = ledger.from_nowhere
        if self._told_balance or number < _FIRST_STEPS or from_nowhere < _UNBALANCED:
            return
        if ledger.is_rounding(displacement):
            return
        self._told_balance = True
        logger.warning(
            "after step %d %.2g of the energy has come from nowhere or is lost "
            "(dissipated_numerical below zero, closure): take a smaller step or tolerance, or ask "
            "for an accuracy",
            number, from_nowhere,
        )  # fmt: skip

    def sum_up(self) -> None:
        """Warn of what was not the only step of its kind, and begin anew."""
        for doubt, count in self._counts.items():
            if count > 1:
                logger.warning("%d steps: %s", count, doubt)
        self._counts.clear()
