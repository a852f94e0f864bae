# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where variables of a kernel live, found when it is asked for: an eighth of the time of compiling.

After each of some eight passes over a function Numba finds out from where to where each of its
variables lives. Two of the passes need it, those that write where variables end. Where a function
has a `with` or a loop over a tuple of several types, other passes read it while they change the
function: then it is found at once, as by Numba.
"""

from __future__ import annotations

from numba.core import ir
from numba.core.analysis import compute_live_variables
from numba.core.postproc import PostProcessor, VariableLifetime
from numba.core.transforms import canonicalize_cfg
from numba.misc.special import literal_unroll

_NAMED = (ir.Global, ir.FreeVar)


class _AtEntry(dict):
    """Names of the variables that live where a block begins, by block."""

    def __init__(self, blocks: dict[int, ir.Block], lifetime: VariableLifetime):
        super().__init__()
        self._blocks, self._lifetime = blocks, lifetime

    def __missing__(self, block: ir.Block) -> set[str]:
        lifetime = self._lifetime
        names = compute_live_variables(
            lifetime.cfg, self._blocks, lifetime.usedefs.defmap, lifetime.deadmaps.combined
        )
        self.update((each, names[offset]) for offset, each in self._blocks.items())
        return self[block]


def _is_changed_by(blocks: dict[int, ir.Block]) -> bool:
    """Whether a pass reads where variables live while it changes the function."""
    for block in blocks.values():
        for statement in block.body:
            if isinstance(statement, ir.EnterWith):
                return True
            if isinstance(statement, ir.Assign) and isinstance(statement.value, _NAMED):
                if statement.value.value is literal_unroll:
                    return True
    return False


def look_when_asked() -> None:
    """Let Numba find where variables live when it needs it, from now on, in this process."""
    at_once = PostProcessor.run

    def run(processor: PostProcessor, emit_dels: bool = False, extend_lifetimes: bool = False):
        function = processor.func_ir
        # a generator keeps what lives where it yields
        if function.is_generator or _is_changed_by(function.blocks):
            at_once(processor, emit_dels, extend_lifetimes)
            return
        function.blocks = canonicalize_cfg(function.blocks)
        function.variable_lifetime = lifetime = VariableLifetime(function.blocks)
        function.block_entry_vars = _AtEntry(function.blocks, lifetime)
        function.generator_info = None
        if emit_dels:
            processor._insert_var_dels(extend_lifetimes=extend_lifetimes)

    PostProcessor.run = run
