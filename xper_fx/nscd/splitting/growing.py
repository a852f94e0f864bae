# SPDX-License-Identifier: LGPL-3.0-or-later
"""A group of points that takes in and gives up points as a run goes on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from xper_fx.nscd.couplings import couple_nodes
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.point_group import PointGroup


class GrowingGroup:
    """Points of one law's kernels, in the order in which they came.

    Arrays have room for more points than there are, so that one more costs what it holds.

    Args:
        like: a group without an order of visit, of which the kinds of arrays count.

    Attributes:
        group: the points so far.
    """

    def __init__(self, like: PointGroup):
        self._size = 0
        self._room = {
            part: {name: array[:0].copy() for name, array in arrays.items()}
            for part, arrays in _arrays(like).items()
        }
        self.group = like
        self._show()

    def take_in(self, more: PointGroup) -> range:
        """Take in points; returns their places in the group."""
        first, self._size = self._size, self._size + len(more)
        for part, arrays in _arrays(more).items():
            rooms = self._room[part]
            for name, array in arrays.items():
                if self._size > len(rooms[name]):
                    old = rooms[name]
                    rooms[name] = np.empty((2 * self._size, *array.shape[1:]), array.dtype)
                    rooms[name][:first] = old[:first]
                rooms[name][first : self._size] = array
        self._show()
        return range(first, self._size)

    def keep(self, places: np.ndarray) -> None:
        """Keep the points at some places, in their order, and no others."""
        self._size = len(places)
        for rooms in self._room.values():
            for room in rooms.values():
                room[: self._size] = room[places]
        self._show()

    def move(self, slots: np.ndarray, inverse: BodyInverse) -> None:
        """Put the points on other slots; arguments as of `FusedPoints.move`."""
        for part in ("points", "turning"):
            if "nodes" in self._room[part]:
                moved = self._room[part]["nodes"][: self._size]
                moved[:] = slots[moved]
        nodes = self._room["points"]["nodes"][: self._size]
        couplings = couple_nodes(nodes, inverse)
        for name in ("start", "body", "size", "rows"):
            self._room["couplings"][name][: self._size] = getattr(couplings, name)
        self.group = replace(self.group, couplings=self.group.couplings._replace(w=inverse.data))
        self._show()

    def _show(self) -> None:
        """Let the group's arrays be those of the points that there are."""
        own, points, couplings, turning = (
            {name: room[: self._size] for name, room in rooms.items()}
            for rooms in self._room.values()
        )
        group, turns = self.group, self.group.turning
        if turns is not None:
            turns = turns._replace(**turning)
            turns = turns._replace(site=np.arange(self._size, dtype=np.int32))
        self.group = replace(
            group, points=replace(group.points, lips=None, **points), turning=turns,
            couplings=group.couplings._replace(**couplings), **own,
        )  # fmt: skip


def _arrays(group: PointGroup) -> dict[str, dict[str, np.ndarray]]:
    """All arrays over the points of a group, by what has them and by name; not those of w."""
    turning = {} if group.turning is None else group.turning.each_its_site()._asdict()
    parts = {
        "group": vars(group), "points": vars(group.points),
        "couplings": group.couplings._replace(w=None)._asdict(), "turning": turning,
    }  # fmt: skip
    return {
        part: {name: array for name, array in arrays.items() if isinstance(array, np.ndarray)}
        for part, arrays in parts.items()
    }
