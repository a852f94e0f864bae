# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Watches cells for strains beyond a bound, at little cost as long as there are none.

With F_0 at a place that strains are counted from, f = F F_0^-1 and the strain of a cell

    e = max |f^T f - I| / 2   (row sums),

of its points of quadrature, as a cell that bends need not be strained in its middle.

Strains are looked at where they may be beyond the bound m alone. Let no node of a cell have moved
by more than r against its first node since the last look, which saw e. As sum_n |grad N_n| <= g, f
has changed by less than b = g r |F_0^-1|. With |f|^2 <= 1 + 2 e the strain has changed, in row
sums, by less than

    sqrt(dim) (b sqrt(1 + 2 e) + b^2 / 2) = m - e   at   b = sqrt(1 + 2 c) - sqrt(1 + 2 e),

c = e + (m - e) / sqrt(dim). A cell is looked at again once a node of it is beyond its r: none
passes the bound unseen, be it crushed in one step, and what is found does not depend on earlier
looks.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from dolfinx import fem

from xper_fx.cache import njit
from xper_fx.forms.shape_gradients import ShapeGradients, gradient_kernel

# Relative slack of r, for rounding.
_SLACK = 1e-9


@cache
def _kernels(dim: int):
    """Kernels that fill gradients, and that look at strains."""
    gradient = gradient_kernel(dim)

    @njit
    def displacement_gradients(places, shapes, out):
        """F - I at all points of all cells, from the displacements of the nodes of each."""
        _, jacobians, shape = shapes
        work = np.empty((dim, dim))
        for cell in range(len(out)):
            for q in range(len(shape)):
                jacobian = jacobians[cell, min(q, jacobians.shape[1] - 1)]
                gradient(places[cell], jacobian, shape[q], work, out[cell, q])

    @njit
    def moved(place, nodes, before, radius):
        """Whether a node of a cell has moved against its first one by a radius or more."""
        bound, first = radius * radius, nodes[0]
        for n in range(1, len(nodes)):
            square = 0.0
            for i in range(dim):
                way = place[nodes[n], i] - before[n, i] - (place[first, i] - before[0, i])
                square += way * way
            if square >= bound:
                return True
        return False

    @njit
    def largest(place, shapes, spread, inverses, bound, radii, kept):
        """Largest strain of the cells looked at; a NaN is left out.

        Args:
            place: displacements, shape (num_nodes, dim).
            shapes, spread: a `ShapeGradients` and its `spread`.
            inverses: F_0^-1, shape (num_cells, num_points, dim, dim).
            bound: m.
            radii: r of each cell, renewed where it is looked at (m).
            kept: displacements of the nodes of each cell at its last look, renewed.
        """
        dofmap, jacobians, shape = shapes
        top, f, h, work = 0.0, np.empty((dim, dim)), np.empty((dim, dim)), np.empty((dim, dim))
        for cell in range(len(radii)):
            nodes = dofmap[cell]
            if not moved(place, nodes, kept[cell], radii[cell]):
                continue
            for n in range(len(nodes)):
                for i in range(dim):
                    kept[cell, n, i] = place[nodes[n], i]
            strain, stretch = 0.0, 0.0
            for q in range(len(shape)):
                jacobian = jacobians[cell, min(q, jacobians.shape[1] - 1)]
                gradient(kept[cell], jacobian, shape[q], work, h)
                square = 0.0
                for i in range(dim):
                    for j in range(dim):
                        f[i, j] = inverses[cell, q, i, j]
                        square += f[i, j] * f[i, j]
                        for k in range(dim):
                            f[i, j] += h[i, k] * inverses[cell, q, k, j]
                stretch = max(stretch, np.sqrt(square))
                for i in range(dim):
                    row = 0.0
                    for j in range(dim):
                        c = -1.0 if i == j else 0.0
                        for k in range(dim):
                            c += f[k, i] * f[k, j]
                        row += abs(c)
                    strain = max(strain, 0.5 * row)
            top = max(top, strain)
            far = 1.0 + 2.0 * (strain + (bound - strain) / np.sqrt(dim))
            change = max(np.sqrt(max(far, 0.0)) - np.sqrt(1.0 + 2.0 * strain), 0.0)
            radii[cell] = (1.0 - _SLACK) * change / (spread[cell] * stretch)
        return top

    return displacement_gradients, largest


class StrainWatch:
    """Of the cells of a space.

    Args:
        V: vector Lagrange space of the displacements.
        points: of quadrature, in the reference cell, shape (num_points, dim).

    Attributes:
        inverses: F_0^-1, shape (num_cells, num_points, dim, dim), at rest at first.
    """

    def __init__(self, V: fem.FunctionSpace, points: np.ndarray):
        self._shapes, dim = ShapeGradients.of(V, points), V.mesh.geometry.dim
        self._gradients, self._largest = _kernels(dim)
        self._spread = self._shapes.spread()
        self.inverses = np.tile(np.eye(dim), (len(self._spread), len(points), 1, 1))
        self._bound = np.inf
        self._radii = np.zeros(len(self._spread))
        self._kept = np.zeros((*self._shapes.dofmap.shape, dim))

    def count_from(self, place: np.ndarray) -> None:
        """Count strains from displacements, shape (num_nodes, dim)."""
        gradients = np.empty_like(self.inverses)
        self._gradients(place[self._shapes.dofmap], self._shapes, gradients)
        self.take(np.linalg.inv(np.eye(place.shape[1]) + gradients))

    def take(self, inverses: np.ndarray) -> None:
        """Count strains from where F was the inverse of some."""
        self.inverses, self._radii[:] = inverses, 0.0

    def largest(self, place: np.ndarray, bound: float) -> float:
        """Largest strain of the cells of this rank in which it may be beyond a bound; zero if none.

        Args:
            place: displacements, shape (num_nodes, dim).
            bound: above zero.
        """
        if bound < self._bound:
            self._radii[:] = 0.0
        self._bound = bound
        return self._largest(
            place, self._shapes, self._spread, self.inverses, bound, self._radii, self._kept
        )
