# SPDX-License-Identifier: LGPL-3.0-or-later
"""The fastest vibration of the bulk, which bounds the step of an explicit one by 2 / omega."""

from __future__ import annotations

import numpy as np

from xper_fx.bulk.body_dofs import BodyLayout
from xper_fx.bulk.sparse_blocks import BlockMatrix
from xper_fx.support.threads import in_ranges

# Bodies whose stiffness is looked at together: their blocks stay in cache.
_BATCH = 1024


def largest_eigenvalue(stiffness: BlockMatrix, mass: np.ndarray, layout: BodyLayout) -> float:
    """Largest eigenvalue of M^-1 K (1/s^2).

    Args:
        stiffness: K on the nodes, in blocks of dim x dim.
        mass: lumped, a dof (kg; 2D: kg/m), those of the nodes first.

    Returns:
        0 without bodies.
    """
    if not layout.num_bodies:
        return 0.0
    if layout.uniform:
        return _largest_of_bodies(stiffness, mass, layout)
    import scipy.sparse as sp

    scale = sp.diags_array(1.0 / np.sqrt(mass[: stiffness.size]))
    scaled = (scale @ stiffness.to_scipy() @ scale).tocsr()
    # a fixed start of the iterations, so that runs repeat
    start = np.random.default_rng(0).standard_normal(stiffness.size)
    top = sp.linalg.eigsh(scaled, k=1, which="LA", return_eigenvectors=False, tol=1e-3, v0=start)
    return float(top[0])


def _largest_of_bodies(stiffness: BlockMatrix, mass: np.ndarray, layout: BodyLayout) -> float:
    """The same for bodies of one size, body by body.

    No eigenvalue exceeds the norm of its block: bodies come by falling norms, and those whose
    norm is below what was found are left out.
    """
    place, count = layout.place_in_body(), layout.num_bodies
    scale = 1.0 / np.sqrt(mass[layout.dofs(layout.nodes)]).reshape(count, -1)
    norm, largest = np.empty(count), np.zeros(count)

    def scaled(bodies):
        blocks = layout.dense_blocks(stiffness, bodies, place)
        return blocks * scale[bodies, :, None] * scale[bodies, None, :]

    def measure(first, last):
        for low in range(first, last, _BATCH):
            bodies = np.arange(low, min(low + _BATCH, last))
            norm[bodies] = np.linalg.norm(scaled(bodies), axis=(1, 2))

    in_ranges(measure, count)
    order = np.argsort(-norm, kind="stable")

    def solve(first, last):
        found = 0.0
        for low in range(first, last, _BATCH):
            bodies = order[low : min(low + _BATCH, last)]
            if norm[bodies[0]] <= found:
                break
            largest[bodies] = np.linalg.eigvalsh(scaled(bodies))[:, -1]
            found = max(found, largest[bodies].max())

    in_ranges(solve, count)
    return float(largest.max())
