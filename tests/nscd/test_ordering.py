# SPDX-License-Identifier: LGPL-3.0-or-later
"""Orders of visit: every point once, and threads that never meet."""

from __future__ import annotations

import numpy as np
import pytest
from plates import crossed_plate

from xper_fx.nscd.ordering import bodies_of_tiles, order_points


def plate_blocks(n):
    blocks = crossed_plate(n, 1e-6).points.nodes[:, :, 0] // 3
    return blocks, 4 * n * n + 1


def random_blocks(seed, bodies, count):
    rng = np.random.default_rng(seed)
    first = rng.integers(0, bodies, count)
    second = (first + rng.integers(1, bodies, count)) % bodies
    second[rng.random(count) < 0.2] = bodies  # the ground
    swap = rng.random(count) < 0.5
    return np.where(swap[:, None], np.stack([second, first], 1), np.stack([first, second], 1)), (
        bodies + 1
    )


CASES = {
    "one point": (np.array([[0, 1]]), 2),
    "plate": plate_blocks(20),
    "small plate": plate_blocks(2),
    "random": random_blocks(0, 300, 3000),
    "crowded": random_blocks(1, 2000, 20000),
    "two bodies": (np.tile([[0, 1], [1, 0]], (300, 1)), 3),
    # more neighbours than there are colours, and a body that all others touch
    "star": (np.stack([np.full(900, 0), np.arange(1, 901)], axis=1), 902),
    "all on the ground": (np.stack([np.arange(700), np.full(700, 700)], axis=1), 701),
}


@pytest.mark.parametrize("name", CASES)
def test_every_point_once_and_no_two_tiles_of_a_colour_share_a_body(name):
    blocks, num_blocks = CASES[name]
    order, tiles, colors = order_points(blocks, num_blocks)
    np.testing.assert_array_equal(np.sort(order), np.arange(len(blocks)))
    assert tiles[0] == colors[0] == 0
    assert tiles[-1] == len(blocks) and colors[-1] == len(tiles) - 1
    assert np.all(np.diff(tiles) > 0) and np.all(np.diff(colors) > 0)
    for first, last in zip(colors[:-1], colors[1:], strict=True):
        owner = {}
        for tile in range(first, last):
            bodies = np.unique(blocks[order[tiles[tile] : tiles[tile + 1]]])
            for body in bodies[bodies != num_blocks - 1]:
                assert owner.setdefault(body, tile) == tile


def test_the_ground_does_not_keep_tiles_apart():
    blocks, num_blocks = CASES["all on the ground"]
    order = order_points(blocks, num_blocks)
    assert len(order.tile_offsets) > 2
    assert len(order.color_offsets) == 2


def test_a_plate_has_tiles_to_share():
    blocks, num_blocks = plate_blocks(40)
    order = order_points(blocks, num_blocks)
    sizes = np.diff(order.tile_offsets)
    assert 100 < sizes.mean() < 600
    assert len(order.color_offsets) - 1 <= 8


@pytest.mark.parametrize("name", ["plate", "random"])
def test_same_points_same_order(name):
    blocks, num_blocks = CASES[name]
    first, again = order_points(blocks, num_blocks), order_points(blocks.copy(), num_blocks)
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("count", [9, 2000])
def test_neighbours_of_a_chain_are_not_visited_one_after_the_other(count):
    """Every other point of a tile, then those between; a tile touches one body more."""
    blocks = np.stack([np.arange(count), np.arange(1, count + 1)], axis=1)
    ordering = order_points(blocks, count + 2)
    bodies = bodies_of_tiles(ordering, blocks, count + 2)
    assert (len(ordering.tile_offsets) == 2) == (count == 9)
    for tile, first in enumerate(ordering.tile_offsets[:-1]):
        found = ordering.order[first : ordering.tile_offsets[tile + 1]]
        points = np.arange(found.min(), found.max() + 1)
        even = points % 2 == 0
        assert found.tolist() == [*points[even], *points[~even]]
        touched = bodies.blocks[bodies.offsets[tile] : bodies.offsets[tile + 1]]
        assert np.sort(touched).tolist() == [*points, points[-1] + 1]


def test_no_points():
    order, tiles, colors = order_points(np.zeros((0, 2), int), 5)
    assert len(order) == 0
    assert tiles.tolist() == colors.tolist() == [0]
