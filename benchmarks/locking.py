# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which triangles lock in plastic flow, which keeps the volume: a strip and Prandtl's punch.

    ./fenicsx python3 benchmarks/locking.py [--cells 4 8 16 32] [--punch-cells 8 16 32]

Perfect plasticity at small strain, plane strain, k = sigma_0 / sqrt(3) the yield stress in shear.

- Strip: a square pulled between rough rigid plates. Slip lines at 45 degrees join its corners, so
  that the exact force is 2 k w, as between smooth plates.
- Prandtl's punch: a rough rigid strip of half width 1 pressed into a block of half width 4 and
  depth 3, wide enough for the mechanism. The exact mean pressure is (2 + pi) k.

Meshes are compatible: their limit loads are above the exact ones. Each is driven far past its own;
beside the force the last slope over the first one is printed, as a mesh that locks has no limit
load. Triangles of order 1 and 2, with diagonals all one way or crossed.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from dolfinx.mesh import CellType, DiagonalType, create_rectangle
from mpi4py import MPI

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from statics import Static  # noqa: E402

from xper_fx.bodies import explode  # noqa: E402
from xper_fx.materials import J2SmallStrain, Linear  # noqa: E402
from xper_fx.meshes import crossed_rectangle, tag_cells, tag_facets  # noqa: E402

YOUNG, YIELD = 1000.0, 1.0
SHEAR_YIELD = YIELD / np.sqrt(3.0)
METAL = J2SmallStrain(YOUNG, 0.3, YIELD, Linear(0.0), 1.0)
FAMILIES = {
    "order 1, diagonals one way": ("right", 1),
    "order 1, crossed": ("crossed", 1),
    "order 2, diagonals one way": ("right", 2),
    "order 2, crossed": ("crossed", 2),
}
LEFT, RIGHT, BOTTOM, TOP, PUNCH = 1, 2, 3, 4, 5


def block(size, cells, kind, predicates):
    """One body, a rectangle from the origin with tagged facets."""
    if kind == "crossed":
        mesh = crossed_rectangle((0.0, 0.0), size, cells, MPI.COMM_SELF)
    else:
        mesh = create_rectangle(
            MPI.COMM_SELF,
            [np.zeros(2), np.array(size)],
            cells,
            CellType.triangle,
            diagonal=DiagonalType.right,
        )
    count = mesh.topology.index_map(2).size_local
    return explode(mesh, np.zeros(count, int), tag_cells(mesh, {}), tag_facets(mesh, predicates))


def near(axis, value):
    return lambda x: np.abs(x[axis] - value) < 1e-9


def strip(kind, order, cells):
    """A square between rough plates: the problem, where and which way it is pulled, exact force."""
    bodies = block((1.0, 1.0), (cells, cells), kind, {BOTTOM: near(1, 0.0), TOP: near(1, 1.0)})
    held = [(BOTTOM, 0, 0.0), (BOTTOM, 1, 0.0), (TOP, 0, 0.0), (TOP, 1, lambda u: u)]
    return Static(bodies, order, {1: METAL}, held), TOP, 1.0, 2.0 * SHEAR_YIELD


def punch(kind, order, cells):
    """Half of Prandtl's punch, a quarter of the `cells` under it; as `strip`."""
    width, depth = 4.0, 3.0
    predicates = {
        LEFT: near(0, 0.0),
        RIGHT: near(0, width),
        BOTTOM: near(1, 0.0),
        PUNCH: lambda x: (np.abs(x[1] - depth) < 1e-9) & (x[0] < 1.0 + 1e-9),
    }
    bodies = block((width, depth), (cells, 3 * cells // 4), kind, predicates)
    held = [(LEFT, 0, 0.0), (RIGHT, 0, 0.0), (BOTTOM, 0, 0.0), (BOTTOM, 1, 0.0)]
    held += [(PUNCH, 0, 0.0), (PUNCH, 1, lambda u: -u)]
    return Static(bodies, order, {1: METAL}, held), PUNCH, -1.0, (2.0 + np.pi) * SHEAR_YIELD


def press(problem, kind, order, cells, last, steps):
    """Force over the exact one at the end of a ramp, last slope over the first, number of dofs."""
    static, tag, sign, reference = problem(kind, order, cells)
    loads = np.linspace(0.0, last, steps + 1)[1:]
    forces = []
    for load in loads:
        static.advance(load, most=60)
        forces.append(sign * static.reaction(tag, 1))
    slopes = np.diff([0.0, *forces])
    return forces[-1] / reference, slopes[-1] / slopes[0], static.bulk.num_dofs


def table(name, problem, sizes, last, steps):
    print(f"\n{name}")
    print(f"{'elements':<28}{'cells':>7}{'dofs':>8}{'force':>9}{'slope':>10}{'time':>9}")
    for family, (kind, order) in FAMILIES.items():
        for cells in sizes:
            start = time.perf_counter()
            try:
                force, slope, dofs = press(problem, kind, order, cells, last, steps)
            except AssertionError:
                print(f"{family:<28}{cells:>7}  no equilibrium found")
                continue
            spent = time.perf_counter() - start
            print(f"{family:<28}{cells:>7}{dofs:>8}{force:>9.4f}{slope:>10.1e}{spent:>7.1f} s")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="+", default=[4, 8, 16])
    parser.add_argument("--punch-cells", type=int, nargs="+", default=[8, 16, 32])
    arguments = parser.parse_args()
    table("strip: force / (2 k w)", strip, arguments.cells, 0.02, 20)
    table("punch: force / ((2 + pi) k)", punch, arguments.punch_cells, 0.06, 30)


if __name__ == "__main__":
    main()
