# SPDX-License-Identifier: LGPL-3.0-or-later
"""Work on many independent items, in threads.

What is done to an item depends on no other, so that results do not depend on the number of threads.
The same compiled kernel serves one thread and several; few items are not worth a second one.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache

from numba import get_num_threads

# Items below which starting a thread costs more than it saves.
_MANY = 20_000


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(thread_name_prefix="xper_fx")


os.register_at_fork(after_in_child=_pool.cache_clear)  # threads do not survive a fork


def worth_taking(count: int, least: int, asked: int | None = None) -> int:
    """How many threads to take.

    Args:
        count: of the items of work.
        least: items below which a second thread does not pay.
        asked: threads that a user asked for, None if not.
    """
    if asked is not None:
        if asked > 1:
            get_num_threads()  # starts them: a kept kernel that calls one with threads does not
        return asked
    # numba's function takes a lock that all forked processes share: not for few items
    return get_num_threads() if count >= least else 1


def num_ranges(count: int) -> int:
    """How many ranges `in_ranges` makes of a number of items."""
    return worth_taking(count, _MANY)


def in_ranges(work: Callable, count: int, *arguments, spaces: Sequence | None = None) -> list:
    """Call `work(first, last, *arguments)` on ranges that make up 0 to `count`.

    Args:
        work: releases the interpreter's lock, as kernels compiled with `nogil` and NumPy do.
        count: number of items.
        arguments: of `work`, the same for all ranges.
        spaces: last argument of `work`, one for each range, such as its work space. Without it
            there are as many ranges as `num_ranges` says, and no such argument.

    Returns:
        What `work` returned, range by range.
    """
    ranges = num_ranges(count) if spaces is None else len(spaces)
    last_ones = [()] * ranges if spaces is None else [(space,) for space in spaces]
    if ranges == 1:
        return [work(0, count, *arguments, *last_ones[0])]
    work(0, 0, *arguments, *last_ones[0])  # a kernel is compiled here, not in a thread
    ends = [count * part // ranges for part in range(ranges + 1)]
    here, *others = [
        (first, last, *arguments, *own)
        for first, last, own in zip(ends[:-1], ends[1:], last_ones, strict=True)
    ]
    others = [_pool().submit(work, *given) for given in others]
    return [work(*here), *(other.result() for other in others)]
