# SPDX-License-Identifier: LGPL-3.0-or-later
"""Variables of instructions and their lives are those that Numba finds, found less often."""

import numpy as np
import pytest
from numba import njit
from numba.core import analysis, ir, postproc
from numba.core.compiler import run_frontend

import xper_fx.cache  # noqa: F401 - from here on they are found when asked


def sums(x, *more, scale=2.0):
    """With what makes instructions: calls, tuples, slices, a loop, a branch, a dictionary."""
    total = {"sum": 0.0, "count": len(x)}
    for i in range(1, len(x)):
        if x[i] > scale and not (i, scale) == (3, x[0]):
            total["sum"] += float(x[i:, None].sum(axis=0)[0]) * max(*more, scale)
    return total


def listed(part):
    """As Numba's `Inst._rec_list_vars` does."""
    if isinstance(part, ir.Var):
        return [part]
    if isinstance(part, ir.Inst):
        return listed(part._kws if isinstance(part, ir.Expr) else vars(part))
    if isinstance(part, dict):
        part = list(part.values())
    if isinstance(part, list | tuple):
        return [found for item in part for found in listed(item)]
    return []


def test_variables_of_instructions():
    function = run_frontend(sums)
    instructions = [found for block in function.blocks.values() for found in block.body]
    assert len(instructions) > 50
    for found in instructions:
        assert found.list_vars() == (
            [found.value] if isinstance(found, ir.Yield) else listed(found)
        ), str(found)
    names = [var.name for found in instructions for var in found.list_vars()]
    assert {"x", "more", "scale", "total", "i"} <= set(names)


@pytest.mark.parametrize("emit_dels", [False, True])
def test_lives_are_those_of_the_blocks_at_that_time(emit_dels):
    function = run_frontend(sums)
    postproc.PostProcessor(function).run(emit_dels)
    blocks = {label: block.copy() for label, block in function.blocks.items()}
    for block in function.blocks.values():
        block.body = [found for found in block.body if isinstance(found, ir.Terminator)]
    lives = function.variable_lifetime
    uses = analysis.compute_use_defs(blocks)
    cfg = analysis.compute_cfg_from_blocks(blocks)
    assert lives.livemap == analysis.compute_live_map(cfg, blocks, uses.usemap, uses.defmap)
    assert any("total" in names for names in lives.livemap.values())


def test_lives_are_found_for_lowering_alone(monkeypatch):
    found = []
    find = analysis.compute_live_map

    def count(*given):
        found.append(given)
        return find(*given)

    monkeypatch.setattr(analysis, "compute_live_map", count)

    @njit
    def total(x):
        s = 0.0
        for i in range(len(x)):
            s += x[i]
        return s

    assert total(np.full(3, 2.0)) == 6.0
    assert 1 <= len(found) <= 3  # a dozen otherwise
