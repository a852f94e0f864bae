# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes that DOLFINx spreads over ranks, against the same meshes whole on one rank."""

import json
import re
import sys
from pathlib import Path

import meshio
import numpy as np
import pytest
from on_ranks import on_ranks
from scenes import COMM

from xper_fx.output.history import read_history
from xper_fx.support.errors import CheckpointError

sys.path.insert(0, str(Path(__file__).parents[1] / "ranks"))
import recorded
import spread_scenes

pytestmark = pytest.mark.ranks

RANKS = 3
# Vertices alone with random numbers and arrays over facets, of order 2, that split at finite
# strain, Gauss points of blocks there, walls, also beside vertices that split, bonds that lag in
# space, ties, and vertices that may split in more ways than one.
SCENES = (
    "uneven", "quadratic", "spun", "blocks", "fall", "turning_dropped", "space", "tied", "burst",
)  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """What the scenes and runs gave on several ranks; one that goes on on fewer, then on more."""
    base = tmp_path_factory.mktemp("spread")
    runs = (*SCENES, "held", "balance", "places", "wrong", "whole=12", "restarted=6")
    runs += ("tied_restarted=9",)
    later = ["places", "restarted=9", "tied_restarted=14"]
    for ranks, asked in ((RANKS, runs), (2, later), (4, ["restarted=12"])):
        done = on_ranks(ranks, "ranks/spread_scenes.py", base, *asked)
        assert done.returncode == 0, done.stdout + done.stderr
    return base


@pytest.mark.parametrize("name", SCENES)
def test_the_mesh_may_be_spread(folder, name):
    several, one = dict(np.load(folder / f"{name}.npz")), spread_scenes.run(name)
    assert set(several) == set(one) and one["damage"].max() > 0.0
    bound = 1e-6 if one["damage"].max() >= 1.0 else 1e-8  # bonds have broken, or not
    assert one["area"].shape == several["area"].shape and len(one["area"]) > 20
    for key in one:
        scale = np.abs(one[key]).max(initial=1e-2)
        assert np.abs(one[key] - several[key]).max(initial=0.0) <= bound * scale, key


def test_nothing_is_whole_on_a_rank(folder):
    """Bytes a body of the rank's own, beside those of a run on one rank."""
    held, one = np.load(folder / "held.npz"), spread_scenes.held(COMM)
    # a rank knows its own bodies and those next to them; it keeps two meshes of its own
    assert held["spread"].max() <= 1.35 * one
    assert held["dust"].max() <= 1.3 * spread_scenes.held_by_dust(COMM)
    # of a mesh that is whole on each rank the same count finds the whole
    assert held["divided"].min() > 1.15 * one


def test_a_rank_is_told_of_tied_surfaces_what_its_own_may_face(folder):
    """Of two ties, between blocks of several ranks, whole meshes and spread ones alike."""
    told, one = np.load(folder / "held.npz")["ties"], spread_scenes.told_of_ties(COMM)
    assert told.max() <= 0.6 * one
    assert told.sum(axis=0).max() <= 1.03 * one


def test_a_body_goes_to_the_rank_that_has_most_of_it(folder):
    """The balance stays: each rank loses one cell of its block's, and gains one."""
    labels, change = np.load(folder / "balance.npz")["cells"].T
    assert labels.tolist() == list(range(RANKS)) and not change.any()


def test_bodies_that_are_unlike_each_other_are_shared_out_by_their_work(folder):
    """Ranks with like numbers of cells would have from 0.6 to 1.7 times the mean."""
    work = np.load(folder / "balance.npz")["work"]
    assert len(work) == RANKS and work.max() < 1.05


def test_each_rank_gets_a_body_where_there_are_as_many(folder):
    """The large block is most of all cells, and of those of each rank."""
    assert np.load(folder / "balance.npz")["few"].tolist() == [1] * RANKS


def test_a_mesh_is_partitioned_in_one_way(folder):
    """Equal runs then have the same bits."""
    assert np.load(folder / "balance.npz")["divisions"].tolist() == [1] * RANKS


def test_facets_have_the_places_of_the_whole_mesh(folder):
    """So random numbers and tables are those of one rank, and scenes with a table the same."""
    found = [np.load(folder / f"places_{ranks}.npz") for ranks in (RANKS, 2)]
    assert max(one["distance"].max() for one in found) < 1e-12
    assert found[0]["described"] == found[1]["described"]
    assert "'type': 'Values', 'values': " in str(found[0]["described"])


def test_what_does_not_fit_is_refused_on_all_ranks(folder):
    told = np.load(folder / "wrong.npz")["told"]
    assert told.shape[0] == RANKS and np.all(told == told[0])
    for said, expected in zip(
        told[0].tolist(),
        (
            "ValueError: Rank 1 .* than rank 0: materials.1.young: 1000.0, here 1001.0",
            "ValueError: Rank 1 .* than rank 0: options.requested.step: 0.0001, here 0.0002",
            r"ValueError: The meshes of the ranks are spread over \[3\] ranks, and comm has 1",
            r"ValueError: strength has 9 values; .* spread over ranks it should have one for each",
            "ValueError: initial_velocity is not finite at",
            "ValueError: .*strength",
            r"ValueError: bodies\[0\] is -1",
            r"ValueError: .* of \d+ nodes on the cell's boundary have no translate",
            "CheckpointError: .* of another scene: its mesh was whole on each rank, .* is not",
            "CheckpointError: .* of another scene: its mesh was not whole on each rank, .* is",
            "ValueError: .*InitialStress",
            "ValueError: The `where` of .* holds at no node of its facets",
            r"ValueError: ignored_facets names \[9\], which occur nowhere",
        ),
        strict=True,
    ):
        assert re.match(expected, said), said


def fields(folder, name):
    """Points, and all fields of the last time, of the files of all ranks."""
    columns = []
    for path in sorted(folder.glob(f"{name}*.xdmf")):
        with meshio.xdmf.TimeSeriesReader(path) as reader:
            points, _ = reader.read_points_cells()
            _, nodal, _ = reader.read_data(reader.num_steps - 1)
        columns.append(np.column_stack([points, *(nodal[key] for key in sorted(nodal))]))
    rows = np.concatenate(columns)
    return rows[np.lexsort(np.round(rows, 7).T[::-1])]


def test_each_rank_writes_its_fields(folder, tmp_path):
    recorded.run(str(tmp_path), 12, restart=False)
    assert len(list((folder / "whole").glob("bulk*.xdmf"))) == RANKS
    for name in ("bulk", "interfaces"):
        one, several = fields(tmp_path, name), fields(folder / "whole", name)
        assert one.shape == several.shape
        np.testing.assert_allclose(several, one, rtol=0.0, atol=2e-7 * np.abs(one).max())
    one, several = (
        json.loads((f / "summary.json").read_text())["counts"] for f in (tmp_path, folder / "whole")
    )
    assert several == one | {"ranks": RANKS}


def test_a_restart_goes_on_as_if_nothing_had_been(folder):
    """On other ranks, and with a mesh that DOLFINx partitions otherwise."""
    whole, again = folder / "whole", folder / "restarted"
    assert len(list(again.glob("bulk*.xdmf"))) == RANKS
    x, y = read_history(whole / "history.csv"), read_history(again / "history.csv")
    work = np.abs(x["external_work"]).max()
    for key in x.keys() - {"sweeps", "residual"}:
        scale = np.abs(x[key]).max() if key in ("step", "time", "strain", "stress") else work
        np.testing.assert_allclose(y[key], x[key], rtol=0.0, atol=1e-6 * scale, err_msg=key)
    for name in ("bulk", "interfaces"):
        one, other = fields(whole, name), fields(again, name)
        assert one.shape == other.shape
        np.testing.assert_allclose(other, one, rtol=0.0, atol=2e-7 * np.abs(one).max())
    with pytest.raises(CheckpointError, match="of another scene: .*mesh"):
        recorded.run(str(again), 12, restart=True)


def test_ties_go_on_on_other_ranks(folder, tmp_path):
    """Their points are numbered alike on all, and bear their histories."""
    recorded.run(str(tmp_path / "tied"), 14, restart=False)
    one = read_history(tmp_path / "tied" / "history.csv")
    again = read_history(folder / "tied_restarted" / "history.csv")
    assert len(again["step"]) == len(one["step"]) and one["dissipated_cohesion"][-1] > 0.0
    for key in ("external_work", "kinetic", "elastic", "cohesive", "dissipated_cohesion"):
        assert np.abs(again[key] - one[key]).max() <= 1e-7 * one["external_work"].max(), key
