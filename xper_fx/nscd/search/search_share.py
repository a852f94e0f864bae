# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a search asks of ranks that divide it.

A rank looks at the nodes of its own bodies, at corners and centres of its own rigid bodies, and at
crossings of edges of which the first is one of its own. It so makes each row of the lists whole or
not at all, and finds of a node what one rank would. The facets it needs for this are those of
*known* bodies: its own, and those whose boxes overlap the boxes of its own, meshed or rigid. The
search knows nothing of MPI: `xper_fx.parallel` has the class that follows this protocol.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np


class SearchShare(Protocol):
    """A rank's share of a search; ranks call its methods together."""

    own_body: np.ndarray  #: shape (num_bodies,), bool: whose nodes this rank looks at
    own_node: np.ndarray  #: shape (num_nodes,), bool: these nodes
    body_of_node: np.ndarray  #: shape (num_nodes,), int
    #: shape (num_rigid,), bool: rigid bodies whose corners and centres this rank looks at, each on
    #: one rank; empty without any
    own_rigid: np.ndarray
    #: shape (num_bodies,), bool: the bodies where positions of nodes mean something
    known: np.ndarray

    def meet(
        self,
        x: np.ndarray,
        low: np.ndarray,
        high: np.ndarray,
        others: tuple[np.ndarray, np.ndarray],
        joined: Callable[[np.ndarray], np.ndarray],
    ) -> None:
        """Find out which bodies may touch this rank's own, and know them from now on.

        Args:
            x: shape (num_nodes, dim), positions of own nodes; those of known bodies are filled in.
            low, high: shape (num_bodies, dim), boxes of own bodies, which hold what may touch them;
                inf and -inf without facets.
            others: low and high corners, each of shape (n, dim), around own rigid bodies.
            joined: gives of bodies, shape (num_bodies,), bool, these and those that are to be known
                with them.
        """

    def refresh(self, x: np.ndarray) -> None:
        """Fill in the positions of known bodies' nodes from those of own ones."""

    def largest(self, values: np.ndarray) -> np.ndarray:
        """The largest of each entry over the ranks."""
