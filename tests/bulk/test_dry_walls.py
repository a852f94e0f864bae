# SPDX-License-Identifier: LGPL-3.0-or-later
"""Walls of dry bricks, pressed and pushed over their friction or until they rock, without inertia.

Newton's method goes in circles in these steps: a point is pushed in where it is open and pulled
where it slips, and sticks (`interior_contacts.py`).
"""

from __future__ import annotations

import numpy as np
import pytest

import xper_fx as xf

BRICK, COURSE, PRESSURE, DENSITY, GRAVITY = 0.2, 0.1, 0.3e6, 2000.0, 9.81
GROUND, TOP = 1, 2
GLUED = 2  # cell tag


def wall(courses, bricks, friction, material, step=0.05, weight=True, glued=0, contact="position"):
    """Pressed by a beam in 0.1 s, which then is pushed at 5 mm/s."""
    width, height = BRICK * bricks, COURSE * (courses + 1)
    mesh = xf.crossed_rectangle((0.0, 0.0), (width, height), (4 * bricks, 2 * (courses + 1)))
    x, y, _ = mesh.geometry.x[xf.geometry_dofmap(mesh)].mean(axis=1).T
    course = (y / COURSE).astype(int)
    column = np.floor((x + 0.5 * BRICK * (course % 2)) / BRICK).astype(int)
    beam = course == courses
    facets = {GROUND: lambda x: x[1] < 1e-6, TOP: lambda x: x[1] > height - 1e-6}
    tags = {GLUED: lambda x: x[1] < COURSE * glued + 1e-6} if glued else {}
    loads = [
        xf.PrescribedDisplacement(GROUND, 0, 0.0),
        xf.PrescribedDisplacement(GROUND, 1, 0.0),
        xf.SurfaceTraction(TOP, lambda t: (0.0, -PRESSURE * min(t / 0.1, 1.0))),
        xf.PrescribedDisplacement(TOP, 0, lambda t: 5e-3 * max(t - 0.1, 0.0)),
    ]
    scene = xf.Scene(
        xf.explode(
            mesh,
            np.where(beam, 0, 1 + course * (bricks + 1) + column),
            xf.tag_cells(mesh, tags, 1),
            xf.tag_facets(mesh, facets),
        ),
        dict.fromkeys((1, *tags), material(5e9, 0.2, DENSITY)),
        interactions={(GLUED, GLUED): xf.laws.PerfectBond()} if glued else {},
        default_interaction=xf.laws.SignoriniCoulomb(friction, contact=contact),
        loads=[*loads, *([xf.Gravity((0.0, -GRAVITY))] if weight else [])],
    )
    return xf.Simulation(scene, step, inertia=False, num_threads=1)


def push(*arguments, end_time=1.0, **options):
    """The push (N/m) at the end of each step of a wall."""
    simulation = wall(*arguments, **options)
    return np.array([simulation.reaction(TOP)[0] for _ in simulation.steps(end_time)])


@pytest.mark.parametrize(("friction", "weight"), [(0.4, True), (0.6, False)])
def test_the_beam_slides_at_last(friction, weight):
    """On the wall, whose top bears the pressure and the beam; no step is cut."""
    forces = push(5, 5, friction, xf.materials.LinearElastic, weight=weight)
    borne = PRESSURE * 5 * BRICK + weight * DENSITY * GRAVITY * COURSE * 5 * BRICK
    assert len(forces) == 20
    assert forces[-1] == pytest.approx(friction * borne, rel=1e-7)
    assert np.all(np.diff(forces) > -1e-6 * borne)


def test_a_slender_wall_rocks():
    """On its first course, which is held: as a whole it would bear all that lies on that course."""
    forces = push(6, 3, 0.6, xf.materials.LinearElastic)
    width, height = 3 * BRICK, 6 * COURSE
    rigid = 0.5 * (PRESSURE + DENSITY * GRAVITY * height) * width**2 / height
    assert 0.97 * rigid < forces[-1] < rigid
    assert np.ptp(forces[-5:]) < 1e-6 * rigid


def test_at_finite_strain():
    forces = push(3, 3, 0.6, xf.materials.SaintVenantKirchhoff, step=0.1)
    borne = PRESSURE * 3 * BRICK + DENSITY * GRAVITY * COURSE * 3 * BRICK
    assert forces[-1] == pytest.approx(0.6 * borne, rel=2e-3)


def test_points_that_part_on_the_way_as_frames_turn():
    """At the velocity level no impulse can close those then: they keep their place on the path."""
    options = {"step": 0.1, "end_time": 0.4, "contact": "velocity"}
    forces = push(3, 3, 0.3, xf.materials.SaintVenantKirchhoff, **options)
    borne = PRESSURE * 3 * BRICK + DENSITY * GRAVITY * COURSE * 3 * BRICK
    assert forces[-1] == pytest.approx(0.3 * borne, rel=2e-3)


def test_glued_courses_below():
    """Their bonds have multipliers, as in Newton's method, beside the interior point."""
    forces = push(4, 3, 0.7, xf.materials.LinearElastic, glued=2)
    borne = (PRESSURE + DENSITY * GRAVITY * COURSE) * 3 * BRICK
    assert len(forces) == 20
    assert forces[-1] == pytest.approx(0.7 * borne, rel=1e-7)


def test_an_interior_point_that_jams_begins_anew():
    """Without that, from x and z of other sizes, the steps of 30 ms are cut into 42."""
    forces = push(3, 3, 0.8, xf.materials.LinearElastic, step=0.03, glued=1)
    borne = (PRESSURE + DENSITY * GRAVITY * COURSE) * 3 * BRICK
    assert len(forces) <= 38
    assert forces[-1] == pytest.approx(0.8 * borne, rel=1e-7)


def test_flips_that_are_rounding_end_a_step():
    """Many joints are at their bound: some flip for ever, a few times the tolerance apart."""
    simulation = wall(6, 4, 0.9, xf.materials.LinearElastic, step=0.02, glued=3)
    forces = [simulation.reaction(TOP)[0] for _ in simulation.steps(0.26)]
    assert len(forces) <= 16
    assert np.all(np.diff(forces[5:]) > 0.0)


def test_every_joint_obeys_signorini_and_coulomb():
    """Gaps, pressures and slips of each step, some of which an interior point has found."""
    friction, step = 0.6, 0.05
    simulation = wall(5, 5, friction, xf.materials.LinearElastic, step)
    (joints,) = simulation.interactions.groups
    before = joints.jump.copy()
    for _ in simulation.steps(0.6):
        r, slip, gap = joints.impulse, joints.jump[:, 1] - before[:, 1], joints.jump[:, 0]
        before, largest = joints.jump.copy(), r.max()
        bound = friction * r[:, 0]
        assert r[:, 0].min() >= 0.0
        assert np.abs(gap[r[:, 0] > 0.0]).max() < 1e-12
        assert gap.min() > -1e-12
        assert np.all(np.abs(r[:, 1]) <= bound + 1e-9 * largest)
        slides = np.abs(slip) > 1e-9
        np.testing.assert_allclose(
            r[slides, 1], -np.sign(slip[slides]) * bound[slides], atol=1e-7 * largest
        )
    assert slides.sum() > 20
