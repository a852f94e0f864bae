# SPDX-License-Identifier: LGPL-3.0-or-later
"""Studies of accuracy against time: what they compare, keep, refuse, advise and draw."""

from __future__ import annotations

import csv
import json
import math
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import box_bodies, nodes

sys.path.insert(0, str(Path(__file__).parents[2] / "demos"))
import accuracy_cost as demo

from xper_fx.materials import LinearElastic
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation, StepRecord
from xper_fx.study import study as study_module
from xper_fx.study.definition import Study, product, vary
from xper_fx.study.effect_prices import effects_study, price_table, prices
from xper_fx.study.plots import plot_error_against_cost, plot_price
from xper_fx.study.quantities import (
    CrackPattern,
    DisplacementL2,
    DissipatedEnergy,
    EnergyClosure,
    PeakStress,
    Penetration,
)
from xper_fx.study.results import Run, StudyResults, pareto_front, percent
from xper_fx.study.study import run_study

BASE = {"cells": 10, "contact": "none", "num_threads": 1}
END = 0.5


def study_of(families, **options) -> Study:
    """A study of the demo's bar whose only error is the energy closure."""
    return Study("bar", demo.bar, END, {"closure": EnergyClosure()}, families, **options)


def results_of(families: dict[str, list[tuple]], quantity="closure", **options) -> StudyResults:
    """Results made up from (setting, seconds, error), or (setting, reason)."""
    study = study_of({name: [BASE | row[0] for row in rows] for name, rows in families.items()},
                     **options)  # fmt: skip
    rows = {str(BASE | row[0]): row for rows in families.values() for row in rows}
    runs = []
    for setting in study.settings():
        names = tuple(n for n, members in study.families.items() if setting in members)
        _, *found = rows[str(setting)]
        if len(found) == 1:
            runs.append(Run(setting, names, {"status": "failed", "reason": found[0]}, {}))
            continue
        seconds, error = found
        record = {
            "status": "done", "seconds": seconds, "cpu_seconds": 2.0 * seconds,
            "peak_memory": 3e8, "array_bytes": 1e6, "steps": 7, "sweeps": 70,
            "newton_iterations": 8, "closure": 1e-9, "estimated_error": None,
        }  # fmt: skip
        runs.append(Run(setting, names, record, {quantity: error}))
    return StudyResults(study, runs)


# -- what is asked for


def test_families():
    assert vary({"a": 1, "b": 2}, "a", [3, 4]) == [{"a": 3, "b": 2}, {"a": 4, "b": 2}]
    combined = product({"a": 1}, b=[2, 3], c=["x", "y"])
    assert combined[1] == {"a": 1, "b": 2, "c": "y"} and len(combined) == 4


def test_a_setting_of_two_families_is_run_once():
    study = study_of({"one": [BASE, BASE | {"courant": 0.5}], "two": [BASE]}, default=BASE)
    assert len(study.settings()) == 2


@pytest.mark.parametrize(
    "setting, message",
    [
        (BASE | {"tolerence": 1e-3}, "'tolerance'?"),
        (BASE | {"scene": 1}, "neither one of bar"),
        ({"cells": 10}, "missing a required argument: 'contact'"),
        (BASE | {"courant": 0.5, "step": 0.1}, "both courant and step"),
        (BASE | {"tolerance": math.nan}, "should be finite"),
    ],
)
def test_unfit_settings_are_refused_before_any_run(setting, message):
    with pytest.raises(ValueError, match=message.replace("?", r"\?")):
        study_of({"only": [setting]})


def test_unfit_studies_are_refused():
    with pytest.raises(TypeError, match="top level"):
        Study("x", lambda cells: None, END, {"q": EnergyClosure()}, {"f": [BASE]})
    with pytest.raises(TypeError, match="written into a file"):
        study_of({"only": [BASE | {"tolerance": (1, 2)}]})
    with pytest.raises(ValueError, match="have no reference"):
        Study("x", demo.bar, END, {"u": DisplacementL2()}, {"f": [BASE]})
    with pytest.raises(ValueError, match="known names"):
        study_of({"only": [BASE]}, known={"other": 1.0})
    with pytest.raises(ValueError, match="at least one"):
        study_of({})


def test_the_key_holds_what_decides_a_result():
    study = study_of({"only": [BASE]})
    longer = Study("bar", demo.bar, 2 * END, study.quantities, study.families)
    other = Study("bar", demo.bar, END, {"closure": DisplacementL2()}, study.families, known={
        "closure": {}})  # fmt: skip
    keys = {study.key(BASE), study.key(BASE | {"cells": 11}), longer.key(BASE), other.key(BASE)}
    assert len(keys) == 4
    assert study.key(dict(reversed(BASE.items()))) == study.key(BASE)


@pytest.mark.parametrize("quick", [True, False])
def test_shipped_studies_are_sound(quick):
    """Every parameter of every setting exists: `Study` refuses others."""
    for make in demo.STUDIES.values():
        for study in make(quick):
            assert len(study.settings()) >= 3


# -- quantities


def record(time: float, **energies: float) -> StepRecord:
    return StepRecord(1, time, 0.1, 0, 0.0, 0.0, 0, 0.0, energies)


def test_dissipated_energy_is_read_between_steps():
    """2 at 0.1 s and 6 at 0.2 s are 3 at 0.125 s; what the scheme loses does not count."""
    steps = [
        record(0.1, dissipated_friction=1.5, dissipated_plastic=0.5, dissipated_numerical=9.0),
        record(0.2, dissipated_friction=5.0, dissipated_plastic=1.0, dissipated_numerical=9.0),
        record(0.3, dissipated_friction=50.0, dissipated_plastic=1.0, dissipated_numerical=9.0),
    ]
    for quantity, expected in (
        (DissipatedEnergy(0.125), 3.0),
        (DissipatedEnergy(), 51.0),
        (DissipatedEnergy(terms=("dissipated_plastic",)), 1.0),
    ):
        seen = None
        for step in steps:
            seen = quantity.observe(None, step, seen)
        assert quantity.value(None, seen) == pytest.approx(expected, rel=1e-14)
    assert DissipatedEnergy().error(1.1, -1.0) == pytest.approx(2.1)
    with pytest.raises(ValueError, match="reference is zero"):
        DissipatedEnergy().error(1.0, 0.0)


def test_peak_stress_is_the_largest():
    readings = iter([-3.0, 2.0, 1.0])
    quantity = PeakStress(SimpleNamespace(read=lambda simulation: (0.0, next(readings))))
    seen = None
    for _ in range(3):
        seen = quantity.observe(None, record(0.1), seen)
    assert quantity.value(None, seen) == 2.0
    assert quantity.error(2.0, 1.6) == pytest.approx(0.25)


def test_penetration_and_closure():
    interactions = SimpleNamespace(gather=lambda name: np.array([[2e-3, 9.0], [-4e-3, 9.0]]))
    simulation = SimpleNamespace(interactions=interactions, ledger=SimpleNamespace(closure=-0.02))
    quantity = Penetration(length=0.1)
    assert quantity.error(quantity.observe(simulation, None, 1e-3), None) == pytest.approx(0.04)
    assert quantity.observe(simulation, None, 5e-3) == 5e-3
    seen = EnergyClosure().observe(None, record(0.1, external_work=-0.5, kinetic=0.4), None)
    seen = EnergyClosure().observe(None, record(0.1, external_work=-0.1, kinetic=0.1), seen)
    assert EnergyClosure().value(simulation, seen) == pytest.approx(0.04)


def cracks(points, area):
    return {"points": np.array(points, float).reshape(-1, 2), "area": np.array(area, float)}


def test_crack_pattern_counts_what_has_no_counterpart():
    quantity = CrackPattern(radius=0.5)
    one = cracks([(0, 0), (1, 0), (9, 0)], [1, 1, 2])
    two = cracks([(0, 0.4), (1.2, 0), (5, 5)], [1, 2, 3])
    # 2 of 4 and 3 of 6 stand alone
    assert quantity.error(one, two) == pytest.approx(0.5)
    assert quantity.error(two, one) == pytest.approx(0.5)
    assert quantity.error(one, one) == 0.0
    none = cracks([], [])
    assert quantity.error(one, none) == 1.0 and quantity.error(none, none) == 0.0
    assert CrackPattern(radius=0.3).error(one, two) == pytest.approx((1 + 2 + 1 + 3) / 10)


def linear_field(cells, kind, order):
    """A simulation whose displacement is (3 x + y, -y) in two bodies, with a jump of 7 along y."""
    bodies = box_bodies((2.0, 1.0), cells, kind, lambda x: x[0] > 1.0)
    scene = Scene(bodies, {1: LinearElastic(1.0, 0.0, 1.0)}, {(1, 1): None}, order=order)
    simulation = Simulation(scene, 0.1)
    x = nodes(simulation)
    body = simulation.bulk.layout.body_of_node()
    u = np.stack([3.0 * x[:, 0] + x[:, 1], -x[:, 1] + 7.0 * body], axis=1)
    simulation.state = replace(simulation.state, displacement=u.ravel())
    return simulation


def test_displacements_compare_between_meshes():
    """A linear field with a jump is the same on a mesh of triangles and one of quadrilaterals."""
    quantity = DisplacementL2(samples=500)
    one = quantity.value(linear_field((4, 2), "crossed", 1), None)
    two = quantity.value(linear_field((6, 3), "quadrilateral", 2), None)
    x = one["points"]
    beyond = np.mean([x[:, 0] > 1.0, x[:, 0] >= 1.0], axis=0)  # where bodies meet their mean
    assert np.count_nonzero(beyond == 0.5) == 1
    exact = np.stack([3 * x[:, 0] + x[:, 1], -x[:, 1] + 7.0 * beyond], axis=1)
    assert one["displacement"] == pytest.approx(exact, abs=1e-12)
    assert np.all(x > 0.0) and x.max(axis=0) == pytest.approx([2.0, 1.0], rel=0.01)
    assert quantity.error(two, one) < 1e-12
    moved = {"points": x, "displacement": 1.02 * exact}
    assert quantity.error(moved, one) == pytest.approx(0.02)
    hole = np.where((x[:, :1] > 1.5), np.nan, exact)
    assert quantity.error({"points": x, "displacement": hole}, one) < 1e-12
    with pytest.raises(ValueError, match="other points"):
        quantity.error({"points": 1.1 * x, "displacement": exact}, one)


# -- results


def test_pareto_front():
    cost = [3.0, 1.0, 2.0, 2.0, 4.0, np.nan, 5.0]
    error = [0.3, 0.9, 0.5, 0.4, 0.35, 0.0, 0.3]
    assert pareto_front(cost, error).tolist() == [1, 3, 0]


STEPS = [
    ({"courant": 4.0}, 1.0, 0.2),
    ({"courant": 2.0}, 2.0, 0.05),
    ({"courant": 1.0}, 4.0, 0.0125),
]
TOLERANCES = [
    ({"tolerance": 1e-2}, 1.5, 0.3),
    ({"tolerance": 1e-3}, 2.5, 0.040),
    ({"tolerance": 1e-4}, 3.5, 0.039),
    ({"tolerance": 1e-5}, 9.0, 0.041),
]


def test_advice_is_computed():
    results = results_of(
        {"step": STEPS, "tolerance": TOLERANCES, "failed": [({"courant": 9.0}, "it burst")]},
        default=BASE | {"tolerance": 1e-4},
    )
    assert results.cheapest("closure", 0.06).setting["courant"] == 2.0
    assert results.cheapest("closure", 1e-3) is None
    advice = results.advice("closure", targets=(0.3, 0.06, 0.02, 0.001))
    assert "for 30 % take courant=4 (1 s, error 20 %)" in advice
    assert "for 6 % take courant=2 (2 s, error 5 %)" in advice
    assert "for 2 % take courant=1 (4 s, error 1.2 %)" in advice
    assert "no run reached 0.1 %" in advice
    assert "the default has 3.9 % in 3.5 s" in advice
    assert "tolerance tighter than 0.001 buys nothing (4 % there, 4.1 % at 1e-05" in advice
    assert "courant tighter" not in advice
    front = [run.record["seconds"] for run in results.front("closure")]
    assert front == [1.0, 2.0, 2.5, 3.5, 4.0]
    table = results.table()
    assert "failed: it burst" in table and "default" in table


def test_saturation_knows_which_way_is_tight():
    """Towards the reference's value; without one, where time is."""
    found_by_cells = ((10, 1, 0.4), (20, 2, 0.1), (40, 4, 0.095), (80, 8, 0.1))
    cells = [({"cells": n}, seconds, error) for n, seconds, error in found_by_cells]
    (found,) = results_of({"cells": cells}).saturation("closure", "cells")
    assert (found.value, found.tightest) == (20, 80)
    (found,) = results_of({"tolerance": TOLERANCES}).saturation("closure", "tolerance")
    assert (found.value, found.error, found.tightest) == (1e-3, 0.040, 1e-5)
    (found,) = results_of({"step": STEPS}).saturation("closure", "courant")
    assert found.value is None and found.tightest == 1.0
    reference = BASE | {"cells": 5}
    rows = {"cells": cells, "reference": [({"cells": 5}, 1.0, 0.0)]}
    (found,) = results_of(rows, reference=reference).saturation("closure", "cells")
    assert found.tightest == 5


def test_rates():
    results = results_of({"step": STEPS})
    assert results.rate("closure", "step", "courant") == pytest.approx(2.0)


def test_percent():
    assert [percent(e) for e in (0.0, 0.1, 0.0123, 1.5e-5, 2.0, 3e-9)] == [
        "0 %", "10 %", "1.2 %", "0.0015 %", "200 %", "3e-07 %",
    ]  # fmt: skip


def test_figure_shows_front_default_and_runs_without_error():
    rows = STEPS + [({"courant": 0.5}, 8.0, 0.0)]
    results = results_of({"step": rows}, default=BASE | {"courant": 1.0})
    figure = plot_error_against_cost(results, costs=["seconds", "cpu_seconds"])
    wall, cpu = figure.axes
    lines = {line.get_label(): line.get_xydata() for line in wall.get_lines()}
    zero = 0.0125 / 3.0
    assert lines["step"] == pytest.approx(np.array([[1, 0.2], [2, 0.05], [4, 0.0125], [8, zero]]))
    assert lines["default"] == pytest.approx(np.array([[4, 0.0125]]))
    assert lines["Pareto front"][:4] == pytest.approx(lines["step"])
    assert {text.get_text() for text in wall.texts} == {"4", "2", "1", "0.5", "0"}
    assert wall.get_xscale() == wall.get_yscale() == "log"
    assert cpu.get_lines()[0].get_xdata() == pytest.approx([2, 4, 8, 16])
    with pytest.raises(ValueError, match="quantities names"):
        plot_error_against_cost(results, quantities=["speed"])


# -- the price of effects


def test_price_of_effects():
    """Switched on one by one, and left out one by one; what cannot be left out is said."""
    effects = {"inertia": {"inertia": True, "theta": 0.5}, "a fine mesh": {"cells": 20}}
    plainest = BASE | {"inertia": False, "theta": 1.0}
    study = effects_study("bar", demo.bar, END, {"closure": EnergyClosure()}, plainest, effects)
    full = plainest | {"inertia": True, "theta": 0.5, "cells": 20}
    assert study.settings() == [
        plainest,
        plainest | {"inertia": True, "theta": 0.5},
        full,
        full | {"inertia": False, "theta": 1.0},
    ]
    assert study.reference == full
    on, left = ({k: r[k] for k in ("inertia", "theta", "cells")} for r in (full, plainest))
    some = {"inertia": True, "theta": 0.5, "cells": 10}
    results = results_of(
        {
            "switched on one by one": [(left, 2.0, 0.1), (some, 3.0, 0.2), (on, 12.0, 0.0)],
            "one left out": [(on | {"inertia": False, "theta": 1.0}, "no mass"), (some, 3.0, 0.2)],
        }
    )
    found = prices(results, list(effects))
    assert [p.time_ratio for p in found] == [1.0, 1.5, 6.0]
    assert found[1].refused == "cannot be left out" and found[1].change == {}
    assert found[2].full_ratio == 4.0 and found[2].change == {"closure": 0.2}
    table = price_table(found)
    assert "cannot be left out" in table and "20 %" in table
    figure = plot_price(found)
    time, _, change = figure.axes
    assert [bar.get_width() for bar in time.patches] == [1.0, 1.5, 6.0]
    assert change.patches[-1].get_width() == pytest.approx(20.0)
    with pytest.raises(ValueError, match="does not name"):
        effects_study("x", demo.bar, END, study.quantities, BASE, {"x": {"theta": 1.0}})


# -- runs


def swinging(courants=()) -> Study:
    """The demo's bar in its first mode, two meshes, one step that is refused."""
    explicit = BASE | {"scheme": "explicit", "courant": 0.5}
    return Study(
        "swinging",
        demo.bar,
        END,
        {"displacement": DisplacementL2(), "closure": EnergyClosure()},
        {
            "mesh": vary(explicit, "cells", [10, 20]),
            "step": vary(explicit, "courant", [1.5, *courants]),
        },
        known={"displacement": demo.known_displacement(demo.in_first_mode, END)},
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The runs of `swinging`, made by their processes."""
    out = tmp_path_factory.mktemp("study")
    run_study(swinging(), out, quiet=True)
    return out


def forbidden(*arguments):
    raise AssertionError("nothing should be run")


@pytest.mark.slow
def test_rate_two_in_h_from_child_processes(folder, monkeypatch):
    """And a second call runs nothing; a refused step is kept with its reason.

    Found: 2.57e-3 with 10 cells, of which interpolation has (k dx)^2 / sqrt(120) = 2.25e-3.
    """
    monkeypatch.setattr(study_module, "_run_in_process", forbidden)
    results = run_study(swinging(), folder, quiet=True)
    assert results.rate("displacement", "mesh", "cells") == pytest.approx(-2.0, abs=0.02)
    coarse, fine, refused = results.runs
    assert coarse.errors["displacement"] == pytest.approx(2.57e-3, rel=0.05)
    assert not refused.done and "unstable" in refused.record["reason"]
    # a whole number of steps of 0.5 dx / c ends at the end time
    assert (coarse.record["steps"], fine.record["steps"]) == (10, 20)
    assert 5e7 < coarse.record["peak_memory"] < 2e9
    assert 0.0 < fine.record["seconds"] < 60.0
    results.to_csv(folder / "runs.csv")
    results.to_json(folder / "results.json")
    with open(folder / "runs.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert float(rows[1]["error displacement"]) == fine.errors["displacement"]
    assert "unstable" in rows[2]["reason"]
    assert len(json.loads((folder / "results.json").read_text())["runs"]) == 3


@pytest.mark.slow
def test_an_interrupted_study_goes_on(folder, monkeypatch):
    """Only what is missing is run: of three runs the one without record, and a new one."""
    study = swinging(courants=[0.25])
    lost = study.settings()[1]
    kept = study.key(lost)
    parts = {p.name: p.read_bytes() for p in folder.glob(f"{kept}.*")}
    for name in parts:
        (folder / name).rename(folder / f"{name}.away")
    (folder / f"{kept}.partial.npz").write_bytes(b"half")
    asked = []

    def note(study, setting, path, patience):
        asked.append(setting)
        return "not today"

    monkeypatch.setattr(study_module, "_run_in_process", note)
    results = run_study(study, folder, quiet=True)
    for name, content in parts.items():
        (folder / name).write_bytes(content)
    assert asked == [lost, study.settings()[3]]
    assert [run.done for run in results.runs] == [True, False, False, False]
    assert results.runs[1].record["reason"] == "not today"


def test_out_of_patience(tmp_path):
    """The process is ended, and the run is not kept: another call may have more patience."""
    results = run_study(swinging(), tmp_path, patience=0.01, quiet=True)
    assert {run.record["reason"] for run in results.runs} == {"took more than 0.01 s"}
    assert not list(tmp_path.glob("*.json"))


def test_a_reference_that_fails_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(study_module, "_run_in_process", lambda *a: "it burst")
    study = study_of({"only": [BASE]}, reference=BASE | {"cells": 40})
    with pytest.raises(RuntimeError, match="reference cells=40.*it burst"):
        run_study(study, tmp_path, quiet=True)


@pytest.mark.demos
def test_effects_demo_writes_its_files(tmp_path):
    """Small: inertia and output on an elastic plate; output changes no number."""
    (results,) = demo.main(["--study", "effects", "--quick", "--quiet", "--out", str(tmp_path)])
    out = tmp_path / "effects"
    for name in ("table.md", "runs.csv", "results.json", "accuracy_cost.png", "effects.png"):
        assert (out / name).stat().st_size > 0
    plain, moving, written, still = results.runs
    assert moving.values["peak stress"] == written.values["peak stress"]
    assert plain.values["peak stress"] == still.values["peak stress"]
    assert plain.values["peak stress"] != moving.values["peak stress"]
