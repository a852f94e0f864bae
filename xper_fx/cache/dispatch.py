# SPDX-License-Identifier: LGPL-3.0-or-later
"""`njit` of kernels whose compiled code is kept between processes."""

from __future__ import annotations

import gc
import logging
import os
import pickle
import secrets
import sys
from collections.abc import Callable
from itertools import count

import llvmlite
import numba
import numpy as np
from llvmlite.binding import ffi
from numba.core import config, event, serialize, sigutils, types
from numba.core.bytecode import FunctionIdentity
from numba.core.compiler import CompileResult
from numba.core.dispatcher import Dispatcher
from numba.core.runtime import rtsys

from xper_fx.cache.compiling import KIND
from xper_fx.cache.content import INHERITED, UnknownContentError, digest
from xper_fx.cache.folder import kernel_folder
from xper_fx.cache.numba_flags import compare_at_once
from xper_fx.cache.numba_libraries import (
    finds_by_address,
    make_code_when_asked,
    parse_when_linked,
    reduced,
)
from xper_fx.cache.numba_operators import choose_once
from xper_fx.cache.numba_variables import find_lives_when_asked, list_by_type

logger = logging.getLogger("xper_fx.cache")

_VERSIONS = (
    sys.implementation.name,
    sys.version_info[:3],
    numba.__version__,
    llvmlite.__version__,
    np.__version__,
)
# Settings of Numba that change no code.
_NO_CODE = frozenset(
    {"CACHE_DIR", "NUMBA_NUM_THREADS", "NUMBA_DEFAULT_NUM_THREADS", "IS_32BITS", "SHOW_HELP",
     "CAPTURED_ERRORS", "DISABLE_PERFORMANCE_WARNINGS", "FUNCTION_CACHE_SIZE"}
)  # fmt: skip
_FIRST_NUMBER = 1 << 60


def _number_functions() -> None:
    """Let Numba number functions from a random place on.

    The number is part of the symbols in machine code. Numba counts from 1 in each process: code
    that another process has compiled would define the same symbols for other functions.
    """
    FunctionIdentity._unique_ids = count(_FIRST_NUMBER + secrets.randbits(60))


def _tell_no_locks() -> None:
    """Let Numba time no call of LLVM: it tells each compilation in progress of all 35 000."""
    told = ffi.lib._lock._cblist
    told[:] = [pair for pair in told if pair[0].__module__ != "numba.core.base"]


compare_at_once()
choose_once()
find_lives_when_asked()
list_by_type()
make_code_when_asked()
parse_when_linked()
_tell_no_locks()
_number_functions()
os.register_at_fork(after_in_child=_number_functions)


def njit(function: Callable | None = None, **options) -> Callable:
    """`numba.njit`, and what it compiles is kept for the processes to come.

    A kernel is compiled with its own options alone. (With Numba's, one that leaves `fastmath`,
    `error_model`, `forceinline` or `_nrt` open takes those of the kernel that happens to compile it
    first: its code would depend on the order of compilation.) Signed integers that a
    kernel hands to another one are int64 there, of whatever size they were.

    Args:
        function: to be compiled; without it a decorator is returned.
        options: of `numba.njit`. Not `cache`, which finds nothing again of kernels that call
            other kernels.

    Returns:
        The compiled function, or with `NUMBA_DISABLE_JIT=1` the function itself.

    Raises:
        TypeError: no function.
    """
    if function is not None and not callable(function):
        raise TypeError(f"njit compiles a function, got {function!r}.")
    if function is None:
        return lambda given: njit(given, **options)
    kernel = numba.njit(**(INHERITED | options))(function)
    if isinstance(kernel, Dispatcher):
        kernel._cache = _Kept(kernel)
        kernel.get_call_template = _for_plain_integers(kernel.get_call_template)
    return kernel


def _for_plain_integers(template_of: Callable) -> Callable:
    """What kernels ask a kernel that they call: one version serves all signed integers.

    Numba would compile a version for int64, one for the entries of an int32 array, and one for a
    variable that is 0 before a loop (a literal), even if it is another number after it. Unsigned
    ones stay: indices that are known not to be negative make faster code.
    """

    def plain(kind: types.Type) -> types.Type:
        kind = types.unliteral(kind)
        return types.int64 if kind in types.signed_domain else kind

    def get_call_template(args: tuple, kws: dict[str, types.Type]):
        return template_of(
            tuple(map(plain, args)), {name: plain(kind) for name, kind in kws.items()}
        )

    return get_call_template


class _Kept:
    """What a Numba dispatcher asks before it compiles, and tells after."""

    cache_path = None

    def __init__(self, kernel: Dispatcher):
        self._kernel = kernel
        self._keys: dict[tuple, str] = {}  # of argument types that are being compiled

    def load_overload(self, signature, context) -> CompileResult | None:
        """The compiled kernel for a signature, if it is kept.

        It needs memory that counts its references and no more: what Numba knows of functions and
        types, a fifth of a start, is loaded when something is compiled.
        """
        rtsys.initialize(context)
        folder = kernel_folder()
        if folder is None:
            return None
        arguments, _ = sigutils.normalize_signature(signature)
        try:
            key = _key(self._kernel, arguments, context)
        except UnknownContentError as reason:
            logger.debug("%s is not kept: %s", self._kernel.py_func.__qualname__, reason)
            return None
        result = self._read(key, arguments, context)
        if result is None and folder.lock(key):
            result = self._read(key, arguments, context)
        if result is None:
            self._keys[arguments] = key
        else:
            folder.unlock(key)
        return result

    def _read(self, key: str, arguments: tuple, context) -> CompileResult | None:
        content = kernel_folder().read(key)
        if content is None:
            return None
        try:
            result = CompileResult._rebuild(context, *pickle.loads(content))
        except Exception as error:  # noqa: BLE001 - whatever it is, the kernel can be compiled
            logger.info("A kept kernel cannot be loaded, and is compiled anew: %r", error)
            return None
        # a class that is known by value alone, such as one of an interactive session, is another
        return result if tuple(result.signature.args) == arguments else None

    def save_overload(self, signature, result: CompileResult) -> None:
        """Keep a kernel that was just compiled."""
        arguments, _ = sigutils.normalize_signature(signature)
        key = self._keys.pop(arguments, None)
        if key is None:
            return
        folder = kernel_folder()
        try:
            library = result.library
            if not (result.lifted or library.has_dynamic_globals or finds_by_address(library)):
                content = serialize.dumps(reduced(result))
                folder.write(key, result.fndesc.qualname, content)
        except Exception as error:  # noqa: BLE001 - of pickle: what a signature names may be local
            logger.debug("%s is not kept: %r", result.fndesc.qualname, error)
        finally:
            folder.unlock(key)

    def give_up(self, arguments: tuple) -> None:
        """Numba could not compile the kernel for these arguments."""
        key = self._keys.pop(arguments, None)
        if key is not None:
            kernel_folder().unlock(key)

    def enable(self) -> None:
        """Called by Numba; `XPER_FX_CACHE` decides."""

    disable = flush = enable


class _Compilation(event.Listener):
    """Compiles without looking for garbage, a seventh of the time, and gives up what failed.

    Numba makes very many objects that live until a kernel is ready. It compiles under a lock.
    """

    def __init__(self):
        self._depth = 0
        self._collects = False

    def on_start(self, event: event.Event) -> None:
        """Called by Numba."""
        if self._depth == 0:
            self._collects = gc.isenabled()
            gc.disable()
        self._depth += 1

    def on_end(self, event: event.Event) -> None:
        """Called by Numba."""
        self._depth -= 1
        if self._depth == 0 and self._collects:
            gc.enable()
        kernel, arguments = event.data["dispatcher"], tuple(event.data["args"])
        kept = getattr(kernel, "_cache", None)
        if isinstance(kept, _Kept) and arguments not in kernel.overloads:
            kept.give_up(arguments)


event.register(KIND, _Compilation())


def _key(kernel: Dispatcher, arguments: tuple, context) -> str:
    """Digest of all that the compiled code depends on."""
    settings = {
        name: repr(value)
        for name, value in vars(config).items()
        if name.isupper() and name not in _NO_CODE
    }
    return digest(_VERSIONS, context.codegen().magic_tuple(), settings, arguments, kernel)
