# SPDX-License-Identifier: LGPL-3.0-or-later
"""Frictional contact problems in files: `.npz`, and FCLIB's HDF5 (`.hdf5`, `.h5`).

FCLIB (Acary et al. 2014, Inria RT-444; `fclib.h`) holds, normal first at each contact,

    local   u = W r + V l + q,   V^T r + R l + s = 0          (V, R, s optional),
    global  u = H^T v + w,   M v = H r + G l + f,   G^T v + b = 0   (G, b optional),

with r_N >= 0 in compression and the column 0 of a contact its normal. Both become u = W r + q here:
the multiplier l is eliminated by W <- W - V R^-1 V^T, q <- q - V R^-1 s, and v by solving with
K = [[M, G], [G^T, 0]], which is the Schur complement on G without forming it:

    W = [H; 0]^T K^-1 [H; 0],   q = w + [H; 0]^T K^-1 [f; -b].
"""

from __future__ import annotations

import math
import tokenize
import zipfile
import zlib
from pathlib import Path

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from xper_fx.nscd.friction.input_checks import SparseOrDense
from xper_fx.support.checks import require_path
from xper_fx.support.hdf5_checks import require_own_content

# Right-hand sides solved at a time: bounds the dense part of a condensation.
_COLUMNS = 256
# Smallest pivot of a matrix to eliminate, relative to its largest.
_SINGULAR = 1e-14
# What NumPy, zipfile and h5py raise on the bytes of a damaged file (found by flipping some).
_DAMAGE = (
    OSError, EOFError, KeyError, MemoryError, RuntimeError, SyntaxError, TypeError, ValueError,
    tokenize.TokenError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip


def read(path: str | Path) -> tuple[sp.csr_matrix, np.ndarray, np.ndarray, int]:
    """Read a problem u = W r + q.

    Args:
        path: a `.npz` file with `data, indices, indptr, shape` (W as CSR), `q`, `mu`, `dim` and
            anything else; or a `.hdf5` or `.h5` file of FCLIB, local or global.

    Returns:
        W, shape (num_contacts * dim, num_contacts * dim), canonical; q, shape
        (num_contacts * dim,); mu, shape (num_contacts,); dim, 2 or 3. Units are the file's.

    Raises:
        FileNotFoundError: no such file.
        TypeError: no path.
        ValueError: another suffix, or a file that is truncated or not in its format; names the file
            and the entry.
    """
    path = require_path("path", path)
    reader = {".npz": _read_npz, ".hdf5": _read_fclib, ".h5": _read_fclib}.get(_suffix(path))
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file.")
    return reader(path)


def write(
    path: str | Path,
    W: SparseOrDense,
    q: npt.ArrayLike,
    mu: npt.ArrayLike,
    dim: int,
    source: str = "",
) -> None:
    """Write a problem u = W r + q, in the format that the suffix names; overwrites.

    Args:
        path: ends in `.npz`, `.hdf5` or `.h5` (FCLIB, local).
        W: shape (num_contacts * dim, num_contacts * dim), sparse.
        q: shape (num_contacts * dim,), normal first at each contact.
        mu: shape (num_contacts,), or a scalar for all.
        dim: 2 or 3.
        source: where the problem came from, kept in the file.

    Raises:
        TypeError: no path.
        ValueError: another suffix.
    """
    path = require_path("path", path)
    suffix = _suffix(path)
    W = sp.csr_matrix(W, dtype=np.float64)
    W.sum_duplicates()
    q = np.asarray(q, dtype=np.float64)
    mu = np.broadcast_to(np.asarray(mu, dtype=np.float64), len(q) // dim)
    if suffix == ".npz":
        with path.open("wb") as file:
            np.savez_compressed(
                file, data=W.data, indices=W.indices, indptr=W.indptr, shape=W.shape,
                q=q, mu=mu, dim=dim, source=source,
            )  # fmt: skip
        return
    import h5py

    with h5py.File(path, "w") as file:
        local = file.create_group("fclib_local")
        local["spacedim"] = np.array([dim], dtype=np.int32)
        local["vectors/q"] = q
        local["vectors/mu"] = mu
        for name, value in zip("mn", W.shape, strict=True):
            local[f"W/{name}"] = np.array([value], dtype=np.int32)
        W = W.tocsc()  # all that FCLIB's own merit function understands
        local["W/nz"] = np.array([-1], dtype=np.int32)
        local["W/nzmax"] = np.array([W.nnz], dtype=np.int32)
        local["W/p"] = W.indptr.astype(np.int32)
        local["W/i"] = W.indices.astype(np.int32)
        local["W/x"] = W.data
        text = source.encode()  # FCLIB reads it as a C string: room for the final zero
        local["info/description"] = np.array(text, dtype=f"S{len(text) + 1}")


def _suffix(path: Path) -> str:
    suffix = path.suffix.lower()
    if suffix not in (".npz", ".hdf5", ".h5"):
        raise ValueError(f"{path}: the name should end in .npz, .hdf5 or .h5, got {suffix!r}.")
    return suffix


class _Entries:
    """The numbers in an open `.npz` or HDF5 file, each checked as it is read."""

    def __init__(self, path: Path, store) -> None:
        self.path = path
        self.store = store

    def error(self, name: str, what: str) -> ValueError:
        return ValueError(f"{self.path}: entry '{name}' {what}.")

    def damaged(self, name: str, error: Exception) -> ValueError:
        return self.error(name, f"cannot be read, the file is damaged ({error})")

    def __contains__(self, name: str) -> bool:
        try:
            return name in self.store
        except _DAMAGE as error:
            raise self.damaged(name, error) from error

    def array(self, name: str) -> np.ndarray:
        """The entry as it is stored, whatever its shape: integers or reals, finite."""
        if name not in self:
            raise self.error(name, "is missing")
        try:
            if isinstance(self.store, np.lib.npyio.NpzFile):
                self._require_room(name)
            value = self.store[name][()]
        except _DAMAGE as error:
            raise self.damaged(name, error) from error
        value = np.asarray(value)
        if value.dtype.kind not in "iuf":
            raise self.error(name, f"should hold numbers, got {value.dtype}")
        bad = np.flatnonzero(~np.isfinite(value))
        if bad.size:
            raise self.error(name, f"is not finite at {bad[0]}: {value.ravel()[bad[0]]}")
        return value

    def _require_room(self, name: str) -> None:
        """Raise a ValueError if an `.npz` entry declares more than it holds."""
        info = self.store.zip.getinfo(f"{name}.npy")
        with self.store.zip.open(info) as file:
            version = np.lib.format.read_magic(file)
            read = np.lib.format.read_array_header_2_0
            if version == (1, 0):
                read = np.lib.format.read_array_header_1_0
            shape, _, dtype = read(file)
        declared = math.prod(shape) * dtype.itemsize
        if declared > info.file_size:
            raise ValueError(f"it declares {declared} bytes and holds {info.file_size}")

    def integer(self, name: str) -> int:
        value = self.array(name)
        if value.size != 1 or value.ravel()[0] != int(value.ravel()[0]):
            raise self.error(name, f"should be one integer, got {value}")
        return int(value.ravel()[0])

    def vector(self, name: str) -> np.ndarray:
        value = self.array(name)
        if value.ndim != 1:
            raise self.error(name, f"should have one dimension, got shape {value.shape}")
        return value.astype(np.float64)

    def integers(self, name: str, length: int, below: int) -> np.ndarray:
        """The first `length` of at least as many integers from 0 to `below` - 1."""
        value = self.array(name)
        if value.ndim != 1 or value.dtype.kind not in "iu":
            raise self.error(name, f"should be a list of integers, got {value.dtype} {value.shape}")
        if value.size < length:
            raise self.error(name, f"should have {length} values, got {value.size}")
        value = value[:length]
        bad = np.flatnonzero((value < 0) | (value >= below))
        if bad.size:
            raise self.error(name, f"is {value[bad[0]]} at {bad[0]}, out of range 0..{below - 1}")
        return value

    def contacts(self, size_name: str, size: int, dim_name: str, mu_name: str):
        """The dimension, and the friction of each of the contacts that make up `size` rows."""
        dim = self.integer(dim_name)
        if dim not in (2, 3):
            raise self.error(dim_name, f"should be 2 or 3, got {dim}")
        if size % dim:
            raise self.error(size_name, f"should have a multiple of {dim} values, got {size}")
        mu = self.array(mu_name)
        if mu.size != 1 and mu.shape != (size // dim,):
            raise self.error(mu_name, f"should have {size // dim} values or 1, got {mu.shape}")
        return dim, np.array(np.broadcast_to(mu.astype(np.float64).ravel(), size // dim))

    def compressed(self, names: tuple[str, str, str], shape: tuple[int, int], kind):
        """A compressed matrix from `(pointers, indices, values)`; `kind` is csr_ or csc_matrix."""
        pointers, indices, values = names
        major, minor = shape if kind is sp.csr_matrix else shape[::-1]
        room = self.array(values).size
        p = self.integers(pointers, major + 1, room + 1)
        down = np.flatnonzero(np.diff(p) < 0)
        if p[0] != 0 or down.size:
            at = 0 if p[0] != 0 else down[0] + 1
            raise self.error(pointers, f"should rise from 0, got {p[at]} at {at}")
        i = self.integers(indices, p[-1], minor)
        matrix = kind((self.vector(values)[: p[-1]], i, p), shape=shape).tocsr()
        matrix.sum_duplicates()
        return matrix

    def sparse_matrix(self, name: str, shape: tuple[int, int]) -> sp.csr_matrix:
        """FCLIB's SparseMatrix: `nz` is -1 for CSC, -2 for CSR, else the number of triplets."""
        given = self.integer(f"{name}/m"), self.integer(f"{name}/n")
        if given != shape:
            raise self.error(name, f"should be {shape} to match the vectors, got {given}")
        names = f"{name}/p", f"{name}/i", f"{name}/x"
        nz = self.integer(f"{name}/nz")
        if nz < -2:
            raise self.error(f"{name}/nz", f"should be -2, -1 or a number of entries, got {nz}")
        if nz < 0:
            return self.compressed(names, shape, sp.csc_matrix if nz == -1 else sp.csr_matrix)
        rows, columns = self.integers(names[0], nz, shape[0]), self.integers(names[1], nz, shape[1])
        x = self.vector(names[2])
        if x.size < nz:
            raise self.error(names[2], f"should have {nz} values, got {x.size}")
        return sp.coo_matrix((x[:nz], (rows, columns)), shape=shape).tocsr()

    def inverse(self, name: str, matrix):
        """The function x -> `matrix`^-1 x, symmetrically scaled so that small pivots tell."""
        scale = np.sqrt(abs(matrix).max(axis=1).toarray().ravel())
        scale = sp.diags(1.0 / np.where(scale > 0.0, scale, 1.0))
        try:
            factors = splu(sp.csc_matrix(scale @ matrix @ scale))
            pivots = np.abs(factors.U.diagonal())
        except RuntimeError:  # an exact zero
            pivots = np.zeros(1)
        if pivots.size and pivots.min() <= _SINGULAR * pivots.max():
            raise self.error(name, "is singular, or makes the equations redundant; remove those")
        return lambda x: scale @ factors.solve(scale @ x)


def _read_npz(path: Path):
    with path.open("rb") as file:
        try:
            store = np.load(file)
        except _DAMAGE as error:
            message = f"{path}: not a readable .npz file, or truncated ({error})."
            raise ValueError(message) from error
        if not isinstance(store, np.lib.npyio.NpzFile):
            raise ValueError(f"{path}: not an .npz file, though named so; it holds one array.")
        entries = _Entries(path, store)
        q = entries.vector("q")
        dim, mu = entries.contacts("q", q.size, "dim", "mu")
        shape = entries.array("shape").tolist()
        if shape != [q.size, q.size]:
            raise entries.error("shape", f"should be {[q.size, q.size]} to match q, got {shape}")
        W = entries.compressed(("indptr", "indices", "data"), tuple(shape), sp.csr_matrix)
    return W, q, mu, dim


def _read_fclib(path: Path):
    import h5py

    try:
        file = h5py.File(path, "r")
    except _DAMAGE as error:
        raise ValueError(f"{path}: not a readable HDF5 file, or truncated ({error}).") from error
    with file:
        require_own_content(path, file)
        entries = _Entries(path, file)
        if "fclib_local" in entries:
            return _local(entries)
        if "fclib_global" in entries:
            return _global(entries)
        raise ValueError(f"{path}: should hold the group fclib_local or fclib_global.")


def _local(entries: _Entries):
    root = "fclib_local"
    q = entries.vector(f"{root}/vectors/q")
    names = f"{root}/spacedim", f"{root}/vectors/mu"
    dim, mu = entries.contacts(f"{root}/vectors/q", q.size, *names)
    W = entries.sparse_matrix(f"{root}/W", (q.size, q.size))
    if f"{root}/V" in entries:
        s = entries.vector(f"{root}/vectors/s")
        V = entries.sparse_matrix(f"{root}/V", (q.size, s.size))
        R = entries.sparse_matrix(f"{root}/R", (s.size, s.size))
        solve = entries.inverse(f"{root}/R", R)
        W = (W - _congruent(V, solve)).tocsr()
        q = q - V @ solve(s)
    return W, q, mu, dim


def _global(entries: _Entries):
    root = "fclib_global"
    w = entries.vector(f"{root}/vectors/w")
    f = entries.vector(f"{root}/vectors/f")
    names = f"{root}/spacedim", f"{root}/vectors/mu"
    dim, mu = entries.contacts(f"{root}/vectors/w", w.size, *names)
    K = entries.sparse_matrix(f"{root}/M", (f.size, f.size))
    H = entries.sparse_matrix(f"{root}/H", (f.size, w.size))
    name = f"{root}/M"
    if f"{root}/G" in entries:
        name = f"{root}/G"
        b = entries.vector(f"{root}/vectors/b")
        G = entries.sparse_matrix(name, (f.size, b.size))
        K = sp.bmat([[K, G], [G.T, None]])
        H = sp.vstack([H, sp.csr_matrix((b.size, w.size))])
        f = np.concatenate([f, -b])
    solve = entries.inverse(name, sp.csr_matrix(K))
    H = sp.csr_matrix(H)
    return _congruent(sp.csr_matrix(H.T), solve), w + H.T @ solve(f), mu, dim


def _congruent(rows: sp.csr_matrix, solve) -> sp.csr_matrix:
    """B K^-1 B^T for B = `rows`, sparse, given x -> K^-1 x."""
    parts = []
    for first in range(0, rows.shape[0], _COLUMNS):
        block = rows[first : first + _COLUMNS].T.toarray()
        parts.append(sp.csc_matrix(rows @ solve(block)))
    return sp.hstack(parts, format="csr") if parts else sp.csr_matrix((0, 0))
