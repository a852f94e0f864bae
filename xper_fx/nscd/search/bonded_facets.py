# SPDX-License-Identifier: LGPL-3.0-or-later
"""What bonds hold together: hidden facets, nodes that count as one, fragments.

A bond joins two facets of two bodies, node by node. As long as it stands the two facets are hidden
inside their *fragment*, the bodies that bonds connect. When it breaks they are *exposed*: other
bodies may touch them, while the lips still meet each other by the bond's own law. When it is
*released* as well the lips meet like any two facets. A bond that has broken at some of its points
leaves its facets *ajar*: a rigid body may touch their nodes, which would else fall through it where
their other facets face elsewhere.

Nodes that coincide and are joined by bonds not yet released count as one point of the surface, a
*weld*. A node and a facet that has its weld do not touch: that keeps lips apart from their bond's
contact, and neighbours around a vertex from each other.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from xper_fx.nscd.search.surface import Surface


class Bonds:
    """State of the bonds of a surface.

    Attributes:
        exposed, ajar: which facets are, shape (f,), bool; those that are exposed are ajar.
        released: which bonds are, shape (num_bonds,), bool.
        weld: smallest node of each node's weld, shape (num_nodes,), int32.
        fragment: smallest body of each body's fragment, shape (num_bodies,), int32.
        edges: what `joined_edges` gives for all facets, shape (f, 3), where bonds between others
            than the surface's bodies decide it; None where it is found here.

    Args:
        surface: its facets and bonds.
        released: bonds that never held, shape (num_bonds,), bool; None: all hold.
    """

    def __init__(self, surface: Surface, released: np.ndarray | None = None):
        self.surface, self.edges = surface, None
        count = len(surface.bond_nodes)
        self.released = np.zeros(count, bool) if released is None else np.array(released, bool)
        if self.released.shape != (count,):
            raise ValueError(
                f"released should be a mask over {count} bonds, got shape {self.released.shape}."
            )
        self.exposed = surface.bond < 0
        self.exposed[~self.exposed] = self.released[surface.bond[~self.exposed]]
        self.ajar = self.exposed.copy()
        self._by_bond = np.argsort(surface.bond, kind="stable")
        self._first = np.searchsorted(surface.bond[self._by_bond], np.arange(count + 1))
        self.weld = np.arange(surface.num_nodes, dtype=np.int32)
        self._join(np.flatnonzero(~self.released))
        last = max(surface.body.max(initial=-1), surface.bond_bodies.max(initial=-1))
        self.fragment = np.arange(last + 1, dtype=np.int32)
        self._find_fragments()

    def expose(self, bonds: np.ndarray) -> np.ndarray:
        """Free the facets of bonds that broke; their lips still meet by the bond.

        Args:
            bonds: numbers of bonds, shape (n,), int.

        Returns:
            Facets that were hidden until now, ascending.

        Raises:
            ValueError: numbers out of range.
        """
        facets = self._facets_of(self._checked(bonds))
        facets = np.sort(facets[~self.exposed[facets]])
        self.exposed[facets] = self.ajar[facets] = True
        return facets

    def leave_ajar(self, bonds: np.ndarray) -> None:
        """Let rigid bodies touch the nodes of facets whose bonds broke at some of their points.

        Args, Raises: as `expose`.
        """
        self.ajar[self._facets_of(self._checked(bonds))] = True

    def release(self, bonds: np.ndarray) -> np.ndarray:
        """Let the lips of bonds meet like any facets; exposes them too.

        Args, Returns, Raises: as `expose`.
        """
        bonds = self._checked(bonds)
        facets = self.expose(bonds)
        bonds = bonds[~self.released[bonds]]
        if len(bonds):
            self.released[bonds] = True
            nodes = self.surface.bond_nodes
            touched = np.zeros(self.surface.num_nodes, bool)
            touched[self.weld[nodes[bonds]]] = True
            self.weld[np.flatnonzero(touched[self.weld])] = -1
            loose = self.weld < 0
            self.weld[loose] = np.flatnonzero(loose)
            near = loose[nodes].any(axis=(1, 2)) & ~self.released
            self._join(np.flatnonzero(near))
            self._find_fragments()
        return facets

    def joined_edges(self, facets: np.ndarray) -> np.ndarray:
        """Which edges of facets (3D) are one: in a body, or across bonds none of which has broken.

        Lips of a broken bond have an edge each along its rim, though they are welded there.

        Args:
            facets: exposed ones, shape (n,), int.

        Returns:
            A number for each edge, from corner j to j + 1, shape (n, 3), int64: that of the lowest
            edge it is one with, smaller node times `num_nodes` plus larger node.
        """
        if self.edges is not None:
            return self.edges[facets]
        surface = self.surface
        own = _edges(surface.facets[facets], surface.num_nodes)
        near = np.zeros(surface.num_nodes, bool)
        near[self.weld[surface.facets[facets]]] = True
        hidden = np.flatnonzero(~self.exposed)
        bond = surface.bond[hidden]
        first = surface.body[hidden] == surface.bond_bodies[bond, 0]
        first &= near[self.weld[surface.facets[hidden]]].sum(axis=1) >= 2
        corner, both = surface.facets[hidden[first]], surface.bond_nodes[bond[first]]
        place = (corner[:, :, None] == both[:, :1]).argmax(axis=2)
        across = _edges(np.take_along_axis(both[:, 1], place, axis=1), surface.num_nodes)
        links = np.stack([_edges(corner, surface.num_nodes), across])
        edges, number = np.unique(np.concatenate([own.ravel(), links.ravel()]), return_inverse=True)
        ends = number.ravel()[own.size :].reshape(2, -1)
        joined = _smallest_connected(np.arange(len(edges)), ends)
        return edges[joined[number.ravel()[: own.size]]].reshape(own.shape)

    def _facets_of(self, bonds: np.ndarray) -> np.ndarray:
        """Facets that bonds hide."""
        return np.concatenate(
            [self._by_bond[self._first[b] : self._first[b + 1]] for b in bonds]
            or [np.empty(0, np.intp)]
        )

    def _checked(self, bonds: np.ndarray) -> np.ndarray:
        bonds = np.unique(np.asarray(bonds, dtype=np.int64))
        count = len(self.released)
        if len(bonds) and not 0 <= bonds[0] <= bonds[-1] < count:
            raise ValueError(f"Bonds {bonds[0]} to {bonds[-1]} were given; there are {count}.")
        return bonds

    def _join(self, bonds: np.ndarray) -> None:
        """Weld the nodes of bonds; what was welded to them stays so."""
        pairs = self.surface.bond_nodes[bonds].transpose(1, 0, 2).reshape(2, -1)
        nodes, ends = np.unique(self.weld[pairs], return_inverse=True)
        smallest = _smallest_connected(nodes, ends.reshape(2, -1))
        lookup = np.arange(self.surface.num_nodes, dtype=np.int32)
        lookup[nodes] = smallest
        self.weld = lookup[self.weld]

    def _find_fragments(self) -> None:
        bodies = np.arange(len(self.fragment))
        self.fragment = _smallest_connected(bodies, self.surface.bond_bodies[~self.released].T)


def _edges(facets: np.ndarray, num_nodes: int) -> np.ndarray:
    """Numbers of the edges of triangles by their nodes, shape (n, 3)."""
    a, b = facets.astype(np.int64), np.roll(facets, -1, axis=1).astype(np.int64)
    return np.minimum(a, b) * num_nodes + np.maximum(a, b)


def _smallest_connected(numbers: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Smallest of the ascending `numbers` connected to each; edges name their places, (2, e)."""
    count = len(numbers)
    graph = coo_array((np.ones(edges.shape[1], np.int8), tuple(edges)), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    _, first = np.unique(label, return_index=True)
    return numbers[first[label]].astype(np.int32)
