# SPDX-License-Identifier: LGPL-3.0-or-later
"""The launcher `fenicsx`, run in a world of stubs.

PATH holds a handful of basic tools and, as a test asks for them, scripts that stand for python3,
mmdebstrap and bwrap. So the tests are quick, need neither root nor a network, and give the same
result on any machine, within the userland too.
"""

import os
import pty
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

LAUNCHER = Path(__file__).resolve().parents[2] / "fenicsx"

TOOLS = (
    "bash sh env cat cksum cut df dirname flock grep ls mkdir mv readlink rm tail tar touch true"
).split()

pytestmark = [
    pytest.mark.skipif(not LAUNCHER.exists(), reason="the package is not run from its checkout"),
    pytest.mark.skipif(
        not all(map(shutil.which, TOOLS)), reason="bash, util-linux or GNU tools are missing"
    ),
]

# Python without its installed packages: knows the DOLFINx of PYTHONPATH only, and notes its calls.
PYTHON = f"""#!/bin/sh
echo called >>"$STUB_NOTES/python3"
exec {sys.executable} -S "$@"
"""

# Like bwrap: stays the parent of the command and gives its status back.
BWRAP = """#!/bin/bash
printf '%s\\n' "$@" >>"$STUB_NOTES/bwrap"
[[ $* == "--dev-bind / / true" ]] && exit
cd /
while [[ $1 != -- ]]; do
    [[ $1 == --chdir ]] && cd -- "$2"
    shift
done
shift
"$@"
exit $?
"""

# Like proot: gives 255 for a command that a signal ends.
PROOT = f"""#!{sys.executable} -S
import os, subprocess, sys
options = sys.argv[1:]
folder = options[options.index("-w") + 1] if "-w" in options else "/"
status = subprocess.call(options[options.index("/bin/sh"):], cwd=folder)
sys.exit(255 if status < 0 else status)
"""

# Makes the folders that the launcher looks at; the arguments end with: suite, target, mirror. It
# waits for a line where World.hold() has made a pipe for it.
MMDEBSTRAP = """#!/bin/bash
echo called >>"$STUB_NOTES/mmdebstrap"
echo "I: running apt-get update..." >&2
[[ -p $STUB_NOTES/build ]] && read -r <"$STUB_NOTES/build"
if [[ -n $STUB_BUILD_ERROR ]]; then
    echo "$STUB_BUILD_ERROR" >&2
    exit 1
fi
target=${@: -2:1}
[[ $target == - ]] && root=$(dirname -- "$STUB_NOTES")/for_tar || root=$target
mkdir -p "$root"/{usr,etc,var}
[[ $target == - ]] && tar --create --directory="$root" .
exit 0
"""


# Notes each of some signals, and ends with status 5 once it reads a line from a pipe.
PATIENT = f"""#!{sys.executable} -S
import os, signal, sys
pipe, *names = sys.argv[1:]
def say(what):
    os.write(1, what.encode() + b"\\n")  # a signal may come while print is at work
def note(number, frame):
    say(signal.Signals(number).name)
for name in names:
    signal.signal(getattr(signal, name), note)
with open(pipe) as go_on:
    say("terminal" if os.isatty(0) else "ready")
    go_on.readline()
os._exit(5)  # at once: while Python ends, a signal that comes again would kill it
"""

SIGNALS = [getattr(signal, f"SIG{name}") for name in "HUP INT QUIT TERM USR1 USR2".split()]

LONGEST = 300.0  # s; on a loaded machine all take longer


def usual_signals():
    """What the signals do in a new process, also where these tests ignore some (`nohup`, `&`)."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_DFL)


class World:
    """A folder with a PATH of stubs, a home and a place for the userland."""

    def __init__(self, folder):
        self.folder = folder
        self.bin = folder / "bin"
        self.notes = folder / "notes"
        self.userland = folder / "cache" / "userland"
        for made in (self.bin, self.notes, folder / "home"):
            made.mkdir()
        self.pipes, self.started = {}, []
        self.watch = threading.Timer(LONGEST, self.close)
        self.watch.start()
        for tool in TOOLS:
            (self.bin / tool).symlink_to(shutil.which(tool))
        self.environment = {
            "PATH": str(self.bin),
            "HOME": str(folder / "home"),
            "XDG_CACHE_HOME": str(folder / "cache"),
            "STUB_NOTES": str(self.notes),
        }

    def stub(self, name, script):
        path = self.bin / name
        path.unlink(missing_ok=True)
        path.write_text(script)
        path.chmod(0o755)

    def calls(self, name):
        """How often a stub was called."""
        note = self.notes / name
        return note.read_text().count("called") if note.exists() else 0

    def with_dolfinx(self, version):
        """Let python3 find a DOLFINx of this version, in a folder of PYTHONPATH."""
        self.stub("python3", PYTHON)
        package = self.folder / "site" / "dolfinx"
        package.mkdir(parents=True)
        (package / "__init__.py").write_text(f"__version__ = {version!r}\n")
        self.environment["PYTHONPATH"] = str(package.parent)

    def with_userland(self):
        """Let a userland be built and entered by stubs."""
        self.stub("python3", PYTHON)
        self.stub("bwrap", BWRAP)
        self.stub("mmdebstrap", MMDEBSTRAP)
        # Not the machine's disk: there is room.
        self.stub("df", "#!/bin/sh\necho Avail\necho ${STUB_FREE:-100000000}\n")
        self.environment["XPER_FX_USERLAND"] = str(self.userland)

    def hold(self, name):
        """Make a pipe that a stub reads a line from before it goes on."""
        os.mkfifo(self.notes / name)
        self.pipes[name] = os.open(self.notes / name, os.O_RDWR)  # for both: waits for nobody

    def let_go(self, name):
        """Let the stub that reads from a pipe go on, and later ones not wait."""
        os.write(self.pipes[name], b"go on\n")
        (self.notes / name).unlink()

    def close(self):
        """End what a failed test has left, or waits for in vain."""
        self.watch.cancel()
        while self.pipes:
            os.close(self.pipes.popitem()[1])
        for process in self.started:
            process.kill()

    def start(self, *command, **options):
        options.setdefault("preexec_fn", usual_signals)
        process = subprocess.Popen(
            [LAUNCHER, *command],
            env=self.environment | options.pop("environment", {}),
            stdin=options.pop("stdin", subprocess.DEVNULL),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            **options,
        )
        self.started.append(process)
        return process

    def run(self, *command, text=None, **options):
        process = self.start(*command, stdin=subprocess.PIPE, **options)
        output, errors = process.communicate(text, timeout=LONGEST)
        return subprocess.CompletedProcess(command, process.returncode, output, errors)


@pytest.fixture
def world(tmp_path):
    world = World(tmp_path)
    yield world
    world.close()
    for process in world.started:
        process.communicate()


@pytest.fixture(params=["native", "userland"])
def either(world, request):
    """A world where commands run natively, or in the userland."""
    if request.param == "native":
        world.with_dolfinx("0.9.0")
    else:
        world.with_userland()
    world.kind = request.param
    return world


# --- the command


def test_without_a_command_prints_the_usage(world):
    result = world.run()
    assert result.returncode == 2
    assert "usage: ./fenicsx COMMAND" in result.stderr


@pytest.mark.parametrize("status", [0, 3, 255])
def test_gives_the_exit_status(either, status):
    assert either.run("sh", "-c", f"exit {status}").returncode == status


def test_gives_127_for_an_unknown_command(either):
    assert either.run("no-such-command").returncode == 127


def test_gives_the_status_of_a_signal(either):
    # A shell shows -15 as 143 too.
    assert either.run("sh", "-c", "kill -TERM $$").returncode in (-15, 128 + 15)


def test_hands_arguments_on_unchanged(either):
    arguments = ["a b", "", "it's", '"q"', "$HOME", "*", "a\nb", "--", "\\"]
    script = 'for a in "$@"; do printf "<%s>" "$a"; done'
    result = either.run("sh", "-c", script, "sh", *arguments)
    assert result.stdout == "".join(f"<{a}>" for a in arguments)


def test_keeps_folder_input_output_and_errors(either, tmp_path):
    folder = tmp_path / "a folder"
    folder.mkdir()
    either.run("true")  # builds the userland
    result = either.run("sh", "-c", "pwd; cat; echo complaint >&2", text="fed\n", cwd=folder)
    assert result.stdout == f"{folder}\nfed\n"
    assert result.stderr == "complaint\n"


def test_sets_the_environment(either):
    script = 'echo "$PYTHONPATH|$OMPI_MCA_btl|$KEPT"'
    result = either.run("sh", "-c", script, environment={"KEPT": "as it was"})
    path, transport, kept = result.stdout.strip().split("|")
    assert path.split(":")[0] == str(LAUNCHER.parent)
    assert transport == "self,sm"
    assert kept == "as it was"
    result = either.run("sh", "-c", script, environment={"OMPI_MCA_btl": "tcp"})
    assert "|tcp|" in result.stdout


def test_keeps_the_hosts_python_out_of_the_userland(world):
    world.with_userland()
    outer = {"PYTHONHOME": "/nowhere", "LD_LIBRARY_PATH": "/nowhere", "LC_ALL": "xx_XX.UTF-8"}
    script = 'echo "$PATH|$PYTHONHOME$LD_LIBRARY_PATH|$LC_ALL"'
    result = world.run("sh", "-c", script, environment=outer)
    path, dropped, locale = result.stdout.strip().split("|")
    assert path.startswith("/usr/local/bin:/usr/bin:/bin:")
    assert path.endswith(str(world.bin))
    assert dropped == ""
    assert locale == "C.UTF-8"


def start_patient(world, signals, **options):
    """Start a command that notes some signals, and ends when `end_of` lets it."""
    world.run("true")
    world.hold("end")
    world.stub("patient", PATIENT)
    names = [f"SIG{name}" for name in signals]
    process = world.start(world.bin / "patient", world.notes / "end", *names, **options)
    assert process.stdout.readline() == "ready\n"
    return process


def at_rest(process):
    """Whether a process sleeps, and no signal is on its way to it."""
    status = Path(f"/proc/{process}/status").read_text()
    rows = dict(row.split(":", 1) for row in status.splitlines())
    pending = int(rows["SigPnd"], 16) | int(rows["ShdPnd"], 16)
    return rows["State"].split()[0] == "S" and not pending


def wait_until_at_rest(process):
    """Between two signals bash may lose the status of a child; not for ever, if it never rests."""
    until = time.monotonic() + LONGEST / 10.0
    while not at_rest(process) and time.monotonic() < until:
        os.sched_yield()


def end_of(world, process):
    """Let the command end once the launcher has handed all on, and give what it has said."""
    wait_until_at_rest(process.pid)
    world.let_go("end")
    return process.communicate(timeout=LONGEST)[0]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["TERM", "INT", "HUP", "USR1"])
def test_signals_reach_the_command(either, name):
    process = start_patient(either, [name])
    process.send_signal(getattr(signal, f"SIG{name}"))
    assert process.stdout.readline() == f"SIG{name}\n"
    assert end_of(either, process) == ""
    assert process.returncode == 5


def test_signal_to_the_whole_group_ends_nothing_early(either):
    """As by `timeout`: the command still ends in its own way, and its status is given."""
    process = start_patient(either, ["TERM"], start_new_session=True)
    os.killpg(process.pid, signal.SIGTERM)
    assert process.stdout.readline() == "SIGTERM\n"
    assert set(end_of(either, process).split()) <= {"SIGTERM"}
    assert process.returncode == 5


def test_ignored_signal_stays_ignored(either):
    """As by `nohup`."""

    def ignore():
        usual_signals()
        signal.signal(signal.SIGHUP, signal.SIG_IGN)

    process = start_patient(either, [], preexec_fn=ignore, start_new_session=True)
    os.killpg(process.pid, signal.SIGHUP)
    assert end_of(either, process) == ""
    assert process.returncode == 5


def test_terminal_stays_a_terminal_and_interrupts_once(either):
    either.run("true")
    either.hold("end")
    either.stub("patient", PATIENT)
    after = ["SIGUSR1", "SIGUSR2"] * 3
    command = [LAUNCHER, either.bin / "patient", either.notes / "end", "SIGINT", *after]
    child, terminal = pty.fork()
    if child == 0:
        usual_signals()
        os.execve(LAUNCHER, list(map(str, command)), either.environment)
    output = read_until(terminal, b"terminal")
    for name in after:  # often: two interruptions that come at once may look like one
        os.write(terminal, b"\x03")
        output += read_until(terminal, b"SIGINT")
        # A signal that comes just before bash waits again is handed on with the next one only.
        wait_until_at_rest(child)
        os.kill(child, getattr(signal, name))
        output += read_until(terminal, name.encode())
        wait_until_at_rest(child)
    either.let_go("end")
    output += read_until(terminal, None)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 5
    os.close(terminal)
    assert output.count(b"SIGINT") == len(after)


def read_until(terminal, said):
    """What a terminal shows until it says something, or to its end."""
    output = b""
    try:
        while said is None or said not in output:
            chunk = os.read(terminal, 1000)
            if not chunk:
                break
            output += chunk
    except OSError:  # how Linux tells the end
        pass
    return output


# --- native or not


@pytest.mark.parametrize("version", ["0.9.0", "0.10.0.post1", "0.11.0.dev0", "1.0"])
def test_runs_natively_where_dolfinx_is(world, version):
    world.with_dolfinx(version)
    result = world.run("sh", "-c", "echo ran")
    assert result.stdout == "ran\n"
    assert result.stderr == ""


@pytest.mark.parametrize("version", ["0.8.0", "0.7.3", "unknown"])
def test_does_not_run_natively_with_an_old_dolfinx(world, version):
    world.with_dolfinx(version)
    assert world.run("true").returncode == 125


def test_asks_python_once(world):
    world.with_dolfinx("0.9.0")
    for _ in range(3):
        assert world.run("true").returncode == 0
    assert world.calls("python3") == 1


def test_asks_python_again_when_packages_change(world):
    world.with_dolfinx("0.8.0")
    site = world.folder / "site"
    assert world.run("true").returncode == 125
    (site / "dolfinx" / "__init__.py").write_text("__version__ = '0.10.0'\n")
    (site / "fenics_dolfinx-0.10.0.dist-info").mkdir()
    later = time.time() + 5
    os.utime(site, (later, later))
    assert world.run("true").returncode == 0


def test_within_the_userland_it_does_not_look(world):
    assert world.run("true", environment={"XPER_FX_INSIDE": "1"}).returncode == 0


def test_says_what_to_do_where_nothing_is_available(world):
    world.stub("python3", PYTHON)
    result = world.run("true")
    assert result.returncode == 125
    for route in ("mmdebstrap bubblewrap", "conda env create -f environment.yml", "docker build"):
        assert route in result.stderr


def test_says_so_where_there_is_no_python(world):
    assert "conda env create" in world.run("true").stderr


# --- building the userland


def test_builds_once_and_says_so(world):
    world.with_userland()
    result = world.run("sh", "-c", "echo ran")
    assert result.stdout == "ran\n"
    assert "building the Debian userland" in result.stderr
    assert "reading the package lists" in result.stderr
    assert not world.userland.with_name("userland.partial").exists()
    result = world.run("sh", "-c", "echo ran")
    assert (result.stdout, result.stderr) == ("ran\n", "")
    assert world.calls("mmdebstrap") == 1


def test_default_folder_follows_the_suite(world):
    world.with_userland()
    del world.environment["XPER_FX_USERLAND"]
    world.run("true")
    world.run("true", environment={"XPER_FX_SUITE": "sid"})
    folders = (world.folder / "cache" / "xper_fx").glob("debian-*/xper_fx-stamp")
    assert sorted(path.parent.name for path in folders) == ["debian-13", "debian-sid"]


def building(process):
    """Read what a call says until it builds."""
    said = ""
    while "reading the package lists" not in said:
        line = process.stderr.readline()
        assert line, said
        said += line
    return said


def test_two_calls_at_once_build_once(world):
    world.with_userland()
    world.hold("build")
    first = world.start("sh", "-c", "echo first")
    said = building(first)
    second = world.start("sh", "-c", "echo second")
    assert "another call is building" in second.stderr.readline()
    world.let_go("build")
    assert second.communicate(timeout=LONGEST)[0] == "second\n"
    output, errors = first.communicate(timeout=LONGEST)
    assert output == "first\n" and "waiting" not in said + errors
    assert world.calls("mmdebstrap") == 1


def test_interrupted_build_is_redone(world):
    world.with_userland()
    world.hold("build")
    first = world.start("true", start_new_session=True)
    building(first)
    os.killpg(first.pid, signal.SIGKILL)
    first.communicate(timeout=LONGEST)
    (world.notes / "build").unlink()
    assert not world.userland.exists()
    second = world.run("sh", "-c", "echo ran")
    assert "interrupted build" in second.stderr
    assert second.stdout == "ran\n"
    assert world.calls("mmdebstrap") == 2


@pytest.mark.parametrize("stamp", ["trixie 0\n", "bookworm 0\n", ""])
def test_other_packages_or_suite_make_it_anew(world, stamp):
    world.with_userland()
    world.run("true")
    (world.userland / "xper_fx-stamp").write_text(stamp)
    (world.userland / "leftover").touch()
    result = world.run("sh", "-c", "echo ran")
    assert result.stdout == "ran\n"
    assert world.calls("mmdebstrap") == 2
    assert not (world.userland / "leftover").exists()
    assert not world.userland.with_name("userland.old").exists()
    assert world.run("true").stderr == ""


def test_packages_of_the_documentation_come_where_they_are_asked_for(world):
    """And stay: neither call makes the userland anew for the other."""
    world.with_userland()
    world.stub("mmdebstrap", MMDEBSTRAP.replace("echo called", 'echo called "$@"'))
    wanted = {"XPER_FX_DOCS": "1"}
    world.run("true")
    assert "python3-sphinx" not in (world.notes / "mmdebstrap").read_text()
    assert world.run("true", environment=wanted).returncode == 0
    assert world.calls("mmdebstrap") == 2
    assert "python3-dolfinx" in (world.notes / "mmdebstrap").read_text().splitlines()[1]
    assert "python3-sphinx" in (world.notes / "mmdebstrap").read_text().splitlines()[1]
    for environment in (wanted, {}, wanted):
        assert world.run("true", environment=environment).stderr == ""
    assert world.calls("mmdebstrap") == 2


def test_leaves_a_folder_that_is_no_userland_alone(world):
    world.with_userland()
    world.userland.mkdir(parents=True)
    precious = world.userland / "thesis.tex"
    precious.write_text("years of work")
    result = world.run("true")
    assert result.returncode == 125
    assert "not a userland" in result.stderr
    assert precious.read_text() == "years of work"
    assert world.calls("mmdebstrap") == 0


@pytest.mark.parametrize(
    "error, advice",
    [
        ("E: Could not resolve 'deb.debian.org'", "network"),
        ("tar: No space left on device", "the disk is full"),
        ("The following signatures: NO_PUBKEY 123", "debian-archive-keyring"),
    ],
)
def test_failed_build_names_the_log_and_the_remedy(world, error, advice):
    world.with_userland()
    result = world.run("true", environment={"STUB_BUILD_ERROR": error})
    assert result.returncode == 125
    assert str(world.userland.with_name("userland.log")) in result.stderr
    assert error in result.stderr
    assert advice in result.stderr
    assert not world.userland.exists()
    assert world.run("true").returncode == 0


def test_short_disk_is_told_before_building(world):
    world.with_userland()
    result = world.run("true", environment={"STUB_FREE": "1000000"})
    assert result.returncode == 125
    assert "976 MB are free" in result.stderr
    assert world.calls("mmdebstrap") == 0


# --- entering it


def test_shows_the_hosts_folders_at_the_same_path(world):
    world.with_userland()
    world.run("true", cwd=world.folder)
    options = (world.notes / "bwrap").read_text().splitlines()
    shown = [b for a, b in zip(options, options[1:], strict=False) if a == "--dev-bind-try"]
    top = "/" + world.folder.parts[1]
    assert {"/dev", "/proc", top} <= set(shown) | {"/var" if top == "/var" else top}
    assert not {"/usr", "/etc", "/bin", "/lib"} & set(shown)


@pytest.fixture
def world_with_proot(world):
    """A world where bwrap is there but may not do its work, and proot does."""
    world.with_userland()
    world.stub("bwrap", "#!/bin/sh\nexit 1\n")
    world.stub("proot", PROOT)
    return world


def test_falls_back_to_proot_where_bwrap_does_not_work(world_with_proot):
    result = world_with_proot.run("sh", "-c", "echo ran; pwd; kill -TERM $$")
    assert result.stdout == f"ran\n{Path.cwd()}\n"
    assert result.returncode == 128 + 15


def test_signals_reach_the_command_within_proot(world_with_proot):
    process = start_patient(world_with_proot, ["TERM"])
    process.send_signal(signal.SIGTERM)
    assert process.stdout.readline() == "SIGTERM\n"
    assert end_of(world_with_proot, process) == ""
    assert process.returncode == 5


def test_unknown_way_to_enter_is_refused(world):
    world.with_userland()
    result = world.run("true", environment={"XPER_FX_ENTER": "teleport"})
    assert result.returncode == 125
    assert "bwrap, proot or chroot" in result.stderr
