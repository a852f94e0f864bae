# SPDX-License-Identifier: LGPL-3.0-or-later
"""Machine code of Numba's where it is run, code for callers where a kernel is compiled that calls.

Numba makes machine code of each kernel, also of those that only kernels call: they merge its code
for LLVM. Here a library gets machine code when somebody asks for the address of a function that it
defines, a twentieth of the time of compiling less.

Numba keeps with a kernel's machine code its code for LLVM, and parses it whenever the kernel is
loaded. Here it is parsed when a caller is compiled: loading takes a quarter of the time.
"""

from __future__ import annotations

from weakref import WeakValueDictionary

from llvmlite import binding
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen, RuntimeLinker
from numba.core.compiler import CompileResult
from numba.core.environment import Environment
from numba.core.runtime import rtsys

_KIND = "xper_fx"


def reduced(result: CompileResult) -> tuple:
    """A compiled kernel as it is kept, for `CompileResult._rebuild`.

    Without its source with the types of all variables, which Numba keeps for `inspect_types`.
    """
    bare = result._replace(type_annotation="")
    (name, _, (machine_code, for_callers)), *others = bare._reduce()
    module = result.library._get_module_for_linking()
    symbols = [
        symbol.name
        for kind in (module.functions, module.global_variables)
        for symbol in (kind if machine_code else ())
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


def finds_by_address(library: JITCodeLibrary) -> bool:
    """Whether functions of a library that call each other find one another by their addresses.

    These belong to the process.
    """
    variables = library._final_module.global_variables
    return any(variable.name.startswith(RuntimeLinker.PREFIX) for variable in variables)


def make_code_when_asked() -> None:
    """Let Numba make machine code of a library when a function in it is asked for, from now on.

    What a library knows of Python (`Environment`: objects that it prints, say) is told to machine
    code by its address; it is told to that of the first caller.
    """
    make_code = JITCodeLibrary._finalize_final_module
    address_of = JITCodeLibrary.get_pointer_to_function
    tell = JITCPUCodegen.set_env
    untold: WeakValueDictionary[str, Environment] = WeakValueDictionary()

    def finalize(library: JITCodeLibrary) -> None:
        if finds_by_address(library):
            # what is called as long as the other function has no address
            rtsys.library.get_pointer_to_function("nrt_unresolved_abort")
            make(library)
            return
        if getattr(library, "_compiled_object", None):
            make(library)
            return
        library._finalize_dynamic_globals()
        library._verify_declare_only_symbols()
        library._finalized = library._waits = True
        library._compiled_object = b""

    def make(library: JITCodeLibrary) -> None:
        library._waits = False
        make_code(library)
        for variable in library._final_module.global_variables:
            environment = untold.pop(variable.name, None)
            if environment is not None:
                tell(library.codegen, variable.name, environment)

    def get_pointer_to_function(library: JITCodeLibrary, name: str) -> int:
        library._ensure_finalized()
        defined = (function.name for function in library.get_defined_functions())
        if library._waits and name in defined:
            make(library)
        return address_of(library, name)

    def set_env(codegen: JITCPUCodegen, name: str, environment: Environment) -> None:
        if codegen._engine.is_symbol_defined(name):
            tell(codegen, name, environment)
        else:
            untold[name] = environment

    JITCodeLibrary._waits = False
    JITCodeLibrary._finalize_final_module = finalize
    JITCodeLibrary.get_pointer_to_function = get_pointer_to_function
    JITCPUCodegen.set_env = set_env
