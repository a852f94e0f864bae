# SPDX-License-Identifier: LGPL-3.0-or-later
"""Small runs of the demos that cut solids: a crack in 3D, perfect bonds as domain decomposition."""

import csv
import json
import sys
from pathlib import Path

import numpy as np
import pytest

from xper_fx.output.history import read_history

sys.path.insert(0, str(Path(__file__).parents[2] / "demos"))

import fracture_3d  # noqa: E402
import subdomains  # noqa: E402

pytestmark = pytest.mark.demos


def test_a_tilted_slit_grows_until_the_bar_is_through(tmp_path):
    """The crack spends at least its energy, and no impulse or energy gets lost on the way."""
    out = tmp_path / "out"
    fracture_3d.main(f"--facet 3e-3 --no-plot --quiet --threads 1 --out {out}".split())
    summary, history = (
        json.loads((out / "summary.json").read_text()),
        read_history(out / "history.csv"),
    )
    # ligament of a bar of 10 mm x 10 mm whose slit takes a part of the section
    assert 0.4e-4 < summary["crack_area"] < 1.1e-4
    assert 1e6 < summary["peak_stress"] < 1e8
    spent = history["dissipated_cohesion"]
    assert np.all(np.diff(spent) >= 0.0)
    # facets that are broken through have spent w; others a part of it
    assert 1.0 <= spent[-1] / (fracture_3d.FRACTURE_ENERGY * summary["crack_area"]) < 1.2
    assert np.abs(history["closure"]).max() < 1e-3 * history["external_work"][-1]


def test_subdomains_find_the_field_of_one_body(tmp_path):
    """Iterations grow with the number of subdomains only where the coarse space is left out."""
    out = tmp_path / "out"
    options = f"--plate-cells 16 --block-cells 4 --subdomains 4 16 --quiet --no-plot --out {out}"
    subdomains.main(options.split())
    with open(out / "iterations.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 12
    assert max(float(row["error"]) for row in rows) < 1e-9
    few, many = rows[:2]  # of the static plate
    # how fast they grow depends on the partition, so on SCOTCH's version
    grown, without = (int(many[name]) / int(few[name]) for name in ("with", "without"))
    assert without > 3.0 and grown < 0.75 * without
    assert 2 * int(many["with"]) < int(many["without"])
