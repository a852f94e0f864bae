# SPDX-License-Identifier: LGPL-3.0-or-later
"""What contacts that come and go keep from one step to the next.

A contact is known by its key. Its impulse, the first guess of the next step, and its slip are kept
in global axes, for its frame turns with the bodies.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

from xper_fx.nscd.exchange import Sides
from xper_fx.nscd.laws.law import LawKernels

if TYPE_CHECKING:
    from xper_fx.nscd.interactions import PointGroup


class _Record(NamedTuple):
    """The contacts of one law at the end of a step, in the order of their keys."""

    keys: np.ndarray
    impulse: np.ndarray
    jump: np.ndarray
    state: np.ndarray


class ContactHistory:
    """The contacts of a step that was committed.

    Args:
        groups: the contacts by law and sides, with the sorted keys, shape (num_contacts, 2), of the
            set that each is part of.
    """

    def __init__(self, groups: list[tuple[PointGroup, np.ndarray]]):
        self._records: dict[tuple[LawKernels, Sides], _Record] = {}
        for g, keys in groups:
            order = np.argsort(g.indices)
            frame = g.points.frame[order]
            self._records[g.kernels, g.sides] = _Record(
                keys[g.indices[order]],
                np.einsum("pij,pi->pj", frame, g.committed_impulse[order]),
                np.einsum("pij,pi->pj", frame[:, 1:], g.jump[order, 1:]),
                g.state[order],
            )

    def hand_on(self, group: PointGroup, keys: np.ndarray) -> None:
        """Let the contacts of a group go on where those with the same keys ended.

        Args:
            group: contacts just found, with the start of a new contact.
            keys: shape (num_contacts, 2), sorted, those of the set that the group is part of.
        """
        record = self._records.get((group.kernels, group.sides))
        if record is None:
            return
        order = np.argsort(group.indices)
        known = _matches(record.keys, keys[group.indices[order]])
        new, old = order[known >= 0], known[known >= 0]
        frame = group.points.frame[new]
        group.committed_impulse[new] = np.einsum("pij,pj->pi", frame, record.impulse[old])
        group.jump[new, 1:] = np.einsum("pij,pj->pi", frame[:, 1:], record.jump[old])
        group.state[new] = record.state[old]


@njit
def _matches(old, new):
    """Where each new key is among the old ones, -1 if nowhere; both are sorted and unique."""
    found = np.full(len(new), -1)
    at = 0
    for i in range(len(new)):
        while at < len(old):
            order = 0
            for part in range(old.shape[1]):
                if old[at, part] != new[i, part]:
                    order = -1 if old[at, part] < new[i, part] else 1
                    break
            if order >= 0:
                if order == 0:
                    found[i] = at
                break
            at += 1
    return found
