# SPDX-License-Identifier: LGPL-3.0-or-later
"""A line at the terminal while kernels are compiled: nobody wonders what a run waits for."""

from __future__ import annotations

import multiprocessing
from functools import cache

from numba.core import event

from xper_fx.cache.compiling import KIND, CompilationListener


class CompilingNote(CompilationListener):
    """The line, which goes when Numba is done; none where stderr is no terminal."""

    def begin(self) -> None:
        from tqdm.auto import tqdm

        self._line = tqdm(bar_format="{desc}", leave=False, disable=None)

    def next_kernel(self) -> None:
        number = f"{self.kernels} kernel" + "s" * (self.kernels > 1)
        self._line.set_description_str(f"compiling {number}, once")

    def end(self) -> None:
        self._line.close()


@cache
def note_compiling() -> None:
    """Let the line come from now on, in a process that a user started and no other process."""
    if multiprocessing.parent_process() is None:
        event.register(KIND, CompilingNote())
