# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checkpoints: a run in one file, from which it goes on as if it had never stopped.

A checkpoint holds all that the next step depends on, and says of which scene. Arrays stand in the
order of the parent mesh's cells and of the scene's points, which no process decides: with the same
options the run goes on bit by bit, and other options (step, tolerance, solver) may be taken. Of
another scene, another version or with a wrong digest it is refused, before anything is changed.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from xper_fx.output.hdf5_tree import read_attributes, read_tree, write_tree
from xper_fx.scene.fingerprint import differences, fingerprint
from xper_fx.support.checks import require_path
from xper_fx.support.errors import CheckpointError
from xper_fx.support.ranks import ALONE
from xper_fx.support.version import __version__

if TYPE_CHECKING:
    from xper_fx.simulation.simulation import Simulation

# Of the file; it changes whenever what is in it does.
FORMAT = 11
# Differences of scenes that an error names.
_NAMED = 6


def save(
    path: Path | str, simulation: Simulation, recording: Callable[[], Mapping] | None = None
) -> None:
    """Write a checkpoint, in the place of the one that is there; all ranks call it together.

    Args:
        path: the file.
        simulation: between two steps.
        recording: called on the first rank, gives what a recorder wants back, a tree as of
            `hdf5_tree.write_tree`.

    Raises:
        OSError: it cannot be written; the one that was there stays.
    """
    path, time = require_path("path", path), simulation.time
    times = [0.0, 0.5 * time, time]
    scene = json.dumps({"times": times, "is": _fingerprint(simulation, times)})
    tree = {"simulation": simulation.saved(), "scene": scene}
    team, versions = simulation.team, {"format": FORMAT, "xper_fx": __version__}

    def take() -> None:
        tree["recording"] = recording() if recording is not None else {}

    team.at_root(take)
    if simulation.part is None:
        team.at_root(lambda: write_tree(path, tree, **versions))
    else:
        write_tree(path, tree, team, **versions)


def restore(path: Path | str, simulation: Simulation) -> dict:
    """Let a simulation go on from a checkpoint.

    Args:
        path: the file.
        simulation: of the same scene, before its first step.

    Returns:
        What the recorder wanted back.

    Raises:
        CheckpointError: the file is damaged, or of another scene or version; the simulation is
            unchanged then.
        FileNotFoundError: there is no such file.
    """
    path = require_path("path", path)
    attributes = read_attributes(path)
    if "format" not in attributes or "xper_fx" not in attributes:
        raise CheckpointError(
            f"{path} is no checkpoint of xper_fx: it is an HDF5 file without its format. Put the "
            "checkpoint in its place, or start the run from its beginning."
        )
    found, here = (attributes["xper_fx"], attributes["format"]), (__version__, FORMAT)
    if found != here:
        raise CheckpointError(
            f"{path} was written by xper_fx {found[0]} (format {found[1]}), and this is xper_fx "
            f"{here[0]} (format {here[1]}): go on with the version that wrote it, or start the run "
            "from its beginning."
        )
    tree = read_tree(path, ALONE if simulation.part is None else simulation.team)
    scene = json.loads(tree["scene"])
    differ = differences(scene["is"], _fingerprint(simulation, scene["times"]))
    if differ:
        more = f"; and {len(differ) - _NAMED} more" if len(differ) > _NAMED else ""
        raise CheckpointError(
            f"{path} is of another scene: {'; '.join(differ[:_NAMED])}{more}. Restart with the "
            "scene that it was written for, or start the run from its beginning in another folder."
        )
    simulation.restore(tree["simulation"])
    return tree.get("recording", {})


def _fingerprint(simulation: Simulation, times: Sequence[float]) -> dict:
    """What the scene of a run is, and its equations."""
    return fingerprint(
        simulation.scene, times, scheme=simulation.options.scheme, theta=simulation.theta,
        inertia=simulation.bulk.inertia is not None,
    )  # fmt: skip
