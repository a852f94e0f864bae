# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a script says and how it ends, at a terminal and before a pipe that is closed."""

import contextlib
import os
import pty
import re
import signal
import subprocess
import sys
import termios
from types import SimpleNamespace

import pytest
from scenes import box_bodies

from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import CohesiveZone
from xper_fx.output.recorder import Recorder
from xper_fx.output.run import recorded_steps
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.compiling_note import CompilingNote

PRINTS_ON = """
import sys
import xper_fx.bodies.explode  # with DOLFINx and PETSc
from xper_fx.parallel.launch import run_together

def main():
    for number in range(200_000):
        print(number)
"""


@pytest.mark.slow
@pytest.mark.parametrize("guarded", [True, False])
def test_a_closed_pipe_ends_a_script_quietly(guarded):
    """As `| head -1`: the status of SIGPIPE, or Python's own error, but no message of PETSc's."""
    script = PRINTS_ON + ("run_together(main)" if guarded else "main()")
    with subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "0\n"
        process.stdout.close()
        error = process.stderr.read()
        status = process.wait()
    if guarded:
        assert (status, error) == (128 + signal.SIGPIPE, "")
    else:
        assert status == 1 and "BrokenPipeError" in error and "PETSC" not in error


def test_the_bar_shows_the_time_with_three_digits(tmp_path, capfd):
    bodies = box_bodies((1.0, 1.0), (2, 2))
    scene = Scene(
        bodies,
        {1: LinearElastic(young=1.0, poisson=0.3, density=1.0)},
        default_interaction=CohesiveZone(10.0, 1e-4, 1e-3),
    )
    simulation = Simulation(scene, 0.0123456789)
    recorder = Recorder(simulation, tmp_path, end_time=0.1)
    for _ in recorded_steps(recorder, 0.1, "plate"):
        pass
    bars = capfd.readouterr().err.split("\r")
    assert re.match(r"plate: 100\.0 %\|.*\| 0\.1 of 0\.1 s \[\d\d:\d\d<\d\d:\d\d, ", bars[-1])
    assert not [bar for bar in bars if re.search(r"\d\.\d{5}", bar)]


def test_compiling_is_said_at_a_terminal(monkeypatch, capsys):
    note = CompilingNote()
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    note.on_start(SimpleNamespace())
    note.on_start(SimpleNamespace())
    note.on_end(SimpleNamespace())
    note.on_end(SimpleNamespace())
    lines = [line.strip() for line in re.split(r"[\r\n]", capsys.readouterr().err)]
    assert "compiling 1 kernel, once" in lines and "compiling 2 kernels, once" in lines
    assert lines[-1] == ""  # gone


PLAIN = """
import xper_fx as xf

body = xf.RigidBody(xf.rigid.Sphere(0.1), (0.0, 0.0, 0.5), "bodies", density=2000.0)
alone = xf.Contact(("bodies", "bodies"), None)
scene = xf.Scene(rigid=[body], contacts=[alone], loads=[xf.Gravity((0.0, 0.0, -9.81))])
next(xf.Simulation(scene, 1e-3).steps(1e-3))
"""


@pytest.mark.slow
def test_a_script_of_its_own_says_that_it_compiles():
    master, terminal = pty.openpty()
    termios.tcsetwinsize(terminal, (24, 80))
    script = subprocess.Popen(
        [sys.executable, "-c", PLAIN], stderr=terminal, env=os.environ | {"XPER_FX_CACHE": "off"}
    )
    os.close(terminal)
    said = b""
    with open(master, "rb", buffering=0) as screen:
        # a terminal whose other side is closed fails
        with contextlib.suppress(OSError):
            while part := screen.read(4096):
                said += part
    assert script.wait() == 0, said
    assert said.count(b"compiling 1 kernel, once") == 1
