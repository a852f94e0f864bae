# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bytes a point and a body, counted from arrays: bounded, and the same whatever the size.

A point of a facing facet, its share of bodies and bulk included (a triangle has 3 points of order
1 in the middle of a mesh, a tetrahedron 6); `all` is everything that a simulation holds.

| scene | law, points | points | inverse | bulk | solver | all |
|---|---|---|---|---|---|---|
TABLE
"""

import numpy as np
import pytest
from dolfinx.mesh import CellType, create_box
from mpi4py import MPI

from xper_fx.bodies import explode
from xper_fx.materials import LinearElastic
from xper_fx.memory import memory_by_part
from xper_fx.meshes import crossed_rectangle
from xper_fx.nscd.laws import CohesiveZone, SignoriniCoulomb
from xper_fx.scene import Scene
from xper_fx.simulation import Simulation

STEEL = LinearElastic(young=210e9, poisson=0.3, density=7800.0)
BOND = CohesiveZone(1e13, fracture_energy=100.0, strength=1e6, friction=0.3)
CONTACT, FRICTIONLESS = SignoriniCoulomb(friction=0.3), SignoriniCoulomb()


def simulation(dim: int, cells: int, scheme: str, law, points: str) -> Simulation:
    """A plate or a box, each cell a body, after a step."""
    if dim == 2:
        mesh = crossed_rectangle((0, 0), (1, 1), (cells, cells))
    else:
        corners = [np.zeros(3), np.ones(3)]
        mesh = create_box(MPI.COMM_WORLD, corners, [cells] * 3, CellType.tetrahedron)
    scene = Scene(explode(mesh), {1: STEEL}, default_interaction=law, points=points)
    run = Simulation(scene, None if scheme == "explicit" else 1e-6, scheme=scheme, solver="auto")
    for _ in run.steps(run.step_size):
        pass
    return run


# Upper bounds on bytes a point: points with their history, inverse, bulk, solver, all.
CASES = {
    "plane, explicit, bonds": (2, "explicit", BOND, "nodal", (1, 1, 1, 1, 1)),
    "plane, implicit, bonds": (2, "implicit", BOND, "nodal", (1, 1, 1, 1, 1)),
    "plane, implicit, bonds at Gauss points": (2, "implicit", BOND, "gauss", (1, 1, 1, 1, 1)),
    "plane, implicit, friction": (2, "implicit", CONTACT, "nodal", (1, 1, 1, 1, 1)),
    "plane, implicit, no friction": (2, "implicit", FRICTIONLESS, "nodal", (1, 1, 1, 1, 1)),
    "space, explicit, bonds": (3, "explicit", BOND, "nodal", (1, 1, 1, 1, 1)),
    "space, implicit, bonds": (3, "implicit", BOND, "nodal", (1, 1, 1, 1, 1)),
}


@pytest.mark.parametrize("case", CASES)
def test_bytes_a_point(case):
    dim, scheme, law, points, bounds = CASES[case]
    found = []
    for cells in (24, 48) if dim == 2 else (6, 10):
        run = simulation(dim, cells, scheme, law, points)
        count, parts = len(run.interactions), memory_by_part(run)
        shared = run.interactions.inverse.data.nbytes  # counted by both
        found.append(
            np.array(
                [
                    run.interactions.nbytes - shared, run.scheme.nbytes, run.bulk.nbytes,
                    parts["solver"], sum(parts.values()),
                ]
            ) / count
        )  # fmt: skip
    print(case, np.round(found, 1).tolist())
