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
It starts from no impulses: what those of the last step have along rows that depend on each other
moves nothing at first, but grew from step to step as the bodies turned.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse.linalg import splu

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.laws.joint_laws import Held
from xper_fx.nscd.rigid.normal_rows import NormalRows

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
        self._own, blocks = interactions.own_rigid, interactions.rigid_blocks
        first = interactions.bulk_inverse.num_nodes
        self._rows = NormalRows(self._group.points, first, len(blocks))
        self._pushed = self._rows.pushed(blocks)
        matrix = self._rows.times(self._pushed)
        diagonal = matrix.diagonal()  # zero where both sides are driven along a row
        matrix.data[matrix.indptr[:-1]] += np.where(diagonal > 0.0, _ADDED * diagonal, 1.0)
        self._factors = splu(matrix)

    def solve(self, velocity: np.ndarray) -> None:
        """Find impulses of the rows with which they hold.

        Args:
            velocity: of all slots with all impulses, flat, which follows; m/s.
        """
        if self._group is None:
            return
        rigid = self._own(velocity).reshape(-1)
        self._pushed.push(-self._group.impulse[:, 0], rigid)
        self._group.impulse[:, 0] = 0.0
        for _ in range(_SOLUTIONS):
            change = self._factors.solve(self._group.terms[:, 0] - self._rows.closing(rigid))
            self._group.impulse[:, 0] += change
            self._pushed.push(change, rigid)
