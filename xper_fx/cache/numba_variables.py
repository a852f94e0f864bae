# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which variables instructions name and where they live, found when asked: a tenth of compiling.

Numba finds the life of all variables of a function after each of its passes, a dozen times. What
lowering takes are those of the last one; others are kept as the blocks from which they are found.

It asks for the variables of an instruction a hundred thousand times a second, and goes through a
chain of tests for each of its parts. Which test holds depends on the part's type alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from numba.core import ir
from numba.core.postproc import PostProcessor, VariableLifetime
from numba.core.transforms import canonicalize_cfg


def _variable(part: ir.Var, found: list[ir.Var]) -> None:
    found.append(part)


def _instruction(part: ir.Inst, found: list[ir.Var]) -> None:
    found += part.list_vars()


def _sequence(part: Iterable, found: list[ir.Var]) -> None:
    for item in part:
        list_of = _LISTS[type(item)]
        if list_of is not None:
            list_of(item, found)


def _dictionary(part: dict, found: list[ir.Var]) -> None:
    _sequence(part.values(), found)


class _Lists(dict[type, Callable | None]):
    """How the variables of a part are listed, by its type; None if it has none."""

    def __missing__(self, kind: type) -> Callable | None:
        for base, list_of in (
            (ir.Var, _variable), (ir.Inst, _instruction), ((list, tuple), _sequence),
            (dict, _dictionary),
        ):  # fmt: skip
            if issubclass(kind, base):
                return self.setdefault(kind, list_of)
        return self.setdefault(kind, None)


_LISTS = _Lists()


def list_by_type() -> None:
    """Let Numba list variables in this way, from now on, in this process."""

    def _rec_list_vars(instruction: ir.Inst, part) -> list[ir.Var]:
        found: list[ir.Var] = []
        _sequence((part,), found)
        return found

    ir.Inst._rec_list_vars = _rec_list_vars


def find_lives_when_asked() -> None:
    """Let Numba find the life of variables when it needs it, from now on, in this process."""
    find = PostProcessor.run

    def run(post: PostProcessor, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
        function = post.func_ir
        if emit_dels or function.is_generator:
            find(post, emit_dels, extend_lifetimes)
            return
        function.blocks = canonicalize_cfg(function.blocks)
        blocks = {label: block.copy() for label, block in function.blocks.items()}
        function.variable_lifetime = VariableLifetime(blocks)
        function.generator_info = None

    PostProcessor.run = run
