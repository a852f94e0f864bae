# SPDX-License-Identifier: LGPL-3.0-or-later
"""What it costs to start: processor time with no kernel kept, and with all.

    ./fenicsx python3 benchmarks/start_up.py
    ./fenicsx python3 benchmarks/start_up.py --only rigid

Each script runs in processes of its own: once so that DOLFINx's forms are compiled, then with an
empty folder of kernels (cold), then with what that run has left (warm, the cheapest of a few runs).
Processor time is that of the process and all it starts, import and end included, as the system
counts it. Demos run to the end of their first step. At last eight processes of some scripts start
at once on an empty folder.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from xper_fx.cache import CacheFolder

ROOT = Path(__file__).parent.parent
# Demos whose first step is a simulation of their own process (a study starts others).
DEMOS = ("notched_plate", "periodic_ductile", "intergranular", "impact_fragmentation",
         "granular_packing", "masonry_arch", "fracture_3d", "subdomains")  # fmt: skip
# Pages of the guide whose first example is run.
PAGES = ("periodic", "friction_problem", "contact")
# Scripts that are also started eight times at once.
TOGETHER = ("README, example", "two rigid blocks, 3D")

FIRST_STEP = """
import runpy, sys
from xper_fx.simulation.simulation import Simulation

steps = Simulation.steps

def first_step(simulation, *arguments, **options):
    for _ in steps(simulation, *arguments, **options):
        raise SystemExit(0)

Simulation.steps = first_step
sys.argv = sys.argv[1:]
runpy.run_path(sys.argv[0], run_name="__main__")
"""

TWO_RIGID = """
import numpy as np
import xper_fx as xf

shape = xf.rigid.{shape}.box((1.0,) * {dim})
up = np.eye({dim})[-1]
law = xf.laws.SignoriniCoulomb(friction=0.5)
scene = xf.Scene(
    rigid=[xf.RigidBody(shape, height * up, "blocks", density=2000.0) for height in (0.5, 1.5)]
    + [xf.rigid.wall(0.0 * up, up, "ground")],
    contacts=[xf.Contact(pair, law) for pair in (("blocks", "blocks"), ("blocks", "ground"))],
    loads=[xf.Gravity(-9.81 * up)],
)
for step in xf.Simulation(scene, 1e-3).steps(0.01):
    pass
"""


class Script(NamedTuple):
    """A script of the benchmark, and how many ranks run it."""

    name: str
    arguments: tuple[str, ...]
    ranks: int = 1


class Cost(NamedTuple):
    """What a script takes.

    Attributes:
        cold: processor time with no kernel kept (s).
        warm: with all kept (s).
        kernels: that it needs.
        bytes: of their files.
    """

    cold: float
    warm: float
    kernels: int
    bytes: int


def example(page: Path) -> str:
    """The first Python code on a page."""
    found = re.search(r"```python\n(.*?)```", page.read_text(), re.DOTALL)
    if found is None:
        raise ValueError(f"{page} has no Python code.")
    return found.group(1)


def scripts() -> list[Script]:
    """All that is measured."""
    first = example(ROOT / "README.md")
    plane = TWO_RIGID.format(dim=2, shape="Polygon")
    space = TWO_RIGID.format(dim=3, shape="Polyhedron")
    return [
        Script("import dolfinx", ("-c", "import dolfinx")),
        Script("import dolfinx, xper_fx", ("-c", "import dolfinx, xper_fx")),
        Script("README, example", ("-c", first)),
        *(Script(f"docs/guide/{page}.md", ("-c", example(ROOT / "docs" / "guide" / f"{page}.md")))
          for page in PAGES),
        Script("two rigid blocks, 2D", ("-c", plane)),
        Script("two rigid blocks, 3D", ("-c", space)),
        *(Script(f"demos/{demo}.py, first step",
                 ("-c", FIRST_STEP, str(ROOT / "demos" / f"{demo}.py"), "--no-plot", "--quiet"))
          for demo in DEMOS),
        Script("README, example, two ranks", ("-c", first), 2),
    ]  # fmt: skip


def command(script: Script) -> list[str]:
    """The command line of a script."""
    python = [sys.executable, *script.arguments]
    if script.ranks == 1:
        return python
    return ["mpirun", "--oversubscribe", "-n", str(script.ranks), *python]


def processor_time(lines: list[list[str]], kernels: Path, work: Path) -> float:
    """Seconds of the processor that commands take which run at the same time in a folder."""
    environment = os.environ | {
        "XPER_FX_CACHE": str(kernels), "NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1",
        "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]),
    }  # fmt: skip
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # bytecode is kept, as it is by default
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    processes = [
        subprocess.Popen(
            line, env=environment, cwd=work, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
            text=True,
        )
        for line in lines
    ]  # fmt: skip
    for process in processes:
        _, error = process.communicate()
        if process.returncode:
            raise RuntimeError(f"{' '.join(process.args)[:200]} failed:\n{error[-2000:]}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def measure(script: Script, repeats: int) -> Cost:
    """Run a script cold and warm."""
    with tempfile.TemporaryDirectory() as folder:
        kernels, other, work = (Path(folder) / name for name in ("kernels", "other", "work"))
        work.mkdir()
        line = [command(script)]
        processor_time(line, other, work)
        cold = processor_time(line, kernels, work)
        warm = min(processor_time(line, kernels, work) for _ in range(repeats))
        files = list(CacheFolder(kernels).files())
    return Cost(cold, warm, len(files), sum(file.size for file in files))


def table(costs: dict[str, Cost]) -> str:
    """The figures as Markdown."""
    lines = [
        "| script | nothing kept (s) | kept (s) | kernels | files (MB) |",
        "|---|---|---|---|---|",
    ]
    for name, cost in costs.items():
        lines.append(
            f"| {name} | {cost.cold:.1f} | {cost.warm:.2f} | {cost.kernels} "
            f"| {cost.bytes / 1e6:.1f} |"
        )
    return "\n".join(lines)


def eight_at_once(script: Script, alone: Cost) -> str:
    """What eight processes take that start together with no kernel kept."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "kernels"
        together = processor_time([command(script)] * 8, path, Path(folder))
        whole = len(list(CacheFolder(path).files())) == len(list(path.glob("*.kernel")))
    at_best = (alone.cold + 7 * alone.warm) / alone.cold
    return (
        f"Eight processes of '{script.name}' at once, nothing kept: {together:.1f} s, "
        f"{together / alone.cold:.2f} times what one takes ({at_best:.2f} if seven found all "
        f"kernels); all files {'whole' if whole else 'NOT whole'}."
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="Processor time of a start.")
    parser.add_argument("--only", default="", help="scripts whose name has this")
    parser.add_argument("--repeats", type=int, default=3, help="warm runs (default 3)")
    options = parser.parse_args()
    chosen = [script for script in scripts() if options.only in script.name]
    costs = {}
    for script in chosen:
        costs[script.name] = cost = measure(script, options.repeats)
        print(f"{script.name}: {cost.cold:.2f} s, {cost.warm:.2f} s", file=sys.stderr)
    print(table(costs))
    for script in chosen:
        if script.name in TOGETHER:
            print(f"\n{eight_at_once(script, costs[script.name])}")


if __name__ == "__main__":
    main()
