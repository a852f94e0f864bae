# SPDX-License-Identifier: LGPL-3.0-or-later
"""What several ranks write, and go on from."""

import json
import shutil
import sys
from pathlib import Path

import meshio
import numpy as np
import pytest
from on_ranks import on_new_ranks, on_ranks

from xper_fx.output.history import read_history

sys.path.insert(0, str(Path(__file__).parents[1] / "ranks"))
import recorded

pytestmark = pytest.mark.ranks


def run(count, last, *options):
    """Runs to the last step of each folder, one after the other."""
    runs = [f"{folder}={step}" for folder, step in last.items()]
    done = on_ranks(count, "ranks/recorded.py", *runs, *options)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Whole runs on one rank and on two; one stopped on two that goes on, on two and on three."""
    base = tmp_path_factory.mktemp("recorded")
    recorded.run(str(base / "one"), 12, restart=False)
    run(2, {base / "two": 12, base / "stopped": 7, base / "explicit": 12, base / "explicit_7": 7})
    shutil.copytree(base / "stopped", base / "again")
    shutil.copytree(base / "stopped", base / "elsewhere")
    run(2, {base / "again": 12, base / "explicit_7": 12}, "restart")
    run(3, {base / "elsewhere": 12}, "restart")
    return base


def series(path):
    """Times and fields of a series."""
    with meshio.xdmf.TimeSeriesReader(path) as reader:
        points, cells = reader.read_points_cells()
        return points, cells[0].data, [reader.read_data(k) for k in range(reader.num_steps)]


def difference(a, b):
    """Largest difference of two histories relative to each column's largest value."""
    x, y = read_history(a / "history.csv"), read_history(b / "history.csv")
    assert list(x) == list(y)
    np.testing.assert_array_equal(x["step"], y["step"])
    return max(
        np.abs(x[k] - y[k]).max() / np.abs(x[k]).max()
        for k in ("strain", "stress", "external_work", "kinetic", "elastic", "cohesive")
    )


def test_the_history_is_that_of_one_rank(folders):
    assert difference(folders / "one", folders / "two") <= 1e-8


@pytest.mark.parametrize("name", ["bulk", "interfaces"])
def test_the_fields_are_those_of_one_rank(folders, name):
    one, two = (series(folders / ranks / f"{name}.xdmf") for ranks in ("one", "two"))
    np.testing.assert_array_equal(one[0], two[0])
    np.testing.assert_array_equal(one[1], two[1])
    assert len(one[2]) == len(two[2]) == 6
    for (t, nodal, cellwise), (s, nodal2, cellwise2) in zip(one[2], two[2], strict=True):
        assert t == pytest.approx(s, rel=1e-12)
        for a, b in ((nodal, nodal2), (cellwise, cellwise2)):
            assert set(a) == set(b)
            for key in a:
                x, y = (np.asarray(v, float) for v in (a[key], b[key]))
                assert np.abs(x - y).max() <= 1e-7 * max(np.abs(x).max(), 1e-6), key


def test_summaries_count_the_whole(folders):
    one, two = (json.loads((folders / f / "summary.json").read_text()) for f in ("one", "two"))
    assert (one["counts"].pop("ranks"), two["counts"].pop("ranks")) == (1, 2)
    assert one["counts"] == two["counts"]
    assert one["steps"] == two["steps"] == 12


def test_as_many_ranks_go_on_to_the_bit(folders):
    histories = [(folders / f / "history.csv").read_bytes() for f in ("again", "two")]
    assert histories[0] == histories[1]
    whole, again = (series(folders / f / "bulk.xdmf")[2] for f in ("two", "again"))
    assert [t for t, *_ in whole] == [t for t, *_ in again]
    np.testing.assert_array_equal(whole[-1][1]["displacement"], again[-1][1]["displacement"])


def test_vertices_go_on_to_the_bit_with_what_was_kept_of_them(folders):
    histories = [(folders / f / "history.csv").read_bytes() for f in ("explicit_7", "explicit")]
    assert histories[0] == histories[1]


def test_another_number_of_ranks_goes_on_to_the_tolerance(folders):
    assert difference(folders / "two", folders / "elsewhere") <= 1e-8


def test_rigid_bodies_go_on_on_the_ranks_that_had_them(tmp_path):
    """Bodies have met when a signal comes; their contacts are divided as they were, not anew."""
    whole, stopped = tmp_path / "whole", tmp_path / "signalled"
    done = on_new_ranks(2, "ranks/recorded.py", f"{whole}=60", f"{stopped}=60", "rigid")
    assert done.returncode == 143  # as of SIGTERM, though one rank alone got it
    assert done.stderr.count("ended by SIGTERM") == 1, done.stderr
    assert len(read_history(stopped / "history.csv")["step"]) in (45, 46)
    stopped = stopped.rename(tmp_path / "restarted")
    run(2, {stopped: 60}, "rigid", "restart")
    assert read_history(whole / "history.csv")["dissipated_impact"][44] > 0.0
    assert (whole / "history.csv").read_bytes() == (stopped / "history.csv").read_bytes()


def test_a_cell_that_stress_drives_goes_on_on_any_number_of_ranks(tmp_path):
    """The rate of its gradient is common to all; contacts go on with their impulses."""
    whole, stopped = tmp_path / "whole", tmp_path / "stopped"
    run(2, {whole: 60, stopped: 50}, "cell")
    for count in (1, 2, 3):
        again = shutil.copytree(stopped, tmp_path / f"on_{count}")
        run(count, {again: 60}, "cell", "restart")
        histories = [read_history(folder / "history.csv") for folder in (whole, again)]
        for name in ("kinetic", "external_work", "dissipated_impact", "P22", "F11"):
            expected, found = (history[name] for history in histories)
            assert np.abs(expected[50:] - expected[49]).max() > 0.0, name
            limit = 0.0 if count == 2 else 1e-8 * np.abs(expected).max()
            np.testing.assert_allclose(found, expected, rtol=0, atol=limit, err_msg=name)
