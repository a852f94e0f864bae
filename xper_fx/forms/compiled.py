# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forms and expressions, compiled by one process for all.

FFCx lets the process that first asks for a form compile it; the others wait for a file that it
leaves at its end. A process that is killed or interrupted before leaves none, and the others would
wait in vain, those of later runs too. So a process holds a lock while it compiles, which the kernel
takes back whatever ends it: where nobody compiles, what is waited for is begun anew.

FFCx lists the whole folder of its cache for each form that it loads, so forms are spread over
folders by their signature: among 4000 files listing took 4 of the 5 ms of a form.
"""

from __future__ import annotations

import fcntl
import logging
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from dolfinx import fem
from dolfinx.jit import get_options

logger = logging.getLogger(__name__)

# FFCx itself looks for another process's result once a second; it gives up at the first look.
OPTIONS: dict[str, Any] = {"timeout": 1}
# Waiting for another process: at most, between two looks, and before a file of nobody known to
# compile counts as left behind, as programs without this module hold no lock (s).
_PATIENCE, _PAUSE, _STRANGERS = 1800.0, 0.1, 20.0
_LOCK = "xper_fx.lock"


def compiled_form(form: Any) -> fem.Form:
    """Compile a UFL form.

    Raises:
        TimeoutError: another process has been compiling it for half an hour.
    """
    return _built(lambda options: fem.form(form, jit_options=options), form.signature()[:2])


def compiled_expression(expression: Any, points: Any) -> fem.Expression:
    """Compile a UFL expression for points of the reference cell, shape (num_points, tdim).

    Raises:
        TimeoutError: another process has been compiling it for half an hour.
    """
    return _built(
        lambda options: fem.Expression(expression, points, jit_options=options), "expressions"
    )


def _built(build: Callable[[dict[str, Any]], Any], folder_name: str) -> Any:
    folder = Path(get_options(OPTIONS)["cache_dir"]) / folder_name
    options = OPTIONS | {"cache_dir": str(folder)}
    end, seen = time.monotonic() + _PATIENCE, set[Path]()
    while True:
        with _lock(folder, fcntl.LOCK_SH):
            try:
                return build(options)
            except TimeoutError as error:
                named = re.search(r"remove (.+\.c)\)", str(error))
                if named is None or time.monotonic() > end:
                    raise
            except ImportError as error:
                broken = Path(error.path or "")
                if broken.parent != folder or broken in seen:
                    raise
                logger.info("%s cannot be loaded, and is compiled anew: %s", broken, error)
                seen.add(broken)
                for file in folder.glob(f"{broken.name.partition('.')[0]}*"):
                    file.unlink()
                continue
        _wait(Path(named[1]), folder, end)


def _wait(source: Path, folder: Path, end: float) -> None:
    """Until a file is compiled, or has been taken away as left behind."""
    while _is_pending(source) and time.monotonic() < end:
        with _lock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB) as nobody_compiles:
            if nobody_compiles and _is_pending(source):
                with suppress(FileNotFoundError):
                    if time.time() - source.stat().st_mtime > _STRANGERS:
                        source.unlink()
        time.sleep(_PAUSE)


def _is_pending(source: Path) -> bool:
    return source.exists() and not source.with_suffix(".c.cached").exists()


@contextmanager
def _lock(folder: Path, kind: int) -> Iterator[bool]:
    """Hold the lock of a folder if that can be; whether it is held."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = open(folder / _LOCK, "ab")
    except OSError:
        yield False
        return
    with file:
        try:
            fcntl.flock(file, kind)
        except OSError:  # others hold it, or the file system has no locks
            held = False
        else:
            held = True
        yield held
