# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton's method on searched contacts with and without a factorisation of its matrix.

    ./fenicsx python3 benchmarks/flying_blocks.py [--scenes cloud slide boxes] [--large]

Scenes of `tests/ranks/touching_bodies.py`: blocks that fly into each other in 2D and in 3D, and a
beam of bonded blocks that slides over another; `--large` adds 192 blocks of 36 squares. Each runs
by turns with GMRES alone and with the matrix factored once GMRES has taken many iterations
(`nscd/solvers/tangent.py`), after a first run that compiles: processor times of all steps, one
thread.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from time import process_time

TESTS = Path(__file__).parents[1] / "tests"
sys.path[:0] = [str(TESTS / "shared"), str(TESTS / "ranks")]
import touching_bodies as bodies  # noqa: E402

import xper_fx as xf  # noqa: E402
from xper_fx.nscd.solvers import tangent  # noqa: E402


def blocks():
    """192 blocks of 6 x 6 crossed squares, a hundredth of their side apart, fly inwards."""
    scene = xf.Scene(
        bodies.apart((16, 12), (96, 72), gap=0.00375), {1: bodies.ELASTIC},
        initial_velocity=lambda x: bodies.inwards(x[:2]), **bodies.EACH_OTHER,
    )  # fmt: skip
    return scene, {"step": 2e-3, "tolerance": 1e-8, "scheme": "implicit"}, 13


def run(make, limit: dict[int, int]) -> tuple[float, int, int]:
    """Processor time of the steps, sweeps, and degrees of freedom at contacts."""
    tangent.DIRECT = limit
    scene, options, steps = make()
    simulation = xf.Simulation(scene, num_threads=1, **options)
    start = process_time()
    sweeps = sum(r.sweeps for r in simulation.steps(steps * simulation.step_size))
    inverse = simulation.interactions.inverse
    return process_time() - start, sweeps, inverse.num_slots * scene.dim


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", nargs="*", default=["cloud", "slide", "boxes"])
    parser.add_argument("--large", action="store_true", help="192 blocks, some minutes")
    options = parser.parse_args(arguments)
    scenes = {name: bodies.SCENES[name] for name in options.scenes}
    if options.large:
        scenes["192 blocks"] = blocks
    limit, never = tangent.DIRECT, {2: 0, 3: 0}
    print("| scene | unknowns | GMRES alone (s) | sweeps | factored (s) | sweeps | ratio |")
    print("|---|---|---|---|---|---|---|")
    for name, make in scenes.items():
        run(make, limit)
        alone, many, size = run(make, never)
        factored, few, _ = run(make, limit)
        print(
            f"| {name} | {size} | {alone:.2f} | {many} | {factored:.2f} | {few} | "
            f"{alone / factored:.1f} |", flush=True,
        )  # fmt: skip


if __name__ == "__main__":
    main()
