# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts that a search has found, and what they take over from those of the step before."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from xper_fx.nscd.contact_history import ContactHistory, kernels_of_contacts
from xper_fx.nscd.grouping import Grouping
from xper_fx.nscd.halo_protocol import ContactHalo, PointHalo, Reductions
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.laws.law import Law
from xper_fx.nscd.point_group import PointGroup
from xper_fx.nscd.points import InteractionPoints


class FoundPoints(NamedTuple):
    """Contacts that a search has found."""

    #: on the node slots, `gap` in the middle of the step, at x0 + h (1 - theta) v0
    points: InteractionPoints
    law_of_point: np.ndarray  #: shape (num_points,), index into the laws
    keys: np.ndarray  #: shape (num_points, 2), what contacts are known by from step to step, sorted
    #: as of `spin_arms` of the search; None where no side is meshed, or none is asked
    spin_arms: np.ndarray | None = None


class _ContactSet(NamedTuple):
    """Contacts in use, by law, with what tells whether a search has found the same again.

    `rolling` has the rolling points of those whose law has them.
    """

    nodes: np.ndarray
    law_of_point: np.ndarray
    keys: np.ndarray
    phase: np.ndarray
    copies: int
    groups: list[PointGroup]
    rolling: list[PointGroup]

    def are(self, found: FoundPoints, phase: np.ndarray, copies: int) -> bool:
        """Whether the found contacts are these, at other places."""
        told = (found.points.nodes, found.law_of_point, found.keys, phase, copies)
        return all(map(np.array_equal, self[:5], told))


class FoundContacts:
    """The contacts in use.

    Args:
        grouping: makes groups of contacts.
        laws: the laws in use.
        dim: 2 or 3.

    Attributes:
        history: of the contacts of the last committed step, None before the first.
    """

    def __init__(self, grouping: Grouping, laws: Sequence[Law], dim: int):
        self._grouping, self._dim = grouping, dim
        self._kernels = kernels_of_contacts(laws, dim)
        self._sets: list[_ContactSet] = []
        self.history: ContactHistory | None = None

    @property
    def groups(self) -> list[PointGroup]:
        """The contacts by law."""
        return [group for known in self._sets for group in known.groups]

    @property
    def rolling(self) -> list[PointGroup]:
        """The rolling points of contacts, by law."""
        return [group for known in self._sets for group in known.rolling]

    def keys_of(self, group: PointGroup) -> np.ndarray:
        """Keys of the contacts of one of the groups, shape (n, 2)."""
        known = next(k for k in self._sets if any(group is own for own in k.groups))
        return known.keys[group.indices]

    def renew(
        self,
        found: list[FoundPoints],
        inverse: BodyInverse,
        halo: PointHalo | ContactHalo | None,
        start: np.ndarray,
        times: tuple[float, float],
    ) -> None:
        """Put new contacts in the place of those of the last step; the known ones go on.

        Args:
            found: sets of contacts.
            inverse: blocks of w.
            halo: of ranks that divide them.
            start: shape (num_slots, dim), velocities at the start of the step (m/s).
            times: h, and the time from the start of the step to when they were found (s).
        """
        before, self._sets, later = self._sets, [], self.history is not None
        step, opened = times
        grouping, copies = self._grouping, 1 if halo is None else halo.copies
        for new in found:
            phase = np.zeros(len(new.keys), int) if halo is None else halo.phase_of(new.points)
            same = next((old for old in before if old.are(new, phase, copies)), None)
            if same is None:
                groups = grouping.groups(inverse, new.points, new.law_of_point, start, phase, later)
                if copies > 1:
                    groups = [_of_copy(group, copies) for group in groups]
            else:
                groups = [
                    grouping.again(inverse, group, new.points, new.law_of_point, start, later)
                    for group in same.groups
                ]
            for group in groups:
                group.jump[:, 0] -= opened * group.velocity[:, 0]
            resisting = [group for group in groups if group.kernels.rolling is not None]
            rolling = [grouping.rolling_points(inverse, group, start) for group in resisting]
            if self.history is not None:
                for group in (*groups, *rolling):
                    self.history.transfer(group, new.keys)
                    _turn_slips(group, start, step, new.spin_arms)
            known = (new.points.nodes, new.law_of_point, new.keys, phase, copies)
            self._sets.append(_ContactSet(*known, groups, rolling))

    def regroup(self, grouping: Grouping) -> None:
        """Make groups on other slots; contacts go on by their keys."""
        self._grouping, self._sets = grouping, []

    def commit(self) -> None:
        """Remember what the step has left of them."""
        self.history = ContactHistory(
            [
                (group, known.keys)
                for known in self._sets
                for group in (*known.groups, *known.rolling)
            ]
        )

    def share_history(self, ranks: Reductions) -> None:
        """Let contacts go on from the last step on whichever rank they are found now.

        All ranks call it together.
        """
        if self.history is not None:
            self.history.share(ranks, self._kernels)

    def saved(self) -> dict[str, dict[str, np.ndarray]]:
        """Their history, by law; empty before the first committed step."""
        return {} if self.history is None else self.history.saved(self._kernels)

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave, its rows in order."""
        self.history = ContactHistory.restored(saved, self._kernels, self._dim)


def _of_copy(group: PointGroup, copies: int) -> PointGroup:
    """Contacts that move one of the copies of a periodic cell that stress drives."""
    cell_w = copies * group.couplings.cell_w
    return replace(group, couplings=group.couplings._replace(cell_w=cell_w))


def _turn_slips(group: PointGroup, start: np.ndarray, step: float, arms: np.ndarray | None) -> None:
    """Let slips in which energy is held follow bodies that spin about the normal (3D).

    They are kept in the axes of space, and turn with the mean spin of both sides, those left out
    that have none: nodes.

    Args:
        group: contacts that go on, with the slips of the last step.
        start: shape (num_slots, dim), velocities at the start of the step (m/s, rad/s).
        step: h (s).
        arms: `FoundPoints.spin_arms`.
    """
    c, kernels = group.couplings, group.kernels
    if kernels.stored is None or kernels.components != 3:
        return
    spins, about = np.zeros((len(group), 2), bool), np.zeros((len(group), 2))
    if c.rotation_dof is not None:
        spins = c.rotation_dof != c.start[:, :, 0]
        spin = start.reshape(-1)[c.rotation_dof[:, :, None].astype(int) + np.arange(3)]
        about = np.einsum("psd,pd->ps", spin, c.frame[:, 0]) * spins
    if arms is not None:
        own = arms[group.indices]
        about += np.einsum("pskd,pskd->ps", own, start[group.points.nodes])
        spins |= own.any(axis=(2, 3))
    angle = step * about.sum(axis=1) / np.maximum(spins.sum(axis=1), 1)
    cosine, sine = np.cos(angle), np.sin(angle)
    one, two = group.jump[:, 1].copy(), group.jump[:, 2].copy()
    group.jump[:, 1], group.jump[:, 2] = cosine * one - sine * two, sine * one + cosine * two
