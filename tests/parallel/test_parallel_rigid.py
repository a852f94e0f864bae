# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes of rigid bodies whose contacts several ranks divide, against the same scenes on one."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from on_ranks import on_ranks

pytestmark = pytest.mark.ranks

OF_TWO = ("bricks", "clouds", "falling", "shear", "glued", "ropes", "gas", "sheared", "pressed",
          "squeezed", "swinging", "assembled")  # fmt: skip
# without contacts, or whose solver wants all
WHOLE = ("swinging", "assembled")
# that take more sweeps than are tried together
HARD = ("hard_bricks", "hard_pressed")
OF_THREE = ("bricks", "pressed", *HARD)
SCENES = {1: (*OF_TWO, *HARD), 2: OF_TWO, 3: OF_THREE}
several = pytest.mark.parametrize("count", [2, 3])
scenes = pytest.mark.parametrize(
    ("count", "scene"), [(count, scene) for count in (2, 3) for scene in SCENES[count]]
)


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """Results of all scenes by number of ranks."""

    @cache
    def results(count: int) -> dict[str, np.ndarray]:
        path = tmp_path_factory.mktemp("rigid") / f"on_{count}.npz"
        done = on_ranks(count, "ranks/rigid_bodies.py", path, *SCENES[count])
        assert done.returncode == 0, done.stderr[-3000:]
        assert "simulates the whole scene" not in done.stdout
        return dict(np.load(path))

    return results


@scenes
def test_contacts_are_divided_and_states_the_same_bits(found, scene, count):
    result = found(count)
    assert (result[f"{scene}/partitions"] >= 1) == (scene not in WHOLE)
    assert result[f"{scene}/undivided"] == (scene in HARD)
    assert result[f"{scene}/alike"]


@scenes
def test_motion_is_that_of_one_rank(found, scene, count):
    alone, together = found(1), found(count)
    for name in ("position", "velocity", "spin"):
        expected = alone[f"{scene}/{name}"]
        scale = np.abs(expected).max()
        np.testing.assert_allclose(
            together[f"{scene}/{name}"], expected, rtol=0, atol=1e-8 * scale, err_msg=name
        )


@scenes
def test_energies_are_those_of_one_rank_and_closed(found, scene, count):
    energies = found(count)[f"{scene}/records"][:, :-1]
    expected = found(1)[f"{scene}/records"][:, :-1]
    scale = np.abs(expected).max()
    np.testing.assert_allclose(energies, expected, rtol=0, atol=1e-8 * scale)
    assert np.abs(energies[:, -1]).max() < 1e-12 * scale


@scenes
def test_fragments_are_those_of_one_rank(found, scene, count):
    """Glue joins bodies on whichever rank its contact is; momenta are not summed over ranks."""
    alone, together = found(1), found(count)
    fragment = together[f"{scene}/fragment"]
    np.testing.assert_array_equal(fragment, alone[f"{scene}/fragment"])
    if scene == "glued":
        assert fragment.tolist() == [3] * 4 + [2] * 5 + [1] * 6 + [0] * 7
    else:
        bodies = np.sort(fragment[fragment >= 0])
        assert bodies.tolist() == [*range(len(bodies))]
    dim = together[f"{scene}/position"].shape[1]
    if scene in ("clouds", "glued"):  # all bodies have mass
        whole = together[f"{scene}/momenta"][:dim]
        assert together[f"{scene}/sum_of_momenta"] == pytest.approx(whole, rel=1e-12)


def test_free_clouds_keep_their_momenta(found):
    result = found(2)
    scale = np.abs(result["clouds/start"]).max()
    assert result["clouds/pushed"] > 50
    assert result["clouds/moved"] > 54  # more than there are: the first partition is not the last
    assert np.abs(result["clouds/momenta"] - result["clouds/start"]).max() < 1e-12 * scale


@several
def test_all_read_all_forces(found, count):
    """Forces on bricks and what moves their floor do not depend on who has the contacts."""
    alone, together = found(1), found(count)
    for name in ("bricks/force", "bricks/reaction", "bricks/asked"):
        scale = np.abs(alone[name]).max()
        np.testing.assert_allclose(together[name], alone[name], rtol=0, atol=1e-7 * scale)
    # a contact whose force is next to nothing may push or not
    assert together["bricks/pushed"] == pytest.approx(alone["bricks/pushed"], rel=0.01)


def test_joints_are_on_the_rank_of_their_bodies(found):
    """Ropes stay whole; two that a wire joins are on one rank. All read all forces."""
    alone, together = found(1), found(2)
    rows = together["ropes/rows"]
    assert sum(rows) == sum(alone["ropes/rows"]) == 56 and min(rows) >= 18
    assert together["ropes/moved"] > 18  # more than there are: joints go on with their bodies
    expected = alone["ropes/joints"]
    scale = np.abs(expected).max()
    np.testing.assert_allclose(together["ropes/joints"], expected, rtol=0, atol=1e-8 * scale)


@several
def test_the_stress_of_a_cell_is_that_of_all_contacts(found, count):
    """Images of a body are where it is; each rank has the impulses that all give the cell."""
    pushed = {"sheared": 150, "pressed": 300, "squeezed": 700}
    for scene in pushed.keys() & SCENES[count]:
        expected = found(1)[f"{scene}/stress"]
        assert np.linalg.eigvalsh(expected + expected.T).max() < -5e2  # grains press each other
        assert found(1)[f"{scene}/pushed"] > pushed[scene]
        scale = np.abs(expected).max()
        np.testing.assert_allclose(
            found(count)[f"{scene}/stress"], expected, rtol=0, atol=1e-8 * scale
        )


@several
def test_all_contacts_move_the_cell_that_stress_drives(found, count):
    """Copies of its rate are one, and what contacts give it is added up over the ranks."""
    for scene in {"pressed", "squeezed"} & {*SCENES[count]}:
        expected = found(1)[f"{scene}/gradient"]
        assert np.abs(expected - np.eye(len(expected))).max() > 0.01
        np.testing.assert_allclose(found(count)[f"{scene}/gradient"], expected, rtol=0, atol=1e-10)
        assert min(found(count)[f"{scene}/own"]) > 5
        # mass splitting takes hardly more sweeps
        sweeps = [found(ranks)[f"{scene}/records"][:, -1].sum() for ranks in (count, 1)]
        assert sweeps[0] < 1.3 * sweeps[1]


def test_bodies_change_their_ranks(found):
    assert found(2)["clouds/partitions"] >= 2
    assert found(2)["clouds/moved"] > 0
