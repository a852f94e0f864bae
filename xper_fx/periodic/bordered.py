# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The iteration matrix of a cell: that of its bodies, bordered by the macroscopic gradient.

For increments of the velocity of the fluctuation v and of the rate g of the m components of G that
stresses determine, with B = N^T K X, A = X^T K X and w the inverse on the bodies,

    [ M + h^2 theta^2 K   h^2 theta B ] [dv]   [ r_v + p ]
    [ h^2 theta B^T       h^2 A       ] [dg] = [ r_g     ].

Without interactions (p = 0) this is solved as it stands, by w and the m x m Schur complement
h^2 A - (h^2 theta)^2 B^T w B.

With interactions dg must know how they answer: with impulses held, bodies that nothing ties would
resist a macroscopic strain by their inertia alone. That answer is the compliance of the cell,

    h^2 dg = (A^-1 + D) r_g,

in which A^-1 is that of the bulk without fluctuation and D what the bonds, the cracks and the
fluctuation add to it. D is learnt from the iterations of the run (Broyden's good update): each
sets impulses free again under a new g, so that nothing of the interaction layer changes. Only
iterations in which the bulk itself had little left to correct teach something.

Where ranks divide the bodies, w and K hold a block for each, so that with the rank's own rows

    A = sum_r X_r^T K_r X_r,   B^T w B = sum_r B_r^T w_r B_r,   B^T w r = sum_r B_r^T w_r r_r,

and dg follows from them on every rank alike, D too.
"""

from __future__ import annotations

import numpy as np

from xper_fx.bulk.body_inverse import CellwiseInverse, ClusterInverse
from xper_fx.bulk.sparse_blocks import BlockMatrix
from xper_fx.periodic.periodic_unknowns import CellUnknowns
from xper_fx.support.ranks import ALONE, Ranks

# A pair of iterations whose work has less than this share of what was expected teaches nothing:
# rounding, or a cell that softens.
_LITTLE_WORK = 1e-3


class BorderedInverse:
    """Inverse of a cell's iteration matrix: bodies and macroscopic gradient.

    Args:
        bodies: inverse on the bodies, factorised.
        free: components of G that stresses determine, among the dim^2, shape (m,).
        stiffness: K on the nodes of V.
        step, theta: of the iteration matrix.
        compliance: D, shape (m, m), 1/(N m) (2D: 1/N); changed in place as it is learnt. None if
            there are no interactions.
        ranks: ranks that divide the cell's bodies.

    Attributes:
        blocks, nodes, num_nodes: see `xper_fx.bulk.body_inverse`.
    """

    in_order = False

    def __init__(
        self,
        bodies: CellwiseInverse | ClusterInverse,
        unknowns: CellUnknowns,
        free: np.ndarray,
        stiffness: BlockMatrix,
        step: float,
        theta: float,
        compliance: np.ndarray | None,
        ranks: Ranks = ALONE,
    ):
        self._bodies, self._step, self._ranks = bodies, step, ranks
        self.blocks, self.nodes, self.num_nodes = bodies.blocks, bodies.nodes, bodies.num_nodes
        self._places = unknowns.macroscopic.start + free
        fields = unknowns.fields(free)
        matrix = stiffness.to_scipy()
        forces = matrix @ fields
        corner = ranks.sum(fields.T @ forces)

        def border(columns: np.ndarray) -> np.ndarray:
            pad = np.zeros((unknowns.dim**2, len(free)))
            return step**2 * theta * np.concatenate([unknowns.sum_on_nodes(columns), pad])

        self._answer = np.stack([bodies.apply(c) for c in border(forces).T], axis=1)
        self._compliance = compliance
        if compliance is None:
            self._rows = border(matrix.T @ fields)
            self._schur = step**2 * corner - ranks.sum(self._rows.T @ self._answer)
        else:
            self._corner = np.linalg.inv(corner)
        self._before: tuple[np.ndarray, np.ndarray] | None = None

    def apply(self, residual: np.ndarray) -> np.ndarray:
        """W r on the bodies with the macroscopic gradient held, shape (num_dofs,)."""
        return self._bodies.apply(residual)

    def advance(self, residual: np.ndarray) -> np.ndarray:
        """Newton's increment of all velocities, shape (num_dofs,)."""
        out = self._bodies.apply(residual)
        if self._compliance is None:
            answered = self._ranks.sum(self._rows.T @ out)
            try:
                rate = np.linalg.solve(self._schur, residual[self._places] - answered)
            except np.linalg.LinAlgError:  # nothing resists a macroscopic strain: a limit load
                return np.full_like(residual, np.nan)
        else:
            rate = (self._corner + self._compliance) @ residual[self._places] / self._step**2
        out -= self._answer @ rate
        out[self._places] = rate
        return out

    def learn(self, velocity: np.ndarray, residual: np.ndarray, trusted: bool) -> None:
        """Learn D from the macroscopic residual left with a velocity.

        Args:
            velocity: after interactions have answered, shape (num_dofs,), m/s.
            residual: of the step with that velocity, shape (num_dofs,), N s.
            trusted: whether what changed since the last call is due to the macroscopic strain.
        """
        if self._compliance is None:
            return
        strain = self._step * velocity[self._places]
        missing = residual[self._places] / self._step
        if trusted and self._before is not None:
            moved, gained = strain - self._before[0], self._before[1] - missing
            compliance = self._corner + self._compliance
            expected = compliance @ gained
            work = moved @ expected
            if work > _LITTLE_WORK * (moved @ moved):
                change = np.outer(moved - expected, moved @ compliance) / work
                total = compliance + change
                if np.linalg.eigvalsh(total + total.T)[0] > 0.0:
                    self._compliance += change
        self._before = strain, missing

    def unlearn(self) -> None:
        """Forget D: the cell is taken to be as stiff as its bulk without fluctuation."""
        if self._compliance is not None:
            self._compliance[:] = 0.0

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        rows = self._rows.nbytes if self._compliance is None else 0
        return self._bodies.nbytes + self._answer.nbytes + rows
