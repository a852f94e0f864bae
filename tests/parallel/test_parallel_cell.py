# SPDX-License-Identifier: LGPL-3.0-or-later
"""Periodic cells whose bodies several ranks divide: what one rank finds, through softening."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from on_ranks import on_ranks

sys.path.insert(0, str(Path(__file__).parents[1] / "ranks"))
import periodic_cells

pytestmark = pytest.mark.ranks

SCRIPT = Path("ranks/periodic_cells.py")
CELLS = {
    2: ("small_strain", "finite_strain", "held", "plastic", "spread_small_strain"),
    3: ("held", "spread_each_cell"),
}
DIVIDED = [(name, count) for count, names in CELLS.items() for name in names]
ENERGIES = (
    "external_work", "kinetic", "elastic", "cohesive", "dissipated_cohesion", "dissipated_friction",
    "dissipated_numerical",
)  # fmt: skip
# Impulses are solved to 1e-8 by sweeps in another order.
SAME = 1e-6


@pytest.fixture(scope="module")
def alone():
    """The cells as one rank finds them."""
    return {name: periodic_cells.run(name) for name in periodic_cells.SCENES}


@pytest.fixture(scope="module")
def divided(tmp_path_factory):
    """The cells as 2 and 3 ranks find them, as a function of name and count of ranks."""
    folders = {}

    def found(name, count):
        if count not in folders:
            folder = tmp_path_factory.mktemp(f"ranks{count}")
            done = on_ranks(count, SCRIPT, folder, *CELLS[count])
            assert done.returncode == 0, done.stdout + done.stderr
            folders[count] = folder
        return dict(np.load(folders[count] / f"{name}.npz"))

    return found


@pytest.mark.parametrize("name", periodic_cells.SCENES)
def test_the_cells_soften(alone, name):
    """What is compared is more than an elastic curve: bonds fail, and cells past their peak."""
    found = alone[name]
    assert found["ranks"] == 1
    assert found["damage"].min() < 0.6
    first, last = found["dissipated_cohesion"][[0, -1]]
    assert first == 0.0 and last > 5e-3
    if name == "plastic":
        assert found["dissipated_plastic"][-1] > last
    peak = found["P11"].max()
    assert found["P11"][-1] < {"held": 0.995, "each_cell": 0.6}.get(name, 1.01) * peak
    check_lemma_and_momentum(found)


def check_lemma_and_momentum(found):
    """Hill and Mandel's lemma at every step; u# has no momentum, nor gains any at the cuts."""
    assert found["hill_mandel"].max() < 1e-7
    momentum = np.stack([found["momentum_x"], found["momentum_y"]])
    assert np.abs(momentum).max() < 1e-12


@pytest.mark.parametrize("name, count", DIVIDED)
def test_ranks_find_the_same_cell(alone, divided, name, count):
    """Macroscopic curves, energies, jumps and damage of points, mean displacements of bodies."""
    alone, divided = alone[name.removeprefix("spread_")], divided(name, count)
    assert divided["ranks"] == count and divided["shared"] > count
    assert divided["dofs"] == alone["dofs"]
    assert divided["time"] == pytest.approx(alone["time"], rel=1e-12)
    for letter in "FP":
        columns = [f"{letter}{i}{j}" for i in (1, 2) for j in (1, 2)]
        curves, expected = (np.stack([run[c] for c in columns]) for run in (divided, alone))
        if letter == "F":
            expected = expected - np.eye(2).reshape(4, 1)
            curves = curves - np.eye(2).reshape(4, 1)
        scale = np.abs(expected).max()
        assert np.abs(curves - expected).max() < SAME * scale
    for column in ENERGIES + (("dissipated_plastic",) if name == "plastic" else ()):
        scale = alone["external_work"].max()
        assert divided[column] == pytest.approx(alone[column], abs=SAME * scale), column
    assert divided["closure"] == pytest.approx(alone["closure"], abs=1e-9)
    assert divided["norm"] == pytest.approx(alone["norm"], rel=SAME)
    if name.startswith("spread_"):
        np.testing.assert_array_equal(divided["again"], divided["elastic"][-3:])
    for field in ("jump", "damage", "displacement"):
        many, one = divided[field], alone[field]
        if name == "spread_each_cell" and field == "displacement":  # bodies have other numbers
            many, one = np.sort(many.ravel()), np.sort(one.ravel())
        assert np.abs(many - one).max() < SAME * np.abs(one).max()
    check_lemma_and_momentum(divided)
