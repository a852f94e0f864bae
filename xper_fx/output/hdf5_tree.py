# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nested dictionaries of arrays in one HDF5 file, which is whole or not there.

The file is written beside its place, flushed to the disk and then put in its place at once: a crash
at any moment leaves the file that was there before. It bears a digest of all it holds.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from xper_fx.output.row_blocks import StoredRows, in_blocks
from xper_fx.support.errors import CheckpointError
from xper_fx.support.files import explained, replacing, reserve
from xper_fx.support.hdf5_checks import require_own_content
from xper_fx.support.ranks import ALONE, Ranks
from xper_fx.support.saved_rows import Rows

# Attribute of a dataset that holds rows which ranks may share.
_ROWS = "rows"


def write_tree(path: Path, tree: Mapping, ranks: Ranks = ALONE, **attributes: str | int) -> None:
    """Write a tree in the place of the file that is there, if any; all ranks call it together.

    Args:
        path: the file.
        tree: by name numbers, strings, arrays, `Rows` and such trees; names have no "/". Rows are
            those of all ranks, which have them under the same names; all else is the first one's.
        ranks: those that share the rows.
        attributes: of the file.

    Raises:
        OSError: on all ranks, if the file cannot be written; what was there before stays.
    """
    leaves = dict(_leaves(tree))
    rows = {name: leaf for name, leaf in sorted(leaves.items()) if isinstance(leaf, Rows)}
    plain = {name: leaf for name, leaf in leaves.items() if name not in rows}
    size = int(ranks.sum(sum(leaf.values.nbytes for leaf in rows.values())))
    size += sum(np.asarray(leaf).nbytes for leaf in plain.values())
    blocks = ((name, *block) for name, leaf in rows.items() for block in in_blocks(leaf, ranks))

    def write() -> None:
        try:
            if ranks.rank == 0:
                _write(path, plain, blocks, size, len(leaves), attributes)
        finally:
            for _ in blocks:  # which all put together, and also if they cannot be written
                pass

    ranks.together(write)


def _write(
    path: Path,
    plain: Mapping[str, np.ndarray | str],
    blocks: Iterator[tuple[str, int, int, Callable[[], np.ndarray]]],
    size: int,
    datasets: int,
    attributes: Mapping[str, str | int],
) -> None:
    """Write leaves, and rows block by block, in the place of a file: so many bytes and datasets."""
    digests = {name: _digest(leaf) for name, leaf in plain.items()}
    with replacing(path) as temporary:
        h5py.File(temporary, "w").close()
        reserve(temporary, size, datasets)
        with h5py.File(temporary, "r+", locking=False) as h5:
            for name, leaf in plain.items():
                h5[name] = leaf
            for name, first, count, made in blocks:
                block = made()
                if first == 0:
                    h5.create_dataset(name, (count, *block.shape[1:]), block.dtype)
                    h5[name].attrs[_ROWS] = True
                    digests[name] = _started(block.dtype, h5[name].shape)
                h5[name][first : first + len(block)] = block
                digests[name].update(np.ascontiguousarray(block))
            h5.attrs.update(attributes)
            h5.attrs["digest"] = _of_all(digests)
        with open(temporary, "rb") as file:
            os.fsync(file.fileno())
    with explained(path):
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def read_attributes(path: Path) -> dict[str, str | int]:
    """The attributes of a file, its digest among them.

    Raises:
        CheckpointError: it is no HDF5 file, or was cut short.
        FileNotFoundError: it is not there.
    """
    with _opened(path) as h5:
        return {
            name: value.item() if isinstance(value, np.generic) else value
            for name, value in h5.attrs.items()
        }


def read_tree(path: Path, ranks: Ranks = ALONE) -> dict:
    """The tree of a file: floats, integers, strings and arrays; all ranks call it together.

    Args:
        path: the file.
        ranks: of several each gets `StoredRows` in the place of `Rows`, to read its own.

    Raises:
        CheckpointError: the file is damaged, or takes values from other files.
        FileNotFoundError: it is not there.
    """
    tree: dict = {}
    for name, leaf in ranks.together(partial(_read, path, ranks)).items():
        *folders, last = name.split("/")
        inner = tree
        for folder in folders:
            inner = inner.setdefault(folder, {})
        inner[last] = leaf.item() if isinstance(leaf, np.generic) else leaf
    return tree


def _read(path: Path, ranks: Ranks) -> dict[str, Any]:
    """The leaves by name; the first rank sees that they are those that were written."""
    leaves: dict[str, Any] = {}
    digests = {}

    def read(name: str, item: h5py.Dataset | h5py.Group) -> None:
        if not isinstance(item, h5py.Dataset):
            return
        if not ranks.alone and _ROWS in item.attrs:
            leaves[name] = StoredRows(path, name)
            if ranks.rank == 0:
                digests[name] = _started(item.dtype, item.shape)
                for _, block in leaves[name].blocks():
                    digests[name].update(block)
            return
        text = h5py.check_string_dtype(item.dtype) is not None
        leaves[name] = item.asstr()[()] if text else item[()]
        digests[name] = _digest(leaves[name])

    with _opened(path) as h5:
        digest = h5.attrs.get("digest")
        try:
            require_own_content(path, h5)
        except ValueError as error:
            raise CheckpointError(
                f"{error} Put a copy of the checkpoint in its place, or start the run from its "
                "beginning."
            ) from None
        try:
            h5.visititems(read)
        except (OSError, RuntimeError, KeyError) as error:
            raise _damaged(path, str(error)) from error
    if ranks.rank == 0 and digest != _of_all(digests):
        raise _damaged(path, "its digest is not that of its content")
    return leaves


def _opened(path: Path) -> h5py.File:
    if not path.is_file():
        raise FileNotFoundError(f"There is no file {path}.")
    try:
        return h5py.File(path, "r", locking=False)
    except OSError as error:
        raise _damaged(path, str(error)) from error


def _damaged(path: Path, why: str) -> CheckpointError:
    return CheckpointError(
        f"{path} cannot be read: it was cut short, was damaged or is another file ({why}). Put a "
        "copy of the checkpoint in its place, or start the run from its beginning."
    )


def _leaves(tree: Mapping, before: str = "") -> Iterator[tuple[str, Any]]:
    """Names with the folders that lead to them, and what is there, as it stands in the file."""
    for name, value in tree.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{before}{name}/")
        elif isinstance(value, str | Rows):
            yield before + name, value
        else:
            yield before + name, np.asarray(value)


def _digest(leaf: np.ndarray | str) -> hashlib.blake2b:
    """Of a string or an array."""
    if isinstance(leaf, str):
        return hashlib.blake2b(leaf.encode(), digest_size=16)
    leaf = np.asarray(leaf)
    digest = _started(leaf.dtype, leaf.shape)
    digest.update(np.ascontiguousarray(leaf))
    return digest


def _started(dtype: np.dtype, shape: tuple[int, ...]) -> hashlib.blake2b:
    """Of an array whose values are still to come."""
    return hashlib.blake2b(f"{dtype.str} {shape}\0".encode(), digest_size=16)


def _of_all(digests: Mapping[str, hashlib.blake2b]) -> str:
    """A digest of all names, types, shapes and values."""
    told = "".join(f"{name}\0{digests[name].hexdigest()}\0" for name in sorted(digests))
    return hashlib.blake2b(told.encode(), digest_size=16).hexdigest()
