# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nearly incompressible bodies, and cells that flow without changing their volume by 100 %."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from cells import cell_of, cell_run
from scenes import BOTTOM, LEFT, RIGHT, box_bodies, field, nodes, run
from scipy.optimize import brentq

from xper_fx.forms.loads import PrescribedDisplacement, SurfaceTraction
from xper_fx.materials import J2FiniteStrain, J2SmallStrain, Linear, LinearElastic, NeoHookean
from xper_fx.materials.material import lame
from xper_fx.nscd.laws import PerfectBond
from xper_fx.periodic.drive import MacroscopicDrive
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

YOUNG = 100.0
NEARLY = pytest.mark.parametrize("poisson", [0.499, 0.4999, 0.49999])
STATIC = {"theta": 1.0, "inertia": False, "newton_tolerance": 1e-13}


def pulled(kind, poisson, strain):
    """P11 and F22 of uniaxial stress in plane strain."""
    if kind is LinearElastic:
        return YOUNG / (1.0 - poisson**2) * strain, 1.0 - strain * poisson / (1.0 - poisson)
    lam, mu = lame(YOUNG, poisson)
    a = 1.0 + strain
    b = brentq(lambda b: mu * (b - 1.0 / b) + lam * np.log(a * b) / b, 0.5, 2.0, xtol=1e-16)
    return mu * (a - 1.0 / a) + lam * np.log(a * b) / a, b


@NEARLY
@pytest.mark.parametrize("kind", [LinearElastic, NeoHookean])
@pytest.mark.parametrize("what", ["body", "cell"])
def test_pulled_with_free_sides(what, kind, poisson, figure):
    """By 20 %: the force is that of the exact field, the pressure does not run away."""
    strain, material = 0.2, kind(YOUNG, poisson, 1.0)
    if what == "body":
        motions = [(LEFT, 0, 0.0), (BOTTOM, 1, 0.0), (RIGHT, 0, lambda t: strain * t)]
        scene = Scene(
            box_bodies((1, 1), (2, 2), label=0), {1: material},
            loads=[PrescribedDisplacement(*m) for m in motions],
        )  # fmt: skip
        simulation = Simulation(scene, 0.1, **STATIC)
        run(simulation, 10)
        stress = simulation.reaction(RIGHT)[0]
    else:
        drive = MacroscopicDrive(
            rate={"11": strain}, gradient={"12": 0.0, "21": 0.0}, stress={"22": 0.0}
        )
        bodies = cell_of((1, 1), (2, 2))
        simulation = cell_run(bodies, {1: material}, drive, step=0.1, steps=10)
        stress = simulation.macroscopic.stress[0, 0]
    exact, across = pulled(kind, poisson, strain)
    error = abs(stress / exact - 1.0)
    case = f"{what} pulled by 20 %, {kind.__name__}, nu = {poisson}"
    figure(case, "stress error < 1e-9", error)
    assert error < 1e-9
    _ = simulation.displacement  # which sets what the forms are evaluated at
    cauchy = simulation.forms.stress_evaluator()()
    pressure = -np.trace(cauchy, axis1=1, axis2=2) / 3.0
    assert np.ptp(pressure) < 1e-8 * abs(exact)
    assert np.abs(pressure).max() < abs(exact)
    if what == "cell":
        assert simulation.macroscopic.gradient[1, 1] == pytest.approx(across, rel=1e-11)


@NEARLY
def test_a_beam_bends_without_locking(poisson, figure):
    """A cantilever of order 2 under shear at its end: 4 q L^3 / (E' h^2), whatever nu."""
    length, traction = 8.0, 1e-4
    scene = Scene(
        box_bodies((length, 1), (8, 1), label=0), {1: LinearElastic(YOUNG, poisson, 1.0)}, order=2,
        loads=[
            PrescribedDisplacement(LEFT, 0, 0.0), PrescribedDisplacement(LEFT, 1, 0.0),
            SurfaceTraction(RIGHT, (0.0, traction)),
        ],
    )  # fmt: skip
    simulation = Simulation(scene, 1.0, **STATIC)
    run(simulation, 1)
    exact = 4.0 * traction * length**3 * (1.0 - poisson**2) / YOUNG
    error = abs(simulation.mean_displacement(RIGHT)[1] / exact - 1.0)
    figure(f"cantilever, nu = {poisson}", "deflection error < 0.06", error)
    assert error < 0.06


@NEARLY
def test_bonded_cells_are_the_connected_body(poisson, figure):
    """Each triangle a body, held on the left and pulled on the right: the same displacement."""
    found = []
    for label in (0, None):
        scene = Scene(
            box_bodies((2, 1), (2, 1), label=label), {1: LinearElastic(YOUNG, poisson, 1.0)},
            default_interaction=PerfectBond(),
            loads=[
                PrescribedDisplacement(LEFT, 0, 0.0), PrescribedDisplacement(LEFT, 1, 0.0),
                PrescribedDisplacement(RIGHT, 0, lambda t: 0.01 * t),
            ],
        )  # fmt: skip
        simulation = Simulation(scene, 0.2, theta=1.0, tolerance=1e-10, num_threads=1)
        run(simulation, 5)
        x, u = nodes(simulation), field(simulation)
        places = np.unique(x.round(6), axis=0)
        found.append(np.array([u[np.abs(x - p).max(axis=1) < 1e-6].mean(axis=0) for p in places]))
    error = np.abs(found[1] - found[0]).max() / np.abs(found[0]).max()
    figure(f"bonded cells against the body, nu = {poisson}", "difference < 1e-7", error)
    assert error < 1e-7


# -- deep plasticity

HARDENING = 0.01


def flow_errors(simulation, finite: bool) -> np.ndarray:
    """Errors of the flow, the worst of all cells.

    Where it flows |q / K - 1|; |det C_p - 1| or |tr e_p|; |J - 1| kappa / K; |p| / K; q / K - 1.
    """
    _ = simulation.displacement  # which sets what the forms are evaluated at
    cells = simulation.scene.bodies.material_of_cell == 1
    cauchy = simulation.forms.stress_evaluator()()[cells]
    history = simulation.forms.history()
    alpha = history["accumulated 1"][:, 0, 0]
    kappa = YOUNG / (3.0 * (1.0 - 2.0 * 0.3))
    mean = np.trace(cauchy, axis1=1, axis2=2) / 3.0
    if finite:
        # kappa / 2 (J^2 - 1) = J mean
        J = mean / kappa + np.sqrt((mean / kappa) ** 2 + 1.0)
        c = history["inverse_plastic_metric 1"][:, 0]
        flow = (c[:, 0] * c[:, 1] - c[:, 3] ** 2) * c[:, 2] - 1.0
    else:
        J = np.ones(len(mean))
        flow = history["plastic_strain 1"][:, 0, :3].sum(axis=1)
    volume = J - 1.0 if finite else mean / kappa
    s = J[:, None, None] * (cauchy - mean[:, None, None] * np.eye(3))
    q, K = np.sqrt(1.5 * np.einsum("cij,cij->c", s, s)), 0.1 + HARDENING * alpha
    flowed = alpha > 0.0
    return np.array(
        [
            np.abs(q / K - 1.0)[flowed].max(initial=0.0),
            np.abs(flow).max(),
            np.abs(volume / (K / kappa)).max(),
            np.abs(mean / K).max(),
            (q / K - 1.0).max(),
        ]
    )


PATHS = {
    "stretched to 2.2": ({"11": lambda t: 1.0 + 1.2 * t, "12": 0.0, "21": 0.0}, {"22": 0.0}),
    "sheared by 1.5": ({"11": 1.0, "12": lambda t: 1.5 * t, "21": 0.0}, {"22": 0.0}),
}


@pytest.mark.slow
@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("kind", [J2SmallStrain, J2FiniteStrain])
def test_a_cell_that_flows_by_more_than_100_percent(kind, path, figure):
    """Homogeneous, H = E / 1e4: on the yield surface and isochoric at every step."""
    gradient, stress = PATHS[path]
    worst, finite = [], kind is J2FiniteStrain
    simulation = cell_run(
        cell_of((1, 1), (1, 1)), {1: kind(YOUNG, 0.3, 0.1, Linear(HARDENING), 1.0)},
        MacroscopicDrive(gradient=gradient, stress=stress), step=0.025, steps=40,
        check=lambda s, r: worst.append(flow_errors(s, finite)),
    )  # fmt: skip
    on_yield, isochoric, volume, pressure, _ = np.max(worst, axis=0)
    alpha = simulation.forms.history()["accumulated 1"]
    case = f"cell {path}, {kind.__name__}"
    figure(case, "|q / K - 1| < 1e-10", on_yield)
    figure(case, "|det C_p - 1| < 1e-10" if finite else "|tr e_p| < 1e-10", isochoric)
    figure(case, "|J - 1| kappa / K < 1", volume)
    assert alpha.min() > 0.8
    assert on_yield < 1e-10 and isochoric < 1e-10
    assert volume < 1.0 and pressure < 1.0
    found = simulation.macroscopic.gradient
    expected = {"stretched to 2.2": 1.0 / 2.2 if finite else 1.0 - 1.2, "sheared by 1.5": 1.0}
    assert found[1, 1] == pytest.approx(expected[path], abs=5e-3)


@cache
def around_an_inclusion(kind) -> tuple[np.ndarray, float]:
    """Worst errors of a run to a mean strain of 30 %, and the largest alpha."""
    drive = MacroscopicDrive(rate={"11": 0.3}, gradient={"12": 0.0, "21": 0.0}, stress={"22": 0.0})
    bodies = cell_of((1, 1), (4, 4), material={2: lambda x: (x[0] < 0.5) & (x[1] < 0.5)})
    worst = []
    simulation = cell_run(
        bodies, {1: kind(YOUNG, 0.3, 0.1, Linear(HARDENING), 1.0), 2: NeoHookean(YOUNG, 0.3, 1.0)},
        drive, step=0.02, steps=50, newton_tolerance=1e-11,
        check=lambda s, r: worst.append(flow_errors(s, kind is J2FiniteStrain)),
    )  # fmt: skip
    return np.max(worst, axis=0), simulation.forms.history()["accumulated 1"].max()


@pytest.mark.slow
@pytest.mark.parametrize("kind", [J2SmallStrain, J2FiniteStrain])
def test_flow_around_a_hard_inclusion(kind, figure):
    """Mean strain of 30 %, twice that and more beside the inclusion: yield and isochoric flow."""
    (_, isochoric, _, _, beyond), alpha = around_an_inclusion(kind)
    case = f"flow around an inclusion, {kind.__name__}"
    figure(case, "q / K - 1 < 1e-10", beyond)
    figure(case, "|det C_p - 1| or |tr e_p| < 1e-10", isochoric)
    assert alpha > 0.6
    assert beyond < 1e-10 and isochoric < 1e-10


LOCKS = pytest.mark.xfail(
    strict=True, reason="|p| / K = 89; suspected: crossed triangles of order 1 lock once distorted"
)


@pytest.mark.parametrize("kind", [J2SmallStrain, pytest.param(J2FiniteStrain, marks=LOCKS)])
def test_pressure_around_a_hard_inclusion(kind, figure):
    """The constraint of constant volume asks for no more than some yield stresses of pressure."""
    (_, _, _, pressure, _), _ = around_an_inclusion(kind)
    figure(f"flow around an inclusion, {kind.__name__}", "|pressure| / K < 5", pressure)
    assert pressure < 5.0
