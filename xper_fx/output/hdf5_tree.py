# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nested dictionaries of arrays in one HDF5 file, which is whole or not there.

The file is written beside its place, flushed to the disk and then put in its place at once: a crash
at any moment leaves the file that was there before. It bears a digest of all it holds.
"""

from __future__ import annotations

import hashlib
import io
import os
from collections.abc import Iterator, Mapping
from pathlib import Path

import h5py
import numpy as np

from xper_fx.support.errors import CheckpointError
from xper_fx.support.files import explained, replacing
from xper_fx.support.hdf5_checks import require_own_content


def write_tree(path: Path, tree: Mapping, **attributes: str | int) -> None:
    """Write a tree in the place of the file that is there, if any.

    Args:
        path: the file.
        tree: by name numbers, strings, arrays and such trees; names have no "/".
        attributes: of the file.

    Raises:
        OSError: the file cannot be written; what was there before stays.
    """
    leaves = dict(_leaves(tree))
    # in memory first: HDF5 does not get over a disk that is full
    content = io.BytesIO()
    with h5py.File(content, "w") as h5:
        for name, leaf in leaves.items():
            h5[name] = leaf
        h5.attrs.update(attributes)
        h5.attrs["digest"] = _digest(leaves)
    with replacing(path) as temporary, open(temporary, "wb") as file:
        file.write(content.getbuffer())
        file.flush()
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


def read_tree(path: Path) -> dict:
    """The tree of a file: floats, integers, strings and arrays.

    Raises:
        CheckpointError: the file is damaged, or takes values from other files.
        FileNotFoundError: it is not there.
    """
    leaves = {}

    def read(name: str, item: h5py.Dataset | h5py.Group) -> None:
        if isinstance(item, h5py.Dataset):
            text = h5py.check_string_dtype(item.dtype) is not None
            leaves[name] = item.asstr()[()] if text else item[()]

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
    if digest != _digest(leaves):
        raise _damaged(path, "its digest is not that of its content")
    tree: dict = {}
    for name, leaf in leaves.items():
        *folders, last = name.split("/")
        inner = tree
        for folder in folders:
            inner = inner.setdefault(folder, {})
        inner[last] = leaf.item() if isinstance(leaf, np.generic) else leaf
    return tree


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


def _leaves(tree: Mapping, before: str = "") -> Iterator[tuple[str, np.ndarray | str]]:
    """Names with the folders that lead to them, and what is there, as it stands in the file."""
    for name, value in tree.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{before}{name}/")
        elif isinstance(value, str):
            yield before + name, value
        else:
            yield before + name, np.asarray(value)


def _digest(leaves: Mapping[str, np.ndarray | str]) -> str:
    """A digest of all names, types, shapes and values."""
    digest = hashlib.blake2b(digest_size=16)
    for name in sorted(leaves):
        leaf = leaves[name]
        digest.update(name.encode() + b"\0")
        if isinstance(leaf, str):
            digest.update(leaf.encode())
        else:
            leaf = np.asarray(leaf)
            digest.update(f"{leaf.dtype.str} {leaf.shape}\0".encode())
            digest.update(np.ascontiguousarray(leaf).tobytes())
    return digest.hexdigest()
