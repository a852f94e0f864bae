# SPDX-License-Identifier: LGPL-3.0-or-later
"""A full disk, a folder that is gone or read-only, files open elsewhere, two runs in one folder.

One clear error each, what was written before readable, and writing goes on where it can.
"""

from __future__ import annotations

import errno
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import textwrap
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pytest
from scenes import LEFT, RIGHT, box_bodies
from test_output import POINTS, TRIANGLES, check, fields

from xper_fx.forms.loads import PrescribedVelocity
from xper_fx.materials import LinearElastic
from xper_fx.output.checkpoint import save
from xper_fx.output.folder_lock import FolderLock
from xper_fx.output.gauges import CellGauge, TensileGauge
from xper_fx.output.history import History, read_history
from xper_fx.output.output_folder import prepare_folder
from xper_fx.output.recorder import Recorder
from xper_fx.output.series import TimeSeries
from xper_fx.output.summary import write_summary
from xper_fx.plotting.figures import new_figure
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

REPOSITORY = Path(__file__).parents[2]


@contextmanager
def file_limit(size: int):
    """No file may grow beyond `size` bytes: to writers, a full disk; root is not exempt."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def told(caught, path, code) -> None:
    """One error that names the file, the reason and what to do, and hides what is below."""
    error = caught.value
    assert error.errno == code
    assert f"'{path}' cannot be written ({os.strerror(code)})" in str(error)
    assert "What was written before is still there. To go on, " in str(error)
    assert error.__suppress_context__ and error.__cause__ is None


# Files


def begun_series(path, times: int) -> TimeSeries:
    series = TimeSeries(path, POINTS, ("triangle", TRIANGLES))
    for step in range(times):
        series.write(step / 3, *fields(step))
    return series


@pytest.mark.parametrize("room", [-1, 0, 1, 800, 2048, 6000, 9000, 20_000, 60_000])
def test_no_room_for_fields(tmp_path, room):
    """However much room is left, a time is there or not, and the file stays whole."""
    series = begun_series(tmp_path / "a.xdmf", 3)
    size = series.h5_path.stat().st_size
    written = 3
    with file_limit(size + room):
        if room == 60_000:
            series.write(1.0, *fields(3))
            written = 4
        else:
            with pytest.raises(OSError) as caught:
                series.write(1.0, *fields(3))
            told(caught, series.h5_path, errno.EFBIG)
            assert series.h5_path.stat().st_size == size
    check(series.path, written)
    for step in range(written, 6):
        series.write(step / 3, *fields(step))
    series.close()
    check(series.path, 6)


def no_room(*_, **__):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_no_room_for_xdmf_after_its_fields(tmp_path, monkeypatch):
    """The fields were stored, the grid that names them was not: the next write replaces them."""
    series = begun_series(tmp_path / "a.xdmf", 3)
    with monkeypatch.context() as patch:
        patch.setattr("xper_fx.output.series.TimeSeries._append", no_room)
        with pytest.raises(OSError) as caught:
            series.write(0.9, *fields(9))
        told(caught, series.path, errno.ENOSPC)
    check(series.path, 3)
    for step in range(3, 6):
        series.write(step / 3, *fields(step))
    series.close()
    check(series.path, 6)


def test_no_room_to_renew_the_xdmf(tmp_path):
    """The room in the file is used up and the disk full: the file stays as it is."""
    series = begun_series(tmp_path / "a.xdmf", 3)
    series._xml_size = 0
    before = series.path.read_bytes()
    with file_limit(max(60_000, series.h5_path.stat().st_size + 30_000)), pytest.raises(OSError):
        series.write(1.0, *fields(3))
    assert series.path.read_bytes() == before and not list(tmp_path.glob(".*"))
    series.write(1.0, *fields(3))
    series.close()
    check(series.path, 4)


@pytest.mark.parametrize("room", [0, 1, 7, 12])
def test_no_room_for_a_line(tmp_path, room):
    """A disk takes the part of a line for which it has room: no part stays."""
    path = tmp_path / "history.csv"
    with History(path, ("step", "time")) as history:
        history.append(step=1, time=0.5)
        with file_limit(path.stat().st_size + room), pytest.raises(OSError) as caught:
            history.append(step=222, time=1.0 / 3.0)
        told(caught, path, errno.EFBIG)
        assert path.read_text() == "step,time\n1,0.5\n"
        history.append(step=2, time=1.0)
    assert read_history(path)["step"].tolist() == [1.0, 2.0]


@pytest.mark.parametrize("kind", ["summary", "series", "figure"])
def test_older_results_outlive_a_write_that_fails(tmp_path, kind):
    path = {"summary": "s.json", "series": "a.h5", "figure": "f.png"}[kind]

    def write(number: int) -> None:
        if kind == "summary":
            write_summary(tmp_path / path, {"number": [number] * 1000})
        elif kind == "series":
            begun_series(tmp_path / "a.xdmf", number)
        else:
            new_figure(tmp_path / path, lambda _, axes: axes.plot([0, number]), (3.0, 3.0))

    write(1)
    before = (tmp_path / path).read_bytes()
    with file_limit(1000), pytest.raises(OSError) as caught:
        write(2)
    told(caught, tmp_path / path, errno.EFBIG)
    assert (tmp_path / path).read_bytes() == before and not list(tmp_path.glob(".*"))


@pytest.mark.parametrize("gone", ["folder", "file"])
def test_what_was_removed_is_noticed(tmp_path, gone):
    """A file that is open can be written to after it was removed, and nobody would see it."""
    folder = prepare_folder(tmp_path / "run")
    history, series = History(folder / "history.csv", ("step",)), begun_series(folder / "a.xdmf", 2)
    history.append(step=1)
    if gone == "folder":
        shutil.rmtree(folder)
    else:
        history.path.unlink()
        series.h5_path.unlink()
    with pytest.raises(FileNotFoundError) as caught:
        history.append(step=2)
    told(caught, history.path, errno.ENOENT)
    with pytest.raises(FileNotFoundError) as caught:
        series.write(1.0, *fields(2))
    told(caught, series.h5_path, errno.ENOENT)


def python(code: str, *arguments, before=(), **options) -> subprocess.Popen:
    """A Python process with this package and these tests."""
    tests = REPOSITORY / "tests"
    paths = os.pathsep.join(map(str, (REPOSITORY, tests / "output", tests / "shared")))
    return subprocess.Popen(
        [*before, sys.executable, "-c", textwrap.dedent(code), *map(str, arguments)],
        env=os.environ | {"PYTHONPATH": paths}, stdout=subprocess.PIPE, stdin=subprocess.PIPE,
        text=True, **options,
    )  # fmt: skip


OWN_MOUNTS = ("unshare", "--mount", "--map-root-user")


def has_own_mounts() -> bool:
    script = "mount -t tmpfs -o size=64k none /tmp"
    try:
        return (
            subprocess.run([*OWN_MOUNTS, "sh", "-c", script], capture_output=True).returncode == 0
        )
    except FileNotFoundError:
        return False


@pytest.mark.slow
@pytest.mark.skipif(not has_own_mounts(), reason="mounts a small disk in a namespace of its own")
@pytest.mark.parametrize("trouble", ["full", "read-only"])
def test_a_small_disk(tmp_path, trouble):
    """On a real file system that fills up, or turns read-only, and then is as before."""
    code = """
    import os, subprocess, sys
    from pathlib import Path
    from test_output import check, fields
    from test_output_failures import begun_series
    from xper_fx.output.history import History, read_history
    from xper_fx.output.output_folder import prepare_folder
    from xper_fx.output.summary import write_summary

    disk, trouble = Path(sys.argv[1]), sys.argv[2]
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "none", disk], check=True)
    folder = prepare_folder(disk / "run")
    series, history = begun_series(folder / "a.xdmf", 3), History(folder / "h.csv", ("step",))
    write_summary(folder / "s.json", {"a": 1})
    history.append(step=0)
    if trouble == "full":
        ballast = open(disk / "ballast", "wb", buffering=0)
        try:
            while ballast.write(bytes(1000)):
                pass
        except OSError:
            pass
    else:
        # Files that are open to be written keep a file system from turning read-only.
        history.close()
        subprocess.run(["mount", "-o", "remount,ro", disk], check=True)

    def filling_lines():
        for step in range(1, 5000):
            history.append(step=step)

    attempts = {
        "series": lambda: series.write(1.0, *fields(3)),
        "summary": lambda: write_summary(folder / "s.json", {"a": [2] * 10000}),
        "folder": lambda: prepare_folder(folder),
        "history": filling_lines if trouble == "full" else lambda: History(folder / "h.csv"),
    }
    for name, attempt in attempts.items():
        try:
            attempt()
        except OSError as error:
            print(name, type(error).__name__, error.errno, "cannot be written" in str(error))
    check(series.path, 3)
    lines = read_history(folder / "h.csv")["step"]
    assert lines.tolist() == list(range(len(lines)))
    assert (folder / "s.json").read_text().split() == ["{", '"a":', "1", "}"]
    if trouble == "full":
        ballast.close()
        (disk / "ballast").unlink()
        history.append(step=len(lines))
        assert len(read_history(folder / "h.csv")["step"]) == len(lines) + 1
    else:
        subprocess.run(["mount", "-o", "remount,rw", disk], check=True)
    series.write(1.0, *fields(3))
    series.close()
    check(series.path, 4)
    write_summary(folder / "s.json", {"a": 2})
    """
    with python(code, tmp_path, trouble, before=OWN_MOUNTS) as process:
        said = process.communicate()[0]
    code = errno.ENOSPC if trouble == "full" else errno.EROFS
    names = ("series", "summary", "folder", "history")
    assert said.splitlines() == [f"{name} OSError {code} True" for name in names]
    assert process.returncode == 0


def test_files_open_elsewhere(tmp_path):
    """Readers with HDF5's lock and with the kernel's do not disturb the run, nor it them."""
    series = begun_series(tmp_path / "a.xdmf", 2)
    history = History(tmp_path / "h.csv", ("step",))
    reader = python(
        """
        import fcntl, h5py, sys
        files = [h5py.File(sys.argv[1], "r", locking=True), open(sys.argv[2]), open(sys.argv[3])]
        for file in files[1:]:
            fcntl.flock(file, fcntl.LOCK_EX)
        print("open", flush=True)
        input()
        print(files[0]["times/000000/01/point/temperature"].shape)
        """,
        series.h5_path, series.path, history.path,
    )  # fmt: skip
    with reader:
        assert reader.stdout.readline() == "open\n"
        for step in range(2, 5):
            series.write(step / 3, *fields(step))
            history.append(step=step)
        assert reader.communicate("\n")[0] == "(4,)\n"
    series.close()
    history.close()
    check(series.path, 5)
    assert read_history(history.path)["step"].tolist() == [2.0, 3.0, 4.0]


# One run a folder

HOLD = """
import sys
from xper_fx.output.folder_lock import FolderLock
from xper_fx.output.gauges import CellGauge, TensileGauge
lock = FolderLock(sys.argv[1])
print("held", flush=True)
input()
"""


@pytest.mark.slow
def test_a_second_run_is_refused(tmp_path):
    with python(HOLD, tmp_path) as first:
        assert first.stdout.readline() == "held\n"
        for refused in (FolderLock, prepare_folder):
            with pytest.raises(BlockingIOError) as caught:
                refused(tmp_path)
            message = str(caught.value)
            assert (
                f"'{tmp_path}' is being written by process {first.pid} on {os.uname()[1]}"
                in message
            )
            assert "give another folder" in message
        first.communicate("\n")
    FolderLock(tmp_path).release()
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_killed_run_locks_nothing(tmp_path):
    with python(HOLD, tmp_path) as first:
        assert first.stdout.readline() == "held\n"
        first.send_signal(signal.SIGKILL)
    assert list(tmp_path.iterdir())
    lock = FolderLock(tmp_path)
    with pytest.raises(BlockingIOError, match="another recorder of this very process"):
        FolderLock(tmp_path)
    lock.release()
    lock.release()
    assert not list(tmp_path.iterdir())


def test_only_one_of_many_gets_in(tmp_path):
    """Also while the file of the lock comes and goes."""
    code = """
    import sys, time
    from pathlib import Path
    from xper_fx.output.folder_lock import FolderLock
    entries, mine = Path(sys.argv[1]) / "inside", 0
    while mine < 200:
        try:
            lock = FolderLock(sys.argv[1])
        except BlockingIOError:
            continue
        entries.touch(exist_ok=False)
        entries.unlink()
        lock.release()
        mine += 1
    """
    runs = [python(code, tmp_path) for _ in range(3)]
    for run in runs:
        run.communicate()
    assert [run.returncode for run in runs] == [0, 0, 0]


# Runs


@pytest.fixture
def simulation():
    bodies = box_bodies((2.0, 1.0), (2, 1), label=0)
    loads = [PrescribedVelocity(LEFT, 0, 0.0), PrescribedVelocity(RIGHT, 0, 1e-3)]
    return Simulation(Scene(bodies, {1: LinearElastic(100.0, 0.3, 1.0)}, loads=loads), 0.1)


def test_a_run_into_a_folder_in_use(tmp_path, simulation):
    with Recorder(simulation, tmp_path, end_time=1.0) as recorder:
        before = (tmp_path / "history.csv").stat().st_ino
        with pytest.raises(BlockingIOError, match="was not closed"):
            Recorder(simulation, tmp_path, end_time=1.0)
        assert (tmp_path / "history.csv").stat().st_ino == before
        recorder.record(next(simulation.steps(0.1)))
    assert len(read_history(tmp_path / "history.csv")["step"]) == 1
    Recorder(simulation, tmp_path, end_time=1.0).close()


def test_a_recorder_without_its_first_fields_closes_its_files(tmp_path, simulation, monkeypatch):
    """No file of the folder is open in this process any more, though the error is at hand."""
    with monkeypatch.context() as patch:
        patch.setattr(Recorder, "_write_fields", lambda self: os.stat(tmp_path / "nothing"))
        with pytest.raises(FileNotFoundError) as caught:
            Recorder(simulation, tmp_path, end_time=1.0)
    held = {os.path.realpath(f"/proc/self/fd/{number}") for number in os.listdir("/proc/self/fd")}
    assert not [path for path in held if path.startswith(str(tmp_path))], caught
    Recorder(simulation, tmp_path, end_time=1.0).close()


def test_a_recorder_that_could_not_be_made_lets_go(tmp_path, simulation):
    (tmp_path / "history.csv").mkdir()
    with pytest.raises(IsADirectoryError) as caught:
        Recorder(simulation, tmp_path, end_time=1.0)
    told(caught, tmp_path / "history.csv", errno.EISDIR)
    (tmp_path / "history.csv").rmdir()
    Recorder(simulation, tmp_path, end_time=1.0).close()


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"end_time": 0.0}, "end_time .* got 0"),
        ({"fields": 2.5}, "fields should be an integer, got 2.5"),
        ({"gauge": "11"}, "gauge .* got '11'"),
        ({"gauge": CellGauge()}, "CellGauge reads a periodic cell"),
        ({"gauge": TensileGauge(LEFT, 88, 0, 1.0, 1.0)}, "`high` is facet tag 88, .* nowhere"),
        ({"gauge": TensileGauge(LEFT, RIGHT, 2, 1.0, 1.0)}, "component 2; it should be 0 to 1"),
        ({"parameters": {"a": {"b": object}}}, "parameters.a.b"),
        ({"restart": "no"}, "restart .* 'no'"),
        ({"folder": ""}, "folder should be a path, got ''"),
    ],
)
def test_a_recorder_is_asked_for_what_it_can_record(tmp_path, simulation, given, words):
    """Before anything is written."""
    with pytest.raises((TypeError, ValueError), match=words):
        Recorder(simulation, **({"folder": tmp_path, "end_time": 1.0} | given))
    assert not list(tmp_path.iterdir())


WRITES = {
    "history": "xper_fx.output.history.write_all",
    "fields": "xper_fx.output.series.reserve",
    "xdmf": "xper_fx.output.series.TimeSeries._append",
}


@pytest.mark.parametrize("goes_on", [True, False])
@pytest.mark.parametrize("kind", WRITES)
def test_a_run_whose_disk_fills_up(tmp_path, simulation, monkeypatch, kind, goes_on):
    """The error ends the run, or the caller makes room and goes on: no step is lost."""
    steps = simulation.steps(0.6)
    failed = []

    def record_all(recorder):
        for step in steps:
            if step.step == 3 and not failed:
                with monkeypatch.context() as patch:
                    patch.setattr(WRITES[kind], no_room)
                    failed.append(kind)
                    recorder.record(step)
            recorder.record(step)

    with pytest.raises(OSError, match="No space left") as caught:
        with Recorder(simulation, tmp_path, end_time=0.6, fields=6) as recorder:
            try:
                record_all(recorder)
            except OSError:
                if goes_on:
                    record_all(recorder)
                raise
    assert caught.value.__suppress_context__
    read = read_history(tmp_path / "history.csv")["step"].tolist()
    summary = json.loads((tmp_path / "summary.json").read_text())
    last = 6 if goes_on else 3
    lost = [] if kind != "history" else [3]
    assert read == [float(n) for n in range(1, last + 1) if n not in lost]
    assert summary["steps"] == len(read) and summary["time"] == pytest.approx(0.1 * last)
    with h5py.File(tmp_path / "bulk.h5") as h5:
        written = len(h5["times/000000"])
    # the start and each step but the third
    assert times_of(tmp_path / "bulk.xdmf") == pytest.approx(
        [0.1 * n for n in range(last + 1) if n != 3]
    )
    assert written >= last
    assert not list(tmp_path.glob(".*"))


def times_of(path) -> list[float]:
    from xml.etree import ElementTree

    return [float(item.get("Value")) for item in ElementTree.parse(path).iter("Time")]


@pytest.mark.parametrize("within", [True, False])
def test_no_room_for_the_summary(tmp_path, simulation, caplog, within):
    """It is the error of a run that went well; of another it is only noted."""
    with pytest.raises(ZeroDivisionError if within else OSError) as caught:
        with Recorder(simulation, tmp_path, end_time=0.2, fields=2) as recorder:
            for step in simulation.steps(0.2):
                recorder.record(step)
            (tmp_path / "summary.json").mkdir()
            if within:
                raise ZeroDivisionError
    if within:
        assert "summary.json' cannot be written" in caplog.text
    else:
        told(caught, tmp_path / "summary.json", errno.EISDIR)
    assert times_of(tmp_path / "bulk.xdmf") == pytest.approx([0.0, 0.1, 0.2])
    assert not list(tmp_path.glob(".*"))
    (tmp_path / "summary.json").rmdir()
    Recorder(simulation, tmp_path, end_time=0.2).close()  # nothing is locked


def test_a_folder_removed_during_a_run(tmp_path, simulation):
    with pytest.raises(FileNotFoundError) as caught:
        with Recorder(simulation, tmp_path / "run", end_time=0.4) as recorder:
            for step in simulation.steps(0.4):
                recorder.record(step)
                shutil.rmtree(tmp_path / "run")
    told(caught, tmp_path / "run" / "history.csv", errno.ENOENT)
    assert "removed or renamed" in str(caught.value)
    # the simulation itself goes on
    assert simulation.time == pytest.approx(0.2)
    assert np.isfinite(next(simulation.steps(0.4)).energies["closure"])


def test_a_state_that_cannot_be_saved_does_not_hide_why(tmp_path, simulation, caplog):
    with Recorder(simulation, tmp_path / "run", end_time=0.4):
        simulation.save_on_failure(partial(save, tmp_path / "gone" / "checkpoint.h5", simulation))
        assert simulation.save_state() is None
    assert "state could not be saved" in caplog.text
