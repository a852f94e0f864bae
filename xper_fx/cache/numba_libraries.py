# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kept machine code, loaded without the code that callers link: a quarter of the time of loading.

Numba keeps with a kernel's machine code its code for LLVM, which a caller that is compiled merges,
and parses it whenever the kernel is loaded. Here it is parsed when such a caller is compiled.
"""

from __future__ import annotations

from llvmlite import binding
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompileResult

_KIND = "xper_fx"


def reduced(result: CompileResult) -> tuple:
    """A compiled kernel as it is kept, for `CompileResult._rebuild`."""
    (name, _, (machine_code, for_callers)), *others = result._reduce()
    module = result.library._get_module_for_linking()
    symbols = [
        symbol.name
        for kind in (module.functions, module.global_variables)
        for symbol in kind
        if not symbol.is_declaration
    ]
    return (name, _KIND, (machine_code, for_callers, symbols)), *others


class _KeptLibrary(JITCodeLibrary):
    """A library whose code for callers is parsed when there is one."""

    _for_callers = b""
    _shared_module: binding.ModuleRef | None

    def _get_module_for_linking(self):
        if self._shared_module is None:
            self._shared_module = binding.parse_bitcode(self._for_callers)
        return self._shared_module


def parse_when_linked() -> None:
    """Let Numba load what `reduced` gives, from now on, in this process."""
    unserialize = JITCodeLibrary._unserialize

    def load(codegen, state: tuple) -> JITCodeLibrary:
        name, kind, data = state
        if kind != _KIND:
            return unserialize(codegen, state)
        library = _KeptLibrary(codegen, name)
        machine_code, library._for_callers, symbols = data
        library.enable_object_caching()
        library._set_compiled_object(machine_code)
        library._finalize_final_module()
        codegen._engine._defined_symbols.update(symbols)
        return library

    JITCodeLibrary._unserialize = staticmethod(load)
