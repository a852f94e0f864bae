# SPDX-License-Identifier: LGPL-3.0-or-later
"""Writes a run into a folder: bulk and interface series, history of each step, summary.

The folder holds `bulk.xdmf` (displacement, velocity, stress, body, material), `interfaces.xdmf`
(jump, traction, damage, spent share of the fracture energy, status, on the points of facing
facets), `rigid.xdmf` (displacement, velocity, spin, rotation, body, group, diameter, half, on
triangles of the rigid bodies), `history.csv`, `summary.json`, `checkpoint.h5`; of the series those
that the scene has something for.

A checkpoint holds the run, and how far its files had come. A restart takes them back to there, so
that they go on without a step that is missing or there twice.

Where several ranks simulate a scene they record it together: what is divided is gathered, and the
first rank alone writes. Of a mesh that is spread over ranks each rank writes the fields of its own
bodies and points, the first one `bulk_0.xdmf` and `interfaces_0.xdmf`. Whatever goes wrong there is
raised on all.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np

from xper_fx.output.field_series import FieldSeries, remove_series
from xper_fx.output.folder_lock import FolderLock
from xper_fx.output.gauges import CellGauge, TensileGauge, require_gauge
from xper_fx.output.history import HISTORY_COLUMNS, History
from xper_fx.output.output_folder import prepare_folder
from xper_fx.output.run_summary import run_summary
from xper_fx.output.series import TimeSeries
from xper_fx.output.summary import plain, steps_told, write_summary
from xper_fx.simulation.simulation import Simulation, StepRecord
from xper_fx.support.checks import (
    require_count,
    require_flag,
    require_kind,
    require_number,
    require_path,
    require_positive,
)

logger = logging.getLogger(__name__)

# A run's checkpoint in its folder, and seconds between checkpoints unless others are asked for.
CHECKPOINT, CHECKPOINT_EVERY = "checkpoint.h5", 600.0


def macroscopic_columns(simulation: Simulation) -> dict[str, float]:
    """Fbar, Pibar (Pa) and, of a mesh, Hill-Mandel's error of a periodic cell by column name.

    Nothing without a cell that is driven.
    """
    cell = simulation.macroscopic
    if cell is None:
        return {}
    axes = range(simulation.bulk.dim)
    columns = {f"F{i + 1}{j + 1}": float(cell.gradient[i, j]) for i in axes for j in axes}
    columns |= {f"P{i + 1}{j + 1}": float(cell.stress[i, j]) for i in axes for j in axes}
    if hasattr(cell, "hill_mandel"):
        columns["hill_mandel"] = cell.hill_mandel
    return columns


class Recorder:
    """Records a simulation; a context manager.

    Args:
        simulation: the run, before its first step.
        folder: where to write; made if need be, tried before any work.
        gauge: what `strain` and `stress` of the history are; 0 without.
            A periodic cell's history has its macroscopic columns besides.
        fields: number of times at which fields are written, spread evenly; 0 for none.
        fragments: whether cells of `bulk.xdmf` and `rigid.xdmf` bear their `fragment`, as
            `output.find_fragments` gives it at that time, and the history its number of
            `fragments`; bonds are looked at in each step then.
        end_time: time of the end of the run (s).
        parameters: what to keep in the summary of how the run was set up.
        checkpoint_every: seconds between checkpoints, as a clock shows them; 0 for none but where
            a step does not converge.
        restart: whether to go on from the folder's checkpoint; from the beginning if there is none.
            The scene must be the checkpoint's; step, tolerance, solver may be others.

    Attributes:
        folder: where it writes.
        restarted: whether it goes on from a checkpoint.
        strain: of the gauge, after the last step.

    A write that fails raises an OSError that names the file. What was written before stays
    readable, the simulation keeps its state, and a later `record` writes again where it can.

    Raises:
        OSError: the folder cannot be written; BlockingIOError: another run writes there.
        CheckpointError: the checkpoint is damaged, or of another scene or version; the folder is
            as it was then.
        ValueError: a number out of range, a gauge or parameters that cannot be recorded, files that
            do not fit the checkpoint.
        TypeError: something of another kind than is expected.
    """

    def __init__(
        self,
        simulation: Simulation,
        folder: str | os.PathLike[str],
        *,
        end_time: float,
        gauge: TensileGauge | CellGauge | None = None,
        fields: int = 20,
        fragments: bool = False,
        parameters: Mapping[str, Any] | None = None,
        checkpoint_every: float = CHECKPOINT_EVERY,
        restart: bool = False,
    ):
        require_kind("simulation", simulation, Simulation)
        if not require_number("checkpoint_every", checkpoint_every) >= 0.0:
            raise ValueError(
                f"checkpoint_every is a time in seconds, or 0 for none; got {checkpoint_every}."
            )
        require_positive("end_time", end_time)
        if end_time < simulation.time:
            raise ValueError(
                f"end_time {end_time:g} s lies before the present time {simulation.time:g} s."
            )
        require_count("fields", fields, 0)
        require_flag("fragments", fragments)
        require_flag("restart", restart)
        if gauge is not None:
            require_gauge(gauge)
            if hasattr(gauge, "check"):
                gauge.check(simulation)
        if parameters is not None:
            require_kind("parameters", parameters, Mapping)
            plain(parameters, "parameters")
        self.folder = require_path("folder", folder).resolve()
        self._at_root = simulation.team.at_root
        self._writes = simulation.team.rank == 0
        self._holds = ExitStack()  # the folder, and the files that are open in it
        self.simulation, self._gauge = simulation, gauge
        self.checkpoint_every, self._saved_at = checkpoint_every, monotonic()
        self._writes_fields = fields > 0
        self._every = end_time / fields if fields > 0 else np.inf
        self._parameters = dict(parameters or {})
        self._find_fragments: Callable[[Simulation], np.ndarray] | None = None
        self._packing_columns: Callable[[Simulation], dict[str, float]] | None = None
        with simulation.team.ending_all():
            try:
                self._begin(fragments, restart)
            except BaseException:
                self._holds.close()
                raise
        simulation.stopwatch.owns("output", lambda: self.written)

    def _begin(self, fragments: bool, restart: bool) -> None:
        """Take the folder, go on from its checkpoint if asked to, and open the files."""
        simulation = self.simulation
        self._at_root(self._take_folder)
        if fragments:
            from xper_fx.output.connectivity import find_fragments

            self._find_fragments = find_fragments
        if simulation.rigid is not None and simulation.detection is not None:
            from xper_fx.output.packing_columns import packing_columns

            self._packing_columns = packing_columns
        before = self._restored() if restart else None
        self.restarted = before is not None
        before = before or {}
        simulation.folder = self.folder
        simulation.save_on_failure(self.checkpoint)
        columns = dict.fromkeys(HISTORY_COLUMNS)
        columns |= simulation.ledger.as_columns() | macroscopic_columns(simulation)
        if self._packing_columns is not None:
            columns |= self._packing_columns(simulation)
        if fragments:
            columns["fragments"] = None
        self._next = before.get("next_fields", 0.0)
        self.strain = before.get("strain", 0.0)
        self._fields = None
        if simulation.scene.bodies is not None:
            self._fields = FieldSeries(simulation, self.folder)
            self._holds.callback(self._fields.close)
        self._totals = {"steps": 0, "sweeps": 0, "largest_residual": 0.0, "restarts": 0}
        self._totals |= before.get("totals", {})
        self._totals["restarts"] += self.restarted
        self._rigid = None
        self._at_root(partial(self._open, tuple(columns), before))
        if self._writes_fields and self._fields is not None:
            self._fields.open(before.get("series", {}))
        if self._writes_fields and not self.restarted:
            self._write_fields()

    def _restored(self) -> dict | None:
        """Let the simulation go on from the folder's checkpoint; what `_recording` gave, if any."""
        path = self.folder / CHECKPOINT
        if not self.simulation.team.all(path.exists()):
            if self.simulation.team.rank == 0:
                logger.warning(
                    "%s: there is no checkpoint, the run starts from its beginning", path
                )
            return None
        from xper_fx.output.checkpoint import restore

        before = restore(path, self.simulation)
        if bool(before.get("series")) != self._writes_fields:
            had, give = ("no fields", "0") if self._writes_fields else ("fields", "above 0")
            raise ValueError(
                f"The run in {self.folder} was recorded with {had}: restart it with fields {give}, "
                "or start it from its beginning."
            )
        had = bool(before.get("fragments", False))
        if had != (self._find_fragments is not None):
            raise ValueError(
                f"The run in {self.folder} was recorded with fragments={had}: restart it so, or "
                "start it from its beginning."
            )
        return before

    def _sealed(self) -> dict[str, dict[str, float]]:
        """How far the series of all ranks have come, all of which are on the disk then."""
        team = self.simulation.team
        own = team.together(lambda: {series.path.stem: series.seal() for series in self._series})
        return {name: state for part in team.comm.allgather(own) for name, state in part.items()}

    def _recording(self, sealed: dict) -> dict:
        """How far the files have come, all of which are on the disk then."""
        return {
            "history": self._history.flush(),
            "next_fields": self._next,
            "strain": self.strain,
            "totals": self._totals,
            "series": sealed,
            "fragments": self._find_fragments is not None,
        }

    def checkpoint(self) -> Path:
        """Write a checkpoint in the place of the last one; its file."""
        from xper_fx.output.checkpoint import save

        watch, path = self.simulation.stopwatch, self.folder / CHECKPOINT
        with watch.phase("output"), watch.phase("checkpoint"):
            save(path, self.simulation, partial(self._recording, self._sealed()))
        self._saved_at = monotonic()
        return path

    def _open(self, columns: tuple[str, ...], before: Mapping) -> None:
        """Open the files, after what `_recording` gave."""
        if not before:
            # they are of a run whose results are replaced now
            (self.folder / CHECKPOINT).unlink(missing_ok=True)
            remove_series(self.folder)
        after, simulation = before.get("series", {}), self.simulation
        if self._writes_fields and simulation.rigid is not None:
            from xper_fx.output.body_shapes import equal_diameters
            from xper_fx.output.rigid_series import RigidSeries

            path = self.folder / "rigid.xdmf"
            diameter = equal_diameters([body.shape for body in simulation.scene.rigid])
            self._rigid = RigidSeries(path, simulation.rigid, diameter, after.get("rigid"))
            self._holds.callback(self._rigid.series.close)
        self._history = History(self.folder / "history.csv", columns, before.get("history"))
        self._holds.callback(self._history.close)

    def _take_folder(self) -> None:
        prepare_folder(self.folder)
        self._lock = FolderLock(self.folder)
        self._holds.callback(self._lock.release)

    def vertex_displacement(self) -> np.ndarray:
        """Displacement of the exploded mesh's geometry nodes, shape (num_nodes, dim), m.

        Of a mesh that is spread over ranks, of this rank's bodies, as is `cell_stress`.
        """
        return self._fields.displacement()

    @property
    def cells(self) -> np.ndarray:
        """Geometry nodes of the exploded mesh's cells, shape (num_cells, k)."""
        return self._fields.cells

    def _write_fields(self) -> None:
        simulation = self.simulation
        with simulation.stopwatch.phase("output"), simulation.stopwatch.phase("fields"):
            fragment = None
            if self._find_fragments is not None:
                fragment = self._find_fragments(simulation)
            if self._fields is not None:
                self._fields.write(fragment)
            if simulation.rigid is not None:
                motion = simulation.rigid
                self._at_root(lambda: self._rigid.write(motion, simulation.time, fragment))
        self._next += self._every

    def cell_stress(self) -> np.ndarray:
        """Cauchy stress of each cell, as `BulkForms.stress_evaluator` gives it (Pa)."""
        return self._fields.stress()

    def record(self, step: StepRecord) -> tuple[float, float]:
        """Write the line of a step, the fields when they are due, then a checkpoint when it is.

        Returns:
            Strain and stress of the gauge.

        Raises:
            TypeError: no record of a step.
        """
        require_kind("step", step, StepRecord)
        with self.simulation.team.ending_all():
            return self._record(step)

    def _record(self, step: StepRecord) -> tuple[float, float]:
        strain, stress = self._gauge.read(self.simulation) if self._gauge else (0.0, 0.0)
        with self.simulation.stopwatch.phase("output"):
            line = {
                "step": step.step, "time": step.time, "strain": strain, "stress": stress,
                "sweeps": step.sweeps, "residual": step.residual, **step.energies,
                **macroscopic_columns(self.simulation),
            }  # fmt: skip
            if self._packing_columns is not None:
                line |= self._packing_columns(self.simulation)
            if self._find_fragments is not None:
                fragment = self._find_fragments(self.simulation)
                most = self.simulation.team.max(float(fragment.max(initial=-1)))
                line["fragments"] = int(most) + 1
            self._at_root(lambda: self._history.append(**line))
        self._totals["steps"] += 1
        self._totals["sweeps"] += step.sweeps
        self._totals["largest_residual"] = max(self._totals["largest_residual"], step.residual)
        if self._writes_fields and step.time >= self._next * (1.0 - 1e-9):
            self._write_fields()
        self.strain = strain
        if self.checkpoint_every > 0.0:
            due = monotonic() - self._saved_at >= self.checkpoint_every
            # by the clock of the first rank
            if self.simulation.team.max(due and self._writes):
                self.checkpoint()
        return strain, stress

    @property
    def written(self) -> int:
        """Bytes of the fields and of the history that this rank has put on disk, if still there."""
        paths = [self.folder / "history.csv"] if self._writes else []
        for series in self._series:
            paths += [series.path, *series.h5_paths]
        return sum(path.stat().st_size for path in paths if path.exists())

    @property
    def _series(self) -> list[TimeSeries]:
        series = [] if self._fields is None else self._fields.series
        return series if self._rigid is None else [*series, self._rigid.series]

    def close(self) -> None:
        """Close the files; write the summary unless a restart finds that of its last step."""
        with self.simulation.team.ending_all():
            self._close()

    def _close(self) -> None:
        self.simulation.save_on_failure(None)
        told = self.restarted and steps_told(self.folder / "summary.json") == self._totals["steps"]
        summary = None
        if self.simulation.team.max(not told):
            summary = run_summary(self.simulation, self._parameters, self._totals)

        def finish() -> None:
            with self._holds:
                if self._writes and summary is not None:
                    write_summary(self.folder / "summary.json", summary)

        self.simulation.team.together(finish)

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, kind: type[BaseException] | None, *exception: object) -> None:
        if kind is None:
            self.close()
            return
        if kind is not GeneratorExit:
            self.simulation.team.end_unless_all_fail()
        try:
            self.close()
        except (OSError, ValueError) as error:
            # What ended the run says more.
            logger.error("the run's summary and files could not be completed: %s", error)
