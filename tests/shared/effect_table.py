# SPDX-License-Identifier: LGPL-3.0-or-later
"""The table of effects of `docs/guide/effects.md`."""

import re
from pathlib import Path
from typing import NamedTuple

PAGE = Path(__file__).resolve().parents[2] / "docs" / "guide" / "effects.md"


class Row(NamedTuple):
    """What the page says of an effect.

    Attributes:
        name: the effect.
        switch: what in the scene or the simulation calls for it.
        code: the modules, and the "module:object" in modules that others share, that are its own.
        holds: what it allocates; "-" if nothing.
    """

    name: str
    switch: str
    code: tuple[str, ...]
    holds: str


def read() -> list[Row]:
    """The rows of the page; code of the package is written from its folder on, with slashes."""
    rows = re.findall(
        r"^\| ([^|]+) \| ([^|]+) \| (`[^|]+`) \| ([^|]+) \|$", PAGE.read_text(), re.MULTILINE
    )
    return [
        Row(name, switch, tuple(map(_in_python, re.findall("`([^`]+)`", code))), holds)
        for name, switch, code, holds in rows
    ]


def _in_python(code: str) -> str:
    return "xper_fx." + code.replace("/", ".") if "/" in code else code
