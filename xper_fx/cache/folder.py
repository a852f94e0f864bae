# SPDX-License-Identifier: LGPL-3.0-or-later
"""The folder of kept kernels: one file each, written whole, read only if it is whole.

`~/.cache/xper_fx/kernels` (under `XDG_CACHE_HOME` if that is set), or the folder that
`XPER_FX_CACHE` names; `XPER_FX_CACHE=off` keeps nothing. A file holds machine code: the folder must
belong to the user, and nobody else may write to it. Beyond a total size the files that were not
used for longest go.
"""

from __future__ import annotations

import fcntl
import logging
import os
import stat
import struct
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

logger = logging.getLogger("xper_fx.cache")

# Bytes of all files together; a run of all tests and demos keeps a third of it.
MAX_BYTES = 1 << 30
# Written between two looks at the total.
_LOOK_EVERY = MAX_BYTES // 32
_SUFFIX = ".kernel"
_MAGIC = b"xper_fx kernel 1\n"
_HEAD = struct.Struct("<32sI")  # digest of what follows the head, length of the title
# Seconds between two uses of a file that are told apart, and after which what a process that was
# killed has left is removed.
_HOUR = 3600.0
# What MPI's launchers tell a process of its rank.
_RANK_OF_PROCESS = ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK")
# Waiting for a kernel that another process compiles: at most, and between two looks (s).
_PATIENCE, _PAUSE = 120.0, 0.02


class KeptFile(NamedTuple):
    """A file of the folder."""

    title: str  #: of the kernel
    size: int  #: bytes
    used: float  #: when it was last used, to an hour (s since the epoch)
    path: Path  #: of the file


class CacheFolder:
    """Kernels by key. A failure to read or write is told once at level INFO, and never raised.

    Args:
        path: of the folder, which is made if need be.

    Raises:
        OSError: the folder cannot be made, or there is a file in its place.
        PermissionError: others than this user may write to it.
    """

    def __init__(self, path: Path):
        self.path = path
        try:
            path.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as error:
            raise OSError(f"the folder {path} cannot be made ({error.strerror})") from None
        status = path.stat()
        if status.st_uid != os.geteuid() or status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            raise PermissionError(
                f"others may write to {path}: it should belong to you, with mode 0700"
            )
        self._unseen = MAX_BYTES  # written since the total was looked at; at first it is unknown
        self._told: set[str] = set()
        self._locks: int | None = None

    def read(self, key: str) -> bytes | None:
        """What was written under a key; None if nothing was, or if it is damaged."""
        path = self._file(key)
        try:
            with open(path, "rb") as file:
                if time.time() - os.fstat(file.fileno()).st_mtime > _HOUR:
                    os.utime(file.fileno())
                content = file.read()
        except FileNotFoundError:
            return None
        except OSError as error:
            self._tell("reads", f"{path} cannot be read: {error.strerror}")
            return None
        parts = _parts(content)
        if parts is None:
            self._tell("damage", f"{path} is damaged")
            return None
        return parts[1]

    def write(self, key: str, title: str, payload: bytes) -> None:
        """Keep bytes under a key; a reader finds all of them or none.

        Args:
            key: hexadecimal digits.
            title: what it is, for people.
        """
        name = title.encode()
        body = name + payload
        content = _MAGIC + _HEAD.pack(sha256(body).digest(), len(name)) + body
        temporary = None
        try:
            with tempfile.NamedTemporaryFile(dir=self.path, prefix=".", delete=False) as file:
                temporary = Path(file.name)
                file.write(content)
            os.replace(temporary, self._file(key))
        except OSError as error:
            self._tell("writes", f"{self.path} cannot be written: {error.strerror}")
            if temporary is not None:
                with suppress(OSError):
                    temporary.unlink(missing_ok=True)
            return
        self._unseen += len(content)
        if self._unseen >= _LOOK_EVERY:
            self._unseen = 0
            self.trim(MAX_BYTES)

    def lock(self, key: str) -> bool:
        """Keep other processes from compiling the kernel of a key; `unlock` lets them again.

        Returns:
            Whether another process held it meanwhile, and may have written the kernel.
        """
        try:
            if self._locks is None:
                self._locks = os.open(
                    self.path / ".locks", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600
                )
            end = time.monotonic() + _PATIENCE
            waited = False
            while time.monotonic() < end:
                try:
                    fcntl.lockf(self._locks, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, _place(key))
                    return waited
                except (BlockingIOError, PermissionError):  # held by another process
                    waited = True
                    time.sleep(_PAUSE)
        except OSError as error:
            self._tell("locks", f"{self.path} cannot be locked: {error.strerror}")
        return False

    def unlock(self, key: str) -> None:
        """Let other processes compile the kernel of a key."""
        if self._locks is not None:
            with suppress(OSError):
                fcntl.lockf(self._locks, fcntl.LOCK_UN, 1, _place(key))

    def files(self) -> Iterator[KeptFile]:
        """The kernels that are kept, whole files only."""
        for path in self.path.glob("*" + _SUFFIX):
            with suppress(OSError):
                status = path.stat()
                parts = _parts(path.read_bytes())
                if parts is not None:
                    yield KeptFile(parts[0], status.st_size, status.st_mtime, path)

    def trim(self, most: int) -> int:
        """Remove the files that were used longest ago until the rest takes at most `most` bytes.

        Returns:
            Bytes that remain.
        """
        found = []
        for entry in os.scandir(self.path):
            with suppress(OSError):
                status = entry.stat()
                if entry.name.endswith(_SUFFIX):
                    found.append((status.st_mtime, status.st_size, entry.path))
                elif entry.name != ".locks" and time.time() - status.st_mtime > _HOUR:
                    os.unlink(entry.path)  # of a process that was killed while it wrote
        total = sum(size for _, size, _ in found)
        for _, size, path in sorted(found):
            if total <= most:
                break
            with suppress(OSError):
                os.unlink(path)
                total -= size
        return total

    def _file(self, key: str) -> Path:
        return self.path / (key + _SUFFIX)

    def _tell(self, kind: str, message: str) -> None:
        """Say something once."""
        if kind not in self._told:
            self._told.add(kind)
            logger.info("Kernels are compiled anew: %s.", message)


def _place(key: str) -> int:
    """Byte of the file of locks that stands for a key."""
    return int(key[:12], 16)


def _parts(content: bytes) -> tuple[str, bytes] | None:
    """Title and payload of a file's content; None if it is not as it was written."""
    start = len(_MAGIC) + _HEAD.size
    if len(content) < start or not content.startswith(_MAGIC):
        return None
    check, length = _HEAD.unpack(content[len(_MAGIC) : start])
    body = content[start:]
    if sha256(body).digest() != check:
        return None
    return body[:length].decode(errors="replace"), body[length:]


def folder_path() -> Path | None:
    """Where kernels are kept by what the environment says; None if they are not."""
    named = os.environ.get("XPER_FX_CACHE", "")
    if named == "off":
        return None
    if named:
        return Path(named).expanduser().absolute()
    home = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(home).expanduser().absolute() / "xper_fx" / "kernels"


@cache
def kernel_folder() -> CacheFolder | None:
    """The folder of this process; None, after one line that says why, if there cannot be one."""
    try:
        path = folder_path()
        return None if path is None else CacheFolder(path)
    except (OSError, RuntimeError) as error:  # RuntimeError: no home
        level = logging.WARNING if "XPER_FX_CACHE" in os.environ else logging.INFO
        if any(os.environ.get(name, "0") != "0" for name in _RANK_OF_PROCESS):
            level = logging.DEBUG  # the first rank says it
        logger.log(
            level,
            "No compiled kernel is kept, each process compiles its own: %s. Set "
            "XPER_FX_CACHE to a folder of yours, or to off.",
            error,
        )
        return None
