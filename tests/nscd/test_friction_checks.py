# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a contact problem must be, and what is said when it is not."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from problems import box_stack, capsule_heap, square_pile, with_zero_rows

from xper_fx.nscd.friction.input_checks import checked


def entry(W, row, column, value):
    W = W.tolil(copy=True)
    W[row, column] = value
    return W.tocsr()


@pytest.mark.parametrize("problem", [square_pile(2), capsule_heap(20)], ids=["2D", "3D"])
@pytest.mark.parametrize(
    "form", [sp.csr_matrix, sp.coo_matrix, sp.csc_array, sp.csr_matrix.toarray]
)
def test_one_form(problem, form):
    W, q, mu = checked(form(problem.W), list(problem.q), 0.5, problem.dim)
    assert isinstance(W, sp.csr_matrix) and W.has_canonical_format and W.dtype == np.float64
    np.testing.assert_array_equal(W.toarray(), problem.W.toarray())
    np.testing.assert_array_equal(q, problem.q)
    np.testing.assert_array_equal(mu, np.full(len(q) // problem.dim, 0.5))


def test_what_is_given_is_not_changed():
    """A CSR with its columns out of order and an entry in two parts; and no copy if it has none."""
    W, q, mu, dim = box_stack(1)
    mixed = sp.csr_matrix((W.data.copy(), W.indices.copy(), W.indptr.copy()), shape=W.shape)
    end = mixed.indptr[1]
    mixed.indices[:end] = mixed.indices[:end][::-1]
    mixed.data[:end] = mixed.data[:end][::-1]
    mixed.has_sorted_indices = mixed.has_canonical_format = False
    before = mixed.indices.copy()
    got, _, got_mu = checked(mixed, q, mu, dim)
    np.testing.assert_array_equal(got.toarray(), W.toarray())
    np.testing.assert_array_equal(mixed.indices, before)
    assert got.has_canonical_format and got_mu is not mu
    assert np.shares_memory(checked(W, q, mu, dim)[0].data, W.data)


def test_measured_asymmetry_is_accepted():
    W, q, mu, dim = box_stack(2)
    checked(entry(W, 0, 1, W[1, 0] + 1.4e-3 * abs(W).max()), q, mu, dim)


def test_blocks_over_eight_decades_are_accepted():
    checked(np.diag([1.0, 1e-8, 1e-8, 1e9, 1.0, 1.0]), np.zeros(6), 0.3, 3)


def test_no_contacts():
    W, q, mu = checked(sp.csr_matrix((0, 0)), np.zeros(0), 0.3, 3)
    assert W.shape == (0, 0) and q.size == mu.size == 0


def test_a_contact_that_cannot_move_is_accepted():
    problem = with_zero_rows(box_stack(3), [0, 5])
    assert checked(*problem)[0][15:18].nnz == 0
    # zeros that are stored count as zeros
    stored = sp.csr_matrix((np.zeros(9), np.tile(np.arange(3), 3), [0, 3, 6, 9]), shape=(3, 3))
    checked(stored, np.zeros(3), 0.3, 3)


W, Q, MU, _ = box_stack(2)
SIZE = len(Q)
COUPLED = sp.diags((np.arange(SIZE) // 3 != 1).astype(float))  # contact 1: nothing of its own
COUPLED = entry(COUPLED, 0, 3, 0.005)

BAD = {
    "a list": ((W.toarray().tolist(), Q, MU, 3), r"W.*sparse.*list"),
    "a vector": ((np.zeros(24), Q, MU, 3), r"W.*two dimensions.*\(24,\)"),
    "complex": ((W.astype(complex), Q, MU, 3), r"W.*real.*complex"),
    "not square": ((W[:, :21], Q, MU, 3), r"W.*square.*\(24, 21\)"),
    "dimension": ((W, Q, MU, 4), r"dim.*2 or 3, got 4"),
    "dimension None": ((W, Q, MU, None), r"dim.*2 or 3, got None"),
    "not a multiple": ((W[:23, :23], Q[:23], MU, 3), r"3 rows a contact.*23"),
    "short q": ((W, Q[:-1], MU, 3), r"q.*\(24,\).*\(23,\)"),
    "q as a table": ((W, Q.reshape(8, 3), MU, 3), r"q.*\(24,\).*\(8, 3\)"),
    "q of words": ((W, ["a"] * 24, MU, 3), r"q.*real"),
    "short mu": ((W, Q, MU[:-1], 3), r"mu.*\(8,\).*\(7,\)"),
    "one mu in a list": ((W, Q, [0.3], 3), r"mu.*\(8,\).*\(1,\)"),
    "NaN in q": ((W, np.where(np.arange(SIZE) == 7, np.nan, Q), MU, 3), r"q.*row 7 \(contact 2\)"),
    "negative mu": ((W, Q, np.where(np.arange(8) == 5, -0.1, MU), 3), r"mu.*-0\.1 at contact 5"),
    "NaN mu": ((W, Q, np.nan, 3), r"mu.*nan at contact 0"),
    "infinite mu": ((W, Q, np.inf, 3), r"mu.*inf at contact 0"),
    "NaN in W": (
        (entry(W, 10, 13, np.nan), Q, MU, 3),
        r"W.*nan at row 10, column 13 \(contacts 3 and 4\)",
    ),
    "asymmetric": (
        (entry(W, 20, 2, W[2, 20] + 0.011 * abs(W).max()), Q, MU, 3),
        r"symmetric.*row (2|20), column (20|2) \(contacts (0|6) and (6|0)\).*H\^T M\^-1 H",
    ),
    "antisymmetric": ((W - 2 * sp.tril(W, -1), Q, MU, 3), r"symmetric"),
    "negative block": ((W - sp.diags(np.where(np.arange(SIZE) == 9, 1.0, 0.0)), Q, MU, 3),
                       r"positive definite.*contact 3 \(1 such"),
    "singular block": ((np.diag([1.0, 1.0, 1e-14]), np.zeros(3), 0.3, 3), r"definite.*contact 0"),
    "zero block, a column": ((COUPLED, Q, MU, 3), r"positive definite.*contact 1"),
    "zero block, a row": ((COUPLED.T, Q, MU, 3), r"positive definite.*contact 1"),
    "indefinite off the diagonal": (
        (np.array([[1.0, 2.0], [2.0, 1.0]]), np.zeros(2), 0.3, 2), r"definite.*-1.*contact 0"),
}  # fmt: skip


@pytest.mark.parametrize("given, message", BAD.values(), ids=BAD.keys())
def test_refused(given, message):
    with pytest.raises(ValueError, match=message):
        checked(*given)
    with pytest.raises(ValueError, match=r"^some/file\.npz: .*" + message):
        checked(*given, source="some/file.npz")


def test_index_out_of_range():
    """A sparse matrix made past SciPy's own check would be read out of bounds."""
    broken = W.copy()
    broken.indices[4] = SIZE + 5
    with pytest.raises(ValueError, match="not a valid sparse matrix"):
        checked(broken, Q, MU, 3)


def test_all_blocks_are_looked_at():
    """Each of the three eigen-directions of each contact in turn."""
    for row in range(SIZE):
        with pytest.raises(ValueError, match=f"contact {row // 3} "):
            checked(sp.eye(SIZE) - 2.0 * sp.diags(np.arange(SIZE) == row, dtype=float), Q, MU, 3)
