# SPDX-License-Identifier: LGPL-3.0-or-later
"""A scene pays for the effects it calls for, and for no other.

Each scene of `effect_scenes.py` runs in two processes: as it is, and with the code of all effects
that it does not call for taken away. Both must give the same bits, by the same calls of Python, C
and kernels, on arrays of the same size.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import effect_scenes
import pytest

from xper_fx.effects import EFFECTS

SCRIPT = Path(effect_scenes.__file__)
# Optimising kernels is not what is tested, and takes most of the time.
ENVIRONMENT = os.environ | {"NUMBA_OPT": "0", "OPENBLAS_NUM_THREADS": "1"}
CALLED_FOR = {scene.__name__: effects for scene, effects in effect_scenes.SCENES.items()}


def observed(scene: str, removed=()) -> dict:
    run = subprocess.run(
        [sys.executable, SCRIPT, scene, *removed],
        capture_output=True, text=True, env=ENVIRONMENT, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout.splitlines()[-1])


def uses(run: dict, code: str) -> str | None:
    """How a run used a piece of code, None if it did not."""
    module, _, name = code.partition(":")
    if not name:
        return "imported" if module in run["modules"] else None
    for how in ("called", "compiled"):
        if any(f"{one}.".startswith(f"{code}.") for one in run[how]):
            return how
    return None


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda e: e.name)
def test_every_effect_has_its_proof(effect):
    """A scene with it and a scene without, so that the proof below is not empty."""
    with_it = [scene for scene, effects in CALLED_FOR.items() if effect.name in effects]
    assert with_it, f"give tests/effect_scenes.py a scene that calls for {effect.name!r}"
    assert len(with_it) < len(CALLED_FOR)
    assert effect.switch and effect.code


def test_names_are_those_of_the_table():
    names = [effect.name for effect in EFFECTS]
    assert len(set(names)) == len(names)
    assert set().union(*CALLED_FOR.values()) == set(names)


@pytest.mark.parametrize("scene", CALLED_FOR)
def test_a_scene_pays_for_what_it_calls_for(scene):
    run = observed(scene)
    assert {name for name, row in run["effects"].items() if row["on"]} == CALLED_FOR[scene]
    on = [effect for effect in EFFECTS if effect.name in CALLED_FOR[scene]]
    off = [effect for effect in EFFECTS if effect.name not in CALLED_FOR[scene]]
    for effect in on:
        assert any(uses(run, code) for code in effect.code), effect.name
        assert (run["effects"][effect.name]["memory"] > 0) == bool(effect.holds), effect.name
    shared = {code for effect in on for code in effect.code}
    absent = sorted({code for effect in off for code in effect.code} - shared)
    assert {code: uses(run, code) for code in absent} == dict.fromkeys(absent)
    for effect in off:
        assert run["effects"][effect.name]["memory"] == 0
    stripped = observed(scene, absent)
    assert run["displacement"] > 0.0
    for what in ("digest", "costs", "held", "effects"):
        if what == "effects":  # but for the times
            for rows in (run[what], stripped[what]):
                for row in rows.values():
                    del row["seconds"]
        assert stripped[what] == run[what], what
