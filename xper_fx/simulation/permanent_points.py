# SPDX-License-Identifier: LGPL-3.0-or-later
"""The permanent interaction points of a scene: on facing facets, in ties, on walls."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from xper_fx.bodies.meshes import cell_measure, local_facet_vertices
from xper_fx.nscd.facets import (
    facet_points,
    join_points,
    no_points,
    nodal_shares,
    wall_points,
    with_lips,
)
from xper_fx.nscd.points import InteractionPoints

if TYPE_CHECKING:
    from xper_fx.bulk.bulk import Bulk
    from xper_fx.nscd.inverse_blocks import BodyInverse
    from xper_fx.nscd.mortar import TiedPoints
    from xper_fx.parallel.halo import Halo
    from xper_fx.parallel.local_bodies import LocalBodies
    from xper_fx.scene.scene import Scene
    from xper_fx.simulation.contact_detection import Detection

# Gaps this small beside the coordinates are closed.
_ROUNDING = 1e-12


class ScenePoints:
    """Points on nodes among this rank's unknowns; ghosts of others' come next, the ground last.

    Args:
        bulk: of its meshed bodies, or an empty one.
        ties: points of each tie on this rank's candidates.
        part: what this rank has of the bodies, None if one rank has all.
        by_vertex: whether each vertex is solved alone.

    Attributes:
        laws: of the scene's facets, ties and walls.
        facets_with_law: shape (n,), which facing facets of the scene's bodies have points, on any
            rank.
        facet_numbers: shape (n,), their numbers among such facets of the scene.
        points_a_facet: points on each.
    """

    def __init__(
        self,
        scene: Scene,
        bulk: Bulk,
        ties: list[TiedPoints],
        part: LocalBodies | None,
        by_vertex: bool,
    ):
        self._scene, self._bulk, self._part, self._by_vertex = scene, bulk, part, by_vertex
        self.laws, self.points_a_facet = [], 0
        self.facets_with_law = self.facet_numbers = np.zeros(0, int)
        self._shared = None
        self._turns = scene.bodies is not None and bulk.forms.finite_strain
        self._num_nodes = self._ground = bulk.num_dofs // bulk.dim
        self._points, self._law_of_point = [], [np.zeros(0, int)]
        self._ties = ties if part is not None else [tied.on(tied.node) for tied in ties]
        self._numbers: list[np.ndarray] = []
        self._on_walls: list[np.ndarray] = []
        if scene.bodies is not None:
            self._take_facets()
            for tie, tied in zip(scene.ties, self._ties, strict=True):
                self._take(tied.points, tie.law)
            self._take_walls()

    @property
    def exist(self) -> bool:
        """Whether the scene has points; this rank may have none of them."""
        return (len(self._points) if self._part is None else self._num_points_of_all) > 0

    @property
    def law_of_point(self) -> np.ndarray:
        """Number in `laws` of each point's, shape (num_points,)."""
        return np.concatenate(self._law_of_point)

    def on_facets(self) -> tuple[np.ndarray, np.ndarray]:
        """Place of this rank's points among those of `facets_with_law`, and their law."""
        if not self.points_a_facet:
            return np.zeros(0, int), np.zeros(0, int)
        if self._shared is None:
            return np.arange(len(self._points[0])), self._law_of_point[1]
        facet, on_facet = np.divmod(self._shared.numbers, self.points_a_facet)
        place = np.searchsorted(self.facet_numbers, facet)
        return place * self.points_a_facet + on_facet, self._law_of_point[1]

    def apart_from_facets(self) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Position, normal (shape (n, dim)) and area of the points of each tie and wall."""
        x = [tied.x for tied in self._ties] + self._on_walls
        others = zip(x, self._points[len(self._points) - len(x) :], strict=True)
        return [(x, points.frame[:, 0], points.area) for x, points in others]

    def bodies_of_points(self) -> np.ndarray:
        """Candidate and antagonist of the points on facets and in ties, on all ranks.

        All ranks call it together.

        Returns:
            Shape (num_points, 2), int; points of walls, which come last in the scene, are left out.
        """
        if self._scene.bodies is None:
            return np.zeros((0, 2), int)
        pairs = self._scene.bodies.facets.bodies[self.facets_with_law]
        facing = np.repeat(pairs, self.points_a_facet, axis=0)
        if not self._ties:
            return facing
        tied = np.concatenate([tied.bodies for tied in self._ties])
        if self._part is not None:
            numbers = np.concatenate(self._numbers[1 : 1 + len(self._ties)])
            tied = self._bulk.ranks.gather(numbers - len(facing), tied)
        return np.concatenate([facing, tied])

    def bodies_of_own_points(self) -> np.ndarray:
        """As `bodies_of_points`, of this rank's points, by numbers that all ranks have alike."""
        bodies = self._scene.bodies
        if bodies is None:
            return np.zeros((0, 2), int)
        facet = self.on_facets()[0] // max(self.points_a_facet, 1)
        pairs = bodies.facets.bodies[self.facets_with_law[facet]]
        tied = [tied.bodies for tied in self._ties]
        return np.concatenate([bodies.numbers_on_all(pairs), *tied])

    def _take(self, points: InteractionPoints, law) -> None:
        if law not in self.laws:
            self.laws.append(law)
        self._points.append(points)
        self._law_of_point.append(np.full(len(points), self.laws.index(law)))

    def _take_facets(self) -> None:
        scene = self._scene
        self.laws, law_of_facet = scene.law_of_facet()
        self.facets_with_law = np.flatnonzero(law_of_facet >= 0)
        self.facet_numbers = np.arange(len(self.facets_with_law))
        if self._part is not None:
            self._share_facets(law_of_facet)
        elif len(self.facets_with_law):
            facets = scene.bodies.facets
            nodes = scene.bodies.facing_nodes(self._bulk.forms.V)[self.facets_with_law]
            points = facet_points(
                self._bulk.unknowns.node_of[nodes],
                facets.normal[self.facets_with_law],
                facets.measure[self.facets_with_law],
                scene.points,
            )
            if self._turns:
                x = scene.bodies.facet_nodes(scene.order)[self.facets_with_law]
                points = with_lips(points, self._bulk.unknowns.node_of[nodes], x, scene.points)
            self.points_a_facet = len(points) // len(self.facets_with_law)
            law = law_of_facet[self.facets_with_law]
            self._points.append(points)
            self._law_of_point.append(np.repeat(law, self.points_a_facet))

    def _share_facets(self, law_of_facet: np.ndarray) -> None:
        from xper_fx.parallel.shared_points import shared_points

        bulk = self._bulk
        shared = self._shared = shared_points(
            self._scene.bodies, self._part, bulk.ranks, bulk.forms.V, bulk.unknowns.node_of,
            self._num_nodes, law_of_facet, self._scene.points, self._by_vertex, self._turns,
        )  # fmt: skip
        self.facet_numbers = shared.facet_numbers
        self.points_a_facet = shared.points_a_facet
        self._numbers.append(shared.numbers)
        if self._ties:
            from xper_fx.parallel.shared_ties import share_ties

            given = share_ties(shared, self._ties, bulk.ranks, self._num_nodes)
            shared = self._shared = given.shared
            self._ties = given.ties
            self._numbers += given.numbers
        self._num_points_of_all = shared.num_points_of_all
        self._ground += sum(map(len, shared.ghosts.values()))
        self._points.append(shared.points)
        self._law_of_point.append(shared.law_of_point)

    def _take_walls(self) -> None:
        k = self._points[0].nodes.shape[2] if self._points else 1
        for wall in self._scene.walls:
            normal = np.asarray(wall.normal, float) / np.linalg.norm(wall.normal)
            nodes, area, x = self._on_wall(wall.facets)
            if self._part is not None:
                nodes, area, x = self._share_wall(nodes, area, x)
            away = x - np.asarray(wall.point, float)
            gap = away @ normal
            # a gap of rounding would leave a body that rests on the wall without it for a step
            size = self._bulk.ranks.max(np.abs(np.concatenate([x, away])).max(initial=0.0))
            gap[np.abs(gap) <= _ROUNDING * size] = 0.0
            self._take(wall_points(nodes, area, normal, gap, self._ground, k), wall.law)
            self._on_walls.append(x)

    def _on_wall(self, tag: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Nodes of this rank's tagged facets, with their shares of the facets, and positions."""
        V, dim = self._bulk.forms.V, self._scene.dim
        bodies = self._scene.bodies if self._part is None else self._part.bodies
        mesh = bodies.mesh
        fdim = mesh.topology.dim - 1
        mesh.topology.create_connectivity(fdim, fdim + 1)
        mesh.topology.create_connectivity(fdim + 1, fdim)
        cells = mesh.topology.connectivity(fdim, fdim + 1)
        facets_of = mesh.topology.connectivity(fdim + 1, fdim)
        x = V.tabulate_dof_coordinates()[:, :dim]
        area = np.zeros(self._ground)
        corners_of = local_facet_vertices(mesh).shape[1]
        kind = {2: "interval", 3: "triangle", 4: "quadrilateral"}[corners_of]
        for facet in bodies.facet_tags.find(tag):
            cell = cells.links(facet)[0]
            local = int(np.flatnonzero(facets_of.links(cell) == facet)[0])
            nodes = V.dofmap.list[cell][V.dofmap.dof_layout.entity_closure_dofs(fdim, local)]
            corners = np.zeros((1, corners_of, 3))
            corners[0, :, :dim] = x[nodes[:corners_of]]
            area[nodes] += cell_measure(kind, corners) * nodal_shares(fdim + 1, len(nodes))
        nodes = np.flatnonzero(area > 0.0)
        return nodes, area[nodes], x[nodes]

    def _share_wall(self, nodes: np.ndarray, area: np.ndarray, x: np.ndarray):
        """Which of the points on a wall this rank has, by what `_on_wall` gave."""
        from xper_fx.parallel.shared_walls import share_wall

        part, dofmap = self._part, self._bulk.forms.V.dofmap.list
        # nodes are numbered as cells name them first, where all are on one rank, too
        _, first = np.unique(dofmap, return_index=True)
        cell, local = np.divmod(first[nodes], dofmap.shape[1])
        of_all = part.cells if self._scene.bodies.spread is None else part.bodies.parent_cell
        order = of_all[cell].astype(np.int64) * dofmap.shape[1] + local
        wall = order, nodes, area, x
        wall, numbers = share_wall(
            self._shared, self._bulk.ranks, self._num_nodes, self._by_vertex, wall
        )
        self._numbers.append(self._num_points_of_all + numbers)
        self._num_points_of_all += int(self._bulk.ranks.sum(len(numbers)))
        return wall[1:]

    def place(self, point: int) -> np.ndarray:
        """Where a point's facet was at the start, shape (dim,), m; NaN of ties and walls.

        Of a mesh that is spread a rank has some facets: all ranks ask together, and all hear of it.

        Args:
            point: its number in the scene's order.
        """
        if self._scene.bodies is None:
            return np.full(self._scene.dim, np.nan)
        here = self.facet_numbers == point // max(self.points_a_facet, 1)
        facets = self.facets_with_law[here]
        own = self._scene.bodies.facets.midpoint[facets].max(axis=0, initial=-np.inf)
        place = self._bulk.ranks.max(own)
        return np.where(np.isfinite(place), place, np.nan)

    def interacting(self, detection: Detection | None) -> np.ndarray:
        """Nodes at which interactions act or contacts may come about, body by body."""
        nodes = self._bulk.layout.nodes
        acts = np.zeros(self._ground + 1, bool)
        for points in self._points:
            acts[points.nodes] = True
            if points.lips is not None:
                acts[points.lips.nodes] = True
        if self._shared is not None:
            for asked in self._shared.asked.values():
                acts[asked] = True
        if detection is not None:
            acts[self._bulk.unknowns.node_of[detection.nodes]] = True
        return nodes[acts[nodes]]

    def on_slots(
        self, inverse, rigid_blocks: np.ndarray | None = None
    ) -> tuple[InteractionPoints, Halo | None]:
        """The points on slots of an inverse, and what is exchanged with other ranks.

        Args:
            inverse: one of `xper_fx.bulk.body_inverse`, of at least the `interacting` nodes.
            rigid_blocks: blocks of w of this rank's rigid bodies, whose slots come next; None
                without any.
        """
        blocks = inverse.blocks
        if rigid_blocks is not None:
            blocks = blocks.joined(rigid_blocks, self._by_vertex)
        slot = np.full(self._ground + 1, blocks.num_nodes)
        slot[inverse.nodes] = np.arange(len(inverse.nodes))
        halo = None if self._shared is None else self._halo(blocks, slot)
        points = join_points(self._points).on(slot) if self._points else no_points(self._bulk.dim)
        if halo is not None and not self._by_vertex:
            halo.divide(points)
        return points, halo

    def _halo(self, blocks: BodyInverse, slot: np.ndarray) -> Halo:
        """What is exchanged with other ranks; the slots of ghosts and ground are set."""
        from xper_fx.parallel.halo import Halo

        shared, numbers = self._shared, np.concatenate(self._numbers)
        given = {rank: slot[asked] for rank, asked in shared.asked.items()}
        halo = Halo(self._bulk.ranks, blocks, given, numbers, shared.at_points)
        slot[self._num_nodes : -1] = np.concatenate(
            [np.zeros(0, int), *(halo.wanted[rank] for rank in shared.ghosts)]
        )
        slot[-1] = halo.num_slots
        return halo
