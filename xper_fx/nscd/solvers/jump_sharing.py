# SPDX-License-Identifier: LGPL-3.0-or-later
"""The operator A of `feti.py`, on a rank's bodies and the nodes of others that meet them."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from xper_fx.nscd.interactions import Interactions

# Weight of D beside the jumps, and the least ratio of stiffnesses that it tells apart.
_LITTLE, _LEAST_RATIO = 1e-3, 1e-6


class JumpSharing:
    """A: jumps shared among the nodes that meet; those of a cut are known to ranks on both sides.

    Args:
        scalar: H^T of one component, shape (num_points, num_slots).
        stiffness, free: of the dofs of this rank's bodies.
    """

    def __init__(
        self,
        interactions: Interactions,
        scalar: sp.csr_array,
        stiffness: np.ndarray,
        free: np.ndarray,
    ):
        self._interactions, self._dim = interactions, interactions.dim
        self._own = own = interactions.own_inverse.num_nodes
        self._count, self._exchange = own, None
        normal = sp.coo_array(scalar.T @ scalar)
        if interactions.halo is None:
            normal = sp.csr_array(normal)[:own, :own]
        else:
            normal = self._with_those_of_others(normal)
        self._normal = sp.csr_array(sp.kron(normal, sp.eye_array(self._dim)))
        self._free = self._told(free.astype(float)) > 0.5
        self._own_free = free
        self._factors = self._factored(self._told(stiffness)[self._free])

    def _with_those_of_others(self, normal: sp.coo_array) -> sp.csr_array:
        """H H^T of one component on this rank's nodes, then on others that meet them at a cut."""
        interactions, own = self._interactions, self._own
        ranks, slots = interactions.halo.ranks, normal.shape[0]
        known = interactions.inverse.num_nodes
        joins = sp.csr_array(normal)[:known, :known]
        cut = interactions.halo.cut_nodes(interactions, connected_components(joins, False)[1])
        others = cut.nodes >= own
        place = np.full(max(slots, cut.nodes.max(initial=-1) + 1), -1)
        place[:own] = np.arange(own)
        place[cut.nodes[others]] = own + np.arange(np.count_nonzero(others))
        self._count += np.count_nonzero(others)
        self._at_cut = (place[cut.nodes][:, None] * self._dim + np.arange(self._dim)).ravel()
        self._exchange = cut.exchange
        # what this rank's points give at cuts the others hear of
        at = np.full(slots, -1)
        here = np.flatnonzero(cut.nodes < slots)
        at[cut.nodes[here]] = here
        rows, columns = at[normal.row], at[normal.col]
        told = []
        for rank in range(ranks.size):
            asked = np.zeros(len(cut.nodes) + 1, bool)  # the last for what is at no cut
            if rank != ranks.rank:
                asked[:-1] = cut.told(rank)
            sent = asked[rows] & (columns >= 0)
            told.append((cut.numbers[rows[sent]], cut.numbers[columns[sent]], normal.data[sent]))
        order = np.argsort(cut.numbers)
        rows, columns, values = place[normal.row], place[normal.col], normal.data
        for first, second, more in ranks.comm.alltoall(told):
            first, second = (
                place[cut.nodes[order[np.searchsorted(cut.numbers, n, sorter=order)]]]
                for n in (first, second)
            )
            rows, columns = np.append(rows, first), np.append(columns, second)
            values = np.append(values, more)
        on_nodes = (rows >= 0) & (columns >= 0)  # not of the ground
        entries = (values[on_nodes], (rows[on_nodes], columns[on_nodes]))
        return sp.csr_array(sp.coo_array(entries, shape=(self._count, self._count)))

    def _told(self, values: np.ndarray) -> np.ndarray:
        """Values at this rank's nodes, and at others that meet them."""
        if self._exchange is None:
            return values
        known = np.zeros(self._count * self._dim)
        known[: len(values)] = values
        at_cut = known[self._at_cut]
        self._exchange.forward(at_cut)
        known[self._at_cut] = at_cut
        return known

    def _factored(self, stiffness: np.ndarray):
        """Factors of H H^T + a little D on the dofs that are free; None where there are none."""
        normal = self._normal[self._free][:, self._free]
        if not len(stiffness):
            return None
        _, cluster = connected_components(normal, directed=False)
        largest = np.zeros(cluster.max() + 1)
        np.maximum.at(largest, cluster, stiffness)
        ratio = np.maximum(stiffness / largest[cluster], _LEAST_RATIO)
        return splu(
            sp.csc_array(normal + sp.diags_array(_LITTLE * ratio)),
            permc_spec="MMD_AT_PLUS_A",
            options={"SymmetricMode": True, "DiagPivotThresh": 0.0},
        )

    def shared(self, forces: np.ndarray) -> np.ndarray:
        """(H H^T + a little D)^-1 of forces on this rank's bodies, where these are free."""
        moved = self._told(forces)
        if self._factors is not None:
            moved[self._free] = self._factors.solve(moved[self._free])
        return np.where(self._own_free, moved[: len(forces)], 0.0)

    def forces(self, motions: sp.csr_array) -> sp.csr_array:
        """H H^T times motions by columns, of which a dof has few."""
        own = self._normal[: motions.shape[0]]
        if self._exchange is None:
            return sp.csr_array(own @ motions)
        lengths = np.diff(motions.indptr)
        row = np.repeat(np.arange(len(lengths)), lengths)
        entry = np.arange(len(row)) - np.repeat(motions.indptr[:-1], lengths)
        rows, columns, values = [np.zeros(0, int)], [np.zeros(0, int)], [np.zeros(0)]
        for number in range(int(self._interactions.largest(lengths.max(initial=0)))):
            there, which = np.zeros((2, len(lengths)))
            chosen = np.flatnonzero(entry == number)
            there[row[chosen]], which[row[chosen]] = motions.data[chosen], motions.indices[chosen]
            there, which = self._told(there), self._told(which)
            known = np.flatnonzero(there)
            rows.append(known)
            columns.append(which[known].astype(int))
            values.append(there[known])
        entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
        shape = (own.shape[1], motions.shape[1])
        return sp.csr_array(own @ sp.csr_array(sp.coo_array(entries, shape=shape)))
