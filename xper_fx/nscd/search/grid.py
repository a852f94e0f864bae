# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pairs of overlapping axis-aligned boxes, in time proportional to boxes and pairs.

Boxes are sorted into levels of cells (Ericson 2005, section 7.2): on level l the cells have the
size s_l = 2^l times the median box, and a box lives on the lowest level whose cells are no smaller
than its longest side, in the one cell that holds its low corner. A box on a level no higher than l
then overlaps only boxes of level l whose low corners lie between its own low corner minus s_l and
its high corner: three cells a direction at most. Each box asks its own level and those above that
hold anything: the work is that of the boxes times the levels in use, at any ratio of sizes.

Cells are kept in a table with two places a box, by a number that runs on along x, so that the cells
of a row are neighbours in memory; empty space costs nothing.
"""

from __future__ import annotations

import numpy as np

from xper_fx.cache import njit

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
    extent = (high - low).max(axis=1)
    origin = low.min(axis=0)
    span = float((high.max(axis=0) - origin).max())
    unit = max(float(np.median(extent)), span * _SMALLEST_CELL) or 1.0
    ratio = np.maximum(extent, span * _SMALLEST_CELL) / unit
    level = np.zeros(len(low), np.int64)
    np.ceil(np.log2(ratio, where=ratio > 0, out=np.zeros(len(low))), out=level, casting="unsafe")
    level[ratio > 2.0**level] += 1  # log2 may round down
    label = np.ascontiguousarray(label, dtype=np.int64)
    allowed = np.ascontiguousarray(allowed, dtype=np.bool_)
    lowest = int(level.min())
    used = np.unique(level) - lowest
    pairs = _find(low, high, label, allowed, level - lowest, used, origin, unit * 2.0**lowest)
    return _sorted_pairs(pairs, len(low))


@njit(inline="always")
def _row(y, z, level):
    """Place of a row of cells in the table, before it is wrapped around."""
    return y * 73856093 + z * 19349663 + level * 83492791


@njit(error_model="numpy")
def _find(low, high, label, allowed, level, used, origin, size):
    """Pairs in the order in which they are found, smaller number first.

    `level` counts from 0, where cells have `size`; `used` are the levels that hold boxes, rising.
    """
    n, dim = low.shape
    places = 4
    while places < 2 * n:
        places *= 2
    mask = places - 1

    cells = np.zeros((n, 3), np.int64)
    place = np.empty(n, np.int64)
    start = np.zeros(places + 1, np.int64)
    for i in range(n):
        cell = size * 2.0 ** level[i]
        for d in range(dim):
            cells[i, d] = int(np.floor((low[i, d] - origin[d]) / cell))
        place[i] = (_row(cells[i, 1], cells[i, 2], level[i]) + cells[i, 0]) & mask
        start[place[i] + 1] += 1
    for b in range(places):
        start[b + 1] += start[b]
    # What the cells hold, in their order: number, cell and level, box.
    number = np.empty(n, np.int64)
    address = np.empty((n, 4), np.int64)
    box = np.empty((n, 2, dim))
    fill = start[:-1].copy()
    for i in range(n):
        k = fill[place[i]]
        fill[place[i]] += 1
        number[k] = i
        address[k, :3] = cells[i]
        address[k, 3] = level[i]
        box[k, 0] = low[i]
        box[k, 1] = high[i]

    pairs = np.empty((4 * n, 2), np.int32)
    count = 0
    first = np.zeros(3, np.int64)
    last = np.zeros(3, np.int64)
    for k in range(n):
        i = number[k]
        for asked in used:
            if asked < level[i]:
                continue
            cell = size * 2.0**asked
            for d in range(dim):
                shifted = box[k, 0, d] - origin[d]
                first[d] = int(np.floor(shifted / cell - 1.0 - _MARGIN))
                last[d] = int(np.floor((box[k, 1, d] - origin[d]) / cell + _MARGIN))
            for z in range(first[2], last[2] + 1):
                for y in range(first[1], last[1] + 1):
                    row = _row(y, z, asked)
                    for x in range(first[0], last[0] + 1):
                        b = (row + x) & mask
                        for m in range(start[b], start[b + 1]):
                            if (
                                address[m, 0] != x
                                or address[m, 1] != y
                                or address[m, 2] != z
                                or address[m, 3] != asked
                            ):
                                continue
                            j = number[m]
                            if asked == level[i] and j <= i:
                                continue
                            if not allowed[label[i], label[j]]:
                                continue
                            apart = False
                            for d in range(dim):
                                if box[k, 0, d] > box[m, 1, d] or box[m, 0, d] > box[k, 1, d]:
                                    apart = True
                            if apart:
                                continue
                            if count == len(pairs):
                                longer = np.empty((2 * count, 2), np.int32)
                                longer[:count] = pairs
                                pairs = longer
                            pairs[count, 0] = min(i, j)
                            pairs[count, 1] = max(i, j)
                            count += 1
    return pairs[:count]


@njit
def _sorted_pairs(pairs, n):
    """The pairs in lexicographic order: by counting along the first, then row by row."""
    start = np.zeros(n + 1, np.int64)
    for p in range(len(pairs)):
        start[pairs[p, 0] + 1] += 1
    for i in range(n):
        start[i + 1] += start[i]
    second = np.empty(len(pairs), np.int32)
    fill = start[:-1].copy()
    for p in range(len(pairs)):
        i = pairs[p, 0]
        second[fill[i]] = pairs[p, 1]
        fill[i] += 1
    result = np.empty((len(pairs), 2), np.int32)
    for i in range(n):
        row = np.sort(second[start[i] : start[i + 1]])
        for k in range(len(row)):
            result[start[i] + k, 0] = i
            result[start[i] + k, 1] = row[k]
    return result
