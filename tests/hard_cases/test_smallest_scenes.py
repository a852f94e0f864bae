# SPDX-License-Identifier: LGPL-3.0-or-later
"""One cell, one body, no interactions: every scheme is exact, and warns of nothing."""

from __future__ import annotations

import numpy as np
import pytest
from cells import cell_of, cell_run, mesh_from, ramp
from scenes import (
    BACK,
    BOTTOM,
    LEFT,
    RIGHT,
    box_bodies,
    field,
    mesh_of,
    nodes,
    run,
    side_tags,
)
from scipy.optimize import brentq

from xper_fx.bodies.explode import explode
from xper_fx.forms.loads import Gravity, PrescribedDisplacement
from xper_fx.materials import LinearElastic, NeoHookean
from xper_fx.materials.material import lame
from xper_fx.nscd.laws import PerfectBond
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.compat import geometry_dofmap

pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")

SOLID = LinearElastic(100.0, 0.3, 2.0)
SHAPES = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}
DYNAMIC = pytest.mark.parametrize("scheme", ["implicit", "explicit"])


def one_cell(kind):
    """A mesh of one cell: a square or a cube, or the simplex that its first cell is."""
    dim = SHAPES[kind]
    bodies = box_bodies((1,) * dim, (1,) * dim, kind, 0)
    if kind in ("quadrilateral", "hexahedron"):
        return bodies
    mesh = mesh_of((1,) * dim, (1,) * dim, kind)
    first = mesh_from(geometry_dofmap(mesh)[:1], mesh.geometry.x[:, :dim], kind)
    return explode(first, facet_tags=side_tags(first, (1,) * dim))


@DYNAMIC
@pytest.mark.parametrize("kind", SHAPES)
def test_one_cell_falls(kind, scheme, figure):
    """Thrown under gravity: the parabola, its work, no strain."""
    dim = SHAPES[kind]
    gravity, thrown = np.array([0.0, -9.81, 1.0])[:dim], np.array([3.0, 4.0, -1.0])[:dim]
    scene = Scene(
        one_cell(kind), {1: SOLID}, loads=[Gravity(tuple(gravity))],
        default_interaction=PerfectBond(),
        initial_velocity=lambda x: np.outer(thrown, np.ones(x.shape[1])),
    )  # fmt: skip
    step = 0.01 if scheme == "implicit" else None
    simulation = Simulation(scene, step, scheme=scheme)
    assert simulation.interactions is None
    records = run(simulation, 20)
    time = simulation.time
    fall = thrown * time + 0.5 * gravity * time**2
    error = np.abs(field(simulation) - fall).max() / np.abs(fall).max()
    figure(f"one {kind} falls, {scheme}", "distance error < 1e-13", error)
    assert error < 1e-13
    energies = records[-1].energies
    scale = energies["kinetic"]
    mass = simulation.bulk.mass[::dim].sum()
    assert energies["external_work"] == pytest.approx(mass * gravity @ fall, rel=1e-12)
    assert abs(energies["closure"]) < 1e-12 * scale
    assert abs(energies["elastic"]) < 1e-13 * scale


@DYNAMIC
def test_a_body_at_rest_stays(scheme):
    """Nothing acts: every number is zero, none is missing."""
    simulation = Simulation(
        Scene(box_bodies((1, 1), (1, 1), label=0), {1: SOLID}), 1e-2, scheme=scheme
    )
    for record in run(simulation, 5):
        assert all(value == 0.0 for value in record.energies.values())
        assert record.residual == record.newton_residual == 0.0
    assert not np.any(simulation.state.displacement) and not np.any(simulation.state.velocity)


@pytest.mark.parametrize("kind", ["quadrilateral", "hexahedron"])
@pytest.mark.parametrize("material", [SOLID, NeoHookean(100.0, 0.3, 2.0)], ids=type)
def test_one_cell_stretched_without_inertia(material, kind, figure):
    """Pulled by 10 % with free sides: the force of uniaxial stress, plane strain in 2D."""
    dim, strain = SHAPES[kind], 0.1
    motions = [(LEFT, 0, 0.0), (BOTTOM, 1, 0.0), (BACK, 2, 0.0)][:dim]
    motions.append((RIGHT, 0, lambda t: strain * t))
    scene = Scene(
        one_cell(kind), {1: material}, loads=[PrescribedDisplacement(*m) for m in motions]
    )
    simulation = Simulation(scene, 0.25, theta=1.0, inertia=False, newton_tolerance=1e-13)
    run(simulation, 4)
    found = simulation.reaction(RIGHT)[0]
    x, u = nodes(simulation), field(simulation)
    side = 1.0 + u[x[:, 1] > 0.5, 1].mean()
    lam, mu = lame(100.0, 0.3)
    if material.linear:
        exact = strain * (100.0 if dim == 3 else 100.0 / (1.0 - 0.3**2))
        across = 1.0 - strain * (0.3 if dim == 3 else 0.3 / 0.7)
    else:
        # P = mu (F - F^-T) + lambda ln J F^-T with no stress across
        def lateral(b):
            log_j = np.log1p(strain) + (dim - 1) * np.log(b)
            return mu * (b - 1.0 / b) + lam * log_j / b

        across = brentq(lateral, 0.8, 1.0, xtol=1e-15)
        log_j = np.log1p(strain) + (dim - 1) * np.log(across)
        exact = mu * (1.1 - 1.0 / 1.1) + lam * log_j / 1.1
    error = abs(found / exact - 1.0)
    figure(f"one {kind} pulled, {type(material).__name__}", "force error < 1e-11", error)
    assert error < 1e-11
    assert side == pytest.approx(across, rel=1e-12)


@pytest.mark.parametrize("bodies", ["one body", "each cell a body"])
@pytest.mark.parametrize("kind", ["quadrilateral", "triangle"])
def test_periodic_cell_of_one_cell_or_two(kind, bodies, figure):
    """A period of one quadrilateral, tied to itself, or two triangles: nothing fluctuates."""
    F = np.array([[1.2, 0.1], [-0.05, 0.9]])
    law = None if bodies == "one body" else PerfectBond()
    label = 0 if bodies == "one body" else None
    simulation = cell_run(
        cell_of((1, 1), (1, 1), kind, label=label), {1: NeoHookean(100.0, 0.3, 1e-3)}, ramp(F), law,
        step=0.25, steps=4, theta=1.0,
    )  # fmt: skip
    lam, mu = lame(100.0, 0.3)
    inverse = np.linalg.inv(F).T
    exact = mu * (F - inverse) + lam * np.log(np.linalg.det(F)) * inverse
    error = np.abs(simulation.macroscopic.stress - exact).max() / np.abs(exact).max()
    figure(f"period of one {kind}, {bodies}", "stress error < 1e-11", error)
    assert error < 1e-11
    assert simulation.macroscopic.hill_mandel < 1e-11
    assert (simulation.interactions is None) == (law is None or kind == "quadrilateral")
