# SPDX-License-Identifier: LGPL-3.0-or-later
"""The unit of length from nm to m, of stress from Pa to GPa, of time from ns to s: same answers.

A run whose units are powers of two repeats the one of units 1 bit for bit if every tolerance is
relative and nothing is formed that overflows: any difference is an absolute number somewhere.
Decimal units differ by rounding, which grows where bonds break: they are for the contact problem on
its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial

import numpy as np
import problems
import pytest
from cells import cell_of
from scenes import BOTTOM, TOP, box_bodies, run

from xper_fx.forms.loads import PrescribedVelocity, RayleighDamping
from xper_fx.materials import J2FiniteStrain, Linear, LinearElastic, NeoHookean
from xper_fx.nscd import FrictionProblem
from xper_fx.nscd.friction.problem import SOLVERS as FRICTION_SOLVERS
from xper_fx.nscd.laws import CohesiveZone, SignoriniCoulomb, Tresca
from xper_fx.periodic.drive import MacroscopicDrive
from xper_fx.scene import Scene, Wall
from xper_fx.simulation.simulation import Simulation


@dataclass(frozen=True)
class Units:
    """Sizes of the units of length, stress and time in m, Pa and s."""

    length: float = 1.0
    stress: float = 1.0
    time: float = 1.0

    @property
    def velocity(self) -> float:
        return self.length / self.time

    @property
    def density(self) -> float:
        return self.stress / self.velocity**2

    def impulse(self, dim: int) -> float:
        return self.stress * self.length ** (dim - 1) * self.time

    def energy(self, dim: int) -> float:
        return self.stress * self.length**dim

    def elastic(self, kind=LinearElastic, young=100.0, poisson=0.3, density=1.0):
        return kind(young * self.stress, poisson, density * self.density)

    def bond(self, stiffness, energy, strength, friction=0.0):
        stress, length = self.stress, self.length
        return CohesiveZone(
            stiffness * stress / length, energy * stress * length, strength * stress,
            friction=friction,
        )  # fmt: skip


ONE = Units()
BINARY = {
    "nm, GPa, ns": Units(2.0**-30, 2.0**30, 2.0**-30),
    "km, Pa, s": Units(2.0**10, 1.0, 1.0),
}


def answer(simulation, records, units: Units) -> dict[str, np.ndarray]:
    """What a run gives, without units, with what it took."""
    dim = simulation.bulk.dim
    out = {
        "displacement": simulation.displacement.x.array / units.length,
        "velocity": simulation.velocity.x.array / units.velocity,
        "energies": np.array([list(r.energies.values()) for r in records]) / units.energy(dim),
        "steps": np.array([r.size for r in records]) / units.time,
    }
    if simulation.interactions is not None:
        gather = simulation.interactions.gather
        out["impulses"] = gather("impulse") / units.impulse(dim)
        size = np.linalg.norm(out["impulses"], axis=1)
        acts = size > 1e-12 * size.max()  # the status of what is rounding is none
        out["damage"], out["status"] = gather("damage"), acts * gather("status").astype(float)
    if simulation.macroscopic is not None:
        out["gradient"] = simulation.macroscopic.gradient
        out["stress"] = simulation.macroscopic.stress / units.stress
    return {name: value.copy() for name, value in out.items()}


def difference(found: dict, reference: dict) -> float:
    """Largest difference of two answers, relative to the largest number of its kind."""
    return max(
        np.abs(found[name] - reference[name]).max() / np.abs(reference[name]).max()
        for name in reference
        if np.any(reference[name]) or np.any(found[name])
    )


# -- scenes, each a function of units


def notched_plate(units: Units, scheme, solver, steps=40):
    """Pulled apart until bonds break; notch and inclusion, friction of the lips."""
    size = units.length
    speed, step = 0.5 * units.velocity, (8e-3 if scheme == "implicit" else 4e-3) * units.time
    bodies = box_bodies(
        (2.0 * size, 2.0 * size), (4, 4),
        material={2: lambda x: np.abs(x[:2] - 1.25 * size).max(axis=0) < 0.5 * size},
        interior={7: lambda x: (np.abs(x[1] - size) < 1e-9 * size) & (x[0] < 0.51 * size)},
    )  # fmt: skip
    scene = Scene(
        bodies,
        {1: units.elastic(), 2: units.elastic(young=300.0, poisson=0.2, density=2.0)},
        {(2, 2): units.bond(2000.0, 0.2, 20.0, 0.3)},
        default_interaction=units.bond(1000.0, 0.05, 8.0, 0.3),
        facet_interactions={7: SignoriniCoulomb(0.3, contact="position")},
        loads=[
            PrescribedVelocity(BOTTOM, 1, -speed),
            PrescribedVelocity(TOP, 1, speed),
            PrescribedVelocity(TOP, 0, 0.3 * speed),
        ],
        damping=RayleighDamping(0.5 / units.time, 1e-3 * units.time),
        initial_velocity=lambda x: np.stack([0.0 * x[0], speed * (x[1] / size - 1.0)]),
    )
    simulation = Simulation(
        scene, step, scheme=scheme, solver=solver, tolerance=1e-9, num_threads=1,
        forgiving=True,  # small strain, and cells that turn
    )  # fmt: skip
    records = run(simulation, steps)
    return answer(simulation, records, units)


def impact(units: Units, scheme, steps=40):
    """A block thrown obliquely on a wall that rubs, in two halves with a Tresca joint, in space."""
    size, step = units.length, 8e-3 * units.time
    bodies = box_bodies(
        (size, size, size), (2, 1, 2), "tetrahedron", lambda x: x[0] > 0.5 * size,
        material={2: lambda x: x[0] > 0.5 * size},
    )  # fmt: skip
    scene = Scene(
        bodies,
        {1: units.elastic(NeoHookean), 2: units.elastic(NeoHookean, young=50.0)},
        default_interaction=Tresca(0.2 * units.stress),
        walls=[Wall(BOTTOM, (0, -0.02 * size, 0), (0, 1, 0), SignoriniCoulomb(0.3, 0.5))],
        initial_velocity=lambda x: (
            units.velocity * np.stack([1.0 + 0 * x[0], -0.8 + 0 * x[0], x[0] / size])
        ),
    )
    simulation = Simulation(scene, step, scheme=scheme, tolerance=1e-9, num_threads=1)
    records = run(simulation, steps)
    assert np.any(simulation.ledger.energies.dissipated_friction > 0.0)
    return answer(simulation, records, units)


def plastic_cell(units: Units, steps=8):
    """Pulled to 8 % at finite strain, stresses given across, an elastic inclusion, no inertia."""
    stress, rate = units.stress, 0.01 / units.time
    matrix = J2FiniteStrain(
        100.0 * stress, 0.3, 0.5 * stress, Linear(1.0 * stress), 0.1 * units.density
    )
    bodies = cell_of(
        (units.length, units.length), (2, 2),
        material={2: lambda x: x[:2].max(axis=0) < 0.5 * units.length},
    )  # fmt: skip
    drive = MacroscopicDrive(
        rate={"11": rate, "21": 0.2 * rate},
        stress={"22": lambda t: -0.02 * stress * t / units.time, "12": 0.0},
    )
    scene = Scene(
        bodies, {1: matrix, 2: units.elastic(NeoHookean, 300.0, 0.2, 0.1)}, macroscopic=drive
    )
    simulation = Simulation(scene, units.time, theta=1.0, inertia=False, newton_tolerance=1e-12)
    return answer(simulation, run(simulation, steps), units)


def stress_driven_cell(units: Units, steps=25):
    """Mean stress raised to eight tenths of the strength of the bonds, theta = 1/2."""
    stress = units.stress
    drive = MacroscopicDrive(
        gradient={"21": 0.0},
        stress={"11": lambda t: 2.0 * stress * t / units.time, "22": 0.0, "12": 0.2 * stress},
    )
    scene = Scene(
        cell_of((units.length, units.length), (3, 3), label=None),
        {1: units.elastic()}, default_interaction=units.bond(2000.0, 0.02, 3.0, 0.2),
        macroscopic=drive,
    )  # fmt: skip
    simulation = Simulation(scene, 0.05 * units.time, tolerance=1e-9, num_threads=1)
    return answer(simulation, run(simulation, steps), units)


SCENES = {
    **{
        f"notched plate, {scheme}, {solver}": partial(notched_plate, scheme=scheme, solver=solver)
        for scheme, solver in (
            ("implicit", "nlgs"), ("implicit", "newton"), ("implicit", "accelerated"),
            ("implicit", "auto"), ("explicit", "auto"),
        )
    },
    "impact in space, implicit": partial(impact, scheme="implicit"),
    "impact in space, explicit": partial(impact, scheme="explicit"),
    "plastic cell": plastic_cell,
    "stress-driven cell": stress_driven_cell,
}  # fmt: skip


@cache
def in_units_of_one(name):
    return SCENES[name](ONE)


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_units_that_are_powers_of_two(name, figure):
    for title, units in BINARY.items():
        found = difference(SCENES[name](units), in_units_of_one(name))
        figure(f"{name}: {title}", "difference < 1e-10", found)
        assert found < 1e-10, title
    reference = in_units_of_one(name)
    if "plate" in name:
        assert np.count_nonzero(reference["damage"] < 0.9) > 3  # something broke


PROBLEMS = {
    "disks on a wall": lambda: problems.disks_on_wall(20),
    "heap of spheres": lambda: problems.sphere_heap(20),
}


@pytest.mark.slow
@pytest.mark.parametrize("problem", PROBLEMS)
@pytest.mark.parametrize("solver", FRICTION_SOLVERS)
def test_friction_problem(solver, problem, figure):
    """W in m/s per N s, q in m/s: scaled by powers of two and of ten.

    The interior point ends where its own accuracy does, somewhat above 1e-8.
    """
    tolerance, bound = (3e-8, 1e-6) if solver == "interior_point" else (1e-11, 1e-10)
    W, q, mu, dim = PROBLEMS[problem]()
    reference = FrictionProblem(W, q, mu, dim).solve(solver, tolerance=tolerance)
    assert reference.converged
    for compliance, velocity in ((2.0**30, 2.0**-30), (2.0**-40, 1.0), (1e9, 1e-9), (1e-12, 1e3)):
        scaled = FrictionProblem(compliance * W, velocity * q, mu, dim)
        found = scaled.solve(solver, tolerance=tolerance)
        errors = [
            np.abs(compliance / velocity * found.reaction - reference.reaction).max()
            / np.abs(reference.reaction).max(),
            np.abs(found.velocity / velocity - reference.velocity).max() / np.abs(q).max(),
        ]
        figure(f"{problem}, {solver}: W x {compliance:.0e}, q x {velocity:.0e}",
               f"difference of velocities < {bound:.0e}", errors[1])  # fmt: skip
        assert found.converged == reference.converged and found.solver == reference.solver
        assert errors[1] < bound
        assert errors[0] < 100.0 * bound
