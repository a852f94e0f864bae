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
        facets: facing facets.
        with_points: numbers of those that have points.
        taken: shape (len(with_points),), bool: those of them that the search may take over.
        ranks: those that divide the points.
        here: shape (len(with_points),), bool: of which of them this rank looks at the normals; it
            has one of the two bodies, and where all points of a facet are on one rank, has them.
    """

    def __init__(
        self,
        search: SurfaceSearch,
        x: np.ndarray,
        facets: FacingFacets,
        with_points: np.ndarray,
        taken: np.ndarray,
        ranks: Ranks,
        here: np.ndarray,
    ):
        self._search, self._lips, self._ranks, self._here = search, with_points, ranks, here
        self._loose = np.zeros((len(taken), 0), bool)  # by point, once there are any
        self._waiting = taken.copy()
        self._broken, self._ajar, self._retired = np.zeros((3, len(taken)), bool)
        self._num_facets, dim = len(facets), x.shape[1]
        self._far = _FAR * facets.measure[with_points] ** (1.0 / (dim - 1))
        self._nodes = search.surface.bond_nodes[with_points]
        self._normals = lip_normals(x[self._nodes])
        own = facets.normal[with_points]
        self._side = np.sign(np.einsum("ld,ld->l", own, self._normals[:, 0]))

    def release(
        self,
        interactions: Interactions,
        each: int,
        moved: Callable[[], np.ndarray],
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
        if not self._waiting.any():
            return
        if not self._loose.size:
            self._loose = np.zeros((len(self._lips), each), bool)
        loose, own = self._loose.reshape(-1), interactions.numbers
        own = own[own < len(loose)]  # those of ties and walls come behind
        lips, points = own // each, np.arange(len(own))
        waiting = np.flatnonzero(self._waiting[lips] & ~loose[own])
        unbonded = interactions.local_unbonded()[waiting]
        new = self._ranks.union(own[waiting[unbonded]])
        loose[new] = True
        opened = np.unique(new // each)
        broken = opened[self._loose[opened].all(axis=1)]
        self._open(opened[~self._ajar[opened]], broken[~self._broken[broken]])
        gone = self._broken & self._waiting
        if not gone.any():
            return
        at = moved()
        points = points[gone[lips]]
        jump = np.linalg.norm(interactions.local("jump")[points], axis=1)
        apart = lips[points[jump > self._far[lips[points]]]]
        broken = np.flatnonzero(gone & self._here)
        normals, framed = lip_normals(at[self._nodes[broken]]), self._normals[broken]
        if interactions.turns:
            frame = interactions.points.frame[np.searchsorted(own, broken * each), 0]
            framed = (self._side[broken, None] * frame)[:, None]
        turned = np.einsum("lsd,lsd->ls", normals, framed).min(axis=1, initial=1.0) < _TURNED
        parted = self._ranks.union(np.concatenate([apart, broken[turned]]))
        if len(parted):
            self._retire(parted)
            interactions.deactivate((parted[:, None] * each + np.arange(each)).ravel())

    def _open(self, ajar: np.ndarray, broken: np.ndarray) -> None:
        if len(ajar):
            self._search.leave_ajar(self._lips[ajar])
            self._ajar[ajar] = True
        if len(broken):
            self._search.expose(self._lips[broken])
            self._broken[broken] = True

    def _retire(self, lips: np.ndarray) -> None:
        self._search.release(self._lips[lips])
        self._retired[lips] = True
        self._waiting[lips] = False

    def saved(self) -> dict[str, np.ndarray]:
        """Which facing facets have opened and which have retired, the same on all ranks."""
        kept = {"exposed": self._broken, "released": self._retired, "ajar": self._ajar}
        out = {name: np.zeros(self._num_facets, bool) for name in kept}
        for name, mask in kept.items():
            out[name][self._lips] = mask
        return out

    def restore(self, saved: Mapping[str, np.ndarray]) -> None:
        """Take what `saved` gave."""
        exposed, gone, ajar = (
            np.flatnonzero(saved[name][self._lips]) for name in ("exposed", "released", "ajar")
        )
        self._open(ajar, exposed)
        self._retire(gone)
