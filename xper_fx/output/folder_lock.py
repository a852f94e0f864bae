# SPDX-License-Identifier: LGPL-3.0-or-later
"""One run at a time writes into a folder.

The lock is the kernel's (`flock`), on a file in the folder that says who holds it. It ends with
its process, however that ends: a file that a killed run leaves behind locks nothing. On NFS the
server keeps it, for all hosts.
"""

from __future__ import annotations

import errno
import fcntl
import gc
import logging
import os
import socket
import sys
from pathlib import Path

from xper_fx.support.files import explained

logger = logging.getLogger(__name__)

_NAME = ".xper_fx-lock"
# A file system that has no locks, or whose server keeps none.
_NO_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL)


class FolderLock:
    """Keeps other runs out of a folder until it is released.

    Args:
        folder: where results are written.

    Raises:
        BlockingIOError: another run writes there; the message says which.
        OSError: the file of the lock cannot be written.
    """

    def __init__(self, folder: str | os.PathLike[str]):
        self._path = Path(folder).resolve() / _NAME
        self._descriptor: int | None = None
        owner = f"process {os.getpid()} on {socket.gethostname()}"
        if not self._take():
            # A run of this process that nothing refers to any more has not yet let go.
            gc.collect()
            if not self._take():
                raise BlockingIOError(
                    errno.EWOULDBLOCK,
                    f"The folder '{self._path.parent}' is being written by {self._holder(owner)}. "
                    "Wait for that run, stop it, or give another folder",
                )
        with explained(self._path):
            os.write(self._descriptor, f"{owner}: {' '.join(sys.argv)}\n".encode())

    def _take(self) -> bool:
        """Lock the file that has the name now, not one that its last holder has removed."""
        while True:
            with explained(self._path):
                descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o666)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                os.close(descriptor)
                return False
            except OSError as error:
                if error.errno not in _NO_LOCKS:
                    os.close(descriptor)
                    raise
                logger.warning(
                    "%s: this file system has no locks (%s); a second run into the folder would "
                    "not be noticed",
                    self._path.parent,
                    error.strerror,
                )
            held = os.fstat(descriptor)
            try:
                same = os.path.samestat(held, os.stat(self._path))
            except FileNotFoundError:
                same = False
            if same:
                os.ftruncate(descriptor, 0)
                self._descriptor = descriptor
                return True
            os.close(descriptor)

    def _holder(self, owner: str) -> str:
        try:
            said = self._path.read_text(errors="replace").strip()
        except OSError:
            said = ""
        if said.startswith(f"{owner}:"):
            return "another recorder of this very process, which was not closed"
        return said or "another run"

    def release(self) -> None:
        """Let others in; the file is removed."""
        if self._descriptor is None:
            return
        try:
            if os.path.samestat(os.fstat(self._descriptor), os.stat(self._path)):
                self._path.unlink()
        except OSError:
            pass  # a folder that is gone or read-only keeps nobody out
        os.close(self._descriptor)
        self._descriptor = None

    def __del__(self) -> None:
        if getattr(self, "_descriptor", None) is not None:
            os.close(self._descriptor)
