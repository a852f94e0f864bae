# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies that are under a stress before anything moves."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import BOTTOM, LEFT, RIGHT, TOP, box_bodies, midpoints

import xper_fx as xf

ROCK = xf.materials.LinearElastic(30e9, 0.25, 2600.0)
GRAVITY, HEIGHT = 9.81, 40.0
TURNED = np.array([[0.0, 1e-10], [-1e-10, 0.0]])  # rounding of a stress that was turned


def geostatic(x):
    """Weight above, half of it to the sides; linear in y (or z in 3D)."""
    dim = 2 if np.ptp(x[2]) == 0.0 else 3
    stress = np.zeros((dim, dim, x.shape[1]))
    vertical = ROCK.density * GRAVITY * (x[dim - 1] - HEIGHT)
    for i in range(dim):
        stress[i, i] = vertical if i == dim - 1 else 0.5 * vertical
    return stress


@pytest.mark.parametrize(
    ("kind", "order", "options"),
    [
        ("crossed", 1, {"scheme": "explicit"}),
        ("quadrilateral", 2, {"step": 1e-3, "scheme": "implicit"}),
        ("tetrahedron", 1, {"step": 1.0, "inertia": False}),
    ],
)
def test_rock_in_balance_with_its_weight_stays(kind, order, options):
    """Two layers with friction between them: nothing moves, and the stress is what was given."""
    dim = 3 if kind == "tetrahedron" else 2
    lengths, cells = (HEIGHT,) * dim, (2,) * dim
    held = [xf.PrescribedVelocity(1 + side, side // 2, 0.0) for side in range(2 * dim - 1)]
    scene = xf.Scene(
        box_bodies(lengths, cells, kind, lambda x: (x[dim - 1] > 0.5 * HEIGHT).astype(int)),
        {1: ROCK},
        default_interaction=xf.laws.SignoriniCoulomb(0.5, contact="position"),
        loads=[
            xf.Gravity((*(0.0,) * (dim - 1), -GRAVITY)), xf.InitialStress(geostatic), *held
        ],
        order=order,
    )  # fmt: skip
    simulation = xf.Simulation(scene, tolerance=1e-12, num_threads=1, **options)
    for _ in zip(range(3), simulation.steps(10.0), strict=False):
        pass
    weight = ROCK.density * GRAVITY * HEIGHT
    (joint,) = simulation.interactions.groups
    pressed = joint.impulse[:, 0].sum() / simulation.step_size
    assert pressed == pytest.approx(0.5 * weight * HEIGHT ** (dim - 1), rel=1e-9)
    strain = np.abs(simulation.state.displacement).max() / HEIGHT
    assert strain * ROCK.young < 1e-9 * weight
    stress = simulation.forms.stress_evaluator()()
    given = geostatic(midpoints(scene.bodies.mesh)).transpose(2, 0, 1)
    np.testing.assert_allclose(stress[:, :dim, :dim], given, atol=1e-8 * weight)


def test_what_nothing_holds_relaxes():
    """A block on rollers that is cut out of a stressed body: its strain is -C^-1 sigma.

    Two initial stresses add up; the block stores sigma : C^-1 sigma / 2 by its volume of 2.
    """
    along, across = 8e6, -20e6
    stress = np.diag([along, across])
    scene = xf.Scene(
        box_bodies((2.0, 1.0), (4, 2), "crossed", 0),
        {1: xf.materials.LinearElastic(ROCK.young, ROCK.poisson, ROCK.density, plane="stress")},
        loads=[
            xf.InitialStress(0.25 * stress + TURNED), xf.InitialStress(0.75 * stress),
            xf.PrescribedVelocity(LEFT, 0, 0.0), xf.PrescribedVelocity(BOTTOM, 1, 0.0),
        ],
    )  # fmt: skip
    simulation = xf.Simulation(scene, 1.0, inertia=False)
    (record,) = simulation.steps(1.0)
    strain = -(along - ROCK.poisson * across) / ROCK.young
    assert simulation.mean_displacement(RIGHT)[0] == pytest.approx(2.0 * strain, rel=1e-9)
    strain = -(across - ROCK.poisson * along) / ROCK.young
    assert simulation.mean_displacement(TOP)[1] == pytest.approx(strain, rel=1e-9)
    assert np.array_equal(simulation.displacement.x.array, simulation.state.displacement)
    assert np.abs(simulation.forms.stress_evaluator()()).max() < 1e-8 * abs(across)
    stored = (along**2 + across**2 - 2.0 * ROCK.poisson * along * across) / ROCK.young
    assert record.energies["elastic"] == pytest.approx(stored, rel=1e-9)


def of_block(load, material=ROCK):
    return xf.Scene(
        box_bodies((1.0, 1.0), (1, 1), "crossed", 0),
        {1: material},
        loads=[load],
    )


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (1e6, r"shape \(\).*2 x 2"),
        (np.eye(3), r"shape \(3, 3\)"),
        ([[1.0, 2.0], [2.0]], "the value"),
        (1j * np.eye(2), "the value"),
        ([[0.0, 1e6], [2e6, 0.0]], "two shear stresses that differ"),
        ([[np.nan, 0.0], [0.0, 0.0]], "not finite"),
        (lambda x: np.zeros((2, 2)), r"shape \(2, 2\).*gives \(2, 2, n\)"),
        (lambda x: x, "gives"),
        ("high", "the value 'high'"),
    ],
)
def test_what_is_no_stress_is_refused(value, words):
    with pytest.raises(ValueError, match=words):
        of_block(xf.InitialStress(value))


def test_materials_that_are_not_linear_are_refused():
    with pytest.raises(ValueError, match="cell tag 1 is NeoHookean.*first part of the run"):
        of_block(xf.InitialStress(np.eye(2)), xf.materials.NeoHookean(1e6, 0.3, 1e3))
