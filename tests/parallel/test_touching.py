# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshed bodies whose contacts are searched, on several ranks against the same on one."""

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from on_ranks import on_ranks, runs_of

from xper_fx.output.history import read_history
from xper_fx.parallel.local_bodies import neighbours

sys.path.insert(0, str(Path(__file__).parents[1] / "ranks"))
import touching_bodies

# Free flight by either bulk, hexahedra with edges that cross, order 2 at finite strain on a wall,
# bonds that break, in small strain, turning and with an explicit bulk, there also with vertices
# that split, at either strain, and a block that has none alone on its rank, friction that weakens,
# and rigid bodies: discs that break a plate on an anvil, jointed ones, spheres and a box in space,
# and such beside vertices that split, also jointed and
# rolling ones, where walls are, too.
SCENES = {
    2: ("cloud", "explicit", "boxes", "heap", "turning_shards", "explicit_shards", "slide",
        "struck", "rammed", "pelted", "split_pelted", "split_walled"),
    3: ("lone", "turning_lone", "split_struck", "turning_split_shards", "turning_split_struck",
        "turning_split_walled"),
    4: ("shards",),
}  # fmt: skip
several = pytest.mark.parametrize(
    ("count", "name"), [(count, name) for count, names in SCENES.items() for name in names]
)
ENERGIES = ("kinetic", "elastic", "external_work", "dissipated_friction", "dissipated_impact")
# Nothing acts on them from outside; at small strain the energy is kept to rounding.
FREE = ("cloud", "explicit", "boxes", "shards", "explicit_shards", "lone",
        "pelted", "split_pelted", "turning_split_shards", "turning_lone")  # fmt: skip

JOINTED = ("rammed", "split_struck", "turning_split_struck")
RIGID = ("struck", "rammed", "pelted", "split_struck", "turning_split_struck", "split_pelted")

# Points without arrays at the end: of lips that the search has taken over, and of vertices that
# are whole.
RETIRED = {"struck": 10, "lone": 18, "turning_lone": 21, "split_pelted": 4}
RETIRED["turning_split_shards"] = 43
RETIRED |= dict.fromkeys(("split_struck", "turning_split_struck"), 34)
RETIRED |= dict.fromkeys(("split_walled", "turning_split_walled"), 22)
RETIRED |= dict.fromkeys(("shards", "explicit_shards"), 48)

# Runs that are stopped and go on.
RECORDED = tuple(touching_bodies.RECORDED)

# Contacts of hexahedra, face on face, or of cells in plates that press each other can push in more
# ways than one: their sum is compared.
WEDGED = ("boxes", "turning_split_shards")


def test_neighbours_are_the_bodies_beside_each_other():
    """A tenth of a side apart at most: at 0.02 times the side of the whole, 0.06 of a block's."""
    pairs = neighbours(touching_bodies.apart((3, 3), (3, 3), "quadrilateral"))
    expected = [(a, b) for a in range(9) for b in range(a + 1, 9)
                if abs(a // 3 - b // 3) <= 1 and abs(a % 3 - b % 3) <= 1]  # fmt: skip
    assert pairs.tolist() == [list(pair) for pair in expected]
    assert not len(neighbours(touching_bodies.apart((3, 3), (3, 3), gap=0.1)))


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """What a scene gives on a number of ranks, in one run or another."""
    return runs_of("ranks/touching_bodies.py", SCENES, touching_bodies.run, tmp_path_factory)


@pytest.mark.ranks
@several
def test_ranks_agree(found, name, count):
    one, many = found(name, 1), found(name, count)
    assert set(one) == set(many) and one["pushed"].max() >= (4 if name == "rammed" else 10)
    assert one["retired"] == RETIRED.get(name, 0)
    for key in ("contact_bodies", "pushed", "fragment", "retired"):
        np.testing.assert_array_equal(many[key], one[key])
    energies = max(np.abs(one[key]).max() for key in ("kinetic", "external_work"))
    for key in ENERGIES:
        assert np.abs(one[key] - many[key]).max() <= 1e-8 * energies, key
    if name.endswith("walled"):
        assert one["momentum"][-1, 1] > 0.05
        # those on the wall come last
        np.testing.assert_allclose(many["jump"][-20:], one["jump"][-20:], rtol=0, atol=1e-9)
    each = () if name in WEDGED else ("contact_force",)
    solids = ("solids",) if name in RIGID else ()
    if name in JOINTED:
        solids += ("joint_force",)
    if name == "rammed":
        # of the two that joints join on either side, seven rows and four, each is on one rank
        assert np.sort(many["rows"]).tolist()[-2:] == [4, 7] and sum(many["rows"]) == 11
        assert np.abs(many["closure"]).max() <= 1e-12 * energies
    each += ("momentum", "force", "displacement", "velocity", "damage", "pieces")
    for key in (*each, *solids):
        scale = np.abs(one[key]).max(initial=0.0)
        assert np.abs(one[key] - many[key]).max(initial=0.0) <= 1e-8 * scale, key

    np.testing.assert_allclose(many["contact_position"], one["contact_position"], atol=1e-10)


@pytest.mark.ranks
def test_a_run_repeats_to_the_bit(found):
    """Of four ranks one gets messages of several: which comes first may not matter to a sum."""
    runs = [found("shards", 4, number) for number in (1, 2)]
    for key in runs[0]:
        np.testing.assert_array_equal(*(run[key] for run in runs), err_msg=key)


@pytest.mark.ranks
@pytest.mark.parametrize(
    ("count", "name"),
    [(count, name) for count in (1, 2, 3, 4) for name in FREE if name in SCENES.get(count, FREE)],
)
def test_momentum_and_energy_are_exact(found, name, count):
    """Nothing from outside acts: what one body gives the other takes, across ranks too."""
    run = found(name, count)
    size = np.sqrt(2.0 * run["kinetic"][0])  # the mass is one, or less than two
    assert np.abs(run["momentum"] - run["start"]).max() <= 1e-13 * size
    lost = run["dissipated_friction"][-1] + run["dissipated_impact"][-1]
    assert lost > 0.02 * run["kinetic"][0]
    bound = 2e-4 if "turning" in name else 1e-12
    assert np.abs(run["closure"]).max() <= bound * run["kinetic"][0]


@pytest.mark.ranks
@several
def test_a_rank_holds_its_share(found, name, count):
    """Bodies, unknowns and contacts, each of which is on one rank."""
    one, many = found(name, 1)["held"], found(name, count)["held"]
    assert len(many) == count and many[:, :2].min() > 0
    assert not name.endswith("lone") or many[:, 0].min() == 1
    # the fifth are the pairs that the search looks at
    for column in (0, 1, 2, 4):
        assert many[:, column].sum() == one[0, column]
        # few bodies cannot be shared more evenly, and contacts are where they are
        uneven = column == 2 or name.endswith(("lone", "split_struck"))
        assert uneven or many[:, column].max() <= 1.45 * one[0, column] / count


@pytest.mark.ranks
def test_a_rank_knows_what_its_bodies_may_touch(found):
    """Facets of own bodies and of those in reach, of 144 in all."""
    assert found("cloud", 2)["held"][:, 5].tolist() == [108, 108]
    assert found("shards", 4)["held"][:, 5].max() <= 96


@pytest.mark.ranks
def test_a_divided_search_finds_what_a_whole_one_does():
    """Bit by bit, while blocks in 2D and 3D tumble, bonds let go, and blocks fly far apart."""
    done = on_ranks(3, "ranks/divided_search.py")
    assert done.returncode == 0, done.stdout + done.stderr
    contacts, edges = map(int, done.stdout.split()[-2:])
    assert contacts > 100 and edges > 8


@pytest.mark.ranks
def test_ghosts_are_those_of_bodies_that_may_touch(found):
    """Of 150 nodes of the other of two ranks the owner of contacts knows half, of three bodies."""
    assert found("cloud", 2)["held"][:, 3].tolist() == [0, 75]


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Whole runs on two ranks; ones stopped after bodies have met that go on, on 2, 3 and 1."""
    base = tmp_path_factory.mktemp("touching")

    def run(count: int, *asked: str) -> None:
        done = on_ranks(count, "ranks/touching_bodies.py", base, *asked)
        assert done.returncode == 0, done.stdout + done.stderr

    last = touching_bodies.LAST
    run(2, *(f"{scene}_{run}" for scene in RECORDED for run in (f"two={last}", "stopped=12")))
    for count in (2, 3, 1):
        for scene in RECORDED:
            shutil.copytree(base / f"{scene}_stopped", base / f"{scene}_on_{count}")
        run(count, *(f"{scene}_on_{count}={last}" for scene in RECORDED), "restart")
    return base


@pytest.mark.ranks
@pytest.mark.parametrize("scene", RECORDED)
def test_as_many_ranks_go_on_to_the_bit(folders, scene):
    histories = [(folders / f"{scene}_{f}" / "history.csv").read_bytes() for f in ("two", "on_2")]
    assert histories[0] == histories[1]


@pytest.mark.ranks
@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize("scene", RECORDED)
def test_another_number_of_ranks_goes_on_to_the_tolerance(folders, scene, count):
    two, other = (
        read_history(folders / f"{scene}_{f}" / "history.csv") for f in ("two", f"on_{count}")
    )
    assert two["dissipated_impact"][11] > 0.0
    for key in ENERGIES:
        assert np.abs(two[key] - other[key]).max() <= 1e-9 * two["kinetic"].max(), key
