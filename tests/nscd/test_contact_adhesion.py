# SPDX-License-Identifier: LGPL-3.0-or-later
"""Adhesion that forms where bodies meet, if the scene's contact has it, and nowhere else."""

import pytest

from xper_fx.nscd.laws import CohesiveZone, SignoriniCoulomb
from xper_fx.nscd.rigid import Polygon, Polyhedron, RigidBody
from xper_fx.scene.contact import Contact
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

ENERGY, STRENGTH, SPEED, STEP = 1e-2, 100.0, 1e-3, 2e-3
GLUE = CohesiveZone(1e6, ENERGY, STRENGTH)


def pulled_apart(dim, law):
    """Two blocks that touch along half of a face, one held and one pulled; force by step."""
    lengths = (1.0, 2.0, 0.5)[:dim]
    shape = Polygon.box(lengths) if dim == 2 else Polyhedron.box(lengths)
    still = dict.fromkeys(range(3 * (dim - 1)), 0.0)
    # free to move aside, which nothing makes it do: two driven bodies are not searched for
    up = {part: 0.0 for part in still if part != 0} | {1: SPEED}
    side = (0.5, 2.0, 0.0)[:dim]
    rigid = [
        RigidBody(shape, (0.0,) * dim, "held", prescribed=still),
        RigidBody(shape, side, "pulled", density=1.0, prescribed=up),
    ]
    scene = Scene(rigid=rigid, contacts=[Contact(("held", "pulled"), law, reach=1e-3)])
    simulation = Simulation(scene, STEP, tolerance=1e-10, num_threads=1)
    area = 0.5 * (1.0 if dim == 2 else lengths[2])
    forces = []
    for step in simulation.steps(0.3):  # noqa: B007 - returned
        forces.append(simulation.reaction_of("pulled")[1] / area)
    return simulation, step, forces, area


@pytest.mark.parametrize("dim", [2, 3])
def test_what_sticks_takes_the_work_of_its_fracture(dim):
    simulation, step, forces, area = pulled_apart(dim, GLUE)
    assert max(forces) == pytest.approx(STRENGTH, rel=2e-2)
    assert forces[-1] == pytest.approx(0.0, abs=1e-9 * STRENGTH)
    assert step.energies["dissipated_cohesion"] == pytest.approx(ENERGY * area, rel=1e-6)
    assert step.energies["external_work"] == pytest.approx(ENERGY * area, rel=1e-6)
    assert abs(step.energies["closure"]) < 1e-9 * ENERGY * area


def test_contact_alone_does_not_stick():
    _, step, forces, _ = pulled_apart(2, SignoriniCoulomb())
    assert max(map(abs, forces)) < 1e-9 * STRENGTH
    assert step.energies["dissipated_cohesion"] == 0.0
