# SPDX-License-Identifier: LGPL-3.0-or-later
"""How far cells stretch or turn, at little cost: what bounds the use of small strain."""

from __future__ import annotations

import numpy as np

from xper_fx.bulk.bulk import Bulk


def largest_slope(bulk: Bulk, displacement: np.ndarray) -> float:
    """The largest |u_i - u_0| / |x_i - x_0| over the nodes i of the cells of all ranks.

    It is the stretch of a cell that is stretched, and 2 sin(alpha / 2) of one that turns by alpha.

    Args:
        bulk: the meshed bodies.
        displacement: of its unknowns, shape (num_dofs,), m.
    """
    nodes = bulk.forms.V.dofmap.list
    u = bulk.unknowns.expand(displacement).reshape(-1, bulk.dim)[nodes]
    x = bulk.forms.V.tabulate_dof_coordinates()[nodes]
    moved = np.linalg.norm(u[:, 1:] - u[:, :1], axis=2)
    apart = np.linalg.norm(x[:, 1:] - x[:, :1], axis=2)
    return bulk.ranks.max(float((moved / apart).max(initial=0.0)))
