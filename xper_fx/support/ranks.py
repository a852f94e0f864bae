# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ranks that simulate a scene together, and what they have to agree on.

Sums are made in the order of the ranks, on every rank: all get the same bits, so that decisions
(cut a step, stop a solver) are the same everywhere without being told. Of very many ranks MPI makes
them: by its standard "the result" of MPI_Allreduce is in the buffers of all (MPI 4.0, 6.9.6).
"""

from __future__ import annotations

import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NoReturn, TextIO

import numpy as np
from mpi4py import MPI

# Ranks up to which each has the values of all, and adds them up itself.
_FEW = 64
# Seconds that a rank that has failed waits for the others to fail, too; tag of what it tells them.
_PATIENCE, _FAILED = 30.0, 32_001
# Seconds that a rank leaves to those before it, which may be about to say the same.
_GRACE, _TURN, _LONGEST = 1.0, 0.2, 10.0


class Ranks:
    """The ranks of a communicator.

    Args:
        comm: communicator.

    Attributes:
        rank, size: this rank, and how many there are.
        alone: whether there is only one.
    """

    def __init__(self, comm: MPI.Comm):
        self.comm, self.rank, self.size = comm, comm.rank, comm.size
        self.alone = comm.size == 1

    def sum(self, value):
        """Sum of numbers, or of arrays of one shape, in double precision."""
        if self.alone:
            return value
        if self.size > _FEW:
            return _plain(self._reduced(value, MPI.SUM))
        return _plain(np.add.reduce(self._of_all(value), axis=0))

    def max(self, value):
        """Largest of numbers, or of arrays of one shape entry by entry, in double precision.

        What is no number (NaN) on a rank is none in what all get.
        """
        if self.alone:
            return value
        if self.size > _FEW:
            # MPI_MAX may pass by what is no number
            missing = np.isnan(value)
            told = np.where(missing, -np.inf, value), missing
            largest, missing = self._reduced(np.stack(told), MPI.MAX)
            return _plain(np.where(missing > 0.0, np.nan, largest))
        return _plain(np.maximum.reduce(self._of_all(value), axis=0))

    def box(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Low and high corner of the box around the points of all ranks, of which one has some."""
        low, high = points.min(axis=0, initial=np.inf), points.max(axis=0, initial=-np.inf)
        return -self.max(-low), self.max(high)

    def sum_and_max(self, added, compared):
        """Sum of the first and largest of the second; ranks wait for each other once.

        Of very many ranks what is no number is not told in the largest: it is to be in the sum.
        """
        if self.alone:
            return added, compared
        if self.size > _FEW:
            pending = [self._reducing(added, MPI.SUM), self._reducing(compared, MPI.MAX)]
            MPI.Request.Waitall([request for request, _, _ in pending])
            total, largest = (found for _, _, found in pending)
            return _plain(total), _plain(largest)
        added, compared = (np.asarray(value, np.float64) for value in (added, compared))
        of_all = self._of_all(np.concatenate([added.ravel(), compared.ravel()]))
        total = np.add.reduce(of_all[:, : added.size], axis=0)
        largest = np.maximum.reduce(of_all[:, added.size :], axis=0)
        return _plain(total.reshape(added.shape)), _plain(largest.reshape(compared.shape))

    def _reducing(self, value, op: MPI.Op) -> tuple[MPI.Request, np.ndarray, np.ndarray]:
        """As `_reduced`, on its way: the request, the buffer it reads, the one it will have."""
        own, found = np.ascontiguousarray(value, np.float64), np.empty(np.shape(value))
        return self.comm.Iallreduce(own, found, op), own, found

    def _reduced(self, value, op: MPI.Op) -> np.ndarray:
        """What MPI makes of the values of all ranks."""
        own, found = np.ascontiguousarray(value, np.float64), np.empty(np.shape(value))
        self.comm.Allreduce(own, found, op)
        return found

    def _of_all(self, value) -> np.ndarray:
        """The values of all ranks, in their order.

        All send doubles: the sum of nothing is an integer on a rank that has nothing.
        """
        own = np.ascontiguousarray(value, np.float64)
        values = np.empty((self.size, *np.shape(value)), own.dtype)
        self.comm.Allgather(own, values)
        return values

    def union(self, numbers: np.ndarray) -> np.ndarray:
        """Whole numbers, shape (n,), that any rank gives, ascending and each once."""
        parts = [numbers] if self.alone else self.comm.allgather(numbers)
        return np.unique(np.concatenate(parts))

    def before(self, count: int) -> int:
        """Sum of a number over the ranks before this one."""
        return 0 if self.alone else int(self._of_all(count)[: self.rank].sum())

    def all(self, condition) -> bool:
        """Whether something holds on all ranks."""
        if self.alone:
            return bool(condition)
        return self.max(float(not condition)) == 0.0

    def together(self, call: Callable[[], Any]) -> Any:
        """Let each rank do something; what the first that fails raises is raised on all.

        Args:
            call: communicates with no other rank.

        Returns:
            What it gives on this rank.
        """
        if self.alone:
            return call()
        given = error = None
        try:
            given = call()
        except Exception as raised:  # noqa: BLE001 - raised again below, on every rank
            error = raised
        for raised in self.comm.allgather(error):
            if raised is not None:
                raise raised
        return given

    def from_first(self, call: Callable[[], Any]) -> Any:
        """What the first rank finds, on all; what it raises is raised on all."""
        return self.comm.bcast(self.together(call if self.rank == 0 else lambda: None))

    def at_root(self, call: Callable[[], object]) -> None:
        """Let the first rank do something for all; what it raises is raised on all."""
        self.together(call if self.rank == 0 else lambda: None)

    @contextmanager
    def ending_all(self) -> Iterator[None]:
        """What a rank raises within, and not all do, ends all ranks: they would wait for it.

        Where all raise, each goes on with its own error. An interrupt and an exit are such, too; a
        generator that is left is not.
        """
        try:
            yield
        except GeneratorExit:
            raise
        except BaseException:
            self.end_unless_all_fail()
            raise

    def end_unless_all_fail(self) -> None:
        """End all ranks with the error that is being handled, if others handle none."""
        if not (self.alone or self._all_fail()):
            end_all(self.comm, sys.__stderr__)

    def _all_fail(self) -> bool:
        """Whether all ranks call this in time; they tell each other beside what else they send."""
        others = [rank for rank in range(self.size) if rank != self.rank]
        waited = [self.comm.Isend(bytearray(1), rank, _FAILED) for rank in others]
        waited += [self.comm.Irecv(bytearray(1), rank, _FAILED) for rank in others]
        end = time.monotonic() + _PATIENCE
        while not (done := MPI.Request.Testall(waited)) and time.monotonic() < end:
            time.sleep(0.01)
        return done

    def gather(self, numbers: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Entries of an array that is spread over the ranks, on every rank.

        Args:
            numbers: shape (n,), which entries this rank has; every one is on some rank.
            values: shape (n, ...).

        Returns:
            Shape (number of entries, ...).
        """
        if self.alone:
            parts = [(numbers, values)]
        else:
            parts = self.comm.allgather((numbers, np.ascontiguousarray(values)))
        count = 1 + max((int(n.max()) for n, _ in parts if len(n)), default=-1)
        whole = np.zeros((count, *values.shape[1:]), values.dtype)
        for n, v in parts:
            whole[n] = v
        return whole


def end_all(comm: MPI.Comm, terminal: TextIO) -> NoReturn:
    """Print the error that is being handled, and end all ranks; several speak in their order."""
    if comm.rank > 0:
        time.sleep(min(_GRACE + _TURN * comm.rank, _LONGEST))
    terminal.write(f"Rank {comm.rank} of {comm.size} failed:\n")
    traceback.print_exc(file=terminal)
    terminal.flush()
    comm.Abort(1)


def _plain(value):
    """A number as Python has it, an array as it is."""
    return value if np.ndim(value) else value.item()


ALONE = Ranks(MPI.COMM_SELF)
"""This rank by itself."""
