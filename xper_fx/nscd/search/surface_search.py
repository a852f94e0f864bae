# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts of the surfaces of meshed bodies: with each other, with themselves, with rigid bodies.

Both passes are made, nodes of a against facets of b and nodes of b against facets of a, and each
contact takes half of its node's area: where two flat sides overlap the areas of both passes add up
to the overlap. A node's area is what its own facets project onto the plane of contact. Edges that
cross (3D) come besides; so do corners of rigid bodies and discs and spheres that touch a facet
between its nodes, each with a node's share of the facet.

Lists of candidates (Verlet 1967) hold pairs no further apart than reach + skin. They are made anew
when some node or rigid body has moved by more than skin / 2 against the middle of all motions. What
bonds free is put into the list there is. Walls are looked at with all nodes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from xper_fx.nscd.rigid.bodies import RigidBodies
from xper_fx.nscd.rigid.shapes import HALF_PLANE, HALF_SPACE
from xper_fx.nscd.search.bonded_facets import Bonds
from xper_fx.nscd.search.contact_pairs import Contacts, empty, join
from xper_fx.nscd.search.edge_edge import convex_edges, edge_edge
from xper_fx.nscd.search.facet_geometry import Faces, facet_normals
from xper_fx.nscd.search.grid import box_pairs
from xper_fx.nscd.search.node_facet import Touching, point_facet, room_for
from xper_fx.nscd.search.node_rigid import node_rigid
from xper_fx.nscd.search.pair_list import PairList
from xper_fx.nscd.search.surface import Surface
from xper_fx.support.saved_rows import Rows

# How many searches a list should serve, and bounds of the skin as shares of a facet's size.
_SEARCHES_A_LIST = 20
_SKIN_BOUNDS = (0.01, 0.5)

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
        reach: largest gap of a contact (m).
        skin: m, of the lists in use.
        renewals: how often lists have been made.
        searches: how often contacts have been looked for.

    Args:
        surface: the facets and bonds.
        x: positions of the nodes at the start, shape (num_nodes, dim), m.
        reach: largest gap of a contact (m), positive.
        pairs: names of groups that may touch, (a, b) or (a, a), of surfaces and rigid bodies (two
            rigid ones are left to `RigidSearch`); None: all.
        released: bonds that never held, shape (num_bonds,), bool; None: all hold.
        self_contact: whether a body may touch itself.
        rigid: rigid bodies, or None.
        depth: share of a facet's size, and of the thickness behind it, that is sought.

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
        rigid: RigidBodies | None = None,
        depth: float = 0.25,
    ):
        if not (np.isfinite(reach) and reach > 0.0):
            raise ValueError(f"The reach (m) must be a finite positive number, got {reach!r}.")
        if not 0.0 < depth <= 1.0:
            raise ValueError(f"The depth is a share of a facet's size, in (0, 1], got {depth!r}.")
        self.surface = surface
        self.bonds = Bonds(surface, released)
        self.reach = float(reach)
        self._dim = surface.dim
        x = self._checked(x)
        self._rigid = _RigidSide(rigid, surface, pairs)
        self._meets = _meets(surface.groups, surface.groups, pairs)
        size = surface.size(x)
        self.depth = depth * np.minimum(size, surface.thickness)
        self._typical = float(np.median(size)) if len(surface) else 1.0
        self._extent = np.hypot(self.reach, self._around(self.depth))
        self.update_areas(x)

        count = surface.num_nodes
        flat = surface.facets.ravel()
        order = np.argsort(flat, kind="stable")
        self._own_start = np.searchsorted(flat[order], np.arange(count + 1)).astype(np.int32)
        self._own_facets = (order // self._dim).astype(np.int32)
        self._groups_of_node = np.zeros((count, len(surface.groups)), bool)
        self._groups_of_node[flat, np.repeat(surface.group, self._dim)] = True
        self._body_of_node = np.full(count, -1, np.int32)
        self._body_of_node[flat] = np.repeat(surface.body, self._dim)
        self._self_contact = self_contact
        self._own_body = np.full(count, -2, np.int32) if self_contact else self._body_of_node

        self._normal = np.zeros((len(surface), self._dim))
        self._no_radius = np.zeros(count)
        self._node_facet = PairList(len(surface))
        self._rigid_facet = PairList(len(surface))
        self._node_rigid = np.empty((0, 2), np.int32)
        self._node_wall = np.empty((0, 2), np.int32)
        self._edges = self._others = np.empty(0, np.int64)
        self._edge_pairs = np.empty((0, 2), np.int32)
        self._edges_are_old = True
        self._is_listed = np.zeros(count, bool)
        self._old_x: np.ndarray | None = None
        self._old_rigid: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
        self.skin = 0.1 * self._typical
        self.renewals = self.searches = 0
        self._searches_at_renewal = 0

    @property
    def num_candidates(self) -> int:
        """Pairs in the lists, walls' pairs left out."""
        lists = self._node_facet, self._rigid_facet, self._node_rigid, self._edge_pairs
        return sum(len(a) for a in lists)

    @property
    def nbytes(self) -> int:
        """Memory of the lists, in bytes."""
        lists = self._node_facet, self._rigid_facet, self._node_rigid, self._edge_pairs
        return sum(a.nbytes for a in (*lists, self._node_wall, self._edges, self._others))

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
        self._put_in(self.bonds.expose(bonds))

    def release(self, bonds: np.ndarray) -> None:
        """Let the lips of broken bonds meet like any facets, when the bond's law does so no more.

        Args, Raises: as `expose`, which it includes.
        """
        self._put_in(self.bonds.release(bonds))
        self._edges_are_old = True

    def find(
        self,
        x: np.ndarray,
        position: np.ndarray | None = None,
        rotation: np.ndarray | None = None,
    ) -> Contacts:
        """The contacts whose gap is no larger than the reach.

        Args:
            x: positions of the nodes, shape (num_nodes, dim), m.
            position: centres of the rigid bodies, shape (n, dim), m.
            rotation: their angles (rad), shape (n,), in 2D; shape (n, 3, 3), from the axes of the
                bodies to those of space, in 3D.

        Returns:
            Contacts with `dim` nodes a side. A node and a rigid body meet at the node, a facet and
            a rigid corner, disc or sphere at the facet's point; meshed sides in the middle.

        Raises:
            ValueError: positions that are not finite or do not fit.
        """
        x = self._checked(x)
        self._rigid.move(position, rotation)
        self._renew_if_needed(x)
        self.searches += 1
        faces = self._faces(x)
        parts = [empty(self._dim, self._dim)]
        if len(self._node_facet):
            parts.append(self._nodes_on_facets(faces))
        if len(self._edge_pairs):
            parts.append(self._edges_on_edges(faces))
        if len(self._node_rigid) or len(self._node_wall):
            parts.append(self._nodes_on_rigid(faces))
        if len(self._rigid_facet):
            parts.append(self._rigid_on_facets(faces))
        return join(parts)

    # ------------------------------------------------------------------------------ contacts

    def _nodes_on_facets(self, faces: Faces) -> Contacts:
        point, facet, slot, weights, normal, gap, area = self._points_on_facets(
            self._node_facet, faces.x, self._no_radius, np.zeros((1, self._dim)), True, faces
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
        point, facet, slot, weights, normal, gap, area = self._points_on_facets(
            self._rigid_facet, side.points, side.radius, side.outward, False, faces
        )
        nodes, both = self._meshed_sides(len(point))
        nodes[:, 1] = self.surface.facets[facet]
        both[:, 1] = weights
        body = np.full((len(point), 2), -1, np.int32)
        body[:, 0] = side.body_of_point[point]
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

    def _points_on_facets(
        self,
        pairs: PairList,
        points: np.ndarray,
        radius: np.ndarray,
        outward: np.ndarray,
        meshed: bool,
        faces: Faces,
    ) -> Touching:
        """Run `point_facet`, again if there was not enough room."""
        room = len(pairs.rows) + 16
        while True:
            out = room_for(room, self._dim)
            found = point_facet(
                points,
                radius,
                outward,
                meshed,
                pairs.rows,
                pairs.start,
                pairs.listed,
                faces,
                self.reach,
                out,
            )
            if found <= room:
                return Touching(*(a[:found] for a in out))
            room = found

    def _edges_on_edges(self, faces: Faces) -> Contacts:
        facets, room = self.surface.facets, len(self._edge_pairs)
        pair, share = np.empty(room, np.int32), np.empty((room, 2))
        normal, gap, area = np.empty((room, 3)), np.empty(room), np.empty(room)
        found = edge_edge(
            self._edge_pairs,
            self._edges,
            self._others,
            faces,
            self.reach,
            pair,
            share,
            normal,
            gap,
            area,
            np.empty((2, 3)),
            np.empty(3),
        )
        edge = self._edges[self._edge_pairs[pair[:found]]]
        nodes, both = self._meshed_sides(found)
        nodes[:, :, 0] = facets[edge // 3, edge % 3]
        nodes[:, :, 1] = facets[edge // 3, (edge + 1) % 3]
        nodes[:, :, 2] = nodes[:, :, 0]
        both[:, :, 0] = 1.0 - share[:found]
        both[:, :, 1] = share[:found]
        return Contacts(
            np.full((found, 2), -1, np.int32),
            nodes,
            both,
            0.5 * np.einsum("nsj,nsjd->nd", both, faces.x[nodes]),
            normal[:found],
            gap[:found],
            area[:found],
            _keys(_EDGE_EDGE, edge[:, 0], edge[:, 1], np.zeros(found, np.int64)),
        )

    def _nodes_on_rigid(self, faces: Faces) -> Contacts:
        pairs = np.concatenate([self._node_rigid, self._node_wall])
        room = len(pairs)
        pair, normal = np.empty(room, np.int32), np.empty((room, self._dim))
        gap, area = np.empty(room), np.empty(room)
        side = self._rigid
        found = node_rigid(
            pairs, faces, side.position, side.turn, side.shapes, self.reach, pair, normal, gap,
            area, np.empty((4, self._dim)),
        )  # fmt: skip
        touching = pairs[pair[:found]]
        nodes, both = self._meshed_sides(found)
        nodes[:, 0] = touching[:, :1]
        both[:, 0, 0] = 1.0
        body = np.full((found, 2), -1, np.int32)
        body[:, 1] = touching[:, 1]
        none = np.zeros(found, np.int64)
        return Contacts(
            body,
            nodes,
            both,
            faces.x[touching[:, 0]],
            normal[:found],
            gap[:found],
            area[:found],
            _keys(_NODE_RIGID, touching[:, 0], touching[:, 1], none),
        )

    def _faces(self, x: np.ndarray) -> Faces:
        surface, bonds = self.surface, self.bonds
        facet_normals(x, surface.facets, np.flatnonzero(bonds.exposed), self._normal)
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
            self._extent,
            self._own_start,
            self._own_facets,
            self._own_body,
        )

    def _meshed_sides(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros((count, 2, self._dim), np.int32), np.zeros((count, 2, self._dim))

    # --------------------------------------------------------------------------------- lists

    def _renew_if_needed(self, x: np.ndarray) -> None:
        if self._old_x is not None:
            motion = self._motion(x)
            if motion <= 0.5 * self.skin:
                if self._edges_are_old:
                    self._list_edges()
                return
            speed = motion / (self.searches - self._searches_at_renewal)
            lowest, highest = (share * self._typical for share in _SKIN_BOUNDS)
            self.skin = float(np.clip(2.0 * _SEARCHES_A_LIST * speed, lowest, highest))
        self._list(x.copy(), self._rigid.state())

    def _list(self, x: np.ndarray, rigid: tuple[np.ndarray, ...] | None) -> None:
        """Make all lists for nodes at x and rigid bodies in a state of `_RigidSide`."""
        self._old_x, self._old_rigid = x, rigid
        self._is_listed[:] = False
        for pairs in (self._node_facet, self._rigid_facet):
            pairs.replace(np.empty((0, 2), np.int32))
        self._node_rigid = self._node_wall = np.empty((0, 2), np.int32)
        self._put_in(np.flatnonzero(self.bonds.exposed))
        self._list_edges()
        self.renewals += 1
        self._searches_at_renewal = self.searches

    def saved(self, by_cell: Callable[[np.ndarray], Rows]) -> dict:
        """What the lists in use were made from, and how long they have served.

        Args:
            by_cell: puts positions of the nodes into an order that no process decides.
        """
        if self._old_x is None:
            return {}
        saved = {
            "skin": self.skin,
            "served": self.searches - self._searches_at_renewal,
            "x": by_cell(self._old_x),
        }
        if self._old_rigid is not None:
            saved |= zip(("position", "turn", "points"), self._old_rigid, strict=True)
        return saved

    def restore(self, saved: Mapping, from_cells: Callable[[np.ndarray], np.ndarray]) -> None:
        """Make the lists that `saved` told of, for the bonds as they are now.

        Args:
            saved: of `saved`, rows in order.
            from_cells: takes back what `by_cell` did.
        """
        if not saved:
            return
        self.skin = saved["skin"]
        rigid = None
        if "position" in saved:
            rigid = saved["position"], saved["turn"], saved["points"]
            self._rigid.points = saved["points"]
        self._list(from_cells(saved["x"]), rigid)
        self.searches += saved["served"]

    def _motion(self, x: np.ndarray) -> float:
        """Largest displacement since the lists were made, against the middle of all nodes'."""
        moved = (x - self._old_x)[self._is_listed]
        if len(moved) == 0:
            return 0.0
        middle = 0.5 * (moved.min(axis=0) + moved.max(axis=0))
        moved -= middle
        furthest = np.sqrt(np.einsum("nd,nd->n", moved, moved).max())
        return max(float(furthest), self._rigid.motion(self._old_rigid, middle))

    def _put_in(self, fresh: np.ndarray) -> None:
        """List what facets that are new on the surface, and their nodes, may touch."""
        if self._old_x is None or len(fresh) == 0:
            return
        x, facets, rigid = self._old_x, self.surface.facets, self._rigid
        self._edges_are_old = True
        of_fresh = np.unique(facets[fresh])
        new_nodes = of_fresh[~self._is_listed[of_fresh]]
        self._is_listed[new_nodes] = True
        nodes = np.flatnonzero(self._is_listed)
        low, high = self._boxes(x, fresh)
        found = [_named(box_pairs(x[nodes], x[nodes], low, high), nodes, fresh)]
        known = np.setdiff1d(np.flatnonzero(self.bonds.exposed), fresh, assume_unique=True)
        if len(new_nodes) and len(known):
            low, high = self._boxes(x, known)
            at = x[new_nodes]
            found.append(_named(box_pairs(at, at, low, high), new_nodes, known))
        found = np.concatenate(found)
        node, facet = found.T
        group = self.surface.group[facet]
        may = (self._groups_of_node[node] & self._meets[group]).any(axis=1)
        if not self._self_contact and len(self.surface.bond_nodes) == 0:
            may &= self._body_of_node[node] != self.surface.body[facet]
        self._node_facet.insert(found[may])

        if not rigid.walls.size and not len(rigid.points):
            return
        meets = (self._groups_of_node[new_nodes] @ rigid.meets).astype(bool)
        node, wall = np.nonzero(meets[:, rigid.walls])
        pairs = np.stack([new_nodes[node], rigid.walls[wall]], axis=1)
        self._node_wall = np.concatenate([self._node_wall, pairs.astype(np.int32)])
        if not len(rigid.points):
            return
        position, _, points = self._old_rigid
        solids = rigid.solids
        beyond = (rigid.bounding[solids] + self.reach + self.skin)[:, None]
        low, high = position[solids] - beyond, position[solids] + beyond
        found = box_pairs(x[new_nodes], x[new_nodes], low, high)
        found = found[meets[found[:, 0], solids[found[:, 1]]]]
        self._node_rigid = np.concatenate([self._node_rigid, _named(found, new_nodes, solids)])
        low, high = self._boxes(x, fresh)
        radius = rigid.radius[:, None]
        found = box_pairs(points - radius, points + radius, low, high)
        point, facet = found[:, 0], fresh[found[:, 1]]
        may = rigid.meets[self.surface.group[facet], rigid.body_of_point[point]]
        self._rigid_facet.insert(np.stack([point, facet], axis=1)[may])

    def _list_edges(self) -> None:
        """List the pairs of convex edges that may cross (3D)."""
        self._edges_are_old = False
        if self._dim == 2:
            return
        x, facets, surface = self._old_x, self.surface.facets, self.surface
        chosen = np.flatnonzero(self.bonds.exposed)
        facet_normals(x, facets, chosen, self._normal)
        edges, others = convex_edges(x, facets, chosen, self.bonds.weld, self._normal)
        ends = x[np.stack([facets[edges // 3, edges % 3], facets[edges // 3, (edges + 1) % 3]])]
        beyond = 0.5 * (self._extent[edges // 3] + self.skin)[:, None]
        pairs = box_pairs(ends.min(axis=0) - beyond, ends.max(axis=0) + beyond)
        first, second = (edges // 3)[pairs.T]
        may = self._meets[surface.group[first], surface.group[second]]
        if not self._self_contact:
            may &= surface.body[first] != surface.body[second]
        self._edges, self._others, self._edge_pairs = edges, others, pairs[may]

    def _boxes(self, x: np.ndarray, facets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        corners = x[self.surface.facets[facets]]
        beyond = (self._extent[facets] + self.skin)[:, None]
        return corners.min(axis=1) - beyond, corners.max(axis=1) + beyond

    def _around(self, depth: np.ndarray) -> np.ndarray:
        """Largest depth of the facets that share a node with each."""
        facets = self.surface.facets
        at_node = np.zeros(self.surface.num_nodes)
        np.maximum.at(at_node, facets.ravel(), np.repeat(depth, self._dim))
        return at_node[facets].max(axis=1, initial=0.0)

    def _checked(self, x: np.ndarray) -> np.ndarray:
        x = np.ascontiguousarray(x, dtype=float)
        expected = (self.surface.num_nodes, self._dim)
        if x.shape != expected or not np.isfinite(x).all():
            raise ValueError(
                f"Positions should be finite and of shape {expected}, got {x.shape}"
                + (", not all finite." if x.shape == expected else ".")
            )
        return x


class _RigidSide:
    """The rigid bodies as surfaces meet them, and where they are now.

    Attributes:
        meets: which body each group of the surface may touch, shape (num_groups, n), bool.
        walls, solids: numbers of the bodies that are walls, and of the others.
        points: corners of polygons and polyhedra, and centres of discs and spheres, now.
        outward: from the centre of the body to its corners, zero at centres.
        radius: of discs and spheres at their centres, 0 at corners.
        body_of_point: shape (num_points,).
    """

    def __init__(
        self,
        bodies: RigidBodies | None,
        surface: Surface,
        pairs: Sequence[tuple[str, str]] | None,
    ):
        dim = surface.dim
        self.points = self.outward = np.empty((0, dim))
        self.walls = self.solids = np.empty(0, np.int64)
        names = () if bodies is None else bodies.groups
        both = set(names) & set(surface.groups)
        if both:
            raise ValueError(
                f"Groups {sorted(both)} are of rigid and of meshed bodies: give them two names."
            )
        unknown = {name for pair in pairs or () for name in pair} - set(names) - set(surface.groups)
        if unknown:
            raise ValueError(
                f"pairs names groups {sorted(unknown)}; there are "
                f"{sorted(set(names) | set(surface.groups))}."
            )
        self._count = 0 if bodies is None else len(bodies)
        if bodies is None:
            return
        if bodies.dim != dim:
            raise ValueError(f"Rigid bodies are of dimension {bodies.dim}, the surface of {dim}.")
        self.shapes = tables = bodies.shapes
        self.meets = _meets(surface.groups, names, pairs)[:, bodies.group_of]
        is_wall = np.isin(tables.kind, (HALF_PLANE, HALF_SPACE))
        self.walls, self.solids = np.flatnonzero(is_wall), np.flatnonzero(~is_wall)
        self.bounding = tables.bounding_radius
        starts = tables.vertex_offsets
        local, owner = [], []
        for body in self.solids:
            entry = tables.entry[body]
            corners = np.zeros((1, dim))
            if entry >= 0:
                corners = tables.vertices[starts[entry] : starts[entry + 1]]
            local.append(corners)
            owner.append(np.full(len(corners), body, np.int32))
        self._local = np.concatenate([self.points, *local])
        self.body_of_point = np.concatenate([np.empty(0, np.int32), *owner])
        self.radius = tables.radius[self.body_of_point]

    def move(self, position: np.ndarray | None, rotation: np.ndarray | None) -> None:
        """Put the bodies where they are now."""
        if self._count == 0:
            return
        if position is None or rotation is None:
            raise ValueError("There are rigid bodies: give their positions and rotations.")
        position = np.ascontiguousarray(position, dtype=float)
        rotation = np.asarray(rotation, dtype=float)
        dim = self.points.shape[1]
        if position.shape != (self._count, dim) or len(rotation) != self._count:
            raise ValueError(
                f"Positions of {self._count} rigid bodies in dimension {dim} were expected, got "
                f"shapes {position.shape} and {rotation.shape}."
            )
        if not (np.isfinite(position).all() and np.isfinite(rotation).all()):
            raise ValueError("Positions and rotations of rigid bodies should be finite.")
        if dim == 2:
            c, s = np.cos(rotation), np.sin(rotation)
            rotation = np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1)
        self.position, self.turn = position, np.ascontiguousarray(rotation)
        body = self.body_of_point
        self.outward = np.einsum("pij,pj->pi", self.turn[body], self._local)
        self.points = position[body] + self.outward

    def state(self) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Positions, rotations and points, to be compared with later ones."""
        if self._count == 0:
            return None
        return self.position.copy(), self.turn.copy(), self.points.copy()

    def motion(self, old: tuple[np.ndarray, ...] | None, middle: np.ndarray) -> float:
        """Largest displacement of a body's points since `old`, against `middle`; walls left out."""
        if len(self.solids) == 0:
            return 0.0
        shift = (self.position - old[0])[self.solids] - middle
        turned = np.sqrt(0.5 * ((self.turn - old[1])[self.solids] ** 2).sum(axis=(1, 2)))
        turned *= np.where(self.shapes.radius[self.solids] > 0, 0.0, self.bounding[self.solids])
        return float((np.linalg.norm(shift, axis=1) + turned).max())


def _meets(
    rows: tuple[str, ...], columns: tuple[str, ...], pairs: Sequence[tuple[str, str]] | None
) -> np.ndarray:
    """Which group of `rows` may touch which of `columns`, bool."""
    named = None if pairs is None else {frozenset(pair) for pair in pairs}
    allowed = [[named is None or frozenset((a, b)) in named for b in columns] for a in rows]
    return np.array(allowed, bool).reshape(len(rows), len(columns))


def _named(pairs: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.stack([first[pairs[:, 0]], second[pairs[:, 1]]], axis=1).astype(np.int32)


def _keys(kind: int, a: np.ndarray, b: np.ndarray, slot: np.ndarray) -> np.ndarray:
    pair = (np.int64(kind) << 2 * _BITS) | (a.astype(np.int64) << _BITS) | b.astype(np.int64)
    return np.stack([pair, slot], axis=1)
