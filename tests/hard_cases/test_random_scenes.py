# SPDX-License-Identifier: LGPL-3.0-or-later
"""A few of the random scenes of `benchmarks/soak.py`, which runs them for hours."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

import soak


@pytest.mark.slow
@pytest.mark.parametrize("first", [2000, 3000, 6000])
def test_scenes_end_or_give_up(first):
    """Energies stay finite, ledgers close, no loss falls, or the step says why it cannot be."""
    outcomes = [soak.run(soak.draw(seed))["outcome"] for seed in range(first, first + 4)]
    assert set(outcomes) <= {"ended", "gave up"} and "ended" in outcomes


@pytest.mark.slow
def test_a_killed_scene_goes_on_to_the_same_bits():
    assert soak.kill_and_restart(24)["outcome"] == "restarted, ended"


def test_a_wrong_step_is_seen(monkeypatch):
    """An open ledger, a NaN, a loss that falls."""
    seed = next(s for s in range(99) if soak.draw(s)["kind"] == "heap")
    spec = soak.draw(seed) | {"steps": 5}
    build = soak.build
    for wrong, why in (
        ({"closure": 1.0}, "open by"),
        ({"kinetic": np.nan}, "not finite"),
        ({"dissipated_cohesion": lambda n: -1.0 * n, "closure": 0.0}, "a loss falls"),
    ):
        simulation = build(spec)
        steps = simulation.steps

        def broken(end, steps=steps, wrong=wrong):
            for number, step in enumerate(steps(end)):
                values = {k: v(number) if callable(v) else v for k, v in wrong.items()}
                yield step._replace(energies=step.energies | values)

        simulation.steps = broken
        monkeypatch.setattr(soak, "build", lambda spec, simulation=simulation: simulation)
        with pytest.raises(AssertionError, match=why):
            soak.run(spec)


def test_growth_of_memory_is_that_of_the_second_time():
    young = [100.0 + 20.0 * k for k in range(30)]
    assert soak.growth([*young, *(500.0 + 0.25 * k for k in range(30))]) == pytest.approx(0.25)
