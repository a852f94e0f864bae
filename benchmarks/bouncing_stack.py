# SPDX-License-Identifier: LGPL-3.0-or-later
"""A stack of masses that bounces without loss for a million steps: how far its energy drifts.

./fenicsx python3 benchmarks/bouncing_stack.py
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tqdm.auto import trange

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "shared"))
from stacks import Stack  # noqa: E402

MASSES, GAP, STEP = (1.0, 2.0, 0.5, 3.0, 1.5), 0.01, 2e-3


def main(options: list[str] | None = None) -> None:
    """Run and print the largest deviations at each decade of steps."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    args = parser.parse_args(options)
    stack = Stack(MASSES, [GAP * (i + 1) for i in range(len(MASSES))], 1.0)
    start, weight = stack.energy, stack.gravity * stack.masses.sum()
    energy = depth = 0.0
    rows, look = [], 10
    for number in trange(1, args.steps + 1, disable=args.quiet):
        stack.step(STEP)
        energy = max(energy, abs(stack.energy / start - 1.0))
        depth = max(depth, -stack.gaps.min() / GAP)
        if number in (look, args.steps):
            given = weight * number * STEP
            missing = abs(stack.momentum + given - stack.ground_impulse) / given
            rows.append((number, energy, missing, depth))
            look *= 10
    print("| steps | energy error | momentum error | largest depth / gap at the start |")
    print("|---|---|---|---|")
    for number, *errors in rows:
        print(f"| {number} | " + " | ".join(f"{e:.1e}" for e in errors) + " |")


if __name__ == "__main__":
    main()
