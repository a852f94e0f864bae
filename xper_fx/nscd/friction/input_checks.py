# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of a frictional contact problem before any work is done on it."""

from __future__ import annotations

from numbers import Integral
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

SparseOrDense: TypeAlias = sp.spmatrix | sp.sparray | npt.ArrayLike
"""A matrix, of SciPy or anything NumPy takes for an array."""

# Asymmetry allowed, relative to max |W|: measured data reach 1.4e-3.
_ASYMMETRY = 1e-2
# Smallest eigenvalue of a diagonal block, relative to its largest: real data go down to 1e-8.
_DEFINITE = 1e-13
# Smallest size of the largest entry, and one over the largest: sums of some stay floats.
_SMALLEST = 1e-300


def checked(
    W: SparseOrDense, q: npt.ArrayLike, mu: npt.ArrayLike, dim: int, source: str | None = None
) -> tuple[sp.csr_matrix, np.ndarray, np.ndarray]:
    """The problem u = W r + q in one form, or an error that says what is wrong and where.

    A contact whose rows and columns of W all vanish (both sides prescribed) is accepted.

    Args:
        W: shape (num_contacts * dim, num_contacts * dim), sparse or an array; symmetric to 1 % of
            max |W|, each diagonal block positive definite.
        q: shape (num_contacts * dim,), normal first at each contact.
        mu: shape (num_contacts,), or a scalar for all; zero or above.
        dim: 2 or 3.
        source: the file it came from, named in the errors.

    Returns:
        W as canonical CSR of float64, sharing its arrays with the one given if that was one; q of
        float64; mu one a contact.

    Raises:
        ValueError: anything else, naming the contact, or the row and column.
    """
    file = "" if source is None else f"{source}: "
    if not isinstance(dim, Integral) or dim not in (2, 3):
        raise ValueError(f"{file}dim should be 2 or 3, got {dim!r}.")
    W = _matrix(W, file)
    size = W.shape[0]
    if W.shape[1] != size:
        raise ValueError(f"{file}W should be square, got shape {W.shape}.")
    if size % dim:
        raise ValueError(
            f"{file}W should have {dim} rows a contact in dimension {dim}, got {size} rows; "
            "check dim."
        )
    num_contacts = size // dim
    q = _vector("q", q, file)
    if q.shape != (size,):
        raise ValueError(f"{file}q should have shape ({size},) like W, got {q.shape}.")
    mu = _vector("mu", mu, file)
    if mu.shape not in ((), (num_contacts,)):
        raise ValueError(
            f"{file}mu should be a number or have shape ({num_contacts},), one a contact, "
            f"got {mu.shape}."
        )
    mu = np.array(np.broadcast_to(mu, num_contacts))
    bad = np.flatnonzero(~np.isfinite(q))
    if bad.size:
        raise ValueError(
            f"{file}q should be finite, got {q[bad[0]]} at row {bad[0]} (contact {bad[0] // dim})."
        )
    bad = np.flatnonzero(~(np.isfinite(mu) & (mu >= 0.0)))
    if bad.size:
        raise ValueError(
            f"{file}mu should be finite and not negative, got {mu[bad[0]]} at contact {bad[0]}."
        )
    _require_finite(W, dim, file)
    for name, values in (("W", W.data), ("q", q)):
        largest = np.abs(values).max(initial=0.0)
        if largest > 0.0 and not _SMALLEST < largest < 1.0 / _SMALLEST:
            raise ValueError(
                f"{file}{name} has entries up to {largest:.3g}, at the end of the range of floats; "
                "take other units."
            )
    _require_symmetric(W, dim, file)
    _require_definite_blocks(W, dim, file)
    return W, q, mu


def _matrix(W: SparseOrDense, file: str) -> sp.csr_matrix:
    if not sp.issparse(W) and not (isinstance(W, np.ndarray) and W.ndim == 2):
        raise ValueError(
            f"{file}W should be a SciPy sparse matrix or an array with two dimensions, got "
            f"{type(W).__name__} of shape {np.shape(W)}."
        )
    if W.dtype.kind not in "iuf":
        raise ValueError(f"{file}W should hold real numbers, got {W.dtype}.")
    W = sp.csr_matrix(W, dtype=np.float64)
    try:
        W.check_format(full_check=True)
    except ValueError as error:
        raise ValueError(f"{file}W is not a valid sparse matrix: {error}.") from error
    if not W.has_canonical_format:
        W = W.copy()  # may share its arrays with the one given
        W.sum_duplicates()
    return W


def _vector(name: str, value: npt.ArrayLike, file: str) -> np.ndarray:
    value = np.asarray(value)
    if value.dtype.kind not in "iuf":
        raise ValueError(f"{file}{name} should hold real numbers, got {value.dtype}.")
    return np.ascontiguousarray(value, dtype=np.float64) if value.ndim else value.astype(float)


def _place(W: sp.csr_matrix, k: int, dim: int) -> str:
    """Where the stored entry k is, in words."""
    row = np.searchsorted(W.indptr, k, side="right") - 1
    column = W.indices[k]
    return f"row {row}, column {column} (contacts {row // dim} and {column // dim})"


def _require_finite(W: sp.csr_matrix, dim: int, file: str) -> None:
    bad = np.flatnonzero(~np.isfinite(W.data))
    if bad.size:
        raise ValueError(
            f"{file}W should be finite, got {W.data[bad[0]]} at {_place(W, bad[0], dim)}."
        )


def _require_symmetric(W: sp.csr_matrix, dim: int, file: str) -> None:
    difference = sp.csr_matrix(W - W.T)
    if difference.nnz == 0:
        return
    size = np.abs(difference.data)
    worst = size.argmax()
    limit = _ASYMMETRY * np.abs(W.data).max()
    if size[worst] > limit:
        raise ValueError(
            f"{file}W should be symmetric to {limit:.3g} (1 % of its largest entry), got "
            f"|W - W^T| = {size[worst]:.3g} at {_place(difference, worst, dim)}; W = H^T M^-1 H is "
            "symmetric: check that the rows and columns of each contact come in the same order."
        )


def _require_definite_blocks(W: sp.csr_matrix, dim: int, file: str) -> None:
    blocks = np.empty((W.shape[0] // dim, dim, dim))
    for i in range(dim):
        for j in range(dim):
            blocks[:, i, j] = W.diagonal(j - i)[min(i, j) :: dim][: len(blocks)]
    values = np.linalg.eigvalsh(0.5 * (blocks + blocks.transpose(0, 2, 1)))
    bad = np.flatnonzero(~(values[:, 0] > _DEFINITE * values[:, -1]))
    if bad.size:
        magnitude = abs(W)
        coupling = magnitude.sum(axis=1).A1 + magnitude.sum(axis=0).A1
        bad = bad[coupling.reshape(-1, dim).any(axis=1)[bad]]
    if bad.size:
        raise ValueError(
            f"{file}the diagonal block of W should be positive definite at each contact, got "
            f"eigenvalues {values[bad[0]]} at contact {bad[0]} ({bad.size} such in all); leave out "
            "a contact that cannot move, or give zero rows and columns for it."
        )
