# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the search of contacts between rigid bodies costs, a pair and a body, from 1000 bodies on.

    ./fenicsx python3 benchmarks/contact_search.py [--sizes 1000 10000 100000] [--repeat R]

Dense packings, bodies numbered at random: discs and spheres on a jittered lattice, bricks and boxes
in stacks. For each number of bodies

- pairs: candidates in the list, and contacts found;
- bytes: memory of the list, a candidate, and of the contacts that one search returns, a contact;
- search: processor time of a search that keeps its list, a candidate;
- list: processor time of making the list, a candidate, and its price over that of a search;
- exponent: of the time of either in the number of bodies, from the line before.

Other work on the machine disturbs: the least of R runs counts.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from xper_fx.nscd.rigid import Disc, Polygon, Polyhedron, RigidBodies, RigidBody, Sphere
from xper_fx.nscd.search.rigid_search import RigidSearch

REACH = 0.01


def packing(shape, count: int) -> tuple[RigidBodies, np.ndarray]:
    """Bodies of unit size on a lattice with a jitter of 1 %, in random order."""
    rng = np.random.default_rng(count)
    side = int(np.ceil(count ** (1.0 / shape.dim)))
    lattice = np.stack(np.meshgrid(*[np.arange(side)] * shape.dim), axis=-1)
    position = lattice.reshape(-1, shape.dim)[:count] + 0.01 * rng.normal(size=(count, shape.dim))
    rng.shuffle(position)
    bodies = RigidBodies([RigidBody(shape, x, "grains", density=1.0) for x in position])
    return bodies, position


def least(repeat: int, work: Callable, *arguments) -> float:
    """Least processor time of a call (s)."""
    times = []
    for _ in range(repeat):
        start = time.process_time()
        work(*arguments)
        times.append(time.process_time() - start)
    return min(times)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[1000, 10_000, 100_000])
    parser.add_argument("--repeat", type=int, default=5)
    arguments = parser.parse_args()
    shapes = {
        "discs": Disc(0.5),
        "bricks": Polygon.box([1.0, 1.0]),
        "spheres": Sphere(0.5),
        "boxes": Polyhedron.box([1.0, 1.0, 1.0]),
    }
    print(
        f"{'':8} {'bodies':>7} {'pairs':>8} {'contacts':>8} {'bytes':>9} {'search':>7} {'list':>7} "
        f"{'price':>6}  exponents"
    )
    for name, shape in shapes.items():
        before = None
        for count in arguments.sizes:
            bodies, position = packing(shape, count)
            search = RigidSearch(bodies, [("grains", "grains")], REACH)
            contacts = search.find(position, bodies.rotation)
            pairs = search.num_candidates
            find = least(arguments.repeat, search.find, position, bodies.rotation)
            assert search.renewals == 1
            renew = least(arguments.repeat, search._renew, position, search._old_rotation)
            exponents = ""
            if before is not None:
                ratio = np.log(count / before[0])
                exponents = " ".join(
                    f"{np.log(now / then) / ratio:.2f}"
                    for now, then in zip((find, renew), before[1:], strict=True)
                )
            before = count, find, renew
            a_contact = sum(a.nbytes for a in contacts) / max(len(contacts), 1)
            print(
                f"{name:8} {count:7} {pairs:8} {len(contacts):8} {search.nbytes / pairs:4.0f} "
                f"{a_contact:4.0f} {find / pairs * 1e9:7.1f} {renew / pairs * 1e9:7.0f} "
                f"{renew / find:6.1f}  {exponents}"
            )


if __name__ == "__main__":
    main()
