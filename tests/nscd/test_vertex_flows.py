# SPDX-License-Identifier: LGPL-3.0-or-later
"""What sound bonds of a vertex transmit: flows on the graph of its corners."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from xper_fx.cache import njit
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.laws import RigidCohesiveZone
from xper_fx.nscd.points import InteractionPoints, frame_from_normal
from xper_fx.nscd.splitting.holding import flow_kernel
from xper_fx.nscd.splitting.vertex_graphs import vertex_graphs
from xper_fx.nscd.splitting.vertex_kernels import vertex_work
from xper_fx.nscd.splitting.whole_vertices import whole_kernel

# A ring of six corners with a chord, and each bond's weakest force.
RING = [(1, 0), (1, 2), (2, 3), (4, 3), (4, 5), (0, 5), (0, 3)]
LEAST = np.array([1.0, 2.0, 0.7, 1.5, 1.1, 0.9, 1.3])


def incidence(bonds, corners):
    """B with s = B p: what bonds give the corners."""
    b = np.zeros((corners, len(bonds)))
    for q, (c, a) in enumerate(bonds):
        b[c, q] += 1.0
        b[a, q] -= 1.0
    return b


def least_flow(bonds, source):
    """Flow of least weighted square, by a pseudo-inverse."""
    b = incidence(bonds, len(source)) * LEAST[: len(bonds)]
    return LEAST[: len(bonds), None] * (np.linalg.pinv(b) @ source)


@cache
def kernel(dim):
    """The kernel, for Python."""
    flow = flow_kernel(dim)

    @njit
    def call(a, k, bonds, sides, least, fused, driven, cluster, pinned, source, out):
        flow(a, k, 0, bonds, sides, least, fused, driven, cluster, pinned, source, out)

    return call


def solve(bonds, source, driven=None):
    """The same by the kernel; driven corners take what is left."""
    k, dim = source.shape
    fused = np.ones(len(bonds), bool)
    driven = np.zeros((k, dim), bool) if driven is None else driven
    out = np.zeros((len(bonds), dim))
    kernel(dim)(
        np.zeros((k, k)), k, len(bonds), np.array(bonds, np.int16), LEAST, fused, driven,
        np.zeros(k, np.int64), np.zeros(k, bool), source.copy(), out,
    )  # fmt: skip
    return out


@pytest.mark.parametrize("dim", [2, 3])
def test_the_flow_is_that_of_least_squares(dim):
    rng = np.random.default_rng(3)
    source = rng.normal(size=(6, dim))
    source -= source.mean(axis=0)
    found = solve(RING, source)
    np.testing.assert_allclose(incidence(RING, 6) @ found, source, atol=1e-13)
    np.testing.assert_allclose(found, least_flow(RING, source), atol=1e-12)


def test_a_driven_corner_takes_what_is_left_in_its_component():
    source = np.arange(12.0).reshape(6, 2) - 5.0
    source[:, 1] -= source[:, 1].mean()
    driven = np.zeros((6, 2), bool)
    driven[2, 0] = True
    given = incidence(RING, 6) @ solve(RING, source, driven)
    free = np.arange(6) != 2
    np.testing.assert_allclose(given[free, 0], source[free, 0], atol=1e-12)
    assert given[2, 0] == pytest.approx(-source[free, 0].sum())
    np.testing.assert_allclose(given[:, 1], source[:, 1], atol=1e-12)


def star(strength, bonds=RING, least=LEAST):
    """Graphs, work space and laws of a vertex of the ring's six corners, of unit masses."""
    nodes = np.array(bonds, np.int32)[:, :, None]
    angle = np.arange(len(bonds)) * 0.8
    points = InteractionPoints(
        nodes, np.ones(nodes.shape), frame_from_normal(np.stack([np.cos(angle), np.sin(angle)], 1)),
        least.copy(), np.zeros(len(bonds)),
    )  # fmt: skip
    inverse = BodyInverse.of_nodes(np.ones((6, 2)), 2)
    zero = np.zeros(len(bonds), int)
    graphs = vertex_graphs(points, zero, zero, np.full(len(bonds), strength), inverse)
    law = RigidCohesiveZone(strength, 1.0)
    return graphs, law


def moved(strength, velocity, bonds=RING, least=LEAST):
    """Velocities of the corners after a unit step, and whether the vertex holds."""
    graphs, law = star(strength, bonds, least)
    v = np.append(velocity.ravel(), np.zeros(2))
    rows = np.zeros(len(bonds), np.int32)
    failed = whole_kernel((law.kernels(2),), 2)(
        v, np.zeros((7, 2)), 1.0, 6, graphs, vertex_work(graphs, 2), np.zeros(1, np.int32),
        np.ones(1, bool), rows, rows.astype(np.int8), (np.array([law.parameters()], float),),
        np.zeros(1, np.int32),
    )  # fmt: skip
    return v[:12].reshape(6, 2), failed == 0


def test_a_vertex_holds_up_to_what_its_least_flow_asks():
    """Corners of unit mass move with their mean where no bond is asked for more than it bears."""
    velocity = np.random.default_rng(8).normal(size=(6, 2))
    mean = velocity.mean(axis=0)
    flow = least_flow(RING, mean - velocity)
    most = (np.linalg.norm(flow, axis=1) / LEAST).max()
    v, holds = moved(1.001 * most, velocity)
    assert holds
    np.testing.assert_allclose(v, np.tile(mean, (6, 1)), rtol=1e-14)
    v, holds = moved(0.999 * most, velocity)
    assert not holds
    assert np.array_equal(v, velocity)


def test_a_ring_bears_twice_what_a_chain_does():
    """Three corners pull one way, three the other: what is looked at first is then sharp."""
    velocity = np.repeat([[-1.0, 0.0], [1.0, 0.0]], 3, axis=0)
    for bonds, most, share in ((RING[:6], 1.5, 4.0), (RING[:5], 3.0, 2.0), (RING, 1.2, 2.0)):
        least = np.ones(len(bonds))
        graphs, _ = star(2.0, bonds, least)
        assert graphs.easy[0] == pytest.approx(2.0 * share / np.sqrt(6.0), rel=1e-15)
        assert moved(1.001 * most, velocity, bonds, least)[1]
        assert not moved(0.999 * most, velocity, bonds, least)[1]


def test_rings_close_and_trees_reach_all():
    graphs, _ = star(1.0)
    assert sorted(graphs.tree[:, 0]) == [0, 1, 2, 3, 4, 5]
    assert graphs.tree[-1, 0] == 0
    assert len(graphs.ring_ends) == len(RING) - 5
    b = incidence([tuple(side) for side in graphs.sides], 6)
    start = 0
    for end in graphs.ring_ends:
        around = np.zeros(len(RING))
        around[graphs.ring[start:end, 0]] = graphs.ring[start:end, 1]
        assert np.count_nonzero(around) > 2
        np.testing.assert_array_equal(b @ around, 0.0)
        start = end
