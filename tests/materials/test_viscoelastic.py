# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linear viscoelasticity against exact solutions of the Prony series."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import BOTTOM, LEFT, RIGHT, TOP, box_bodies
from scipy.integrate import solve_ivp

from xper_fx.bulk.bulk import Bulk
from xper_fx.forms.dynamics import BulkForms
from xper_fx.forms.loads import PrescribedDisplacement, SurfaceTraction
from xper_fx.materials import LinearElastic, LinearViscoelastic
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

YOUNG, POISSON = 120.0, 0.25
MU, KAPPA = 48.0, 80.0
PRONY = ((0.3, 0.5), (0.4, 8.0))
SOLID = LinearViscoelastic(YOUNG, POISSON, PRONY, 1.0)
CASES = [(1, 2), (2, 2), (1, 3), (2, 3)]
SUDDEN = 1e-13
"""A time (s) in which nothing relaxes."""


def bulk_of(material, order=1, dim=2):
    kind = "crossed" if dim == 2 else "tetrahedron"
    bodies = box_bodies((1,) * dim, (1,) * dim, kind, 0)
    return Bulk(BulkForms(bodies, order, {1: material}))


def affine(bulk, gradient):
    x = bulk.forms.V.tabulate_dof_coordinates()[:, : bulk.dim]
    return (x @ np.asarray(gradient)[: bulk.dim, : bulk.dim].T).ravel()


def nominal_stress(bulk, u):
    x = bulk.forms.V.tabulate_dof_coordinates()[:, : bulk.dim]
    return bulk.internal(u).reshape(-1, bulk.dim).T @ x


def relaxed(t):
    """G(t) / G(0)."""
    return 0.3 + 0.3 * np.exp(-t / 0.5) + 0.4 * np.exp(-t / 8.0)


def integral(t):
    """int_0^t G / G(0)."""
    return 0.3 * t + 0.3 * 0.5 * -np.expm1(-t / 0.5) + 0.4 * 8.0 * -np.expm1(-t / 8.0)


def dev(a):
    return a - np.trace(a) / 3.0 * np.eye(3)


STRAIN = np.array([[0.02, 0.01, 0.0], [0.01, -0.005, 0.0], [0.0, 0.0, 0.0]])


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("step", [1e-7, 0.03, 0.3, 7.0])
def test_relaxation_is_exact_for_any_step(step, dim):
    """A sudden strain held: the deviator follows G(t), whatever the step."""
    bulk = bulk_of(SOLID, 1, dim)
    forms, u = bulk.forms, affine(bulk, STRAIN)
    forms.set_step(0.0)
    forms.commit(u)
    evaluate = forms.stress_evaluator()
    for n in range(6):
        exact = KAPPA * 0.015 * np.eye(3) + 2.0 * MU * relaxed(n * step) * dev(STRAIN)
        stress = evaluate()
        assert stress == pytest.approx(np.broadcast_to(exact, stress.shape), rel=1e-12, abs=1e-13)
        forms.set_step(step)
        later = KAPPA * 0.015 * np.eye(3) + 2.0 * MU * relaxed((n + 1) * step) * dev(STRAIN)
        assert nominal_stress(bulk, u) == pytest.approx(later[:dim, :dim], rel=1e-12, abs=1e-13)
        forms.commit(u)


@pytest.mark.parametrize("steps", [1, 3, 40])
def test_a_ramp_is_exact_for_any_step(steps):
    """Strain at a constant rate: stress 2 de/dt int G, work = stored + dissipated to rounding."""
    bulk = bulk_of(SOLID, 2, 2)
    forms, total, u = bulk.forms, 4.0, affine(bulk, STRAIN)
    forms.set_step(total / steps)
    lost, old = 0.0, np.zeros_like(u)
    for n in range(1, steps + 1):
        q = n / steps * u
        t = n * total / steps
        exact = KAPPA * 0.015 * n / steps * np.eye(3) + 2 * MU * integral(t) / total * dev(STRAIN)
        assert nominal_stress(bulk, q) == pytest.approx(exact[:2, :2], rel=1e-12)
        lost += forms.assemble_dissipation(q)["viscous"]
        energy = forms.assemble_energy(q)
        forms.commit(q)
        old = q
    # int sigma : eps' dt with int_0^t int_0^s G
    twice = 0.15 * t**2 + 0.15 * (t + 0.5 * np.expm1(-t / 0.5)) + 3.2 * (
        t + 8.0 * np.expm1(-t / 8.0)
    )  # fmt: skip
    deviator = dev(STRAIN)
    work = 0.5 * KAPPA * 0.015**2 + 2.0 * MU * np.sum(deviator**2) * twice / total**2
    assert energy + lost == pytest.approx(work, rel=1e-12)
    assert lost > 0.1 * work
    # the committed state stores what was stored
    forms.set_step(0.0)
    assert forms.assemble_energy(old) == pytest.approx(energy, rel=1e-12)


def test_creep_under_a_traction():
    """Plane strain, held across, pulled by a dead traction: the exact solution by an ODE."""
    held = [(LEFT, 0, 0.0), (BOTTOM, 1, 0.0), (TOP, 1, 0.0)]
    scene = Scene(
        box_bodies((1, 1), (1, 1), "crossed", 0),
        {1: SOLID},
        loads=[*(PrescribedDisplacement(*motion) for motion in held),
               SurfaceTraction(RIGHT, (1.0, 0.0))],
    )  # fmt: skip

    def loaded():
        """A run that has borne the traction for no time to speak of."""
        simulation = Simulation(scene, SUDDEN, theta=1.0, inertia=False)
        list(simulation.steps(SUDDEN))
        return simulation

    # sigma = (kappa + 4/3 mu_inf) eps + sum s_i = 1, s_i' + s_i / tau_i = 4/3 mu_i eps'
    modulus = KAPPA + 4.0 / 3.0 * 0.3 * MU
    parts = 4.0 / 3.0 * MU * np.array([0.3, 0.4])
    times = np.array([0.5, 8.0])
    glassy = KAPPA + 4.0 / 3.0 * MU

    def rate(t, y):
        creep = (y[1:] / times).sum() / glassy
        return np.concatenate([[creep], parts * creep - y[1:] / times])

    first = 1.0 / glassy
    exact = solve_ivp(
        rate, (0.0, 6.0), [first, *(parts * first)], rtol=1e-11, atol=1e-14, dense_output=True
    ).sol
    assert loaded().mean_displacement(RIGHT)[0] == pytest.approx(first, rel=1e-12)
    errors = []
    for steps in (12, 24, 48):
        simulation = loaded()
        simulation.step_size = 6.0 / steps
        worst, count = 0.0, 0
        for step in simulation.steps(6.0):
            length = simulation.mean_displacement(RIGHT)[0]
            worst, count = max(worst, abs(length / exact(step.time)[0] - 1.0)), count + 1
        assert count == steps
        errors.append(worst)
    print("creep, worst relative error:", errors)
    assert errors[2] < 1e-4
    assert errors[0] / errors[1] > 3.5 and errors[1] / errors[2] > 3.5
    assert 1.0 / modulus > exact(6.0)[0] > 1.1 * first


@pytest.mark.parametrize("order, dim", CASES)
def test_forces_and_tangent_between_the_limits(order, dim):
    """Linear in u; a sudden step is the fast solid, a long one the solid that has relaxed."""
    bulk = bulk_of(SOLID, order, dim)
    u = 0.01 * np.random.default_rng(0).standard_normal(bulk.num_dofs)
    fast = bulk_of(LinearElastic(YOUNG, POISSON, 1.0), order, dim)
    mu = 0.3 * MU
    slow = bulk_of(
        LinearElastic(
            9 * KAPPA * mu / (3 * KAPPA + mu), (3 * KAPPA - 2 * mu) / (6 * KAPPA + 2 * mu), 1.0
        ),
        order,
        dim,
    )
    for step, limit in ((0.0, fast), (1e-12, fast), (1e15, slow)):
        bulk.forms.set_step(step)
        force = limit.internal(u)
        assert bulk.internal(u) == pytest.approx(force, abs=1e-11 * np.abs(force).max())
        K = limit.stiffness.to_scipy().toarray()
        tangent = bulk.tangent(u).to_scipy().toarray()
        assert tangent == pytest.approx(K, abs=1e-11 * np.abs(K).max())
    bulk.forms.set_step(0.7)
    bulk.forms.commit(u)
    w = 0.01 * np.random.default_rng(1).standard_normal(bulk.num_dofs)
    change = bulk.internal(u + w) - bulk.internal(u)
    predicted = bulk.tangent(u).to_scipy() @ w
    assert predicted == pytest.approx(change, abs=1e-11 * np.abs(change).max())


@pytest.mark.parametrize("step", [1e-9, 1e-4, 0.0499, 0.0501, 0.79, 0.81, 30.0])
def test_dissipation_of_a_step_is_the_integral(step):
    """From a state under stress, strained back: against quadrature of s : s / (2 mu tau)."""
    bulk = bulk_of(SOLID, 1, 2)
    forms = bulk.forms
    forms.set_step(0.3)
    forms.commit(affine(bulk, STRAIN))
    back = -0.4 * STRAIN.T + 0.003 * np.diag([1.0, 0.0, 0.0])
    places = [(0, 0), (1, 1), (2, 2), (0, 1)]
    start = {}
    for name in ("term_1", "term_2"):
        s = np.zeros((3, 3))
        for value, (i, j) in zip(forms.history()[f"{name} 1"][0, 0], places, strict=True):
            s[i, j] = s[j, i] = value
        start[name] = s
    exact = 0.0
    t, weights = np.polynomial.legendre.leggauss(60)
    for s, (share, tau) in zip(start.values(), PRONY, strict=True):
        # the interval is cut where the exponential has died out
        end = min(step, 40.0 * tau)
        rate = 2.0 * share * MU * dev(back - STRAIN) / step
        y = 0.5 * end * (t + 1.0)
        decay = np.exp(-y / tau)[:, None, None]
        path = decay * s + tau * rate * (1.0 - decay)
        density = np.sum(path**2, axis=(1, 2)) / (2.0 * share * MU * tau)
        exact += 0.5 * end * weights @ density
        exact += (step - end) * np.sum((tau * rate) ** 2) / (2.0 * share * MU * tau)
    forms.set_step(step)
    lost = forms.assemble_dissipation(affine(bulk, back))["viscous"]
    assert lost == pytest.approx(exact, rel=1e-10) and lost > 0.0


@pytest.mark.parametrize(
    "prony, message",
    [
        (((0.5, 1.0), (0.5, 2.0)), "less than 1"),
        ((), "more than 0"),
        (((0.5, 0.0),), "above zero"),
        (((-0.1, 1.0),), "above zero"),
    ],
)
def test_bad_series_are_refused(prony, message):
    with pytest.raises(ValueError, match=message):
        LinearViscoelastic(YOUNG, POISSON, prony, 1.0)
