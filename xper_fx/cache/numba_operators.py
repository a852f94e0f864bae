# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numba's choice among the versions of an operator, made once: a tenth of the time of compiling.

For each operator in a kernel (`a * b`, `x[i]`, `len(x)`) Numba goes through some twenty templates,
those of NumPy's arrays and of strings first, several times while it infers types and again while it
lowers. What it chooses for numbers, arrays and their indices depends on the operator and on the
types alone; it is kept here for as long as the operator has the same templates.
"""

from __future__ import annotations

import operator

from numba.core import types
from numba.core.types.functions import BaseFunction

_CHOSEN_ONCE = frozenset(filter(callable, vars(operator).values())) | {bool, len, range}
_PLAIN = (types.Number, types.Boolean, types.Array, types.BaseTuple)


def choose_once() -> None:
    """Let Numba keep what it has chosen, from now on, in this process."""
    choose = BaseFunction.get_call_type

    def get_call_type(function: BaseFunction, context, args: tuple, kws: dict):
        plain = all(isinstance(kind, _PLAIN) for kind in args)
        if kws or not plain or function.typing_key not in _CHOSEN_ONCE:
            return choose(function, context, args, kws)
        # Numba makes another function where it adds templates to an operator
        chosen = function.__dict__.setdefault("_chosen", {})
        key = (context, *args)
        if key not in chosen:
            chosen[key] = choose(function, context, args, kws)
        return chosen[key]

    BaseFunction.get_call_type = get_call_type
