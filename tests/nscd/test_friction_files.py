# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact problems written and read back, FCLIB's formats against dense algebra, damaged files."""

from __future__ import annotations

import re

import h5py
import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from problems import box_stack, square_pile

from xper_fx.nscd.friction.problem_files import read, write


def put(group, name, matrix, kind):
    """FCLIB's SparseMatrix, with room for more entries than there are where it allows that."""
    matrix = np.asarray(matrix)
    if kind == "triplet":
        stored = sp.coo_matrix(matrix)
        # every entry in two halves: triplets add up
        p, i = np.tile(stored.row, 2), np.tile(stored.col, 2)
        x, nz, room = np.tile(0.5 * stored.data, 2), 2 * stored.nnz, 0
    else:
        stored = sp.csr_matrix(matrix) if kind == "csr" else sp.csc_matrix(matrix)
        p, i, x, nz, room = stored.indptr, stored.indices, stored.data, {"csr": -2, "csc": -1}, 3
        nz = nz[kind]
    for key, value in {"m": matrix.shape[0], "n": matrix.shape[1], "nz": nz}.items():
        group[f"{name}/{key}"] = np.array([value], dtype=np.int32)
    group[f"{name}/nzmax"] = np.array([len(x) + room], dtype=np.int32)
    group[f"{name}/p"] = p.astype(np.int32)
    group[f"{name}/i"] = np.append(i, np.full(room, -7)).astype(np.int32)
    group[f"{name}/x"] = np.append(x, np.zeros(room))


def put_problem(path, group, matrices, vectors, kind="csc", dim=3):
    with h5py.File(path, "w") as file:
        root = file.create_group(group)
        root["spacedim"] = np.array([dim], dtype=np.int32)
        for name, matrix in matrices.items():
            put(root, name, matrix, kind)
        for name, vector in vectors.items():
            root[f"vectors/{name}"] = vector


def spd(rng, n):
    a = rng.normal(size=(n, n))
    return a @ a.T + np.eye(n)


@pytest.mark.parametrize("suffix", ["npz", "hdf5", "h5", "NPZ"])
@pytest.mark.parametrize("problem", [square_pile(2), box_stack(2)], ids=["2D", "3D"])
def test_round_trip(tmp_path, suffix, problem):
    path = tmp_path / f"problem.{suffix}"
    upper = problem.W + 1e-3 * sp.triu(problem.W)  # rows are not columns
    problem = problem._replace(W=sp.csr_matrix(upper))
    write(path, *problem, source="a pile, écrit")
    W, q, mu, dim = read(path)
    assert W.has_canonical_format and W.dtype == q.dtype == mu.dtype == np.float64
    np.testing.assert_array_equal(W.toarray(), problem.W.toarray())
    np.testing.assert_array_equal(q, problem.q)
    np.testing.assert_array_equal(mu, problem.mu)
    assert dim == problem.dim


def test_one_mu_and_other_keys(tmp_path):
    W, q, _, dim = square_pile(2)
    path = tmp_path / "p.npz"
    np.savez(
        path, data=W.data, indices=W.indices, indptr=W.indptr, shape=W.shape, q=q, mu=0.25, dim=dim,
        kind="local", when=[2026],
    )  # fmt: skip
    np.testing.assert_array_equal(read(path)[2], np.full(len(q) // 2, 0.25))
    write(tmp_path / "p.h5", W, q, 0.5, dim)
    np.testing.assert_array_equal(read(tmp_path / "p.h5")[2], np.full(len(q) // 2, 0.5))


def test_parts_of_an_entry_add_up(tmp_path):
    np.savez(
        tmp_path / "p.npz", data=[1.0, 2.0, 3.0, 4.0], indices=[1, 0, 1, 1], indptr=[0, 3, 4],
        shape=(2, 2), q=np.zeros(2), mu=0.5, dim=2,
    )  # fmt: skip
    W = read(tmp_path / "p.npz")[0]
    assert W.has_canonical_format and W.nnz == 3
    np.testing.assert_array_equal(W.toarray(), [[2.0, 4.0], [0.0, 4.0]])


@pytest.mark.parametrize("kind", ["csr", "csc", "triplet"])
def test_fclib_local(tmp_path, kind):
    rng = np.random.default_rng(0)
    W = rng.normal(size=(6, 6)) * (rng.random((6, 6)) > 0.4)  # not symmetric: rows are not columns
    q, mu = rng.normal(size=6), np.array([0.1, 0.7])
    path = tmp_path / "local.hdf5"
    put_problem(path, "fclib_local", {"W": W}, {"q": q, "mu": mu}, kind)
    got, got_q, got_mu, dim = read(path)
    assert got.has_canonical_format and dim == 3
    np.testing.assert_allclose(got.toarray(), W, rtol=1e-15)
    np.testing.assert_array_equal(got_q, q)
    np.testing.assert_array_equal(got_mu, mu)


def test_fclib_local_with_bilateral_part(tmp_path):
    """The multiplier solved for by hand satisfies both equations of the file."""
    rng = np.random.default_rng(1)
    W, V, R = spd(rng, 6), rng.normal(size=(6, 2)), spd(rng, 2)
    q, s, r = rng.normal(size=6), rng.normal(size=2), rng.normal(size=6)
    path = tmp_path / "local.hdf5"
    vectors = {"q": q, "s": s, "mu": np.full(2, 0.3)}
    put_problem(path, "fclib_local", {"W": W, "V": V, "R": R}, vectors)
    reduced_W, reduced_q, _, _ = read(path)
    multiplier = np.linalg.solve(R, -V.T @ r - s)
    np.testing.assert_allclose(reduced_W @ r + reduced_q, W @ r + V @ multiplier + q, rtol=1e-12)


@pytest.mark.parametrize("kind", ["csr", "csc", "triplet"])
@pytest.mark.parametrize("bilateral", [0, 3])
def test_fclib_global(tmp_path, kind, bilateral):
    """Against v = particular + Z y with Z a basis of the kernel of G^T, M y from Z^T M Z."""
    rng = np.random.default_rng(2)
    dofs, rows = 11, 300  # more rows than are solved for at once
    M, H = spd(rng, dofs), rng.normal(size=(dofs, rows))
    G, b = rng.normal(size=(dofs, bilateral)), rng.normal(size=bilateral)
    f, w = rng.normal(size=dofs), rng.normal(size=rows)
    matrices, vectors = {"M": M, "H": H}, {"f": f, "w": w, "mu": np.full(rows // 3, 0.3)}
    if bilateral:
        matrices["G"], vectors["b"] = G, b
        Z = scipy.linalg.null_space(G.T)
        particular = -np.linalg.pinv(G.T) @ b
    else:
        Z, particular = np.eye(dofs), np.zeros(dofs)
    path = tmp_path / "global.hdf5"
    put_problem(path, "fclib_global", matrices, vectors, kind)
    W, q, mu, dim = read(path)
    w_inverse = Z @ np.linalg.inv(Z.T @ M @ Z) @ Z.T
    v_free = particular + w_inverse @ (f - M @ particular)
    np.testing.assert_allclose(W.toarray(), H.T @ w_inverse @ H, atol=1e-11)
    np.testing.assert_allclose(q, w + H.T @ v_free, atol=1e-11)
    assert mu.shape == (100,) and dim == 3


def test_fclib_global_of_scales(tmp_path):
    """A mass of 1e-12 beside one of 1e9, and no contact between them: W stays sparse and exact."""
    path = tmp_path / "global.hdf5"
    M = np.diag([1e-12, 1e-12, 1e9, 1e9])
    vectors = {"f": np.array([-1e-12, 0.0, -1e9, 0.0]), "w": np.zeros(4), "mu": np.full(2, 0.3)}
    put_problem(path, "fclib_global", {"M": M, "H": np.eye(4)}, vectors, dim=2)
    W, q, _, _ = read(path)
    assert W.nnz == 4
    np.testing.assert_allclose(W.diagonal(), [1e12, 1e12, 1e-9, 1e-9], rtol=1e-14)
    np.testing.assert_allclose(q, [-1.0, 0.0, -1.0, 0.0], rtol=1e-14)  # both fall on the ground


def test_redundant_bilateral_equations(tmp_path):
    rng = np.random.default_rng(3)
    G = rng.normal(size=(5, 2)) @ np.array([[1.0, 0.0, 0.3], [0.0, 1.0, 0.7]])
    path = tmp_path / "global.hdf5"
    vectors = {"f": np.zeros(5), "w": np.zeros(3), "b": np.zeros(3), "mu": np.ones(1)}
    put_problem(path, "fclib_global", {"M": np.eye(5), "H": np.ones((5, 3)), "G": G}, vectors)
    with pytest.raises(ValueError, match=r"global\.hdf5.*fclib_global/G.*redundant"):
        read(path)


# Errors: the file and the entry are named.


def good():
    W, q, mu, dim = box_stack(2)
    return {
        "data": W.data.copy(), "indices": W.indices.copy(), "indptr": W.indptr.copy(),
        "shape": np.array(W.shape), "q": q.copy(), "mu": mu.copy(), "dim": np.array(dim),
    }  # fmt: skip


def changed(name, index, value):
    def change(entries):
        entries[name][index] = value

    return change


def replaced(name, value):
    return lambda entries: entries.update({name: value})


BAD = {
    "a missing key": (lambda entries: entries.pop("indptr"), "indptr.*missing"),
    "no dimension": (lambda entries: entries.pop("dim"), "dim.*missing"),
    "dimension 4": (replaced("dim", np.array(4)), "dim.*2 or 3, got 4"),
    "half a dimension": (replaced("dim", np.array(2.5)), "dim.*one integer"),
    "a short q": (replaced("q", np.zeros(23)), "q.*multiple of 3"),
    "another q": (replaced("q", np.zeros(21)), "mu.*7 values|shape.*21"),
    "q as a table": (replaced("q", np.zeros((8, 3))), "q.*one dimension"),
    "mu of another length": (replaced("mu", np.full(3, 0.5)), "mu.*8 values"),
    "another shape": (replaced("shape", np.array([24, 23])), "shape.*24, 24"),
    "a column too far": (changed("indices", 5, 24), "indices.*24 at 5, out of range 0..23"),
    "a negative column": (changed("indices", 0, -1), "indices.*-1 at 0"),
    "pointers that fall": (changed("indptr", 4, 1), "indptr.*rise.*1 at 4"),
    "pointers from 1": (changed("indptr", 0, 1), "indptr.*rise from 0, got 1 at 0"),
    "pointers past the data": (changed("indptr", -1, 10**6), "indptr.*1000000 at 24"),
    "short pointers": (replaced("indptr", np.array([0, 1])), "indptr.*25 values, got 2"),
    "short indices": (replaced("indices", np.array([0, 1])), "indices.*values, got 2"),
    "real indices": (replaced("indices", np.zeros(900)), "indices.*integers"),
    "NaN in W": (changed("data", 7, np.nan), "data.*not finite at 7"),
    "an infinite q": (changed("q", 2, np.inf), "q.*not finite at 2: inf"),
    "NaN friction": (changed("mu", 1, np.nan), "mu.*not finite at 1"),
    "words": (replaced("q", np.array(["a"] * 24)), "q.*numbers"),
    "objects": (replaced("q", np.array([None] * 24)), "q.*cannot be read"),
}


@pytest.mark.parametrize("change, message", BAD.values(), ids=BAD.keys())
def test_bad_npz(tmp_path, change, message):
    entries = good()
    change(entries)
    path = tmp_path / "bad.npz"
    np.savez(path, **entries)
    with pytest.raises(ValueError, match=r"bad\.npz: .*(" + message + ")"):
        read(path)


BAD_FCLIB = {
    "no matrix": (lambda root: root.__delitem__("W"), "fclib_local/W/m.*missing"),
    "no values": (lambda root: root.__delitem__("W/x"), "fclib_local/W/x.*missing"),
    "no friction": (lambda root: root.__delitem__("vectors/mu"), "vectors/mu.*missing"),
    "no dimension": (lambda root: root.__delitem__("spacedim"), "spacedim.*missing"),
    "another size": (("W/m", np.array([23])), r"fclib_local/W'.*\(24, 24\).*\(23, 24\)"),
    "an unknown kind": (("W/nz", np.array([-3])), "W/nz.*-3"),
    "triplets too few": (("W/nz", np.array([10**5])), "W/p.*100000 values"),
    "a column too far": (("W/i", np.full(864, 99)), "W/i.*99 at 0, out of range 0..23"),
    "NaN": (("vectors/q", np.full(24, np.nan)), "vectors/q.*not finite at 0"),
    "a group for a vector": (("vectors/q", None), "vectors/q.*(cannot be read|missing)"),
}


@pytest.mark.parametrize("change, message", BAD_FCLIB.values(), ids=BAD_FCLIB.keys())
def test_bad_fclib(tmp_path, change, message):
    path = tmp_path / "bad.hdf5"
    write(path, *box_stack(2))
    with h5py.File(path, "a") as file:
        root = file["fclib_local"]
        if callable(change):
            change(root)
        else:
            name, value = change
            del root[name]
            if value is None:
                root.create_group(name)
            else:
                root[name] = value
    with pytest.raises(ValueError, match=r"bad\.hdf5: .*(" + message + ")"):
        read(path)


@pytest.mark.parametrize("suffix", ["npz", "hdf5"])
@pytest.mark.parametrize("kept", [0.0, 0.01, 0.3, 0.7, 0.99])
def test_truncated(tmp_path, suffix, kept):
    path = tmp_path / f"cut.{suffix}"
    write(path, *box_stack(4))
    content = path.read_bytes()
    path.write_bytes(content[: int(kept * len(content))])
    with pytest.raises(ValueError, match=rf"cut\.{suffix}: .*(truncated|damaged)"):
        read(path)


def test_triplets_without_all_their_values(tmp_path):
    path = tmp_path / "bad.hdf5"
    put_problem(path, "fclib_local", {"W": np.eye(3)}, {"q": np.zeros(3), "mu": [0.5]}, "triplet")
    with h5py.File(path, "a") as file:
        del file["fclib_local/W/x"]
        file["fclib_local/W/x"] = np.ones(5)
    with pytest.raises(ValueError, match=r"bad\.hdf5: .*W/x.*6 values, got 5"):
        read(path)


def test_damaged_inside(tmp_path):
    """A byte of the compressed values of W flipped: the entry is named."""
    path = tmp_path / "damaged.npz"
    write(path, *box_stack(4))
    content = bytearray(path.read_bytes())
    content[120] ^= 0xFF
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"damaged\.npz: entry 'data' cannot be read"):
        read(path)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["npz", "hdf5"])
def test_damaged_anywhere(tmp_path, suffix):
    """Whatever bytes change, the file is read or refused by its name: nothing else is raised."""
    path = tmp_path / f"damaged.{suffix}"
    write(path, *box_stack(1))
    good = path.read_bytes()
    rng = np.random.default_rng(0)
    refused = 0
    for _ in range(400):
        content = bytearray(good)
        for at in rng.integers(0, len(good), 3):
            content[at] = rng.integers(256)
        path.write_bytes(content)
        try:
            read(path)
        except ValueError as error:
            assert str(error).startswith(f"{path}: ")
            refused += 1
    assert refused > 100


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"shape": (1 << 37,), "chunks": (1 << 16,)}, "vectors/q' declares 1099511627776 bytes"),
        ({"shape": (2,), "external": [("/etc/hostname", 0, 16)]}, "vectors/q' .* external files"),
        (h5py.ExternalLink("other.h5", "q"), "vectors/q' is a link into another file"),
    ],
)
def test_a_file_holds_what_it_declares(tmp_path, how, words):
    path = tmp_path / "p.hdf5"
    write(path, *box_stack(1))
    with h5py.File(path, "a") as file:
        del file["fclib_local/vectors/q"]
        if isinstance(how, dict):
            file["fclib_local/vectors"].create_dataset("q", dtype="f8", **how)
        else:
            file["fclib_local/vectors/q"] = how
    with pytest.raises(ValueError, match=words):
        read(path)


def test_compressed_zeros_are_no_lie(tmp_path):
    """A thousandfold is what gzip makes of them."""
    path = tmp_path / "p.hdf5"
    write(path, *box_stack(1))
    with h5py.File(path, "a") as file:
        file.create_dataset("zeros", data=np.zeros(4_000_000), compression="gzip")
    assert path.stat().st_size < 100_000
    assert len(read(path)[2]) == len(box_stack(1)[2])


def test_neither_one_nor_the_other(tmp_path):
    with pytest.raises(FileNotFoundError, match=re.escape(str(tmp_path / "none.npz"))):
        read(tmp_path / "none.npz")
    with pytest.raises(FileNotFoundError, match=re.escape(str(tmp_path / "none.h5"))):
        read(tmp_path / "none.h5")
    for action in (read, lambda path: write(path, *box_stack(1))):
        with pytest.raises(ValueError, match=r"p\.dat.*\.npz, \.hdf5 or \.h5"):
            action(tmp_path / "p.dat")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file.create_group("mesh")
    with pytest.raises(ValueError, match=r"other\.h5.*fclib_local or fclib_global"):
        read(tmp_path / "other.h5")
    with (tmp_path / "array.npz").open("wb") as file:
        np.save(file, np.zeros(3))
    with pytest.raises(ValueError, match=r"array\.npz.*one array"):
        read(tmp_path / "array.npz")
