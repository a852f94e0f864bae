# SPDX-License-Identifier: LGPL-3.0-or-later
"""How the tests share the cores, which tier each is in, and what a worker keeps.

With pytest-xdist, a run of several files has a worker of one thread for each core, four at most;
`-n 0`, `--pdb` and `-s` run in one process, as does a single file. A file's tests run in one worker
(`--dist loadfile`): what one has built serves the next. So do all files of `parallel/`: the ranks
that stand by for one serve the next.

A test is `fast` unless it is marked otherwise.
"""

import ctypes
import gc
import os
import sys

import numba
import on_ranks
import pytest

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
numba.set_num_threads(1)

MOST_WORKERS = 4
OTHER_TIERS = {"slow", "ranks", "docs", "demos"}
# A folder whose files are run one after the other by one worker.
TOGETHER = "tests/parallel"
# What takes longest, in this order: begun first, so that all workers end together.
LONGEST = (
    "parallel",
    "output/test_effects.py",
    "project/test_docs.py",
    "output/test_restart.py",
    "cache/test_kept_kernels.py",
    "periodic/test_periodic_interactions.py",
    "periodic/test_microstructure.py",
    "simulation/test_path.py",
    "scene/test_joints.py",
    "demos/test_impact_fragmentation.py",
    "study/test_study.py",
    "simulation/test_accuracy.py",
    "demos/test_periodic_demos.py",
)


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config):
    """Share the files among workers, where xdist is there and the caller says nothing else."""
    option = config.option
    files = {argument.split("::")[0] for argument in config.args}
    alone = len(files) == 1 and os.path.isfile(next(iter(files)))
    if (
        "PYTEST_XDIST_WORKER" in os.environ  # this is one of them
        or alone
        or not config.pluginmanager.hasplugin("xdist")
        or option.numprocesses is not None
        or option.dist != "no"
        or option.tx
        or option.usepdb
        or option.trace
        or option.capture == "no"
        or option.collectonly
    ):
        return
    workers = min(len(os.sched_getaffinity(0)), MOST_WORKERS)
    if workers > 1:
        option.numprocesses, option.dist = workers, "loadfile"


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Those that take longest first; xdist takes those of most tests first."""
    if config.option.dist != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    class LongestFirst(LoadFileScheduling):
        def _assign_work_unit(self, node):
            for file in reversed(LONGEST):
                if f"tests/{file}" in self.workqueue:
                    self.workqueue.move_to_end(f"tests/{file}", last=False)
            super()._assign_work_unit(node)

        def _split_scope(self, nodeid):
            together = nodeid.startswith(f"{TOGETHER}/")
            return TOGETHER if together else super()._split_scope(nodeid)

    return LongestFirst(config, log)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    for item in items:
        if not OTHER_TIERS & {mark.name for mark in item.iter_markers()}:
            item.add_marker("fast")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    on_ranks.marked = item.get_closest_marker("ranks") is not None


@pytest.fixture(scope="module", autouse=True)
def given_back():
    """What a file has built goes with it: simulations are cycles, figures are kept by pyplot.

    What there is before it is not looked at again, libraries and kernels for the most part. What
    compiling took goes back to the system as far as glibc can tell.
    """
    gc.freeze()
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")
    gc.collect()
    if trim := getattr(ctypes.CDLL(None), "malloc_trim", None):
        trim(0)
