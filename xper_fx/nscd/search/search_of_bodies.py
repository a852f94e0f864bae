# SPDX-License-Identifier: LGPL-3.0-or-later
"""The search that rigid bodies ask for, in a periodic cell or without one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from xper_fx.nscd.rigid.bodies import RigidBodies
from xper_fx.nscd.search.rigid_search import RigidSearch

if TYPE_CHECKING:
    from xper_fx.nscd.search.periodic_search import PeriodicSearch


def search_of_bodies(
    bodies: RigidBodies,
    pairs: Sequence[tuple[str, str]],
    reach: float,
    apart: np.ndarray | None,
    lattice: np.ndarray | None,
) -> RigidSearch | PeriodicSearch:
    """A search of contacts between rigid bodies.

    Args:
        bodies, pairs, reach, apart: as of `RigidSearch`.
        lattice: as of `PeriodicSearch`, whose bodies are not kept apart; None without a cell.
    """
    if lattice is None:
        return RigidSearch(bodies, pairs, reach, apart)
    from xper_fx.nscd.search.periodic_search import PeriodicSearch

    return PeriodicSearch(bodies, pairs, reach, lattice)
