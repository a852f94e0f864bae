# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vertex by vertex, the answers of Gauss-Seidel over all points."""

from __future__ import annotations

import numpy as np
import pytest
from plates import crossed_plate
from scipy.spatial.transform import Rotation
from solving import solve

from xper_fx.cache import njit
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.laws import CohesiveZone, PerfectBond, SignoriniCoulomb
from xper_fx.nscd.points import InteractionPoints, frame_from_normal
from xper_fx.nscd.solvers import NonlinearGaussSeidel, SolveOptions, VertexBlocks, vertex_blocks

SIZE = 50e-6
STEP = 1e-10
SOUND = CohesiveZone(2e18, 0.5, 1e9, friction=0.05)
BROKEN = CohesiveZone(2e18, 0.5, 1e9, friction=0.3, initial_damage=1e-6)


def lumped(mass, fixed=None):
    """One block of w a node."""
    dim = mass.shape[1]
    w = np.zeros((len(mass), dim, dim))
    w[:, range(dim), range(dim)] = 1.0 / mass if fixed is None else np.where(fixed, 0.0, 1.0 / mass)
    return BodyInverse.from_uniform(w, dim)


def plate(n=4, fix=False):
    p = crossed_plate(n, SIZE)
    x = p.x.reshape(-1, 2)
    fixed = np.zeros(x.shape, bool)
    if fix:
        fixed[x[:, 0] < 1e-12] = True
        fixed[x[:, 0] > SIZE - 1e-12, 0] = True
    return p.points, x, lumped(p.mass.reshape(-1, 2), fixed), fixed


def corner_points_3d(seed=3, vertices=5):
    """Nodes that meet at points of space, six a vertex, linked in a ring with chords."""
    rng = np.random.default_rng(seed)
    pairs = [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (5, 0), (0, 3), (1, 4)]
    nodes = np.array([[(6 * k + a, 6 * k + b) for a, b in pairs] for k in range(vertices)])
    nodes = nodes.reshape(-1, 2, 1).astype(np.int32)
    normal = rng.normal(size=(len(nodes), 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    points = InteractionPoints(
        nodes, np.ones(nodes.shape), frame_from_normal(normal),
        rng.uniform(1e-12, 2e-12, len(nodes)), np.zeros(len(nodes)),
    )  # fmt: skip
    mass = rng.uniform(1e-14, 3e-14, 6 * vertices)
    return points, rng.normal(size=(6 * vertices, 3)), lumped(np.repeat(mass[:, None], 3, axis=1))


def interactions(points, inverse, laws, law_of_point, ordering):
    return Interactions(points, laws, law_of_point, inverse, ordering=ordering)


def run(points, inverse, laws, law_of_point, velocities, *, by_vertex, step=STEP, **options):
    """Steps from rest with the given free velocities; impulses, end velocities, damage."""
    scene = interactions(points, inverse, laws, law_of_point, "vertices" if by_vertex else "tiles")
    solver = VertexBlocks() if by_vertex else NonlinearGaussSeidel()
    history, reports = [], []
    for free in velocities:
        v = np.zeros((inverse.num_slots, inverse.dim))
        v[: inverse.num_nodes] = free
        v = v.ravel()
        scene.begin_step(step, 0.5)
        reports.append(solver.solve(scene, v, SolveOptions(**options)))
        scene.commit(v)
        history.append(
            (v.copy(), scene.gather("impulse"), scene.gather("damage"), scene.gather("status"))
        )
    return history, reports


def velocities(x, gradient, noise=0.0, steps=3, seed=0):
    rng = np.random.default_rng(seed)
    scale = np.abs(x @ np.asarray(gradient).T).max()
    return [
        x @ np.asarray(gradient).T + noise * scale * rng.normal(size=x.shape) for _ in range(steps)
    ]


# Velocity gradients are per second; bonds open by noise times the edge speed times h.
CASES = {
    "elastic": ([SOUND], [[1e5, 0], [0, 1e4]], 0.3, 1e-10),
    "softening": ([SOUND], [[4e7, 0], [0, 1e7]], 0.3, 2e-12),
    "contact": ([BROKEN], [[-1e5, 0], [0, -1e5]], 0.5, 1e-10),
    "sliding": ([BROKEN], [[0, 1e5], [0, -1e5]], 0.5, 1e-10),
    "mixed": (
        [SOUND, SignoriniCoulomb(0.0), PerfectBond()], [[1e5, 0], [5e4, -1e5]], 0.5, 1e-10,
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("fix", [False, True])
@pytest.mark.parametrize("newton_dofs", [0, 48])
def test_equals_gauss_seidel(monkeypatch, case, fix, newton_dofs):
    monkeypatch.setattr(vertex_blocks, "_NEWTON_DOFS", newton_dofs)
    laws, gradient, noise, step = CASES[case]
    points, x, inverse, fixed = plate(fix=fix)
    law_of_point = np.random.default_rng(5).integers(len(laws), size=len(points))
    free = [np.where(fixed, x @ np.transpose(gradient), v) for v in velocities(x, gradient, noise)]
    options = {"tolerance": 1e-11, "step": step, "num_threads": 1}
    expected, reports = run(
        points, inverse, laws, law_of_point, free, by_vertex=False, max_sweeps=100_000, **options
    )
    found, found_reports = run(
        points, inverse, laws, law_of_point, free, by_vertex=True, max_sweeps=20_000, **options
    )
    assert all(r.converged for r in reports + found_reports)
    for (v0, r0, damage0, _), (v1, r1, damage1, _) in zip(expected, found, strict=True):
        assert np.abs(v1 - v0).max() <= 1e-7 * np.abs(v0).max()
        assert np.abs(damage1 - damage0).max() <= 1e-6
        if case in ("elastic", "softening") and not fix:  # else impulses are not unique
            assert np.abs(r1 - r0).max() <= 1e-7 * np.abs(r0).max()
    # the case is what its name says
    damage, status = found[-1][2], found[-1][3]
    if case == "elastic":
        assert np.all(damage == 1.0) and np.any(status == 0)
    if case == "softening":
        assert np.any((damage > 0.0) & (damage < 1.0)) and np.any(damage == 1.0)
    if case in ("contact", "sliding"):
        assert np.any(status == 0) and np.any(status == 1) and np.any(status == 2)
    if case == "mixed":
        assert {0, 1} <= {int(s) for s in status}


@pytest.mark.parametrize("laws", [[SOUND], [SOUND, SignoriniCoulomb(0.5)]])
def test_three_dimensions(laws):
    points, x, inverse = corner_points_3d()
    law_of_point = np.arange(len(points)) % len(laws)
    free = velocities(x, np.diag([1.0, -2.0, 0.5]), 0.5)
    options = {"tolerance": 1e-11, "step": 1e-10, "num_threads": 1}
    expected, _ = run(points, inverse, laws, law_of_point, free, by_vertex=False, **options)
    found, reports = run(points, inverse, laws, law_of_point, free, by_vertex=True, **options)
    assert all(r.converged for r in reports)
    for (v0, *_), (v1, *_) in zip(expected, found, strict=True):
        assert np.abs(v1 - v0).max() <= 1e-7 * np.abs(v0).max()


def test_one_product_brings_the_elastic_answer():
    """The kept inverse: once it is known, a step takes two visits, whatever the stiffness."""
    points, x, inverse, _ = plate()
    zero = np.zeros(len(points), int)
    stiff = [CohesiveZone(2e21, 0.5, 1e9)]
    centre = np.repeat(x.reshape(-1, 3, 2).mean(axis=1), 3, axis=0)
    free = [1e3 * (1.0 + 0.2 * np.sin(k)) * centre for k in range(12)]  # all bonds open
    history, reports = run(
        points, inverse, stiff, zero, free, by_vertex=True, step=1e-11, tolerance=1e-6
    )
    assert all(r.converged for r in reports)
    impulses = np.array([np.linalg.norm(r, axis=1) for _, r, *_ in history])
    assert np.all(impulses > 0.0) and np.all(np.ptp(impulses, axis=0) > 0.0)
    assert max(r.sweeps for r in reports[2:]) <= 3


@pytest.mark.parametrize("dim", [2, 3])
def test_the_inverse_turns_with_its_vertex(dim):
    """K_i K_p^T F_p F_i^T for frames of the start and of now, its first row alone in 2D."""
    if dim == 2:
        angles = np.random.default_rng(1).uniform(0.0, 6.0, (2, 6))
        start, now = np.stack([np.cos(angles), np.sin(angles)], axis=-1)[:, :, None]
        whole = [np.stack([f[:, 0], f[:, 0] @ [[0, 1], [-1, 0]]], axis=1) for f in (start, now)]
    else:
        start, now = whole = Rotation.random(12, random_state=4).as_matrix().reshape(2, 6, 3, 3)
    tilt = np.zeros_like(start)
    _, whole_turn, set_tilt = vertex_blocks._turn_kernels(dim)

    @njit
    def tilt_all(start, now, tilt):
        turn = whole_turn(start, 0, now, 0)
        for i in range(len(start)):
            set_tilt(tilt, i, start, i, now, i, turn)

    tilt_all(start, now, tilt)
    K, F = whole
    for i in range(len(start)):
        expected = K[i] @ K[0].T @ F[0] @ F[i].T
        np.testing.assert_allclose(tilt[i], expected[: len(tilt[i])], atol=1e-14)


def test_one_thread_and_two_agree_bitwise():
    laws, gradient, noise, step = CASES["softening"]
    points, x, inverse, _ = plate(8)
    law_of_point = np.random.default_rng(5).integers(len(laws), size=len(points))
    free = velocities(x, gradient, noise)
    one, two = (
        run(points, inverse, laws, law_of_point, free, by_vertex=True, step=step, num_threads=n)[0]
        for n in (1, 2)
    )
    for a, b in zip(one, two, strict=True):
        for left, right in zip(a, b, strict=True):
            assert np.array_equal(left, right)


def test_points_against_the_ground_stay_apart():
    """The ground couples nothing: two bodies resting on it are two vertices."""
    nodes = np.array([[[0], [2]], [[1], [2]]], np.int32)
    points = InteractionPoints(
        nodes, np.ones(nodes.shape), frame_from_normal(np.tile([0.0, 1.0], (2, 1))),
        np.ones(2), np.zeros(2),
    )  # fmt: skip
    inverse = lumped(np.ones((2, 2)))
    scene = interactions(points, inverse, [SignoriniCoulomb(0.0)], np.zeros(2, int), "vertices")
    assert len(scene.groups[0].ordering.tile_offsets) == 3
    velocity = np.array([1.0, -1.0, 0.0, 2.0, 0.0, 0.0])
    scene.begin_step(1.0, 0.5)
    assert solve(scene, velocity, VertexBlocks).converged
    assert np.allclose(velocity, [1.0, 0.0, 0.0, 2.0, 0.0, 0.0])


def test_refuses_what_is_not_lumped_and_nodal():
    p = crossed_plate(2, SIZE)
    zero = np.zeros(len(p.points), int)
    with pytest.raises(ValueError, match="lumped mass"):
        interactions(p.points, p.inverse(STEP, 0.5), [SOUND], zero, "vertices")
    points, _, inverse, _ = plate(2)
    twice = InteractionPoints(
        np.repeat(points.nodes, 2, axis=2), 0.5 * np.repeat(points.weights, 2, axis=2),
        points.frame, points.area, points.gap,
    )  # fmt: skip
    with pytest.raises(ValueError, match="nodal points"):
        interactions(twice, inverse, [SOUND], zero, "vertices")
    with pytest.raises(ValueError, match='"tiles" or "vertices"'):
        interactions(points, inverse, [SOUND], zero, "blocks")
    tiles = interactions(points, inverse, [SOUND], zero, "tiles")
    tiles.begin_step(STEP, 0.5)
    with pytest.raises(ValueError, match='ordering="vertices"'):
        solve(tiles, np.zeros(inverse.num_slots * 2), VertexBlocks)


@pytest.mark.parametrize("twins", [2, 3, 8])
def test_velocities_are_those_of_the_impulses(twins):
    """Points that share both nodes are redundant: their matrix is all but singular, and corrections
    of 1e10 times the answer come and go."""
    nodes = np.tile(np.array([0, 1], np.int32).reshape(1, 2, 1), (twins, 1, 1))
    frame = frame_from_normal(np.tile([0.0, 1.0], (twins, 1)))
    points = InteractionPoints(
        nodes, np.ones(nodes.shape), frame, np.full(twins, 0.5), np.zeros(twins)
    )
    mass, rng = np.full((2, 2), 1.0 / 12.0), np.random.default_rng(0)
    closing = np.array([[0.1, -0.5], [0.0, 0.5]])
    free = [closing + rng.normal(size=(2, 2)) for _ in range(300)]
    law = CohesiveZone(1e5, 0.05, 20.0, friction=0.3, initial_damage=1e-300)
    history, reports = run(
        points, lumped(mass), [law], np.zeros(twins, int), free,
        by_vertex=True, step=1e-3, tolerance=1e-10,
    )  # fmt: skip
    assert all(report.converged for report in reports)
    off, pushed = 0.0, 0
    for v0, (v, impulse, _, _) in zip(free, history, strict=True):
        moved = np.einsum("pi,pij->j", impulse, frame)
        pushed += impulse[:, 0].sum() > 0.0
        off = max(off, np.abs(v[:4].reshape(2, 2) - v0 - np.array([moved, -moved]) / mass).max())
    assert pushed > 50 and off < 1e-12


@pytest.mark.parametrize("dim", [2, 3])
def test_redundant_bonds_of_turning_cells_at_a_held_face(dim):
    """Cells joined without compliance move as one body, those too whose nodes are held in part.

    The bonds around a vertex are a closed ring, whose impulses are not unique: solved in axes that
    turn, where w has directions of space, they grew to ten thousand times the others and burst.
    """
    from scenes import BOTTOM, TOP, box_bodies, field, nodes

    from xper_fx.forms.loads import PrescribedVelocity
    from xper_fx.materials import NeoHookean
    from xper_fx.scene import Scene
    from xper_fx.simulation.simulation import Simulation

    up, kind = dim - 1, "crossed" if dim == 2 else "tetrahedron"
    sides = (BOTTOM, TOP) if dim == 2 else (5, 6)

    loads = [PrescribedVelocity(sides[0], up, 0.0), PrescribedVelocity(sides[1], up, -0.5)]

    def pressed(label, step=None):
        scene = Scene(
            box_bodies((1,) * dim, (2,) * dim, kind, label),
            {1: NeoHookean(100.0, 0.3, 1.0)},
            default_interaction=PerfectBond(),
            loads=loads,
            initial_velocity=lambda x: np.stack([0.0 * x[0]] * up + [-0.5 * x[up]]),
        )
        simulation = Simulation(scene, step, scheme="explicit", tolerance=1e-10, num_threads=1)
        *_, record = simulation.steps(0.4)
        return simulation, record.energies

    cells, energies = pressed(None)
    whole, _ = pressed(0, cells.step_size)
    place = dict(zip(map(tuple, nodes(whole).round(9)), field(whole), strict=True))
    expected = np.array([place[tuple(x)] for x in nodes(cells).round(9)])
    np.testing.assert_allclose(field(cells), expected, atol=1e-8)
    assert abs(energies["dissipated_numerical"]) < 1e-8 * energies["elastic"]
