# SPDX-License-Identifier: LGPL-3.0-or-later
"""Restart: a run that goes on from a checkpoint is the run that never stopped."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
from argparse import ArgumentParser
from dataclasses import replace
from pathlib import Path

import effect_scenes
import h5py
import meshio
import numpy as np
import pytest
import restart_scenes
from dolfinx import fem
from scenes import LEFT, RIGHT, TOP, box_bodies

import xper_fx
from xper_fx.forms.loads import Gravity, PrescribedVelocity
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import CohesiveZone, SignoriniCoulomb
from xper_fx.output.checkpoint import restore, save
from xper_fx.output.gauges import TensileGauge
from xper_fx.output.hdf5_tree import read_tree, write_tree
from xper_fx.output.history import read_history
from xper_fx.output.recorder import Recorder
from xper_fx.output.row_blocks import StoredRows
from xper_fx.output.run import add_run_options, recorded_steps
from xper_fx.output.series import TimeSeries
from xper_fx.output.signals import Interruption
from xper_fx.scene import Scene, Wall
from xper_fx.scene.fingerprint import differences, fingerprint
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.errors import CheckpointError, ConvergenceError
from xper_fx.support.saved_rows import Rows

# Of a bar of two halves, until its bond has broken and it has swung back.
STEP, STEPS = 0.1, 30
END = STEP * STEPS
BAR = {
    "material": LinearElastic(young=1.0, poisson=0.3, density=1.0),
    "law": CohesiveZone(10.0, 1e-4, 1e-2),
    "speed": 0.02,
}


def bar(step=STEP, cells=(2, 1), tags=None, more=(), walls=(), order=1, **options):
    """A bar of two halves that is pulled until its bond breaks."""
    of = BAR | {name: options.pop(name) for name in BAR if name in options}
    bodies = box_bodies((2.0, 1.0), cells, label=lambda x: x[0] > 1.0, material=tags)
    scene = Scene(
        bodies,
        dict.fromkeys((1, 2) if tags else (1,), of["material"]),
        default_interaction=of["law"],
        loads=[PrescribedVelocity(LEFT, 0, 0.0), PrescribedVelocity(RIGHT, 0, of["speed"]), *more],
        walls=walls,
        order=order,
    )
    return Simulation(scene, step, **{"num_threads": 1, "solver": "nlgs"} | options)


def recorder_of(simulation, folder, **options) -> Recorder:
    gauge = TensileGauge(LEFT, RIGHT, 0, 2.0, 1.0)
    return Recorder(simulation, folder, **{"end_time": END, "gauge": gauge, "fields": 10} | options)


def recorded(folder, simulation=None, end=END, **options) -> Recorder:
    """A run with its files, made or gone on with until an end time."""
    recorder = recorder_of(simulation or bar(), folder, **options)
    for _ in recorded_steps(recorder, end, "bar", quiet=True):
        pass
    return recorder


def stop_at(folder, step: int, beyond: int = 4, simulation=None, **options) -> None:
    """A run with a checkpoint at a step that ends without a word some steps later."""
    recorder = recorder_of(simulation or bar(), folder, checkpoint_every=0.0, **options)
    for record in recorder.simulation.steps(END):
        recorder.record(record)
        if record.step == step:
            recorder.checkpoint()
        if record.step == step + beyond:
            recorder._history.close()
            recorder._lock.release()
            return


def contents(folder: Path) -> dict[str, bytes]:
    """What a run has left, its lock apart."""
    paths = [path for path in Path(folder).iterdir() if path.name != ".xper_fx-lock"]
    return {path.name: path.read_bytes() for path in paths}


def series_of(path: Path) -> list[tuple[float, dict]]:
    """All times of a series and their fields, as meshio reads them."""
    with meshio.xdmf.TimeSeriesReader(path) as reader:
        reader.read_points_cells()
        out = []
        for k in range(reader.num_steps):
            time, points, cells = reader.read_data(k)
            out.append((time, points | {name: data[0] for name, data in cells.items()}))
    return out


def same_series(one: Path, other: Path) -> None:
    first, second = series_of(one), series_of(other)
    assert [time for time, _ in first] == [time for time, _ in second]
    for (_, a), (_, b) in zip(first, second, strict=True):
        assert a.keys() == b.keys()
        assert all(np.array_equal(a[name], b[name], equal_nan=True) for name in a)


def same_files(one: Path, other: Path, names=("bulk", "interfaces")) -> None:
    """Histories and series of two folders are the same bit by bit."""
    assert (one / "history.csv").read_bytes() == (other / "history.csv").read_bytes()
    for name in names:
        same_series(one / f"{name}.xdmf", other / f"{name}.xdmf")
    summaries = [json.loads((folder / "summary.json").read_text()) for folder in (one, other)]
    for name in ("steps", "sweeps", "time", "errors"):
        assert summaries[0][name] == summaries[1][name]


def state_of(simulation) -> dict[str, np.ndarray]:
    """Everything that a run has come to."""
    state = simulation.state
    out = {name: getattr(state, name) for name in ("displacement", "velocity", "internal")}
    out["ledger"] = np.array(list(simulation.ledger.as_columns().values()))
    if simulation.interactions is not None:
        names = ("jump", "velocity", "impulse", "traction", "status", "energy", "damage")
        out |= {f"point {name}": simulation.interactions.gather(name) for name in names}
        for number, group in enumerate(simulation.interactions.contacts):
            out |= {f"{n} {number}": getattr(group, n) for n in ("jump", "impulse", "state")}
    if simulation.rigid is not None:
        out |= {f"rigid {name}": array for name, array in simulation.rigid.saved().items()}
    if hasattr(simulation.forms, "has_history"):
        out |= simulation.forms.history()
    if simulation.macroscopic is not None:
        out |= {name: np.array(v) for name, v in simulation.macroscopic._asdict().items()}
    return out


def readings(simulation) -> dict[str, np.ndarray]:
    """What a run tells of its last step."""
    scene = simulation.model.scene
    out = {"tolerance": simulation.tolerance}
    if simulation.macroscopic is not None:
        out |= simulation.macroscopic._asdict()
    elif scene.bodies is not None:
        for tag in np.unique(scene.bodies.facet_tags.values).tolist():
            out[f"reaction {tag}"] = simulation.reaction(tag)
            out[f"moved {tag}"] = simulation.mean_displacement(tag)
            out[f"moved for the reaction {tag}"] = simulation.mean_displacement_of_reaction(tag)
    if scene.rigid_bodies is not None:
        for group in scene.rigid_bodies.groups:
            out[f"reaction of {group}"] = simulation.reaction_of(group)
    return {name: np.copy(value) for name, value in out.items()}


def restarts_equal(whole, make, end: float, folder: Path, parts=(1 / 3, 2 / 3)) -> list:
    """Restart a run from its checkpoints, each of which must go on as the run did.

    Returns:
        The records of the run.
    """
    records, saved, told = [], [], {}
    for record in whole.steps(end):
        records.append(record)
        if len(saved) < len(parts) and record.time >= parts[len(saved)] * end:
            save(folder / f"{record.step}.h5", whole)
            saved.append(record.step)
            told[record.step] = readings(whole)
    assert len(saved) == len(parts) and saved[-1] < len(records)
    expected = state_of(whole)
    for step in saved:
        again = make()
        restore(folder / f"{step}.h5", again)
        assert again.step_number == step and again.time == records[step - 1].time
        np.testing.assert_equal(readings(again), told[step])
        assert list(again.steps(end)) == records[step:]
        found = state_of(again)
        assert found.keys() == expected.keys()
        different = [name for name in expected if not np.array_equal(found[name], expected[name])]
        assert not different
    return records


@pytest.mark.slow
@pytest.mark.parametrize("scene", restart_scenes.SCENES, ids=lambda scene: scene.__name__)
def test_a_restarted_run_is_the_same_bit_by_bit(scene, tmp_path):
    end, event = restart_scenes.SCENES[scene]
    run = scene()
    records = restarts_equal(run, scene, end, tmp_path)
    energies = run.ledger.energies
    if event == "broken":
        damage = run.interactions.gather("damage")
        assert damage.min() == 0.0 and energies.dissipated_cohesion > 0.0
    elif event == "cut":
        # saved within a step that was cut, of which a piece was left
        saved = [read_tree(path)["simulation"] for path in tmp_path.iterdir()]
        assert len({record.size for record in records}) > 1
        assert any(len(tree["course"]["pieces"]) for tree in saved)
    elif event == "flown":
        assert energies.dissipated_plastic > 0.0
    elif event == "retired":
        saved = [read_tree(path)["simulation"] for path in tmp_path.iterdir()]
        assert not all(tree["interactions"]["kept"].all() for tree in saved)
        assert sum(map(len, run.interactions.contacts)) > 0
    else:
        assert energies.dissipated_impact > 0.0 and energies.dissipated_friction > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("scene", effect_scenes.SCENES, ids=lambda scene: scene.__name__)
def test_every_effect_restarts(scene, tmp_path):
    run = scene()
    restarts_equal(run, scene, 6 * run.step_size, tmp_path, parts=(0.49,))


def test_the_tolerance_that_was_picked_is_taken(tmp_path):
    """The next step after a restart is solved to what the run had found it to need."""
    run = restart_scenes.explicit_plate()
    for record in run.steps(0.5):
        if record.step == 3:
            break
    save(tmp_path / "run.h5", run)
    tree = read_tree(tmp_path / "run.h5")["simulation"]
    tree["accuracy"]["learnt"]["tolerance"] = 0.25 * run.tolerance
    again = restart_scenes.explicit_plate()
    assert again.tolerance != 0.25 * run.tolerance
    again.restore(tree)
    assert again.tolerance == 0.25 * run.tolerance


def test_an_inverse_of_a_stiff_iterate_is_made_again(tmp_path, monkeypatch):
    """That of a step is refused where stiffness hides the mass; one renewed on the way is not."""
    run = restart_scenes.turning_cells()
    next(run.steps(1.0))
    save(tmp_path / "run.h5", run)
    again = restart_scenes.turning_cells()
    monkeypatch.setattr("xper_fx.bulk.kept_inverses._HIDDEN", 0.0)
    restore(tmp_path / "run.h5", again)
    assert again.model.scheme.holds(again.step_size)


# -- what a checkpoint is


def test_rows_are_saved_by_their_numbers():
    """Whatever order a process holds them in; keys of two numbers by the first, then the second."""
    values = np.arange(8.0).reshape(4, 2)
    assert np.array_equal(Rows(np.array([2, 0, 3, 1]), values).in_order(), values[[1, 3, 0, 2]])
    keys = np.array([[2, 0], [1, 5], [1, 4], [0, 9]])
    assert np.array_equal(Rows(keys, values).in_order(), values[[3, 2, 1, 0]])


def test_a_tree_is_read_as_it_was_written(tmp_path):
    tree = {
        "a": {"b": np.arange(3), "c": {"d": 1.5, "e": "text, \u00e9"}}, "i": 7, "yes": True,
        "none": np.zeros((0, 2)), "rows": np.array([[np.nan], [1.0]]),
    }  # fmt: skip
    write_tree(tmp_path / "t.h5", tree)
    found = read_tree(tmp_path / "t.h5")
    assert found["a"]["c"] == {"d": 1.5, "e": "text, \u00e9"} and found["i"] == 7
    assert found["yes"] is True and found["none"].shape == (0, 2)
    assert np.array_equal(found["a"]["b"], np.arange(3))
    assert np.array_equal(found["rows"], [[np.nan], [1.0]], equal_nan=True)
    assert [path.name for path in tmp_path.iterdir()] == ["t.h5"]


@pytest.mark.parametrize("block", [1, 50, 10_000])
def test_rows_are_read_block_by_block(tmp_path, monkeypatch, block):
    """Each rank reads its own, in whatever order and as often as it likes."""
    number = np.random.default_rng(3).permutation(20)
    values = {"v": 1.0 * np.stack([number, -number], axis=1), "m": number > 9}
    rows = {name: Rows(number, array) for name, array in values.items()}
    write_tree(tmp_path / "t.h5", {"rows": rows})
    monkeypatch.setattr("xper_fx.output.row_blocks._BLOCK", block)
    stored = {name: StoredRows(tmp_path / "t.h5", f"rows/{name}") for name in rows}
    wanted = np.array([7, 19, 0, 7, 12])
    np.testing.assert_array_equal(stored["v"][wanted], np.stack([wanted, -wanted], axis=1))
    np.testing.assert_array_equal(stored["v"][wanted, :1], wanted[:, None])
    np.testing.assert_array_equal(stored["m"][wanted], wanted > 9)
    assert stored["v"][wanted[:0]].shape == (0, 2) and stored["m"][wanted].dtype == bool
    assert len(list(stored["v"].blocks())) == {1: 20, 50: 7, 10_000: 1}[block]


@pytest.mark.parametrize("where", ["h5py.File.__setitem__", "os.fsync", "os.replace"])
def test_a_crash_while_writing_leaves_the_last_checkpoint(where, tmp_path, monkeypatch):
    simulation, path = bar(), tmp_path / "c.h5"
    steps = simulation.steps(END)
    next(steps)
    save(path, simulation)
    before = path.read_bytes()
    next(steps)
    calls = []

    def fail(*arguments):
        calls.append(arguments)
        raise OSError("the disk is full")

    with monkeypatch.context() as patch:
        patch.setattr(where, fail)
        with pytest.raises(OSError, match="the disk is full"):
            save(path, simulation)
    assert calls and path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["c.h5"]
    again = bar()
    restore(path, again)
    assert again.step_number == 1
    save(path, simulation)
    assert read_tree(path)["simulation"]["step_number"] == 2


def test_a_kill_while_writing_leaves_the_last_checkpoint(tmp_path):
    """What a killed process leaves beside it is no checkpoint and is overwritten by the next."""
    simulation, path = bar(), tmp_path / "c.h5"
    next(simulation.steps(END))
    save(path, simulation)
    (tmp_path / ".c.h5.tmp").write_bytes(path.read_bytes()[:5000])
    restore(path, bar())
    save(path, simulation)
    assert [p.name for p in tmp_path.iterdir()] == ["c.h5"]


@pytest.fixture(scope="module")
def stopped(tmp_path_factory):
    """A folder with a checkpoint after 12 steps and files that go on for 4 more; not to change."""
    folder = tmp_path_factory.mktemp("stopped") / "run"
    stop_at(folder, 12)
    return folder


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The folder of a run that never stopped, and the run."""
    folder = tmp_path_factory.mktemp("whole") / "run"
    return folder, recorded(folder).simulation


@pytest.fixture
def folder(stopped, tmp_path):
    """A copy of the stopped run."""
    shutil.copytree(stopped, tmp_path / "run")
    return tmp_path / "run"


def refused(folder, match, simulation=None, error=CheckpointError, **options) -> None:
    """A restart raises, and leaves the folder as it was."""
    before = contents(folder)
    with pytest.raises(error, match=match):
        recorder_of(simulation or bar(), folder, restart=True, **options)
    assert contents(folder) == before


@pytest.mark.parametrize("left", [0.0, 0.01, 0.5, 0.999])
def test_a_truncated_checkpoint_is_refused(folder, left):
    path = folder / "checkpoint.h5"
    os.truncate(path, int(left * path.stat().st_size))
    refused(folder, r"checkpoint\.h5 cannot be read: it was cut short.*from its beginning")


def test_a_changed_byte_is_noticed(folder):
    path = folder / "checkpoint.h5"
    with h5py.File(path) as h5:
        place = h5["simulation/state/velocity/nodes"].id.get_offset()
    content = bytearray(path.read_bytes())
    content[place + 5] ^= 1
    path.write_bytes(content)
    refused(folder, "its digest is not that of its content")


def test_a_foreign_file_is_refused(folder):
    path = folder / "checkpoint.h5"
    path.write_text("no HDF5")
    refused(folder, "cannot be read")
    with h5py.File(path, "w") as h5:
        h5["x"] = 1.0
    refused(folder, "no checkpoint of xper_fx")


@pytest.mark.parametrize(("name", "value"), [("xper_fx", "99.0"), ("format", 99)])
def test_another_version_is_refused(folder, name, value):
    with h5py.File(folder / "checkpoint.h5", "r+") as h5:
        h5.attrs[name] = value
    refused(folder, rf"99.*this is xper_fx {xper_fx.__version__}.*the version that wrote it")


MATERIAL, LAW = BAR["material"], BAR["law"]
EXPLICIT = {"scheme": "explicit", "solver": "auto", "step": 0.02}
OTHER_SCENES = {
    "material": ({"material": replace(MATERIAL, young=2.0)}, r"materials\.1\.young: 1\.0, here 2"),
    "law": ({"law": CohesiveZone(10.0, 2e-4, 1e-2)}, r"default_interaction\.\w+: 0\.0001, here"),
    "other law": ({"law": SignoriniCoulomb()}, r"default_interaction\.type: \"CohesiveZone\""),
    "speed": ({"speed": 0.03}, r"loads\[1\]\.value: 0\.02, here 0\.03"),
    "function": ({"speed": lambda t: 0.02 + 1e-9 * t}, r"loads\[1\]\.value"),
    "gravity": ({"more": [Gravity((0.0, -1.0))]}, "loads"),
    "mesh": ({"cells": (4, 2)}, r"mesh\.cells: 8, here 32"),
    "tags": ({"tags": {2: lambda x: x[1] > 0.5}}, r"mesh\.cell tags"),
    "wall": ({"walls": [Wall(TOP, (0, 2), (0, -1), SignoriniCoulomb())]}, "walls"),
    "order": ({"order": 2}, "order: 1, here 2"),
    "theta": ({"theta": 0.7}, r"theta: 0\.5, here 0\.7"),
    "scheme": (EXPLICIT, 'scheme: "implicit", here "explicit"'),
}  # fmt: skip


@pytest.mark.parametrize("change", OTHER_SCENES)
def test_another_scene_is_refused(folder, change):
    options, difference = OTHER_SCENES[change]
    refused(folder, f"is of another scene: .*{difference}.*another folder", bar(**options))


def test_fields_are_told_apart_by_their_values():
    """Functions of one name, and those of DOLFINx."""

    def described(strength, factor=1.0):
        scene = bar(law=replace(LAW, strength=lambda x: strength * (1.0 + x[0]))).scene
        velocity = fem.Function(fem.functionspace(scene.bodies.mesh, ("P", 1, (2,))))
        velocity.x.array[:] = factor * np.arange(len(velocity.x.array))
        return fingerprint(replace(scene, initial_velocity=velocity), [0.0])

    first = described(1e-4)
    assert differences(first, described(1e-4)) == []
    (law,) = differences(first, described(1.1e-4))
    (velocity,) = differences(first, described(1e-4, 2.0))
    assert law.startswith("default_interaction") and velocity.startswith("initial_velocity")


def test_another_shape_of_the_mesh_is_another_scene(folder):
    simulation = bar()
    simulation.scene.bodies.mesh.geometry.x[0, 1] += 1e-12
    refused(folder, r"mesh\.shape", simulation)


def test_functions_of_time_are_known_by_their_values(tmp_path):
    """Until the checkpoint: what comes later may be another load."""
    path = tmp_path / "c.h5"
    one = bar(speed=lambda t: 0.02 * t)
    next(one.steps(END))
    save(path, one)
    restore(path, bar(speed=lambda time: 0.02 * min(time, 1.0)))
    with pytest.raises(CheckpointError, match=r"loads\[1\]\.value"):
        restore(path, bar(speed=lambda t: 0.021 * t))


# -- files


@pytest.mark.parametrize("beyond", [0, 1, 4])
def test_files_go_on_without_a_step_twice_or_missing(whole, tmp_path, beyond):
    folder, run = whole
    stop_at(tmp_path / "run", 12, beyond)
    recorder = recorded(tmp_path / "run", restart=True)
    same_files(folder, tmp_path / "run")
    assert np.array_equal(recorder.simulation.state.velocity, run.state.velocity)
    assert run.interactions.gather("damage").min() == 0.0
    steps = read_history(tmp_path / "run" / "history.csv")["step"]
    assert np.array_equal(steps, np.arange(1, STEPS + 1))
    assert len(series_of(folder / "bulk.xdmf")) == 11
    summaries = [json.loads((f / "summary.json").read_text()) for f in (folder, tmp_path / "run")]
    assert [summary["restarts"] for summary in summaries] == [0, 1]


def test_many_restarts_are_one_run(whole, tmp_path):
    folder, _ = whole
    stop_at(tmp_path / "run", 5, 2)
    for step in (9, 10, 17):
        stop_at(tmp_path / "run", step, 3, restart=True)
    recorded(tmp_path / "run", restart=True)
    same_files(folder, tmp_path / "run")


def test_rigid_bodies_go_on_too(tmp_path):
    """Displacements are those from the start of the run, not of the restart."""
    for name in ("whole", "run"):
        simulation = restart_scenes.falling_bodies()
        recorder = Recorder(simulation, tmp_path / name, end_time=0.1, fields=10)
        for record in simulation.steps(0.1):
            recorder.record(record)
            if name == "run" and record.step == 9:
                recorder.checkpoint()
                break
        recorder.close()
    simulation = restart_scenes.falling_bodies()
    with Recorder(simulation, tmp_path / "run", end_time=0.1, fields=10, restart=True) as recorder:
        for record in simulation.steps(0.1):
            recorder.record(record)
    same_files(tmp_path / "whole", tmp_path / "run", ("rigid",))


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"shape": (1 << 37,), "chunks": (1 << 16,)}, "'bulk/huge' declares 1099511627776 bytes"),
        ({"shape": (1 << 37,), "chunks": (1 << 16,), "compression": "gzip"}, "declares 1099511"),
        ({"shape": (1,), "external": [("/etc/hostname", 0, 8)]}, "'bulk/huge' .* external files"),
        (h5py.ExternalLink("other.h5", "x"), "'/bulk/huge' is a link into another file"),
    ],
)
def test_a_file_holds_what_it_declares(tmp_path, how, words):
    """Before a byte of it is allocated, or another file opened."""
    path = tmp_path / "c.h5"
    write_tree(path, {"bulk": {"a": np.zeros(10_000)}})
    read_tree(path)
    with h5py.File(path, "a") as file:
        if isinstance(how, dict):
            file["bulk"].create_dataset("huge", dtype="f8", **how)
        else:
            file["bulk/huge"] = how
    with pytest.raises(CheckpointError, match=words):
        read_tree(path)


def test_a_damaged_last_file_loses_nothing_older(whole, folder):
    """A kill within a write may leave the HDF5 file unreadable; the sealed ones are not opened."""
    assert (folder / "bulk.1.h5").exists()
    for name in ("bulk", "interfaces"):
        os.truncate(folder / f"{name}.1.h5", 100)
    with (folder / "history.csv").open("ab") as history:
        history.write(b"17,1.7,0.0")
    recorded(folder, restart=True)
    same_files(whole[0], folder)


@pytest.mark.parametrize("name", ["history.csv", "bulk.xdmf", "interfaces.h5"])
def test_missing_files_are_told(folder, name):
    (folder / name).unlink()
    with pytest.raises(ValueError, match=rf"{name}.*from its beginning"):
        recorder_of(bar(), folder, restart=True)


@pytest.mark.parametrize("name", ["history.csv", "bulk.xdmf"])
def test_files_cut_short_are_told(folder, name):
    os.truncate(folder / name, 1500)
    with pytest.raises(ValueError, match=rf"{name}.*from its beginning"):
        recorder_of(bar(), folder, restart=True)


def test_fields_are_with_all_restarts_or_with_none(folder):
    refused(folder, "with fields: restart it with fields above 0", error=ValueError, fields=0)


def test_a_series_stands_in_files_that_are_closed_for_good(tmp_path):
    points, cells = np.eye(3)[:, :2], ("triangle", [[0, 1, 2]])
    series = TimeSeries(tmp_path / "s.xdmf", points, cells)
    series.write(0.0, {"u": [1.0, 2.0, 3.0]})
    series.seal()
    first = (tmp_path / "s.h5").read_bytes()
    for time in (1.0, 2.0):
        series.write(time, {"u": [time, 0.0, 0.0]})
    assert series.seal() == series.seal()
    after = series.seal()
    series.write(3.0, {"u": [9.0, 0.0, 0.0]})
    series.close()
    assert (tmp_path / "s.h5").read_bytes() == first
    assert [path.name for path in series.h5_paths] == ["s.h5", "s.1.h5", "s.2.h5"]
    assert [time for time, _ in series_of(series.path)] == [0.0, 1.0, 2.0, 3.0]
    again = TimeSeries(tmp_path / "s.xdmf", points, cells, after)
    assert not (tmp_path / "s.2.h5").exists()
    assert [time for time, _ in series_of(series.path)] == [0.0, 1.0, 2.0]
    with pytest.raises(ValueError, match="grow"):
        again.write(2.0, {"u": [0.0, 0.0, 0.0]})
    again.write(2.5, {"u": [4.0, 5.0, 6.0]})
    again.close()
    times = series_of(again.path)
    assert [time for time, _ in times] == [0.0, 1.0, 2.0, 2.5]
    assert times[3][1]["u"].tolist() == [4.0, 5.0, 6.0] and times[0][1]["u"].tolist() == [1, 2, 3]
    TimeSeries(tmp_path / "s.xdmf", points, cells).close()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["s.h5"]


# -- how users restart


def test_other_options_may_be_taken(whole, folder):
    """Half the step and a tighter tolerance: the same run but for what they change."""
    simulation = bar(step=0.5 * STEP, tolerance=1e-8)
    recorder = recorded(folder, simulation, restart=True)
    assert recorder.restarted and simulation.time == pytest.approx(END)
    history = read_history(folder / "history.csv")
    assert np.allclose(np.diff(history["time"])[:11], STEP)
    assert np.allclose(np.diff(history["time"])[11:], 0.5 * STEP)
    expected = read_history(whole[0] / "history.csv")
    assert np.array_equal(history["stress"][:12], expected["stress"][:12])
    peak = expected["stress"].max()
    assert history["stress"].max() == pytest.approx(peak, rel=0.05)
    closure = np.abs(history["closure"]).max()
    assert closure < 1e-12 * history["external_work"].max()


def test_a_restart_without_a_checkpoint_begins_anew(whole, tmp_path, caplog):
    recorder = recorded(tmp_path / "run", restart=True)
    assert not recorder.restarted
    assert "there is no checkpoint, the run starts from its beginning" in caplog.text
    same_files(whole[0], tmp_path / "run")


def test_a_complete_run_has_nothing_left_to_do(whole, tmp_path, caplog):
    shutil.copytree(whole[0], tmp_path / "run")
    before = contents(tmp_path / "run")
    recorder = recorded(tmp_path / "run", restart=True)
    assert "complete until 3 s, there is nothing left to do" in caplog.text
    assert recorder.strain == read_history(tmp_path / "run" / "history.csv")["strain"][-1] > 0.0
    assert recorder.simulation.step_number == STEPS
    assert contents(tmp_path / "run") == before


@pytest.mark.parametrize(
    "make",
    [
        bar,
        lambda: bar(
            more=[PrescribedVelocity(side, 1, 0.0) for side in (LEFT, RIGHT)],
            inertia=False, solver="auto", path=xper_fx.GrowthControl(),
        ),
    ],
    ids=["steps", "path"],
)  # fmt: skip
def test_a_run_killed_after_its_last_step_is_complete(make, tmp_path, caplog):
    """The last step of a given size goes beyond the end, a path ends there."""
    end = 4.5 * STEP if make is bar else 1.0
    whole = recorded(tmp_path / "whole", make(), end, end_time=end)
    steps, folder = whole.simulation.step_number, tmp_path / "killed"
    assert whole.simulation.time > end if make is bar else whole.simulation.time == end
    assert steps > 1
    with recorder_of(make(), folder, end_time=end) as recorder:
        recorder.record(next(recorder.simulation.steps(end)))
        recorder.checkpoint()
    recorder = recorder_of(make(), folder, end_time=end, restart=True)
    for record in recorder.simulation.steps(end):
        recorder.record(record)
    recorder.checkpoint()
    recorder._history.close()
    recorder._lock.release()
    again = recorded(folder, make(), end, end_time=end, restart=True)
    assert "there is nothing left to do" in caplog.text
    assert again.simulation.step_number == steps
    assert again.simulation.time == whole.simulation.time
    same_files(tmp_path / "whole", folder)
    told = [json.loads((f / "summary.json").read_text()) for f in (tmp_path / "whole", folder)]
    assert [summary["steps"] for summary in told] == [steps, steps]
    with pytest.raises(ValueError, match="lies before the present time"):
        next(again.simulation.steps(0.9 * end))


def test_a_complete_run_goes_on_to_a_later_end(tmp_path):
    recorded(tmp_path / "run", end=0.5 * END)
    recorded(tmp_path / "run", restart=True)
    recorded(tmp_path / "whole")
    same_files(tmp_path / "whole", tmp_path / "run")


def test_a_new_run_forgets_the_checkpoint_of_the_last(folder):
    """Otherwise a restart of the new run would go on with the last one."""
    recorder_of(bar(), folder).close()
    assert not (folder / "checkpoint.h5").exists()


def test_checkpoints_come_in_time(tmp_path, monkeypatch):
    """Every 3 s of a clock that shows a second more at each look."""
    clock = iter(range(1000))
    monkeypatch.setattr("xper_fx.output.recorder.monotonic", lambda: next(clock))
    recorder, seen = recorder_of(bar(), tmp_path, checkpoint_every=3.0), []
    for record in recorder.simulation.steps(10 * STEP):
        recorder.record(record)
        path = tmp_path / "checkpoint.h5"
        if path.exists():
            seen.append(read_tree(path)["simulation"]["step_number"])
    recorder.close()
    assert seen == [3, 3, 3, 6, 6, 6, 9, 9]
    with pytest.raises(ValueError, match="checkpoint_every is a time in seconds.*-1"):
        recorder_of(bar(), tmp_path, checkpoint_every=-1.0)


def test_without_checkpoints_none_are_written(tmp_path):
    recorded(tmp_path, checkpoint_every=0.0)
    series = {f"{name}.{suffix}" for name in ("bulk", "interfaces") for suffix in ("h5", "xdmf")}
    assert set(contents(tmp_path)) == {"history.csv", "summary.json", *series}


def test_a_step_that_fails_can_be_taken_with_other_options(whole, tmp_path):
    """The checkpoint is that of the state before it."""
    simulation = bar()
    recorder = recorder_of(simulation, tmp_path / "run", checkpoint_every=0.0)
    with pytest.raises(ConvergenceError, match=r"checkpoint\.h5") as caught:
        for _ in recorded_steps(recorder, END, "bar", quiet=True):
            if simulation.step_number == 9:
                few = replace(simulation.options.solve, max_sweeps=1)
                simulation.model.options = replace(simulation.options, solve=few)
                simulation.tolerance = 1e-15
    assert caught.value.saved == tmp_path / "run" / "checkpoint.h5"
    recorder = recorded(tmp_path / "run", restart=True)
    history = [read_history(f / "history.csv") for f in (whole[0], tmp_path / "run")]
    assert np.array_equal(history[1]["step"], np.arange(1, STEPS + 1))
    for name in ("stress", "external_work", "kinetic", "dissipated_cohesion"):
        scale = np.abs(history[0][name]).max()
        assert history[1][name] == pytest.approx(history[0][name], abs=1e-6 * scale)


def test_options_of_a_command_line():
    parser = ArgumentParser()
    add_run_options(parser, Path("out"))
    options = parser.parse_args([])
    assert options.checkpoint_every == 600.0 and options.restart is False
    options = parser.parse_args(["--restart", "--checkpoint-every", "60"])
    assert options.checkpoint_every == 60.0 and options.restart is True


# -- interruptions


@pytest.fixture
def usual_handlers():
    """What Python does at a signal, whatever a test before or the shell has chosen."""
    usual = {signal.SIGTERM: signal.SIG_DFL, signal.SIGINT: signal.default_int_handler}
    usual[signal.SIGHUP] = signal.SIG_DFL
    before = {number: signal.signal(number, handler) for number, handler in usual.items()}
    yield
    for number, handler in before.items():
        signal.signal(number, handler or signal.SIG_DFL)


def test_signals_are_noted_once_and_only_within(usual_handlers):
    before = [signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)]
    with Interruption() as interruption:
        assert interruption.number == 0
        signal.raise_signal(signal.SIGINT)
        assert interruption.number == signal.SIGINT
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert [signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)] == before

    signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as `nohup` does
    with Interruption() as interruption:
        signal.raise_signal(signal.SIGHUP)
        assert interruption.number == 0

    def elsewhere():
        with Interruption():
            found.append(signal.getsignal(signal.SIGTERM))

    found: list = []
    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert found == [before[0]]


@pytest.fixture(scope="module")
def processes(tmp_path_factory):
    """Folder of the runs of `restart_process.py`, and what it says of them."""
    folder = tmp_path_factory.mktemp("processes")
    script = Path(restart_scenes.__file__).with_name("restart_process.py")
    done = subprocess.run(
        [sys.executable, script, folder], capture_output=True, text=True,
        env=os.environ | {"NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return folder, json.loads(done.stdout.splitlines()[-1])


@pytest.mark.slow
def test_kills_lose_nothing_but_the_last_steps(processes):
    folder, found = processes
    killed = found["killed"]
    assert killed["statuses"] == [-signal.SIGKILL] * 6 and killed["last"] == 0
    saved, reached = np.array(killed["saved"]), np.array(killed["reached"])
    assert np.all(np.diff(saved) >= 0) and np.all(reached >= saved)
    assert len(np.unique(saved)) > 1 and np.count_nonzero(reached > saved) > 1
    same_files(folder / "whole", folder / "killed")
    steps = read_history(folder / "killed" / "history.csv")["step"]
    assert np.array_equal(steps, np.arange(1, 201))
    trees = [read_tree(folder / name / "checkpoint.h5") for name in ("whole", "killed")]
    assert_same(*(tree["simulation"] for tree in trees))


def assert_same(one, other) -> None:
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for name in one:
            assert_same(one[name], other[name])
    else:
        np.testing.assert_equal(one, other)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "status"), [("terminated", 143), ("interrupted", 130), ("hung_up", 129)]
)
def test_a_signal_ends_a_run_that_can_go_on(processes, name, status):
    folder, found = processes
    assert found[name] == found[name] | {"status": status, "saved": True, "after": 0}
    assert 5 <= found[name]["steps"] < 300
    log = (folder / f"{name}.log").read_text()
    signal_name = signal.Signals(status - 128).name
    assert f"bar: ended by {signal_name} at" in log and "--restart" in log
    same_files(folder / "whole", folder / name)


@pytest.mark.slow
def test_a_second_signal_ends_a_run_at_once(processes):
    _, found = processes
    assert found["twice"]["status"] == -signal.SIGTERM and not found["twice"]["saved"]


@pytest.mark.slow
def test_a_complete_run_ends_well_when_restarted(processes):
    folder, found = processes
    assert found["complete"] == 0
    assert "nothing left to do" in (folder / "whole.log").read_text()
