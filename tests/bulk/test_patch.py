# SPDX-License-Identifier: LGPL-3.0-or-later
"""Patch tests: what is cut and bonded again is what was not cut."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
import ufl
from dolfinx import fem
from scenes import (
    BOTTOM,
    EXACT,
    LEFT,
    RIGHT,
    box_bodies,
    field,
    mesh_of,
    midpoints,
    nodes,
    run,
    side_tags,
)
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from xper_fx.forms.compiled import compiled_form
from xper_fx.forms.loads import (
    BodyForce,
    Gravity,
    PrescribedDisplacement,
    PrescribedVelocity,
    RayleighDamping,
    SurfaceTraction,
)
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import CohesiveZone, PerfectBond
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

SOFT, HARD = LinearElastic(100.0, 0.3, 1.0), LinearElastic(300.0, 0.2, 2.0)
STEP, STEPS = 0.02, 5
TRACTION, FORCE, GRAVITY = (2.0, 1.0, 3.0), (0.5, -1.0, 0.25), (-0.3, 0.2, 0.7)


def hard(x):
    """The right half is of the second material."""
    return x[0] > 1.0


def traction_at(time):
    return 3.0 * np.sin(10.0 * time)


def connected_reference(kind, lengths, cells, order, theta):
    """Theta scheme on the connected mesh, in DOLFINx and SciPy alone.

    Rayleigh damping M + 0.01 K; left side held but for a prescribed velocity of component 1;
    body force, gravity and a traction that varies in time on the right.
    """
    mesh = mesh_of(lengths, cells, kind)
    dim = mesh.geometry.dim
    tags = side_tags(mesh, lengths)
    V = fem.functionspace(mesh, ("Lagrange", order, (dim,)))
    constants = fem.functionspace(mesh, ("DG", 0))
    lam, mu, rho = (fem.Function(constants) for _ in range(3))
    is_hard = hard(midpoints(mesh))
    for material, where in ((SOFT, ~is_hard), (HARD, is_hard)):
        E, nu = material.young, material.poisson
        lam.x.array[where] = E * nu / (1 + nu) / (1 - 2 * nu)
        mu.x.array[where] = E / 2 / (1 + nu)
        rho.x.array[where] = material.density
    u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
    eps = lambda w: ufl.sym(ufl.grad(w))  # noqa: E731
    form = lam * ufl.div(u) * ufl.div(v) + 2 * mu * ufl.inner(eps(u), eps(v))
    K = sp.csr_array(fem.assemble_matrix(compiled_form(form * ufl.dx)).to_scipy())
    mass = fem.assemble_matrix(compiled_form(rho * ufl.inner(u, v) * ufl.dx)).to_scipy().diagonal()
    total = fem.assemble_scalar(compiled_form(rho * ufl.dx))
    mass = mass * total * dim / mass.sum()  # lumped as the diagonal of the consistent mass
    density = ufl.as_vector([rho * g for g in GRAVITY[:dim]]) + ufl.as_vector(FORCE[:dim])
    steady = fem.assemble_vector(compiled_form(ufl.inner(density, v) * ufl.dx)).array.copy()
    ds = ufl.Measure("ds", mesh, subdomain_data=tags)
    pull = ufl.as_vector([1.0] + [0.0] * (dim - 1))
    moving = fem.assemble_vector(compiled_form(ufl.inner(pull, v) * ds(RIGHT))).array.copy()
    rest = ufl.as_vector([0.0, *TRACTION[1:dim]])
    steady += fem.assemble_vector(compiled_form(ufl.inner(rest, v) * ds(RIGHT))).array
    left = fem.locate_dofs_topological(V, dim - 1, tags.find(LEFT))
    fixed = np.zeros(len(mass), bool)
    fixed[(left[:, None] * dim + np.arange(2)).ravel()] = True
    C = sp.diags_array(mass) + 0.01 * K
    A = sp.csc_array(sp.diags_array(mass) + STEP * theta * C + (STEP * theta) ** 2 * K)
    free = np.flatnonzero(~fixed)
    lu = splu(sp.csc_matrix(A[free][:, free]))
    q, w = np.zeros(len(mass)), np.zeros(len(mass))
    external = lambda t: steady + traction_at(t) * moving  # noqa: E731
    for n in range(STEPS):
        t0, t1 = n * STEP, (n + 1) * STEP
        new = w.copy()
        new[left * dim], new[left * dim + 1] = 0.0, np.cos(t1)
        middle = q + STEP * (1 - theta) * w
        rhs = STEP * (theta * external(t1) + (1 - theta) * external(t0))
        rhs = rhs + mass * w - STEP * (1 - theta) * (K @ q + C @ w) - STEP * theta * (K @ middle)
        new[free] = lu.solve((rhs - A @ np.where(fixed, new, 0.0))[free])
        q, w = middle + STEP * theta * new, new
    return V.tabulate_dof_coordinates()[:, :dim], q.reshape(-1, dim), w.reshape(-1, dim)


def bonded(kind, lengths, cells, order, label, points="nodal", theta=0.6):
    dim = len(lengths)
    scene = Scene(
        box_bodies(lengths, cells, kind, label, material={2: hard}),
        {1: SOFT, 2: HARD},
        default_interaction=PerfectBond(),
        loads=[
            PrescribedVelocity(LEFT, 0, 0.0),
            PrescribedVelocity(LEFT, 1, np.cos),
            BodyForce(FORCE[:dim]),
            Gravity(GRAVITY[:dim]),
            SurfaceTraction(RIGHT, (traction_at, *TRACTION[1:dim])),
        ],
        damping=RayleighDamping(1.0, 0.01),
        order=order,
        points=points,
    )
    simulation = Simulation(scene, STEP, theta=theta, **EXACT)
    records = run(simulation, STEPS)
    return simulation, records


def grains_alike(x):
    return np.floor(2.0 * x[0]) + 10.0 * np.floor(2.0 * x[1])


def grains_uneven(x):
    return np.floor(1.5 * x[0] + x[1])


CASES = {
    "triangles": ("crossed", (2, 1), (2, 1), 1, None),
    "triangles P2": ("crossed", (2, 1), (2, 1), 2, None),
    "quadrilaterals": ("quadrilateral", (2, 1), (4, 2), 1, None),
    "quadrilaterals P2": ("quadrilateral", (2, 1), (2, 1), 2, None),
    "tetrahedra": ("tetrahedron", (2, 1, 1), (2, 1, 1), 1, None),
    "tetrahedra P2": ("tetrahedron", (2, 1, 1), (2, 1, 1), 2, None),
    "hexahedra": ("hexahedron", (2, 1, 1), (2, 1, 2), 1, None),
    "grains of four cells": ("crossed", (2, 1), (4, 2), 1, grains_alike),
    "grains of any size": ("crossed", (2, 1), (4, 2), 1, grains_uneven),
    "grains P2": ("crossed", (2, 1), (4, 2), 2, grains_uneven),
    "one body": ("crossed", (2, 1), (4, 4), 1, 0),
    "one small body": ("crossed", (2, 1), (2, 1), 2, 0),
}


@pytest.mark.parametrize("case", CASES)
def test_perfect_bonds_give_the_connected_solution(case):
    """A mesh cut anywhere and bonded perfectly moves as the connected one, to 1e-10.

    Two materials, damping, all loads, theta = 0.6. Found: below 1e-13 of the largest value.
    """
    kind, lengths, cells, order, label = CASES[case]
    x, q, v = connected_reference(kind, lengths, cells, order, theta=0.6)
    simulation, records = bonded(kind, lengths, cells, order, label)
    distance, same = cKDTree(x).query(nodes(simulation))
    assert distance.max() < 1e-12
    assert np.abs(field(simulation) - q[same]).max() < 1e-10 * np.abs(q).max()
    assert np.abs(field(simulation, "velocity") - v[same]).max() < 1e-10 * np.abs(v).max()
    energies = records[-1].energies
    assert abs(energies["closure"]) < 1e-12 * energies["external_work"]
    assert energies["dissipated_viscous"] > 0.0 and energies["dissipated_numerical"] > 0.0


def test_gauss_points_bond_perfectly_too():
    x, q, _ = connected_reference("crossed", (2, 1), (2, 1), 1, theta=0.6)
    simulation, _ = bonded("crossed", (2, 1), (2, 1), 1, None, points="gauss")
    _, same = cKDTree(x).query(nodes(simulation))
    assert np.abs(field(simulation) - q[same]).max() < 1e-10 * np.abs(q).max()


# -- uniform stress through intact bonds

BOND = CohesiveZone(400.0, 1.0, 10.0, tangential_stiffness=150.0)


def pulled(kind, lengths, cells, order, label, points="nodal"):
    """Uniaxial tension to a displacement of 1e-3, free lateral sides, brought to rest."""
    dim = len(lengths)
    hold = [(LEFT, 0), (BOTTOM, 1), (5, 2)][:dim]
    scene = Scene(
        box_bodies(lengths, cells, kind, label),
        {1: SOFT},
        default_interaction=BOND,
        loads=[PrescribedDisplacement(tag, axis, 0.0) for tag, axis in hold]
        + [PrescribedDisplacement(RIGHT, 0, lambda t: 1e-3 * min(t, 1.0))],
        order=order,
        points=points,
    )
    simulation = Simulation(scene, 0.5, theta=1.0, tolerance=1e-12, relaxation=1.6, num_threads=1)
    run(simulation, 16)
    return simulation


def stress_of(simulation):
    simulation.displacement  # noqa: B018  brings the state into the forms
    return simulation.forms.stress_evaluator()()


def slabs(x):
    return np.floor(2.0 * x[0])


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind, lengths, cells, order, label, points",
    [
        ("crossed", (2, 1), (4, 2), 1, None, "nodal"),
        ("crossed", (2, 1), (4, 2), 2, None, "nodal"),
        ("crossed", (2, 1), (4, 2), 1, None, "gauss"),
        ("quadrilateral", (2, 1), (4, 2), 1, None, "nodal"),
        ("tetrahedron", (2, 1, 1), (4, 1, 1), 1, slabs, "nodal"),
        ("tetrahedron", (2, 1, 1), (4, 1, 1), 2, slabs, "gauss"),
        ("hexahedron", (2, 1, 1), (4, 1, 1), 1, slabs, "nodal"),
    ],
)
def test_uniform_tension_through_cohesive_bonds(kind, lengths, cells, order, label, points):
    """Constant jumps C^-1 sigma n on all facets are compatible: the stress is uniform.

    On the crossed mesh because facets come in pairs of opposite normals round each vertex. The
    stress is then known: the displacement given is that of the bulk and of the facets crossed.
    """
    simulation = pulled(kind, lengths, cells, order, label, points)
    stress = stress_of(simulation)
    dim = len(lengths)
    young = SOFT.young / (1.0 - SOFT.poisson**2) if dim == 2 else SOFT.young
    length, columns = lengths[0], cells[0]
    c_n, c_t = BOND.parameters()[:2]
    flexibility = length / young + (columns - 1) / c_n
    if kind == "crossed":
        flexibility += columns * np.sqrt(0.5) * (1.0 / c_n + 1.0 / c_t)
    exact = np.zeros((3, 3))
    exact[0, 0] = 1e-3 / flexibility
    if dim == 2:
        exact[2, 2] = SOFT.poisson * exact[0, 0]
    assert stress == pytest.approx(np.broadcast_to(exact, stress.shape), abs=1e-8 * exact[0, 0])
    traction = simulation.interactions.gather("traction")
    normal = simulation.interactions.points.frame[:, 0, 0]
    assert traction[:, 0] == pytest.approx(-exact[0, 0] * normal**2, abs=1e-8 * exact[0, 0])
    assert simulation.reaction(RIGHT)[0] == pytest.approx(exact[0, 0], rel=1e-8)


def test_nodal_bonds_on_quadratic_tetrahedra_fail_the_patch_test():
    """A uniform traction puts no force on the vertices of a quadratic triangle; nodal shares do.

    Found: stresses off by up to 2.6 % here. So `Scene` asks for Gauss points there.
    """
    stress = stress_of(pulled("tetrahedron", (2, 1, 1), (4, 1, 1), 2, slabs, "nodal"))[:, 0, 0]
    assert 0.005 < np.ptp(stress) / stress.mean() < 0.1


def test_grains_break_alike_as_bodies_and_as_bonded_cells():
    """Cohesive bonds between grains that are bodies, or whose cells are perfectly bonded."""
    grain_tags = {tag: lambda x, tag=tag: grains_uneven(x) == tag - 1 for tag in (2, 3)}
    weak = CohesiveZone(2000.0, 0.02, 5.0, friction=0.2)
    results = []
    for label in (grains_uneven, None):
        scene = Scene(
            box_bodies((2, 1), (4, 2), label=label, material=grain_tags),
            {1: SOFT, 2: SOFT, 3: SOFT},
            {} if label else {(t, t): PerfectBond() for t in (1, 2, 3)},
            default_interaction=weak,
            loads=[PrescribedVelocity(LEFT, 0, -1.0), PrescribedVelocity(RIGHT, 0, 1.0)],
        )
        simulation = Simulation(scene, 5e-3, tolerance=1e-11, num_threads=1)
        run(simulation, 30)
        results.append((nodes(simulation), field(simulation), simulation.ledger.energies))
    (x, u, whole), (x_cells, u_cells, cells) = results
    assert whole.dissipated_cohesion > 0.01  # bonds broke
    for a, b in ((x, u), (x_cells, u_cells)):
        assert len(a) == len(b)
    # where grains face each other two nodes are at one place: compare the nearest value
    apart = [np.abs(u[np.abs(x - p).max(axis=1) < 1e-9] - v).max(axis=1).min()
             for p, v in zip(x_cells, u_cells, strict=True)]  # fmt: skip
    assert max(apart) < 1e-7 * np.abs(u).max()
    assert cells.dissipated_cohesion == pytest.approx(whole.dissipated_cohesion, rel=1e-7)
    assert cells.external_work == pytest.approx(whole.external_work, rel=1e-7)
