# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sparse direct solution of systems that keep their pattern: MUMPS through PETSc.

Over several ranks each has some rows. MUMPS then adds what ranks send it in the order in which it
arrives: two runs may differ by rounding.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from petsc4py import PETSc

from xper_fx.support.ranks import ALONE, Ranks

# MUMPS controls: ordering (METIS where there is one, else picked), room for pivots that are put
# off (%), no parallel root.
_ORDERING, _ROOM, _ROOT = (7, 7), (14, 80), (13, 1)
# Number of MUMPS' information that counts negative pivots.
_NEGATIVE = 12


class SingularMatrixError(ArithmeticError):
    """A matrix that cannot be factorised."""


class Direct(Protocol):
    """What factors a matrix; all methods are those of `SparseDirect`."""

    def factorise(self, data: np.ndarray) -> None:
        """Take new values."""

    def negative_pivots(self) -> int | None:
        """Negative eigenvalues of the matrix."""

    def solve(self, right: np.ndarray) -> np.ndarray:
        """The solution for one right-hand side."""


class SparseDirect:
    """Factorisations of matrices of one pattern.

    Args:
        indptr, indices: of this rank's rows, as of `scipy.sparse.csr_array`, both triangles.
        symmetric: whether the values will be symmetric: LDL^T, half the work of LU.
        ranks: that have the rows, in their order; they do everything together.
    """

    def __init__(
        self, indptr: np.ndarray, indices: np.ndarray, symmetric: bool, ranks: Ranks = ALONE
    ):
        self._pattern = indptr.astype(np.int32), indices.astype(np.int32)
        self._symmetric, self._ranks = symmetric, ranks
        self._make()

    def _make(self) -> None:
        """PETSc's objects; after an error they are of no more use."""
        (indptr, indices), symmetric = self._pattern, self._symmetric
        size = len(indptr) - 1, PETSc.DETERMINE
        self._matrix = PETSc.Mat().createAIJ(
            (size, size), csr=(indptr, indices, np.zeros(len(indices))), comm=self._ranks.comm
        )
        self._matrix.setOption(PETSc.Mat.Option.SYMMETRIC, symmetric)
        self._solver = PETSc.KSP().create(self._ranks.comm)
        self._solver.setOperators(self._matrix)
        self._solver.setType("preonly")
        preconditioner = self._solver.getPC()
        preconditioner.setType("cholesky" if symmetric else "lu")
        if not PETSc.Sys.hasExternalPackage("mumps"):
            raise RuntimeError(
                "The monolithic solver needs PETSc with MUMPS, which this PETSc was built without: "
                'take another build, or solver="newton".'
            )
        preconditioner.setFactorSolverType("mumps")
        preconditioner.setFactorSetUpSolverType()
        factor = preconditioner.getFactorMatrix()
        for number, value in (_ORDERING, _ROOM, _ROOT):
            factor.setMumpsIcntl(number, value)
        self._x, self._b = self._matrix.createVecs()

    def factorise(self, data: np.ndarray) -> None:
        """Take new values.

        Raises:
            SingularMatrixError: they cannot be factorised.
        """
        if not self._ranks.all(np.all(np.isfinite(data))):
            raise SingularMatrixError("The matrix has entries that are not finite.")
        self._matrix.setValuesCSR(*self._pattern, data)
        self._matrix.assemble()
        self._solver.setOperators(self._matrix)
        try:
            self._solver.setUp()
        except PETSc.Error as error:
            self._make()
            raise SingularMatrixError("The matrix cannot be factorised.") from error

    def negative_pivots(self) -> int | None:
        """Negative eigenvalues of the matrix that was factorised; None unless it is symmetric."""
        factor = self._solver.getPC().getFactorMatrix()
        return factor.getMumpsInfog(_NEGATIVE) if self._symmetric else None

    def solve(self, right: np.ndarray) -> np.ndarray:
        """The solution for one right-hand side, of this rank's rows, shape (n,).

        Raises:
            SingularMatrixError: the factors are of no use.
        """
        self._b.array[:] = right
        try:
            self._solver.solve(self._b, self._x)
        except PETSc.Error as error:
            self._make()
            raise SingularMatrixError("The factors are of no use.") from error
        solution = self._x.array.copy()
        if not self._ranks.all(np.all(np.isfinite(solution))):
            raise SingularMatrixError("The matrix is singular.")
        return solution
