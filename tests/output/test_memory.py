# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bytes a point and a body, counted from arrays: bounded, and the same whatever the size.

What is measured at the larger size, in bytes a point; "points" are geometry, history and constants
of the laws, "inverse" is w, "bulk" masses and stiffness, "solver" what an explicit bulk keeps for
each vertex. In the plane a body (a triangle) has 3 points, in space (a tetrahedron) 6; `bodies`
are mesh, tags and facing facets, in bytes a body.

| scene | points | inverse | bulk | solver | bodies |
|---|---|---|---|---|---|
| plane, explicit bulk, bonds | 494 | 48 | 129 | 271 | 261 |
| plane, implicit bulk, bonds | 474 | 97 | 129 | 0 | 261 |
| the same, Gauss points | 514 | 97 | 129 | 0 | 261 |
| plane, implicit bulk, contact with friction | 314 | 97 | 129 | 0 | 261 |
| the same, no friction | 186 | 97 | 129 | 0 | 261 |
| space, explicit bulk, bonds | 612 | 66 | 230 | 334 | 380 |
| space, implicit bulk, bonds | 597 | 199 | 230 | 0 | 380 |

Rigid bodies and their contacts: `benchmarks/rigid_speed.py`.
"""

import numpy as np
import pytest
from dolfinx.mesh import CellType, create_box
from mpi4py import MPI

from xper_fx.bodies.explode import explode
from xper_fx.bodies.meshes import crossed_rectangle
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import CohesiveZone, SignoriniCoulomb
from xper_fx.nscd.solvers import vertex_blocks
from xper_fx.output.memory import memory_by_part
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

STEEL = LinearElastic(young=210e9, poisson=0.3, density=7800.0)
BOND = CohesiveZone(1e13, fracture_energy=100.0, strength=1e6, friction=0.3)
CONTACT, FRICTIONLESS = SignoriniCoulomb(friction=0.3), SignoriniCoulomb()


def simulation(dim: int, cells: int, scheme: str, law, points: str) -> Simulation:
    """A plate or a box, each cell a body."""
    if dim == 2:
        mesh = crossed_rectangle((0, 0), (1, 1), (cells, cells))
    else:
        corners = [np.zeros(3), np.ones(3)]
        mesh = create_box(MPI.COMM_WORLD, corners, [cells] * 3, CellType.tetrahedron)
    scene = Scene(explode(mesh), {1: STEEL}, default_interaction=law, points=points)
    return Simulation(scene, None if scheme == "explicit" else 1e-6, scheme=scheme)


def measured(run: Simulation) -> np.ndarray:
    """Bytes a point of points, inverse, bulk and solver; bytes a body of bodies."""
    layer, parts = run.interactions, memory_by_part(run)
    solver = 0
    if run.options.scheme == "explicit":
        solver = sum(a.nbytes for a in vertex_blocks.build(layer))
    points = layer.nbytes - layer.inverse.data.nbytes  # w belongs to the inverse
    held = np.array([points, run.scheme.nbytes, run.bulk.nbytes, solver]) / len(layer)
    return np.append(held, parts["bodies"] / run.scene.bodies.num_bodies)


# Upper bounds on what is measured: points, inverse, bulk, solver, bodies.
CASES = {
    "plane, explicit, bonds": (2, "explicit", BOND, "nodal", (500, 50, 135, 280, 275)),
    "plane, implicit, bonds": (2, "implicit", BOND, "nodal", (480, 100, 135, 0, 275)),
    "plane, implicit, bonds at Gauss points": (
        2, "implicit", BOND, "gauss", (520, 100, 135, 0, 275),
    ),
    "plane, implicit, friction": (2, "implicit", CONTACT, "nodal", (320, 100, 135, 0, 275)),
    "plane, implicit, no friction": (
        2, "implicit", FRICTIONLESS, "nodal", (190, 100, 135, 0, 275),
    ),
    "space, explicit, bonds": (3, "explicit", BOND, "nodal", (625, 70, 240, 345, 400)),
    "space, implicit, bonds": (3, "implicit", BOND, "nodal", (610, 205, 240, 0, 400)),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_bytes_a_point(case):
    dim, scheme, law, points, bounds = CASES[case]
    small, large = (
        measured(simulation(dim, cells, scheme, law, points))
        for cells in ((24, 48) if dim == 2 else (8, 14))
    )
    assert np.all(large <= bounds), (large, bounds)
    linear = np.ones(len(large), bool)
    linear[3] = dim == 2  # in space vertices of the surface, which have few points, count yet
    assert large[linear] == pytest.approx(small[linear], rel=0.05)


def test_all_that_is_held():
    """After a step the parts leave out nothing large, and count no array twice."""
    run = simulation(2, 40, "implicit", BOND, "nodal")
    before = memory_by_part(run)
    for _ in run.steps(run.step_size):
        pass
    after = memory_by_part(run)
    dofs = 8 * run.bulk.num_dofs
    # displacement, velocity, internal forces; before the step too (at rest one array is two of
    # them), and impulses, velocities of slots
    assert before["state"] == pytest.approx(3 * dofs, rel=0.05)
    assert after["state"] == pytest.approx(8 * dofs, rel=0.05)
    for part in ("bodies", "inverse", "bulk", "interactions"):
        assert after[part] == pytest.approx(before[part], rel=0.02), part
    k = run.bulk.stiffness
    matrix = k.data.nbytes + k.indices.nbytes + k.indptr.nbytes
    assert after["bulk"] >= matrix + run.bulk.weights.nbytes
    assert after["bulk"] <= 1.3 * (matrix + run.bulk.weights.nbytes)


@pytest.mark.parametrize("law", [BOND, FRICTIONLESS], ids=["bonds", "no friction"])
def test_points_in_the_scenes_order(law):
    """They are held by law in the order of visit alone, and put together again when asked for."""
    run = simulation(2, 6, "implicit", law, "nodal")
    given, _ = run.model.points.on_slots(run.scheme.inverse(run.step_size, run.state.displacement))
    held = run.interactions.points
    np.testing.assert_array_equal(held.nodes, given.nodes)
    np.testing.assert_array_equal(held.frame[:, 0], given.frame[:, 0])
    for name in ("weights", "area", "gap"):
        np.testing.assert_array_equal(getattr(held, name), getattr(given, name))
