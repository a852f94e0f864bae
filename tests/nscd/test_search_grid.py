# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pairs of boxes and joining of contacts, against brute force."""

import numpy as np
import pytest

from xper_fx.nscd.search import contact_pairs as contacts
from xper_fx.nscd.search import grid


def brute(low_a, high_a, low_b, high_b):
    meets = (low_a[:, None] <= high_b[None]) & (low_b[None] <= high_a[:, None])
    return np.argwhere(meets.all(axis=2))


def random_boxes(rng, count, dim, kind, offset):
    if kind == "clustered":
        centres = rng.normal(size=(max(count // 10, 1), dim))[rng.integers(0, count // 10, count)]
        middle = centres * 50.0 + rng.normal(size=(count, dim)) * 0.5
    else:
        middle = rng.uniform(0.0, 4.0 * count ** (1 / dim), (count, dim))
    if kind == "decades":
        half = 10.0 ** rng.uniform(-2.0, 1.0, (count, dim))
    elif kind == "equal":
        half = np.full((count, dim), 1.0)
        middle = np.round(middle)  # many boxes touch exactly
    else:
        half = rng.uniform(0.5, 1.5, (count, dim))
    return middle - half + offset, middle + half + offset


@pytest.mark.parametrize("kind", ["sparse", "clustered", "decades", "equal"])
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("offset", [0.0, -1e7])
def test_pairs_of_boxes_are_those_of_brute_force(dim, kind, offset):
    rng = np.random.default_rng(dim)
    for count in (20, 100, 700):
        low, high = random_boxes(rng, count, dim, kind, offset)
        expected = brute(low, high, low, high)
        expected = expected[expected[:, 0] < expected[:, 1]]
        pairs = grid.box_pairs(low, high)
        assert pairs.dtype == np.int32
        assert np.array_equal(pairs, expected)

        half = count // 3
        between = grid.box_pairs(low[:half], high[:half], low[half:], high[half:])
        assert np.array_equal(between, brute(low[:half], high[:half], low[half:], high[half:]))
    assert len(pairs) > 10


def test_labels_that_may_meet():
    rng = np.random.default_rng(0)
    low, high = random_boxes(rng, 400, 2, "decades", 0.0)
    label = rng.integers(0, 3, 400)
    allowed = np.array([[0, 1, 0], [1, 1, 0], [0, 0, 0]])
    expected = grid.box_pairs(low, high)
    expected = expected[allowed[label[expected[:, 0]], label[expected[:, 1]]] == 1]
    assert len(expected) > 100
    assert np.array_equal(grid.labelled_box_pairs(low, high, label, allowed), expected)


def test_few_boxes_have_the_pairs_that_many_have():
    """Boxes of labels, by themselves and beside as many far away."""
    rng = np.random.default_rng(4)
    low, high = random_boxes(rng, 24, 3, "clustered", 0.0)
    label = rng.integers(0, 2, 24)
    for allowed in (np.eye(2), 1 - np.eye(2), np.ones((2, 2))):
        few = grid.labelled_box_pairs(low, high, label, allowed)
        far = [np.concatenate([corner, corner + 1e3]) for corner in (low, high)]
        many = grid.labelled_box_pairs(*far, np.tile(label, 2), allowed)
        assert len(few) > 10 and len(many) > grid._FEW
        assert np.array_equal(few, many[many[:, 1] < 24])


def test_boxes_without_extent_and_few_boxes():
    points = np.array([[0.0, 0.0], [1.0, 1.0], [0.0, 0.0], [1.0, 2.0]])
    assert grid.box_pairs(points, points).tolist() == [[0, 2]]
    same = np.zeros((3, 3))
    assert grid.box_pairs(same, same).tolist() == [[0, 1], [0, 2], [1, 2]]
    assert grid.box_pairs(points[:1], points[:1]).shape == (0, 2)
    assert grid.box_pairs(points[:0], points[:0], points, points).shape == (0, 2)


def test_one_large_box_among_many_small_ones():
    rng = np.random.default_rng(1)
    middle = rng.uniform(0.0, 100.0, (3000, 2))
    low = np.concatenate([[[0.0, -1.0]], middle - 0.01])
    high = np.concatenate([[[100.0, 0.5]], middle + 0.01])
    pairs = grid.box_pairs(low, high)
    on_large = pairs[pairs[:, 0] == 0, 1]
    assert np.array_equal(on_large, np.flatnonzero(low[1:, 1] <= 0.5) + 1)


@pytest.mark.parametrize(
    ("low", "high", "words"),
    [
        ([[0.0, 0.0], [1.0, np.inf]], [[1.0, 1.0], [2.0, np.inf]], "box 1"),
        ([[0.0, 0.0], [3.0, 0.0]], [[1.0, 1.0], [2.0, 1.0]], "box 1"),
        ([[0.0], [3.0]], [[1.0], [4.0]], "shape"),
    ],
)
def test_bad_boxes_are_refused(low, high, words):
    with pytest.raises(ValueError, match=words):
        grid.box_pairs(np.array(low), np.array(high))


def one_contact(key, body, k=1):
    part = contacts.empty(2, k)
    count = len(key)
    arrays = [np.zeros((count, *a.shape[1:]), a.dtype) for a in part]
    result = contacts.Contacts(*arrays)
    result.key[:] = key
    result.body[:] = body
    result.weights[:] = 1.0
    return result


def test_joined_contacts_are_sorted_and_wide_enough():
    a = one_contact([[5, 0], [5, 2]], [[0, 1], [0, 1]])
    b = one_contact([[1, 7], [5, 1]], [[2, 3], [4, 5]], k=3)
    joined = contacts.join([a, contacts.empty(2), b])
    assert joined.key.tolist() == [[1, 7], [5, 0], [5, 1], [5, 2]]
    assert joined.body.tolist() == [[2, 3], [0, 1], [4, 5], [0, 1]]
    assert joined.weights[:, 0].tolist() == [[1, 1, 1], [1, 0, 0], [1, 1, 1], [1, 0, 0]]
    assert len(joined) == 4 and joined.dim == 2
    assert len(contacts.join([contacts.empty(3)])) == 0


def test_two_contacts_of_one_key_are_refused():
    a = one_contact([[5, 0]], [[0, 1]])
    with pytest.raises(ValueError, match=r"\(5, 0\)"):
        contacts.join([a, a])
