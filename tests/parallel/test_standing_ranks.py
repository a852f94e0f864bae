# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scripts on ranks that stand: one that fails, hangs or ends them leaves the next as it was."""

import on_ranks
import pytest

pytestmark = pytest.mark.ranks

RANK = "from mpi4py.MPI import COMM_WORLD as comm\n"
# The first rank says it for all: what others print may come after the end.
HELLO = f"{RANK}said = comm.gather('hello')\nif said:\n    print(*said, flush=True)\n"


@pytest.fixture(scope="module", autouse=True)
def of_their_own():
    """Others than those that other files run scripts on, which have loaded what these need."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(on_ranks, "_standing", [])
        patch.setattr(on_ranks, "MOST_RANKS", 3)
        yield
        on_ranks._dismiss()


@pytest.fixture
def run(tmp_path):
    """Run a script given by its text on two ranks."""

    def run(text):
        script = tmp_path / "script.py"
        script.write_text(text)
        return on_ranks.on_ranks(2, script)

    yield run
    assert run(HELLO).stdout.count("hello") == 2


def test_a_rank_that_fails_is_told(run):
    done = run(f"{RANK}if comm.rank == 1:\n    raise ValueError('no such row')\ncomm.Barrier()\n")
    assert done.returncode != 0
    assert "ValueError: no such row" in done.stdout


def test_ranks_that_wait_for_each_other_are_stopped(run, monkeypatch):
    monkeypatch.setattr(on_ranks, "_PATIENCE", 2.0)
    done = run(f"{RANK}print('waiting', flush=True)\ncomm.recv(source=1 - comm.rank)\n")
    assert done.returncode != 0
    assert "waiting" in done.stdout


def test_a_last_line_may_be_open(run):
    """Some mpirun keep that of another rank than the first until the line ends."""
    script = "from mpi4py import MPI\nMPI.COMM_WORLD.rank or print('half', end='', flush=True)\n"
    assert run(script).stdout == "half"


def test_ranks_that_have_ended_have_followers(run):
    assert run(HELLO).returncode == 0
    on_ranks._standing[0].terminate()
    on_ranks._standing[0].wait()


def test_an_interrupted_test_ends_its_ranks(run, monkeypatch):
    assert run(HELLO).returncode == 0
    ranks = on_ranks._standing[0]

    def interrupted(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(on_ranks.json, "dumps", interrupted)
        run(HELLO)
    assert ranks.poll() is not None
