# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts of a scene: found in the middle of each step, given to the interaction layer as points.

Only what the scene's contacts name is looked for, and only the searches that it calls for exist.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from dolfinx.fem import functionspace

from xper_fx.nscd.found_contacts import FoundPoints
from xper_fx.nscd.laws.law import Law
from xper_fx.nscd.points import Branches, InteractionPoints, frame_from_normal
from xper_fx.nscd.search.candidate_lists import bodies_of_nodes
from xper_fx.nscd.search.contact_pairs import Contacts, spin_arms
from xper_fx.simulation.contacts_ahead import surface_contacts
from xper_fx.support.ranks import ALONE, Ranks

if TYPE_CHECKING:
    from dolfinx.fem import FunctionSpace

    from xper_fx.bulk.bulk import Bulk
    from xper_fx.bulk.state import State
    from xper_fx.nscd.interactions import Interactions
    from xper_fx.nscd.rigid.motion import Prediction, RigidMotion
    from xper_fx.nscd.search.periodic_search import PeriodicSearch
    from xper_fx.nscd.search.rigid_search import RigidSearch
    from xper_fx.parallel.local_bodies import LocalBodies
    from xper_fx.parallel.rigid_partition import RigidDivision
    from xper_fx.parallel.rigid_share import RigidShare
    from xper_fx.scene.scene import Scene

# Reach of a search where the scene gives none, as a share of the smallest body or facet; without
# inertia the load of a step moves bodies, however large it is, and what is not found is sunk into.
_REACH, _STATIC_REACH = 1e-2, 0.25
# Gaps this small beside the coordinates are closed: a body put down on another rests from the first
# step on, and does not fall for a step to hit it.
_ROUNDING = 1e-12
# Depth of an overlap that coordinates may leave, as a share of the depth that is sought.
_LITTLE = 1e-2


class Detection:
    """The searches that the contacts of a scene call for.

    Args:
        scene: the scene, which has contacts.
        laws: laws of the scene's other interactions.
        V: space of the displacements, None without a mesh.
        part: what this rank has of the meshed bodies, None if it has all.
        ranks: those that divide them.
        rigid_share: what this rank has of rigid bodies beside divided meshed ones, None if all.
        static: whether nothing has inertia, so that hollows hold what is in them by both sides.

    Attributes:
        laws: laws of all interactions: those given, and those of contacts.
        nodes: nodes of V at which contacts may come about.
        reach: largest gap of contacts of surfaces (m); infinite without any.
    """

    def __init__(
        self,
        scene: Scene,
        laws: list[Law],
        V: FunctionSpace | None,
        part: LocalBodies | None = None,
        ranks: Ranks = ALONE,
        rigid_share: RigidShare | None = None,
        static: bool = False,
    ):
        self._static, self._scene = static, scene
        self._ranks, self._rigid_share = ranks, rigid_share
        self._contacts = [contact for contact in scene.contacts if contact.law is not None]
        rigid = () if scene.rigid_bodies is None else scene.rigid_bodies.groups
        names = [*scene.surfaces, *rigid]
        self.laws = list(laws)
        self._law_of_pair = np.full((len(names), len(names)), -1)
        for contact in self._contacts:
            if contact.law not in self.laws:
                self.laws.append(contact.law)
            a, b = (names.index(name) for name in contact.between)
            self._law_of_pair[a, b] = self._law_of_pair[b, a] = self.laws.index(contact.law)
        self._ball_radius: np.ndarray | None = None  # where a law resists rolling
        self._rigid = self._rigid_search(set(rigid))
        self._division: RigidDivision | None = None
        self._surfaces, self._shared, self._listed = None, None, 0
        self.nodes = np.zeros(0, np.int64)
        self._depth = self.reach = np.inf  # the least at which nodes are sought behind facets
        if any(set(contact.between) & set(scene.surfaces) for contact in self._contacts):
            self._surface_search(V, part)

    def _reach(self, contacts, smallest: float) -> float:
        some = (_STATIC_REACH if self._static else _REACH) * smallest
        return max((c.reach for c in contacts if c.reach is not None), default=some)

    def _rigid_search(self, names: set[str]) -> RigidSearch | PeriodicSearch | None:
        if not (contacts := [c for c in self._contacts if set(c.between) <= names]):
            return None
        bodies, pairs = self._scene.rigid_bodies, [c.between for c in contacts]
        reach = self._reach(contacts, float(bodies.shapes.bounding_radius.min()))
        if any(c.law.kernels(bodies.dim).rolling is not None for c in contacts):
            self._ball_radius = bodies.shapes.ball_radius
        from xper_fx.nscd.search.search_of_bodies import search_of_bodies

        return search_of_bodies(bodies, pairs, reach, self._scene.kept_apart, self._scene.lattice)

    def _surface_search(self, V: FunctionSpace, part: LocalBodies | None) -> None:
        from xper_fx.bodies.surfaces import extract_surface
        from xper_fx.nscd.search.surface_search import SurfaceSearch

        scene, own_V = self._scene, V
        if part is not None:
            V = functionspace(scene.bodies.mesh, V.ufl_element())
        surface, at = extract_surface(scene.bodies, V, scene.surfaces).compact()
        self._x = V.tabulate_dof_coordinates()[at, : scene.dim]
        touchable = np.zeros(len(at), bool)
        touchable[surface.facets] = True
        if part is not None:
            from xper_fx.parallel.surface_division import SurfaceDivision

            body, own = np.zeros((2, int(V.dofmap.list.max()) + 1), np.int64)
            body[V.dofmap.list] = scene.bodies.body_of_cell[:, None]
            own[V.dofmap.list[part.cells]] = own_V.dofmap.list
            self._shared = SurfaceDivision(
                self._ranks, part.rank_of_body, body[at], touchable, scene.dim, self._rigid_share
            )
            at, touchable = own[at[self._shared.own]], touchable[self._shared.own]
        self._at, self._touchable, self.nodes = at, touchable, at[touchable]
        contacts = [c for c in self._contacts if set(c.between) & set(scene.surfaces)]
        stored = (c.law.kernels(scene.dim).stored is not None for c in contacts)
        self._hold_slips = scene.dim == 3 and any(stored)
        _, law_of_facet = scene.law_of_facet()
        self._surfaces = SurfaceSearch(
            surface,
            self._x,
            self._reach(contacts, float(surface.size(self._x).min())),
            pairs=[c.between for c in contacts],
            released=law_of_facet < 0,
            rigid=scene.rigid_bodies,
            share=None if self._shared is None else self._shared.search,
            hollows=self._static,
        )
        self._depth, self.reach = float(self._surfaces.depth.min()), self._surfaces.reach
        self._body_of_node = bodies_of_nodes(surface)
        self._group_of_node = np.full(surface.num_nodes, -1)
        self._group_of_node[surface.facets] = surface.group[:, None]
        lips = np.flatnonzero(law_of_facet >= 0)
        group = self._group_of_node[surface.bond_nodes[lips, :, 0]]
        taken = np.all(group >= 0, axis=1) & (self._law_of_pair[group[:, 0], group[:, 1]] >= 0)
        from xper_fx.simulation.parted_lips import PartedLips

        facets = scene.bodies.facets
        here = np.ones(len(lips), bool)
        if self._shared is not None:
            here = self._shared.owns(facets.bodies[lips])
        numbers = np.arange(len(lips))
        self._lips = PartedLips(
            self._surfaces, self._x, facets, lips, numbers, taken, self._ranks, here
        )

    def outrun(self, state: State, rigid: RigidMotion | None, step: float) -> bool:
        """Whether something moves so far in a step (s) that it may pass through another unseen.

        That is a rigid body, or a part of a cluster, by its own radius, a node by the depth that is
        sought behind a facet.
        """
        if rigid is not None:
            shapes = self._scene.rigid_bodies.shapes
            speed = rigid.speeds[shapes.body]
            if shapes.offset.any():
                spin = np.linalg.norm(rigid.state.turn.spin, axis=1)[shapes.body]
                speed += spin * np.linalg.norm(shapes.offset, axis=1)
            if np.any(speed * step > shapes.bounding_radius):
                return True
        if self._surfaces is None:
            return False
        return self._ranks.max(float(np.abs(state.velocity).max(initial=0.0))) * step > self._depth

    def overlap(
        self, interactions: Interactions, state: State, rigid: RigidMotion | None, step: float
    ) -> float:
        """Depth by which surfaces overlap (m) beyond what a step (s) may bring; 0 for little."""
        if self._surfaces is None:
            return 0.0
        speed = float(np.abs(state.velocity).max(initial=0.0))
        if rigid is not None:
            speed += float(np.abs(rigid.state.velocity).max(initial=0.0))
        gaps = [float(group.points.gap.min(initial=0.0)) for group in interactions.contacts]
        speed, deepest = self._ranks.max(np.array([speed, -min(gaps, default=0.0)])).tolist()
        little = _LITTLE * self._depth + 2.0 * speed * step
        return deepest if deepest > little else 0.0

    def divide(self, division: RigidDivision) -> None:
        """Search contacts of rigid bodies, of which the scene has no others, where they are."""
        self._division = division
        self._rigid.divide(division.own)

    def share(self, interactions: Interactions, nodes: np.ndarray) -> None:
        """Take the layer of points where ranks divide meshed bodies.

        Args:
            nodes: as of `renew`.
        """
        if self._shared is not None:
            slot = np.full(nodes.max(initial=-1) + 1, -1)
            slot[nodes] = np.arange(len(nodes))
            slots = np.full(len(self._at), -1)
            slots[self._touchable] = slot[self.nodes]
            self._shared.begin(interactions, slots)

    def join(self) -> None:
        """Let each rank find all contacts until bodies are divided anew."""
        self._division.join()
        self._rigid.search_all()

    @property
    def nbytes(self) -> int:
        """Memory of the searches' lists, in bytes."""
        searches = [search for search in (self._rigid, self._surfaces) if search is not None]
        return sum(search.nbytes for search in searches)

    def renew(
        self,
        interactions: Interactions,
        nodes: np.ndarray,
        bulk: Bulk,
        state: State,
        rigid: Prediction | None,
        step: float,
        theta: float,
    ) -> None:
        """Give the interaction layer the contacts of a step.

        Args:
            nodes: interacting nodes, among the unknowns, in the order of the layer's slots.
            bulk: the meshed bodies.
            state: of the meshed bodies, at the start of the step.
            rigid: prediction of the rigid bodies, None without any.
            step: h (s).
            theta: weight of the end of the step.
        """
        slot = np.zeros(bulk.num_dofs // bulk.dim, np.int64)
        slot[nodes] = np.arange(len(nodes))
        place = (None, None) if rigid is None else (rigid.position, rigid.rotation)
        found = []
        if self._rigid is not None and (self._rigid_share is None or self._rigid_share.is_home):
            gradient = () if self._scene.lattice is None else (rigid.gradient,)
            contacts = self._rigid.find(*place, *gradient)
            found.append((contacts, slot, None))
            if self._division is not None:
                if self._division.found(contacts.body):
                    interactions.share_history(self._division.ranks)
        velocity = state.velocity.reshape(-1, bulk.dim)[nodes]
        halo = interactions.halo
        if self._division is not None:
            halo = self._division.halo
        if self._surfaces is not None:
            middle = state.displacement + step * (1.0 - theta) * state.velocity
            x = self._moved(bulk.unknowns.expand(middle))
            contacts = surface_contacts(self._surfaces, x, rigid, step if self._static else 0.0)
            slot = slot[bulk.unknowns.node_of[self._at]]
            if self._shared is not None:
                contacts = self._own(contacts, interactions)
                slot, halo = self._shared.slot, interactions.halo
            with_rigid = np.any(contacts.body >= 0, axis=1)
            x = self._known_x(x) if self._hold_slips else None
            for which in (~with_rigid, with_rigid):
                found.append((contacts.take(np.flatnonzero(which)), slot, x))
        rigid_slots = self._rigid_slots(len(nodes))
        points = [
            self._on_slots(contacts, rigid, slot_of_node, rigid_slots, x)
            for contacts, slot_of_node, x in found
            if len(contacts)
        ]
        interactions.find_contacts(points, velocity, step, theta, halo)

    def touches(self, bulk: Bulk, state: State) -> bool:
        """Whether surfaces of meshed bodies, of scenes without rigid ones, touch in a state."""
        x = self._moved(bulk.unknowns.expand(state.displacement))
        gap = self._surfaces.find(x, None, None).gap
        return self._ranks.max(float(np.any(gap <= 0.0))) > 0.0

    def _moved(self, displacement: np.ndarray) -> np.ndarray:
        """Where nodes of surfaces are, this rank's own, from displacements of V, flat (m)."""
        own = displacement.reshape(-1, self._scene.dim)[self._at]
        if self._shared is None:
            return self._x + own
        x = self._x.copy()
        x[self._shared.own] += own
        return x

    def _known_x(self, x: np.ndarray) -> np.ndarray:
        """Positions of the nodes that contacts name, after a search at x."""
        return x

    def _moved_with_known(self, displacement: np.ndarray) -> np.ndarray:
        """The same with nodes of bodies of other ranks that this one knows."""
        x = self._moved(displacement)
        if self._shared is not None:
            self._shared.search.refresh(x)
        return x

    def _own(self, contacts: Contacts, interactions: Interactions) -> Contacts:
        """This rank's contacts, wherever they were found; the ghosts that they need are there."""
        lists, shared = self._surfaces.lists, self._shared
        if lists.changes != self._listed:
            self._listed = lists.changes
            shared.take_ghosts(interactions, lists.pairs_of_bodies())
        main = np.take_along_axis(contacts.nodes, contacts.weights.argmax(axis=2)[..., None], 2)
        bodies = self._body_of_node[main[..., 0]]
        rigid = contacts.body >= 0
        bodies[rigid] = self._scene.bodies.num_bodies + contacts.body[rigid]
        contacts, some_moved = shared.hand_over(contacts, bodies)
        if some_moved:
            interactions.share_history(self._ranks)
        return contacts

    def _rigid_slots(self, first: int) -> np.ndarray:
        """First of the two slots of each rigid body; without ranks from `first` on."""
        if self._shared is not None:
            return self._shared.slot_of_rigid
        bodies, share = self._scene.rigid_bodies, self._rigid_share
        slots = np.zeros(0 if bodies is None else len(bodies), np.int64)
        here = slice(None) if share is None else share.here
        slots[here] = first + 2 * np.arange(len(slots[here]))
        return slots

    def _on_slots(
        self, contacts: Contacts, prediction: Prediction | None, slot_of_node, rigid_slots, x
    ) -> FoundPoints:
        """Contacts as interaction points, with their laws; x as `spin_arms`, or None."""
        rigid = contacts.body >= 0
        nodes, weights = contacts.nodes.copy(), contacts.weights.copy()
        group = np.empty(rigid.shape, np.int64)
        if not np.all(rigid):
            main = np.take_along_axis(nodes, weights.argmax(axis=2)[..., None], axis=2)[..., 0]
            group[~rigid] = self._group_of_node[main[~rigid]]
            nodes[~rigid] = slot_of_node[nodes[~rigid]]
        lever_arms = branches = None
        if np.any(rigid):
            bodies = self._scene.rigid_bodies
            group[rigid] = len(self._scene.surfaces) + bodies.group_of[contacts.body[rigid]]
            nodes[rigid] = rigid_slots[contacts.body[rigid]][:, None]
            weights[rigid, 0] = 1.0
            centre = prediction.position[contacts.body]
            if self._scene.lattice is not None:
                centre += self._rigid.offset
            lever_arms = contacts.point[:, None] - centre
            lever_arms[~rigid] = 0.0
            if prediction.gradient is not None:
                apart = np.linalg.solve(prediction.gradient, (centre[:, 0] - centre[:, 1]).T)
                cell = rigid_slots[0] + 2 * len(bodies)
                branches = Branches(cell, np.ascontiguousarray(apart.T))
        round_radius = None
        if self._ball_radius is not None and np.all(rigid):
            radius = self._ball_radius[contacts.body]
            curvature = np.divide(1.0, radius, out=np.zeros(radius.shape), where=radius > 0.0)
            total = curvature.sum(axis=1)
            round_radius = np.divide(1.0, total, out=total, where=total > 0.0)
        gap = contacts.gap.copy()
        gap[np.abs(gap) <= _ROUNDING * np.abs(contacts.point).max(axis=1)] = 0.0
        points = InteractionPoints(
            nodes.astype(np.int32), weights, frame_from_normal(contacts.normal), contacts.area,
            gap, lever_arms, round_radius, branches=branches,
        )  # fmt: skip
        law = self._law_of_pair[group[:, 0], group[:, 1]]
        return FoundPoints(points, law, contacts.key, None if x is None else spin_arms(contacts, x))

    def release(self, interactions: Interactions, each: int, displacement: np.ndarray) -> None:
        """After a step, let the search take over the broken lips that have parted or turned.

        Args:
            interactions: the layer, whose permanent points come facet after facet.
            each: points on a facet.
            displacement: at the end of the step, of all nodes of V, flat (m).
        """
        if self._shared is not None:
            self._shared.commit()
        if self._surfaces is not None:
            self._lips.release(interactions, each, lambda: self._moved_with_known(displacement))

    def saved(self) -> dict:
        """Lists' origins, broken lips and those that have retired."""
        out = {}
        if self._rigid is not None:
            out["rigid"] = self._rigid.saved()
            if self._rigid_share is not None:
                out["rigid"] = self._rigid_share.from_home(out["rigid"])
        if self._division is not None:
            out["division"] = self._division.saved()
        if self._surfaces is not None:
            out["surfaces"] = self._surfaces.lists.saved()
            if self._shared is not None and out["surfaces"]:
                self._shared.fill_in(out["surfaces"]["x"])
            out |= self._lips.saved()
        return out

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave, its rows in order."""
        if self._division is not None and "division" in saved:
            self._division.restore(saved["division"])
        if self._rigid is not None:
            self._rigid.restore(saved.get("rigid", {}))
        if self._surfaces is not None and "surfaces" in saved:
            self._lips.restore(saved)
            self._surfaces.lists.restore(saved["surfaces"])
