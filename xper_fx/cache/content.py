# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a kernel is made of: a digest of a function's content and of all that it reaches.

The content is byte code, constants, defaults, closure cells and globals, followed through every
function, kernel, intrinsic and overload that they name. Paths, line numbers, times and identities
are not content: the same source in another folder has the same digest. What belongs to Python,
NumPy, Numba or llvmlite stands for itself by name: their versions are part of a kernel's key.

A kernel of plain `numba.njit` may have been compiled by another caller, with that caller's options:
its content is then unknown. A method that `numba.extending.overload_method` gives to a type is not
followed.
"""

from __future__ import annotations

import enum
import sys
from collections.abc import Iterator
from functools import cache
from hashlib import sha256
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numba.core import types
from numba.core.dispatcher import Dispatcher
from numba.core.typing.templates import builtin_registry
from numba.extending import _Intrinsic

_VERSIONED = frozenset(sys.stdlib_module_names) | {"numpy", "numba", "llvmlite"}
_PLAIN = (bool, int, float, complex, str, bytes, type(None), type(Ellipsis), slice, range)
_PARTS_OF_CODE = (
    "co_code", "co_exceptiontable", "co_flags", "co_name", "co_argcount", "co_posonlyargcount",
    "co_kwonlyargcount", "co_names", "co_varnames", "co_freevars", "co_cellvars",
)  # fmt: skip


# Options that a kernel takes from the one that compiles it unless they are given, and what they are
# where nobody gives them.
INHERITED = {"fastmath": False, "error_model": "python", "forceinline": False, "_nrt": True}


class UnknownContentError(TypeError):
    """A kernel reaches an object, and what Numba makes of it cannot be told from the object."""


def digest(*values) -> str:
    """Digest of the content of functions, kernels, Numba types and plain values.

    Returns:
        64 hexadecimal digits.

    Raises:
        UnknownContentError: an object is reached that has no known content.
    """
    reader = _Reader()
    reader.read(values)
    return reader.hash.hexdigest()


def functions_of(kernel: Dispatcher) -> list[FunctionType]:
    """A kernel's function and all functions that its content reaches.

    Raises:
        UnknownContentError: an object is reached that has no known content.
    """
    reader = _Reader()
    reader.read(kernel)
    return [thing for _, thing in reader.met.values() if isinstance(thing, FunctionType)]


def _is_versioned(module: Any) -> bool:
    return isinstance(module, str) and module.partition(".")[0] in _VERSIONED


def _codes(code: CodeType) -> Iterator[CodeType]:
    """A function's code and that of the functions defined in it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


@cache
def _names(code: CodeType) -> tuple[str, ...]:
    """Names of globals and attributes in a code, sorted."""
    return tuple(sorted({name for part in _codes(code) for name in part.co_names}))


class _Reader:
    """Feeds the content of objects to a hash."""

    def __init__(self):
        self.hash = sha256()
        # Functions and modules met, by identity; held, so that no other one gets the same identity.
        self.met: dict[int, tuple[int, Any]] = {}

    def _tell(self, *words) -> None:
        self.hash.update(f"{words!r}\n".encode())

    def read(self, value: Any) -> None:
        """Tell the hash what a value is."""
        if isinstance(value, enum.Enum):
            self._tell("member", type(value).__module__, type(value).__qualname__, value.name)
            self.read(value.value)
        elif isinstance(value, _PLAIN):
            self._tell(type(value).__name__, value)
        elif isinstance(value, (tuple, list)):
            kind = type(value)
            fields = getattr(kind, "_fields", None)  # of a named tuple
            self._tell(kind.__module__, kind.__qualname__, fields, len(value))
            for item in value:
                self.read(item)
        elif isinstance(value, (set, frozenset)):
            self._tell("set", sorted(map(repr, value)))
        elif isinstance(value, dict):
            self._tell("dict", len(value))
            for key in sorted(value, key=repr):
                self.read(key)
                self.read(value[key])
        elif isinstance(value, (np.ndarray, np.generic)) and not value.dtype.hasobject:
            order = value.flags.c_contiguous, value.flags.f_contiguous
            self._tell("array", repr(value.dtype), value.shape, order)
            self.hash.update(value.tobytes())
        elif isinstance(value, CodeType):
            self._read_code(value)
        elif isinstance(value, types.Type):
            self._read_type(value)
        elif isinstance(value, Dispatcher):
            self._read_kernel(value)
        elif isinstance(value, _Intrinsic):
            self._tell("intrinsic")
            self._read_function(value._defn)
        elif isinstance(value, FunctionType):
            self._read_plain_function(value)
        else:
            self._read_named(value)

    def _read_kernel(self, kernel: Dispatcher) -> None:
        self._tell("kernel")
        if kernel.overloads and not INHERITED.keys() <= kernel.targetoptions.keys():
            raise UnknownContentError(f"{kernel!r} has options of a kernel that called it before.")
        self.read(kernel.targetoptions)
        self.read(kernel.locals)
        self._read_function(kernel.py_func)

    def _read_plain_function(self, function: FunctionType) -> None:
        """A function that is no kernel: one of a library, overloaded, or called by an intrinsic."""
        home = function.__globals__.get("__name__")
        if _is_versioned(home) and vars(sys.modules.get(home)) is function.__globals__:
            self._tell("named", home, function.__qualname__)
            return
        self._read_function(function)
        for overloaded, kind in builtin_registry.globals:
            if overloaded is function:
                for template in kind.templates:
                    self.read(getattr(template, "_overload_func", None))

    def _read_function(self, function: FunctionType) -> None:
        met = self.met.get(id(function))
        if met is not None:
            self._tell("met", met[0])
            return
        self.met[id(function)] = (len(self.met), function)
        self._tell("function", function.__module__, function.__qualname__)
        self._read_code(function.__code__)
        self.read((function.__defaults__, function.__kwdefaults__))
        for cell in function.__closure__ or ():
            try:
                content = cell.cell_contents
            except ValueError:
                self._tell("empty")
            else:
                self.read(content)
        self._read_attributes(function.__globals__, _names(function.__code__))

    def _read_attributes(self, scope: dict[str, Any], names: tuple[str, ...]) -> None:
        """Those of the names that are in a scope: of globals, or of a module among them."""
        for name in names:
            if name not in scope:
                continue
            value = scope[name]
            self._tell("name", name)
            if not isinstance(value, ModuleType):
                self.read(value)
            elif _is_versioned(value.__name__):
                self._tell("module", value.__name__)
            elif id(value) not in self.met:
                self.met[id(value)] = (len(self.met), value)
                self._read_attributes(vars(value), names)

    def _read_code(self, code: CodeType) -> None:
        self._tell(*(getattr(code, part) for part in _PARTS_OF_CODE))
        self.read(code.co_consts)

    def _read_type(self, kind: types.Type) -> None:
        """A type of Numba's, of an argument or named in a kernel."""
        if isinstance(kind, types.Dispatcher):
            self.read(kind.dispatcher)
        elif isinstance(kind, types.BaseTuple):
            self._tell("tuple", len(kind))
            self.read(getattr(kind, "instance_class", None))
            for part in kind:
                self._read_type(part)
        elif isinstance(kind, (types.Number, types.Boolean, types.Literal, types.NoneType,
                               types.Omitted, types.UnicodeType, types.Buffer)):  # fmt: skip
            self._tell("type", str(kind))
        else:
            raise UnknownContentError(f"the type {kind} is not known.")

    def _read_named(self, value: Any) -> None:
        """A class, or what belongs to a library."""
        module, name = getattr(value, "__module__", None), getattr(value, "__qualname__", None)
        name = name or getattr(value, "__name__", None)  # NumPy's universal functions
        if isinstance(value, type):
            self._tell("class", module, name)
            self.read(getattr(value, "_fields", ()))
            if issubclass(value, enum.Enum):
                self.read({key: member.value for key, member in value.__members__.items()})
        elif isinstance(value, np.dtype):
            self._tell("dtype", repr(value))
        elif name is not None and (_is_versioned(module) or isinstance(value, np.ufunc)):
            self._tell("named", module, name)
        else:
            raise UnknownContentError(f"{value!r} of type {type(value).__qualname__} is not known.")
