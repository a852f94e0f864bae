# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kernels kept between processes: found again by content, never for other content."""

from __future__ import annotations

import gc
import importlib.util
import itertools
import logging
import os
import pickle
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from llvmlite import binding
from numba.core import config
from numba.core.errors import TypingError

from xper_fx.cache import CacheFolder, folder, kernel_folder, njit
from xper_fx.cache.__main__ import main

SOURCE = """
    import enum
    from collections import namedtuple

    import numpy as np
    from numba import njit as plain, types
    from numba.extending import intrinsic, overload, register_jitable

    import constants
    from xper_fx.cache import njit

    SHIFT = 0.25
    TABLE = np.array([1.0, 2.0])
    Pair = namedtuple("Pair", "x y")

    class Kind(enum.IntEnum):
        FIRST = 7

    @intrinsic
    def one_more(context, x):
        def generate(context, builder, signature, arguments):
            return builder.fadd(arguments[0], context.get_constant(types.float64, 1.0))
        return types.float64(types.float64), generate

    def overloaded(x):
        pass

    @overload(overloaded)
    def _overloaded(x):
        def apply(x):
            return x * 1.5
        return apply

    @register_jitable
    def helped(x):
        return x + 0.125

    @njit(inline="always")
    def deepest(x):
        return x + 100.0

    @plain
    def deeper(x, zero=0.0):
        return deepest(x) + SHIFT + zero

    def make(factor, pair):
        @njit(error_model="numpy")
        def kernel(x, z=0.5):
            total = one_more(deeper(x)) * factor + pair.y + TABLE[1] + constants.OFFSET
            if x in (3.0, 5.0):
                total += z
            return total + overloaded(x) + helped(x) + Kind.FIRST.value + 1.0 / (x + 1e-300)

        return kernel

    kernel = make(2.0, Pair(1.0, 3.0))
"""
# A change of the source: what is replaced by what.
CHANGES = {
    "constant in a closure": ("make(2.0,", "make(4.0,"),
    "constant in a named tuple": ("Pair(1.0, 3.0)", "Pair(1.0, 4.0)"),
    "order of fields": ('"x y"', '"y x"'),
    "callee two calls down": ("x + 100.0", "x + 200.0"),
    "callee of plain Numba": ("+ SHIFT +", "- SHIFT +"),
    "global": ("SHIFT = 0.25", "SHIFT = 0.75"),
    "global array": ("[1.0, 2.0]", "[1.0, 3.0]"),
    "intrinsic": ("types.float64, 1.0", "types.float64, 2.0"),
    "overload": ("x * 1.5", "x * 2.5"),
    "helper": ("x + 0.125", "x + 0.375"),
    "member of an enumeration": ("FIRST = 7", "FIRST = 8"),
    "default": ("z=0.5", "z=0.75"),
    "default of a callee": ("zero=0.0", "zero=1.0"),
    "constant of the code": ("(3.0, 5.0)", "(3.0, 6.0)"),
    "option": ('error_model="numpy"', 'error_model="python"'),
    "option of a callee": ("@plain\n", "@plain(fastmath=True)\n"),
}
numbers = itertools.count()


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """The folder of kept kernels of this test alone."""
    path = tmp_path / "kernels"
    monkeypatch.setenv("XPER_FX_CACHE", str(path))
    kernel_folder.cache_clear()
    yield path
    monkeypatch.undo()
    kernel_folder.cache_clear()


def load(path: Path, name: str, text: str):
    """A module of a file, made anew."""
    path.mkdir(parents=True, exist_ok=True)
    file = path / f"{name}.py"
    file.write_text(textwrap.dedent(text))
    spec = importlib.util.spec_from_file_location(name, file)
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def made(path: Path, text: str = SOURCE, offset: float = 5.0):
    """The kernel of a source, and whether it is found when it is called with a number."""
    load(path, "constants", f"OFFSET = {offset}")
    kernel = load(path, "kernels_of_a_test", text).kernel
    value = kernel(1.0)
    return value, sum(kernel.stats.cache_hits.values())


# 1 + 100 + 0.25 + 1, twice; 3 + 2 + 5; 1.5, 1.125, 7, 1
VALUE = 2.0 * 102.25 + 10.0 + 1.5 + 1.125 + 7.0 + 1.0


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """A folder of kept kernels that has that of the source; not to change."""
    path = tmp_path_factory.mktemp("compiled")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XPER_FX_CACHE", str(path / "kernels"))
        kernel_folder.cache_clear()
        assert made(path / "a") == (VALUE, 0)
    kernel_folder.cache_clear()
    return path / "kernels"


@pytest.fixture
def known(compiled, kept):
    """The folder of kept kernels of this test, which has that of the source."""
    return Path(shutil.copytree(compiled, kept))


def test_the_same_code_is_found_in_another_folder(kept, tmp_path):
    assert made(tmp_path / "a") == (VALUE, 0)
    moved = "\n# a comment\n\n" + textwrap.dedent(SOURCE)
    assert made(tmp_path / "elsewhere" / "b", moved) == (VALUE, 1)
    assert len(list(kept.glob("*.kernel"))) == 1


@pytest.mark.slow
@pytest.mark.parametrize("change", CHANGES)
def test_other_code_is_not_found(known, tmp_path, change):
    old, new = CHANGES[change]
    assert textwrap.dedent(SOURCE).count(old) == 1
    value, hits = made(tmp_path / "b", textwrap.dedent(SOURCE).replace(old, new))
    assert hits == 0
    same = change in ("constant of the code", "default", "option", "option of a callee")
    assert (value == VALUE) == same
    assert made(tmp_path / "c") == (VALUE, 1)


CALLERS = """
    {} import njit
    from xper_fx.cache import njit as kept

    @njit
    def shared(x, y):
        return x * x + y

    @kept(fastmath=True, error_model="numpy", forceinline=True, _nrt=False)
    def first(x, y):
        return shared(x, y)

    @kept
    def second(x, y):
        return shared(x, y)
"""


def test_code_does_not_depend_on_who_compiles_first(kept, tmp_path):
    module = load(tmp_path / "a", "kernels_of_a_test", CALLERS.format("from xper_fx.cache"))
    assert module.first(3.0, 1.0) == module.second(3.0, 1.0) == 10.0
    (result,) = module.shared.overloads.values()
    assert "fast" not in result.library.get_llvm_str()
    again = load(tmp_path / "b", "kernels_of_a_test", CALLERS.format("from xper_fx.cache"))
    assert again.second(3.0, 1.0) == 10.0 and sum(again.second.stats.cache_hits.values()) == 1


def test_a_foreign_kernel_that_another_has_compiled_is_not_kept(kept, tmp_path):
    module = load(tmp_path / "a", "kernels_of_a_test", CALLERS.format("from numba"))
    assert module.first(3.0, 1.0) == module.second(3.0, 1.0) == 10.0
    (only,) = CacheFolder(kept).files()
    assert only.title == "first"


def test_a_global_of_another_module_counts(known, tmp_path):
    assert made(tmp_path / "b", offset=6.0) == (VALUE + 1.0, 0)


def test_another_type_is_another_kernel(kept, tmp_path):
    text = SOURCE.replace("@plain", "@njit")
    made(tmp_path / "a", text)
    kernel = sys.modules["kernels_of_a_test"].kernel
    assert kernel(1) == VALUE and not kernel.stats.cache_hits  # an integer
    assert made(tmp_path / "b", text) == (VALUE, 1)
    kernel = sys.modules["kernels_of_a_test"].kernel
    assert kernel(1) == VALUE and sum(kernel.stats.cache_hits.values()) == 2


@pytest.mark.parametrize(
    ("name", "value"), [("OPT", 1), ("BOUNDSCHECK", 1), ("DEBUGINFO_DEFAULT", 1)]
)
def test_settings_of_numba_count(known, tmp_path, monkeypatch, name, value):
    monkeypatch.setattr(config, name, value)
    assert made(tmp_path / "b")[1] == 0
    monkeypatch.undo()
    monkeypatch.setenv("XPER_FX_CACHE", str(known))
    assert made(tmp_path / "c")[1] == 1


@pytest.mark.parametrize("version", ["numba", "llvmlite", "numpy"])
def test_versions_count(known, tmp_path, monkeypatch, version):
    from xper_fx.cache import dispatch

    there = sys.modules[version].__version__
    assert there in dispatch._VERSIONS
    others = tuple("0.0" if part == there else part for part in dispatch._VERSIONS)
    monkeypatch.setattr(dispatch, "_VERSIONS", others)
    assert made(tmp_path / "b")[1] == 0


def test_what_is_reached_through_an_unknown_object_is_not_kept(kept, tmp_path, caplog):
    text = SOURCE + "    constants.OFFSET = 5.0\n    make.__globals__['TABLE'] = object()\n"
    text = text.replace("TABLE[1]", "(0.0 if True else TABLE[1]) + 2.0")
    with caplog.at_level(logging.DEBUG, "xper_fx.cache"):
        assert made(tmp_path / "a", text) == (VALUE, 0)
    assert "kernel is not kept: <object object" in caplog.text.replace("make.<locals>.", "")
    assert not list(kept.glob("*.kernel"))


def test_a_kernel_that_does_not_compile_leaves_no_lock(kept, tmp_path):
    made(tmp_path / "a")
    kernel = sys.modules["kernels_of_a_test"].kernel
    with pytest.raises(Exception, match="one_more"):
        kernel("text")
    assert not kernel._cache._keys


def test_a_kernel_with_threads_and_one_that_calls_itself(kept, tmp_path):
    text = """
        import numpy as np
        from numba import prange
        from xper_fx.cache import njit

        @njit
        def factorial(n):
            return 1 if n <= 1 else n * factorial(n - 1)

        @njit(parallel=True)
        def squares(x):
            out = np.empty(8)
            for i in prange(8):
                out[i] = x * i * i
            return out
    """
    for number in range(2):
        module = load(tmp_path / str(number), "kernels_of_a_test", text)
        np.testing.assert_array_equal(module.squares(2.0), 2.0 * np.arange(8.0) ** 2)
        assert module.factorial(6) == 720
        assert sum(module.squares.stats.cache_hits.values()) == number
        assert sum(module.factorial.stats.cache_hits.values()) == number


def test_code_for_callers_is_parsed_when_one_is_compiled(kept, tmp_path, monkeypatch):
    text = """
        from xper_fx.cache import njit

        @njit
        def square(x):
            return x * x

        @njit
        def power(x):
            return square(x) * square(x) * {factor}
    """
    parsed = []
    parse = binding.parse_bitcode
    monkeypatch.setattr(binding, "parse_bitcode", lambda code: parsed.append(code) or parse(code))
    for number, (factor, expected) in enumerate([(1.0, 0), (1.0, 0), (2.0, 1)]):
        parsed.clear()
        source = text.format(factor=factor)
        module = load(tmp_path / str(number), "kernels_of_a_test", source)
        assert module.power(3.0) == 81.0 * factor
        assert len(parsed) == expected, number


@pytest.mark.slow
def test_a_damaged_or_foreign_file_is_compiled_anew(kept, tmp_path, caplog):
    made(tmp_path / "a")
    (path,) = kept.glob("*.kernel")
    whole = path.read_bytes()
    harm = pickle.dumps(os.getcwd)
    for content in (b"", whole[:-1], whole[:100] + b"x" + whole[101:], harm, b"x" * 10_000_000):
        path.write_bytes(content)
        kernel_folder.cache_clear()
        with caplog.at_level(logging.INFO, "xper_fx.cache"):
            assert made(tmp_path / "b") == (VALUE, 0)
        assert caplog.text.count("is damaged") == 1
        caplog.clear()
        assert len(path.read_bytes()) == pytest.approx(len(whole), abs=200)
        assert made(tmp_path / "c") == (VALUE, 1)


def test_a_folder_that_cannot_be_written(kept, tmp_path, caplog, monkeypatch):
    """As on a full disk: said once, at level INFO."""

    def full(*arguments, **options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(folder.tempfile, "NamedTemporaryFile", full)
    with caplog.at_level(logging.INFO, "xper_fx.cache"):
        for name in "abc":
            assert made(tmp_path / name) == (VALUE, 0)
    assert caplog.text.count("No space left on device") == 1
    assert {record.levelno for record in caplog.records} == {logging.INFO}


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["file", "impossible", "open", "foreign"])
def test_a_bad_folder_is_one_line_and_no_cache(tmp_path, monkeypatch, caplog, kind):
    path = tmp_path / "bad"
    if kind == "file":
        path.write_text("")
    elif kind == "open":
        path.mkdir()
        path.chmod(0o777)
    elif kind == "impossible":
        path = Path("/proc/nowhere/kernels")
    else:
        path.mkdir()
        monkeypatch.setattr(os, "geteuid", lambda: path.stat().st_uid + 1)
    monkeypatch.setenv("XPER_FX_CACHE", str(path))
    kernel_folder.cache_clear()
    try:
        for name in "ab":
            assert made(tmp_path / name) == (VALUE, 0)
    finally:
        kernel_folder.cache_clear()
    (record,) = caplog.records
    assert record.levelno == logging.WARNING and str(path) in record.getMessage()
    assert "\n" not in record.getMessage()


def test_off_keeps_nothing(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("XPER_FX_CACHE", "off")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    kernel_folder.cache_clear()
    assert made(tmp_path / "a") == made(tmp_path / "b") == (VALUE, 0)
    assert main([]) == "XPER_FX_CACHE is off: no kernel is kept."
    monkeypatch.delenv("XPER_FX_CACHE")
    kernel_folder.cache_clear()
    assert made(tmp_path / "a") == (VALUE, 0)
    assert kernel_folder().path == tmp_path / "cache" / "xper_fx" / "kernels"
    assert kernel_folder().path.stat().st_mode & 0o777 == 0o700
    monkeypatch.undo()
    kernel_folder.cache_clear()


def test_the_least_recently_used_go_first(tmp_path, monkeypatch):
    kernels = CacheFolder(tmp_path / "kernels")
    for number in range(10):
        kernels.write(f"{number:064x}", "kernel", b"x" * 1000)
        os.utime(kernels.path / f"{number:064x}.kernel", (1e9 + number,) * 2)
    assert kernels.read(f"{0:064x}") == b"x" * 1000  # used now
    (kernels.path / ".left").write_bytes(b"")
    os.utime(kernels.path / ".left", (1e9, 1e9))
    assert kernels.trim(4000) <= 4000
    assert {int(file.path.stem, 16) for file in kernels.files()} == {0, 8, 9}
    assert not (kernels.path / ".left").exists()
    # and by itself, as it fills
    monkeypatch.setattr(folder, "MAX_BYTES", 5000)
    monkeypatch.setattr(folder, "_LOOK_EVERY", 2000)
    for number in range(20, 40):
        kernels.write(f"{number:064x}", "kernel", b"y" * 1000)
    assert sum(file.size for file in kernels.files()) <= 8000
    assert kernels.read(f"{39:064x}") == b"y" * 1000


def test_the_command_shows_and_clears(kept, tmp_path):
    made(tmp_path / "a")
    lines = main([]).splitlines()
    assert lines[0].startswith("1 kernels, 0.0 of at most") and str(kept) in lines[0]
    assert lines[2].split()[0] == "1" and lines[2].endswith("make.<locals>.kernel")
    assert main(["--clear"]).endswith("removed")
    assert not list(kept.glob("*.kernel"))
    assert made(tmp_path / "b") == (VALUE, 0)


def run(script: str, environment: dict[str, str], count: int = 1) -> list[str]:
    """What processes that run a script at the same time print."""
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", textwrap.dedent(script)], text=True, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE, env=os.environ | environment,
        )
        for _ in range(count)
    ]  # fmt: skip
    results = [process.communicate(timeout=600) for process in processes]
    assert not any(process.returncode for process in processes), results[0][1]
    return [out for out, _ in results]


STACK = """
    import hashlib
    import numpy as np
    from numba.core import event
    from xper_fx.nscd import FrictionProblem
    compiled = []
    class Count(event.Listener):
        def on_start(self, event):
            compiled.append(event.data["dispatcher"].py_func.__qualname__)
        def on_end(self, event):
            pass
    event.register("numba:compile", Count())
    rng = np.random.default_rng(0)
    matrix = rng.standard_normal((12, 12))
    problem = FrictionProblem(matrix @ matrix.T, rng.standard_normal(12) - 1.0, 0.4, 2)
    result = problem.solve(solver="nlgs", tolerance=1e-10)
    print(hashlib.sha256(result.reaction.tobytes()).hexdigest(), len(compiled))
"""


@pytest.mark.slow
def test_processes_at_once_compile_once(tmp_path):
    path = tmp_path / "kernels"
    alone = run(STACK, {"XPER_FX_CACHE": "off"})[0].split()
    together = [
        out.split() for out in run(STACK, {"XPER_FX_CACHE": str(path), "NUMBA_NUM_THREADS": "1"}, 2)
    ]
    assert {bits for bits, _ in together} == {alone[0]}
    # each kernel is compiled by one of them, kernels within kernels included
    assert sum(int(count) for _, count in together) <= 1.2 * int(alone[1])
    assert len(list(CacheFolder(path).files())) == len(list(path.glob("*.kernel"))) > 3
    again = run(STACK, {"XPER_FX_CACHE": str(path)})[0].split()
    assert again == [alone[0], "0"]


UNCOMPILED = """
    import numpy as np
    import xper_fx as xf
    from xper_fx.output.contact_forces import find_contact_forces

    steel = xf.materials.LinearElastic(young=99e9, poisson=0.325, density=7800.0)
    bond = xf.laws.CohesiveZone(2e18, fracture_energy=0.5, strength=1e9, friction=0.05)
    contact = xf.laws.SignoriniCoulomb(friction=0.5)

    def plate(scheme):
        size = 50e-6
        mesh = xf.crossed_rectangle((0, 0), (size, size), (2, 2))
        at = {1: lambda x: x[0] < 1e-12, 2: lambda x: x[0] > size - 1e-12}
        bodies = xf.explode(mesh, facet_tags=xf.tag_facets(mesh, at))
        loads = [xf.PrescribedVelocity(1, 0, -1.0), xf.PrescribedVelocity(2, 0, 1.0)]
        scene = xf.Scene(bodies, {1: steel}, default_interaction=bond, loads=loads)
        simulation = xf.Simulation(scene, scheme=scheme)
        list(simulation.steps(5e-9))
        return simulation.reaction(2)[0]

    def stack(shape, up):
        blocks = [xf.RigidBody(shape, (k + 0.5) * up, "blocks", density=2e3) for k in range(2)]
        ground = xf.rigid.wall(0.0 * up, up, "ground")
        pairs = [xf.Contact((a, "blocks"), contact) for a in ("blocks", "ground")]
        loads = [xf.Gravity(-9.81 * up + 2.0 * np.roll(up, 1))]
        scene = xf.Scene(rigid=[*blocks, ground], contacts=pairs, loads=loads)
        simulation = xf.Simulation(scene, 1e-3)
        list(simulation.steps(3e-3))
        return abs(find_contact_forces(simulation).force).sum()

    print(plate("implicit"), plate("explicit"))
    print(stack(xf.rigid.Polygon.box((1.0, 1.0)), np.eye(2)[-1]))
    print(stack(xf.rigid.Polyhedron.box((1.0, 1.0, 1.0)), np.eye(3)[-1]))
"""


@pytest.mark.slow
def test_numba_off_runs_the_python_source(tmp_path):
    """For a debugger: the same numbers, nothing kept."""
    compiled = np.array(run(UNCOMPILED, {})[0].split(), float)
    setting = {"NUMBA_DISABLE_JIT": "1", "XPER_FX_CACHE": str(tmp_path / "kernels")}
    source = np.array(run(UNCOMPILED, setting)[0].split(), float)
    assert np.all(compiled != 0.0) and not (tmp_path / "kernels").exists()
    np.testing.assert_allclose(source, compiled, rtol=1e-6)


@pytest.mark.slow
def test_functions_are_numbered_apart():
    """Symbols of machine code that two processes have compiled are never the same."""
    script = """
        import os, sys
        from numba.core.bytecode import FunctionIdentity
        import xper_fx.cache
        if os.fork():
            os.wait()
        print(FunctionIdentity.from_function(lambda: 0).unique_id, flush=True)
    """
    found = [int(number) for out in run(script, {}, 2) for number in out.split()]
    assert len(set(found)) == 4 and min(found) >= 1 << 60


@pytest.mark.parametrize("collects", [True, False])
def test_garbage_is_collected_again_after_a_kernel_was_compiled(collects):
    @njit
    def inner(x):
        return x + 1.0

    @njit
    def outer(x):
        return inner(x)

    (gc.enable if collects else gc.disable)()
    try:
        assert outer(1.0) == 2.0
        assert gc.isenabled() == collects
        with pytest.raises(TypingError):
            outer("a")
        assert gc.isenabled() == collects
    finally:
        gc.enable()
