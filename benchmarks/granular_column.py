# SPDX-License-Identifier: LGPL-3.0-or-later
"""Granular columns that collapse: run-outs beside the published law.

Discs settle between two walls at the distance r0, to the height a r0. Then the right wall is taken
away, and the column spreads to r. The published law for discs (Staron and Hinch 2005) is
(r - r0) / r0 = 2.5 a up to a = 2, and 3.25 a^0.7 above. The front is the foremost disc of the heap;
those that roll on alone do not count.

./fenicsx python3 benchmarks/granular_column.py --aspects 1 2 4 --seeds 2
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.stats import uniform
from tqdm.auto import tqdm

import xper_fx as xf

RADIUS, SPREAD, FILLED, GRAVITY, STEP = 0.01, 0.2, 0.8, 9.81, 5e-4
# Free falls from the height of the column that it has to settle, and to spread.
SETTLING, SPREADING = 3.0, 6.0


def settled(count: int, aspect: float, friction: float, seed: int, quiet: bool) -> xf.Simulation:
    """Discs at rest between two walls."""
    width = RADIUS * np.sqrt(np.pi * count / (FILLED * aspect))
    radii = uniform((1.0 - SPREAD) * RADIUS, 2.0 * SPREAD * RADIUS)
    grains = xf.assemblies.packing(radii, (width, np.inf), density=2500.0, seed=seed, count=count)
    law = xf.laws.SignoriniCoulomb(friction=friction)
    scene = xf.Scene(
        rigid=[*grains, *xf.assemblies.box((width, 1.0))],
        contacts=[xf.Contact(("grains", group), law) for group in ("grains", "box")],
        loads=[xf.Gravity((0.0, -GRAVITY))],
    )
    return run(scene, SETTLING * np.sqrt(2.0 * aspect * width / GRAVITY), "settles", quiet)


def run(scene: xf.Scene, end: float, what: str, quiet: bool) -> xf.Simulation:
    """The scene, stepped to an end (s)."""
    simulation = xf.Simulation(scene, STEP)
    steps = simulation.steps(end)
    for _ in tqdm(steps, what, total=round(end / STEP), disable=quiet, leave=False):
        pass
    return simulation


def front(simulation: xf.Simulation, count: int) -> float:
    """Where the heap ends on the right (m): discs in touch, up to a tenth of their size."""
    x = simulation.rigid.state.position[:count]
    r = np.array([body.shape.radius for body in simulation.scene.rigid[:count]])
    pairs = cKDTree(x).query_pairs(2.2 * r.max(), output_type="ndarray")
    apart = np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1)
    pairs = pairs[apart < 1.1 * r[pairs].sum(axis=1)]
    graph = coo_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(count, count))
    label = connected_components(graph, directed=False)[1]
    heap = label == np.argmax(np.bincount(label))
    return float((x[heap, 0] + r[heap]).max())


def run_out(count: int, aspect: float, friction: float, seed: int, quiet: bool):
    """The aspect ratio after settling, and (r - r0) / r0."""
    before = settled(count, aspect, friction, seed, quiet)
    x = before.rigid.state.position
    width = x[-1, 0]  # of the right wall
    height = x[:count, 1].max() + RADIUS
    opened = replace(
        before.scene, rigid=xf.output.rigid_bodies_now(before)[:-1], resolve_overlaps=True
    )
    after = run(opened, SPREADING * np.sqrt(2.0 * height / GRAVITY), "spreads", quiet)
    return height / width, front(after, count) / width - 1.0


def published(aspect: float) -> float:
    """Staron and Hinch (2005)."""
    return 2.5 * aspect if aspect < 2.0 else 3.25 * aspect**0.7


def main(options: list[str] | None = None) -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--aspects", type=float, nargs="+", default=[0.5, 1.0, 2.0, 4.0, 6.0])
    add("--discs", type=int, default=1000)
    add("--friction", type=float, default=0.5)
    add("--seeds", type=int, default=1, help="how many")
    add("--quiet", action="store_true", help="no progress bar")
    args = parser.parse_args(options)
    print("| asked for | settled to | run-out | published | ratio |")
    print("|---|---|---|---|---|", flush=True)
    for aspect in args.aspects:
        for seed in range(args.seeds):
            a, found = run_out(args.discs, aspect, args.friction, seed, args.quiet)
            print(
                f"| {aspect:g} | {a:.2f} | {found:.2f} | {published(a):.2f} | "
                f"{found / published(a):.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
