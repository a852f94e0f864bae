# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts of a scene: found in the middle of each step, given to the interaction layer as points.

Only what the scene's contacts name is looked for, and only the searches that it calls for exist.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from xper_fx.nscd.laws.law import Law
from xper_fx.nscd.points import InteractionPoints, frame_from_normal
from xper_fx.nscd.search.contacts import Contacts

if TYPE_CHECKING:
    from xper_fx.bulk.bulk import Bulk
    from xper_fx.bulk.scheme import State
    from xper_fx.nscd.interactions import Interactions
    from xper_fx.nscd.rigid.motion import Prediction
    from xper_fx.scene import Scene


# Reach of a search where the scene gives none, as a share of the smallest body's radius.
_REACH = 1e-2


class FoundPoints(NamedTuple):
    """Contacts as interaction points on node slots.

    Attributes:
        points: with gaps in the middle of the step.
        law_of_point: shape (num_points,), index into the laws.
        keys: shape (num_points, 3), sorted: the search, the pair, the feature.
    """

    points: InteractionPoints
    law_of_point: np.ndarray
    keys: np.ndarray


class Detection:
    """The searches that the contacts of a scene call for.

    Args:
        scene: the scene, which has contacts.
        laws: laws of the scene's other interactions; those of contacts are added.

    Attributes:
        nodes: nodes of the mesh at which contacts may come about.
    """

    def __init__(self, scene: Scene, laws: list[Law]):
        self._scene = scene
        self._law_of_pair: dict[tuple[str, str], int] = {}
        for contact in scene.contacts:
            if contact.law is not None:
                if contact.law not in laws:
                    laws.append(contact.law)
                number = laws.index(contact.law)
                self._law_of_pair[contact.between] = number
                self._law_of_pair[contact.between[::-1]] = number
        self._rigid = self._rigid_search()
        self.nodes = np.zeros(0, np.int64)

    def _rigid_search(self):
        """The search between rigid bodies, None if no contact is."""
        bodies = self._scene.rigid_bodies
        names = () if bodies is None else bodies.groups
        wanted = [c for c in self._scene.contacts if c.law is not None and {*c.between} <= {*names}]
        if not wanted:
            return None
        from xper_fx.nscd.search.rigid_search import RigidSearch

        reaches = [c.reach for c in wanted if c.reach is not None]
        self._rigid_laws = np.full((len(names), len(names)), -1)
        for (a, b), law in self._law_of_pair.items():
            if {a, b} <= {*names}:
                self._rigid_laws[names.index(a), names.index(b)] = law
        smallest = float(bodies.shapes.bounding_radius.min())
        return RigidSearch(
            bodies, [c.between for c in wanted], max(reaches, default=_REACH * smallest)
        )

    def renew(
        self,
        interactions: Interactions,
        bulk: Bulk,
        state: State,
        rigid: Prediction | None,
        step: float,
        theta: float,
    ) -> None:
        """Give the interaction layer the contacts of a step.

        Args:
            interactions: the layer.
            bulk: the meshed bodies.
            state: of the meshed bodies, at the start of the step.
            rigid: prediction of the rigid bodies, None without any.
            step: h (s).
            theta: weight of the end of the step.
        """
        found = self._find(rigid, np.zeros(0, int), interactions.bulk_inverse.num_nodes)
        interactions.find_contacts(
            found.points, found.law_of_point, found.keys, np.zeros((0, bulk.dim)), step, theta
        )

    def _find(
        self, rigid: Prediction | None, slot_of_node: np.ndarray, first_rigid: int
    ) -> FoundPoints:
        """The contacts in the middle of a step.

        Args:
            rigid: where the rigid bodies are, None without any.
            slot_of_node: shape (num_nodes,), slot of each node of the mesh.
            first_rigid: first slot of the rigid bodies.
        """
        contacts = self._rigid.find(rigid.position, rigid.rotation)
        group = self._scene.rigid_bodies.group_of[contacts.body]
        law = self._rigid_laws[group[:, 0], group[:, 1]]
        points = _on_slots(contacts, rigid.position, slot_of_node, first_rigid)
        return FoundPoints(points, law, np.pad(contacts.key, ((0, 0), (1, 0))))


def _on_slots(contacts: Contacts, position, slot_of_node, first_rigid: int) -> InteractionPoints:
    """Contacts as interaction points."""
    rigid = contacts.body >= 0
    nodes, weights = contacts.nodes.copy(), contacts.weights.copy()
    meshed = np.broadcast_to(~rigid[:, :, None], nodes.shape)
    nodes[meshed] = slot_of_node[nodes[meshed]]
    nodes[rigid] = first_rigid + 2 * contacts.body[rigid][:, None]
    weights[rigid, 0] = 1.0
    arms = None
    if np.any(rigid):
        arms = contacts.point[:, None] - position[contacts.body]
        arms[~rigid] = 0.0
    return InteractionPoints(
        nodes.astype(np.int32), weights, frame_from_normal(contacts.normal), contacts.area,
        contacts.gap, arms,
    )  # fmt: skip
