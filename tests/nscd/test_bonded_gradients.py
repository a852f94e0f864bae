# SPDX-License-Identifier: LGPL-3.0-or-later
"""The solver of perfect bonds alone, against dense algebra."""

import numpy as np
import pytest
from heaps import Heap, grains
from solving import solve

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.laws import PerfectBond, SignoriniCoulomb
from xper_fx.nscd.points import InteractionPoints, frame_from_normal
from xper_fx.nscd.solvers import Automatic, BondedGradients, SolveOptions

STEP = 0.1
GROUND = 16
# Four bodies of four nodes that meet at a cross point (nodes 0, 4, 8, 12) and along their sides:
# pairs of nodes, some tied twice, in rings with a tie too many; the last is held by the ground.
PAIRS = [
    (0, 4), (0, 4), (1, 5), (4, 8), (6, 9), (6, 9), (8, 12), (10, 13), (12, 0), (14, 2), (14, 2),
    (15, GROUND),
]  # fmt: skip


def blocks_of(dim, sizes=(4, 4, 4, 4), stiff=1.0):
    """Blocks of w whose softest motions are much softer than the rest, as in long steps."""
    random = np.random.default_rng(3)
    blocks = []
    for number, nodes in enumerate(sizes):
        n = nodes * dim
        basis, _ = np.linalg.qr(random.standard_normal((n, n)))
        values = random.uniform(1.0, 4.0, n)
        values[: dim * (dim + 1) // 2] = 1e4
        blocks.append((basis * values) @ basis.T * (stiff if number == 1 else 1.0))
    blocks[3][: dim - 1], blocks[3][:, : dim - 1] = 0.0, 0.0  # prescribed
    return blocks


def with_idle_nodes(block, count, dim):
    """A block of w with as many nodes more, which move with the others and beside them."""
    moved = np.random.default_rng(5).standard_normal((count * dim, len(block)))
    moved = np.concatenate([np.eye(len(block)), moved])
    return moved @ block @ moved.T + np.diag(np.arange(len(moved)) >= len(block))


def bonded(dim, law=None, idle=0, **options):
    """The four bodies, their dense W and H^T in local frames; nothing acts on idle nodes."""
    blocks = [with_idle_nodes(block, idle, dim) for block in blocks_of(dim, **options)]
    inverse = BodyInverse.from_blocks(blocks, dim)
    count = len(PAIRS)
    random = np.random.default_rng(7)
    normal = random.standard_normal((count, dim))
    frame = frame_from_normal(normal / np.linalg.norm(normal, axis=1, keepdims=True))
    nodes = np.array(PAIRS, np.int32)[:, :, None]
    nodes += idle * (nodes // 4)
    gap = np.zeros(count)
    points = InteractionPoints(nodes, np.ones((count, 2, 1)), frame, np.ones(count), gap)
    interactions = Interactions(points, [law or PerfectBond()], np.zeros(count, int), inverse)
    interactions.begin_step(STEP, 0.5)
    size = inverse.num_slots * dim
    w = np.zeros((size, size))
    for block, first in zip(blocks, inverse.node_offsets * dim, strict=False):
        w[first : first + len(block), first : first + len(block)] = block
    units = np.eye(size).reshape(size, -1, dim)
    jumps = np.stack([points.relative(unit).ravel() for unit in units], axis=1)
    return interactions, w, jumps


@pytest.mark.parametrize("coarse_space", (True, False))
@pytest.mark.parametrize("stiff", (1.0, 1e-4))
@pytest.mark.parametrize("dim", (2, 3))
def test_velocities_are_those_of_dense_algebra(dim, stiff, coarse_space):
    """W is singular; the velocities are not, no bond opens, and impulses explain them."""
    interactions, w, jumps = bonded(dim, stiff=stiff)
    free = np.random.default_rng(1).standard_normal(len(w))
    free[-dim:] = 0.0  # the ground
    velocity = free.copy()
    report = BondedGradients(coarse_space=coarse_space).solve(
        interactions, velocity, SolveOptions(tolerance=1e-12)
    )
    assert report.converged and report.solver == "subdomains"
    impulse = np.linalg.lstsq(jumps @ w @ jumps.T, -jumps @ free, rcond=1e-13)[0]
    np.testing.assert_allclose(velocity, free + w @ jumps.T @ impulse, atol=1e-9)
    assert np.abs(jumps @ velocity).max() < 1e-9
    again = free.copy()
    interactions.add_velocity(again)
    np.testing.assert_allclose(again, velocity, atol=1e-9)
    # from the solution there is nothing left to do
    assert solve(interactions, free.copy(), BondedGradients, tolerance=1e-9).sweeps == 1


def test_jumps_left_by_an_earlier_step_are_taken_back():
    interactions, w, jumps = bonded(2)
    opened = jumps @ np.random.default_rng(2).standard_normal(len(w))
    interactions.groups[0].jump[:] = opened.reshape(-1, 2)[interactions.groups[0].indices]
    interactions.begin_step(STEP, 0.5)
    velocity = np.zeros(len(w))
    report = solve(interactions, velocity, BondedGradients, tolerance=1e-12)
    free = np.flatnonzero(np.diag(w) > 0.0)
    reachable = jumps[:, free] @ np.linalg.lstsq(jumps[:, free], -opened / STEP, rcond=None)[0]
    assert report.converged
    np.testing.assert_allclose(jumps @ velocity, reachable, atol=1e-8)


def test_few_iterations_where_motions_are_soft():
    """The coarse space takes what is far softer than the rest out of the iterations."""
    counts = []
    for coarse_space in (True, False):
        interactions, w, _ = bonded(3)
        velocity = np.random.default_rng(1).standard_normal(len(w))
        velocity[-3:] = 0.0
        solver = BondedGradients(coarse_space=coarse_space)
        report = solver.solve(interactions, velocity, SolveOptions(tolerance=1e-6))
        counts.append(report.sweeps)
    assert counts[0] < counts[1]


@pytest.mark.parametrize("dim", (2, 3))
def test_nodes_that_nothing_acts_on_cost_no_iterations(dim):
    """As where contacts are searched: what is seen of a body are the nodes of its points."""
    found = []
    free = np.random.default_rng(1).standard_normal((GROUND, dim))
    for idle in (0, 3):
        interactions, w, jumps = bonded(dim, idle=idle)
        velocity = np.zeros((len(w) // dim, dim))
        acted = np.arange(GROUND) + idle * (np.arange(GROUND) // 4)
        velocity[acted] = free
        report = solve(interactions, velocity.reshape(-1), BondedGradients, tolerance=1e-10)
        assert np.abs(jumps @ velocity.reshape(-1)).max() < 1e-8
        found.append((report.sweeps, report.reason, velocity[acted]))
    (few, unknowns, one), (many, more, other) = found
    assert many == few and more == unknowns
    np.testing.assert_allclose(other, one, atol=1e-8)


def test_iterations_are_bounded_and_told():
    interactions, w, _ = bonded(2)
    velocity = np.random.default_rng(1).standard_normal(len(w))
    velocity[-2:] = 0.0
    report = BondedGradients(coarse_space=False).solve(
        interactions, velocity, SolveOptions(tolerance=1e-12, max_sweeps=1)
    )
    assert not report.converged and report.sweeps == 1 and report.residual > 1e-12
    assert "1 iterations, 0 coarse unknowns" in report.reason


def test_nothing_to_do_takes_one_sweep():
    interactions, w, _ = bonded(2)
    report = solve(interactions, np.zeros(len(w)), BondedGradients, tolerance=1e-12)
    assert report.converged and report.residual == 0.0


def test_contacts_that_a_search_has_found_are_refused():
    heap = Heap(grains(2, 2, least=1.0, pitch=2.0))
    heap.search()
    assert heap.num_contacts and not len(heap.layer)
    with pytest.raises(ValueError, match="needs PerfectBond at every point"):
        heap.solve(BondedGradients)


def test_other_laws_are_refused_and_auto_leaves_them_alone():
    interactions, w, _ = bonded(2, SignoriniCoulomb(0.3))
    velocity = np.random.default_rng(1).standard_normal(len(w))
    velocity[-2:] = 0.0
    with pytest.raises(ValueError, match="needs PerfectBond at every point"):
        solve(interactions, velocity.copy(), BondedGradients)
    assert "subdomains" not in solve(interactions, velocity, Automatic, tolerance=1e-6).reason
