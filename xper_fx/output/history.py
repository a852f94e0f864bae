# SPDX-License-Identifier: LGPL-3.0-or-later
"""The history of a run, `history.csv`: a line a step.

It can be read while the run goes on and after it was killed: a line that was written stays
readable. SI units throughout; in 2D, forces and energies are per metre of depth.
"""

import csv
import errno
import io
import logging
import math
import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Self

import numpy as np
import numpy.typing as npt

from xper_fx.support.checks import require_path
from xper_fx.support.files import explained, write_all

logger = logging.getLogger(__name__)

HISTORY_COLUMNS: tuple[str, ...] = (
    "step",
    "time",
    "strain",
    "stress",
    "sweeps",
    "residual",
    "external_work",
    "kinetic",
    "elastic",
    "cohesive",
    "dissipated_cohesion",
    "dissipated_friction",
    "dissipated_impact",
    "dissipated_viscous",
    "dissipated_numerical",
    "closure",
)
"""Columns of ``history.csv``: time in s, strain dimensionless, stress in Pa, energies and their
closure error in J (J/m in 2D); ``sweeps`` and ``residual`` are those of the interaction solver.
Effects that a scene calls for add columns: dissipated_plastic; dissipated_viscous_bonds; shadow of
an explicit bulk; F11... and P11... of a cell; contacts, coordination and overlap (m) of rigid
bodies, and healing, what they were given where overlaps were taken back."""


class History:
    """A table with one line a step, on disk as soon as the step is done.

    Args:
        path: The file, usually ``history.csv``; one that is there is replaced.
        columns: Names of the columns, in their order.
        after: Bytes of a table that is there (:meth:`flush`), after which it goes on; what was
            written later is dropped. None for a new table.

    Raises:
        ValueError: If a column occurs twice or is not a Python identifier, or the table that is
            there is shorter or has other columns.
        OSError: If the file cannot be written.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        columns: Sequence[str] = HISTORY_COLUMNS,
        after: int | None = None,
    ) -> None:
        self.path = Path(path).resolve()
        self.columns = tuple(columns)
        if len(set(self.columns)) != len(self.columns) or not all(
            column.isidentifier() for column in self.columns
        ):
            raise ValueError(
                f"Columns should be different Python identifiers, got {list(self.columns)}."
            )
        head = ",".join(self.columns) + "\n"
        if after is None:
            with explained(self.path):
                self._file = io.FileIO(self.path, "w")
            self._write_line(head.rstrip())
            return
        there = self.path.read_bytes()[:after] if self.path.exists() else b""
        if len(there) != after or not (there.startswith(head.encode()) and there.endswith(b"\n")):
            raise ValueError(
                f"'{self.path}' does not begin with the {after} bytes of steps that were written "
                "to it: put it back, or start the run from its beginning."
            )
        with explained(self.path):
            os.truncate(self.path, after)
            self._file = io.FileIO(self.path, "a")

    def flush(self) -> int:
        """See all lines on the disk; how many bytes they take."""
        with explained(self.path):
            os.fsync(self._file.fileno())
        return self._file.seek(0, os.SEEK_END)

    def append(self, **values: float) -> None:
        """Write the line of one step, in full double precision.

        Args:
            **values: One number for each column: integers as such, all else as float64.

        Raises:
            ValueError: If a column is missing, unknown, or NaN; nothing is written then.
            OSError: If the file cannot be written, or was removed; no part of the line is left.
        """
        missing = [column for column in self.columns if column not in values]
        unknown = [column for column in values if column not in self.columns]
        if missing or unknown:
            raise ValueError(
                f"A line of '{self.path.name}' needs each column once: "
                f"missing {missing}, unknown {unknown}."
            )
        line = []
        for column in self.columns:
            value = values[column]
            if isinstance(value, (int, np.integer)):
                line.append(str(int(value)))
                continue
            if math.isnan(value):
                raise ValueError(
                    f"The column '{column}' of '{self.path.name}' is not a number: the step "
                    "that gave it is wrong."
                )
            line.append(repr(float(value)))
        self._write_line(",".join(line))

    def _write_line(self, line: str) -> None:
        """One unbuffered write: a killed run leaves whole lines, and so does a full disk."""
        with explained(self.path):
            if os.fstat(self._file.fileno()).st_nlink == 0:
                raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))
            whole = self._file.seek(0, os.SEEK_END)
            try:
                write_all(self._file, (line + "\n").encode())
            except OSError:
                with suppress(OSError):
                    self._file.truncate(whole)
                raise

    def close(self) -> None:
        """Close the file; no more can be appended."""
        with explained(self.path):
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def read_history(path: str | os.PathLike[str]) -> dict[str, npt.NDArray[np.float64]]:
    """Read a table written by :class:`History`, bit for bit, also while the run goes on.

    Args:
        path: The file, usually ``history.csv``.

    Returns:
        For each column an array of shape (num_steps,), float64. A last line without its end, left
        by a run that was killed, is not counted.

    Raises:
        ValueError: If a line has not one number for each column.
        TypeError: If the path is none.
        OSError: If the file cannot be read.
    """
    path = require_path("path", path)
    try:
        lines = path.read_text().splitlines(keepends=True)
    except UnicodeDecodeError as error:
        raise ValueError(f"'{path}' is no table of a history, but no text: {error}.") from None
    if lines and not lines[-1].endswith("\n"):
        logger.warning("%s: the last line is incomplete and left out", path)
        lines.pop()
    rows = list(csv.reader(lines))
    if not rows:
        raise ValueError(f"'{path}' is empty, expected a line of column names.")
    for number, row in enumerate(rows, start=1):
        if len(row) != len(rows[0]):
            raise ValueError(
                f"'{path}', line {number}: got {len(row)} values for {len(rows[0])} columns."
            )
    table = np.array([_numbers(path, n, row) for n, row in enumerate(rows[1:], start=2)])
    table = table.reshape(-1, len(rows[0]))
    return {name: table[:, column].copy() for column, name in enumerate(rows[0])}


def _numbers(path: Path, number: int, row: Sequence[str]) -> list[float]:
    try:
        return [float(value) for value in row]
    except ValueError as error:
        raise ValueError(f"'{path}', line {number}: expected numbers, {error}.") from None
