# SPDX-License-Identifier: LGPL-3.0-or-later
"""A scene pays for the effects it calls for, and for no other.

Each scene of `effect_scenes.py` runs in two processes: as it is, and with the code of all effects
that it does not call for taken away. They start as forks of one that has imported libraries alone.
Both must give the same bits, by the same calls of Python, C
and kernels, on arrays of the same size.
"""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from operator import attrgetter
from pathlib import Path

import effect_scenes
import effect_table
import pytest
from on_ranks import on_new_ranks
from scenes import box_bodies

from xper_fx.forms.loads import Gravity
from xper_fx.materials import NeoHookean
from xper_fx.nscd.laws import (
    Adhesion,
    CohesiveCurve,
    CohesiveZone,
    MixedMode,
    MohrCoulomb,
    PerfectBond,
    SignoriniCoulomb,
    SlipWeakening,
    StribeckFriction,
    Tresca,
)
from xper_fx.nscd.laws.curves import Petersson
from xper_fx.output.effects import EFFECTS, effects_of, effects_table
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

SCRIPT = Path(effect_scenes.__file__)
ENVIRONMENT = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
FAST = ("static", "dynamic", "closed")
MARKS = dict.fromkeys(FAST, ()) | {"divided": pytest.mark.ranks}
TABLE = effect_table.read()
CALLED_FOR = {scene.__name__: effects for scene, effects in effect_scenes.SCENES.items()}


@pytest.fixture(scope="module")
def observer():
    """A process that observes scenes in forks of its own."""
    with subprocess.Popen(
        [sys.executable, SCRIPT], env=ENVIRONMENT, text=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    ) as process:  # fmt: skip
        yield process
        process.stdin.close()


def observed(observer, scene: str, removed=()) -> dict:
    if scene == "divided":
        run = on_new_ranks(2, SCRIPT, scene, *removed)
        assert run.returncode == 0, run.stderr
        return json.loads(run.stdout.splitlines()[-1])
    print(json.dumps([scene, *removed]), file=observer.stdin, flush=True)
    found = json.loads(observer.stdout.readline())
    assert found is not None, f"{scene} has failed; see what it printed"
    return found


def uses(run: dict, code: str) -> str | None:
    """How a run used a piece of code, None if it did not."""
    module, _, name = code.partition(":")
    if not name:
        return "imported" if module in run["modules"] else None
    for how in ("called", "compiled"):
        if any(f"{one}.".startswith(f"{code}.") for one in run[how]):
            return how
    return None


@pytest.mark.parametrize("effect", TABLE, ids=lambda e: e.name)
def test_every_effect_has_its_proof(effect):
    """A scene with it and a scene without, so that the proof below is not empty."""
    with_it = [scene for scene, effects in CALLED_FOR.items() if effect.name in effects]
    assert with_it, f"give tests/shared/effect_scenes.py a scene that calls for {effect.name!r}"
    assert len(with_it) < len(CALLED_FOR)


def test_names_are_those_of_the_table():
    names = [effect.name for effect in EFFECTS]
    assert len(set(names)) == len(names)
    assert set().union(*CALLED_FOR.values()) == set(names)
    assert [effect.name for effect in TABLE] == names


@pytest.mark.parametrize("code", sorted({code for effect in TABLE for code in effect.code}))
def test_code_of_the_table_is_there(code):
    module, _, name = code.partition(":")
    assert not name or attrgetter(name)(import_module(module))
    assert find_spec(module)


@pytest.mark.parametrize(
    "scene",
    [pytest.param(scene, marks=MARKS.get(scene, pytest.mark.slow)) for scene in CALLED_FOR],
)
def test_a_scene_pays_for_what_it_calls_for(scene, observer):
    run = observed(observer, scene)
    assert {name for name, row in run["effects"].items() if row["on"]} == CALLED_FOR[scene]
    on = [effect for effect in TABLE if effect.name in CALLED_FOR[scene]]
    off = [effect for effect in TABLE if effect.name not in CALLED_FOR[scene]]
    for effect in on:
        assert any(uses(run, code) for code in effect.code), effect.name
        assert (run["effects"][effect.name]["memory"] > 0) == (effect.holds != "-"), effect.name
    shared = {code for effect in on for code in effect.code}
    absent = sorted({code for effect in off for code in effect.code} - shared)
    assert {code: uses(run, code) for code in absent} == dict.fromkeys(absent)
    for effect in off:
        assert run["effects"][effect.name]["memory"] == 0
    stripped = observed(observer, scene, absent)
    assert run["displacement"] > 0.0
    for what in ("digest", "costs", "held", "effects"):
        if what == "effects":  # but for the times
            for rows in (run[what], stripped[what]):
                for row in rows.values():
                    del row["seconds"]
        assert stripped[what] == run[what], what


LAWS = (
    CohesiveZone(10.0, 1e-4, 1e-3),
    CohesiveZone(10.0, 1e-4, 1e-3, friction=0.1),
    CohesiveZone(10.0, 1e-4, 1e-3, damage="lagged"),
    CohesiveZone(10.0, 1e-4, 1e-3, damage="end", friction=0.1, curve=Petersson()),
    CohesiveZone(10.0, 1e-4, 1e-3, damage="end", viscosity=1e-4),
    MixedMode(10.0, (1e-3, 2e-3), (1e-4, 2e-4), 2.0, friction=0.1),
    Adhesion(10.0, 1e-4),
    Adhesion(10.0, 1e-4, 1e-4, friction=0.1),
    CohesiveCurve(([0.0, 1e-4, 1e-1], [0.0, 1e-3, 0.0]), friction=0.1),
    SignoriniCoulomb(),
    SignoriniCoulomb(0.3),
    SignoriniCoulomb(0.3, rolling=0.1),
    SignoriniCoulomb(contact="position"),
    SignoriniCoulomb(0.3, contact="position"),
    SignoriniCoulomb(0.3, 0.5, tangential_restitution=0.5),
    StribeckFriction(0.5, 0.3, 0.1),
    StribeckFriction(0.5, 0.3, 0.1, 10.0, contact="position"),
    Tresca(1e3),
    Tresca(1e3, contact="position"),
    SlipWeakening(0.5, 0.3, 1e-3),
    SlipWeakening(0.5, 0.3, 1e-3, contact="position"),
    MohrCoulomb(0.5, 1e5, 1e4, 1e-3),
    MohrCoulomb(0.5, 1e5, 1e4, 1e-3, contact="position"),
    PerfectBond(),
)


@pytest.mark.parametrize("scheme", ["implicit", "explicit"])
def test_loads_of_either_scheme_are_in_the_table(scheme):
    """An explicit bulk keeps no external forces in its state."""
    scene = Scene(
        box_bodies((1.0, 1.0), (1, 1), label=0),
        {1: NeoHookean(1.0, 0.3, 1.0)},
        loads=[Gravity((0.0, -1.0))],
    )
    simulation = Simulation(scene, scheme=scheme)
    next(simulation.steps(simulation.step_size))
    assert "external forces" in [effect.name for effect in effects_of(simulation) if effect.on]


@pytest.mark.parametrize("dim", (2, 3))
@pytest.mark.parametrize("law", LAWS, ids=repr)
def test_what_a_law_holds_belongs_to_its_effects(law, dim):
    """All columns, each once: the bytes of the table are those of the arrays."""
    kernels = law.kernels(dim)
    held = len(law.parameters()) + len(law.initial_state()) + kernels.num_terms
    assert sum(columns for _, columns in kernels.effects) == held + kernels.num_details
    assert len(law.initial_state()) == len(kernels.state_names)


@dataclass(frozen=True)
class Glue(PerfectBond):
    """A user's law with an effect of its own."""

    def kernels(self, dim):
        return super().kernels(dim)._replace(name="my glue", effects=(("adhesion", 5),))


@dataclass(frozen=True)
class Rubber(NeoHookean):
    """A user's material with an effect of its own beside one of the table."""

    effects = ("finite strain", "heat")


def two_halves(material, law):
    bodies = box_bodies((2.0, 1.0), (2, 1), label=lambda x: x[0] > 1.0)
    return Simulation(Scene(bodies, {1: material}, default_interaction=law), 0.1)


def test_laws_and_materials_of_a_user_join_the_table():
    simulation = two_halves(Rubber(young=1.0, poisson=0.3, density=1.0), Glue())
    rows = {row.name: row for row in effects_of(simulation)}
    assert list(rows)[-2:] == ["heat", "adhesion"]
    # two nodes of one facet, five columns
    assert rows["adhesion"][:3] == ("adhesion", True, 2 * 5 * 8)
    assert rows["heat"].on and rows["finite strain"].on and not rows["perfect bond"].on
    table = effects_table(simulation).splitlines()
    assert "law: my glue, 2 points" in table
    assert table[-1].startswith("off: ") and "perfect bond" in table[-1]
    assert not any(line.startswith("perfect bond") for line in table)


@pytest.mark.slow
def test_phases_of_an_effect_are_read_from_the_profile():
    simulation = effect_scenes.static()
    rows = {row.name: row for row in effects_of(simulation)}
    assert not rows["macroscopic control"].on
    with simulation.stopwatch.phase("macroscopic averages"):
        pass
    # off: zero, whatever the clock says
    assert effects_of(simulation) == list(rows.values())
    cell = effect_scenes.stretched_cell()
    list(cell.steps(2 * cell.step_size))
    rows = {row.name: row for row in effects_of(cell)}
    # at the start and after each step
    assert rows["macroscopic control"].calls == 3 and rows["macroscopic control"].seconds > 0.0
