# SPDX-License-Identifier: LGPL-3.0-or-later
"""The linear system of Newton's method over the bodies of all ranks, by PETSc.

GMRES (Saad and Schultz 1986) with the two corrections of `nscd/solvers/tangent.py`, added up:
clusters of facing nodes, whose rows are on one rank each (`row_numbering.py`) and whose blocks are
inverted there; and all clusters moving as one, whose matrix P^T w^-1 P is factored once for each w,
by every rank or, if large, over all ranks by MUMPS (Amestoy et al. 2001). Both are those of one
rank, and so is the number of iterations. Where they are many the matrix itself is factored, too.

What ranks add up is added in the order of the ranks: PETSc's own assembly takes entries of other
ranks in the order in which they arrive, and so may its scatters, and two runs would differ in the
last digits. MUMPS does so, too.
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.solvers.clusters import facing_clusters, opened_clusters
from xper_fx.nscd.solvers.tangent import prescribed
from xper_fx.parallel.row_numbering import Rows, number_rows

# Vectors that GMRES keeps before a restart.
_BASIS = 40
# Unknowns of the coarse problem, and of the matrix itself, up to which every rank factors the
# whole: one exchange a solve, in place of the many of a factorisation that is spread.
_REPLICATED, _WHOLE_REPLICATED = 50_000, 6_000

Elements = list[tuple[np.ndarray, np.ndarray]]
"""Degrees of freedom of slots, shape (n, m), and square matrices on them, shape (n, m, m)."""


class LinearSystem:
    """(w^-1 + S) x = b, S the springs of the points; all ranks call everything together.

    What is prescribed has a row with a one.

    Args:
        interactions: this rank's points.

    Attributes:
        size: number of unknowns of all ranks.
    """

    def __init__(self, interactions: Interactions):
        halo, dim = interactions.halo, interactions.dim
        self._comm, self._dim, self._everywhere = halo.ranks.comm, dim, halo.everywhere
        clusters, _ = facing_clusters(interactions)
        rows = number_rows(interactions, clusters.cluster)
        self._sizes = rows.sizes
        index = (rows.row[:, None] * dim + np.arange(dim)).ravel()
        fixed = prescribed(interactions.inverse)
        self._index = np.full(len(fixed), -1, PETSc.IntType)
        self._index[: len(index)] = np.where(fixed[: len(index)], -1, index)
        own = interactions.own_inverse.num_nodes * dim
        self._ones = index[:own][fixed[:own]].astype(PETSc.IntType)[:, None]

        sizes = (rows.sizes * dim).astype(PETSc.IntType)
        self._count = int(sizes.sum())
        self._matrix = self._new_matrix(self._count)
        self._matrix.setVariableBlockSizes(sizes)
        self.size = self._matrix.getSize()[0]
        self._starts = self._matrix.getOwnershipRanges()
        self._x, self._b = self._matrix.createVecs()
        self._local = PETSc.Vec().createSeq(own, comm=PETSc.COMM_SELF)
        where = PETSc.IS().createGeneral(index[:own].astype(PETSc.IntType), comm=PETSc.COMM_SELF)
        self._scatter = PETSc.Scatter().create(self._x, where, self._local, None)

        self._preconditioner = _TwoLevel(self._prolongation(interactions, rows, fixed[:own]))
        self._krylov = PETSc.KSP().create(self._comm)
        self._krylov.setType(PETSc.KSP.Type.GMRES)
        self._krylov.setGMRESRestart(_BASIS)
        self._krylov.setPCSide(PETSc.PC.Side.RIGHT)
        self._krylov.setInitialGuessNonzero(True)
        self._krylov.setOperators(self._matrix)
        pc = self._krylov.getPC()
        pc.setType(PETSc.PC.Type.PYTHON)
        pc.setPythonContext(self._preconditioner)
        self._bodies: Elements = []

    def _new_matrix(self, columns: int) -> PETSc.Mat:
        """An empty matrix, with this many columns of this rank."""
        matrix = PETSc.Mat().create(self._comm)
        matrix.setSizes([(n, PETSc.DETERMINE) for n in (self._count, columns)])
        matrix.setType(PETSc.Mat.Type.AIJ)
        matrix.setUp()
        matrix.setOption(PETSc.Mat.Option.NO_OFF_PROC_ENTRIES, True)
        return matrix

    def _prolongation(self, interactions: Interactions, rows: Rows, fixed: np.ndarray):
        """P, without the motions that open a point or move what is prescribed."""
        slots, ground = len(rows.cluster), interactions.inverse.num_slots
        labels = np.append(rows.cluster, -1 - np.arange(ground - slots))
        compact = np.unique(labels, return_inverse=True)[1]
        opened = opened_clusters(interactions, compact)[compact[:slots]]
        marks = np.zeros(ground * self._dim)
        marks[: slots * self._dim] = np.repeat(opened, self._dim)
        marks[: len(fixed)] += fixed
        self._sum_to_rows(marks)
        firsts = np.cumsum(self._sizes) - self._sizes
        marks = self._b.array.reshape(-1, self._dim)
        held = np.add.reduceat(marks, firsts, axis=0) > 0.0 if len(firsts) else marks > 0.0
        matrix = self._new_matrix(int(np.count_nonzero(~held)))
        (first, _), (first_column, _) = matrix.getOwnershipRange(), matrix.getOwnershipRangeColumn()
        number = first_column + np.cumsum(~held).reshape(held.shape) - 1
        of_row = np.repeat(np.arange(len(self._sizes)), self._sizes)
        kept = np.flatnonzero(~held[of_row].ravel())
        columns = number[of_row].ravel()[kept]
        if len(kept):
            self._add(matrix, (first + kept)[:, None], columns[:, None], np.ones(len(kept)))
        matrix.assemble()
        return matrix

    @staticmethod
    def _add(matrix, rows: np.ndarray, columns: np.ndarray, values: np.ndarray) -> None:
        """Add small matrices to a matrix; rows and columns below 0 count for nothing."""
        matrix.setValuesRCV(
            rows.astype(PETSc.IntType),
            columns.astype(PETSc.IntType),
            values.reshape(*rows.shape, columns.shape[1]),
            addv=PETSc.InsertMode.ADD_VALUES,
        )

    def _assemble(self, matrix, elements: Elements) -> None:
        """Sum of the bodies' blocks and of others, and ones for what is prescribed."""
        matrix.zeroEntries()
        blocks = [(self._index[dofs], values) for dofs, values in (*self._bodies, *elements)]
        blocks.append((self._ones, np.ones((len(self._ones), 1, 1))))
        rank, starts = self._comm.rank, self._starts
        told: list[list] = [[] for _ in range(self._comm.size)]
        for where, values in blocks:
            owner = np.searchsorted(starts, where, side="right") - 1
            self._add(matrix, np.where(owner == rank, where, -1), where, values)
            element, row = np.nonzero((owner != rank) & (where >= 0))
            of = owner[element, row]
            for other in np.unique(of).tolist():
                e, r = element[of == other], row[of == other]
                told[other].append((where[e, r][:, None], where[e], values[e, r]))
        for rows in self._comm.alltoall(told):
            for row in rows:
                self._add(matrix, *row)
        matrix.assemble()

    def _sum_to_rows(self, values: np.ndarray) -> None:
        """Sum what the ranks have at slots and ghosts into the rows of b."""
        self._everywhere.add_back(values)
        self._to_rows(values, self._b)

    def _to_rows(self, values: np.ndarray, vector) -> None:
        """Put what the ranks have at their own slots into the rows of a vector."""
        self._local.array[:] = values[: self._local.size]
        self._scatter.scatter(
            self._local, vector, PETSc.InsertMode.INSERT_VALUES, PETSc.ScatterMode.REVERSE
        )

    def take_bodies(self, blocks: Elements) -> None:
        """Take w^-1 of this rank's bodies."""
        self._bodies = blocks
        matrix = self._new_matrix(self._count)
        self._assemble(matrix, [])
        self._preconditioner.factor(matrix)
        matrix.destroy()

    def take_springs(self, springs: Elements, kind: str) -> bool:
        """Take S.

        Args:
            springs: of this rank's points.
            kind: of the preconditioner: "clusters", "clusters and all as one", or "whole", the
                matrix itself.

        Returns:
            Whether what it needs could be inverted.
        """
        self._assemble(self._matrix, springs)
        return self._preconditioner.take(self._matrix, kind)

    def solve(self, b: np.ndarray, x: np.ndarray, bound: float, max_iterations: int) -> int:
        """Improve x until |b - A x| is within a bound.

        Args:
            b: shape (num_slots * dim,), what this rank's points add at its slots and ghosts;
                summed in place.
            x: shape (num_slots * dim,), at slots and ghosts: a first guess, and then the solution.
            bound: norm of the residual to reach.
            max_iterations: of GMRES.

        Returns:
            Iterations made.
        """
        b[: len(self._index)][self._index < 0] = 0.0
        self._sum_to_rows(b)
        self._to_rows(x, self._x)
        self._krylov.setTolerances(rtol=0.0, atol=bound, divtol=1e300, max_it=max_iterations)
        self._krylov.solve(self._b, self._x)
        self._scatter.scatter(
            self._x, self._local, PETSc.InsertMode.INSERT_VALUES, PETSc.ScatterMode.FORWARD
        )
        x[: self._local.size] = self._local.array
        self._everywhere.forward(x)
        return self._krylov.getIterationNumber()


class _TwoLevel:
    """z = clusters alone + all clusters moving as one, or that of the matrix itself.

    Args:
        prolongation: P.
    """

    def __init__(self, prolongation):
        self._prolongation = prolongation
        self._clusters = PETSc.PC().create(prolongation.comm)
        self._clusters.setType(PETSc.PC.Type.VPBJACOBI)
        self._whole = PETSc.PC().create(prolongation.comm)
        _take_factors(self._whole, prolongation.getSize()[0] > _WHOLE_REPLICATED)
        self._first = self._clusters
        self._as_one, self._coarse = False, None
        self._moved, _ = prolongation.createVecs()
        self._force = self._moved.duplicate()

    def factor(self, bodies) -> None:
        """Factor P^T w^-1 P."""
        if self._moved.getSize() == 0:
            return
        matrix = bodies.ptap(self._prolongation)
        if self._coarse is not None:
            self._coarse.destroy()
        self._coarse = PETSc.KSP().create(bodies.comm)
        self._coarse.setType(PETSc.KSP.Type.PREONLY)
        self._coarse.setOperators(matrix)
        _take_factors(self._coarse.getPC(), matrix.getSize()[0] > _REPLICATED)
        self._coarse.setUp()

    def take(self, matrix, kind: str) -> bool:
        """Invert the clusters' blocks, or the whole; whether that was possible on all ranks."""
        self._as_one = kind == "clusters and all as one" and self._coarse is not None
        self._first = self._whole if kind == "whole" else self._clusters
        self._first.setOperators(matrix)
        self._first.setUp()
        return self._first.getFailedReason() == 0

    def apply(self, pc, r, z) -> None:
        """z = B r, as PETSc calls it."""
        self._first.apply(r, z)
        if self._as_one:
            self._prolongation.multTranspose(r, self._force)
            self._coarse.solve(self._force, self._moved)
            self._prolongation.multAdd(self._moved, z, z)


def _take_factors(pc, together: bool) -> None:
    """Factor the matrix by MUMPS over all ranks, if it is there, or on every rank."""
    if together and PETSc.Sys.hasExternalPackage("mumps"):
        pc.setType(PETSc.PC.Type.LU)
        pc.setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
    else:
        pc.setType(PETSc.PC.Type.REDUNDANT)
