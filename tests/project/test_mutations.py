# SPDX-License-Identifier: LGPL-3.0-or-later
"""The list of mutations (`benchmarks/mutations.toml`) fits the code; the script breaks as told."""

from __future__ import annotations

import shlex
import sys
from collections import Counter
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(CHECKOUT / "benchmarks"))
import mutations  # noqa: E402

LISTED = mutations.listed()

TEXT = """\
class One:
    def read(
        self,
    ):
        x = 1
        return x

    def write(self):
        x = 1


def read_all():
    x = 1
"""


@pytest.mark.parametrize(
    "mutation", LISTED, ids=[f"{n} {m.file}" for n, m in enumerate(LISTED, start=1)]
)
def test_every_mutation_applies_once_and_is_python(mutation):
    text = (CHECKOUT / "xper_fx" / mutation.file).read_text()
    broken = mutation.broken(text)
    assert broken != text
    compile(broken, mutation.file, "exec")
    assert mutation.breaks and not mutation.breaks.endswith(".")


def test_every_mutation_names_tests_that_there_are():
    for mutation in LISTED:
        words = shlex.split(mutation.tests)
        if "-k" in words:
            # pytest takes the last -k for all paths
            assert words.count("-k") == 1 and words[-2] == "-k", mutation.tests
            words = words[:-2]
        for path in words:
            assert (CHECKOUT / path).is_file(), mutation.tests


def test_no_mutation_comes_twice_and_there_are_many():
    told = Counter((m.file, m.inside, m.line, m.becomes) for m in LISTED)
    assert max(told.values()) == 1
    assert len(LISTED) >= 120
    assert len({(m.file, m.breaks) for m in LISTED}) == len(LISTED)


@pytest.mark.parametrize("number, inside", enumerate(["def read(", "def write(", "def read_all"]))
def test_a_line_is_broken_within_its_function_alone(number, inside):
    parts = TEXT.split("x = 1")
    expected = "x = 1".join(parts[: number + 1]) + "x = 2" + "x = 1".join(parts[number + 1 :])
    assert mutations.Mutation("", "x = 1", "x = 2", "", "", inside).broken(TEXT) == expected


@pytest.mark.parametrize(
    "line, inside", [("x = 1", ""), ("x = 3", ""), ("return x", "def write("), ("x", "def none")]
)
def test_a_line_that_is_not_there_once_is_told(line, inside):
    with pytest.raises(mutations.DoesNotApplyError):
        mutations.Mutation("", line, "", "", "", inside).broken(TEXT)
