# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshed bodies that ranks divide anew as the load moves."""

import re
import sys
from pathlib import Path
from types import SimpleNamespace

import meshio
import numpy as np
import pytest
from on_ranks import on_ranks, runs_of

from xper_fx.output.history import read_history
from xper_fx.parallel import rebalancing
from xper_fx.parallel.rebalancing import Rebalancing

sys.path.insert(0, str(Path(__file__).parents[1] / "ranks"))
import rebalanced

SCENES = {
    2: ("explicit_shards", "pelted", "split_pelted", "pile", "again"),
    3: ("hinged", "there_and_back", "asked"),
}
RUNS = SCENES[2][:3]


class FirstOfTwo:
    """The first of two ranks, of which the second has no contacts."""

    rank, size = 0, 2

    def __init__(self):
        def allgather(own):
            return [own, tuple(array[:0] for array in own)]

        self.comm = SimpleNamespace(allgather=allgather)
        self.from_first = lambda call: call()


def row_of_bodies(**settings):
    """Six meshed bodies of ten cells in a row, three on a rank; two rigid ones, one is held."""
    ranks = np.array([0, 0, 0, 1, 1, 1, 0, 1])
    moves = np.array([True, False])
    return Rebalancing(FirstOfTwo(), ranks, np.full(6, 10), moves, np.arange(2))


NEIGHBOURS = np.array([[i, i + 1] for i in range(5)])
LEFT = np.array([[0, 1], [1, 2], [0, 6], [2, 7]])


def look(balance, contacts=LEFT):
    """At bodies that hang together in a row and touch at the left end."""
    balance.look(NEIGHBOURS, contacts, np.array([[0, 1]]))


def test_the_cost_is_that_of_the_rank_that_has_most(monkeypatch):
    """30 cells a rank; points, 2 x 2 on either and 2 between both; 4 contacts; exchanges."""
    monkeypatch.setattr(rebalancing, "_STEP", 100)
    monkeypatch.setattr(rebalancing, "_EXCHANGES", 7)
    balance = row_of_bodies()
    assert balance.cost == 1.0
    look(balance)
    assert balance.cost == pytest.approx((100 + 30 + 4 + 4 * 30 + 2 + 7) / (100 + 30 + 5 + 2 * 30))


def test_bodies_are_divided_once_as_much_is_lost_as_that_takes(monkeypatch):
    monkeypatch.setattr(rebalancing, "_STEP", 0)
    monkeypatch.setattr(rebalancing, "_EXCHANGES", 0)
    balance = row_of_bodies()
    look(balance, LEFT[:0])  # what can be reached is seen while nothing touches
    even = balance.cost
    looks = 0
    while not balance.is_pending:
        look(balance)
        looks += 1
    lost = rebalancing._LOOKS_EVERY * (balance.cost - even)
    assert looks == np.ceil(rebalancing._PRICE / lost)
    saved = balance.saved()
    other = balance.other(saved)
    assert other.tolist() == saved["rank_of_body"].tolist()
    assert set(other[:6]) == {0, 1} and other[7] == 1  # what is held is on every rank
    assert len(set(other[[0, 1, 2]])) == 2  # contacts are shared
    then = Rebalancing(FirstOfTwo(), other, np.full(6, 10), np.array([True, False]), np.arange(2))
    then.restore(saved)
    assert then.other(saved) is None and not then.is_pending
    look(then)
    assert then.cost < balance.cost - rebalancing._WORTH
    for _ in range(looks):
        look(then)
    assert not then.is_pending


def test_what_was_lost_before_a_checkpoint_counts(monkeypatch):
    monkeypatch.setattr(rebalancing, "_STEP", 0)
    monkeypatch.setattr(rebalancing, "_EXCHANGES", 0)
    first, second = row_of_bodies(), row_of_bodies()
    look(first, LEFT[:0])
    while not first.is_pending:
        second = row_of_bodies()
        second.restore(first.saved())
        look(first)
    look(second)
    assert second.is_pending


def test_bodies_stay_where_too_little_is_gained(monkeypatch):
    """What is tried is then not tried again."""
    monkeypatch.setattr(rebalancing, "_STEP", 0)
    monkeypatch.setattr(rebalancing, "_EXCHANGES", 0)
    monkeypatch.setattr(rebalancing, "_WORTH", 10.0)
    balance, tried = row_of_bodies(), []
    partition = rebalancing.partition_bodies

    def counted(*arguments):
        tried.append(arguments)
        return partition(*arguments)

    monkeypatch.setattr(rebalancing, "partition_bodies", counted)
    look(balance, LEFT[:0])
    for _ in range(1000):
        look(balance)
    assert len(tried) == 1 and not balance.is_pending


def test_other_numbers_of_ranks_begin_anew():
    balance = row_of_bodies()
    saved = balance.saved() | {"ranks": 3, "lost": 7.0}
    balance.restore(saved)
    assert balance.other(saved) is None and balance.saved()["lost"] == 0.0


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """What a scene gives on a number of ranks."""
    return runs_of("ranks/rebalanced.py", SCENES, rebalanced.run, tmp_path_factory)


@pytest.mark.ranks
@pytest.mark.parametrize("name", RUNS)
def test_runs_are_those_of_one_rank(found, name):
    """Bonds that break, solids in space, and vertices that split: state, history and ledger."""
    one, many = found(name, 1), found(name, 2)
    assert many["partitions"] >= 2
    assert one["pushed"].max() >= 10
    for key in ("contact_bodies", "pushed", "fragment", "retired"):
        np.testing.assert_array_equal(many[key], one[key])
    energies = max(np.abs(one[key]).max() for key in ("kinetic", "external_work"))
    for key in ("kinetic", "elastic", "dissipated_friction", "dissipated_impact"):
        assert np.abs(one[key] - many[key]).max() <= 1e-8 * energies, key
    assert np.abs(many["closure"]).max() <= 1e-12 * energies
    size = np.sqrt(2.0 * one["kinetic"][0])
    assert np.abs(many["momentum"] - many["start"]).max() <= 1e-12 * size
    solids = ("solids",) if "pelted" in name else ()
    for key in ("force", "displacement", "velocity", "damage", "jump", "pieces", *solids):
        scale = np.abs(one[key]).max(initial=0.0)
        assert np.abs(one[key] - many[key]).max(initial=0.0) <= 1e-8 * scale, key


@pytest.mark.ranks
def test_ranks_share_the_contacts_of_a_pile(found):
    """Those of the lower half of the blocks, which one of two ranks has at the start."""
    pile = found("pile", 2)
    first = np.argmax(pile["divided"] > 0)
    assert first > 10 and pile["divided"][-1] == 1
    assert np.all(pile["uneven"][:first] == 2.0) and pile["cost"][first - 1] > 1.35
    assert pile["uneven"][first:].mean() < 1.4 and pile["cost"][-1] < 1.1


@pytest.mark.ranks
def test_bodies_joined_where_a_run_goes_on_come_to_one_rank(found):
    """Those of the run before were on two."""
    one, many = found("hinged", 1), found("hinged", 3)
    assert len(set(many["ranks"])) == 2
    np.testing.assert_allclose(many["solids"], one["solids"], rtol=0, atol=1e-8)


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """A whole run on two ranks and on one; those on two that were stopped go on."""
    base = tmp_path_factory.mktemp("rebalanced")

    def run(*asked: str) -> list[int]:
        done = on_ranks(2, "ranks/rebalanced.py", base, *asked)
        assert done.returncode == 0, done.stdout
        return [int(step) for step in re.findall(r"divided anew in step (\d+)", done.stdout)]

    divided = run("two=16", "early=10", "late=12"), run("early=16", "late=16", "restart")
    assert len(run("spread=16")) > 2
    rebalanced.record(f"{base}/one", 16, restart=False)
    return base, *divided


def of_one_value(nodal):
    """Fields at points; those that hang on impulses only of lips that have parted.

    Around a vertex impulses of lips that press may have several values.
    """
    if "traction" in nodal:
        pressed = nodal["jump"][:, 0] <= 1e-9
        assert np.any(nodal["traction"][~pressed])
        for name in ("traction", "status"):
            nodal[name] = np.where(pressed, 0.0, nodal[name].T).T
    return nodal


def series(path):
    """Fields of a series at all times but the start."""
    with meshio.xdmf.TimeSeriesReader(path) as reader:
        reader.read_points_cells()
        fields = [reader.read_data(k) for k in range(1, reader.num_steps)]
    return [(time, of_one_value(nodal), of_cells) for time, nodal, of_cells in fields]


@pytest.mark.ranks
def test_a_run_goes_on_to_the_bit(folders):
    """Between two divisions, and before the second one, which the checkpoint has."""
    base, before, after = folders
    assert before == [7, 13, 7, 7] and after == [13]
    histories = [(base / f / "history.csv").read_bytes() for f in ("two", "early", "late")]
    assert histories[0] == histories[1] == histories[2]


@pytest.mark.ranks
@pytest.mark.parametrize("file", ["bulk.xdmf", "interfaces.xdmf"])
def test_fields_are_those_of_one_rank(folders, file):
    one, two = (series(folders[0] / run / file) for run in ("one", "two"))
    assert len(one) == len(two) > 3
    for a, b in zip(one, two, strict=True):
        assert a[0] == b[0]
        for of_one, of_two in zip(a[1:], b[1:], strict=True):
            assert set(of_one) == set(of_two)
            for name, values in of_one.items():
                x, y = np.asarray(values), np.asarray(of_two[name])
                assert np.abs(x - y).max() <= 1e-8 * max(np.abs(x).max(), 1e-6), name


def last_rows(folder, name):
    """Of all files of a series at the last time: cells and points by their places, and fields."""
    points, cells = [], []
    for path in sorted(folder.glob(f"{name}*.xdmf")):
        with meshio.xdmf.TimeSeriesReader(path) as reader:
            x, blocks = reader.read_points_cells()
            _, nodal, cellwise = reader.read_data(reader.num_steps - 1)
        nodal = of_one_value(nodal)
        points.append(np.column_stack([x, *(nodal[key] for key in sorted(nodal))]))
        at_cells = {"stress", "material", "fragment"} & set(cellwise)
        columns = [np.concatenate(cellwise[key]) for key in sorted(at_cells)]
        cells.append(np.column_stack([x[blocks[0].data].mean(axis=1), *columns]))
    tables = (points, cells) if name == "bulk" else (points,)  # a file of all has longer cells
    return [rows[np.lexsort(np.round(rows, 7).T[::-1])] for rows in map(np.vstack, tables)]


@pytest.mark.ranks
@pytest.mark.parametrize("name", ["bulk", "interfaces"])
def test_each_rank_writes_the_bodies_that_it_began_with(folders, name):
    """Of a mesh that is spread, whichever rank has them now."""
    assert len(list((folders[0] / "spread").glob(f"{name}*.xdmf"))) == 2
    one, two = (last_rows(folders[0] / run, name) for run in ("one", "spread"))
    for rows, others in zip(one, two, strict=True):
        assert rows.shape == others.shape
        assert np.abs(rows - others).max() <= 1e-7 * np.abs(rows).max()


@pytest.mark.ranks
def test_bodies_of_a_spread_mesh_that_come_back_are_what_they_were(found):
    """A rank has known what the one before it did, its facets and tags, and nothing else."""
    told = found("there_and_back", 3)
    at_first, then, back = told["known"]
    np.testing.assert_array_equal(then, np.roll(at_first, 1))
    np.testing.assert_array_equal(back, at_first)
    assert len(told["facets"]) > 100 and len({*told["cells"][:, 1]}) > 100
    for name in ("cells", "facets"):
        for when in ("then", "back"):
            np.testing.assert_array_equal(told[f"{when}_{name}"], told[name])


@pytest.mark.ranks
def test_a_rank_asks_for_the_ranks_of_bodies_of_others(found):
    """Costs are those of ranks that know all; work is shared, and what is held stays."""
    told = found("asked", 3)
    np.testing.assert_array_equal(*told["costs"])
    load, moves, held = np.bincount(told["rank"], told["work"], 3), *told["rank_of_rigid"]
    load[moves] += told["work_of_rigid"]
    assert load.max() < 1.1 * load.mean()
    assert held == 0 and told["work_of_rigid"] > 100


@pytest.mark.ranks
def test_a_run_of_a_spread_mesh_goes_on_to_the_bit(found):
    """Whichever bodies DOLFINx gives to the ranks at first; a division is due at step 8."""
    runs = found("again", 2)
    for step in (8, 10):
        np.testing.assert_array_equal(runs[f"from_{step}"], runs["whole"][step:])
    assert runs["sweeps"]
    np.testing.assert_allclose(runs["swept"], runs["whole"], atol=1e-8 * runs["whole"].max())


@pytest.mark.ranks
def test_fragments_are_those_of_one_rank(folders):
    one, two = (read_history(folders[0] / run / "history.csv") for run in ("one", "two"))
    np.testing.assert_array_equal(one["fragments"], two["fragments"])
