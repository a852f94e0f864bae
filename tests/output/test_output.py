# SPDX-License-Identifier: LGPL-3.0-or-later
"""Output is read back, bit for bit, while the run goes on, after it was killed, and elsewhere."""

import errno
import json
import math
import os
import signal
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import h5py
import numpy as np
import pytest

from xper_fx.output.history import HISTORY_COLUMNS, History, read_history
from xper_fx.output.output_folder import prepare_folder
from xper_fx.output.series import TimeSeries
from xper_fx.output.summary import write_summary

POINTS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]) / 3
TRIANGLES = np.array([[0, 1, 2], [1, 3, 2]], dtype=np.int32)


def fields(step):
    """Point and cell data that differ in every entry and every step."""
    rng = np.random.default_rng(step)
    point_data = {"displacement": rng.random((4, 2)), "temperature": rng.random(4)}
    cell_data = {"stress": rng.random((2, 2, 2)), "material": np.array([step, 7])}
    return point_data, cell_data


def check(path, num_steps):
    """Read a series by meshio and compare it with ``fields`` to the last bit."""
    meshio = pytest.importorskip("meshio")
    with meshio.xdmf.TimeSeriesReader(path) as reader:
        points, cells = reader.read_points_cells()
        np.testing.assert_array_equal(points, np.pad(POINTS, ((0, 0), (0, 1))))
        assert cells[0].type == "triangle"
        np.testing.assert_array_equal(cells[0].data, TRIANGLES)
        assert reader.num_steps == num_steps
        for step in range(num_steps):
            time, point_data, cell_data = reader.read_data(step)
            expected_point, expected_cell = fields(step)
            assert time == step / 3
            assert set(point_data) == set(expected_point)
            assert set(cell_data) == set(expected_cell)
            np.testing.assert_array_equal(
                point_data["displacement"],
                np.pad(expected_point["displacement"], ((0, 0), (0, 1))),
            )
            np.testing.assert_array_equal(point_data["temperature"], expected_point["temperature"])
            stress = np.zeros((2, 3, 3))
            stress[:, :2, :2] = expected_cell["stress"]
            np.testing.assert_array_equal(cell_data["stress"][0], stress.reshape(2, 9))
            np.testing.assert_array_equal(cell_data["material"][0], expected_cell["material"])
            assert cell_data["stress"][0].dtype == np.float64


def test_series_reads_back_after_each_write(tmp_path, monkeypatch):
    """The relative path is resolved once: a changed current folder does not redirect output."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out").mkdir()
    (tmp_path / "elsewhere").mkdir()
    with TimeSeries("out/bulk.xdmf", POINTS, ("triangle", TRIANGLES)) as series:
        for step in range(5):
            series.write(step / 3, *fields(step))
            monkeypatch.chdir(tmp_path / "elsewhere")
            check(tmp_path / "out" / "bulk.xdmf", step + 1)
    check(tmp_path / "out" / "bulk.xdmf", 5)
    check(Path("../out/bulk.xdmf"), 5)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["bulk.h5", "bulk.xdmf"]
    assert not list((tmp_path / "elsewhere").iterdir())


def test_series_moves_as_a_pair(tmp_path):
    with TimeSeries(tmp_path / "bulk.xdmf", POINTS, ("triangle", TRIANGLES)) as series:
        for step in range(3):
            series.write(step / 3, *fields(step))
    moved = tmp_path / "moved" / "here"
    moved.mkdir(parents=True)
    for suffix in (".xdmf", ".h5"):
        (tmp_path / f"bulk{suffix}").rename(moved / f"bulk{suffix}")
    check(moved / "bulk.xdmf", 3)
    assert str(tmp_path) not in (moved / "bulk.xdmf").read_text()


def test_series_is_one_temporal_collection(tmp_path):
    """What ParaView needs: Xdmf 3, one collection, each grid with mesh, time and attributes."""
    with TimeSeries(tmp_path / "bulk.xdmf", POINTS, ("triangle", TRIANGLES)) as series:
        for step in range(3):
            series.write(step / 3, *fields(step))
    root = ElementTree.parse(tmp_path / "bulk.xdmf").getroot()
    assert root.get("Version") == "3.0"
    (collection,) = root.find("Domain")
    assert collection.get("CollectionType") == "Temporal"
    for grid in collection:
        assert grid.find("Topology").get("TopologyType") == "Triangle"
        assert grid.find("Geometry").get("GeometryType") == "XYZ"
        assert {(a.get("Name"), a.get("AttributeType"), a.get("Center")) for a in grid[3:]} == {
            ("displacement", "Vector", "Node"),
            ("temperature", "Scalar", "Node"),
            ("stress", "Tensor", "Cell"),
            ("material", "Scalar", "Cell"),
        }
        with h5py.File(tmp_path / "bulk.h5") as h5:
            for item in grid.iter("DataItem"):
                dataset = h5[item.text.removeprefix("bulk.h5:")]
                assert " ".join(map(str, dataset.shape)) == item.get("Dimensions")


@pytest.mark.parametrize(
    ("cell_type", "meshio_type", "cells"),
    [
        ("vertex", "vertex", [[0], [3]]),
        ("line", "line", [[0, 1], [1, 3]]),
        ("interval", "line", [[0, 1], [1, 3]]),
        ("quadrilateral", "quad", [[0, 1, 3, 2]]),
        ("tetrahedron", "tetra", [[0, 1, 2, 3]]),
    ],
)
def test_series_cell_types(tmp_path, cell_type, meshio_type, cells):
    meshio = pytest.importorskip("meshio")
    points = np.random.default_rng(0).random((4, 3))
    jump = np.random.default_rng(1).random((len(cells), 3))
    with TimeSeries(tmp_path / "a.xdmf", points, (cell_type, cells)) as series:
        series.write(0.0, cell_data={"jump": jump})
    with meshio.xdmf.TimeSeriesReader(tmp_path / "a.xdmf") as reader:
        read_points, (block,) = reader.read_points_cells()
        np.testing.assert_array_equal(read_points, points)
        assert block.type == meshio_type
        np.testing.assert_array_equal(block.data, cells)
        np.testing.assert_array_equal(reader.read_data(0)[2]["jump"][0], jump)


@pytest.mark.parametrize("death", ["os._exit(3)", "os.kill(os.getpid(), signal.SIGKILL)"])
def test_series_of_a_killed_run(tmp_path, death):
    here = Path(__file__)
    paths = [str(here.parent), str(here.parents[1] / "shared"), str(here.parents[2])]
    program = f"""
import os, signal, sys
sys.path[:0] = {paths!r}
from test_output import *
series = TimeSeries({str(tmp_path / "bulk.xdmf")!r}, POINTS, ("triangle", TRIANGLES))
history = History({str(tmp_path / "history.csv")!r}, ["step", "time"])
for step in range(4):
    series.write(step / 3, *fields(step))
    history.append(step=step, time=step / 3)
{death}
"""
    code = subprocess.run([sys.executable, "-c", program], check=False).returncode
    assert code in (3, -signal.SIGKILL)
    check(tmp_path / "bulk.xdmf", 4)
    np.testing.assert_array_equal(read_history(tmp_path / "history.csv")["time"], np.arange(4) / 3)


@pytest.mark.slow
def test_series_is_whole_at_every_instant(tmp_path, monkeypatch):
    """Between any two writes to the XDMF file it is well-formed and names no missing data."""
    series = TimeSeries(tmp_path / "a.xdmf", POINTS, ("triangle", TRIANGLES))
    seen = []

    class Watched:
        """A file that is looked at after each of its writes, and after half of a long one."""

        def __init__(self, file):
            self.file = file

        def __enter__(self):
            return self

        def __exit__(self, *_):
            self.file.close()

        def __getattr__(self, name):
            return getattr(self.file, name)

        def write(self, data):
            pieces = [data[:50], data[50:]] if len(data) > 100 else [data]
            if len(pieces) == 1:
                # The switch to the new end of the document: one page, hence all or nothing.
                assert self.file.tell() // 64 == (self.file.tell() + len(data) - 1) // 64
            for piece in pieces:
                self.file.write(piece)
                check(tmp_path / "a.xdmf", len(seen) + (len(pieces) == 1))
            return len(data)

    def watched_open(path, mode, **options):
        file = open(path, mode, **options)  # noqa: SIM115
        return Watched(file) if mode == "r+b" else file

    monkeypatch.setattr("xper_fx.output.series.open", watched_open, raising=False)
    # A small page has many borders to fall on.
    monkeypatch.setattr("xper_fx.output.series._PAGE", 64)
    for step in range(20):
        series.write(step / 3, *fields(step))
        seen.append(step)
    monkeypatch.undo()
    series.close()
    check(tmp_path / "a.xdmf", 20)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/io").exists(), reason="counts written bytes on Linux")
def test_series_cost_does_not_grow(tmp_path):
    """Bytes handed to the system per write, XML and HDF5, over 800 writes."""

    def written():
        lines = Path("/proc/self/io").read_text().splitlines()
        return int(dict(line.split(": ") for line in lines)["wchar"])

    series = TimeSeries(tmp_path / "a.xdmf", POINTS, ("triangle", TRIANGLES))
    data = fields(0)
    costs = []
    for step in range(800):
        before = written()
        series.write(step, *data)
        costs.append(written() - before)
    series.close()
    costs = np.array(costs)
    # Median: the usual write. Mean: with the rare ones that make new room.
    assert np.median(costs[-200:]) < 1.2 * np.median(costs[:200])
    assert costs[400:].mean() < 1.5 * costs[:400].mean()
    assert (tmp_path / "a.xdmf").stat().st_size < 800 * 3000
    meshio = pytest.importorskip("meshio")
    with meshio.xdmf.TimeSeriesReader(tmp_path / "a.xdmf") as reader:
        reader.read_points_cells()
        assert reader.num_steps == 800
        assert [reader.read_data(step)[0] for step in (0, 101, 799)] == [0.0, 101.0, 799.0]


def test_series_replaces_an_older_one(tmp_path):
    """A stale XDMF file does not survive beside a new HDF5 file."""
    for num_steps in (5, 2):
        with TimeSeries(tmp_path / "a.xdmf", POINTS, ("triangle", TRIANGLES)) as series:
            assert not (tmp_path / "a.xdmf").exists()
            for step in range(num_steps):
                series.write(step / 3, *fields(step))
    check(tmp_path / "a.xdmf", 2)


def test_series_goes_on_while_it_is_looked_at(tmp_path):
    with TimeSeries(tmp_path / "a.xdmf", POINTS, ("triangle", TRIANGLES)) as series:
        series.write(0.0, *fields(0))
        viewer = subprocess.Popen(
            [
                sys.executable,
                "-c",
                f"import h5py; file = h5py.File({str(tmp_path / 'a.h5')!r});"
                "print('open', flush=True); input()",
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        assert viewer.stdout.readline() == b"open\n"
        series.write(1 / 3, *fields(1))
        viewer.communicate(b"\n")
    check(tmp_path / "a.xdmf", 2)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (lambda p, c: p.pop("temperature"), "temperature"),
        (lambda p, c: p.update(extra=np.zeros(4)), "extra"),
        (lambda p, c: p.update(temperature=np.zeros((4, 2))), "temperature"),
        (lambda p, c: c.update(stress=np.zeros((2, 3, 3))), "stress"),
        (lambda p, c: c.update(material=np.zeros(3)), "material"),
        (lambda p, c: c.update(displacement=p.pop("displacement")[:2]), "displacement"),
    ],
)
def test_series_refuses_other_fields(tmp_path, change, name):
    with TimeSeries(tmp_path / "a.xdmf", POINTS, ("triangle", TRIANGLES)) as series:
        series.write(0.0, *fields(0))
        point_data, cell_data = fields(1)
        change(point_data, cell_data)
        with pytest.raises(ValueError, match=f"'{name}'"):
            series.write(1 / 3, point_data, cell_data)
        series.write(1 / 3, *fields(1))
    check(tmp_path / "a.xdmf", 2)


def test_series_refuses_bad_input(tmp_path):
    path, cells = tmp_path / "a.xdmf", ("triangle", TRIANGLES)
    with pytest.raises(ValueError, match=r"\.xdmf"):
        TimeSeries(tmp_path / "a.vtu", POINTS, cells)
    with pytest.raises(ValueError, match="':'"):
        TimeSeries(tmp_path / "a:b.xdmf", POINTS, cells)
    with pytest.raises(ValueError, match=r"got \(4,\)"):
        TimeSeries(path, np.zeros(4), cells)
    with pytest.raises(ValueError, match="finite"):
        TimeSeries(path, np.where(POINTS > 0, np.nan, POINTS), cells)
    with pytest.raises(ValueError, match="wedge"):
        TimeSeries(path, POINTS, ("wedge", TRIANGLES))
    with pytest.raises(ValueError, match=r"\(num_cells, 4\)"):
        TimeSeries(path, POINTS, ("tetra", TRIANGLES))
    with pytest.raises(ValueError, match="integers"):
        TimeSeries(path, POINTS, ("triangle", TRIANGLES.astype(float)))
    with pytest.raises(ValueError, match="points 0 to 3, got 1 to 4"):
        TimeSeries(path, POINTS, ("triangle", TRIANGLES + 1))
    assert not list(tmp_path.iterdir())

    series = TimeSeries(path, POINTS, cells)
    for time in (math.nan, math.inf):
        with pytest.raises(ValueError, match="finite and grow"):
            series.write(time, {"u": np.zeros(4)})
    for name in ("", "a/b", "a:b"):
        with pytest.raises(ValueError, match="name without"):
            series.write(0.0, {name: np.zeros(4)})
    with pytest.raises(ValueError, match=r"'u' should have shape .* got \(4, 4\)"):
        series.write(0.0, {"u": np.zeros((4, 4))})
    series.write(0.0, {"u": np.zeros(4)})
    with pytest.raises(ValueError, match="finite and grow"):
        series.write(0.0, {"u": np.zeros(4)})
    series.close()
    series.close()
    with pytest.raises(ValueError, match="closed"):
        series.write(1.0, {"u": np.zeros(4)})


def test_series_names_are_escaped(tmp_path):
    meshio = pytest.importorskip("meshio")
    name = 'a<b> & "c" ?> \u00b5'
    with TimeSeries(tmp_path / "a.xdmf", POINTS, ("triangle", TRIANGLES)) as series:
        for step in range(3):
            series.write(step, {name: np.arange(4.0) + step})
    with meshio.xdmf.TimeSeriesReader(tmp_path / "a.xdmf") as reader:
        reader.read_points_cells()
        np.testing.assert_array_equal(reader.read_data(2)[1][name], np.arange(4.0) + 2)


def test_history_reads_back_bitwise(tmp_path):
    rng = np.random.default_rng(0)
    table = rng.random((50, len(HISTORY_COLUMNS))) * 10.0 ** rng.integers(
        -300, 300, (50, len(HISTORY_COLUMNS))
    )
    table[:, 0] = np.arange(50)
    table[3, 5:8] = [5e-324, -0.0, 0.1 + 0.2]
    with History(tmp_path / "history.csv") as history:
        for step, row in enumerate(table):
            values = dict(zip(HISTORY_COLUMNS, row, strict=True))
            # Whatever the order and the type of the numbers.
            values["step"] = np.int64(step)
            values["time"] = float(values["time"])
            history.append(**dict(reversed(values.items())))
            assert len(read_history(tmp_path / "history.csv")["step"]) == step + 1
    columns = read_history(tmp_path / "history.csv")
    assert tuple(columns) == HISTORY_COLUMNS
    read = np.stack(list(columns.values()), axis=1)
    np.testing.assert_array_equal(read.view(np.int64), table.view(np.int64))
    lines = (tmp_path / "history.csv").read_text().splitlines()
    assert lines[0].startswith("step,time,strain,stress,sweeps,residual,external_work,")
    assert lines[4].startswith("3,")
    assert len(lines) == 51


def test_history_refuses_wrong_lines(tmp_path):
    path = tmp_path / "history.csv"
    with History(path, ["step", "time"]) as history:
        with pytest.raises(ValueError, match=r"missing \['time'\]"):
            history.append(step=0)
        with pytest.raises(ValueError, match=r"unknown \['strain'\]"):
            history.append(step=0, time=0.0, strain=0.0)
        for nan in (math.nan, np.float64("nan")):
            with pytest.raises(ValueError, match="'time'"):
                history.append(step=0, time=nan)
        assert path.read_text() == "step,time\n"
        history.append(step=0, time=0.5)
    with pytest.raises(ValueError, match="different"):
        History(path, ["a", "a"])
    with pytest.raises(ValueError, match="identifiers"):
        History(path, ["a,b"])
    assert path.read_text() == "step,time\n0,0.5\n"


def test_history_with_a_torn_line(tmp_path, caplog):
    path = tmp_path / "history.csv"
    path.write_text("step,time\n0,0.125\n1,0.2")
    columns = read_history(path)
    assert columns["time"].tolist() == [0.125]
    assert "incomplete" in caplog.text
    path.write_text("step,time\n0,0.125\n1\n")
    with pytest.raises(ValueError, match="line 3"):
        read_history(path)
    path.write_text("")
    with pytest.raises(ValueError, match="empty"):
        read_history(path)
    path.write_text("step,time\n")
    assert read_history(path)["time"].shape == (0,)


def test_summary_converts_numpy(tmp_path):
    path = tmp_path / "summary.json"
    write_summary(path, {"old": True})
    write_summary(
        path,
        {
            "points": np.int64(19040),
            "effects": {"friction": np.bool_(True), "none": None},
            "peak": np.float64(0.1),
            "float32": np.float32(0.5),
            "lengths": np.arange(4.0).reshape(2, 2),
            "phases": [("assembly", np.float64(1.5))],
            "folder": Path("out") / "weak",
        },
    )
    assert json.loads(path.read_text()) == {
        "points": 19040,
        "effects": {"friction": True, "none": None},
        "peak": 0.1,
        "float32": 0.5,
        "lengths": [[0.0, 1.0], [2.0, 3.0]],
        "phases": [["assembly", 1.5]],
        "folder": os.path.join("out", "weak"),
    }
    keys = list(json.loads(path.read_text()))
    assert keys == sorted(keys)
    assert [p.name for p in tmp_path.iterdir()] == ["summary.json"]


def test_summary_refuses_what_json_cannot_say(tmp_path):
    path = tmp_path / "summary.json"
    write_summary(path, {"good": 1})
    with pytest.raises(ValueError, match=r"'errors\.closure\[1\]' is nan"):
        write_summary(path, {"errors": {"closure": np.array([0.0, np.nan])}})
    with pytest.raises(ValueError, match="'peak' is inf"):
        write_summary(path, {"peak": math.inf})
    with pytest.raises(TypeError, match="'law'"):
        write_summary(path, {"law": object()})
    assert json.loads(path.read_text()) == {"good": 1}


def test_summary_is_written_at_once(tmp_path, monkeypatch):
    """A failure while writing leaves the old file and nothing else."""
    path = tmp_path / "summary.json"
    write_summary(path, {"good": 1})

    def fail(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.replace", fail)
    with pytest.raises(OSError, match="No space"):
        write_summary(path, {"good": 2})
    assert json.loads(path.read_text()) == {"good": 1}
    assert [p.name for p in tmp_path.iterdir()] == ["summary.json"]


def test_prepare_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for _ in range(2):
        folder = prepare_folder("a/b")
        assert folder == tmp_path.resolve() / "a" / "b"
        assert not list(folder.iterdir())


def test_prepare_folder_where_a_file_is(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FileExistsError, match=r"'.*file' cannot be written .*expected a folder"):
        prepare_folder(tmp_path / "file")
    with pytest.raises(NotADirectoryError, match="give another one"):
        prepare_folder(tmp_path / "file" / "below")


@pytest.mark.skipif(os.geteuid() == 0, reason="root writes whatever the access rights say")
def test_prepare_folder_without_permission(tmp_path):
    (tmp_path / "closed").mkdir(mode=0o500)
    with pytest.raises(PermissionError, match="cannot be written"):
        prepare_folder(tmp_path / "closed")
    with pytest.raises(PermissionError, match="cannot be written"):
        prepare_folder(tmp_path / "closed" / "below")


def test_prepare_folder_on_a_kernel_file_system():
    """Not even root may create files there."""
    if not Path("/proc/self").is_dir():
        pytest.skip("no /proc here")
    with pytest.raises(OSError, match="'/proc/.*' cannot be written"):
        prepare_folder("/proc/xper_fx_output")
    with pytest.raises(OSError, match="'/proc/.*' cannot be written"):
        prepare_folder("/proc/self")


@pytest.mark.parametrize(
    ("number", "kind"), [(errno.ENOSPC, OSError), (errno.EACCES, PermissionError)]
)
def test_prepare_folder_finds_out_by_writing(tmp_path, monkeypatch, number, kind):
    """A full disk says so at the latest when data are to be stored."""

    def fail(_):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("os.fsync", fail)
    with pytest.raises(kind, match=os.strerror(number)) as caught:
        prepare_folder(tmp_path / "out")
    assert caught.value.errno == number
    assert not list((tmp_path / "out").iterdir())
