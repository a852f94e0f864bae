# SPDX-License-Identifier: LGPL-3.0-or-later
"""Discs that fall into a box and come to rest: time a step, sweeps, and the share of the search.

./fenicsx python3 benchmarks/settling_discs.py --discs 2640 10000 --solver auto

Times are of the processor, on one thread. The exponent is that of the time of a step in the number
of discs, from the size before at the same time.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from tqdm.auto import tqdm

import xper_fx as xf

RADIUS, GRAVITY, STEP = 0.05, 9.81, 2e-3
# ms a step that LMGC90 is known to take for a heap of so many discs, of a scene and on a machine
# that are not known: an order of magnitude.
OF_LMGC90 = {2640: 70.0}


def box_of_discs(count: int, across: int) -> xf.Scene:
    """Discs of 0.7 to 1 times the largest radius on a loose lattice, `across` in a row."""
    rng, pitch = np.random.default_rng(0), 2.1 * RADIUS
    radii = RADIUS * rng.uniform(0.7, 1.0, count)
    x = pitch * (np.arange(count) % across) + RADIUS * rng.uniform(1.05, 1.1, count)
    y = pitch * (np.arange(count) // across) + RADIUS
    bodies = [
        xf.RigidBody(xf.rigid.Disc(radius), place, "discs", density=1000.0)
        for radius, *place in zip(radii, x, y, strict=True)
    ]
    width = pitch * across + RADIUS
    for point, normal in (((0, 0), (0, 1)), ((0, 0), (1, 0)), ((width, 0), (-1, 0))):
        bodies.append(xf.rigid.wall(point, normal, "box"))
    law = xf.laws.SignoriniCoulomb(friction=0.3)
    return xf.Scene(
        rigid=bodies,
        contacts=[xf.Contact(("discs", group), law) for group in ("discs", "box")],
        loads=[xf.Gravity((0.0, -GRAVITY))],
    )


class Search:
    """Times the searches of a simulation, points of interaction included (s)."""

    def __init__(self, simulation: xf.Simulation):
        self.seconds, self._renew = 0.0, simulation.detection.renew
        simulation.detection.renew = self

    def __call__(self, *arguments) -> None:
        start = time.process_time()
        self._renew(*arguments)
        self.seconds += time.process_time() - start


def main(options: list[str] | None = None) -> None:
    """Run, and print each third of the time."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--discs", type=int, nargs="+", default=[2640])
    add("--solver", nargs="+", default=["auto"])
    add("--steps", type=int, default=300, help=f"of {STEP:g} s")
    add("--quiet", action="store_true", help="no progress bar")
    args = parser.parse_args(options)
    third = args.steps // 3
    print("| discs | solver | until (s) | contacts | sweeps a step | ms a step | of it search | "
          "exponent |\n|---|---|---|---|---|---|---|---|", flush=True)  # fmt: skip
    for solver in args.solver:
        for _ in xf.Simulation(box_of_discs(100, 10), STEP, solver=solver).steps(0.2):
            pass  # compiles
        before = {}
        for count in args.discs:
            scene = box_of_discs(count, round(np.sqrt(1.65 * count)))
            simulation = xf.Simulation(scene, STEP, solver=solver, num_threads=1)
            search, sweeps, last = Search(simulation), 0, time.process_time()
            steps = simulation.steps(3 * third * STEP)
            for record in tqdm(steps, total=3 * third, disable=args.quiet):
                sweeps += record.sweeps
                if record.step % third:
                    continue
                spent = time.process_time() - last
                contacts = sum(len(group) for group in simulation.interactions.contacts)
                ms, exponent = spent / third * 1e3, ""
                if record.step in before:
                    size, earlier = before[record.step]
                    exponent = f"{np.log(ms / earlier) / np.log(count / size):.2f}"
                print(
                    f"| {count} | {solver} | {record.time:.2g} | {contacts} | "
                    f"{sweeps / third:.0f} | {ms:.1f} | {search.seconds / spent:.0%} | "
                    f"{exponent} |",
                    flush=True,
                )
                before[record.step] = count, ms
                search.seconds, sweeps, last = 0.0, 0, time.process_time()
            if count in OF_LMGC90:
                known = OF_LMGC90[count]
                print(f"LMGC90, a heap of {count} discs: {known:g} ms a step, {ms / known:.2g} of "
                      "it here in the last third", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
