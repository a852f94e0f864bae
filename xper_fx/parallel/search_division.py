# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which part of a search for contacts of meshed bodies a rank makes.

Whenever lists are made anew the ranks tell each other the boxes of their bodies, twice `dim`
numbers a body. A rank finds the bodies whose boxes overlap those of its own, asks their ranks for
them, and has the positions of their nodes from then on. Nodes of other bodies never reach it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from xper_fx.nscd.search.grid import box_pairs
from xper_fx.parallel.exchange import Exchange
from xper_fx.parallel.rows_of_all import RowsOfAll
from xper_fx.support.ranks import Ranks


class SearchDivision:
    """A rank's share of a search; see `SearchShare`.

    Args:
        rank_of_body: shape (num_bodies,), int.
        body_of_node: shape (num_nodes,), body of each node of the surfaces.
        dim: 2 or 3.
        rank_of_rigid: shape (num_rigid,), int.

    Attributes:
        own_body, own_node, body_of_node, own_rigid, known: see `SearchShare`.
    """

    def __init__(
        self,
        ranks: Ranks,
        rank_of_body: np.ndarray,
        body_of_node: np.ndarray,
        dim: int,
        rank_of_rigid: np.ndarray,
    ):
        self._ranks, self._rank_of_body, self._dim = ranks, rank_of_body, dim
        self.body_of_node = body_of_node
        self.own_body = rank_of_body == ranks.rank
        self.own_node = self.own_body[body_of_node]
        self.own_rigid = rank_of_rigid == ranks.rank
        self.known = self.own_body
        self._boxes = RowsOfAll(ranks, rank_of_body, 2 * dim)
        self._exchange: Exchange | None = None

    def meet(
        self,
        x: np.ndarray,
        low: np.ndarray,
        high: np.ndarray,
        others: tuple[np.ndarray, np.ndarray],
        joined: Callable[[np.ndarray], np.ndarray],
    ) -> None:
        """Know the bodies that may touch own ones, and what is joined to them."""
        boxes = np.concatenate([low, high], axis=1)
        self._boxes.forward(boxes.reshape(-1))
        low, high = np.split(boxes, 2, axis=1)
        there = (low <= high).all(axis=1)
        own, all_there = np.flatnonzero(there & self.own_body), np.flatnonzero(there)
        looking = (np.concatenate(both) for both in zip((low[own], high[own]), others, strict=True))
        pairs = box_pairs(*looking, low[all_there], high[all_there])
        near = self.own_body.copy()
        near[all_there[pairs[:, 1]]] = True
        self.known = joined(near)
        ranks, bodies = range(self._ranks.size), np.flatnonzero(self.known & ~self.own_body)
        asked = [bodies[self._rank_of_body[bodies] == rank] for rank in ranks]
        told = self._ranks.comm.alltoall(asked)
        self._exchange = Exchange(
            self._ranks, *({r: self._nodes_of(b[r]) for r in ranks if len(b[r])}
                           for b in (told, asked)), self._dim,
        )  # fmt: skip
        self.refresh(x)

    def refresh(self, x: np.ndarray) -> None:
        """Fill in the positions of known bodies' nodes from those of own ones."""
        if self._exchange is not None:
            self._exchange.forward(x.reshape(-1))

    def largest(self, values: np.ndarray) -> np.ndarray:
        """The largest of each entry over the ranks."""
        return self._ranks.max(values)

    def _nodes_of(self, bodies: np.ndarray) -> np.ndarray:
        """All nodes of bodies, ascending."""
        there = np.zeros(len(self._rank_of_body), bool)
        there[bodies] = True
        return np.flatnonzero(there[self.body_of_node])
