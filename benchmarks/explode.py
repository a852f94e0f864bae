# SPDX-License-Identifier: LGPL-3.0-or-later
"""How long a mesh takes to be cut into bodies, and how that grows with its size.

    ./fenicsx python3 benchmarks/explode.py [--largest N] [--repeat R]

Crossed triangles, each its own body: topology, geometry, tags and facing facets. Prints a line a
size: the best of R runs, beside the time DOLFINx takes to create the connected mesh, and the
growth exponent since the line above (1 is linear).
"""

from __future__ import annotations

import argparse
import gc
import math
import time

from xper_fx.bodies.explode import explode
from xper_fx.bodies.meshes import crossed_rectangle


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--largest", type=int, default=640_000, help="largest number of triangles")
    parser.add_argument("--repeat", type=int, default=3, help="runs a size, the best is shown")
    options = parser.parse_args()

    explode(crossed_rectangle((0, 0), (1, 1), (2, 2)))
    print("triangles  facing facets  create mesh (s)  explode (s)  ns a triangle  exponent")
    previous = None
    for n in (50, 100, 200, 400):  # 10 000 to 640 000 triangles
        if 4 * n * n > options.largest:
            break
        creation = explosion = math.inf
        for _ in range(options.repeat):
            gc.collect()
            start = time.perf_counter()
            mesh = crossed_rectangle((0, 0), (1, 1), (n, n))
            created = time.perf_counter()
            bodies = explode(mesh)
            explosion = min(explosion, time.perf_counter() - created)
            creation = min(creation, created - start)
        size = 4 * n * n
        growth = "" if previous is None else f"{math.log(explosion / previous, 4):8.2f}"
        print(
            f"{size:9d}  {len(bodies.facets):13d}  {creation:15.3f}  {explosion:11.3f}  "
            f"{1e9 * explosion / size:13.0f}  {growth}"
        )
        previous = explosion


if __name__ == "__main__":
    main()
