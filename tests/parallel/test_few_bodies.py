# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fewer bodies than ranks: those without take part with nothing, and one rank's error ends all."""

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from on_ranks import on_new_ranks, on_ranks, runs_of

from xper_fx.output.history import read_history

sys.path.insert(0, str(Path(__file__).parents[1] / "ranks"))
import few_bodies

pytestmark = pytest.mark.ranks

WHOLE = tuple(few_bodies.SCENES)
SPREAD = tuple(
    f"spread_{name}"
    for name in ("blocks", "assembled", "explicit", "tied", "static", "struck", "bar", "hole")
)
SCENES = {3: (*WHOLE, *SPREAD, "misfit", "spread_misfit")}


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """What a scene gives on a number of ranks."""
    return runs_of("ranks/few_bodies.py", SCENES, few_bodies.run, tmp_path_factory)


@pytest.mark.parametrize("name", (*WHOLE, *SPREAD))
def test_ranks_without_a_body_change_nothing(found, name):
    one, many = found(name.removeprefix("spread_"), 1), found(name, 3)
    bodies = 1 if name.removeprefix("spread_") in ("struck", "bar", "hole") else 2
    assert one["bodies"].tolist() == [bodies]
    assert sorted(many["bodies"].tolist()) == [0] * (3 - bodies) + [1] * bodies
    assert set(one) == set(many)
    energy = max(np.abs(one[key]).max() for key in ("kinetic", "elastic", "external_work"))
    assert energy > 0.0
    size = np.abs(one["samples"]).max()
    assert np.abs(one["samples"] - many["samples"]).max() <= 1e-7 * size > 0.0
    for key in set(one) - {"bodies", "mass", "samples"}:
        assert np.abs(one[key] - many[key]).max() <= 1e-10 * energy, key
    if "mass" in one:
        np.testing.assert_allclose(np.sort(many["mass"]), np.sort(one["mass"]), rtol=1e-12)


def test_something_happens_in_what_is_compared(found):
    for name, key in (
        ("blocks", "dissipated_friction"), ("assembled", "asked"),
        ("explicit", "dissipated_impact"), ("tied", "cohesive"), ("static", "cohesive"),
        ("struck", "dissipated_friction"), ("cell", "cohesive"),
    ):  # fmt: skip
        assert np.abs(found(name, 1)[key]).max() > 0.0, (name, key)


@pytest.mark.parametrize("name", ["misfit", "spread_misfit"])
def test_a_tie_that_does_not_fit_tells_the_places_of_all(found, name):
    (one,) = found("misfit", 1)["told"]
    assert "(2 such facets)" in one
    assert found(name, 3)["told"].tolist() == [one] * 3


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Whole runs on three ranks, and ones that are stopped and go on, on three and two."""
    base = tmp_path_factory.mktemp("few")
    last, half = few_bodies.LAST, few_bodies.LAST // 2

    def run(count: int, *asked: str) -> str:
        done = on_ranks(count, "ranks/few_bodies.py", base, *asked)
        assert done.returncode == 0, done.stdout
        return done.stdout

    kinds = ("whole", "spread")
    said = run(3, *(f"{kind}_{f}" for kind in kinds for f in (f"three={last}", f"on_3={half}")))
    assert said.count("1 of 3 ranks have no meshed body") == 4
    for kind in kinds:
        shutil.copytree(base / f"{kind}_on_3", base / f"{kind}_on_2")
    for count, bare in ((3, 2), (2, 0)):
        said = run(count, *(f"{kind}_on_{count}={last}" for kind in kinds), "restart")
        assert said.count("have no meshed body") == bare
    return base


@pytest.mark.parametrize("kind", ["whole", "spread"])
def test_runs_go_on(folders, kind):
    three, again, two = (folders / f"{kind}_{f}" / "history.csv" for f in ("three", "on_3", "on_2"))
    assert three.read_bytes() == again.read_bytes()
    expected, other = read_history(three), read_history(two)
    for key in ("kinetic", "elastic", "external_work", "cohesive"):
        np.testing.assert_allclose(other[key], expected[key], rtol=1e-9, atol=1e-14)
    assert set(expected["fragments"]) == {1}  # counted by ranks without a body, too
    files = {path.name for path in three.parent.glob("bulk*.xdmf")}
    assert files == ({"bulk.xdmf"} if kind == "whole" else {f"bulk_{n}.xdmf" for n in range(3)})


@pytest.mark.parametrize("stage", ["set-up", "restart", "record", "script"])
def test_what_one_rank_raises_ends_all(stage, tmp_path):
    """Without `run_together`; what all ranks raise can be caught."""
    done = on_new_ranks(2, "ranks/one_fails.py", stage, tmp_path, timeout=120)
    assert done.returncode != 0
    assert done.stdout.count("all have caught it") == 2 and "gone on" not in done.stdout
    assert done.stderr.count("Rank 1 of 2 failed:") == 1
    said = "SystemExit: left by hand" if stage == "script" else "MemoryError: by hand"
    assert done.stderr.count(said) == 1
