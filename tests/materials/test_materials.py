# SPDX-License-Identifier: LGPL-3.0-or-later
"""Materials against exact answers, and Newton on the one that is not linear."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import BACK, BOTTOM, LEFT, RIGHT, box_bodies, field, nodes, run
from scipy.optimize import brentq

from xper_fx.bulk.bulk import Bulk
from xper_fx.forms.dynamics import BulkForms
from xper_fx.forms.loads import PrescribedDisplacement, PrescribedVelocity, RayleighDamping
from xper_fx.materials import (
    Cubic,
    LinearElastic,
    NeoHookean,
    Orthotropic,
    SaintVenantKirchhoff,
)
from xper_fx.nscd.laws import CohesiveZone
from xper_fx.output.checkpoint import restore
from xper_fx.output.recorder import Recorder
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.errors import ConvergenceError

RUBBER = NeoHookean(100.0, 0.3, 1.0)
LAM, MU = 100.0 * 0.3 / 1.3 / 0.4, 50.0 / 1.3


def bulk_of(material, order=1, dim=2, kind=None):
    kind = kind or ("crossed" if dim == 2 else "tetrahedron")
    bodies = box_bodies((1, 1, 1)[:dim], (1, 1, 1)[:dim], kind, 0)
    return Bulk(BulkForms(bodies, order, {1: material}))


def some_displacement(bulk, size=0.1):
    return size * np.random.default_rng(1).standard_normal(bulk.num_dofs)


CASES = [(1, 2), (2, 2), (1, 3), (2, 3)]


WOOD = Orthotropic((100.0, 60.0, 20.0), (0.3, 0.1, 0.2), (30.0, 15.0, 10.0), 1.0, rotation=0.4)
ELASTIC = [
    LinearElastic(100.0, 0.3, 1.0),
    RUBBER,
    SaintVenantKirchhoff(100.0, 0.3, 1.0),
    WOOD,
    Cubic(150.0, 90.0, 80.0, 1.0, rotation=-0.3),
]


@pytest.mark.parametrize("material", ELASTIC, ids=type)
@pytest.mark.parametrize("order, dim", CASES)
def test_forces_and_tangent_are_derivatives(order, dim, material):
    """Forces against differences of the energy, the tangent against differences of the forces."""
    bulk = bulk_of(material, order, dim)
    u, w = some_displacement(bulk, 0.02), some_displacement(bulk, 1.0)[::-1]
    h = 1e-5
    energy = lambda q: bulk.elastic_energy(q, bulk.internal(q))  # noqa: E731
    slope = (energy(u + h * w) - energy(u - h * w)) / (2 * h)
    assert bulk.internal(u) @ w == pytest.approx(slope, rel=1e-6)
    K = bulk.tangent(u).to_scipy().toarray()
    change = (bulk.internal(u + h * w) - bulk.internal(u - h * w)) / (2 * h)
    assert K @ w == pytest.approx(change, rel=1e-5, abs=1e-6 * np.abs(change).max())
    assert K == pytest.approx(K.T, abs=1e-10 * np.abs(K).max())


def affine(bulk, F):
    x = bulk.forms.V.tabulate_dof_coordinates()[:, : bulk.dim]
    return (x @ (np.asarray(F) - np.eye(bulk.dim)).T).ravel()


@pytest.mark.parametrize("material", [RUBBER, SaintVenantKirchhoff(100.0, 0.3, 1.0)], ids=type)
@pytest.mark.parametrize("order, dim", CASES)
def test_rotation_leaves_a_solid_at_rest(order, dim, material):
    bulk = bulk_of(material, order, dim)
    a = 1.1
    R = np.eye(dim)
    R[:2, :2] = [[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]
    u = affine(bulk, R)
    assert np.abs(bulk.internal(u)).max() < 1e-12 * material.young
    assert bulk.elastic_energy(u, None) == pytest.approx(0.0, abs=1e-12)
    bulk.forms.u.x.array[:] = u
    assert np.abs(bulk.forms.stress_evaluator()()).max() < 1e-12 * material.young


@pytest.mark.parametrize("order, dim", [(1, 2), (2, 3)])
def test_neo_hookean_stress_of_a_homogeneous_deformation(order, dim):
    """Cauchy stress and energy density by hand, F general with plane strain in 2D."""
    bulk = bulk_of(RUBBER, order, dim)
    F = np.eye(3)
    F[:dim, :dim] = np.array([[1.3, 0.2, 0.1], [-0.1, 0.8, 0.05], [0.0, 0.3, 1.1]])[:dim, :dim]
    J = np.linalg.det(F)
    sigma = (MU * (F @ F.T - np.eye(3)) + LAM * np.log(J) * np.eye(3)) / J
    density = 0.5 * MU * (np.sum(F * F) - 3 - 2 * np.log(J)) + 0.5 * LAM * np.log(J) ** 2
    u = affine(bulk, F[:dim, :dim])
    bulk.forms.u.x.array[:] = u
    stress = bulk.forms.stress_evaluator()()
    assert stress == pytest.approx(np.broadcast_to(sigma, stress.shape), abs=1e-10)
    assert bulk.elastic_energy(u, None) == pytest.approx(density, rel=1e-12)
    # nodal forces of the side x = 1 are its nominal traction, P N = J sigma F^-T N
    side = bulk.forms.V.tabulate_dof_coordinates()[:, 0] > 1 - 1e-9
    force = bulk.internal(u).reshape(-1, dim)[side].sum(axis=0)
    if dim == 2:
        assert force == pytest.approx((J * sigma @ np.linalg.inv(F).T)[:2, 0], rel=1e-10)


def stretched(material, dim, stretch, step=1.0, **options):
    """A block drawn out along x to rest, its other sides free; reaction and displacement."""
    hold = [(LEFT, 0), (BOTTOM, 1), (BACK, 2)][:dim]
    scene = Scene(
        box_bodies((1, 1, 1)[:dim], (1, 1, 1)[:dim], "crossed" if dim == 2 else "tetrahedron", 0),
        {1: material},
        loads=[PrescribedDisplacement(tag, axis, 0.0) for tag, axis in hold]
        + [PrescribedDisplacement(RIGHT, 0, lambda t: stretch * min(0.2 * t, 1.0))],
    )
    simulation = Simulation(scene, step, theta=1.0, **options)
    records = run(simulation, 16)
    return simulation, records


@pytest.mark.parametrize("dim", [2, 3])
def test_neo_hookean_uniaxial_tension(dim):
    """Stretch 1.5 with free sides: the lateral stretch solves sigma_22 = 0."""
    a = 1.5
    across = dim - 1
    lateral = brentq(lambda b: MU * (b**2 - 1) + LAM * np.log(a * b**across), 0.1, 1.5)
    nominal = (MU * (a**2 - 1) + LAM * np.log(a * lateral**across)) / a
    simulation, _ = stretched(RUBBER, dim, a - 1.0, newton_tolerance=1e-12)
    x, u = nodes(simulation), field(simulation)
    assert u[:, 1] == pytest.approx((lateral - 1.0) * x[:, 1], abs=1e-6)
    assert simulation.reaction(RIGHT)[0] == pytest.approx(nominal, rel=1e-6)


@pytest.mark.parametrize(
    "plane, young, contraction",
    [("strain", 100.0 / (1 - 0.09), 0.3 / 0.7), ("stress", 100.0, 0.3)],
)
def test_plane_strain_and_plane_stress(plane, young, contraction):
    material = LinearElastic(100.0, 0.3, 1.0, plane=plane)
    simulation, _ = stretched(material, 2, 1e-3)
    x, u = nodes(simulation), field(simulation)
    assert simulation.reaction(RIGHT)[0] == pytest.approx(1e-3 * young, rel=1e-9)
    assert u[:, 1] == pytest.approx(-contraction * 1e-3 * x[:, 1], abs=1e-12)
    simulation.displacement  # noqa: B018  brings the state into the forms
    stress = simulation.forms.stress_evaluator()()
    out = 0.3 * 1e-3 * young if plane == "strain" else 0.0
    exact = np.diag([1e-3 * young, 0.0, out])
    assert stress == pytest.approx(np.broadcast_to(exact, stress.shape), abs=1e-9)


def test_small_strains_of_both_materials_agree():
    linear, _ = stretched(LinearElastic(100.0, 0.3, 1.0), 2, 1e-6)
    finite, _ = stretched(RUBBER, 2, 1e-6)
    assert field(finite) == pytest.approx(field(linear), abs=1e-11)


# -- Saint-Venant-Kirchhoff


@pytest.mark.parametrize("order, dim", [(1, 2), (2, 3)])
def test_saint_venant_kirchhoff_stress_of_a_homogeneous_deformation(order, dim):
    bulk = bulk_of(SaintVenantKirchhoff(100.0, 0.3, 1.0), order, dim)
    F = np.eye(3)
    F[:dim, :dim] = np.array([[1.3, 0.2, 0.1], [-0.1, 0.8, 0.05], [0.0, 0.3, 1.1]])[:dim, :dim]
    E = 0.5 * (F.T @ F - np.eye(3))
    S = LAM * np.trace(E) * np.eye(3) + 2.0 * MU * E
    u = affine(bulk, F[:dim, :dim])
    bulk.forms.u.x.array[:] = u
    stress = bulk.forms.stress_evaluator()()
    exact = F @ S @ F.T / np.linalg.det(F)
    assert stress == pytest.approx(np.broadcast_to(exact, stress.shape), abs=1e-10)
    assert bulk.elastic_energy(u, None) == pytest.approx(0.5 * np.sum(S * E), rel=1e-12)
    x = bulk.forms.V.tabulate_dof_coordinates()[:, :dim]
    nominal = bulk.internal(u).reshape(-1, dim).T @ x
    assert nominal == pytest.approx((F @ S)[:dim, :dim], abs=1e-10)


# -- anisotropy


def voigt_rotation(R):
    """6 x 6 matrix that turns stresses in Voigt's order 11, 22, 33, 23, 13, 12 by R (Bond)."""
    a, b = [1, 2, 0], [2, 0, 1]
    out = np.zeros((6, 6))
    out[:3, :3] = R**2
    for i in range(3):
        for j in range(3):
            out[j, 3 + i] = 2.0 * R[j, a[i]] * R[j, b[i]]
            out[3 + j, i] = R[a[j], i] * R[b[j], i]
            out[3 + j, 3 + i] = R[a[j], a[i]] * R[b[j], b[i]] + R[a[j], b[i]] * R[b[j], a[i]]
    return out


SPACE = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
SPACE = SPACE * np.linalg.det(SPACE)
SPIN = np.array([[np.cos(0.4), -np.sin(0.4), 0], [np.sin(0.4), np.cos(0.4), 0], [0, 0, 1]])


def uniform_stress(material, strain, dim):
    bulk = bulk_of(material, 1, dim)
    bulk.forms.u.x.array[:] = affine(bulk, np.eye(dim) + strain[:dim, :dim])
    return bulk.forms.stress_evaluator()()[0]


def in_voigt(a, shear):
    return np.array([a[0, 0], a[1, 1], a[2, 2], shear * a[1, 2], shear * a[0, 2], shear * a[0, 1]])


@pytest.mark.parametrize("crystal", ["wood", "cubic"])
@pytest.mark.parametrize("dim, rotation, R", [(2, 0.4, SPIN), (3, 0.4, SPIN), (3, SPACE, SPACE)])
def test_rotated_stiffness(dim, rotation, R, crystal):
    """Stress of a general strain against Bond's rotation of the stiffness."""
    if crystal == "wood":
        material = Orthotropic(
            (100.0, 60.0, 20.0), (0.3, 0.1, 0.2), (30.0, 15.0, 10.0), 1.0, rotation
        )
        S = np.zeros((6, 6))
        S[:3, :3] = [
            [1 / 100, -0.3 / 100, -0.1 / 100],
            [-0.3 / 100, 1 / 60, -0.2 / 60],
            [-0.1 / 100, -0.2 / 60, 1 / 20],
        ]
        S[3, 3], S[4, 4], S[5, 5] = 1 / 10.0, 1 / 15.0, 1 / 30.0
        C = np.linalg.inv(S)
    else:
        material = Cubic(150.0, 90.0, 80.0, 1.0, rotation)
        C = np.diag([150.0] * 3 + [80.0] * 3)
        C[:3, :3] += 90.0 * (1.0 - np.eye(3))
    M = voigt_rotation(R)
    strain = np.random.default_rng(5).standard_normal((3, 3))
    strain = strain + strain.T
    strain[dim:], strain[:, dim:] = 0.0, 0.0
    stress = uniform_stress(material, strain, dim)
    assert in_voigt(stress, 1.0) == pytest.approx(M @ C @ M.T @ in_voigt(strain, 2.0), rel=1e-11)
    assert stress == pytest.approx(stress.T)


def test_equal_axes_are_isotropic():
    """Cubic with 2 c44 = c11 - c12, orthotropic with equal constants, in any axes."""
    strain = np.array([[0.3, 0.1, -0.2], [0.1, -0.4, 0.25], [-0.2, 0.25, 0.15]])
    exact = uniform_stress(LinearElastic(100.0, 0.3, 1.0), strain, 3)
    cubic = Cubic(LAM + 2 * MU, LAM, MU, 1.0, SPACE)
    wood = Orthotropic((100.0,) * 3, (0.3,) * 3, (MU,) * 3, 1.0, SPACE)
    for material in (cubic, wood):
        assert uniform_stress(material, strain, 3) == pytest.approx(exact, rel=1e-11)
    other = uniform_stress(Cubic(LAM + 2 * MU, LAM, 2 * MU, 1.0, SPACE), strain, 3)
    assert np.abs(other - exact).max() > 0.1 * np.abs(exact).max()


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: Cubic(1.0, 2.0, 1.0, 1.0), "positive definite"),
        (lambda: Cubic(1.0, -0.6, 1.0, 1.0), "positive definite"),
        (lambda: Cubic(2.0, 1.0, 1.0, 0.0), "density should be"),
        (lambda: Cubic(2.0, 1.0, 1.0, 1.0, np.ones((3, 3))), "orthonormal"),
        (lambda: Cubic(2.0, 1.0, 1.0, 1.0, np.diag([1.0, 1.0, -1.0])), "orthonormal"),
        (lambda: Cubic(2.0, 1.0, 1.0, 1.0, np.nan), "finite angle"),
        (lambda: Orthotropic((1, 1, 0), (0, 0, 0), (1, 1, 1), 1.0), "young should be above"),
        (lambda: Orthotropic((1, 1, 1), (0.9, 0.9, 0.9), (1, 1, 1), 1.0), "positive definite"),
        (lambda: Orthotropic((1, 1), (0, 0, 0), (1, 1, 1), 1.0), "three finite numbers"),
        (lambda: SaintVenantKirchhoff(1.0, 0.5, 1.0), "poisson"),
    ],
)
def test_bad_elastic_constants_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_axes_out_of_the_plane_are_refused():
    with pytest.raises(ValueError, match="normal to the plane"):
        bulk_of(Cubic(150.0, 90.0, 80.0, 1.0, SPACE))


# -- Newton


def shaken(step=0.05, velocity=3.0, **options):
    """A rubber block held below and thrown sideways."""
    scene = Scene(
        box_bodies((1, 1), (2, 2), label=0),
        {1: RUBBER},
        loads=[PrescribedVelocity(BOTTOM, axis, 0.0) for axis in (0, 1)],
        initial_velocity=lambda x: np.stack([velocity * x[1], -0.3 * velocity * x[1]]),
    )
    return Simulation(scene, step, **options)


def corrections(simulation, count):
    """Relative corrections of Newton's first iterations from the present state."""
    scheme, out = simulation.scheme, []
    for iterations in range(1, count + 1):
        scheme._limits = scheme._limits._replace(iterations=iterations)
        scheme._inverses.drop(simulation.step_size)
        outcome = scheme.attempt(simulation.state, simulation.step_size, None, None, 1.0)
        out.append(outcome.newton_residual)
        if outcome.converged:
            break
    return np.array(out)


def test_newton_contracts_and_does_not_change_the_answer():
    """With the matrix kept while it serves, each correction is a fraction of the last."""
    simulation = shaken(newton_tolerance=1e-13)
    relative = corrections(simulation, 20)
    assert relative[-1] <= 1e-13 and len(relative) <= 14
    assert np.all(relative[1:] < 0.6 * relative[:-1])
    run(simulation, 1)
    loose = shaken(newton_tolerance=1e-6)
    run(loose, 1)
    scale = np.abs(loose.state.velocity).max()
    assert loose.state.velocity == pytest.approx(simulation.state.velocity, abs=1e-6 * scale)


def test_newton_is_quadratic_where_the_matrix_is_renewed(monkeypatch):
    monkeypatch.setattr("xper_fx.bulk.implicit_step._SLOW", 0.0)
    monkeypatch.setattr("xper_fx.bulk.implicit_step._FEW", 0)
    relative = corrections(shaken(newton_tolerance=1e-14), 10)
    assert len(relative) <= 7
    # the first two use one matrix; below 1e-12 rounding takes over
    good = np.flatnonzero(relative > 1e-12)
    orders = np.log(relative[good[2:]]) / np.log(relative[good[1:-1]])
    assert len(orders) >= 1 and orders.min() > 1.6


def test_halving_rescues_a_step_too_big():
    """Ten times the step that Newton takes: cut, and the run reaches its end in smaller pieces."""
    options = {"velocity": 10.0, "step": 0.3, "max_newton": 8}
    with pytest.raises(ConvergenceError):
        run(shaken(**options, max_halvings=0), 1)
    simulation = shaken(**options)
    records = run(simulation, 1)
    assert len(records) > 1 and sum(r.size for r in records) == pytest.approx(0.3, rel=1e-14)
    assert simulation.time == pytest.approx(0.3, rel=1e-14)
    assert [r.step for r in records] == list(range(1, len(records) + 1))
    # the pieces are what steps of that size give
    size = min(r.size for r in records)
    assert size < 0.3 and all(np.log2(0.3 / r.size) % 1 == 0 for r in records)


def bonded(max_sweeps, **options):
    scene = Scene(
        box_bodies((1, 1), (2, 2)),
        {1: LinearElastic(100.0, 0.3, 1.0)},
        default_interaction=CohesiveZone(1000.0, 0.05, 8.0),
        loads=[PrescribedVelocity(LEFT, 0, 0.0), PrescribedVelocity(RIGHT, 0, 1.0)],
        damping=RayleighDamping(stiffness=1e-3),
    )
    options = {"forgiving": True} | options  # small strain, and cells that turn
    return Simulation(scene, 0.02, max_sweeps=max_sweeps, num_threads=1, **options)


def test_a_failed_step_leaves_the_state_as_it_was(tmp_path):
    """The error says where, the state before it is saved, and the run can go on from it."""
    simulation = bonded(20_000)
    whole = bonded(20_000)
    run(simulation, 5)
    run(whole, 5)
    before = simulation.state
    history = {n: simulation.interactions.gather(n) for n in ("jump", "velocity", "damage")}
    recorder = Recorder(simulation, tmp_path, end_time=1.0, fields=0)
    options = simulation.options
    few = replace(options.solve, max_sweeps=1)
    simulation.model.options = replace(options, solve=few, max_halvings=2)
    with pytest.raises(ConvergenceError, match="Step 6 at t = 0.1 s.*checkpoint") as caught:
        run(simulation, 1)
    error = caught.value
    assert (error.step, error.size) == (6, pytest.approx(0.005))
    assert error.time == pytest.approx(0.1) and error.residual > 1e-4
    recorder.close()
    other = bonded(20_000)
    restore(error.saved, other)
    assert np.array_equal(other.state.displacement, before.displacement)
    assert np.array_equal(other.state.velocity, before.velocity)
    assert other.time == simulation.time == before.time
    assert np.array_equal(other.interactions.gather("damage"), history["damage"])
    assert simulation.state is before and simulation.step_number == 5
    for name, values in history.items():
        assert np.array_equal(simulation.interactions.gather(name), values)
    simulation.model.options = options
    run(simulation, 5)
    run(whole, 5)
    scale = np.abs(whole.state.velocity).max()
    assert simulation.state.velocity == pytest.approx(whole.state.velocity, abs=1e-12 * scale)
    columns = simulation.ledger.as_columns()
    for name, value in whole.ledger.as_columns().items():
        assert columns[name] == pytest.approx(value, rel=1e-12, abs=1e-14)


def test_an_error_without_a_folder_saves_nothing():
    simulation = bonded(1, max_halvings=1)
    with pytest.raises(ConvergenceError) as caught:
        run(simulation, 1)
    assert caught.value.saved is None and caught.value.size == 0.01
