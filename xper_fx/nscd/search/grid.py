# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pairs of overlapping axis-aligned boxes, in time proportional to boxes and pairs.

Boxes are sorted into levels of cells (Ericson 2005, section 7.2): on level l the cells have the
size s_l = 2^l times that of the largest box among those near the median, and a box lives on the
lowest level whose cells are no smaller than its longest side, in the one cell that holds its low
corner. A box on a level no higher than l then overlaps only boxes of level l whose low corners lie
between its own low corner minus s_l and its high corner: three cells a direction at most. Each box
asks its own level and those above that hold anything: the work is that of the boxes times the
levels in use, at any ratio of sizes. Boxes of nearly one size, as most are, have one level.

Cells are kept in a table with two places a box, by a number that runs on along x, so that the cells
of a row are neighbours in memory; empty space costs nothing. Of few boxes all pairs are compared.
"""

from __future__ import annotations

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY, MERGED

# Boxes of which all pairs are compared.
_FEW = 32
# Boxes up to this many times the median share a level.
_ALIKE = 1.5
# Cells are not made smaller than this share of the whole extent: their numbers stay exact.
_SMALLEST_CELL = 2.0**-30
# Share of a cell by which the range that is asked exceeds the exact one, against rounding.
_MARGIN = 2.0**-18


def box_pairs(
    low_a: np.ndarray,
    high_a: np.ndarray,
    low_b: np.ndarray | None = None,
    high_b: np.ndarray | None = None,
) -> np.ndarray:
    """Pairs of boxes that overlap or touch, within one set or between two.

    Args:
        low_a, high_a: shape (n, dim), corners (m) of the boxes, finite.
        low_b, high_b: shape (m, dim), of a second set; if not given, pairs are within the first.

    Returns:
        Shape (num_pairs, 2), int32: numbers in the first and in the second set (within one set the
        smaller first), each pair once, sorted lexicographically.

    Raises:
        ValueError: corners that are not finite, a low one above the high one, or shapes that do
            not match.
    """
    if low_b is None:
        return labelled_box_pairs(low_a, high_a, np.zeros(len(low_a), np.int64), np.ones((1, 1)))
    count_a = len(low_a)
    low, high = np.concatenate([low_a, low_b]), np.concatenate([high_a, high_b])
    label = (np.arange(len(low)) >= count_a).astype(np.int64)
    pairs = labelled_box_pairs(low, high, label, 1 - np.eye(2))
    pairs[:, 1] -= count_a
    return pairs


def labelled_box_pairs(
    low: np.ndarray, high: np.ndarray, label: np.ndarray, allowed: np.ndarray
) -> np.ndarray:
    """Pairs of boxes that overlap or touch and whose labels may meet.

    Args:
        low, high: shape (n, dim), dim 2 or 3, corners (m), finite.
        label: shape (n,), from 0.
        allowed: shape (num_labels, num_labels), symmetric, true where two labels may meet.

    Returns:
        Shape (num_pairs, 2), int32, the smaller number first, each pair once, sorted
        lexicographically.

    Raises:
        ValueError: as `box_pairs`.
    """
    low = np.ascontiguousarray(low, dtype=float)
    high = np.ascontiguousarray(high, dtype=float)
    if low.ndim != 2 or low.shape != high.shape or low.shape[1] not in (2, 3):
        raise ValueError(
            "The corners of boxes should have the shape (number of boxes, 2 or 3), "
            f"got {low.shape} and {high.shape}."
        )
    bad = ~(np.isfinite(low) & np.isfinite(high) & (low <= high)).all(axis=1)
    if bad.any():
        first = int(bad.argmax())
        raise ValueError(
            "Boxes should be finite, and their low corners not above their high ones: box "
            f"{first} goes from {low[first]} to {high[first]}."
        )
    if len(low) < 2:
        return np.empty((0, 2), np.int32)
    label = np.ascontiguousarray(label, dtype=np.int64)
    allowed = np.ascontiguousarray(allowed, dtype=np.bool_)
    if len(low) <= _FEW:
        meet = np.all(low[:, None] <= high, axis=2)
        meet &= meet.T & allowed[label[:, None], label]
        return np.argwhere(np.triu(meet, 1)).astype(np.int32)
    rows, tops = low.T.copy(), high.T.copy()  # quicker to go through
    extent, origin = (tops - rows).max(axis=0), rows.min(axis=1)
    span = float((tops.max(axis=1) - origin).max())
    alike = extent[extent <= _ALIKE * np.median(extent)]
    unit = max(float(alike.max()), span * _SMALLEST_CELL) or 1.0
    fraction, level = np.frexp(np.maximum(extent, span * _SMALLEST_CELL) / unit)
    level = level.astype(np.int64) - (fraction <= 0.5)
    lowest = int(level.min())
    used = np.unique(level) - lowest
    size = unit * 2.0**lowest
    return _found_pairs(low, high, label, allowed, level - lowest, used, origin, size)


def _row(y, z, level):
    """Place of a row of cells in the table, before it is wrapped around."""
    return y * 73856093 + z * 19349663 + level * 83492791


_row_in_kernel = njit(**MERGED)(_row)


def _found_pairs(
    low: np.ndarray, high: np.ndarray, label: np.ndarray, allowed: np.ndarray, level: np.ndarray,
    used: np.ndarray, origin: np.ndarray, size: float,
) -> np.ndarray:  # fmt: skip
    """Sorted pairs; `level` counts from 0, where cells have `size`; `used` levels hold boxes."""
    n, dim = low.shape
    places = 4
    while places < 2 * n:
        places *= 2
    address = np.zeros((n, 4), np.int64)  # cell and level
    address[:, :dim] = np.floor((low - origin) / (size * 2.0**level)[:, None])
    address[:, 3] = level
    place = (_row(address[:, 1], address[:, 2], level) + address[:, 0]) & (places - 1)
    start, number = _by_bucket(place, places)  # what the cells hold, in their order
    address, low, high, label = (a.take(number, axis=0) for a in (address, low, high, label))
    room = 4 * n
    while True:
        pairs = np.empty((room, 2), np.int32)
        count = _find(
            low - origin, high - origin, low, high, label, allowed, number, address, start, used,
            size, pairs,
        )  # fmt: skip
        if count <= room:
            break
        room = count
    pairs = pairs[:count]
    _, by_second = _by_bucket(pairs[:, 1], n)
    _, by_first = _by_bucket(pairs[by_second, 0], n)
    return pairs.take(by_second[by_first], axis=0)


def _by_bucket(bucket: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """First place of each bucket, shape (count + 1,), and the items, in order, by bucket."""
    start = np.zeros(count + 1, np.int64)
    np.cumsum(np.bincount(bucket, minlength=count), out=start[1:])
    item = np.empty(len(bucket), np.int64)
    _fill(bucket, start[:-1].copy(), item)
    return start, item


@njit(**LEAN_ENTRY)
def _fill(bucket, place, item):
    for k in range(len(bucket)):
        item[place[bucket[k]]] = k
        place[bucket[k]] += 1


@njit(**LEAN_ENTRY)
def _find(
    from_low, from_high, low, high, label, allowed, number, address, start, used, size, pairs
):
    """Write the pairs for which there is room, and return how many there are.

    Boxes come in the order of their cells, with their corners also measured from the origin. On
    its own level a box asks the cells from its own on, in the order z, y, x: the others ask it.
    """
    n, dim = low.shape
    mask = len(start) - 2
    count = 0
    for k in range(n):
        i = number[k]
        for asked in used:
            if asked < address[k, 3]:
                continue
            own = asked == address[k, 3]
            cell = size * 2.0**asked
            x0 = int(np.floor(from_low[k, 0] / cell - 1.0 - _MARGIN))
            x1 = int(np.floor(from_high[k, 0] / cell + _MARGIN))
            y0 = int(np.floor(from_low[k, 1] / cell - 1.0 - _MARGIN))
            y1 = int(np.floor(from_high[k, 1] / cell + _MARGIN))
            z0 = z1 = 0
            if dim == 3:
                z0 = int(np.floor(from_low[k, 2] / cell - 1.0 - _MARGIN))
                z1 = int(np.floor(from_high[k, 2] / cell + _MARGIN))
            for z in range(address[k, 2] if own else z0, z1 + 1):
                own_layer = own and z == address[k, 2]
                for y in range(address[k, 1] if own_layer else y0, y1 + 1):
                    own_row = own_layer and y == address[k, 1]
                    row = _row_in_kernel(y, z, asked)
                    x = address[k, 0] if own_row else x0
                    while x <= x1:
                        b = (row + x) & mask
                        last = min(x1, x + mask - b)  # as far as the table goes
                        for m in range(start[b], start[b + last - x + 1]):
                            if (
                                address[m, 0] < x
                                or address[m, 0] > last
                                or address[m, 1] != y
                                or address[m, 2] != z
                                or address[m, 3] != asked
                                or (m <= k and own_row and address[m, 0] == address[k, 0])
                                or not allowed[label[k], label[m]]
                            ):
                                continue
                            apart = False
                            for d in range(dim):
                                if low[k, d] > high[m, d] or low[m, d] > high[k, d]:
                                    apart = True
                            if apart:
                                continue
                            if count < len(pairs):
                                j = number[m]
                                pairs[count, 0] = min(i, j)
                                pairs[count, 1] = max(i, j)
                            count += 1
                        x = last + 1
    return count
