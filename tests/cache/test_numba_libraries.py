# SPDX-License-Identifier: LGPL-3.0-or-later
"""Machine code is made of what is run, and what callers link works as it did."""

import os
import subprocess
import sys
import textwrap

import pytest
from numba import njit
from numba.core import event

from xper_fx.cache import CacheFolder
from xper_fx.cache.numba_libraries import reduced


def machine_code(kernel) -> bytes:
    """What is kept of it for a kernel's only version."""
    (result,) = kernel.overloads.values()
    (_, _, (code, for_callers, symbols)), *_ = reduced(result)
    assert for_callers and bool(symbols) == bool(code)
    return code


def test_what_only_kernels_call_has_no_machine_code():
    @njit(no_cpython_wrapper=True, no_cfunc_wrapper=True)
    def inner(x):
        return x * x

    @njit
    def outer(x):
        return inner(x) + 1.0

    assert outer(3.0) == 10.0
    assert machine_code(inner) == b"" and len(machine_code(outer)) > 1000
    # asked for, it is made
    (result,) = inner.overloads.values()
    assert result.library.get_pointer_to_function("no such function") == 0
    assert machine_code(inner) == b""
    assert result.library.get_pointer_to_function(result.fndesc.llvm_func_name) != 0
    assert len(machine_code(inner)) > 100


def test_calls_of_llvm_are_not_told():
    told = []

    class Listener(event.Listener):
        def on_start(self, event):
            told.append(event.kind)

        def on_end(self, event):
            pass

    with (
        event.install_listener("numba:llvm_lock", Listener()),
        event.install_listener("numba:compile", Listener()),
    ):
        assert njit(lambda x: x + 1.0)(1.0) == 2.0
    assert told == ["numba:compile"]


SCRIPT = """
    import numba
    from numba import cfunc, types
    from xper_fx.cache import njit

    inner = njit(no_cpython_wrapper=True, no_cfunc_wrapper=True)

    @inner
    def deepest(n):
        if n == 3:
            raise ValueError("three is deep")
        if n == 4:
            raise KeyError("deep", n)
        print("at", n)
        return n + 1

    @inner
    def deeper(n):
        return 2 * deepest(n)

    @njit
    def top(n):
        return deeper(n)

    @njit
    def other_top(n):
        return deepest(n) + deeper(n + 10)

    @inner
    def odd(n):
        return False if n == 0 else even(n - 1)

    @inner
    def even(n):
        return True if n == 0 else odd(n - 1)

    @njit
    def is_even(n):
        return even(n)

    @njit
    def square(x):
        return x * x

    @njit
    def half(x):
        return 0.5 * x

    @njit
    def of_one(x):
        return square(x) + 1.0

    @njit
    def cube(x):
        return x * x * x

    @njit
    def of_cube(x):
        return cube(x) + 1.0

    number = types.float64
    any_function = types.FunctionType(number(number))

    @numba.njit(number(any_function, any_function, number))
    def of_any(first, second, x):
        return first(x) + second(x)

    @cfunc("float64(float64)")
    def for_c(x):
        return square(x) + half(x)

    print(top(1), other_top(0), flush=True)
    for call in (top, other_top):
        for n in (3, 4):
            try:
                call(n)
            except (ValueError, KeyError) as error:
                print(repr(error))
    print([is_even(n) for n in range(4)])
    print([call(3.0) for call in (square, of_one, of_cube, cube)])
    print(of_any(square, half, 3.0), for_c.ctypes(3.0))
"""
PRINTED = """\
at 1
at 0
at 10
4 23
ValueError('three is deep')
KeyError('deep', 4)
ValueError('three is deep')
KeyError('deep', 4)
[True, False, True, False]
[9.0, 10.0, 28.0, 27.0]
10.5 10.5
"""


@pytest.mark.slow
def test_callees_raise_print_and_call_each_other(tmp_path):
    """Compiled, and loaded by another process; functions that call each other are not kept.

    A kernel is called before its caller, and another one after.
    """
    script = textwrap.dedent(SCRIPT)
    # callers of their own, for which kept kernels are linked
    changed = script.replace("square(x) + 1.0", "1.0 + square(x)")
    changed = changed.replace("cube(x) + 1.0", "1.0 + cube(x)")
    changed = changed.replace("return deeper(n)\n", "return deeper(n) + 0\n")
    assert changed.count("return 1.0 + ") == 2 and changed.count("deeper(n) + 0") == 1
    for source in (script, script, changed):
        done = subprocess.run(
            [sys.executable, "-c", source], capture_output=True, text=True,
            env=os.environ | {"XPER_FX_CACHE": str(tmp_path / "kernels")}, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert done.stdout == PRINTED
    titles = {file.title for file in CacheFolder(tmp_path / "kernels").files()}
    assert {"top", "other_top", "deeper", "deepest", "square", "cube", "half"} <= titles
    assert not titles & {"odd", "even", "is_even"}


def test_numba_keeps_its_own_kernels(tmp_path, monkeypatch):
    """`numba.njit(cache=True)`, whose files Numba reads and writes."""
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    source = "import numba\n@numba.njit(cache=True)\ndef twice(x):\n    return x + x\n"
    (tmp_path / "of_a_test.py").write_text(source)
    script = (
        "import of_a_test, xper_fx.cache\n"
        "print(of_a_test.twice(2.5), sum(of_a_test.twice.stats.cache_hits.values()))"
    )
    for hits in range(2):
        path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
        out = subprocess.check_output(
            [sys.executable, "-c", script], text=True, env=os.environ | {"PYTHONPATH": path}
        )
        assert out.split() == ["5.0", str(hits)]
