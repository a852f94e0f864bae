# SPDX-License-Identifier: LGPL-3.0-or-later
"""The branching plate of the demo, coarse: the crack starts and runs, the ledger closes."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "demos"))
import dynamic_branching as demo

pytestmark = pytest.mark.demos


def test_the_crack_starts_and_stays_below_rayleighs_speed(tmp_path):
    options = f"--facet 1.5e-3 --end-time 50e-6 --threads 1 --quiet --fields 4 --out {tmp_path}"
    found = demo.main(options.split())
    assert 10.0 < found["starts_us"] < 20.0
    assert 0.4 < found["fastest_over_rayleigh"] < 0.8
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["starts_us"] == found["starts_us"]
    history = demo.xf.read_history(tmp_path / "history.csv")
    work = history["external_work"][-1]
    assert abs(history["closure"][-1]) < 1e-11 * work
    assert 0.02 * work < history["dissipated_cohesion"][-1] < 0.2 * work
    for name in ("branching.png", "energies.png", "bulk.xdmf", "interfaces.xdmf"):
        assert (tmp_path / name).stat().st_size > 0


def test_speed_is_the_mean_over_a_window():
    time = np.linspace(0.0, 50e-6, 101)
    assert demo.speeds(time, 700.0 * time)[10:-10] == pytest.approx(700.0)


@pytest.mark.parametrize("facet", ["0", "-1e-3", "3e-3"])
def test_facets_that_resolve_nothing_are_refused(facet, capsys):
    with pytest.raises(SystemExit):
        demo.parse([f"--facet={facet}"])
    assert "to resolve cracks" in capsys.readouterr().err
