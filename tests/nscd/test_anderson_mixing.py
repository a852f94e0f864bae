# SPDX-License-Identifier: LGPL-3.0-or-later
"""Anderson's mixing: GMRES of a linear map, and iterates that run away."""

import numpy as np

from xper_fx.nscd.algebra.anderson_mixing import AndersonMixing


def test_a_linear_map_is_solved_by_as_many_differences_as_it_has_unknowns():
    """G(r) = A r + c with a spectral radius of 2, at which plain iterations run away."""
    random = np.random.default_rng(0)
    turn, _ = np.linalg.qr(random.normal(size=(4, 4)))
    a, c = turn @ np.diag([2.0, -1.5, 0.5, 0.1]) @ turn.T, random.normal(size=4)
    mixing, r = AndersonMixing(4, 8, 1), np.zeros(4)
    for _ in range(6):
        image = a @ r + c
        mixing.mix(image - r, image, r)
    np.testing.assert_allclose(r, np.linalg.solve(np.eye(4) - a, c), rtol=1e-9)


def test_squares_beyond_the_range_of_floats_are_not_mixed():
    """The image is taken as it is, and what is known forgotten."""
    mixing, r = AndersonMixing(3, 4, 1), np.zeros(3)
    for size in (1.0, 1e100, 1e200):
        image = size * np.arange(1.0, 4.0)
        mixed = mixing.mix(image - r, image, r)
    assert not mixed and np.array_equal(r, image)
    assert not mixing.mix(np.ones(3), np.ones(3), r)  # the first one again
