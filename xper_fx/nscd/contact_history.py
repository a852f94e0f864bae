# SPDX-License-Identifier: LGPL-3.0-or-later
"""What contacts that come and go keep from one step to the next.

A contact is known by its key. Its impulse, the first guess of the next step, and its slip are kept
in global axes, for its frame turns with the bodies.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.couplings import Sides
from xper_fx.nscd.halo_protocol import Reductions
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.nscd.laws.law import Law, LawKernels
from xper_fx.nscd.point_group import PointGroup


class _Record(NamedTuple):
    """The contacts of one law at the end of a step, in the order of their keys."""

    keys: np.ndarray
    impulse: np.ndarray
    slip: np.ndarray
    state: np.ndarray


class ContactHistory:
    """The contacts of a step that was committed.

    Args:
        groups: the contacts by law and sides, with the sorted keys, shape (num_contacts, 2), of the
            set that each is part of.
    """

    def __init__(self, groups: list[tuple[PointGroup, np.ndarray]]):
        records: dict[tuple[LawKernels, Sides], list[_Record]] = {}
        for g, keys in groups:
            dim = g.points.dim
            record = _Record(
                keys=np.empty((len(g), keys.shape[1]), keys.dtype),
                impulse=np.empty((len(g), dim)),
                slip=np.empty((len(g), dim)),
                state=np.empty(g.state.shape),
            )
            places = _places(g.indices, len(keys))
            _keep(places, keys, g.points.frame, g.committed_impulse, g.jump, g.state, record)
            records.setdefault((g.kernels, g.sides), []).append(record)
        self._records = {kind: _merged(parts) for kind, parts in records.items()}

    def transfer(self, group: PointGroup, keys: np.ndarray) -> None:
        """Let the contacts of a group go on where those with the same keys ended.

        Args:
            group: contacts just found, with the start of a new contact.
            keys: shape (num_contacts, 2), sorted, those of the set that the group is part of.
        """
        record = self._records.get((group.kernels, group.sides))
        if record is not None:
            g, places = group, _places(group.indices, len(keys))
            _go_on(places, keys, g.points.frame, g.committed_impulse, g.jump, g.state, record)

    def share(self, ranks: Reductions, kernels: list[LawKernels]) -> None:
        """Let every rank know the contacts of all; all ranks call it together.

        Args:
            ranks: the ranks, each of which has other contacts.
            kernels: of the laws, in the same order on all ranks.
        """
        own = [
            (kernels.index(law), sides, record) for (law, sides), record in self._records.items()
        ]
        records: dict[tuple[LawKernels, Sides], list[_Record]] = {}
        for law, sides, record in chain.from_iterable(ranks.comm.allgather(own)):
            records.setdefault((kernels[law], sides), []).append(record)
        self._records = {kind: _merged(parts) for kind, parts in records.items()}

    def saved(self, kernels: Sequence[LawKernels]) -> dict[str, dict[str, np.ndarray]]:
        """All records, which all ranks know (`share`), in the order of their keys.

        Names are the number among kernels, nodes a side, whether with lever arms and branches.
        """
        return {
            f"{kernels.index(law)} {sides.k} {int(sides.lever_arms)} {int(sides.branches)}": (
                record._asdict()
            )
            for (law, sides), record in self._records.items()
        }

    @classmethod
    def restored(
        cls, saved: Mapping[str, Mapping[str, np.ndarray]], kernels: Sequence[LawKernels], dim: int
    ) -> ContactHistory:
        """The history that `saved` told of; `kernels` are those of each law."""
        history = cls([])
        for name, record in saved.items():
            law, k, lever_arms, branches = map(int, name.split())
            sides = Sides(dim, kernels[law].components, k, bool(lever_arms), bool(branches))
            history._records[kernels[law], sides] = _Record(**record)
        return history


def kernels_of_contacts(laws: Sequence[Law], dim: int) -> list[LawKernels | None]:
    """Kernels of each law, then those of its rolling points, None where it has none."""
    own = [law.kernels(dim) for law in laws]
    return own + [kernels.rolling for kernels in own]


def _merged(parts: list[_Record]) -> _Record:
    """Records of one kind of contacts as one, in the order of their keys."""
    if len(parts) == 1:
        return parts[0]
    joined = _Record(*map(np.concatenate, zip(*parts, strict=True)))
    order = np.lexsort(joined.keys.T[::-1])
    keys = joined.keys[order]
    # what several ranks know is the same on all
    new = np.ones(len(keys), bool)
    new[1:] = np.any(keys[1:] != keys[:-1], axis=1)
    return _Record(*(array[order[new]] for array in joined))


def _places(indices: np.ndarray, count: int) -> np.ndarray:
    """Where each contact is in its group, -1 if it is in another."""
    place = np.full(count, -1)
    place[indices] = np.arange(len(indices))
    return place


@njit(**LEAN_ENTRY)
def _keep(place, keys, frame, impulse, jump, state, kept):
    """Write the contacts of a group in the order of their keys, vectors in global axes."""
    at = 0
    for number in range(len(place)):
        i = place[number]
        if i < 0:
            continue
        for part in range(keys.shape[1]):
            kept.keys[at, part] = keys[number, part]
        for n in range(state.shape[1]):
            kept.state[at, n] = state[i, n]
        for d in range(frame.shape[2]):
            total, slip = 0.0, 0.0
            for x in range(frame.shape[1]):
                total += frame[i, x, d] * impulse[i, x]
                if x > 0:
                    slip += frame[i, x, d] * jump[i, x]
            kept.impulse[at, d], kept.slip[at, d] = total, slip
        at += 1


@njit(**LEAN_ENTRY)
def _go_on(place, keys, frame, impulse, jump, state, kept):
    """Give the contacts of a group what those with their keys have left; both are sorted."""
    at = 0
    for number in range(len(place)):
        i = place[number]
        if i < 0:
            continue
        order = -1
        while at < len(kept.keys):
            order = 0
            for part in range(keys.shape[1]):
                if kept.keys[at, part] != keys[number, part]:
                    order = -1 if kept.keys[at, part] < keys[number, part] else 1
                    break
            if order >= 0:
                break
            at += 1
        if order != 0 or at == len(kept.keys):
            continue
        for n in range(state.shape[1]):
            state[i, n] = kept.state[at, n]
        for x in range(frame.shape[1]):
            total, slip = 0.0, 0.0
            for d in range(frame.shape[2]):
                total += frame[i, x, d] * kept.impulse[at, d]
                slip += frame[i, x, d] * kept.slip[at, d]
            impulse[i, x] = total
            if x > 0:
                jump[i, x] = slip
