# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files written whole or not at all, and what a failed write tells: file, reason, what to do."""

from __future__ import annotations

import errno
import io
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_GONE = (errno.ENOENT, errno.ENOTDIR, errno.ESTALE)
_FORBIDDEN = (errno.EACCES, errno.EPERM, errno.EROFS)
# What HDF5 may add to a file besides the numbers (bytes): for each dataset, and for all of them.
_DATASET, _GROUPS = 4096, 16384


def _advice(code: int) -> str:
    if code in _NO_ROOM:
        return "make room there, or write into another folder"
    if code in _GONE:
        return "the folder or the file was removed or renamed during the run; leave it in place"
    if code in _FORBIDDEN:
        return "give the folder write permission, or write into another one"
    return "look after the disk, or write into another folder"


def write_all(file: io.FileIO, content: bytes) -> None:
    """Write to an unbuffered file, which takes a part when the disk is about to be full."""
    while content:
        content = content[file.write(content) :]


@contextmanager
def explained(path: str | os.PathLike[str]) -> Iterator[None]:
    """Let what fails when a file is written be one OSError that says what to do.

    HDF5 tells the same failure as OSError or as RuntimeError, with the reason in its text.

    Raises:
        OSError: of the subclass that the reason has (PermissionError, FileNotFoundError, ...).
    """
    try:
        yield
    except (OSError, RuntimeError) as error:
        code, reason = getattr(error, "errno", None), str(error)
        if code is None:
            found = re.search(r"errno = (\d+)", reason)
            code = int(found[1]) if found else errno.EIO
        if found_reason := os.strerror(code):
            reason = found_reason if code != errno.EIO else f"{found_reason}: {reason}"
        raise OSError(
            code,
            f"'{os.fspath(path)}' cannot be written ({reason}). What was written before is still "
            f"there. To go on, {_advice(code)}",
        ) from None


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A file put in place at once: a reader finds the old content or the new, never a part.

    Yields:
        The path to write to, in the same folder; it takes the place of `path` when all went well.

    Raises:
        OSError: the file cannot be written; one that was there before stays as it was.
    """
    temporary = path.with_name(f".{path.name}.tmp")  # the next write takes the place of a stale one
    with explained(path):
        try:
            yield temporary
            os.replace(temporary, path)
        finally:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)


def write_file(path: Path, content: bytes) -> None:
    """Put a file in place at once.

    Raises:
        OSError: the file cannot be written; one that was there before stays as it was.
    """
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def reserve(path: Path, size: int, datasets: int) -> None:
    """See to it that an HDF5 file can grow by `size` bytes in some datasets.

    HDF5 cannot be trusted with a full disk: what it has not stored stays in its cache, and the
    file open and damaged. When it closes a file it gives back what it did not need.
    """
    size += _DATASET * datasets + _GROUPS
    with open(path, "r+b", buffering=0) as file:
        end = file.seek(0, os.SEEK_END)
        try:
            os.posix_fallocate(file.fileno(), end, size)
        except OSError as error:
            # Some file systems have no such call.
            if error.errno not in (errno.EOPNOTSUPP, errno.EINVAL, errno.ENOSYS):
                with suppress(OSError):
                    os.ftruncate(file.fileno(), end)
                raise
