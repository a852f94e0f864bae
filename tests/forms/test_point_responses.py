# SPDX-License-Identifier: LGPL-3.0-or-later
"""What inelastic materials answer in one pass is what forms would give, and never stale."""

from __future__ import annotations

import numpy as np
import pytest
import ufl
from dolfinx import fem
from scenes import BOTTOM, TOP, box_bodies

from xper_fx.forms import point_responses
from xper_fx.forms.dynamics import BulkForms
from xper_fx.forms.loads import PrescribedVelocity
from xper_fx.materials import (
    J2FiniteStrain,
    J2SmallStrain,
    Linear,
    LinearViscoelastic,
    NeoHookean,
)
from xper_fx.scene import Scene
from xper_fx.simulation.simulation import Simulation

FINITE = J2FiniteStrain(10.0, 0.3, 0.1, Linear(1.0), 1.0)
SMALL = J2SmallStrain(10.0, 0.3, 0.1, Linear(1.0), 1.0)
VISCOUS = LinearViscoelastic(10.0, 0.3, ((0.4, 0.5),), 1.0)
NEO = NeoHookean(10.0, 0.3, 1.0)


def forms_of(materials, kind="triangle", order=1, judged=False):
    """Distorted cells; those of the second material, if there is one, to the right."""
    dim = 3 if kind in ("tetrahedron", "hexahedron") else 2
    right = {tag: lambda x: x[0] > 0.5 for tag in materials if tag > 1}
    bodies = box_bodies((1.0,) * dim, (2,) * dim, kind, 0, right)
    x = bodies.mesh.geometry.x
    x[:, 0] += 0.2 * x[:, 1] * x[:, 0] ** 2
    forms = BulkForms(bodies, order, materials, judged=judged)
    forms.set_step(0.1)
    return forms


def displacements(forms, size=0.03):
    x = forms.V.tabulate_dof_coordinates()[:, : forms.V.dofmap.index_map_bs]
    return (size * (np.sin(3.0 * x) + x[:, ::-1] ** 2)).ravel()


def integral(forms, name):
    """By a form of its own."""
    responses = forms._responses.items()
    densities = {t: getattr(r, name) for t, r in responses}
    total = [d * forms._dx(t) for t, d in densities.items() if d is not None]
    return fem.assemble_scalar(fem.form(sum(total)))


@pytest.mark.parametrize(
    "materials, kind, order",
    [
        ({1: FINITE}, "triangle", 2),
        ({1: FINITE}, "hexahedron", 1),
        ({1: SMALL}, "tetrahedron", 2),
        ({1: SMALL, 2: NEO}, "quadrilateral", 2),
        ({1: SMALL, 2: NEO}, "tetrahedron", 1),
        ({1: VISCOUS, 2: FINITE}, "triangle", 1),
    ],
)
def test_one_pass_is_what_forms_are(materials, kind, order):
    forms = forms_of(materials, kind, order)
    u = displacements(forms)
    expected = forms.assemble_internal(u)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(forms.internal_at_end(u), expected, atol=1e-13 * scale)
    assert scale > 1e-3
    energy = integral(forms, "energy")
    if any(m is NEO for m in materials.values()):
        energy += fem.assemble_scalar(fem.form(NEO.energy(forms.u, forms._constant) * forms._dx(2)))
    assert forms.assemble_energy(u) == pytest.approx(energy, rel=1e-13)
    lost = forms.assemble_dissipation(u)
    losses = {"plastic" for m in materials.values() if m in (SMALL, FINITE)}
    losses |= {"viscous" for m in materials.values() if m is VISCOUS}
    assert set(lost) == losses
    for name, value in lost.items():
        assert value == pytest.approx(integral(forms, name), rel=1e-13) and value > 1e-6
    increments = [r.increment for r in forms._responses.values() if r.increment is not None]
    points, _ = forms.quadrature
    tags, mesh = forms.bodies.material_of_cell, forms.bodies.mesh
    (tag,) = (t for t, m in materials.items() if m in (SMALL, FINITE))
    cells = np.flatnonzero(tags == tag).astype(np.int32)
    top = fem.Expression(increments[0], points).eval(mesh, cells).max()
    assert forms.largest_increment(u) == pytest.approx(top, rel=1e-13) and top > 1e-3


@pytest.mark.parametrize("material", [SMALL, VISCOUS])
@pytest.mark.parametrize(
    ("kind", "judged"), [("quadrilateral", True), ("quadrilateral", False), ("tetrahedron", False)]
)
def test_stresses_of_cells_are_what_expressions_are(material, kind, judged):
    """The one across the plane included, at a step of size zero as after a step."""
    forms = forms_of({1: material, 2: NEO}, kind, judged=judged)
    forms.u.x.array[:] = displacements(forms)
    found = forms.stress_evaluator()()
    assert float(forms.step.value) == 0.1
    points, weights = forms.quadrature
    cells = np.flatnonzero(forms.bodies.material_of_cell == 1).astype(np.int32)
    forms.set_step(0.0)
    values = fem.Expression(forms._responses[1].stress, points).eval(forms.bodies.mesh, cells)
    expected = np.average(values.reshape(len(cells), -1, 3, 3), axis=1, weights=weights)
    np.testing.assert_allclose(found[cells], expected, atol=1e-13 * np.abs(expected).max())
    assert np.abs(expected[:, 2, 2]).min() > 1e-3


@pytest.mark.parametrize("material", [SMALL, FINITE, VISCOUS])
def test_values_are_those_of_the_present_history_step_and_displacement(material):
    forms = forms_of({1: material})
    u = displacements(forms)

    def asked(displacement):
        lost = forms.assemble_dissipation(displacement)
        return (forms.assemble_energy(displacement), *lost.values())

    def right(displacement):
        forms.u.x.array[:] = displacement
        name = "viscous" if material is VISCOUS else "plastic"
        return pytest.approx((integral(forms, "energy"), integral(forms, name)), rel=1e-12)

    assert asked(u) == right(u)
    assert asked(0.5 * u) == right(0.5 * u) != asked(u)
    start, first = forms.history_by_cell(), asked(u)
    forms.set_step(0.2)
    assert asked(u) == right(u)
    assert (asked(u) == first) is (material is not VISCOUS)
    forms.commit(u)
    assert asked(u) == right(u)
    assert asked(u) != first
    kept = forms.history()
    forms.set_step(0.1)
    forms.restore_by_cell(start)
    assert asked(u) == first
    forms.restore(kept)
    assert asked(u) == right(u)
    assert asked(u) != first


@pytest.mark.parametrize("scheme", ["explicit", "implicit"])
@pytest.mark.parametrize("material", [SMALL, FINITE])
def test_materials_answer_once_a_step(scheme, material, monkeypatch):
    scene = Scene(
        box_bodies((1, 1), (2, 2), label=0),
        {1: material},
        loads=[PrescribedVelocity(BOTTOM, 1, 0.0), PrescribedVelocity(TOP, 1, 0.3)],
        initial_velocity=lambda x: np.stack([0.0 * x[0], 0.3 * x[1]]),
    )
    simulation = Simulation(scene, 0.01, scheme=scheme, num_threads=1)
    calls, evaluate = [], point_responses._Pass.evaluate
    monkeypatch.setattr(
        point_responses._Pass, "evaluate", lambda *a: calls.append(a) or evaluate(*a)
    )
    forces, assemble = [], BulkForms.assemble_internal
    monkeypatch.setattr(BulkForms, "assemble_internal", lambda *a: forces.append(a) or assemble(*a))
    records = list(simulation.steps(0.2))
    assert len(calls) == len(records) == 20
    assert scheme == "implicit" or len(forces) == 20  # those of mid-step
    assert records[-1].energies["dissipated_plastic"] > 0.0


@pytest.mark.parametrize("yield_stress, hardening", [(1.0, 10.0), (0.2, 0.5), (3.0, 0.0)])
def test_the_plastic_work_of_a_step_of_finite_strain(yield_stress, hardening):
    """The formulas of the module's head, by NumPy and its roots: one step from rest."""
    material = J2FiniteStrain(26.0, 0.3, yield_stress, Linear(hardening), 1.0)
    forms = forms_of({1: material}, "tetrahedron")
    x, mu = forms.V.tabulate_dof_coordinates(), 10.0
    gradient = np.array([[0.16, 0.10, 0.0], [-0.02, -0.09, 0.04], [0.05, 0.0, -0.05]])
    F = np.eye(3) + gradient
    b = np.linalg.det(F) ** (-2.0 / 3.0) * F @ F.T
    mean = np.trace(b) / 3.0
    trial = mu * (b - mean * np.eye(3))
    q, m = np.sqrt(1.5) * np.linalg.norm(trial), 3.0 * mu * mean
    p = (q - yield_stress) / (m + hardening)
    n = trial / np.linalg.norm(trial)

    def share(alpha):
        d = np.sqrt(2.0 / 3.0) * (yield_stress + hardening * alpha) / mu
        of_b = d * n
        roots = np.roots([1.0, 0.0, -0.5 * np.sum(of_b**2), np.linalg.det(of_b) - 1.0])
        x = roots[np.abs(roots.imag) < 1e-9].real.max()
        inverse = np.linalg.inv(of_b + x * np.eye(3))
        return -np.sum(n * inverse) / np.trace(inverse)

    cubic = np.trace(n @ n @ n)
    away = np.linalg.norm(trial) / mu - np.sqrt(2.0 / 3.0) * yield_stress / mu
    density = np.sqrt(1.5) * m * 0.5 * (share(0.0) + share(p)) * p
    density *= np.exp(-0.5 * cubic * away / mean)
    volume = fem.assemble_scalar(fem.form(ufl.as_ufl(1.0) * forms._dx))
    lost = forms.assemble_dissipation((x @ gradient.T).ravel())["plastic"]
    assert lost == pytest.approx(density * volume, rel=1e-12) and p > 0.01
