# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bonds that turn beyond what small strain bears.

Materials at small strain are stressed by a rotation, by E alpha^2 / 2 for an angle alpha, and their
bonds keep the frames of the start.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.kernel_options import LEAN_ENTRY

if TYPE_CHECKING:
    from xper_fx.bodies.explode import Bodies
    from xper_fx.nscd.interactions import Interactions
    from xper_fx.parallel.local_bodies import LocalBodies
    from xper_fx.support.ranks import Ranks

# Angle (rad) that bonds may turn by at small strain, and share of them that may turn further:
# single cells that tumble among debris decide nothing.
LARGEST_TURN, FEW = np.radians(10.0), 1e-2


class TurnedBonds(NamedTuple):
    """The sound bonds that have turned too far."""

    angle: float  #: that the one that has turned most has turned by (rad)
    midpoint: np.ndarray  #: of its facet at the start (m)
    share: float  #: of all bonds of the scene that may break


class BondTurns:
    """The angles by which facets with bonds that may break have turned.

    Args:
        bodies: all bodies.
        part: what this rank has of them, None if it has all.
        ranks: those that divide the bodies.
        V: space of the displacements on this rank.
        facets: which facing facets have a law, and so points.
        numbers: shape (num_facets with a law,), their numbers among those of all ranks.
        breaks: shape (num_facets with a law,), whether their bonds may break.
        each: points on a facet.
    """

    def __init__(
        self,
        bodies: Bodies,
        part: LocalBodies | None,
        ranks: Ranks,
        V,
        facets: np.ndarray,
        numbers: np.ndarray,
        breaks: np.ndarray,
        each: int,
    ):
        self._midpoint = bodies.facets.midpoint[facets]
        self._here = np.flatnonzero(breaks)
        if part is None:
            nodes = bodies.facing_nodes(V)[facets[self._here], 0]
        else:
            from xper_fx.parallel.local_bodies import nodes_on_sides

            candidate = part.rank_of_body[bodies.facets.bodies[facets, 0]]
            self._here = np.flatnonzero(breaks & (candidate == ranks.rank))
            nodes = nodes_on_sides(part, V, bodies.facets, facets[self._here], 0)
        self._nodes = nodes
        self._count = ranks.sum(len(self._here))
        self._points = numbers[self._here][:, None] * each + np.arange(each)
        self._x = V.tabulate_dof_coordinates()[:, : bodies.mesh.geometry.dim]
        self._normal = lip_normals(self._x[nodes])

    def beyond(self, interactions: Interactions, displacement: np.ndarray) -> TurnedBonds | None:
        """The bonds that have spent nothing and have turned too far, None if there are none.

        Args:
            interactions: the points, those on facets first.
            displacement: of all nodes of V on this rank, flat (m).
        """
        cosine, u = np.empty(len(self._nodes)), displacement.reshape(self._x.shape)
        _turn_kernel(u.shape[1])(self._x, u, self._nodes, self._normal, cosine)
        far = cosine < np.cos(LARGEST_TURN)
        if interactions.everywhere(not far.any()):
            return None
        far &= np.all(interactions.gather("spent")[self._points] == 0.0, axis=1)
        turned = int(interactions.total(int(far.sum())))
        if not turned:
            return None
        least = float(interactions.largest(-cosine[far].min(initial=np.inf)))
        place = np.full(self._midpoint.shape[1], -np.inf)
        if far.any() and -cosine[far].min() == least:
            place = self._midpoint[self._here[far]][np.argmin(cosine[far])]
        angle = float(np.arccos(np.clip(-least, -1.0, 1.0)))
        return TurnedBonds(angle, interactions.largest(place), turned / self._count)


def lip_normals(x: np.ndarray) -> np.ndarray:
    """Unit normals of lips with nodes at x, shape (..., k, dim), all turned alike."""
    along = x[..., 1, :] - x[..., 0, :]
    if x.shape[-1] == 2:
        normal = np.stack([along[..., 1], -along[..., 0]], axis=-1)
    else:
        normal = np.cross(along, x[..., 2, :] - x[..., 0, :])
    return normal / np.linalg.norm(normal, axis=-1, keepdims=True)


@cache
def _turn_kernel(dim: int):
    """Kernel: cosines of the angles between `lip_normals` and where lips have moved to."""
    algebra = for_dimension(dim)
    row, add, subtract, dot = algebra.row, algebra.add, algebra.subtract, algebra.dot

    @njit(**LEAN_ENTRY)
    def cosines(x, u, nodes, normal, out):
        for f in range(len(nodes)):
            i, j = nodes[f, 0], nodes[f, 1]
            first = add(row(x, i), row(u, i))
            along = subtract(add(row(x, j), row(u, j)), first)
            if dim == 2:
                turned = along[1], -along[0]
            else:
                k = nodes[f, 2]
                (a, b, c), beside = along, subtract(add(row(x, k), row(u, k)), first)
                turned = (
                    b * beside[2] - c * beside[1], c * beside[0] - a * beside[2],
                    a * beside[1] - b * beside[0],
                )  # fmt: skip
            out[f] = dot(turned, row(normal, f)) / np.sqrt(dot(turned, turned))

    return cosines
