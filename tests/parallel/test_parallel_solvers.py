# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solvers of the interactions beyond sweeps, on several ranks: what one rank finds, as quickly.

Run as a script this module steps the plate and writes what it found.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest
from on_ranks import on_ranks

sys.path.insert(0, str(Path(__file__).parents[2] / "demos"))
from notched_plate import notched_plate

from xper_fx.nscd.solvers import NewtonOnAllPoints
from xper_fx.parallel.launch import run_together
from xper_fx.simulation.simulation import Simulation

pytestmark = pytest.mark.ranks

# The critical step of the bulk of 20 x 20 quads (s).
CRITICAL = 2.3e-10
# Solver, step beside the critical one, number of steps, tolerance. In the steps of 10 no bond
# breaks, in that of 100 some do, and friction acts on their lips.
SOUND, BROKEN = 10, 100
CASES = (
    ("accelerated", SOUND, 1),
    ("newton", SOUND, 2),
    ("newton", BROKEN, 1),
    ("auto", SOUND, 1),
)
TOLERANCE = 1e-8


def found(solver: str, ratio: float, steps: int) -> dict[str, np.ndarray]:
    """What the last step of a run holds, the same on all ranks; `counts` of all steps.

    Counts are sweeps, Newton steps and GMRES iterations.
    """
    plate, step, reports = notched_plate(20, "weak"), ratio * CRITICAL, []
    solve = NewtonOnAllPoints.solve

    def observed(self, *arguments):
        reports.append(solve(self, *arguments))
        return reports[-1]

    NewtonOnAllPoints.solve = observed
    try:
        simulation = Simulation(
            plate, step, scheme="implicit", solver=solver, tolerance=TOLERANCE, num_threads=1
        )
        records = list(simulation.steps(steps * step))
    finally:
        NewtonOnAllPoints.solve = solve
    told = [re.match(r"(\d+) Newton steps, (\d+) iterations", r.reason) for r in reports]
    newton_steps, iterations = (sum(int(m[i]) for m in told) for i in (1, 2))
    gather = simulation.interactions.gather
    return {
        "impulse": gather("impulse"),
        "velocity": gather("velocity"),
        "damage": gather("damage"),
        "energies": np.array(list(records[-1].energies.values())),
        "counts": np.array([sum(r.sweeps for r in records), newton_steps, iterations]),
    }


def main() -> None:
    """Write a file a case and rank: all ranks have to find the same."""
    from mpi4py import MPI

    folder, *which = sys.argv[1:]
    for number in map(int, which):
        result = found(*CASES[number])
        np.savez(Path(folder) / f"{number}_{MPI.COMM_WORLD.rank}.npz", **result)


def found_on_ranks(count: int, folder: Path, which) -> list[dict[str, np.ndarray]]:
    """Results of cases on ranks, whose decisions have to be the same to the last bit."""
    done = on_ranks(count, Path(__file__).resolve(), folder, *which)
    assert done.returncode == 0, done.stderr[-4000:]
    results = []
    for number in which:
        first, *others = (dict(np.load(folder / f"{number}_{r}.npz")) for r in range(count))
        for other in others:
            for name, values in first.items():
                np.testing.assert_array_equal(other[name], values)
        results.append(first)
    return results


def assert_same(result, reference):
    for name in ("impulse", "velocity", "damage", "energies"):
        scale = np.linalg.norm(reference[name])
        assert np.linalg.norm(result[name] - reference[name]) <= 1e-6 * scale, name


@pytest.fixture(scope="module")
def alone():
    return [found(*case) for case in CASES]


@pytest.fixture(scope="module")
def together(tmp_path_factory):
    return found_on_ranks(2, tmp_path_factory.mktemp("two"), range(len(CASES)))


@pytest.mark.parametrize("number", range(len(CASES)))
def test_two_ranks_find_what_one_finds(number, together, alone):
    assert_same(together[number], alone[number])


def test_bonds_break_where_they_should(together):
    broken = [np.count_nonzero(r["damage"] == 0.0) for r in together]
    assert len({broken[0], broken[1], broken[3]}) == 1 and broken[2] > broken[0]


def test_newton_takes_as_many_iterations_as_on_one_rank(together, alone):
    for number in (1, 3):
        ours, theirs = together[number]["counts"], alone[number]["counts"]
        # clusters that are cut do not go on from each other
        assert ours[1] <= theirs[1] + 2 and ours[2] <= 1.25 * theirs[2]


def test_ranks_solve_one_linear_problem():
    done = on_ranks(3, "ranks/linearised.py")
    assert done.returncode == 0, done.stdout
    assert "linearised" in done.stdout


def test_others_need_fewer_sweeps_than_sweeps(together):
    sweeps = found("nlgs", SOUND, 1)["counts"][0]
    mixed, newtons, _, picked = (r["counts"][0] for r in together)
    assert mixed < 0.2 * sweeps
    assert newtons <= 20 and picked < 200


def test_three_ranks_find_what_one_finds(alone, tmp_path):
    (result,) = found_on_ranks(3, tmp_path, [1])
    assert_same(result, alone[1])


if __name__ == "__main__":
    run_together(main)
