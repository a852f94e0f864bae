# SPDX-License-Identifier: LGPL-3.0-or-later
"""When Numba compiles: for a stopwatch, a progress bar, somebody who waits."""

from __future__ import annotations

from numba.core import event

KIND = "numba:compile"


class CompilationListener(event.Listener):
    """Told when Numba begins and ends to compile; kernels that a kernel calls are part of it.

    Listens while `numba.core.event.install_listener(KIND, listener)` is entered.

    Attributes:
        kernels: compiled so far, those within others included.
    """

    def __init__(self):
        self.kernels = self._depth = 0

    def begin(self) -> None:
        """Numba begins to compile."""

    def end(self) -> None:
        """Numba has compiled a kernel and all that it calls."""

    def next_kernel(self) -> None:
        """One more kernel is being compiled."""

    def on_start(self, event: event.Event) -> None:
        """Called by Numba."""
        if self._depth == 0:
            self.begin()
        self._depth += 1
        self.kernels += 1
        self.next_kernel()

    def on_end(self, event: event.Event) -> None:
        """Called by Numba."""
        self._depth -= 1
        if self._depth == 0:
            self.end()
