# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts beside vertices that split, where ranks divide both.

A vertex is on the rank of the first of its bodies, a contact on that of one of its two bodies, and
a cluster of cells may be touched by contacts of several ranks. Turns are those of
`touching_clusters.py`. In each of them

1. a rank solves those of its vertices that contacts touch, whosesoever these are,
2. ranks with contacts are told the velocity and one over the mass of each cluster there, and the
   number by which all know it, that of its first corner,
3. all contacts are told to all ranks, each of which sweeps all of them in the same order. The bits
   are the same, and so are the decisions,
4. corners get the impulses that the contacts of all ranks give them.

**Limitation.** Sweeps over contacts are not divided, only what is done at vertices.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from xper_fx.nscd.contact_history import kernels_of_contacts
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.solvers.solver import SolveOptions, SolveReport
from xper_fx.nscd.splitting.touching_clusters import SweptContacts, TouchingClusters


class SharedClusters(TouchingClusters):
    """The contacts of all ranks in a step, and this rank's vertices that they touch.

    Arguments are those of `TouchingClusters`; ghosts have the velocities of their owners. All ranks
    do everything together.
    """

    def __init__(
        self,
        interactions: Interactions,
        velocity: np.ndarray,
        move: Callable[[np.ndarray], SolveReport],
        options: SolveOptions,
    ):
        self._halo = halo = interactions.halo
        super().__init__(interactions, velocity, move, options)
        self._law_kernels = kernels_of_contacts(interactions.laws, interactions.dim)
        self._nodes = super()._touched_slots()
        count = len(self._velocity)
        first = halo.ranks.before(interactions.own_inverse.num_nodes)
        self._number = np.repeat(np.arange(first, first + count, dtype=float), interactions.dim)
        halo.everywhere.forward(self._number)
        self._number = self._number.reshape(count, -1)
        # of each slot its cluster's number and one over its mass, and a slot for it at contacts
        self._known_number, self._known_mobility = self._number.copy(), self._mobility.copy()
        self._known_root = self._root.copy()
        self._own = slice(0, 0)

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
        """Tell all ranks the contacts of all.

        Args:
            number: shape (num_slots,), of the cluster of each.
            slots: one for each cluster at own contacts.
        """
        own = []
        for g in self._groups:
            contacts = SweptContacts.of(g)
            law = self._law_kernels.index(g.kernels)
            own.append(contacts._replace(kernels=law, nodes=number[contacts.nodes]))
        clusters = number[slots], self._velocity[slots], self._known_mobility[slots]
        comm = self._halo.ranks.comm
        told, at = zip(*comm.allgather((own, clusters)), strict=True)
        numbers, velocity, mobility = map(np.concatenate, zip(*at, strict=True))
        numbers, first = np.unique(numbers, return_index=True)
        rows = np.arange(len(first), dtype=np.int32)
        self._of_clusters = velocity[first], rows, mobility[first]
        self._swept = [
            contacts._replace(
                kernels=self._law_kernels[contacts.kernels],
                nodes=np.searchsorted(numbers, contacts.nodes).astype(np.int32),
            )
            for of_rank in told
            for contacts in of_rank
        ]
        before = sum(map(len, told[: comm.rank]))
        self._own = slice(before, before + len(own))
