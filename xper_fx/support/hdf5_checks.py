# SPDX-License-Identifier: LGPL-3.0-or-later
"""Whether an HDF5 file holds what it declares, and holds it itself.

A file from elsewhere may declare an array of a terabyte in some bytes, or take its values from
another file of this machine. Both are refused by name, before anything is read.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import h5py

# What a filter (gzip at its best) makes of a byte, and bytes that may be declared without any.
_LARGEST_RATIO, _FREE = 1100, 1 << 20


def require_own_content(path: Path, file: h5py.File) -> None:
    """See that all is in the file, and takes the room there that it may.

    Args:
        file: the file, open.

    Raises:
        ValueError: a link to another file, external storage, an array larger than the file, or
            entries that cannot be read.
    """
    import h5py

    size = path.stat().st_size

    def links(group: h5py.Group) -> str | None:
        for name in group:
            if isinstance(group.get(name, getlink=True), h5py.ExternalLink):
                entry = f"{group.name.rstrip('/')}/{name}"
                return f"entry '{entry}' is a link into another file, which is not followed"
        return None

    def look(name: str, item: h5py.Group | h5py.Dataset) -> str | None:
        """What is wrong with an entry, None if nothing is."""
        if isinstance(item, h5py.Group):
            return links(item)
        if item.external or item.is_virtual:
            return f"entry '{name}' has its values in external files, which are not read"
        declared = item.size * item.dtype.itemsize if item.size else 0
        filtered = item.id.get_create_plist().get_nfilters() > 0
        stored = min(item.id.get_storage_size(), size)
        if declared > _FREE + stored * (_LARGEST_RATIO if filtered else 1):
            return (
                f"entry '{name}' declares {declared} bytes, more than its {stored} bytes in the "
                "file can hold: the file is damaged"
            )
        return None

    try:
        wrong = links(file) or file.visititems(look)
    except Exception as error:  # of any kind: bytes may be anything
        wrong = f"the file is damaged ({error})"
    if wrong:
        raise ValueError(f"{path}: {wrong}.")
