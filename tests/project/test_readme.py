# SPDX-License-Identifier: LGPL-3.0-or-later
"""The README is a page, its example runs as pasted, and its pictures and links lead somewhere."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()

pytestmark = pytest.mark.skipif(not (ROOT / "docs").is_dir(), reason="not in a checkout")


def test_it_is_a_page():
    assert README.count("\n") <= 150


def test_the_example_runs(capsys):
    (example,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    names = {}
    exec(example, names)
    time, stress, closure = (float(x) for x in capsys.readouterr().out.split())
    # E' eps with the artificial compliance of the bonds, -2 % at 5 um: 108 GPa * 0.2 %
    assert time >= 5e-8
    assert abs(stress - 2.1e8) < 0.1e8
    assert abs(closure) < 1e-10 * names["step"].energies["external_work"]
    (imported,) = re.findall(r"import xper_fx.*\n+((?:.+\n)+)", example)
    assert imported.count("\n") <= 12


def test_pictures_and_files_named_exist():
    for path in re.findall(r"\]\(([\w/.]+)\)", README):
        assert (ROOT / path).is_file(), path
    for path in re.findall(r"!\[[^]]*\]\((docs/[^)]+)\)", README):
        assert (ROOT / path).stat().st_size > 10_000, path
    for path in re.findall(r"`((?:demos|benchmarks|tests)/[\w/]+(?:\.py|/))`?", README):
        assert (ROOT / path).exists(), path
