# SPDX-License-Identifier: LGPL-3.0-or-later
"""Misuses of the public interface are heard of: `benchmarks/misuses.py` in one process."""

from __future__ import annotations

import logging

import numpy as np
import pytest
from misuse import BAD, Misuse, outcome
from misused_groups import GROUPS

import xper_fx as xf

# Its checkpoints take more than a second.
SLOW = ("records",)


@pytest.mark.parametrize(
    "group", [pytest.param(g, marks=[pytest.mark.slow] * (g in SLOW)) for g in GROUPS]
)
def test_misuses_are_heard_of(group, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = {misuse.name: outcome(misuse) for misuse in GROUPS[group]()}
    assert {name: told for name, (kind, told) in found.items() if kind in BAD} == {}


def test_there_are_some():
    misuses = [misuse.name for make in GROUPS.values() for misuse in make()]
    assert len(misuses) > 1500


def test_the_judge_knows_what_is_clear():
    """An error of NumPy, one with other words, nothing and too much are not."""
    logger = logging.getLogger("xper_fx.test")
    cases = {
        "silent": Misuse("", "a", lambda: None),
        "obscure": Misuse("", "shapes", lambda: np.zeros(2) + np.zeros(3)),
        "obscure ": Misuse("", "height", lambda: xf.rigid.Disc(-1.0)),
        "obscure  ": Misuse("", "a", lambda: [logger.warning("a") for _ in range(50)]),
        "warned": Misuse("", "a & b", lambda: logger.warning("b, a")),
        "clear": Misuse("", "radius & -1", lambda: xf.rigid.Disc(-1.0)),
    }
    for kind, misuse in cases.items():
        assert outcome(misuse).kind == kind.strip()
