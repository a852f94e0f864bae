# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forms that another process compiles, or has left behind."""

import os
import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import create_unit_square
from mpi4py import MPI

from xper_fx.forms import compiled

# Compiles the form of `area` into a folder.
OTHER = """
import sys
from test_compiled_forms import area
from xper_fx.forms import compiled
compiled.OPTIONS["cache_dir"] = sys.argv[1]
area()
"""


def area() -> float:
    mesh = create_unit_square(MPI.COMM_SELF, 2, 2)
    return fem.assemble_scalar(compiled.compiled_form(fem.Constant(mesh, 1.0) * ufl.dx(mesh)))


@pytest.fixture
def start(tmp_path, monkeypatch):
    """Start a process whose compiler first runs a line of shell."""
    monkeypatch.setitem(compiled.OPTIONS, "cache_dir", str(tmp_path / "forms"))
    monkeypatch.setattr(compiled, "_STRANGERS", 0.0)
    monkeypatch.setattr(compiled, "_PAUSE", 1e-3)
    compiler = tmp_path / "compiler"
    paths = os.pathsep.join([os.path.dirname(__file__), os.environ.get("PYTHONPATH", "")])

    def start(line):
        compiler.write_text(f'#!/bin/sh\n{line}\nexec {shutil.which("gcc")} "$@"\n')
        compiler.chmod(0o755)
        return subprocess.Popen(
            [sys.executable, "-c", OTHER, tmp_path / "forms"],
            env=os.environ | {"CC": str(compiler), "PYTHONPATH": paths},
        )

    return start


@pytest.mark.slow
def test_what_a_killed_process_has_left_is_compiled_anew(start, tmp_path, monkeypatch):
    """Where patience ends before, it is told as FFCx tells it: what to remove."""
    assert start("kill -KILL $PPID").wait() == -signal.SIGKILL
    (source,) = (tmp_path / "forms").glob("*/*.c")
    assert compiled._is_pending(source)
    with monkeypatch.context() as patch:
        patch.setattr(compiled, "_STRANGERS", 1e9)
        patch.setattr(compiled, "_PATIENCE", 0.0)
        with pytest.raises(TimeoutError, match="remove .*forms.*[.]c"):
            area()
    assert compiled._is_pending(source)
    assert area() == pytest.approx(1.0)
    assert not compiled._is_pending(source)


@pytest.mark.slow
def test_what_cannot_be_loaded_is_compiled_anew(start, tmp_path, caplog):
    assert start("").wait() == 0
    (library,) = (tmp_path / "forms").glob("*/*.so")
    library.write_bytes(b"")  # as after a machine has lost power
    with caplog.at_level("INFO", compiled.logger.name):
        assert area() == pytest.approx(1.0)
    assert [str(library) in message for message in caplog.messages] == [True]
    assert library.stat().st_size > 0


@pytest.mark.slow
def test_what_another_process_compiles_is_waited_for(start, tmp_path, monkeypatch):
    """However long it takes: its file is not taken away."""
    for name in ("compiling", "go on"):
        os.mkfifo(tmp_path / name)
    at_work, go_on = (os.open(tmp_path / name, os.O_RDWR) for name in ("compiling", "go on"))
    line = f"echo >'{tmp_path}/compiling'; read -r _ <'{tmp_path}/go on'"
    looks, is_pending = [], compiled._is_pending

    def looked(source):
        looks.append(is_pending(source))
        if len(looks) == 10:
            os.write(go_on, b"\n" * 10)  # the compiler is called to compile and to link
        return looks[-1]

    monkeypatch.setattr(compiled, "_is_pending", looked)
    other = start(line)
    try:
        os.read(at_work, 1)
        monkeypatch.setenv("CC", "false")  # here nothing can be compiled
        assert area() == pytest.approx(1.0)
    finally:
        os.write(go_on, b"\n" * 10)
        status = other.wait()
        for pipe in (at_work, go_on):
            os.close(pipe)
    assert status == 0 and np.all(looks[:10])
