# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nodes and supports of tagged facets, found once a tag."""

from __future__ import annotations

import numpy as np
from dolfinx import fem

from xper_fx.bodies.explode import Bodies
from xper_fx.bulk.bulk import Bulk


class TaggedFacets:
    """What is read of this rank's facets with a tag.

    Args:
        bodies: of this rank.
        bulk: of them.
    """

    def __init__(self, bodies: Bodies | None, bulk: Bulk):
        self._bodies, self._bulk = bodies, bulk
        self._nodes: dict[int, np.ndarray] = {}
        self._supports: dict[int, tuple[np.ndarray, np.ndarray]] = {}

    def nodes(self, tag: int) -> np.ndarray:
        """Nodes, shape (n,)."""
        if tag not in self._nodes:
            dim, facets = self._bodies.mesh.topology.dim - 1, self._bodies.facet_tags.find(tag)
            self._nodes[tag] = fem.locate_dofs_topological(self._bulk.forms.V, dim, facets)
        return self._nodes[tag]

    def supports(self, tag: int) -> tuple[np.ndarray, np.ndarray]:
        """Places among the prescribed dofs, and the components that these are, shape (n,) both."""
        if tag not in self._supports:
            dim, prescribed = self._bulk.dim, self._bulk.layout.prescribed_dofs
            place = np.flatnonzero(np.isin(prescribed // dim, self.nodes(tag)))
            self._supports[tag] = place, prescribed[place] % dim
        return self._supports[tag]
