# SPDX-License-Identifier: LGPL-3.0-or-later
"""The profile of a run: phases nest, are counted, hold what they say, and add up to the wall time.

Times are those of a clock that the tests wind, so that sums are exact.
"""

import json

import numpy as np
import pytest
from numba import njit
from scenes import BOTTOM, LEFT, RIGHT, box_bodies

from xper_fx.forms.loads import PrescribedVelocity
from xper_fx.materials import J2SmallStrain, LinearElastic
from xper_fx.materials.hardening import Linear
from xper_fx.output.recorder import Recorder
from xper_fx.output.run import recorded_steps
from xper_fx.plotting.figures import plot_profile
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation
from xper_fx.support import profile
from xper_fx.support.profile import OTHER, Stopwatch, profile_table


class Clock:
    """A clock that moves when it is told to."""

    def __init__(self):
        self.now = 0.0

    def __call__(self) -> float:
        return self.now

    def wait(self, seconds: float) -> None:
        self.now += seconds


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(profile, "perf_counter", clock)
    return clock


def by_path(rows):
    return {" > ".join(row.path): row for row in rows}


def walk(stopwatch, clock):
    """Two steps of 11 s, of which 4 are in each of their two solves; 5 s of nothing."""
    for _ in range(2):
        with stopwatch.phase("step"):
            clock.wait(1.0)
            for _ in stopwatch.each("newton", range(2)):
                clock.wait(1.0)
                with stopwatch.phase("solve"):
                    clock.wait(4.0)
        clock.wait(1.5)
    with stopwatch.phase("solve"):
        clock.wait(2.0)
    clock.wait(2.0)


def test_phases_nest_and_add_up(clock):
    stopwatch = Stopwatch()
    walk(stopwatch, clock)
    rows = by_path(stopwatch.rows())
    assert {name: (row.seconds, row.own, row.calls) for name, row in rows.items()} == {
        "step": (22.0, 2.0, 2),
        "step > newton": (20.0, 4.0, 4),
        "step > newton > solve": (16.0, 16.0, 4),
        "solve": (2.0, 2.0, 1),
        OTHER: (5.0, 5.0, 0),
    }
    assert sum(row.own for row in rows.values()) == stopwatch.wall == 29.0
    assert rows["step"].share == 22.0 / 29.0
    # by name, wherever it is
    assert stopwatch.seconds == {"step": 22.0, "newton": 20.0, "solve": 18.0}
    assert stopwatch.calls == {"step": 2, "newton": 4, "solve": 5}


def test_a_phase_within_itself_counts_once_in_the_total(clock):
    stopwatch = Stopwatch()
    with stopwatch.phase("solve"), stopwatch.phase("part"), stopwatch.phase("solve"):
        clock.wait(3.0)
    assert stopwatch.seconds == {"solve": 3.0, "part": 3.0}
    assert stopwatch.calls["solve"] == 2


def test_an_exception_leaves_all_phases(clock):
    stopwatch = Stopwatch()
    with pytest.raises(ZeroDivisionError), stopwatch.phase("step"):
        for _ in stopwatch.each("newton", range(3)):
            with stopwatch.phase("solve"):
                clock.wait(1.0)
                1 / 0  # noqa: B018
    with stopwatch.phase("output"):
        clock.wait(2.0)
    rows = by_path(stopwatch.rows())
    assert list(rows) == ["step", "step > newton", "step > newton > solve", "output", OTHER]
    assert [row.calls for row in rows.values()] == [1, 1, 1, 1, 0]
    assert rows["step"].seconds == 1.0 and rows["output"].seconds == 2.0


def test_leaving_a_loop_leaves_its_phase(clock):
    stopwatch = Stopwatch()
    for number in stopwatch.each("newton", range(5)):
        clock.wait(1.0)
        if number == 1:
            break
    with stopwatch.phase("next"):
        clock.wait(1.0)
    rows = by_path(stopwatch.rows())
    assert list(rows) == ["newton", "next", OTHER]
    assert rows["newton"].calls == 2 and rows["newton"].seconds == 2.0


def test_a_restart_forgets_times_but_not_what_is_held(clock):
    stopwatch = Stopwatch()
    stopwatch.owns("step", lambda: 24)
    walk(stopwatch, clock)
    stopwatch.restart()
    with stopwatch.phase("step"):
        clock.wait(1.0)
    (step, other) = stopwatch.rows()
    assert step == (("step",), 1.0, 1.0, 1.0, 1, 24) and other.seconds == 0.0


def test_compiling_is_a_phase_of_its_own(clock):
    """Within the phase that called for it, with a kernel's kernels; nothing without a phase."""

    @njit
    def inner(x):
        return x + 1

    @njit
    def outer(x):
        return 2 * inner(x)

    stopwatch, idle = Stopwatch(), Stopwatch()
    for _ in range(2):
        with stopwatch.phase("step"), stopwatch.phase("solve"):
            assert outer(1.0) == 4.0
            clock.wait(1.0)
    assert stopwatch.calls == {"step": 2, "solve": 2, "compiling": 1}
    assert list(by_path(stopwatch.rows())) == [
        "step", "step > solve", "step > solve > compiling", OTHER,
    ]  # fmt: skip
    assert idle.calls == {}
    outer(1)  # of another type
    assert stopwatch.calls["compiling"] == 1


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A plastic bar, whose first step is cut in two, in a folder."""
    material = J2SmallStrain(
        young=1.0, poisson=0.3, yield_stress=1e-3, hardening=Linear(0.1), density=1.0
    )
    motions = [
        PrescribedVelocity(LEFT, 0, 0.0),
        PrescribedVelocity(RIGHT, 0, 0.15),
        PrescribedVelocity(BOTTOM, 1, 0.0),
    ]
    scene = Scene(box_bodies((2.0, 1.0), (2, 1), label=0), {1: material}, loads=motions)
    simulation = Simulation(scene, 1.0, theta=1.0, inertia=False)
    recorder = Recorder(simulation, tmp_path_factory.mktemp("run"), end_time=2.0, fields=2)
    steps = [s for s, _ in recorded_steps(recorder, 2.0, "bar", quiet=True, profile=True)]
    return recorder, steps


def test_a_run_counts_its_phases(recorded):
    recorder, steps = recorded
    stopwatch = recorder.simulation.stopwatch
    rows = by_path(stopwatch.rows())
    assert len(steps) == 4  # two, each cut
    attempts = rows["step"].calls
    assert attempts == 6 and stopwatch.calls["commit"] == 4
    # cut steps iterate too
    assert rows["step > newton"].calls > sum(s.newton_iterations for s in steps) >= 8
    assert rows["output > checkpoint"].calls == 1
    assert rows["output > fields"].calls == 3 and rows["output"].calls == 3 + 4 + 1
    assert "step > newton > interaction solve" not in rows
    np.testing.assert_allclose(
        sum(row.own for row in rows.values()),
        sum(r.seconds for r in rows.values() if len(r.path) == 1),
    )
    assert all(row.own >= 0.0 for row in rows.values())


def test_phases_hold_what_their_arrays_take(recorded):
    recorder, _ = recorded
    simulation = recorder.simulation
    rows = by_path(simulation.stopwatch.rows())
    held = {name: row.bytes for name, row in rows.items() if row.bytes}
    files = [recorder.folder / name for name in ("history.csv", "bulk.xdmf", "bulk.h5")]
    assert held == {
        "set-up > forms": simulation.bulk.nbytes,
        # 8 triangles, one point each: e_p has four components, alpha is one; twelve answers of the
        # end of the step, none of them across the plane, and a weight
        "step > commit": 8 * (5 + 12 + 1) * 8,
        "output": sum(path.stat().st_size for path in files),
        "step > inverse": simulation.scheme.nbytes,
    }


def test_the_summary_has_the_profile(recorded):
    recorder, _ = recorded
    summary = json.loads((recorder.folder / "summary.json").read_text())
    rows = {row["path"]: row for row in summary["profile"]}
    assert rows["step"]["calls"] == 6 and rows["step"]["bytes"] == 0
    assert {"seconds", "own", "share", "calls", "bytes", "path"} == set(rows[OTHER])
    total = sum(row["share"] for path, row in rows.items() if " > " not in path)
    assert total == pytest.approx(1.0, rel=1e-12)
    assert (recorder.folder / "profile.png").stat().st_size > 10_000


def test_the_table_indents_what_is_within(clock):
    stopwatch = Stopwatch()
    stopwatch.owns("solve", lambda: 2_500_000)
    walk(stopwatch, clock)
    _, step, newton, solve, *_, other = profile_table(stopwatch.rows()).splitlines()
    assert step.split() == ["step", "22.000", "s", "2.000", "s", "75.9", "%", "2", "11000.000",
                            "ms", "-"]  # fmt: skip
    assert newton.startswith("  newton ") and solve.startswith("    solve ")
    assert solve.endswith("2.50 MB") and other.split()[:2] == [OTHER, "5.000"]


def test_bars_stand_under_the_phase_they_are_within(clock):
    stopwatch = Stopwatch()
    walk(stopwatch, clock)
    axes = plot_profile(stopwatch.rows()).axes[0]
    bars = {(bar.get_x(), bar.get_y() + 0.5 * bar.get_height()): bar for bar in axes.patches}
    widths = {place: bar.get_width() for place, bar in bars.items()}
    assert widths == pytest.approx(
        {(0.0, 0.0): 22.0, (0.0, 1.0): 20.0, (0.0, 2.0): 16.0, (22.0, 0.0): 2.0, (24.0, 0.0): 5.0}
    )
    assert axes.get_xlim() == (0.0, 29.0)
    assert bars[24.0, 0.0].get_hatch() and not bars[22.0, 0.0].get_hatch()
    names = {text.get_text().splitlines()[0].split(",")[0] for text in axes.texts}
    assert {"step", "newton", "solve", OTHER} == names


def test_an_elastic_run_has_no_phase_for_what_it_does_not_do():
    motions = [PrescribedVelocity(side, 0, 0.0) for side in (LEFT, RIGHT)]
    material = LinearElastic(young=1.0, poisson=0.3, density=1.0)
    scene = Scene(box_bodies((2.0, 1.0), (2, 1), label=0), {1: material}, loads=motions)
    simulation = Simulation(scene, 0.1)
    next(simulation.steps(0.1))
    assert not {"flow check", "interaction solve", "output"} & set(simulation.stopwatch.seconds)
