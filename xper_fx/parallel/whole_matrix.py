# SPDX-License-Identifier: LGPL-3.0-or-later
"""The matrix of Newton's method over the bodies of all ranks, factored by PETSc.

It is factored where the corrections of `nscd/solvers/tangent.py` take many iterations: by every
rank or, if large, over all ranks by MUMPS (Amestoy et al. 2001).

What ranks add up is added in the order of the ranks: PETSc's own assembly takes entries of other
ranks in the order in which they arrive, and two runs would differ in the last digits. MUMPS does
so, too.
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from xper_fx.nscd.interactions import Interactions

# Unknowns up to which every rank factors the whole: one exchange a solve, in place of the many of a
# factorisation that is spread.
_REPLICATED = 6_000

Elements = list[tuple[np.ndarray, np.ndarray]]
"""Degrees of freedom of slots, shape (n, m), and square matrices on them, shape (n, m, m)."""


class WholeMatrix:
    """w^-1 + S, S the springs of the points; all ranks call everything together.

    What is prescribed has a row with a one.

    Args:
        interactions: this rank's points.
        fixed: shape (n,), which degrees of freedom of this rank's slots and ghosts are prescribed.
    """

    def __init__(self, interactions: Interactions, fixed: np.ndarray):
        halo, dim = interactions.halo, interactions.dim
        self._comm = halo.ranks.comm
        own = interactions.own_inverse.num_nodes * dim
        first = halo.ranks.before(own)
        index = halo.with_ghost_values(first + np.arange(own, dtype=float).reshape(-1, dim))
        index = index.ravel().astype(PETSc.IntType)
        self._index = np.full(interactions.inverse.num_slots * dim, -1)
        self._index[: len(index)] = np.where(fixed[: len(index)], -1, index)
        self._ones = index[:own][fixed[:own]][:, None]
        self._matrix = PETSc.Mat().create(self._comm)
        self._matrix.setSizes([(own, PETSc.DETERMINE)] * 2)
        self._matrix.setType(PETSc.Mat.Type.AIJ)
        self._matrix.setUp()
        self._matrix.setOption(PETSc.Mat.Option.NO_OFF_PROC_ENTRIES, True)
        self._x, self._b = self._matrix.createVecs()
        self._factors = PETSc.PC().create(self._comm)
        if self._matrix.getSize()[0] > _REPLICATED and PETSc.Sys.hasExternalPackage("mumps"):
            self._factors.setType(PETSc.PC.Type.LU)
            self._factors.setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
        else:
            self._factors.setType(PETSc.PC.Type.REDUNDANT)

    def _add(self, rows: np.ndarray, columns: np.ndarray, values: np.ndarray) -> None:
        """Add small matrices; rows and columns below 0 count for nothing."""
        self._matrix.setValuesRCV(
            rows.astype(PETSc.IntType),
            columns.astype(PETSc.IntType),
            values.reshape(*rows.shape, columns.shape[1]),
            addv=PETSc.InsertMode.ADD_VALUES,
        )

    def factor(self, elements: Elements) -> bool:
        """Take the blocks of w^-1 of this rank's bodies and the springs of its points.

        Returns:
            Whether their sum over all ranks could be factored.
        """
        self._matrix.zeroEntries()
        blocks = [(self._index[dofs], values) for dofs, values in elements]
        blocks.append((self._ones, np.ones((len(self._ones), 1, 1))))
        rank, starts = self._comm.rank, self._matrix.getOwnershipRanges()
        told: list[list] = [[] for _ in range(self._comm.size)]
        for where, values in blocks:
            owner = np.searchsorted(starts, where, side="right") - 1
            self._add(np.where(owner == rank, where, -1), where, values)
            element, row = np.nonzero((owner != rank) & (where >= 0))
            of = owner[element, row]
            for other in np.unique(of).tolist():
                e, r = element[of == other], row[of == other]
                told[other].append((where[e, r][:, None], where[e], values[e, r]))
        for rows in self._comm.alltoall(told):
            for row in rows:
                self._add(*row)
        self._matrix.assemble()
        self._factors.setOperators(self._matrix)
        self._factors.setUp()
        return self._factors.getFailedReason() == 0

    def solve(self, r: np.ndarray, z: np.ndarray) -> None:
        """z = (w^-1 + S)^-1 r, of this rank's slots."""
        self._b.array[:] = r
        self._factors.apply(self._b, self._x)
        z[:] = self._x.array
