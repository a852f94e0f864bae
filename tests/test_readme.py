# SPDX-License-Identifier: LGPL-3.0-or-later
"""The README's example runs as pasted, and its pictures exist."""

import re
from pathlib import Path

import numpy as np

from xper_fx.effects import EFFECTS

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


EXAMPLES = re.findall(r"```python\n(.*?)```", README, re.DOTALL)


def test_the_contact_problem_runs():
    names = {}
    exec(EXAMPLES[2], names)
    reaction, velocity = names["result"].reaction, names["result"].velocity
    # both corners slide to the right, the front one carries more; momentum before and after
    normal, tangential = reaction[::2], reaction[1::2]
    assert names["result"].converged and len(EXAMPLES) == 4
    np.testing.assert_allclose(tangential, 0.3 * normal, rtol=1e-8)
    np.testing.assert_allclose(normal.sum(), 0.1, rtol=1e-8)
    np.testing.assert_allclose(velocity, [0.0, -0.17, 0.0, -0.17], atol=1e-9)
    assert normal[1] > normal[0] > 0.0


def test_the_periodic_cell_runs():
    """524.7 MPa at 1 %, nothing sideways."""
    names = {}
    exec(EXAMPLES[1], names)
    stress = names["simulation"].macroscopic.stress
    np.testing.assert_allclose(stress[0, 0], 524.7e6, rtol=1e-3)
    assert abs(stress[1, 1]) < 1e-6 * stress[0, 0]


def test_the_disc_rolls():
    """Down the slope by g sin(slope) t^2 / 3."""
    names = {}
    exec(EXAMPLES[3], names)
    place = names["simulation"].rigid.state.position[1]
    along = (2.0 * place[0] - place[1]) / 5**0.5
    np.testing.assert_allclose(along, 9.81 / 5**0.5 * 0.5**2 / 3.0, rtol=1e-2)
    assert abs(names["step"].energies["closure"]) < 1e-10


def test_the_example_runs(capsys):
    names = {}
    exec(EXAMPLES[0], names)
    printed = capsys.readouterr().out
    time, stress, closure = (float(x) for x in printed.splitlines()[0].split())
    # E' eps with the artificial compliance of the bonds, -2 % at 5 um: 108 GPa * 0.2 %
    assert time >= 5e-8
    assert abs(stress - 2.1e8) < 0.1e8
    assert abs(closure) < 1e-10 * names["step"].energies["external_work"]
    assert "cohesive zone with friction" in printed


def test_the_table_of_effects_is_that_of_the_package():
    rows = re.findall(r"^\| ([^|]+) \| ([^|]+) \| ([^|]+) \| ([^|]+) \|$", README, re.MULTILINE)
    first = next(number for number, row in enumerate(rows) if row[0] == EFFECTS[0].name)
    for effect, (name, switch, code, holds) in zip(EFFECTS, rows[first:], strict=False):
        assert (name, switch, holds) == (effect.name, effect.switch, effect.holds or "-")
        assert code.count("`") == 2 * len(effect.code)


def test_pictures_and_files_named_exist():
    for path in re.findall(r"\]\((docs/[^)]+)\)", README):
        assert (ROOT / path).stat().st_size > 10_000, path
    for path in re.findall(r"`((?:demos|benchmarks|tests|nscd)/[\w/]+\.py)`", README):
        root = ROOT / "xper_fx" if path.startswith("nscd") else ROOT
        assert (root / path).is_file(), path
