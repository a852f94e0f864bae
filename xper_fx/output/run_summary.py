# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the summary of a run tells: its options, sizes, effects, times and errors."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from typing import Any

import dolfinx
import numba
import numpy as np

from xper_fx.output.effects import effects_of
from xper_fx.output.summary import write_summary
from xper_fx.simulation.cohesive_scales import cohesive_scales
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.checks import require_kind
from xper_fx.support.version import __version__


def run_summary(
    simulation: Simulation, parameters: Mapping[str, Any], totals: Mapping[str, float]
) -> dict[str, Any]:
    """What `summary.json` says of a run; all ranks call it together.

    Args:
        simulation: at the end of the run.
        parameters: how the run was set up, as the user told.
        totals: "steps", "sweeps", "largest_residual" and "restarts" of the whole run.
    """
    interactions, bodies = simulation.interactions, simulation.scene.bodies
    points = 0 if interactions is None else interactions.num_points
    total = simulation.ranks.sum
    summary = {
        "parameters": {
            **parameters,
            "step_size": simulation.step_size,
            "theta": simulation.theta,
            "scheme": simulation.options.scheme,
            "tolerance": simulation.tolerance,
            "relaxation": simulation.options.solve.relaxation,
        },
        "versions": {
            "xper_fx": __version__,
            "dolfinx": dolfinx.__version__,
            "numba": numba.__version__,
            "numpy": np.__version__,
            "python": platform.python_version(),
        },
        "counts": {
            "bodies": 0 if bodies is None else bodies.counts[0],
            "rigid_bodies": len(simulation.scene.rigid),
            "points": points,
            "dofs": simulation.bulk.num_dofs_of_all,
            "ranks": simulation.ranks.size,
        },
        "effects": [effect._asdict() for effect in effects_of(simulation)],
        "seconds": simulation.stopwatch.seconds,
        "profile": [
            row._asdict() | {"path": " > ".join(row.path)} for row in simulation.stopwatch.rows()
        ],
        "bytes_per_point": total(interactions.nbytes) / points if points else 0.0,
        "errors": {
            "closure": simulation.ledger.closure,
            "external_work": simulation.ledger.energies.external_work,
            "largest_residual": totals["largest_residual"],
            "estimated": simulation.estimated_error,
        },
        "steps": totals["steps"],
        "sweeps": totals["sweeps"],
        "restarts": totals["restarts"],
        "time": simulation.time,
    }
    summary["scales"] = cohesive_scales(simulation)
    verdict = simulation.verdict()
    if verdict is not None:
        summary["verdict"] = verdict._asdict() | {"text": verdict.text}
    return summary


def add_to_summary(simulation: Simulation, found: Mapping[str, Any]) -> None:
    """Add what was found in a recorded run to its `summary.json`; all ranks call it together.

    Args:
        simulation: the run, whose recorder is closed.
        found: what to add, as `output.write_summary` takes it.

    Raises:
        ValueError: a run that was not recorded, a file that is no summary, numbers that are not
            finite.
        TypeError: no simulation, no mapping, something that has no meaning in JSON.
        OSError: the summary cannot be read or written.
    """
    require_kind("simulation", simulation, Simulation)
    if simulation.folder is None:
        raise ValueError("The simulation was not recorded, so that there is no summary to add to.")
    require_kind("found", found, Mapping)
    path = simulation.folder / "summary.json"

    def add() -> None:
        try:
            before = json.loads(path.read_text())
        except json.JSONDecodeError as error:
            raise ValueError(f"'{path}' is no summary of a run: {error}.") from None
        write_summary(path, before | dict(found))

    simulation.team.at_root(add)
