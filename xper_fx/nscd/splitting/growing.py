# SPDX-License-Identifier: LGPL-3.0-or-later
"""A group of points that takes in and gives up points as a run goes on."""

from __future__ import annotations

from dataclasses import fields, replace

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
        self._room = {name: array[:0].copy() for name, array in _arrays(like).items()}
        self.group = like
        self._show()

    def take_in(self, more: PointGroup) -> range:
        """Take in points; returns their places in the group."""
        first, self._size = self._size, self._size + len(more)
        for name, array in _arrays(more).items():
            if self._size > len(self._room[name]):
                old = self._room[name]
                self._room[name] = np.empty((2 * self._size, *array.shape[1:]), array.dtype)
                self._room[name][:first] = old[:first]
            self._room[name][first : self._size] = array
        self._show()
        return range(first, self._size)

    def keep(self, places: np.ndarray) -> None:
        """Keep the points at some places, in their order, and no others."""
        self._size = len(places)
        for room in self._room.values():
            room[: self._size] = room[places]
        self._show()

    def move(self, slots: np.ndarray, inverse: BodyInverse) -> None:
        """Put the points on other slots; arguments as of `FusedPoints.move`."""
        nodes = self._room["points.nodes"][: self._size]
        nodes[:] = slots[nodes]
        couplings = couple_nodes(nodes, inverse)
        for name in ("start", "body", "size", "rows"):
            self._room[f"couplings.{name}"][: self._size] = getattr(couplings, name)
        self.group = replace(self.group, couplings=self.group.couplings._replace(w=inverse.data))
        self._show()

    def _show(self) -> None:
        """Let the group's arrays be those of the points that there are."""
        shown = {name: room[: self._size] for name, room in self._room.items()}
        group = self.group
        points, couplings = _named(shown, "points."), _named(shown, "couplings.")
        turning = group.turning
        if turning is not None:
            turning = turning._replace(**_named(shown, "turning."))
            turning = turning._replace(site=np.arange(self._size, dtype=np.int32))
        self.group = replace(
            group, points=replace(group.points, lips=None, **points), turning=turning,
            couplings=group.couplings._replace(**couplings), **_named(shown, "group."),
        )  # fmt: skip


def _named(arrays: dict[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    """Those arrays whose name has a prefix, without it."""
    return {name[len(prefix) :]: a for name, a in arrays.items() if name.startswith(prefix)}


def _arrays(group: PointGroup) -> dict[str, np.ndarray]:
    """All arrays over the points of a group, by the name of what has them and their own."""
    own = {f"group.{f.name}": getattr(group, f.name) for f in fields(group)}
    own |= {f"points.{name}": array for name, array in vars(group.points).items()}
    shared = {
        f"couplings.{name}": array for name, array in group.couplings._asdict().items()
        if name != "w"
    }  # fmt: skip
    turns = {} if group.turning is None else group.turning.each_its_site()._asdict()
    every = own | shared | {f"turning.{name}": array for name, array in turns.items()}
    return {name: array for name, array in every.items() if isinstance(array, np.ndarray)}
