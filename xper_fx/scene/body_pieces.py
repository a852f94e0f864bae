# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshed bodies that laws between facing facets join."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from xper_fx.bodies.explode import Bodies


def pieces_of_bodies(bodies: Bodies, law_of_facet: np.ndarray) -> np.ndarray:
    """Meshed bodies that facing facets with a law join are one piece.

    Args:
        law_of_facet: number of the law of each facing facet, negative without one.

    Returns:
        Number of the piece of each body, shape (num_bodies,).
    """
    pairs = bodies.facets.bodies[law_of_facet >= 0].T
    graph = coo_array((np.ones(pairs.shape[1]), tuple(pairs)), shape=(bodies.num_bodies,) * 2)
    return connected_components(graph, directed=False)[1]
