# SPDX-License-Identifier: LGPL-3.0-or-later
"""The folder that a run writes to, tried before any work."""

import os
import tempfile
from pathlib import Path

from xper_fx.output.folder_lock import FolderLock
from xper_fx.support.checks import require_path


def prepare_folder(path: str | os.PathLike[str]) -> Path:
    """Create an output folder if it is missing, write a probe file into it, see that it is free.

    Call it before any work. What access rights say is not asked: root may do everything on a
    read-only or a full disk, until it tries.

    Args:
        path: The folder; its parents are created too.

    Returns:
        The folder's absolute path.

    Raises:
        TypeError: If the path is none.
        OSError: If the folder cannot be created or written; the subclass tells why
            (PermissionError, NotADirectoryError, ...; BlockingIOError if a run writes there).
    """
    folder = require_path("folder", path).resolve()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(bytes(1 << 16))
            probe.flush()
            # A file system may take data that it has no space for until they must be stored.
            os.fsync(probe.fileno())
    except OSError as error:
        raise type(error)(
            error.errno,
            f"The output folder '{folder}' cannot be written ({error.strerror}): expected a "
            "folder, or a place for a new one, with write permission and free space; give "
            "another one or mend this",
        ) from None
    FolderLock(folder).release()
    return folder
