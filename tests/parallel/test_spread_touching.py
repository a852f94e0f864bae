# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts that are searched on meshes that are spread over ranks, against whole meshes on one."""

import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from on_ranks import on_ranks, runs_of

from xper_fx.output.history import read_history

sys.path.insert(0, str(Path(__file__).parents[1] / "ranks"))
import spread_touching

pytestmark = pytest.mark.ranks

# Vertices that split, at either strain, bonds that break and lips that part, both in space, too,
# hexahedra and edges that cross, a sphere on an edge, order 2 on a wall, friction that weakens
# where nodes slide from body to body of one fragment, and ranks without a surface. Beside rigid
# bodies: joints, clusters of cells that split, discs that meet, an anvil and a floor, solids in
# space, a disc that flies to another rank's block, bodies that touch without a bond. Where they are
# moved bodies change their ranks.
SCENES = {
    2: ("split_cells", "heap", "rammed", "thrown", "struck", "split_boxes", "on_edge", "rubbed",
        "moved_pelted", "moved_split_struck"),
    3: ("turning_cells", "breaking", "boxes", "broken_boxes", "slide", "held", "refused",
        "turning_split_struck"),
    4: ("one_end", "moved_tabled", "moved_sampled"),
}  # fmt: skip
runs = [(n, name) for n in SCENES for name in SCENES[n] if name not in ("held", "refused")]


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """What a scene gives on a number of ranks."""
    script = "ranks/spread_touching.py"
    return runs_of(script, SCENES, spread_touching.run, tmp_path_factory)


@pytest.mark.parametrize(("count", "name"), runs)
def test_ranks_agree(found, name, count):
    one, many = found(name.removeprefix("moved_"), 1), found(name, count)
    assert many.pop("moves", 2) >= 2
    assert set(one) == set(many)
    least = {"one_end": 0, "rammed": 4, "thrown": 2, "on_edge": 1, "rubbed": 6}.get(name, 10)
    assert one["pushed"].max() >= least
    np.testing.assert_array_equal(many["pushed"], one["pushed"])
    energy = max(np.abs(one[key]).max() for key in ("kinetic", "external_work"))
    for key in one:
        scale = np.abs(one[key]).max(initial=0.0)
        if np.shape(one[key]) == np.shape(one["kinetic"]):
            scale = energy
        elif key == "momentum":  # masses are about one
            scale = np.sqrt(energy)
        # faces of hexahedra can push each other in more ways than one
        elif key == "force" and name == "boxes":
            one[key], many[key] = one[key].sum(), many[key].sum()
        # two contacts of a body share what they bear as the tolerance lets them
        bound = 1e-7 if key == "force" else 1e-8
        assert np.abs(one[key] - many[key]).max(initial=0.0) <= bound * scale, key
    if name not in ("heap", "turning_cells", "turning_split_struck"):
        # at small strain energy closes to rounding
        assert np.abs(many["closure"]).max() <= 1e-12 * energy


def test_a_search_finds_what_one_on_the_whole_mesh_does():
    """While blocks in 2D and 3D tumble, bonds open and let go, and fragments come about."""
    done = on_ranks(3, "ranks/searched_spread.py")
    assert done.returncode == 0, done.stdout + done.stderr
    contacts, fragments = map(int, done.stdout.split()[-2:])
    assert contacts > 100 and fragments > 5


def test_nothing_is_whole_on_a_rank(found):
    """Bytes a body of the rank's own, beside those of a run on one rank."""
    (spread, divided), one = found("held", 3)["held"].T, spread_touching.held(MPI.COMM_SELF)
    assert spread.max() <= 2.4 * one
    # of a mesh that is whole on each rank the same count finds the whole
    assert divided.min() > 3.1 * one


def test_what_is_not_divided_is_refused(found):
    for said, expected in zip(
        found("refused", 3)["told"].tolist(),
        (
            r"ValueError: No contact says .*\n.*\('left', 'left'\), None\),\n.*\('right', ",
            "ValueError: .*'wrong'",
        ),
        strict=True,
    ):
        assert re.match(expected, said), said


@pytest.mark.parametrize(("name", "half", "last"), [("", 12, 14), ("solids_", 12, 14),
                                                    ("boxes_", 8, 10)])  # fmt: skip
def test_a_restart_goes_on_as_if_nothing_had_been(tmp_path, name, half, last):
    """On as many ranks and on others, for which DOLFINx partitions the mesh otherwise."""

    def run(count: int, *asked: str) -> None:
        done = on_ranks(count, "ranks/spread_touching.py", tmp_path, *asked)
        assert done.returncode == 0, done.stdout + done.stderr

    run(2, f"{name}whole={last}", f"{name}on_2={half}")
    shutil.copytree(tmp_path / f"{name}on_2", tmp_path / f"{name}on_3")
    for count in (2, 3):
        run(count, f"{name}on_{count}={last}", "restart")
    one = read_history(tmp_path / f"{name}whole" / "history.csv")
    assert one["dissipated_impact"][half - 1] > 0.0
    for count in (2, 3):
        other = read_history(tmp_path / f"{name}on_{count}" / "history.csv")
        for key in ("kinetic", "elastic", "dissipated_friction", "dissipated_impact"):
            assert np.abs(one[key] - other[key]).max() <= 1e-9 * one["kinetic"].max(), key
