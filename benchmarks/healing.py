# SPDX-License-Identifier: LGPL-3.0-or-later
"""Overlaps of rigid bodies with and without healing: a heap, a wall, and a tower.

- heap: discs fall into a box. Overlaps of contacts that push, relative to the largest radius; the
  kinetic energy; what healing has given and impacts have taken; processor time so far.
- wall: 5 x 10 blocks hop on a table that is shaken up and down at 4 Hz by 0.6 m/s, for a whole
  number of periods. How far a block has gone, sideways and downwards, and the deepest overlap.
- tower: a hundred blocks for ten seconds.

./fenicsx python3 benchmarks/healing.py heap --figure healing.png
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator

import numpy as np
from settling_discs import RADIUS, STEP, box_of_discs
from tall_stack import tower
from tqdm.auto import tqdm

import xper_fx as xf

SHAKE = 0.6


def overlaps(simulation: xf.Simulation) -> tuple[float, float]:
    """The deepest overlap, and the mean one of contacts that push (m)."""
    groups = simulation.interactions.contacts
    gap = np.concatenate([group.jump[:, 0] for group in groups])
    pushes = np.concatenate([group.impulse[:, 0] for group in groups]) > 0.0
    return -float(gap.min(initial=0.0)), -float(gap[pushes].mean()) if pushes.any() else 0.0


def fall(count: int, steps: int, healing: bool, quiet: bool) -> Iterator[tuple]:
    """Discs that fall into a box; 50 times what the module docstring names."""
    scene = box_of_discs(count, round(np.sqrt(1.65 * count)))
    simulation = xf.Simulation(scene, STEP, num_threads=1, healing=healing)
    start = time.process_time()
    records = simulation.steps(steps * STEP)
    for record in tqdm(records, total=steps, disable=quiet):
        if record.step % (steps // 50):
            continue
        energies = record.energies
        yield (
            record.time, *(x / RADIUS for x in overlaps(simulation)), energies["kinetic"],
            energies.get("healing", 0.0), energies["dissipated_impact"],
            time.process_time() - start,
        )  # fmt: skip


def heap(args: argparse.Namespace) -> None:
    """Print the tables and draw the overlaps."""
    found = {}
    for healing in (False, True):
        print(f"\nhealing={healing}\n")
        print("| t (s) | deepest / R | mean / R | kinetic (J) | given | impacts | s |")
        print("|---|---|---|---|---|---|---|", flush=True)
        found[healing] = []
        for row in fall(args.discs, args.steps, healing, args.quiet):
            line = "| {:.2f} | {:.1e} | {:.1e} | {:.1e} | {:.4g} | {:.5g} | {:.1f} |"
            print(line.format(*row), flush=True)
            found[healing].append(row)
    if args.figure is None:
        return
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6.0, 3.2), constrained_layout=True)
    for healing, colour in ((False, "#D55E00"), (True, "#0072B2")):
        t, deepest, mean = np.array(found[healing])[:, :3].T
        name = "with healing" if healing else "without"
        axes.semilogy(t, deepest, color=colour, label=f"deepest, {name}")
        axes.semilogy(t, mean, "--", color=colour, label=f"mean, {name}")
    axes.set_xlabel("time (s)")
    axes.set_ylabel("overlap / largest radius")
    axes.set_ylim(2e-4, 1.0)
    axes.legend(frameon=False, loc="upper center", ncols=2)
    figure.savefig(args.figure, dpi=150)


def wall(args: argparse.Namespace) -> None:
    """Print where the blocks have gone."""
    print("| healing | sideways (m) | downwards (m) | deepest (m) | moved in steps | given (J) |")
    print("|---|---|---|---|---|---|", flush=True)
    shaken = {0: 0.0, 1: lambda t: SHAKE * np.sin(8.0 * np.pi * t), 2: 0.0}
    table = xf.RigidBody(xf.rigid.Polygon.box((6.0, 1.0)), (1.0, -0.5), "table", prescribed=shaken)
    law = xf.laws.SignoriniCoulomb(friction=0.65)
    scene = xf.Scene(
        rigid=[table, *xf.assemblies.masonry_wall(5, 10, block=(0.4, 0.2), density=2000.0)],
        contacts=[xf.Contact(("blocks", group), law) for group in ("blocks", "table")],
        loads=[xf.Gravity((0.0, -9.81))],
    )
    for healing in (False, True):
        simulation = xf.Simulation(scene, 5e-3, num_threads=1, healing=healing)
        start = simulation.rigid.state.position.copy()
        for _ in tqdm(simulation.steps(args.end), disable=args.quiet):
            pass
        moved = (simulation.rigid.state.position - start)[1:]
        count = 0 if simulation.model.healing is None else simulation.model.healing.count
        given = simulation.ledger.energies.healing
        print(
            f"| {healing} | {np.abs(moved[:, 0]).max():.1e} | {-moved[:, 1].min():.1e} | "
            f"{overlaps(simulation)[0]:.1e} | {count} | {given:.3g} |",
            flush=True,
        )


def stack(args: argparse.Namespace) -> None:
    """Print how far the blocks of the tower have gone."""
    print("| healing | drift (m) | sinking (m) | deepest (m) | moved in steps |")
    print("|---|---|---|---|---|", flush=True)
    for healing in (False, True):
        simulation = tower(2, 100, 5e-3, 1e-3, "velocity", healing=healing)
        start = simulation.rigid.state.position.copy()
        for _ in tqdm(simulation.steps(args.end), disable=args.quiet):
            pass
        moved = np.abs(simulation.rigid.state.position - start).max(axis=0)
        count = 0 if simulation.model.healing is None else simulation.model.healing.count
        print(
            f"| {healing} | {moved[0]:.1e} | {moved[1]:.1e} | {overlaps(simulation)[0]:.1e} | "
            f"{count} |",
            flush=True,
        )


def main(options: list[str] | None = None) -> None:
    """Run one of the studies."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("study", choices=("heap", "wall", "tower"))
    add("--discs", type=int, default=900)
    add("--steps", type=int, default=1000, help=f"of {STEP:g} s, of the heap")
    add("--end", type=float, default=10.0, help="s, of the wall and the tower")
    add("--figure", help="file of the figure of the heap")
    add("--quiet", action="store_true", help="no progress bar")
    args = parser.parse_args(options)
    {"heap": heap, "wall": wall, "tower": stack}[args.study](args)


if __name__ == "__main__":
    main()
