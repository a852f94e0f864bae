# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which triangles lock in plastic flow, which keeps the volume: a strip and Prandtl's punch.

    ./fenicsx python3 benchmarks/locking.py [--cells 4 8 16] [--punch-cells 8 16] [--weak-bonds]

Perfect plasticity at small strain, plane strain, k = sigma_0 / sqrt(3) the yield stress in shear.

- Strip: a square pulled between rough rigid plates. Slip lines at 45 degrees join its corners, so
  that the exact force is 2 k w, as between smooth plates.
- Prandtl's punch: a rough rigid strip of half width 1 pressed into a block of half width 4 and
  depth 3, wide enough for the mechanism. The exact mean pressure is (2 + pi) k.

Meshes are compatible: their limit loads are above the exact ones. Each is driven far past its own;
beside the force the last slope over the first one is printed, as a mesh that locks has no limit
load. Triangles of order 1 and 2, with diagonals all one way or crossed, connected or each a body.

Bodies of one cell are bonded perfectly, or by the cohesive zone of the notched plate's matrix, its
numbers taken relative to the facet and the solid (`plate_bond`). It breaks at 2.2 times the yield
stress, which the corners of the punch exceed: then the force is that of a cracked block, and takes
minutes, so that these rows are printed with `--weak-bonds` only. Bodies need some mass: so little
that the force differs by 1e-4 at most.
"""

from __future__ import annotations

import argparse
import time
from typing import NamedTuple

import numpy as np
from dolfinx.mesh import CellType, DiagonalType, create_rectangle
from mpi4py import MPI

from xper_fx.bodies.explode import EACH_CELL, explode
from xper_fx.bodies.meshes import crossed_rectangle, tag_cells, tag_facets
from xper_fx.forms.loads import PrescribedDisplacement
from xper_fx.materials import J2SmallStrain, Linear
from xper_fx.materials.library import ZIRCALOY_4_DUCTILE, ZIRCALOY_BOND
from xper_fx.nscd.laws import CohesiveZone, PerfectBond
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.errors import ConvergenceError

YOUNG, YIELD = 1000.0, 1.0
SHEAR_YIELD = YIELD / np.sqrt(3.0)
METAL = J2SmallStrain(YOUNG, 0.3, YIELD, Linear(0.0), 1e-4)
LEFT, RIGHT, BOTTOM, TOP, PUNCH = 1, 2, 3, 4, 5


class Family(NamedTuple):
    """Triangles: their diagonals, "right" or "crossed"; order; bond between them, if any."""

    diagonals: str
    order: int
    bond: str | None = None


FAMILIES = {
    "order 1, diagonals one way": Family("right", 1),
    "order 1, crossed": Family("crossed", 1),
    "order 2, diagonals one way": Family("right", 2),
    "order 2, crossed": Family("crossed", 2),
    "order 1, crossed, each a body": Family("crossed", 1, "perfect"),
}
WEAK_BONDS = {"the same, the plate's bonds": Family("crossed", 1, "plate")}
ADVICE = (
    "Advice: where bodies flow plastically take bodies of many cells and order 2; if each cell "
    "must be a body, cross the triangles and refine, for as long as bonds hold they bear what "
    "connected ones do."
)


class Problem(NamedTuple):
    """What is driven: the scene, the tag that moves and its sign, the exact force (N/m)."""

    scene: Scene
    tag: int
    sign: float
    exact: float


class Pressed(NamedTuple):
    """Force over the exact one at the end, last slope over the first, dofs, broken points."""

    force: float
    slope: float
    dofs: int
    broken: int


def plate_bond(facet: float) -> CohesiveZone:
    """The bond of the notched plate's matrix, beside a facet of 2.5 um there and `facet` (m) here.

    Kept are strength over yield stress, stiffness times facet over Young's modulus, and cohesive
    length over facet.
    """
    metal, bond = ZIRCALOY_4_DUCTILE, ZIRCALOY_BOND
    there = 2.5e-6
    strength = bond.strength / metal.yield_stress * YIELD
    stiffness = bond.normal_stiffness * there / metal.young * YOUNG / facet
    length = metal.young * bond.fracture_energy / bond.strength**2 / there * facet
    return CohesiveZone(stiffness, length * strength**2 / YOUNG, strength, friction=bond.friction)


def scene_of(family: Family, size, cells, predicates, held, bond_facet: float) -> Scene:
    """A rectangle from the origin with tagged facets and held displacements."""
    if family.diagonals == "crossed":
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
    bodies = EACH_CELL if family.bond else np.zeros(count, int)
    laws = {None: None, "perfect": PerfectBond(), "plate": plate_bond(bond_facet)}
    return Scene(
        explode(mesh, bodies, tag_cells(mesh, {}), tag_facets(mesh, predicates)),
        {1: METAL},
        default_interaction=laws[family.bond],
        loads=[PrescribedDisplacement(*motion) for motion in held],
        order=family.order,
    )


def near(axis, value):
    return lambda x: np.abs(x[axis] - value) < 1e-9


def strip(family: Family, cells: int) -> Problem:
    """A square of `cells` a side, pulled between rough plates."""
    held = [(BOTTOM, 0, 0.0), (BOTTOM, 1, 0.0), (TOP, 0, 0.0), (TOP, 1, lambda t: t)]
    predicates = {BOTTOM: near(1, 0.0), TOP: near(1, 1.0)}
    scene = scene_of(family, (1.0, 1.0), (cells, cells), predicates, held, 1.0 / cells)
    return Problem(scene, TOP, 1.0, 2.0 * SHEAR_YIELD)


def punch(family: Family, cells: int) -> Problem:
    """Half of Prandtl's punch, a quarter of the `cells` under it."""
    width, depth = 4.0, 3.0
    predicates = {
        LEFT: near(0, 0.0),
        RIGHT: near(0, width),
        BOTTOM: near(1, 0.0),
        PUNCH: lambda x: (np.abs(x[1] - depth) < 1e-9) & (x[0] < 1.0 + 1e-9),
    }
    held = [(LEFT, 0, 0.0), (RIGHT, 0, 0.0), (BOTTOM, 0, 0.0), (BOTTOM, 1, 0.0)]
    held += [(PUNCH, 0, 0.0), (PUNCH, 1, lambda t: -t)]
    scene = scene_of(
        family, (width, depth), (cells, 3 * cells // 4), predicates, held, width / cells
    )
    return Problem(scene, PUNCH, -1.0, (2.0 + np.pi) * SHEAR_YIELD)


def press(problem, family: Family, cells: int, last: float, steps: int) -> Pressed:
    """Drive a problem to a displacement (m) in equal steps."""
    scene, tag, sign, exact = problem(family, cells)
    simulation = Simulation(
        scene, last / steps, theta=1.0, tolerance=1e-5, inertia=family.bond is not None
    )
    times, forces = [0.0], [0.0]
    for step in simulation.steps(last):
        times.append(step.time)
        forces.append(sign * simulation.reaction(tag)[1])
    slopes = np.diff(forces) / np.diff(times)
    broken = 0
    if family.bond == "plate":
        broken = int(np.count_nonzero(simulation.interactions.gather("damage") < 1e-3))
    return Pressed(forces[-1] / exact, slopes[-1] / slopes[0], simulation.bulk.num_dofs, broken)


def table(name, problem, families, sizes, last, steps):
    print(f"\n{name}")
    print(
        f"{'elements':<30}{'cells':>6}{'dofs':>8}{'force':>9}{'slope':>10}{'broken':>8}{'time':>9}"
    )
    for title, family in families.items():
        for cells in sizes:
            start = time.perf_counter()
            try:
                found = press(problem, family, cells, last, steps)
            except ConvergenceError:
                print(f"{title:<30}{cells:>6}  no equilibrium found")
                continue
            spent = time.perf_counter() - start
            print(
                f"{title:<30}{cells:>6}{found.dofs:>8}{found.force:>9.4f}{found.slope:>10.1e}"
                f"{found.broken:>8}{spent:>7.1f} s",
                flush=True,
            )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="+", default=[4, 8, 16])
    parser.add_argument("--punch-cells", type=int, nargs="+", default=[8, 16, 32])
    parser.add_argument("--weak-bonds", action="store_true", help="the plate's bonds as well")
    arguments = parser.parse_args()
    families = FAMILIES | (WEAK_BONDS if arguments.weak_bonds else {})
    table("strip: force / (2 k w)", strip, families, arguments.cells, 0.02, 20)
    table("punch: force / ((2 + pi) k)", punch, families, arguments.punch_cells, 0.06, 30)
    print(f"\n{ADVICE}")


if __name__ == "__main__":
    main()
