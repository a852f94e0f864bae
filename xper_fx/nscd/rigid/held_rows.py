# SPDX-License-Identifier: LGPL-3.0-or-later
"""The rows of joints that hold, solved all at once.

Sweeps carry what happens at one end of a chain to the other joint by joint. Rows that hold are
linear: with the impulses of all others as they are, dr of all of them follows from

    (H^T w H) dr = u_asked - u,

a sparse matrix with a block a pair of joints at one body, factorised once a step. The solver of all
interactions starts from there, and has nothing left to do in a mechanism without contact, friction
or stops.

Joints that hold more than the bodies need make the matrix singular: a share of its diagonal is
added, and what that leaves is taken away by solving again.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.laws.joint_laws import Held

# Share of the diagonal that is added, and solutions after which its effect is of rounding.
_ADDED, _SOLUTIONS = 1e-9, 3


class HeldRows:
    """The rows that hold, in the middle of a step.

    Args:
        interactions: with the rows of the step; those of other ranks move other bodies.
    """

    def __init__(self, interactions: Interactions):
        kernels = Held().kernels(interactions.dim)
        self._group = next((g for g in interactions.joints if g.kernels is kernels), None)
        if self._group is None:
            return
        self._first = interactions.bulk_inverse.num_nodes * interactions.dim
        blocks = interactions.rigid_blocks
        count, size = blocks.shape[:2]
        self._h = _rows_of(self._group.points, self._first, count * size)
        w = sp.bsr_array((blocks, np.arange(count), np.arange(count + 1)))
        self._pushed = (w @ self._h.T).tocsc()
        matrix = (self._h @ self._pushed).tocsc()
        diagonal = matrix.diagonal()  # zero where both sides are driven along a row
        matrix += sp.diags_array(np.where(diagonal > 0.0, _ADDED * diagonal, 1.0))
        self._factors = splu(matrix)

    def solve(self, velocity: np.ndarray) -> None:
        """Change the impulses of the rows so that they hold.

        Args:
            velocity: of all slots with all impulses, flat, which follows; m/s.
        """
        if self._group is None:
            return
        rigid = velocity[self._first : self._first + self._h.shape[1]]
        for _ in range(_SOLUTIONS):
            change = self._factors.solve(self._group.terms[:, 0] - self._h @ rigid)
            self._group.impulse[:, 0] += change
            rigid += self._pushed @ change


def _rows_of(points, first: int, count: int) -> sp.csr_array:
    """H^T of points with a normal alone, shape (num_points, count).

    Args:
        points: of rigid bodies and the ground.
        first: number of the rigid bodies' first degree of freedom.
        count: of their degrees of freedom.
    """
    normal, dim = points.frame[:, 0], points.dim
    sign = np.array([1.0, -1.0])[None, :, None]
    force = sign * normal[:, None]
    arms = points.lever_arms
    if dim == 3:
        moment = sign * np.cross(arms, normal[:, None])
    else:
        turn = arms[..., 0] * normal[:, None, 1] - arms[..., 1] * normal[:, None, 0]
        moment = sign * np.stack([turn, np.zeros_like(turn)], axis=-1)
    place = np.stack([points.nodes[:, :, 0], points.rotation_nodes()], axis=-1) * dim - first
    column = place[..., None] + np.arange(dim)
    values = np.stack([force, moment], axis=2)
    row = np.broadcast_to(np.arange(len(points))[:, None, None, None], column.shape)
    moves = (column < count) & (values != 0.0)
    return sp.csr_array((values[moves], (row[moves], column[moves])), (len(points), count))
