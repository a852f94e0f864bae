# SPDX-License-Identifier: LGPL-3.0-or-later
"""Calls of kernels by their address, whose arguments are bound before.

A kernel that names those it calls is compiled again for each of their combinations, and so are the
loops in it. One that is given calls ready to be made is compiled once, and never again for the law
that somebody writes tomorrow.

A call is a row of 64 bit words: the address of a function without arguments of its own, then the
arguments of the kernel, which this function reads there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, partial

import numpy as np
from numba import config, types
from numba.core.cgutils import ir
from numba.extending import intrinsic

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY

# Words of the arguments of a call; those of an array are 5 and 2 for each of its dimensions.
_WORDS = 1024


def _types():
    """The address of anything, and a function that is given one (LLVM)."""
    address = ir.IntType(8).as_pointer()
    return address, ir.FunctionType(ir.VoidType(), [address])


def _borrowed(context, builder, kind, value):
    """The value, whose arrays count no references."""
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        array.meminfo, array.parent = array.meminfo.type(None), array.parent.type(None)
        return array._getvalue()
    if isinstance(kind, types.BaseTuple):
        for place, part in enumerate(kind.types):
            item = _borrowed(context, builder, part, builder.extract_value(value, place))
            value = builder.insert_value(value, item, place)
    return value


@intrinsic
def _bind(typing_context, kernel, arguments, call):
    """Make a row of calls that of a kernel with these arguments."""
    signature = kernel.get_call_type(typing_context, arguments.types, {})

    def generate(context, builder, bind_signature, values):
        compiled = kernel.dispatcher.overloads[signature.args]
        context.active_code_library.add_linking_library(compiled.library)
        given = _borrowed(context, builder, arguments, values[1])
        size = context.get_abi_sizeof(given.type)
        if size > 8 * _WORDS:
            raise ValueError(
                f"The arrays of a law and its points are described by {size} bytes; at most "
                f"{8 * _WORDS} are foreseen. Put parameters that do not vary into numbers."
            )
        row = context.make_array(call)(context, builder, values[2]).data
        block = builder.gep(row, [context.get_constant(types.intp, 1)])
        builder.store(given, builder.bitcast(block, given.type.as_pointer()), align=8)

        name = builder.module.get_unique_name(f"{compiled.fndesc.llvm_func_name}.bound")
        bound = ir.Function(builder.module, _types()[1], name)
        bound.linkage = "internal"
        inside = ir.IRBuilder(bound.append_basic_block())
        block = inside.bitcast(bound.args[0], given.type.as_pointer())
        zero, count = ir.IntType(32)(0), len(arguments.types)
        places = [inside.gep(block, [zero, ir.IntType(32)(n)], inbounds=True) for n in range(count)]
        read = [inside.load(place) for place in places]
        callee = context.declare_function(builder.module, compiled.fndesc)
        context.call_conv.call_function(inside, callee, types.none, signature.args, read)
        inside.ret_void()
        builder.store(builder.ptrtoint(bound, ir.IntType(64)), row)
        return context.get_dummy_value()

    return types.none(kernel, arguments, call), generate


@intrinsic
def _make(typing_context, calls, number):
    """Make the call of a row."""

    def generate(context, builder, signature, values):
        words = context.get_constant(types.intp, 1 + _WORDS)
        data = context.make_array(calls)(context, builder, values[0]).data
        row = builder.gep(data, [builder.mul(values[1], words)])
        one = context.get_constant(types.intp, 1)
        address, call = _types()
        function = builder.inttoptr(builder.load(row), call.as_pointer())
        builder.call(function, [builder.bitcast(builder.gep(row, [one]), address)])
        return context.get_dummy_value()

    return types.none(calls, types.intp), generate


@cache
def _binding(kernel: Callable):
    @njit(**LEAN_ENTRY)
    def bind(call, arguments):
        _bind(kernel, arguments, call)

    return bind


def bind_calls(kernels: Sequence[Callable], arguments: Sequence[tuple]) -> np.ndarray | list:
    """Calls of kernels that return nothing, for `make_call`.

    Args:
        kernels: from `xper_fx.cache.njit`; they raise nothing.
        arguments: of each kernel. Whoever makes the calls holds their arrays, which are not copied
            and whose references are not counted.

    Raises:
        ValueError: arguments take more than 8 kB to describe.
    """
    if config.DISABLE_JIT:
        return [partial(kernel, *given) for kernel, given in zip(kernels, arguments, strict=True)]
    calls = np.empty((len(kernels), 1 + _WORDS), np.int64)
    for call, kernel, given in zip(calls, kernels, arguments, strict=True):
        _binding(kernel)(call, given)
    return calls


if config.DISABLE_JIT:

    def make_call(calls, number):
        """Make one of the calls."""
        calls[number]()

else:

    @njit(forceinline=True, **LEAN_ENTRY)
    def make_call(calls, number):
        """Make one of the calls."""
        _make(calls, number)
