# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pairs of nodes, facets, edges and rigid bodies that may touch before the lists are made anew.

Lists (Verlet 1967) hold pairs no further apart than reach + skin. They are made anew when some node
or rigid body has moved by more than skin / 2 against the middle of all motions. What bonds free is
put into the list there is. Walls are looked at with all nodes.

Where ranks divide the search (`search_share.py`) all make lists anew at the same steps. Each lists
the nodes of its own bodies, and pairs of edges of which the first is of its own.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from xper_fx.nscd.search.bonded_facets import Bonds
from xper_fx.nscd.search.edge_edge import BENT, edge_bends, surface_edges
from xper_fx.nscd.search.grid import box_pairs
from xper_fx.nscd.search.pair_list import PairList
from xper_fx.nscd.search.rigid_side import RigidSide
from xper_fx.nscd.search.search_share import SearchShare
from xper_fx.nscd.search.surface import Surface

# How many searches a list should serve, and bounds of the skin as shares of a facet's size.
_SEARCHES_A_LIST = 20
_SKIN_BOUNDS = (0.01, 0.5)
# Share of the bend that counts with which an edge is listed.
_BENT_SOON = 0.5


class CandidateLists:
    """Pairs that may touch.

    Args:
        surface: the facets.
        bonds: what of them is exposed.
        rigid: the rigid bodies.
        meets: which group of the surface may touch which, shape (num_groups, num_groups), bool.
        extent: of each facet (m): a point further from it does not touch it.
        reach: largest gap of a contact (m).
        self_contact: whether a body may touch itself.
        typical_size: of a facet (m).
        share: of the ranks that divide the search; None where one makes all of it.

    Attributes:
        node_facet, rigid_facet: nodes and rigid points beside facets.
        node_rigid, node_wall: nodes beside pieces of rigid bodies and walls, shape (n, 2).
        edges, others: edges (3D), as 3 facet + corner, and the facet beyond each.
        bends: of `edge_bends`, how the edges are bent now.
        edge_pairs: pairs of `edges` that may cross, shape (n, 2).
        skin: m, of the lists in use.
        renewals: how often lists have been made.
        searches: how often contacts have been looked for.
        changes: how often pairs of meshed bodies have been listed, by all ranks together.
    """

    def __init__(
        self,
        surface: Surface,
        bonds: Bonds,
        rigid: RigidSide,
        meets: np.ndarray,
        extent: np.ndarray,
        reach: float,
        self_contact: bool,
        typical_size: float,
        share: SearchShare | None = None,
    ):
        self._surface, self._bonds, self._rigid = surface, bonds, rigid
        self._meets, self._extent, self._reach = meets, extent, reach
        self._self_contact, self._dim, self._share = self_contact, surface.dim, share
        count, flat = surface.num_nodes, surface.facets.ravel()
        self._groups_of_node = np.zeros((count, len(surface.groups)), bool)
        self._groups_of_node[flat, np.repeat(surface.group, self._dim)] = True
        self._body_of_node = bodies_of_nodes(surface)
        self.node_facet = PairList(len(surface))
        self.rigid_facet = PairList(len(surface))
        self.node_rigid = np.empty((0, 2), np.int32)
        self.node_wall = np.empty((0, 2), np.int32)
        self.edges = self.others = np.empty(0, np.int64)
        self.edge_pairs = np.empty((0, 2), np.int32)
        self.bends = np.empty(0)
        self._edge_is_listed = np.empty(0, bool)
        self._edges_are_old = True
        self._is_listed = np.zeros(count, bool)
        self._old_x: np.ndarray | None = None
        self._old_rigid: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
        self._typical = typical_size
        self.skin = 0.1 * self._typical
        self.renewals = self.searches = self.changes = 0
        self._searches_at_renewal = 0

    @property
    def num_pairs(self) -> int:
        """Pairs in the lists, walls' pairs left out."""
        return sum(len(a) for a in self._lists)

    @property
    def nbytes(self) -> int:
        """Memory of the lists, in bytes."""
        edges = self.edges, self.others, self.bends
        return sum(a.nbytes for a in (*self._lists, self.node_wall, *edges))

    @property
    def _lists(self) -> tuple:
        return self.node_facet, self.rigid_facet, self.node_rigid, self.edge_pairs

    def pairs_of_bodies(self) -> np.ndarray:
        """Bodies in the lists, shape (n, 2), the lower number first, sorted.

        Of ranks that divide the search; rigid bodies are numbered after meshed ones, and pairs with
        walls are left out.
        """
        near, edges = self.node_facet, self.edges[self.edge_pairs] // 3
        node = np.repeat(near.rows, np.diff(near.start))
        body = self._surface.body
        pairs = np.stack([self._body_of_node[node], body[near.listed]], axis=1)
        pairs = [pairs, body[edges].reshape(-1, 2)]
        if len(self._rigid.points):
            first, near, rigid = len(self._share.own_body), self.rigid_facet, self._rigid
            point = np.repeat(near.rows, np.diff(near.start))
            node, piece = self.node_rigid.T
            for meshed, solid in (
                (body[near.listed], rigid.body_of_point[point]),
                (self._body_of_node[node], rigid.shapes.body[piece]),
            ):
                pairs.append(np.stack([meshed, first + solid], axis=1))
        pairs = np.sort(np.concatenate(pairs), axis=1)
        return np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)

    def forget_edges(self) -> None:
        """List edges anew before the next search: they have other facets now."""
        self._edges_are_old = True

    def renew_if_needed(self, x: np.ndarray) -> None:
        """Make the lists anew if something has moved too far; one more search is made with them.

        Args:
            x: shape (num_nodes, dim), m; of ranks that divide the search each gives its own nodes,
                and has those of known bodies then.
        """
        self._renew(x)
        self.searches += 1

    def known(self, facets: np.ndarray) -> np.ndarray:
        """Those of some facets where this rank knows the nodes, in their order."""
        if self._share is None:
            return facets
        return facets[self._share.known[self._surface.body[facets]]]

    def _renew(self, x: np.ndarray) -> None:
        if self._old_x is None or self.are_old(x):
            self._list(x, self._rigid.state())
        elif self._share is not None:
            self._share.refresh(x)

    def are_old(self, x: np.ndarray) -> bool:
        """Whether something has moved too far since they were made; the next get another skin.

        Args:
            x: as of `renew_if_needed`.
        """
        motion = self._motion(x)
        if motion <= 0.5 * self.skin:
            return False
        speed = motion / (self.searches - self._searches_at_renewal)
        lowest, highest = (share * self._typical for share in _SKIN_BOUNDS)
        self.skin = float(np.clip(2.0 * _SEARCHES_A_LIST * speed, lowest, highest))
        return True

    def _list(self, x: np.ndarray, rigid: tuple[np.ndarray, ...] | None) -> None:
        """Make all lists for nodes at x and rigid bodies in a state of `RigidSide`."""
        if self._share is not None:
            others = self._boxes_of_rigid(rigid)
            self._share.meet(x, *self._boxes_of_bodies(x), others, self._with_joined)
        self._old_x, self._old_rigid = x.copy(), rigid
        self._is_listed[:] = False
        for pairs in (self.node_facet, self.rigid_facet):
            pairs.replace(np.empty((0, 2), np.int32))
        self.node_rigid = self.node_wall = np.empty((0, 2), np.int32)
        self._edges_are_old = True
        self.add(np.flatnonzero(self._bonds.exposed))
        self.renewals += 1
        self._searches_at_renewal = self.searches

    def saved(self) -> dict:
        """What lists are made from again, bit by bit; `x` has the nodes that this rank knows."""
        if self._old_x is None:
            return {}
        saved = {
            "skin": self.skin,
            "served": self.searches - self._searches_at_renewal,
            "x": self._old_x,
        }
        if self._old_rigid is not None:
            saved |= zip(("position", "turn", "points"), self._old_rigid, strict=True)
        return saved

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave."""
        if not saved:
            return
        self.skin = saved["skin"]
        rigid = None
        if "position" in saved:
            rigid = saved["position"], saved["turn"], saved["points"]
            self._rigid.points = saved["points"]
        self._list(saved["x"], rigid)
        self.searches += saved["served"]

    def _motion(self, x: np.ndarray) -> float:
        """Largest displacement since the lists were made, against the middle of all nodes'."""
        moved = (x - self._old_x)[self._is_listed]
        ends = np.stack([moved.max(axis=0, initial=-np.inf), -moved.min(axis=0, initial=np.inf)])
        ends = self._largest(ends)
        if np.isinf(ends).any():
            return 0.0
        middle = 0.5 * (ends[0] - ends[1])
        moved -= middle
        squared = self._largest(np.einsum("nd,nd->n", moved, moved).max(initial=0.0))
        return max(float(np.sqrt(squared)), self._rigid.motion(self._old_rigid, middle))

    def _largest(self, values):
        return values if self._share is None else self._share.largest(values)

    def add(self, fresh: np.ndarray) -> None:
        """List what facets that are new on the surface, and their nodes, may touch."""
        if self._old_x is None or len(fresh) == 0:
            return
        x, facets, rigid = self._old_x, self._surface.facets, self._rigid
        self._edges_are_old = True
        self.changes += 1
        fresh = self.known(fresh)
        of_fresh = np.unique(facets[fresh])
        new_nodes = of_fresh[~self._is_listed[of_fresh]]
        if self._share is not None:
            new_nodes = new_nodes[self._share.own_node[new_nodes]]
        self._is_listed[new_nodes] = True
        nodes = np.flatnonzero(self._is_listed)
        low, high = self._boxes(x, fresh)
        found = [_named(box_pairs(x[nodes], x[nodes], low, high), nodes, fresh)]
        known = self.known(np.flatnonzero(self._bonds.exposed))
        known = np.setdiff1d(known, fresh, assume_unique=True)
        if len(new_nodes) and len(known):
            low, high = self._boxes(x, known)
            at = x[new_nodes]
            found.append(_named(box_pairs(at, at, low, high), new_nodes, known))
        found = np.concatenate(found)
        node, facet = found.T
        group = self._surface.group[facet]
        may = (self._groups_of_node[node] & self._meets[group]).any(axis=1)
        if not self._self_contact and len(self._surface.bond_nodes) == 0:
            may &= self._body_of_node[node] != self._surface.body[facet]
        self.node_facet.insert(found[may])

        if not rigid.walls.size and not len(rigid.points):
            return
        meets = (self._groups_of_node[new_nodes] @ rigid.meets).astype(bool)
        node, wall = np.nonzero(meets[:, rigid.walls])
        pairs = np.stack([new_nodes[node], rigid.walls[wall]], axis=1)
        self.node_wall = np.concatenate([self.node_wall, pairs.astype(np.int32)])
        if not len(rigid.points):
            return
        position, _, points = self._old_rigid
        solids = rigid.solids
        beyond = (rigid.bounding[solids] + self._reach + self.skin)[:, None]
        low, high = position[solids] - beyond, position[solids] + beyond
        found = box_pairs(x[new_nodes], x[new_nodes], low, high)
        found = found[meets[found[:, 0], solids[found[:, 1]]]]
        self.node_rigid = np.concatenate([self.node_rigid, _named(found, new_nodes, solids)])
        low, high = self._boxes(x, fresh)
        looked = np.arange(len(points))
        if self._share is not None:
            looked = looked[self._share.own_rigid[rigid.body_of_point]]
        at, radius = points[looked], rigid.radius[looked, None]
        found = box_pairs(at - radius, at + radius, low, high)
        point, facet = looked[found[:, 0]], fresh[found[:, 1]]
        may = rigid.meets[self._surface.group[facet], rigid.piece_of_point[point]]
        self.rigid_facet.insert(np.stack([point, facet], axis=1)[may])

    def follow_edges(self, x: np.ndarray, normal: np.ndarray) -> None:
        """See how edges are bent, and list pairs of them anew if one that is not listed counts.

        What is found hangs on where facets are, not on when lists were made.

        Args:
            x: as of `renew_if_needed`, which comes before.
            normal: of the exposed facets, shape (f, 3).
        """
        facets, is_old = self._surface.facets, self._edges_are_old
        if is_old:
            self._edges_are_old = False
            chosen = self.known(np.flatnonzero(self._bonds.exposed))
            self.edges, self.others = surface_edges(
                facets, chosen, self._bonds.joined_edges(chosen)
            )
            self._edge_is_listed = np.zeros(len(self.edges), bool)
        self.bends = edge_bends(x, facets, self.edges, self.others, normal)
        is_old |= bool(np.any((self.bends < -BENT) & ~self._edge_is_listed))
        if self._share is not None:
            is_old = bool(self._largest(float(is_old)))
        if is_old:
            self._list_edges()

    def _list_edges(self) -> None:
        """List the pairs of bent edges that may cross (3D)."""
        self.changes += 1
        x, facets, surface = self._old_x, self._surface.facets, self._surface
        self._edge_is_listed = self.bends < -_BENT_SOON * BENT
        listed = np.flatnonzero(self._edge_is_listed)
        facet, corner = np.divmod(self.edges[listed], 3)
        ends = x[np.stack([facets[facet, corner], facets[facet, (corner + 1) % 3]])]
        beyond = 0.5 * (self._extent[facet] + self.skin)[:, None]
        pairs = box_pairs(ends.min(axis=0) - beyond, ends.max(axis=0) + beyond)
        first, second = facet[pairs.T]
        may = self._meets[surface.group[first], surface.group[second]]
        if not self._self_contact:
            may &= surface.body[first] != surface.body[second]
        if self._share is not None:
            may &= self._share.own_body[surface.body[first]]
        self.edge_pairs = listed[pairs[may]].astype(np.int32)

    def _boxes(self, x: np.ndarray, facets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        corners = x[self._surface.facets[facets]]
        beyond = (self._extent[facets] + self.skin)[:, None]
        return corners.min(axis=1) - beyond, corners.max(axis=1) + beyond

    def _boxes_of_bodies(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Boxes that hold all facets of own bodies, and what may touch them."""
        body = self._surface.body
        facets = np.flatnonzero(self._share.own_body[body])
        low, high = np.full((2, len(self._share.own_body), self._dim), np.inf)
        high *= -1.0
        lowest, highest = self._boxes(x, facets)
        np.minimum.at(low, body[facets], lowest)
        np.maximum.at(high, body[facets], highest)
        return low, high

    def _boxes_of_rigid(self, rigid: tuple[np.ndarray, ...] | None):
        """Boxes around own rigid bodies but walls, in a state of `RigidSide`."""
        if rigid is None:
            return np.empty((2, 0, self._dim))
        side = self._rigid
        own = side.solids[self._share.own_rigid[side.shapes.body[side.solids]]]
        centre, radius = rigid[0][own], side.bounding[own, None]
        return centre - radius, centre + radius

    def _with_joined(self, near: np.ndarray) -> np.ndarray:
        """Bodies, shape (num_bodies,), bool, and those with which they share welds.

        Broken lips are watched across their bond, and whether an edge is convex hangs on all facets
        that have it: in 3D edges of others than own bodies are listed, too.
        """
        surface, weld = self._surface, self._bonds.weld
        if len(surface.bond_nodes) == 0:
            return near
        of_node, there = self._share.body_of_node, np.zeros(surface.num_nodes, bool)
        there[weld[(near if self._dim == 3 else self._share.own_body)[of_node]]] = True
        joined = near.copy()
        joined[of_node[there[weld]]] = True
        return joined


def bodies_of_nodes(surface: Surface) -> np.ndarray:
    """Body of each node, shape (num_nodes,), -1 where no facet has it."""
    body = np.full(surface.num_nodes, -1, np.int32)
    body[surface.facets.ravel()] = np.repeat(surface.body, surface.dim)
    return body


def _named(pairs: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.stack([first[pairs[:, 0]], second[pairs[:, 1]]], axis=1).astype(np.int32)
