# SPDX-License-Identifier: LGPL-3.0-or-later
"""A search for contacts of bodies of a mesh that is spread over ranks.

A rank holds the surfaces of its own bodies. Whenever lists are made anew the ranks tell each other
one box around all of their bodies, those whose boxes overlap the boxes of their bodies there, and
each gives the others its bodies whose boxes overlap some of theirs: their facets, and the positions
of their nodes from then on. Nothing else of other ranks is known, and nothing has the size of the
whole. Rigid bodies, which all ranks know, have boxes on one rank each, which looks at their corners
and centres.

Which nodes bonds weld is known to the ranks of all cells at a vertex. Fragments reach over ranks:
the smallest number of their bodies goes from neighbour to neighbour until none changes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from xper_fx.bodies.explode import Bodies
from xper_fx.bodies.keepers import JoinedNumbers
from xper_fx.nscd.rigid.bodies import RigidBodies
from xper_fx.nscd.search.bonded_facets import Bonds
from xper_fx.nscd.search.contact_pairs import Contacts
from xper_fx.nscd.search.grid import box_pairs
from xper_fx.nscd.search.rigid_side import RigidSide
from xper_fx.nscd.search.surface import Surface
from xper_fx.nscd.search.surface_search import SurfaceSearch, renamed
from xper_fx.parallel.exchange import Exchange
from xper_fx.parallel.known_surface import MOST, OwnSurface, Tables, joined
from xper_fx.support.ranks import Ranks


class KnownBodies:
    """A rank's bodies and those that others have given it, as a `SearchShare`.

    Attributes:
        tables: of these bodies.
        own_body, own_node, body_of_node, own_rigid, known: see `SearchShare`.
    """

    def __init__(
        self,
        ranks: Ranks,
        tables: Tables,
        given: Sequence[np.ndarray],
        own_rigid: np.ndarray,
    ):
        """Take the tables of all bodies that are known; all ranks call it together.

        Args:
            tables: of own bodies and of those of others.
            given: by rank, own nodes that it knows, by their numbers, ascending.
            own_rigid: see `SearchShare`.
        """
        self._ranks, self.tables = ranks, tables
        node, rank = tables.node, tables.rank
        self.body_of_node = np.zeros(len(node), np.int32)
        place = np.searchsorted(node, tables.corners)
        body = np.searchsorted(tables.which, tables.body)
        self.body_of_node[place] = body[:, None]
        self.own_body = rank == ranks.rank
        self.own_node = self.own_body[self.body_of_node]
        self.own_rigid = own_rigid
        self.known = np.ones(len(rank), bool)
        self.corners, self.body = place, body
        rank_of_node = rank[self.body_of_node]
        there = {r: np.searchsorted(node, n) for r, n in enumerate(given) if len(n)}
        here = {r: np.flatnonzero(rank_of_node == r) for r in np.unique(rank).tolist()}
        here.pop(ranks.rank, None)
        self._exchange = Exchange(ranks, there, here, tables.start.shape[1])

    def meet(self, x, low, high, others, joined) -> None:
        """Bodies have met before the search was made."""

    def refresh(self, x: np.ndarray) -> None:
        """Fill in the positions of other ranks' nodes."""
        self._exchange.forward(x.reshape(-1))

    def largest(self, values: np.ndarray) -> np.ndarray:
        """The largest of each entry over the ranks."""
        return self._ranks.max(values)


class SpreadSearch:
    """A rank's search; ranks call its methods together unless they say otherwise.

    Args:
        bodies: those known here of a mesh that is spread.
        own: the surface of this rank's.
        reach: largest gap of a contact (m).
        pairs: names of groups that may touch.
        released: facing facets that never held, shape (num_facets,), bool.
        hollows: as of `SurfaceSearch`.
        rigid: the rigid bodies, and the rank of each, shape (num_rigid,); None without any.

    Attributes:
        reach: as given.
        surface: of own bodies, with all bonds that are known here.
        own: its nodes that are on facets, and so of own bodies, shape (n,).
        depth: the smallest, over all ranks, at which nodes behind a facet are sought (m).
        known: `KnownBodies` of the last search.
        x: shape (num_nodes, dim), positions of the nodes known in the last search (m).
        meetings: how often ranks have given each other bodies.
    """

    def __init__(
        self,
        ranks: Ranks,
        bodies: Bodies,
        own: OwnSurface,
        reach: float,
        pairs: Sequence[tuple[str, str]],
        released: np.ndarray,
        hollows: bool,
        rigid: tuple[RigidBodies, np.ndarray] | None = None,
    ):
        self.surface, self._ranks = own.surface, ranks
        solids, rank_of_rigid = (None, np.zeros(0, int)) if rigid is None else rigid
        self._rigid = RigidSide(solids, own.surface, pairs)
        self._own_rigid = rank_of_rigid == ranks.rank
        self._node, self._facet, self._start = own.node, own.facet, own.start
        self.reach, self._pairs, self._hollows = reach, pairs, hollows
        self._bonds = Bonds(own.surface, released)
        self._around = None if own.with_hidden is None else Bonds(own.with_hidden, released)
        rank_of_body = bodies.spread.rank_of_body
        self._rank_of_body, self._rank_of_node = rank_of_body, rank_of_body[own.body_of_node]
        self.own = np.unique(own.surface.facets)
        self._number_of_body = bodies.labels
        self._body_of_node = own.body_of_node
        search = SurfaceSearch(own.surface, own.start, reach, pairs=pairs, rigid=self._rigid)
        self._extent = search.extent
        sizes = own.surface.size(own.start)
        self.depth = -ranks.max(-float(search.depth.min(initial=np.inf)))
        self._typical = ranks.max(float(np.median(sizes)) if len(sizes) else 0.0)
        self._joined = JoinedNumbers(ranks, bodies.labels)
        self._fragment = self._fragments()
        self._search: SurfaceSearch | None = None
        self._stale, self.meetings, self._skin = False, 0, 0.1 * self._typical

    @property
    def nbytes(self) -> int:
        """Memory of the lists, in bytes."""
        return 0 if self._search is None else self._search.nbytes

    @property
    def lists_made(self) -> tuple[int, int]:
        """Changes when lists have been made anew."""
        return self.meetings, self._search.lists.changes

    def leave_ajar(self, bonds: np.ndarray) -> None:
        """Let rigid bodies touch nodes of bonds that are open at some points, as `SurfaceSearch`.

        This rank alone calls it, as the next two.
        """
        self._bonds.leave_ajar(bonds)
        self._stale |= len(self._own_rigid) > 0

    def expose(self, bonds: np.ndarray) -> None:
        """Free the facets of bonds that broke, as `SurfaceSearch.expose`."""
        self._bonds.expose(bonds)
        if self._around is not None:
            self._around.expose(bonds)
        self._stale = True

    def release(self, bonds: np.ndarray) -> None:
        """Let the lips of broken bonds meet like any facets, as `SurfaceSearch.release`."""
        self._bonds.release(bonds)
        if self._around is not None:
            self._around.release(bonds)
        self._stale = True

    def find(
        self,
        x: np.ndarray,
        position: np.ndarray | None = None,
        rotation: np.ndarray | None = None,
    ) -> Contacts:
        """The contacts that own nodes and edges have; nodes are those of `known`.

        Args:
            x: shape (len(own), dim), positions of own nodes (m).
            position, rotation: as of `SurfaceSearch`.
        """
        self._rigid.move(position, rotation)
        stale = self._search is None or self._ranks.max(float(self._stale)) > 0.0
        if not stale:
            self.x[self.known.own_node] = x
            if not self._search.lists.are_old(self.x):
                self.known.refresh(self.x)
                self._search.lists.searches += 1
                return self._renamed(self._search.find_in_lists(self.x))
            self._skin = self._search.lists.skin
        self._meet(x)
        return self._renamed(self._search.find(self.x, position, rotation))

    def pairs_of_bodies(self) -> np.ndarray:
        """Bodies of `known` in the lists, shape (n, 2); rigid ones are numbered after them."""
        return self._search.lists.pairs_of_bodies()

    def at_surface(self, x: np.ndarray) -> np.ndarray:
        """Where nodes of `surface` are, those of bodies that are not known at the start.

        Args:
            x: as of `find`.
        """
        at = self._start.copy()
        if self._search is None:
            self._meet(x)
        there = self.x.copy()
        there[self.known.own_node] = x
        self.known.refresh(there)
        node = self.known.tables.node
        found = np.isin(self._node, node)
        at[found] = there[np.searchsorted(node, self._node[found])]
        return at

    def _renamed(self, contacts: Contacts) -> Contacts:
        tables = self.known.tables
        return Contacts(*contacts[:-1], renamed(contacts.key, tables.node, tables.facet))

    def _meet(self, x: np.ndarray) -> None:
        """Know the bodies of other ranks that own ones may touch, or that are welded to them."""
        if self._ranks.max(float(self._stale)) > 0.0:
            self._fragment = self._fragments()
        own = self._tables()
        given = [own.of(bodies) for bodies in self._given(x)]
        got = self._ranks.comm.alltoall(given)
        got[self._ranks.rank] = own
        tables = joined(got)
        nodes = [part.node for part in given]
        nodes[self._ranks.rank] = own.node[:0]
        known = self.known = KnownBodies(self._ranks, tables, nodes, self._own_rigid)
        surface = Surface(
            known.corners, known.body, len(tables.node), tables.group, self.surface.groups,
            thickness=tables.thickness,
        )  # fmt: skip
        search = self._search = SurfaceSearch(
            surface, tables.start, self.reach, pairs=self._pairs, rigid=self._rigid, share=known,
            typical_size=self._typical, hollows=self._hollows,
        )  # fmt: skip
        search.bonds.exposed[:], search.bonds.ajar[:] = tables.exposed, tables.ajar
        search.bonds.weld[:] = np.unique(tables.weld, return_inverse=True)[1]
        search.bonds.fragment[:] = tables.fragment
        if surface.dim == 3:
            search.bonds.edges = tables.edges
        search.lists.skin = self._skin
        self.x = tables.start.copy()
        self.x[known.own_node] = x
        known.refresh(self.x)
        self.meetings += 1
        self._stale = False

    def _tables(self) -> Tables:
        """Of own bodies."""
        surface, own, bodies = self.surface, self.own, np.unique(self.surface.body)
        return Tables(
            self._facet, self._node[surface.facets], self._number_of_body[surface.body],
            surface.group, surface.thickness, self._bonds.exposed, self._bonds.ajar, self._edges(),
            self._node[own], self._start[own], self._node[self._bonds.weld[own]],
            self._number_of_body[bodies], self._fragment[bodies],
            np.full(len(bodies), self._ranks.rank),
        )  # fmt: skip

    def _edges(self) -> np.ndarray:
        """Which edges of own exposed facets are one, by numbers that all ranks have alike.

        All bodies around an edge of one's own are known, and the bonds between them.
        """
        if self._around is None:
            return np.zeros((len(self.surface), 0), np.int64)
        out = np.full((len(self.surface), 3), -1, np.int64)
        exposed = np.flatnonzero(self._bonds.exposed)
        ends = np.divmod(self._around.joined_edges(exposed), self.surface.num_nodes)
        out[exposed] = self._node[ends[0]] * MOST + self._node[ends[1]]
        return out

    def _given(self, x: np.ndarray) -> list[np.ndarray]:
        """By rank, numbers of own bodies that it is to know."""
        ranks, low, high = self._ranks, *self._boxes(x)
        bodies = np.flatnonzero((low <= high).all(axis=1))
        count, of_rigid = len(bodies), self._boxes_of_rigid()
        both = zip((low, high), of_rigid, strict=True)
        low, high = (np.concatenate([meshed[bodies], rigid]) for meshed, rigid in both)
        box = low.min(axis=0, initial=np.inf), high.max(axis=0, initial=-np.inf)
        of_ranks = np.array(ranks.comm.allgather(box))
        told, looked = [], []
        for rank in range(ranks.size):
            near = (low <= of_ranks[rank, 1]).all(axis=1) & (of_ranks[rank, 0] <= high).all(axis=1)
            looked.append(np.flatnonzero(near) if rank != ranks.rank else np.zeros(0, int))
            told.append((low[looked[-1]], high[looked[-1]]))
        heard = ranks.comm.alltoall(told)
        out = []
        for rank, (low_there, high_there) in enumerate(heard):
            here, near = looked[rank][looked[rank] < count], np.zeros(0, int)
            if len(here) and len(low_there):
                met = box_pairs(low[here], high[here], low_there, high_there)
                near = bodies[here[np.unique(met[:, 0])]]
            out.append(np.unique(np.concatenate([near, self._welded_to(rank)])))
        if self.surface.dim == 3:
            out = self._with_joined(out)
        return [self._number_of_body[bodies] for bodies in out]

    def _with_joined(self, given: list[np.ndarray]) -> list[np.ndarray]:
        """Own bodies that ranks are to know, and those that share welds with what they are given.

        Whether an edge is convex hangs on all facets that have it, of bodies of any ranks.

        Args:
            given: by rank, own bodies.
        """
        ranks, weld, body = self._ranks, self._bonds.weld, self._body_of_node
        asked: list[list] = [[np.zeros((0, 2), np.int64)] for _ in range(ranks.size)]
        for rank, bodies in enumerate(given):
            if not len(bodies):
                continue
            there = np.zeros(len(weld), bool)
            there[weld[np.isin(body, bodies)]] = True
            joined = np.unique(body[there[weld]])
            of_rank = self._rank_of_body[joined]
            for other in np.setdiff1d(of_rank, [rank]):
                numbers = self._number_of_body[joined[of_rank == other]]
                asked[other].append(np.column_stack([np.full(len(numbers), rank), numbers]))
        heard = np.concatenate(ranks.comm.alltoall([np.concatenate(rows) for rows in asked]))
        place = np.searchsorted(self._number_of_body, heard[:, 1])
        return [np.union1d(bodies, place[heard[:, 0] == rank]) for rank, bodies in enumerate(given)]

    def _boxes(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Boxes around bodies that hold what may touch own ones, of others inf and -inf."""
        surface, at = self.surface, self._start.copy()
        at[self.own] = x
        beyond = (self._extent + self._skin)[:, None]
        corners = at[surface.facets]
        low = np.full((len(self._number_of_body), surface.dim), np.inf)
        high = np.full(low.shape, -np.inf)
        np.minimum.at(low, surface.body, corners.min(axis=1) - beyond)
        np.maximum.at(high, surface.body, corners.max(axis=1) + beyond)
        return low, high

    def _boxes_of_rigid(self) -> tuple[np.ndarray, np.ndarray]:
        """Boxes around own rigid bodies but walls, where they were put last."""
        side = self._rigid
        if not len(side.solids):
            return np.zeros((2, 0, self.surface.dim))
        own = side.solids[self._own_rigid[side.shapes.body[side.solids]]]
        centre, radius = side.position[own], side.bounding[own, None]
        return centre - radius, centre + radius

    def _welded_to(self, rank: int) -> np.ndarray:
        """Own bodies that bonds weld to some of a rank."""
        weld, there = self._bonds.weld, self._rank_of_node == rank
        if rank == self._ranks.rank or not there.any():
            return np.zeros(0, int)
        met = np.zeros(len(weld), bool)
        met[weld[there]] = True
        return np.unique(self._body_of_node[self.own[met[weld[self.own]]]])

    def _fragments(self) -> np.ndarray:
        """Smallest number of the bodies that bonds connect, over all ranks, of each known body."""
        here = np.arange(len(self._number_of_body))
        fragment = self._bonds.fragment
        return self._joined.smallest(np.column_stack([here[: len(fragment)], fragment]))
