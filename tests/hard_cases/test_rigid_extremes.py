# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid bodies and their contacts at the extremes: masses, speeds, places, units, thin walls."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import run

from xper_fx.forms.loads import Gravity
from xper_fx.nscd.laws import SignoriniCoulomb
from xper_fx.nscd.rigid import Disc, Polygon, Polyhedron, RigidBody, Sphere, wall
from xper_fx.scene.contact import Contact
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

OPTIONS = {"num_threads": 1, "tolerance": 1e-10}


def scene_of(rigid, friction=0.3, restitution=0.0, gravity=None):
    groups = sorted({body.group for body in rigid})
    pairs = [(a, b) for i, a in enumerate(groups) for b in groups[i:]]
    law = SignoriniCoulomb(friction, restitution)
    loads = [] if gravity is None else [Gravity(gravity)]
    return Scene(rigid=rigid, contacts=[Contact(pair, law) for pair in pairs], loads=loads)


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [1.0, 1e3, 1e6])
def test_a_heavy_block_on_a_light_one(ratio, figure):
    """Light below: the floor carries both weights, at once and for good."""
    box = Polygon.box((1.0, 1.0))
    rigid = [
        wall((0.0, 0.0), (0.0, 1.0), "floor"),
        RigidBody(box, (0.0, 0.5), "blocks", mass=1.0),
        RigidBody(box, (0.1, 1.5), "blocks", mass=ratio),
    ]
    simulation = Simulation(scene_of(rigid, gravity=(0.0, -10.0)), 1e-3, **OPTIONS)
    worst = 0.0
    for _ in range(20):
        run(simulation, 1)
        weight = 10.0 * (1.0 + ratio)
        worst = max(worst, abs(simulation.reaction_of("floor")[1] - weight) / weight)
    figure(f"heavy block on a light one, mass ratio {ratio:g}", "weight on the floor < 1e-8", worst)
    assert worst < 1e-8
    assert np.abs(simulation.rigid.state.velocity[1:]).max() < 1e-8


@pytest.mark.parametrize("far", [1e3, 1e6])
def test_far_from_the_origin(far, figure):
    """A bouncing disc goes as near the origin, to the rounding of its coordinates."""
    heights = []
    for place in (0.0, far):
        rigid = [
            wall((place, place), (0.0, 1.0), "floor"),
            RigidBody(Disc(0.5), (place, place + 1.0), "discs", density=1.0, velocity=(1.0, 0.0)),
        ]
        scene = scene_of(rigid, restitution=0.5, gravity=(0.0, -10.0))
        simulation = Simulation(scene, 1.0 / 512.0, **OPTIONS)
        run(simulation, 300)
        heights.append(simulation.rigid.state.position[1] - place)
    apart = np.abs(heights[1] - heights[0]).max()
    figure(
        f"bouncing disc {far:g} m from the origin", "difference < 1e-11 of the place", apart / far
    )
    assert apart < 1e-11 * far


@pytest.mark.parametrize("power", [-30, 20])
def test_units_do_not_matter(power):
    """Lengths in other units, by a power of two: the same motion."""
    ends = []
    for unit in (1.0, 2.0**power):
        rigid = [
            wall((0.0, 0.0), (0.0, unit), "floor"),
            RigidBody(Disc(0.5 * unit), (0.0, 0.6 * unit), "discs", mass=1.0, spin=3.0),
            RigidBody(Polygon.box((unit, unit)), (0.2 * unit, 1.7 * unit), "boxes", mass=2.0),
        ]
        scene = scene_of(rigid, gravity=(0.0, -8.0 * unit))
        simulation = Simulation(scene, 1.0 / 128.0, **OPTIONS)
        run(simulation, 60)
        ends.append(simulation.rigid.state.position / unit)
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-6)


@pytest.mark.parametrize("speed", [10.0, 1e3, 1e5])
def test_nothing_is_shot_through_a_thin_wall(speed, figure):
    """Steps are cut where a body would cross a plate a tenth of its size between two searches."""
    rigid = [
        RigidBody(
            Polygon.box((0.1, 4.0)), (2.0, 0.0), "plate", prescribed={0: 0.0, 1: 0.0, 2: 0.0}
        ),
        RigidBody(Disc(0.5), (0.0, 0.1), "shots", density=1.0, velocity=(speed, 0.0)),
    ]
    simulation = Simulation(scene_of(rigid), 8.0 / speed, max_halvings=8, **OPTIONS)
    run(simulation, 2)
    x = simulation.rigid.state.position[1, 0]
    figure(f"shot of {speed:g} m/s at a thin plate", "position stays before the plate", x)
    assert x < 2.0
    assert simulation.rigid.state.velocity[1, 0] < 1e-9 * speed


def test_slivers_and_needles_settle(figure):
    """Polygons 200 times as long as thick fall on each other and come to rest."""
    needle = Polygon.box((2.0, 0.01))
    rigid = [wall((0.0, 0.0), (0.0, 1.0), "floor")]
    rigid += [
        RigidBody(needle, (0.1 * i, 0.0051 + 0.0102 * i), "needles", density=1.0) for i in range(6)
    ]
    simulation = Simulation(scene_of(rigid, gravity=(0.0, -10.0)), 2e-4, **OPTIONS)
    run(simulation, 250)
    y = simulation.rigid.state.position[1:, 1]
    sunk = np.abs(y - 0.01 * (np.arange(6) + 0.5)).max()
    figure("six needles, 200 long to 1 thick, at rest", "off their places < 1e-3 m", sunk)
    assert sunk < 1e-3
    assert simulation.ledger.energies.kinetic < 1e-12


@pytest.mark.slow
def test_a_box_on_its_corner_falls_over(figure):
    """An unstable balance in 3D: no energy is created on the way, and a face comes to lie flat."""
    edge = np.array([1.0, 1.0, 1.0]) / np.sqrt(3.0)
    axis = np.cross(edge, (0.0, 0.0, 1.0))
    axis *= np.arccos(edge[2]) / np.linalg.norm(axis)
    from scipy.spatial.transform import Rotation

    rotation = Rotation.from_rotvec(axis + (1e-3, 0.0, 0.0))
    rigid = [
        wall((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), "floor"),
        RigidBody(
            Polyhedron.box((1.0, 1.0, 1.0)), (0.0, 0.0, 0.87), "boxes", density=1.0,
            rotation=rotation,
        ),
    ]  # fmt: skip
    simulation = Simulation(
        scene_of(rigid, friction=0.5, gravity=(0.0, 0.0, -10.0)), 8e-3, **OPTIONS
    )
    held = 10.0
    most = 0.0
    for _ in range(400):
        run(simulation, 1)
        most = max(most, abs(simulation.ledger.closure) / held)
    figure("box that falls from its corner", "ledger closes to 1e-12", most)
    assert most < 1e-12
    assert simulation.rigid.state.position[1, 2] == pytest.approx(0.5, abs=2e-2)
    up = np.abs(simulation.rigid.state.turn.rotation[1][2])
    assert up.max() == pytest.approx(1.0, abs=1e-3)


def test_spheres_of_all_sizes(figure):
    """Masses over three decades in a row that collides: momentum is kept."""
    rng = np.random.default_rng(5)
    radii = 10.0 ** rng.uniform(-1.0, 0.0, 60)
    place = np.concatenate([[0.0], np.cumsum(radii[1:] + radii[:-1])])
    rigid = [
        RigidBody(
            Sphere(r), (x, 0.0, 0.0), "spheres", density=1.0, velocity=rng.normal(size=3) * 0.1
        )
        for r, x in zip(radii, place, strict=True)
    ]
    simulation = Simulation(scene_of(rigid), 1e-3, num_threads=1)
    before = simulation.rigid.momentum(), simulation.rigid.angular_momentum()
    scale = simulation.scene.rigid_bodies.mass.sum() * 0.1
    run(simulation, 20)
    after = simulation.rigid.momentum(), simulation.rigid.angular_momentum()
    off = max(np.abs(a - b).max() for a, b in zip(after, before, strict=True)) / scale
    figure("spheres with masses over three decades", "momenta change < 1e-12", off / place[-1])
    assert off < 1e-12 * place[-1]
    assert simulation.ledger.energies.dissipated_impact > 0.0
