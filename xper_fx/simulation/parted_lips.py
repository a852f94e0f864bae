# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lips of broken bonds that the search of contacts takes over.

Facing facets have permanent points, made for lips that stay near each other. Once nothing bonds
them and they are `_FAR` of their size apart, these points retire and the search takes over, where
a contact between the two groups is named: broken pieces meet again wherever they go.

Where ranks divide the bodies each looks at the points that it has, of whichever lips, and all are
told which are loose and which lips have parted: these are few.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from xper_fx.bodies.explode import FacingFacets
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.search.surface_search import SurfaceSearch
from xper_fx.simulation.turned_bonds import lip_normals
from xper_fx.support.ranks import Ranks
from xper_fx.support.saved_rows import Rows

# Distance of two lips, relative to their size, at which their own points retire.
_FAR = 0.25
# Cosine of the angle between broken lips and the frames of their own points at which they retire:
# along other normals than theirs pieces that tumble would interpenetrate.
_TURNED = np.cos(0.2)


class PartedLips:
    """The lips of facing facets that have points.

    Args:
        search: of contacts of the surfaces, whose bonds are the facing facets.
        x: shape (num_nodes, dim), nodes of the surfaces at the start (m).
        with_points: numbers of those that have points.
        numbers: shape (len(with_points),), ascending: what these are among those of all ranks.
        taken: shape (len(with_points),), bool: those of them that the search may take over.
        ranks: those that divide the points.
        here: shape (len(with_points),), bool: of which of them this rank looks at the normals; it
            has one of the two bodies, and where all points of a facet are on one rank, has them.

    Attributes:
        search: as given.
        retired: shape (len(with_points),), bool: which of them the search has taken over.
    """

    def __init__(
        self,
        search: SurfaceSearch,
        x: np.ndarray,
        facets: FacingFacets,
        with_points: np.ndarray,
        numbers: np.ndarray,
        taken: np.ndarray,
        ranks: Ranks,
        here: np.ndarray,
    ):
        self.search, self._lips, self._ranks, self._here = search, with_points, ranks, here
        self._numbers, self._exist = numbers, ranks.max(float(taken.any())) > 0.0
        self._loose = np.zeros((len(taken), 0), bool)  # by point, once there are any
        self._waiting = taken.copy()
        self._broken, self._ajar, self.retired = np.zeros((3, len(taken)), bool)
        dim = x.shape[1]
        self._far = _FAR * facets.measure[with_points] ** (1.0 / (dim - 1))
        self._nodes = search.surface.bond_nodes[with_points]
        self._normals = lip_normals(x[self._nodes])
        own = facets.normal[with_points]
        self._side = np.sign(np.einsum("ld,ld->l", own, self._normals[:, 0]))

    def release(
        self, interactions: Interactions, each: int, moved: Callable[[], np.ndarray]
    ) -> None:
        """After a step, let the search take over the broken lips that have parted or turned.

        Lips that are broken at one of their points may touch rigid bodies at once. All ranks call
        it together.

        Args:
            interactions: the layer, whose permanent points come facet after facet.
            each: points on a facet.
            moved: gives where the nodes of the surfaces are at the end of the step, shape
                (num_nodes, dim), m; all ranks call it together.
        """
        if not self._exist:
            return
        if not self._loose.size:
            self._loose = np.zeros((len(self._lips), each), bool)
        loose, own = self._loose.reshape(-1), interactions.numbers
        points, lips = self._known(own // each)  # those of ties and walls come behind
        own = own[points]
        waiting = np.flatnonzero(self._waiting[lips] & ~loose[lips * each + own % each])
        unbonded = interactions.local_unbonded()[points[waiting]]
        new = self._ranks.union(own[waiting[unbonded]])
        known, opened = self._known(new // each)
        loose[opened * each + new[known] % each] = True
        opened = np.unique(opened)
        broken = opened[self._loose[opened].all(axis=1)]
        self._open(opened[~self._ajar[opened]], broken[~self._broken[broken]])
        gone = self._broken & self._waiting
        if not self._ranks.max(float(gone.any())):
            return
        at = moved()
        points, lips = points[gone[lips]], lips[gone[lips]]
        jump = np.linalg.norm(interactions.local("jump")[points], axis=1)
        apart = lips[jump > self._far[lips]]
        broken = np.flatnonzero(gone & self._here)
        normals, framed = lip_normals(at[self._nodes[broken]]), self._normals[broken]
        if interactions.turns:
            frame = self._frames(interactions, own, each, np.flatnonzero(gone), broken)
            framed = (self._side[broken, None] * frame)[:, None]
        turned = np.einsum("lsd,lsd->ls", normals, framed).min(axis=1, initial=1.0) < _TURNED
        parted = self._ranks.union(self._numbers[np.concatenate([apart, broken[turned]])])
        if len(parted):
            self._retire(self._known(parted)[1])
            interactions.deactivate((parted[:, None] * each + np.arange(each)).ravel())

    def _frames(
        self,
        interactions: Interactions,
        own: np.ndarray,
        each: int,
        gone: np.ndarray,
        asked: np.ndarray,
    ) -> np.ndarray:
        """Normals of the frames of broken lips, shape (len(asked), dim).

        Where vertices are solved alone the first point of a facet may be on a rank that looks at
        others: all ranks then tell each other the frames.

        Args:
            interactions, each: as of `release`.
            own: numbers of this rank's points on facets, ascending.
            gone: broken lips that have not parted, those known here.
            asked: those of them whose frames are wanted.
        """
        numbers = self._numbers[gone] * each
        place = np.searchsorted(own, numbers)
        here = np.isin(numbers, own)
        numbers, frames = numbers[here], interactions.points.frame[place[here], 0]
        if interactions.halo is not None and interactions.ordering == "vertices":
            told = self._ranks.comm.allgather((numbers, frames))
            numbers, frames = (np.concatenate(parts) for parts in zip(*told, strict=True))
            order = np.argsort(numbers)
            numbers, frames = numbers[order], frames[order]
        return frames[np.searchsorted(numbers, self._numbers[asked] * each)]

    def _known(self, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places of those numbers of facing facets that are known here, and which of `lips`."""
        if not len(self._numbers):
            return (np.zeros(0, int),) * 2
        lips = np.minimum(np.searchsorted(self._numbers, numbers), len(self._numbers) - 1)
        known = np.flatnonzero(self._numbers[lips] == numbers)
        return known, lips[known]

    def _open(self, ajar: np.ndarray, broken: np.ndarray) -> None:
        if len(ajar):
            self.search.leave_ajar(self._lips[ajar])
            self._ajar[ajar] = True
        if len(broken):
            self.search.expose(self._lips[broken])
            self._broken[broken] = True

    def _retire(self, lips: np.ndarray) -> None:
        self.search.release(self._lips[lips])
        self.retired[lips] = True
        self._waiting[lips] = False

    def saved(self) -> dict[str, Rows]:
        """Which facing facets with points have opened and which have retired."""
        kept = {"exposed": self._broken, "released": self.retired, "ajar": self._ajar}
        number = self._numbers[self._here]
        return {name: Rows(number, mask[self._here]) for name, mask in kept.items()}

    def restore(self, saved: Mapping[str, np.ndarray]) -> None:
        """Take what `saved` gave, its rows in order."""
        exposed, gone, ajar = (
            np.flatnonzero(saved[name][self._numbers]) for name in ("exposed", "released", "ajar")
        )
        self._open(ajar, exposed)
        self._retire(gone)
