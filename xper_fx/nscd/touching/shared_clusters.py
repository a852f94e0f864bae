# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts beside vertices that are solved alone, where ranks divide both.

A vertex is on the rank of the first of its bodies, a contact on that of one of its two bodies, and
a cluster of cells may be touched by contacts of several ranks. Turns are those of
`touching_clusters.py`. In each of them

1. a rank solves those of its vertices that contacts touch, whosesoever these are,
2. ranks with contacts are told the velocity and one over the mass of each cluster there, and the
   number by which all know it, that of its first corner,
3. all contacts are told to all ranks, what stays in a step once, each of which sweeps all of them
   in the same order. The bits are the same, and so are the decisions,
4. corners and rigid bodies get the impulses that the contacts of all ranks give them.

Rigid bodies have velocities and blocks of w on all ranks, each of which moves all of them as it
sweeps.

**Limitation.** Sweeps over contacts are not divided, only what is done at vertices.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from xper_fx.nscd.contact_history import kernels_of_contacts
from xper_fx.nscd.couplings import Couplings
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.laws.law import LawKernels
from xper_fx.nscd.solvers.solver import SolveOptions, SolveReport
from xper_fx.nscd.touching.touching_clusters import SweptContacts, TouchingClusters

if TYPE_CHECKING:
    from xper_fx.nscd.splitting.fused_points import FusedPoints
    from xper_fx.nscd.touching.loose_vertices import LooseVertices


class SharedClusters(TouchingClusters):
    """The contacts of all ranks in a step, and this rank's vertices that they touch.

    Arguments are those of `TouchingClusters`; ghosts have the velocities of their owners. All ranks
    do everything together.
    """

    def __init__(
        self,
        interactions: Interactions,
        at: FusedPoints | LooseVertices,
        velocity: np.ndarray,
        move: Callable[[np.ndarray], SolveReport],
        options: SolveOptions,
    ):
        self._halo = halo = interactions.halo
        super().__init__(interactions, at, velocity, move, options)
        self._nodes = super()._touched_slots()
        count, own = len(self._velocity), interactions.own_inverse.num_nodes
        first = halo.ranks.before(own)
        number = np.empty((count, interactions.dim))
        number[:] = np.arange(first, first + count)[:, None]
        # rigid bodies are numbered as in the scene, after all that is meshed
        blocks, first_rigid = interactions.rigid_blocks_of_all, int(interactions.total(own))
        self._rigid = blocks, first_rigid
        self._mobility_of_rigid = np.einsum("bii->bi", blocks).reshape(-1, interactions.dim)
        in_scene = np.arange(first_rigid, first_rigid + 2 * len(blocks)).reshape(-1, 2)
        interactions.own_rigid(number)[:] = interactions.own_of_rigid(in_scene).reshape(-1, 1)
        halo.everywhere.forward(number.reshape(-1))
        number[-1] = first_rigid + 2 * len(blocks)  # the ground
        self._number = number
        places = number[:, 0].astype(np.int64)
        self._turned = [c and _at_places(c, places.__getitem__) for c in self._turned]
        # of each slot its cluster's number and one over its mass, and a slot for it at contacts
        self._known_number, self._known_mobility = self._number.copy(), self._mobility.copy()
        self._known_root = self._root.copy()
        laws = kernels_of_contacts(interactions.laws, interactions.dim)
        self._of_all = self._contacts_of_all(laws)

    def _contacts_of_all(self, laws: list[LawKernels]) -> list[SweptContacts]:
        """Contacts of all ranks, where details of rolling points are the impulses of contacts."""
        own = [
            contacts._replace(kernels=laws.index(contacts.kernels), turned=turned)
            for contacts, turned in zip(self._swept, self._turned, strict=True)
        ]
        comm = self._halo.ranks.comm
        told = comm.allgather(own)
        before = sum(map(len, told[: comm.rank]))
        self._own = slice(before, before + len(own))
        return [c._replace(kernels=laws[c.kernels]) for of_rank in told for c in of_rank]

    def _touched_slots(self) -> np.ndarray:
        """Slots here that contacts of some rank touch."""
        touched = np.zeros(self._velocity.shape)
        touched[super()._touched_slots()] = 1.0
        self._sum(touched)
        return np.flatnonzero(touched[:-1, 0])

    def _impulses_on_slots(self) -> np.ndarray:
        """What the contacts of all ranks give the slots here."""
        impulses = super()._impulses_on_slots()
        self._sum(impulses)
        return impulses

    def _sum(self, values: np.ndarray) -> None:
        """Let owners and ghosts have the sums of what all have, shape (num_slots, dim)."""
        self._halo.everywhere.add_back(values.reshape(-1))
        self._halo.everywhere.forward(values.reshape(-1))

    def _take(self, impulses: np.ndarray) -> None:
        super()._take(impulses)
        for g, contacts in zip(self._groups, self._swept[self._own], strict=True):
            g.impulse[:] = contacts.impulse

    def _take_compliances(self, root: np.ndarray, mobility: np.ndarray) -> None:
        """Tell what moves as one; the compliances of own contacts, and the contacts of all."""
        here, known = root[self._moved], self._nodes
        self._known_number[self._moved] = self._number[here]
        self._known_mobility[self._moved] = mobility[here]
        for values in (self._velocity, self._known_number, self._known_mobility):
            self._halo.corners.back(values.reshape(-1))
            self._halo.everywhere.forward(values.reshape(-1))
        number = self._known_number[:, 0].astype(np.int64)
        _, first, place = np.unique(number[known], return_index=True, return_inverse=True)
        self._known_root[known] = known[first][place]
        super()._take_compliances(self._known_root, self._known_mobility)
        self._gather(number, known[first])

    def _gather(self, number: np.ndarray, slots: np.ndarray) -> None:
        """Tell all ranks what has changed of the contacts of all.

        Args:
            number: shape (num_slots,), of the cluster of each.
            slots: one for each cluster at own contacts.
        """
        changing = [
            (number[g.points.nodes], g.compliance, g.terms, g.details) for g in self._groups
        ]
        clusters = number[slots], self._velocity[slots], self._known_mobility[slots]
        told, at = zip(*self._halo.ranks.comm.allgather((changing, clusters)), strict=True)
        numbers, velocity, mobility = map(np.concatenate, zip(*at, strict=True))
        blocks, first_rigid = self._rigid
        numbers, first = np.unique(numbers, return_index=True)
        first = first[numbers < first_rigid]
        numbers = np.append(numbers[: len(first)], first_rigid + np.arange(2 * len(blocks) + 1))
        solid = self._interactions.rigid_part(self._velocity)
        ground = np.zeros((1, self._interactions.dim))
        self._of_clusters = (
            np.concatenate([velocity[first], solid, ground]),
            np.arange(len(numbers), dtype=np.int32),
            np.concatenate([mobility[first], self._mobility_of_rigid, ground]), blocks, len(first),
        )  # fmt: skip
        self._swept = []
        for contacts, (nodes, *changed) in zip(self._of_all, chain(*told), strict=True):
            now = contacts.compliance, contacts.terms, contacts.details
            for array, values in zip(now, changed, strict=True):
                array[:] = values
            turned = contacts.turned
            if turned:
                turned = _at_places(turned, lambda there: np.searchsorted(numbers, there))
            nodes = np.searchsorted(numbers, nodes).astype(np.int32)
            self._swept.append(contacts._replace(nodes=nodes, turned=turned))


def _at_places(turned: Couplings, place: Callable[[np.ndarray], np.ndarray]) -> Couplings:
    """Couplings of contacts of which nodes and spins are in other places, w left out.

    Args:
        turned: of contacts with rigid bodies.
        place: gives the places that some have now.
    """
    dim, kind = turned.lever_arms.shape[2], turned.start.dtype
    start, spin = (
        (place(dofs // dim) * dim).astype(kind) for dofs in (turned.start, turned.rotation_dof)
    )
    return turned._replace(start=start, rotation_dof=spin, w=turned.w[:0])
