# SPDX-License-Identifier: LGPL-3.0-or-later
"""Values that ranks give each other, by persistent requests of MPI."""

from __future__ import annotations

import weakref
from collections.abc import Mapping

import numpy as np
from mpi4py import MPI

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.support.ranks import Ranks

# Tag of these messages; that of ranks that fail is the one before (`support/ranks.py`).
_TAG = 32_002


class Exchange:
    """Moves entries of velocity arrays between slots and their ghosts.

    Args:
        given: slots whose entries go to other ranks, by rank, in the order of their ghosts.
        ghosts: slots that take them, by the rank that they come from.
        dim: dofs a slot.
    """

    def __init__(
        self,
        ranks: Ranks,
        given: Mapping[int, np.ndarray],
        ghosts: Mapping[int, np.ndarray],
        dim: int,
    ):
        self._own, self._mirrored = _entries(given, dim), _entries(ghosts, dim)
        self._own_values = np.empty(len(self._own))
        self._mirrored_values = np.empty(len(self._mirrored))
        comm = ranks.comm
        own = _parts(given, self._own_values, dim)
        mirrored = _parts(ghosts, self._mirrored_values, dim)
        self._there = [comm.Recv_init(part, rank, _TAG) for rank, part in mirrored]
        self._there += [comm.Send_init(part, rank, _TAG) for rank, part in own]
        self._back = [comm.Recv_init(part, rank, _TAG) for rank, part in own]
        self._back += [comm.Send_init(part, rank, _TAG) for rank, part in mirrored]
        weakref.finalize(self, _free, self._there + self._back)

    def forward(self, values: np.ndarray) -> None:
        """Ghosts take the values of their owners; `values` is flat, of all slots."""
        _take(values, self._own, self._own_values)
        _exchange(self._there)
        _put(values, self._mirrored, self._mirrored_values)

    def back(self, values: np.ndarray) -> None:
        """Owners take the values of their ghosts, of which each has one."""
        self._bring_back(values)
        _put(values, self._own, self._own_values)

    def add_back(self, values: np.ndarray) -> None:
        """Owners add the values of their ghosts."""
        self._bring_back(values)
        _add(values, self._own, self._own_values)

    def _bring_back(self, values: np.ndarray) -> None:
        _take(values, self._mirrored, self._mirrored_values)
        _exchange(self._back)

    @property
    def nbytes(self) -> int:
        """Memory of the values exchanged and of where they are, in bytes."""
        arrays = (self._own, self._mirrored, self._own_values, self._mirrored_values)
        return sum(array.nbytes for array in arrays)

    @property
    def bytes_sent(self) -> int:
        """Bytes that this rank sends forward."""
        return self._own_values.nbytes

    @property
    def bytes_returned(self) -> int:
        """Bytes that this rank sends back."""
        return self._mirrored_values.nbytes


def _entries(slots: Mapping[int, np.ndarray], dim: int) -> np.ndarray:
    """Entries of the dofs of slots, rank by rank."""
    joined = np.concatenate([np.zeros(0, np.int64), *slots.values()])
    return (joined[:, None] * dim + np.arange(dim)).ravel()


def _parts(
    slots: Mapping[int, np.ndarray], values: np.ndarray, dim: int
) -> list[tuple[int, np.ndarray]]:
    """What of values goes to which rank, or comes from it; ranks without any are left out."""
    ends = dim * np.cumsum([len(part) for part in slots.values()], dtype=np.int64)
    parts = zip(slots, np.split(values, ends), strict=False)  # nothing comes after the last end
    return [(rank, part) for rank, part in parts if len(part)]


def _exchange(requests: list[MPI.Prequest]) -> None:
    MPI.Prequest.Startall(requests)
    MPI.Request.Waitall(requests)


def _free(requests: list[MPI.Prequest]) -> None:
    for request in requests:
        request.Free()


@njit(**LEAN_ENTRY)
def _take(values, entries, taken):
    for i in range(len(entries)):
        taken[i] = values[entries[i]]


@njit(**LEAN_ENTRY)
def _put(values, entries, given):
    for i in range(len(entries)):
        values[entries[i]] = given[i]


@njit(**LEAN_ENTRY)
def _add(values, entries, given):
    for i in range(len(entries)):
        values[entries[i]] += given[i]
