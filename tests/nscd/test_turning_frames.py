# SPDX-License-Identifier: LGPL-3.0-or-later
"""Frames that turn with their lips, the spin and the couple, against differences and statics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from xper_fx.nscd import stepped_points
from xper_fx.nscd.facets import facet_points, facet_shapes, with_lips
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.laws import CohesiveZone, SignoriniCoulomb
from xper_fx.nscd.lips import facet_derivatives
from xper_fx.nscd.points import frame_from_normal
from xper_fx.nscd.stepped_points import FacetFlippedError
from xper_fx.nscd.turning_frames import TurningFrames
from xper_fx.nscd.turning_tangents import curvature, motion_of_lips, rows_of_jumps

SEGMENT = np.array([[0.3, -0.2], [1.1, 0.7]])
TRIANGLE = np.array([[0.1, 0.0, 0.2], [1.3, 0.2, -0.1], [0.4, 0.9, 0.5]])
SQUARE = np.array([[0.0, 0.0, 0.1], [1.0, 0.1, -0.1], [0.1, 1.2, 0.0], [1.2, 1.1, 0.2]])
FACETS = {
    "segment": SEGMENT,
    "quadratic segment": np.concatenate([SEGMENT, SEGMENT.mean(axis=0)[None]]),
    "triangle": TRIANGLE,
    "quadratic triangle": np.concatenate(
        [TRIANGLE, [TRIANGLE[[1, 2]].mean(0), TRIANGLE[[0, 2]].mean(0), TRIANGLE[[0, 1]].mean(0)]]
    ),
    "quadrilateral": SQUARE,
}
RULES = [(name, rule) for name in FACETS for rule in ("nodal", "gauss") if (name, rule) != (
    "quadrilateral", "gauss")]  # fmt: skip
LAW = CohesiveZone(1e3, 0.5, 8.0, 400.0, friction=0.3)


def normal_of(x):
    if x.shape[1] == 2:
        t = x[1] - x[0]
        n = np.array([t[1], -t[0]])
    elif len(x) == 4:
        n = np.cross(x[3] - x[0], x[2] - x[1])
    else:
        n = np.cross(x[1] - x[0], x[2] - x[0])
    return n / np.linalg.norm(n)


class Facet:
    """The points of a facing facet between two bodies, on nodes of their own."""

    def __init__(self, name, rule, law=LAW):
        self.x = FACETS[name]
        k, self.dim = self.x.shape
        nodes = np.arange(2 * k).reshape(1, 2, k)
        points = facet_points(nodes, normal_of(self.x)[None], np.ones(1), rule)
        points = with_lips(points, nodes, self.x[None], rule)
        inverse = BodyInverse.from_uniform(
            np.repeat(np.eye(self.dim)[None], 2 * k, axis=0) / 0.7, self.dim
        )
        self.shapes = facet_shapes(self.dim, k, rule)
        self.layer = Interactions(points, [law], np.zeros(len(points), int), inverse)
        self.group = self.layer.groups[0]
        self.both = np.concatenate([self.x, self.x])

    def turn(self, displacement, velocity, reach=0.0, theta=0.5):
        """Frames after the step 2 reach at the velocity, whose middle lies at the reach."""
        displacement, velocity = map(self.with_ground, (displacement, velocity))
        motion = self.layer.lip_motion(displacement, velocity, velocity)
        self.layer.turn(motion, reach / theta, theta)
        return self.layer.points.frame[self.group.indices]

    def spin(self, velocity, theta=0.5):
        """s of a step that begins and ends with a velocity, frames being turned already.

        What is known of the velocities of the start is not taken from the frames, and what the law
        was given of their spin is left out.
        """
        step, group, layer = 1e-3, self.group, self.layer
        group.turning.by_spin[:], group.turning.omega[:] = True, 0.0
        layer._motion = layer._motion._replace(starts=False)
        layer.begin_step(step, theta)
        group.impulse[:] = group.jump[:] = group.velocity[:] = 0.0
        layer.couples()
        values = self.with_ground(velocity)
        layer.commit(values.ravel().copy())
        return theta * layer.points.relative(values)[group.indices] - group.jump / step

    def with_ground(self, values):
        """Values of all slots for those of the nodes: the ground does not move."""
        return np.concatenate([values, np.zeros((1, self.dim))])

    def random(self, seed, size):
        return size * np.random.default_rng(seed).standard_normal(self.both.shape)


def rotation(dim, seed=3):
    q, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((dim, dim)))
    q[:, 0] *= np.linalg.det(q)
    return q


@pytest.mark.parametrize("name", FACETS)
def test_derivatives_of_shape_functions(name):
    """Sums over nodes of the derivatives times positions are the sides of a facet; of 1, zero."""
    x = FACETS[name]
    k, dim = x.shape
    derivatives = facet_derivatives(dim, k, np.eye(k))
    assert np.abs(derivatives.sum(axis=1)).max() < 1e-14
    along = np.einsum("pka,kd->pad", derivatives, x)
    if len(x) == 4:
        sides = np.stack([x[1] - x[0] + x[3] - x[2], x[2] - x[0] + x[3] - x[1]]) / 2
    else:
        sides = x[1:dim] - x[0]
    assert np.abs(along - sides).max() < 1e-14


@pytest.mark.parametrize("k, dim", [(3, 2), (6, 3)])
def test_derivatives_of_quadratic_fields(k, dim):
    """The derivatives at each node of u = s^2 (and s t) are 2 s (t and s)."""
    corners = np.concatenate([np.zeros((1, dim - 1)), np.eye(dim - 1)])
    pairs = [(0, 1)] if dim == 2 else [(1, 2), (0, 2), (0, 1)]
    s = np.concatenate([corners, [corners[list(p)].mean(axis=0) for p in pairs]])
    got = np.einsum("pka,k->pa", facet_derivatives(dim, k, np.eye(k)), s[:, 0] ** 2)
    assert got[:, 0] == pytest.approx(2.0 * s[:, 0], abs=1e-14)
    if dim == 3:
        mixed = np.einsum("pka,k->pa", facet_derivatives(dim, k, np.eye(k)), s[:, 0] * s[:, 1])
        assert mixed == pytest.approx(s[:, ::-1], abs=1e-14)


@pytest.mark.parametrize("name, rule", RULES)
def test_frames_are_those_given_until_lips_move(name, rule):
    """Without displacements F is that of the points; a rotation of all turns it as a whole."""
    facet = Facet(name, rule)
    still = np.zeros_like(facet.both)
    start = frame_from_normal(normal_of(facet.x)[None])[0]
    assert np.abs(facet.turn(still, still) - start).max() < 1e-14
    R = rotation(facet.dim)
    turned = facet.both @ R.T - facet.both
    assert np.abs(facet.turn(turned, still) - start @ R.T).max() < 1e-14


@pytest.mark.parametrize("name, rule", RULES)
def test_points_with_the_same_lips_turn_as_if_each_was_alone(name, rule):
    """Sites change nothing but the order in which couples add up; any points may be taken."""
    facets = [Facet(name, rule) for _ in range(3)]
    shared, alone, taken = (facet.group for facet in facets)
    flat = name in ("segment", "triangle", "quadrilateral")  # one gradient on the whole facet
    assert len(shared.turning.nodes) == (1 if flat else len(shared))
    alone.turning = alone.turning.each_its_site()
    assert len(alone.turning.nodes) == len(alone)
    backwards = np.arange(len(taken))[::-1]
    taken.turning = taken.turning.take(backwards).take(backwards)
    u, v = facets[0].random(21, 0.1), facets[0].random(22, 1.0)
    found = []
    for facet in facets:
        facet.turn(u, v, 0.05)
        group = facet.group
        group.impulse[:] = np.random.default_rng(23).standard_normal(group.impulse.shape)
        turning = group.turning.by_spin, group.turning.jump
        found.append((facet.layer.points.frame, group.jump, group.velocity, *turning))
    for others in found[1:]:
        for one, other in zip(found[0], others, strict=True):
            np.testing.assert_array_equal(one, other)
    first, *rest = (facet.layer.couples() for facet in facets)
    assert np.abs(first).max() > 1e-2
    for other in rest:
        np.testing.assert_allclose(first, other, rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("name", ["segment", "triangle"])
def test_sites_may_be_found_before_points(name, monkeypatch):
    """As several threads do, who share sites: the same bits."""
    found = []
    for ranges in (1, 2):
        monkeypatch.setattr(stepped_points, "num_ranges", lambda count, n=ranges: n)
        facet = Facet(name, "nodal")
        group = facet.group
        facet.turn(facet.random(21, 0.1), facet.random(22, 1.0), 0.05)
        turning = group.turning.by_spin, group.turning.jump, group.turning.omega
        found.append((facet.layer.points.frame, group.jump, group.velocity, *turning))
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("theta", [0.5, 0.7])
@pytest.mark.parametrize("name, rule", RULES)
def test_spin_is_the_rate_of_the_frame(name, rule, theta):
    """s = F (omega x d) is -F' d, with F' by differences of frames."""
    facet = Facet(name, rule)
    u, v, eps = facet.random(1, 0.2), facet.random(2, 1.0), 1e-6
    before, after = facet.turn(u - eps * v, 0 * v), facet.turn(u + eps * v, 0 * v)
    rate = (after - before) / (2.0 * eps)
    facet.turn(u, v, theta=theta)
    jump = np.einsum("pid,pi->pd", facet.layer.points.frame, facet.group.turning.jump)
    expected = -np.einsum("pid,pd->pi", rate, jump)
    assert facet.spin(v, theta) == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("theta", [0.5, 0.7])
@pytest.mark.parametrize("name", ["segment", "triangle"])
def test_laws_are_given_the_spin_of_the_start(name, theta):
    """velocity0 - s / (1 - theta): a step that ends with the same velocity has U1 = U0 + h U'."""
    facet, step = Facet(name, "nodal"), 0.02
    layer, group = facet.layer, facet.group
    u, v = facet.random(1, 0.2), facet.random(2, 1.0)
    group.turning.isotropic[:] = False
    facet.turn(u, v, step * theta, theta)
    jump, velocity = group.jump.copy(), group.velocity.copy()
    relative = layer.points.relative(facet.with_ground(v))[group.indices]
    before = facet.turn(u, v)
    k = len(facet.x)
    at_start = np.einsum("pid,pd->pi", before, (u[:k] - u[k:])[group.indices])
    facet.turn(u, v, step * theta, theta)
    layer.begin_step(step, theta)
    group.impulse[:] = 0.0
    layer.couples()
    layer.commit(facet.with_ground(v).ravel())
    moved = group.jump - at_start
    spin = relative - moved / step
    assert np.abs(spin).max() > 0.05
    assert velocity == pytest.approx(relative - spin / (1.0 - theta), rel=1e-9, abs=1e-10)
    assert jump == pytest.approx(at_start, rel=1e-9, abs=1e-10)
    assert spin == pytest.approx(facet.spin(v, theta), rel=1e-9, abs=1e-10)


@pytest.mark.parametrize("name", ["segment", "triangle"])
def test_lips_do_not_drift_with_theta_1(name):
    """Their law takes F(q1) d0 for U0, and their jump at the end is F(q1) d1."""
    facet, step = Facet(name, "nodal"), 0.02
    layer, group = facet.layer, facet.group
    u, v = facet.random(15, 0.1), facet.random(16, 1.0)
    group.turning.isotropic[:] = False
    frame = facet.turn(u, v, step, 1.0)
    k = len(facet.x)
    start, end = (
        np.einsum("pid,pd->pi", frame, (x[:k] - x[k:])[group.indices]) for x in (u, u + step * v)
    )
    assert group.jump == pytest.approx(start, rel=1e-12)
    layer.begin_step(step, 1.0)
    group.impulse[:] = 0.0
    layer.couples()
    layer.commit(facet.with_ground(v).ravel())
    assert group.jump == pytest.approx(end, rel=1e-12)


@pytest.mark.parametrize("name, rule", RULES)
def test_forces_and_couple_have_no_moment(name, rule):
    """f at the candidate, -f at the antagonist and the couple's forces: no resultant, no moment."""
    facet = Facet(name, rule)
    u, v, reach = facet.random(4, 0.1), facet.random(5, 0.3), 0.05
    facet.turn(u, v, reach)
    group = facet.group
    group.impulse[:] = np.random.default_rng(6).standard_normal(group.impulse.shape)
    forces, couples = facet.layer.impulses()[:-1], facet.layer.couples()[:-1]
    middle = facet.both + u + reach * v
    assert np.abs(couples.sum(axis=0)).max() < 1e-13
    cross = np.cross if facet.dim == 3 else lambda a, b: a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    moments = [cross(middle, p).sum(axis=0) for p in (forces, couples)]
    assert np.abs(moments[0]).max() > 1e-3
    assert np.abs(moments[0] + moments[1]).max() < 1e-13


@pytest.mark.parametrize("name, rule", RULES)
def test_the_couple_does_the_work_of_the_spin(name, rule):
    """H r . v + couple . v = r . (F B v - s) for any velocities."""
    facet = Facet(name, rule)
    u, v = facet.random(7, 0.1), facet.random(8, 1.0)
    facet.turn(u, v)
    group = facet.group
    group.impulse[:] = np.random.default_rng(9).standard_normal(group.impulse.shape)
    power = float(np.vdot((facet.layer.impulses() + facet.layer.couples())[:-1], v))
    impulse, relative = group.impulse.copy(), facet.layer.points.relative(facet.with_ground(v))
    given = float(np.vdot(impulse, relative[group.indices] - facet.spin(v)))
    assert power == pytest.approx(given, rel=1e-12)


@pytest.mark.parametrize("name", ["segment", "triangle"])
def test_energy_gained_by_reading_jumps_anew_is_booked(name):
    """What a bond of C_N unlike C_T holds with F(q0) d0 beyond what it held is numerical, less."""
    facet = Facet(name, "nodal")
    u, still = facet.random(10, 1e-2), np.zeros_like(facet.both)
    facet.turn(u, still)
    facet.layer.begin_step(1e-3, 0.5)
    group, held = facet.group, 1e-4
    group.impulse[:], group.energy[:, 0] = 0.0, held
    stiffness = np.array([LAW.normal_stiffness, *[LAW.tangential_stiffness] * (facet.dim - 1)])
    k = len(facet.x)
    jump = np.einsum("pid,pd->pi", group.points.frame, (u[:k] - u[k:])[facet.group.indices])
    energy = 0.5 * group.points.area * (jump**2 @ stiffness)
    assert np.all(group.turning.by_spin)
    facet.layer.couples()
    booked = facet.layer.commit(np.zeros((2 * k + 1) * facet.dim)).numerical
    assert booked == pytest.approx(-np.sum(energy - held), rel=1e-12)
    assert energy.min() > 10.0 * held


@pytest.mark.parametrize("theta", [0.5, 0.7, 1.0])
@pytest.mark.parametrize("name, rule", RULES)
def test_what_forces_and_couples_work_is_what_is_booked(name, rule, theta):
    """(H r + couple) . v_theta is what the points lose: held, dissipated, numerical, all together.

    The velocities found are those that frames were turned with, and other ones.
    """
    step, held = 0.05, 0.3
    for seed in (12, 13):
        facet = Facet(name, rule)
        layer, group = facet.layer, facet.group
        u, start, end = facet.random(11, 0.05), facet.random(12, 0.3), facet.random(seed, 0.3)
        mean = theta * end + (1.0 - theta) * start
        layer.turn(layer.lip_motion(*map(facet.with_ground, (u, start, mean))), step, theta)
        layer.begin_step(step, theta)
        group.impulse[:] = np.random.default_rng(14).standard_normal(group.impulse.shape)
        group.energy[:, 0], before = held, held * len(group)
        given = np.vdot((layer.impulses() + layer.couples())[:-1], mean)
        work = layer.commit(facet.with_ground(end).ravel())
        assert abs(np.vdot(layer.couples()[:-1], mean)) > 1e-4
        booked = work.stored - before + sum(work[1:])
        assert given + booked == pytest.approx(0.0, abs=1e-12 * abs(before))


def test_rounding_hangs_on_no_frame_of_an_earlier_step():
    """A restarted run knows none: of a law of the normal, between bodies that are not alike."""
    facet = Facet("segment", "nodal", SignoriniCoulomb(0.0))
    layer, still = facet.layer, np.zeros_like(facet.both)
    layer.update_inverse(BodyInverse.from_uniform(np.tile(np.diag([1.0, 4.0]), (4, 1, 1)), 2))
    velocity = np.ones(layer.inverse.num_slots * 2)
    at_start = layer.rounding(velocity)
    facet.turn(facet.both @ rotation(2).T - facet.both, still)
    layer.begin_step(1e-3, 0.5)
    found = layer.rounding(velocity)
    layer.update_inverse(layer.bulk_inverse)
    assert layer.rounding(velocity) == found != at_start


@pytest.mark.parametrize("name", ["segment", "triangle"])
def test_impulses_of_rounding_press_no_lips(name):
    """Beside the speed of both lips, which do not part."""
    facet = Facet(name, "nodal", CohesiveZone(1e3, 0.5, 8.0, friction=0.3))
    open_lips = np.zeros_like(facet.both)
    open_lips[: len(facet.x)] = 0.01 * normal_of(facet.x)
    group, together = facet.group, np.full_like(facet.both, 3.0)
    for speed, pressed in ((1e-15, False), (1e-3, True)):
        group.committed_impulse[:, 0] = speed / group.compliance[:, 0]
        facet.turn(open_lips, together, 1e-3)
        assert np.all(group.turning.by_spin == pressed)


def test_a_facet_that_flips_is_named():
    """Lips turned by more than 90 degrees within half a step have no frame."""
    facet = Facet("segment", "nodal")
    still = np.zeros_like(facet.both)
    velocity = -2.0 * (facet.both - facet.x.mean(axis=0))  # through a point, and out again
    with pytest.raises(FacetFlippedError, match="point 0"):
        facet.turn(still, velocity, reach=1.0)


def test_a_law_that_does_not_tell_its_energy_is_refused():
    """Where frames turn, a law that stores energy has to have `stored`."""
    kernels = LAW.kernels(2)._replace(stored=None)
    lips = Facet("segment", "nodal").layer.points.lips
    with pytest.raises(ValueError, match=r"stores energy.*LawKernels\.stored"):
        TurningFrames.of(lips, kernels, np.zeros((2, 6)), np.zeros((2, 2)))


def test_points_that_are_taken_keep_their_lips():
    """A part of the points has the facets of that part."""
    points = replace(Facet("triangle", "nodal").layer.points)
    part = points.take(np.array([2, 0]))
    assert np.array_equal(part.lips.nodes, points.lips.nodes[[2, 0]])
    assert np.array_equal(part.lips.gradient, points.lips.gradient[[2, 0]])


@pytest.mark.parametrize("name, rule", RULES)
def test_derivatives_of_forces_and_couples(name, rule):
    """As displacements change, for impulses that do not; also of points whose lips have others."""
    for apart in (False, True):
        facet = Facet(name, rule)
        if apart:  # as points of a tie, which lie on no node of the facets that turn them
            facet.group.points.nodes[:] = facet.group.points.nodes[:, ::-1].copy()
            facet.layer.groups[0].couplings.start[:] = facet.group.points.nodes * facet.dim
        u, along, still = facet.random(31, 0.1), facet.random(32, 1.0), 0.0 * facet.both

        def given(x, facet=facet, still=still):
            facet.turn(x, still)
            r = np.random.default_rng(33).standard_normal(facet.group.impulse.shape)
            facet.group.impulse[:] = r
            return (facet.layer.impulses() + facet.layer.couples())[:-1]

        eps = 1e-6
        expected = (given(u + eps * along) - given(u - eps * along)) / (2.0 * eps)
        forces, group = given(u), facet.group
        slots, q = motion_of_lips(group, 0)
        moved = np.einsum("pym,pm->py", q, along[slots].reshape(len(group), -1))
        total, change = np.zeros_like(forces), np.zeros_like(forces)
        rows = np.einsum("piy,pi->py", rows_of_jumps(group), group.impulse)
        for to, values in (
            (total, rows),
            (change, np.einsum("pxy,py->px", curvature(group), moved)),
        ):
            at_nodes = np.einsum("pym,py->pm", q, values).reshape(*slots.shape, facet.dim)
            np.add.at(to, slots, at_nodes)
        assert np.abs(total - forces).max() < 1e-13 * np.abs(forces).max()
        assert np.abs(change - expected).max() < 1e-8 * np.abs(expected).max()
        assert (slots.shape[1] > 2 * len(facet.x)) == apart
