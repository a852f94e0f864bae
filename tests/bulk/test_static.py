# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs without inertia: nothing takes its place, so that every body must be held."""

import numpy as np
import pytest
from scenes import BACK, BOTTOM, LEFT, RIGHT, box_bodies, run

from xper_fx.bulk.rigid_motions import free_rigid_motions
from xper_fx.forms.loads import PrescribedDisplacement, RayleighDamping, SurfaceTraction
from xper_fx.materials import LinearElastic, NeoHookean
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

SIZE = 3e-5


def bar(held, material=None, dim=2, label=0, forces=(), **options):
    """A bar of which (facet tag, component) are held."""
    lengths, cells = ((2.0, 1.0, 1.0)[:dim], (2, 1, 1)[:dim])
    bodies = box_bodies(
        np.multiply(SIZE, lengths), cells, "crossed" if dim == 2 else "tetrahedron", label=label
    )
    material = material or LinearElastic(young=7e9, poisson=0.3, density=2000.0)
    loads = [PrescribedDisplacement(facets, axis, 0.0) for facets, axis in held]
    return Scene(bodies, {1: material}, loads=[*loads, *forces], **options)


def static(scene, step=0.1):
    return Simulation(scene, step, theta=1.0, inertia=False)


ROLLERS = [(LEFT, 0), (BOTTOM, 1)]


@pytest.mark.parametrize(
    "dim, held, ways",
    [
        (2, [], 3),
        (2, [(LEFT, 0), (RIGHT, 0)], 1),  # slides along y
        (2, [(LEFT, 1)], 1 + 1),  # slides along x; both nodes of LEFT let it turn
        (3, [(LEFT, 0), (BOTTOM, 1)], 1),  # slides along z
        (3, [(LEFT, 1), (LEFT, 2)], 3),  # slides along x, turns about y and z
    ],
)
def test_a_body_that_can_move_as_a_whole_is_refused(dim, held, ways):
    with pytest.raises(ValueError, match=rf"body 0 is free .* in {ways} way\(s\).*inertia=True"):
        static(bar(held, dim=dim))


@pytest.mark.parametrize(
    "dim, held",
    [(2, ROLLERS), (2, [(LEFT, 0), (LEFT, 1)]), (3, [*ROLLERS, (BACK, 2)])],
)
def test_a_body_that_is_held_is_taken(dim, held):
    assert run(static(bar(held, dim=dim)), 1)[0].newton_iterations == 1


def test_the_body_that_is_not_held_is_named():
    scene = bar([(LEFT, 0), (LEFT, 1)], label=lambda x: x[0] > SIZE, interactions={(1, 1): None})
    with pytest.raises(ValueError, match=r"body 1 is free .* in 3 way\(s\)"):
        static(scene)


def test_one_point_of_a_body_lets_it_turn():
    """Nodes 0 to 3 are a square held at a corner, 4 to 7 one held at two."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    x = SIZE * np.concatenate([corners, 1e3 + corners])
    held = np.zeros(x.shape, bool)
    held[[0, 4]] = True
    held[5, 1] = True
    np.testing.assert_array_equal(free_rigid_motions(x, np.array([0, 4, 8]), held), [1, 0])


def test_along_the_line_through_the_held_point_nothing_is_held():
    """A component that a rotation about the held point does not move."""
    x = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    held = np.zeros(x.shape, bool)
    held[0] = held[1, 0] = True  # node 1 turns along y
    assert free_rigid_motions(x, np.array([0, 3]), held) == [1]


@pytest.mark.parametrize("kind", (LinearElastic, NeoHookean))
def test_nothing_takes_the_place_of_inertia(kind):
    """Neither density nor step matters, to the bit: K is not regularised by either.

    Both are scaled by powers of two, which leaves roundings alone.
    """
    pull = [SurfaceTraction(RIGHT, (2e8, 0.0))]

    def displacement(density, step):
        scene = bar(ROLLERS, kind(young=7e9, poisson=0.3, density=density), forces=pull)
        simulation = static(scene, step)
        run(simulation, 1)
        return simulation.state.displacement

    ours = displacement(2000.0, 0.125)
    assert np.abs(ours).max() > 0.01 * SIZE
    np.testing.assert_array_equal(ours, displacement(2000.0 * 2.0**20, 0.125))
    np.testing.assert_array_equal(ours, displacement(2000.0, 0.125 * 2.0**-10))


def test_a_static_bar_bears_its_load_at_once():
    """Plane strain, sigma along x: u = sigma (1 - nu^2) L / E, whatever the time."""
    simulation = static(bar(ROLLERS, forces=[SurfaceTraction(RIGHT, (2e8, 0.0))]))
    run(simulation, 2)
    u = simulation.mean_displacement(RIGHT)[0]
    np.testing.assert_allclose(u, 2e8 * (1.0 - 0.3**2) * 2.0 * SIZE / 7e9, rtol=1e-10)
    energies = simulation.ledger.as_columns()
    assert energies["kinetic"] == 0.0 and simulation.bulk.mass is None


def test_damping_of_a_mass_that_is_not_there_is_refused():
    scene = bar(ROLLERS, damping=RayleighDamping(mass=3.0))
    with pytest.raises(ValueError, match=r"Damping by 3 /s times the mass.*inertia=True"):
        static(scene)
    # by the stiffness there is something to damp: a Kelvin-Voigt solid, u = u_inf (1 - x^n) with
    # x = b / (b + h) by backward Euler
    b, h = 0.2, 0.1
    pull = [SurfaceTraction(RIGHT, (2e8, 0.0))]
    creeping = static(bar(ROLLERS, forces=pull, damping=RayleighDamping(stiffness=b)), h)
    run(creeping, 3)
    whole = 2e8 * (1.0 - 0.3**2) * 2.0 * SIZE / 7e9
    np.testing.assert_allclose(
        creeping.mean_displacement(RIGHT)[0], whole * (1.0 - (b / (b + h)) ** 3), rtol=1e-10
    )
    assert creeping.ledger.as_columns()["dissipated_viscous"] > 0.0
    assert abs(creeping.ledger.closure) < 1e-10 * creeping.ledger.energies.external_work


def test_a_rotation_about_a_slanted_axis_is_found():
    """About (1, 1, 1): u_x = z - y vanishes where y = z, and so on round."""
    x = np.array([[0, 0, 0], [0, 1, 1], [1, 0, 1], [1, 1, 0.0]])
    held = np.array([[1, 1, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1]], bool)
    assert free_rigid_motions(x, np.array([0, 4]), held) == [1]
    held[1, 1] = True
    assert free_rigid_motions(x, np.array([0, 4]), held) == [0]
