# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts of the surfaces of meshed bodies: with each other, with themselves, with rigid bodies.

Both passes are made, nodes of a against facets of b and nodes of b against facets of a, and each
contact takes half of its node's area: where two flat sides overlap the areas of both passes add up
to the overlap. A node's area is what its own facets project onto the plane of contact. Edges that
cross (3D) come besides; so do corners of rigid bodies and discs and spheres that touch a facet
between its nodes, each with a node's share of the facet.

`candidate_lists.py` holds the pairs that are looked at.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from xper_fx.nscd.rigid.bodies import RigidBodies
from xper_fx.nscd.search.bonded_facets import Bonds
from xper_fx.nscd.search.candidate_lists import CandidateLists, bodies_of_nodes
from xper_fx.nscd.search.contact_pairs import Contacts, empty, join
from xper_fx.nscd.search.edge_edge import crossings
from xper_fx.nscd.search.facet_geometry import Faces, facet_normals
from xper_fx.nscd.search.node_facet import Points, Touching, point_facet, room_for
from xper_fx.nscd.search.node_rigid import nodes_on_rigid
from xper_fx.nscd.search.pair_list import PairList
from xper_fx.nscd.search.rigid_side import RigidSide, may_meet
from xper_fx.nscd.search.search_share import SearchShare
from xper_fx.nscd.search.surface import Surface

# What the first column of a key begins with. Those of rigid pairs are below 2^60.
_NODE_FACET, _EDGE_EDGE, _NODE_RIGID, _RIGID_FACET = range(1, 5)
_BITS = 30


class SurfaceSearch:
    """Search of contacts of meshed surfaces.

    Keys: the first column says what touches, (node, fragment), (edge, edge), (node, rigid body) or
    (rigid corner or centre, fragment); the second counts what one node touches of one fragment,
    0 nearly always. So a node keeps its key while it slides from facet to facet.

    Attributes:
        bonds: `Bonds`: what is exposed, released, welded, and the fragments.
        depth: of each facet (m), shape (f,): a point deeper behind it does not touch it.
        extent: of each facet (m), shape (f,): a point further from it does not touch it.
        lists: pairs that are looked at, `CandidateLists`.
        reach: largest gap of a contact (m).

    Args:
        surface: the facets and bonds.
        x: positions of the nodes at the start, shape (num_nodes, dim), m.
        reach: largest gap of a contact (m), positive.
        pairs: names of groups that may touch, (a, b) or (a, a), of surfaces and rigid bodies (two
            rigid ones are left to `RigidSearch`); None: all.
        released: bonds that never held, shape (num_bonds,), bool; None: all hold.
        self_contact: whether a body may touch itself.
        rigid: rigid bodies, also as another search of these groups and pairs has them, or None.
        depth: share of a facet's size, and of the thickness behind it, that is sought.
        share: of the ranks that divide the search; None where one makes all of it.
        typical_size: of a facet (m), the same on all ranks; None: the median.
        hollows: whether both sides of mild hollows hold what is in them (`node_facet.py`).

    Raises:
        ValueError: a group that there is not, two groups of one name, a reach that is not positive.
    """

    def __init__(
        self,
        surface: Surface,
        x: np.ndarray,
        reach: float,
        *,
        pairs: Sequence[tuple[str, str]] | None = None,
        released: np.ndarray | None = None,
        self_contact: bool = True,
        rigid: RigidBodies | RigidSide | None = None,
        depth: float = 0.25,
        share: SearchShare | None = None,
        typical_size: float | None = None,
        hollows: bool = False,
    ):
        if not (np.isfinite(reach) and reach > 0.0):
            raise ValueError(f"The reach (m) must be a finite positive number, got {reach!r}.")
        if not 0.0 < depth <= 1.0:
            raise ValueError(f"The depth is a share of a facet's size, in (0, 1], got {depth!r}.")
        self.surface = surface
        self.bonds = Bonds(surface, released)
        self.reach = float(reach)
        self._dim, self._hollows = surface.dim, hollows
        x = self.surface.checked(x)
        made = isinstance(rigid, RigidSide)
        self._rigid = rigid if made else RigidSide(rigid, surface, pairs)
        meets = may_meet(surface.groups, surface.groups, pairs)
        size = surface.size(x)
        self.depth = depth * np.minimum(size, surface.thickness)
        self.extent = np.hypot(self.reach, surface.around(self.depth))
        self.update_areas(x)

        count = surface.num_nodes
        flat = surface.facets.ravel()
        order = np.argsort(flat, kind="stable")
        self._own_start = np.searchsorted(flat[order], np.arange(count + 1)).astype(np.int32)
        self._own_facets = (order // self._dim).astype(np.int32)
        self._own_body = np.full(count, -2, np.int32)
        if not self_contact:
            self._own_body = bodies_of_nodes(surface)

        self._normal = np.zeros((len(surface), self._dim))
        self._no_radius = np.zeros(count)
        if typical_size is None:
            typical_size = float(np.median(size)) if len(surface) else 1.0
        self.lists = CandidateLists(
            surface, self.bonds, self._rigid, meets, self.extent, self.reach, self_contact,
            typical_size, share,
        )  # fmt: skip

    @property
    def nbytes(self) -> int:
        """Memory of the lists, in bytes."""
        return self.lists.nbytes

    def update_areas(self, x: np.ndarray) -> None:
        """Take the nodes' areas from positions x, shape (num_nodes, dim); at first the start's."""
        self._share = self.surface.measure(x) / self._dim

    def expose(self, bonds: np.ndarray) -> None:
        """Free the facets of bonds that broke: others may touch them, the lips not each other.

        Args:
            bonds: numbers of bonds, shape (n,), int.

        Raises:
            ValueError: numbers out of range.
        """
        self.lists.add(self.bonds.expose(bonds))

    def leave_ajar(self, bonds: np.ndarray) -> None:
        """Let rigid bodies touch the nodes of facets whose bonds broke at some of their points.

        Args, Raises: as `expose`.
        """
        self.bonds.leave_ajar(bonds)

    def release(self, bonds: np.ndarray) -> None:
        """Let the lips of broken bonds meet like any facets, when the bond's law does so no more.

        Args, Raises: as `expose`, which it includes.
        """
        self.lists.add(self.bonds.release(bonds))
        self.lists.forget_edges()

    def find(
        self, x: np.ndarray, position: np.ndarray | None = None, rotation: np.ndarray | None = None
    ) -> Contacts:
        """The contacts whose gap is no larger than the reach.

        Of ranks that divide the search each finds what its own nodes touch, and its own edges.

        Args:
            x: positions of the nodes, shape (num_nodes, dim), m. Of ranks that divide the search
                each gives those of its own bodies.
            position: centres of the rigid bodies, shape (n, dim), m.
            rotation: their angles (rad), shape (n,), in 2D; shape (n, 3, 3), from the axes of the
                bodies to those of space, in 3D.

        Returns:
            Contacts with `dim` nodes a side. A node and a rigid body meet at the node, a facet and
            a rigid corner, disc or sphere at the facet's point; meshed sides in the middle.

        Raises:
            ValueError: positions that are not finite or do not fit.
        """
        x = self.surface.checked(x)
        self._rigid.move(position, rotation)
        self.lists.renew_if_needed(x)
        return self.find_in_lists(x)

    def find_in_lists(self, x: np.ndarray) -> Contacts:
        """As `find`, with the lists that there are and rigid bodies where they were put last."""
        lists, faces = self.lists, self._faces(x)
        if self._dim == 3:
            lists.follow_edges(x, faces.normal)
        parts = [empty(self._dim, self._dim)]
        if len(lists.node_facet):
            parts.append(self._nodes_on_facets(faces))
        if len(lists.edge_pairs):
            parts.append(self._edges_on_edges(faces))
        if len(lists.node_rigid) or len(lists.node_wall):
            parts.append(self._nodes_on_rigid(faces))
        if len(lists.rigid_facet):
            parts.append(self._rigid_on_facets(faces))
        return self._of_bodies(join(parts)) if self._rigid.in_parts else join(parts)

    # ------------------------------------------------------------------------------ contacts

    def _of_bodies(self, contacts: Contacts) -> Contacts:
        """Contacts with pieces of clusters as contacts with the clusters."""
        from xper_fx.nscd.search.whole_clusters import on_the_whole

        side = self._rigid
        piece, *others = on_the_whole(contacts, side.shapes, side.position, side.turn)
        return Contacts(np.where(piece < 0, -1, side.shapes.body[piece]), *others)

    def _nodes_on_facets(self, faces: Faces) -> Contacts:
        points = Points(faces.x, self._no_radius, np.zeros((1, self._dim)), True)
        point, facet, slot, weights, normal, gap, area = self._points_on_facets(
            self.lists.node_facet, points, faces
        )
        nodes, both = self._meshed_sides(len(point))
        nodes[:, 0] = point[:, None]
        both[:, 0, 0] = 1.0
        nodes[:, 1] = self.surface.facets[facet]
        both[:, 1] = weights
        opposite = np.einsum("nj,njd->nd", weights, faces.x[nodes[:, 1]])
        fragment = self.bonds.fragment[self.surface.body[facet]]
        return Contacts(
            np.full((len(point), 2), -1, np.int32),
            nodes,
            both,
            0.5 * (faces.x[point] + opposite),
            normal,
            gap,
            0.5 * area,
            _keys(_NODE_FACET, point, fragment, slot),
        )

    def _rigid_on_facets(self, faces: Faces) -> Contacts:
        side = self._rigid
        points = Points(side.points, side.radius, side.outward, False)
        point, facet, slot, weights, normal, gap, area = self._points_on_facets(
            self.lists.rigid_facet, points, faces
        )
        nodes, both = self._meshed_sides(len(point))
        nodes[:, 1] = self.surface.facets[facet]
        both[:, 1] = weights
        body = np.full((len(point), 2), -1, np.int32)
        body[:, 0] = side.piece_of_point[point]
        fragment = self.bonds.fragment[self.surface.body[facet]]
        return Contacts(
            body,
            nodes,
            both,
            np.einsum("nj,njd->nd", weights, faces.x[nodes[:, 1]]),
            normal,
            gap,
            area,
            _keys(_RIGID_FACET, point, fragment, slot),
        )

    def _points_on_facets(self, pairs: PairList, points: Points, faces: Faces) -> Touching:
        """Run `point_facet`, again if there was not enough room."""
        room = len(pairs.rows) + 16
        while True:
            out = room_for(room, self._dim)
            found = point_facet(points, pairs, faces, self.reach, self._hollows, out)
            if found <= room:
                return Touching(*(a[:found] for a in out))
            room = found

    def _edges_on_edges(self, faces: Faces) -> Contacts:
        facets, lists = self.surface.facets, self.lists
        pair, share, normal, gap, area = crossings(
            lists.edge_pairs, lists.edges, lists.others, lists.bends, faces, self.reach
        )
        edge = lists.edges[lists.edge_pairs[pair]]
        nodes, both = self._meshed_sides(len(pair))
        nodes[:, :, 0] = facets[edge // 3, edge % 3]
        nodes[:, :, 1] = facets[edge // 3, (edge + 1) % 3]
        nodes[:, :, 2] = nodes[:, :, 0]
        both[:, :, 0] = 1.0 - share
        both[:, :, 1] = share
        return Contacts(
            np.full((len(pair), 2), -1, np.int32),
            nodes,
            both,
            0.5 * np.einsum("nsj,nsjd->nd", both, faces.x[nodes]),
            normal,
            gap,
            area,
            _keys(_EDGE_EDGE, edge[:, 0], edge[:, 1], np.zeros(len(pair), np.int64)),
        )

    def _nodes_on_rigid(self, faces: Faces) -> Contacts:
        pairs = np.concatenate([self.lists.node_rigid, self.lists.node_wall])
        side = self._rigid
        ajar = faces._replace(exposed=self.bonds.ajar)
        pair, normal, gap, area = nodes_on_rigid(
            pairs, ajar, side.position, side.turn, side.shapes, self.reach
        )
        touching = pairs[pair]
        nodes, both = self._meshed_sides(len(pair))
        nodes[:, 0] = touching[:, :1]
        both[:, 0, 0] = 1.0
        body = np.full((len(pair), 2), -1, np.int32)
        body[:, 1] = touching[:, 1]
        none = np.zeros(len(pair), np.int64)
        return Contacts(
            body,
            nodes,
            both,
            faces.x[touching[:, 0]],
            normal,
            gap,
            area,
            _keys(_NODE_RIGID, touching[:, 0], touching[:, 1], none),
        )

    def _faces(self, x: np.ndarray) -> Faces:
        surface, bonds = self.surface, self.bonds
        ajar = self.lists.known(np.flatnonzero(bonds.ajar))
        facet_normals(x, surface.facets, ajar, self._normal)
        return Faces(
            x,
            surface.facets,
            surface.body,
            self._normal,
            bonds.exposed,
            bonds.weld,
            bonds.fragment,
            self._share,
            self.depth,
            self.extent,
            self._own_start,
            self._own_facets,
            self._own_body,
        )

    def _meshed_sides(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros((count, 2, self._dim), np.int32), np.zeros((count, 2, self._dim))


def _keys(kind: int, a: np.ndarray, b: np.ndarray, slot: np.ndarray) -> np.ndarray:
    pair = (np.int64(kind) << 2 * _BITS) | (a.astype(np.int64) << _BITS) | b.astype(np.int64)
    return np.stack([pair, slot], axis=1)


def renamed(keys: np.ndarray, node: np.ndarray, facet: np.ndarray) -> np.ndarray:
    """Keys of contacts with other numbers of nodes and facets.

    Args:
        keys: shape (n, 2).
        node: shape (num_nodes,), ascending; of each node.
        facet: shape (num_facets,), ascending; of each facet. What is rigid and fragments stay as
            they are.
    """
    mask = (1 << _BITS) - 1
    pair, out = keys[:, 0], keys.copy()
    kind, first, second = pair >> 2 * _BITS, pair >> _BITS & mask, pair & mask
    edges = kind == _EDGE_EDGE
    nodes = ~edges & (kind != _RIGID_FACET)
    first[nodes] = node[first[nodes]]
    for edge in (first, second):
        edge[edges] = 3 * facet[edge[edges] // 3] + edge[edges] % 3
    out[:, 0] = kind << 2 * _BITS | first << _BITS | second
    return out
