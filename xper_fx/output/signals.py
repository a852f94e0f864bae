# SPDX-License-Identifier: LGPL-3.0-or-later
"""Signals that ask a run to end: noted, so that it ends between two steps."""

from __future__ import annotations

import signal
import threading
from types import FrameType


class Interruption:
    """While it is entered, the first SIGTERM, SIGINT or SIGHUP is noted; the second acts as ever.

    A signal that is ignored stays so: `nohup` ignores SIGHUP. Elsewhere than in the main thread,
    where Python gives no signals, nothing is changed.

    Attributes:
        number: of the signal that came, 0 before.
    """

    def __init__(self) -> None:
        self.number = 0
        self._before = {}

    def __enter__(self) -> Interruption:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
                if signal.getsignal(number) is signal.SIG_IGN:
                    continue
                self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(self, *exception: object) -> None:
        for number, handler in self._before.items():
            # None: a handler that was not installed from Python, and cannot be put back
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        self._before = {}

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.number = number
        self.__exit__()
