# SPDX-License-Identifier: LGPL-3.0-or-later
"""The summary of a run, `summary.json`: how it was set up and what came out."""

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from xper_fx.support.files import write_file

TIMING_KEYS: tuple[str, ...] = ("seconds", "profile")
"""Keys of ``summary.json``, at any depth, that hold times; a run made twice has all else alike."""


def plain(value: Any, where: str) -> Any:
    """Turn NumPy values and paths into what JSON has, and refuse what it has not.

    Args:
        value: to be written.
        where: its name, for messages.
    """
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(item, f"{where}.{key}") for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item, f"{where}[{number}]") for number, item in enumerate(value)]
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(
            f"The summary's '{where}' is {value}: give a finite number, or None if there is none."
        )
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise TypeError(
        f"The summary's '{where}' is of {type(value)}: give a number, a string, an array, a list "
        "or a mapping."
    )


def write_summary(path: str | os.PathLike[str], mapping: Mapping[str, Any]) -> None:
    """Write a run's parameters and results as JSON, sorted by key, at once or not at all.

    Args:
        path: The file, usually ``summary.json``; one that is there is replaced.
        mapping: Nested mappings and lists of numbers, strings, None, NumPy scalars and arrays.

    Raises:
        ValueError: If a number is not finite.
        TypeError: If a value has no meaning in JSON.
        OSError: If the file cannot be written.
    """
    content = {str(key): plain(value, str(key)) for key, value in mapping.items()}
    text = json.dumps(content, indent=2, sort_keys=True, allow_nan=False, ensure_ascii=False)
    write_file(Path(path), (text + "\n").encode())


def steps_told(path: Path) -> int | None:
    """Steps of the run that a summary tells of; None without a summary that can be read."""
    try:
        return json.loads(path.read_text()).get("steps")
    except (OSError, ValueError, AttributeError):
        return None


def without_times(summary: Any) -> Any:
    """A summary without what :data:`TIMING_KEYS` name: two runs of the same scene have it alike."""
    if isinstance(summary, Mapping):
        return {k: without_times(v) for k, v in summary.items() if k not in TIMING_KEYS}
    if isinstance(summary, (list, tuple)):
        return [without_times(item) for item in summary]
    return summary
