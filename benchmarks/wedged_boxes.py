# SPDX-License-Identifier: LGPL-3.0-or-later
"""How fast two runs of one rank part that differ in the last digits at the start.

    ./fenicsx python3 benchmarks/wedged_boxes.py

Eight boxes of hexahedra are pressed into each other (`boxes` in `tests/ranks/touching_bodies.py`).
From step 20 on, 26 contacts can push in more ways than one. The second run starts with velocities
that differ by 1e-12, relative. Printed are the differences of kinetic and elastic energy at the end
of each step, the larger one relative to the kinetic energy after the first step; a step that has
been cut counts as one.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

TESTS = Path(__file__).parents[1] / "tests"
sys.path[:0] = [str(TESTS / "shared"), str(TESTS / "ranks")]
import touching_bodies as bodies  # noqa: E402

import xper_fx as xf  # noqa: E402

STEPS, SHIFT = 24, 1e-12


def energies(shift: float) -> np.ndarray:
    """Kinetic and elastic energy of each step, shape (STEPS, 2), J."""
    inwards = bodies.inwards
    bodies.inwards = lambda x: inwards(x) * (1.0 + shift * np.sin(40.0 * x))
    try:
        scene, options, _ = bodies.boxes()
        simulation = xf.Simulation(scene, num_threads=1, **options)
        found = np.zeros((STEPS, 2))
        for record in simulation.steps(STEPS * options["step"]):
            done = record.time / options["step"]
            if abs(done - round(done)) < 1e-6:
                now = record.energies
                found[round(done) - 1] = now["kinetic"], now["elastic"]
        return found
    finally:
        bodies.inwards = inwards


def main() -> None:
    one, other = energies(0.0), energies(SHIFT)
    apart = np.abs(one - other).max(axis=1) / one[0, 0]
    print("| step | difference of the energies |")
    print("|---|---|")
    for step, most in enumerate(apart, start=1):
        print(f"| {step} | {most:.0e} |")


if __name__ == "__main__":
    main()
