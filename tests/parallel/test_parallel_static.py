# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static and monolithic runs on several ranks against the same on one."""

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from on_ranks import on_new_ranks, on_ranks, runs_of

from xper_fx.output.history import read_history

sys.path.insert(0, str(Path(__file__).parents[1] / "ranks"))
import static_scenes

pytestmark = pytest.mark.ranks
SCRIPT = "ranks/static_scenes.py"
# Bonds that weaken, contacts that Newton's method does not find by itself, finite strain on a wall,
# initially rigid bonds in space, searched contacts, also in steps picked until bodies touch,
# contacts solved at their points, contacts that alone hold, also such as an interior point finds, a
# rigid tool, also by sweeps, blocks on springs that Newton's method lets go, inertia, ties, paths
# that snap back, periodic cells, also along a path, meshes that are spread over the ranks, matrices
# that all ranks factor, subdomains.
SCENES = {
    2: ("rigid", "touching", "nearing", "held", "leaning", "pushed", "indented", "swept", "sprung",
        "inert", "tied", "bridged", "spread_bridged", "unrolled", "inert_cell", "cell",
        "spread_cell", "spread_drawn", "spread_touching", "spread_indented", "factored_drawn",
        "factored_turned_cell", "bonded", "groups", "messages"),
    3: ("stopped", "spread_stopped", "spread_tied", "drawn", "wedged", "turned", "peeled",
        "turned_cell", "celled_path", "spread_celled_path", "spread_unrolled", "spread_row",
        "spread_bonded", "groups"),
}  # fmt: skip
# Those that give something else than a history.
APART = ("groups", "messages", "stopped", "spread_stopped")
RUNS = [(count, name) for count, names in SCENES.items() for name in names if name not in APART]
several = pytest.mark.parametrize(("count", "name"), RUNS)


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """What a scene gives on a number of ranks."""
    return runs_of(SCRIPT, SCENES, static_scenes.run, tmp_path_factory)


@several
def test_ranks_agree(found, name, count):
    one, many = found(name, 1), found(name, count)
    work = np.abs(one["external_work"]).max()
    on_sides = [key for key in one if key.startswith("reaction")]
    reactions = max((np.abs(one[key]).max() for key in on_sides), default=0.0)
    sizes = {"displacement": np.abs(one["displacement"]).max(), "damage": 1.0}
    sizes |= dict.fromkeys(on_sides, reactions)
    sizes |= dict.fromkeys(("external_work", "elastic", "cohesive", "dissipated_friction"), work)
    for letter in "FP":  # of a periodic cell
        columns = [letter + i + j for i in "12" for j in "12" if "F11" in one]
        sizes |= dict.fromkeys(columns, max((np.abs(one[c]).max() for c in columns), default=0.0))
    # Newton ends the first step of bonds that turn where a reaction is found to 1.6e-9
    bound = 3e-9 if name.endswith("unrolled") else 1e-9
    for key, size in sizes.items():
        assert np.abs(one[key] - many[key]).max(initial=0.0) <= bound * size, key
    # a matrix that lacked something would take more corrections to the same end; where the first
    # step of bonds that turn ends is decided by rounding
    later = slice(int(name.endswith("unrolled")), None)
    assert many["iterations"][later].sum() <= 1.3 * one["iterations"][later].sum()
    if name.endswith("bonded"):
        assert many["sweeps"].sum() <= 1.05 * one["sweeps"].sum()


@several
def test_forces_balance_and_energy_is_exact(found, name, count):
    run = found(name, count)
    work = np.abs(run["external_work"]).max()
    # frames that turn end each step within their tolerance, forces of points that close in a step
    # do not change linearly in it
    if not name.endswith(("turned", "tied", "unrolled", "turned_cell", "nearing")):
        assert np.abs(run["closure"]).max() <= 1e-11 * work
    if "hill_mandel" in run:
        assert run["hill_mandel"].max() <= (1e-6 if name.endswith("turned_cell") else 1e-10)
    if name in ("drawn", "wedged"):
        # a corner belongs to two sides, one of which holds it along x and the other along y
        reactions = [run[f"reaction_{side}"] for side in (static_scenes.LEFT, static_scenes.RIGHT)]
        axis = 0 if name == "drawn" else 1
        total = np.sum(reactions, axis=0)[:, axis]
        assert np.abs(total).max() <= 1e-10 * np.abs(reactions[0]).max()
    if name == "peeled":
        total = sum(run[key] for key in run if key.startswith("reaction"))
        assert np.abs(total).max() <= 1e-10 * np.abs(run[f"reaction_{static_scenes.LEFT}"]).max()


@pytest.mark.parametrize(
    ("count", "name"),
    [(c, n) for c, n in RUNS if n.removeprefix("spread_") in ("peeled", "unrolled", "celled_path")],
)
def test_paths_agree_turn_and_go_on(found, name, count):
    """The loads are those of one rank, and those of a run that was saved on the way."""
    one, many = found(name, 1), found(name, count)
    assert np.abs(many["time"] - one["time"]).max() <= 1e-9 * one["time"].max()
    assert np.any(np.diff(one["time"]) < 0.0) == (name == "peeled")
    assert one["dissipated_cohesion"][-1] > 0.1 * one["external_work"][-1]
    later = many["time"][-len(many["again"]) :]
    assert np.abs(many["again"] - later).max() <= 1e-9 * later.max()


@several
def test_a_rank_holds_its_share(found, name, count):
    one, many = found(name, 1)["held"], found(name, count)["held"]
    assert len(many) == count and many.min() > 0
    np.testing.assert_array_equal(many.sum(axis=0), one[0])


def test_what_was_compared_has_weakened_and_slid(found):
    assert found("drawn", 1)["damage"].max() > 0.9
    assert found("turned", 1)["dissipated_friction"][-1] > 0.01 * found("turned", 1)["elastic"][-1]
    assert found("wedged", 1)["iterations"][0] > 30  # contacts were looked for


@pytest.mark.parametrize("name", ["loose", "spread_loose"])
def test_what_nothing_holds_is_told_as_on_one_rank(tmp_path, name):
    with pytest.raises(ValueError, match="is free with the 71 it is joined to") as raised:
        static_scenes.run(name)
    done = on_new_ranks(2, SCRIPT, tmp_path, name)
    assert done.returncode != 0 and str(raised.value) in done.stderr


@pytest.mark.parametrize("name", ["stopped", "spread_stopped"])
def test_a_path_that_stops_does_so_on_all_ranks_in_the_same_words(found, name):
    """Why the last attempt fails is chance, and so is whether a bond took turns in it."""
    one, many = found("stopped", 1), found(name, 3)
    bond = "The bond at (0.825, 0.0625) opens"
    assert bond in one["told"][0]
    assert len(many["told"]) == 3 and len(set(many["told"])) == 1
    told = many["told"][0]
    assert told.split(":")[0] == one["told"][0].split(":")[0]
    assert bond in told or "The bond" not in told
    np.testing.assert_allclose(many["loads"], one["loads"], rtol=1e-8)


@pytest.mark.parametrize("name", ["stopped", "spread_stopped"])
def test_all_ranks_know_where_a_bond_is(found, name):
    one, many = found("stopped", 1)["places"][0], found(name, 3)["places"]
    for places in many:
        np.testing.assert_array_equal(places, many[0])
        order, sought = (np.lexsort(np.round(x, 9).T) for x in (places, one))
        np.testing.assert_allclose(places[order], one[sought], atol=1e-12)


def test_a_correction_is_few_messages(found):
    """Where another process has the core, each waits for a slice of time; they were 37.6.

    What PETSc and MUMPS exchange where all ranks factor comes on top of that.
    """
    assert found("messages", 2)["messages"] < 32


def test_a_step_is_few_sums(found):
    """One of what is agreed on when an attempt ends, one of what the points did.

    Sweeps have two more where they are as many as in the step before, one for their laws' history,
    and bonds that may turn one.
    """
    told = found("messages", 2)
    assert told["explicit"][0] == 2.0
    sums, sweeps = told["implicit"]
    assert sweeps > 7.0 and sums <= 6.25


@pytest.mark.parametrize("count", [count for count in SCENES if "groups" in SCENES[count]])
def test_groups_that_reach_over_ranks_are_one(found, count):
    one, many = found("groups", 1)["told"], found("groups", count)["told"]
    assert len(np.unique(one[:, 2])) > 1 and one[:, 3].max() > 10
    np.testing.assert_allclose(many, one, rtol=1e-12)


def test_a_run_goes_on_from_its_checkpoint(tmp_path):
    def run(count: int, *asked: str) -> None:
        done = on_ranks(count, SCRIPT, tmp_path, *asked)
        assert done.returncode == 0, done.stdout + done.stderr

    run(2, "two=4", "on_2=2")
    shutil.copytree(tmp_path / "on_2", tmp_path / "on_1")
    for count in (2, 1):
        run(count, f"on_{count}=4", "restart")
    two, *others = (read_history(tmp_path / f / "history.csv") for f in ("two", "on_2", "on_1"))
    for other in others:
        for key in ("elastic", "cohesive", "dissipated_friction"):
            assert np.abs(two[key] - other[key]).max() <= 1e-9 * two["external_work"].max(), key
