# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of shape functions at points of quadrature, as kernels take them.

The gradient of shape function n is J^-T times that in the reference cell. The latter are a table
for all cells, the Jacobian J of a linear simplex is the same at all of its points.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import ufl
from dolfinx import fem

from xper_fx.cache import njit
from xper_fx.forms.compiled import compiled_expression


class ShapeGradients(NamedTuple):
    """Of a vector Lagrange space."""

    dofmap: np.ndarray  #: nodes of the cells, shape (num_cells, num_nodes)
    #: J^-1, shape (num_cells, num_points or one where all are the same, dim, dim), 1/m
    inverses: np.ndarray
    #: derivatives of the shape functions in the reference cell, shape (num_points, dim, num_nodes)
    shape: np.ndarray

    @classmethod
    def of(cls, V: fem.FunctionSpace, points: np.ndarray) -> ShapeGradients:
        """Those of a space.

        Args:
            V: vector Lagrange space.
            points: of quadrature, in the reference cell, shape (num_points, dim).
        """
        mesh, dofmap = V.mesh, V.dofmap.list
        same = mesh.ufl_domain().is_piecewise_linear_simplex_domain()
        places = points[:1] if same else points
        inverse = compiled_expression(ufl.JacobianInverse(mesh), places)
        dim, cells = mesh.geometry.dim, np.arange(len(dofmap), dtype=np.int32)
        inverses = inverse.eval(mesh, cells).reshape(len(cells), len(places), dim, dim)
        table = V.sub(0).element.basix_element.tabulate(1, points)[1:, :, :, 0]
        return cls(dofmap, inverses, np.ascontiguousarray(table.transpose(1, 0, 2)))

    def spread(self) -> np.ndarray:
        """Largest sum, at a point of each cell, of the lengths of the gradients (1/m).

        The first node's is left out: with displacements taken from those of this node, the
        displacement gradient is no larger than this times the largest of them.
        """
        out = np.empty(len(self.dofmap))
        _spread(self.inverses, self.shape, out)
        return out


@njit
def _spread(inverses, shape, out):
    """Fill `ShapeGradients.spread`."""
    num_points, dim, num_nodes = shape.shape
    last = inverses.shape[1] - 1
    for cell in range(len(out)):
        out[cell] = 0.0
        for q in range(num_points):
            inverse = inverses[cell, min(q, last)]
            total = 0.0
            for node in range(1, num_nodes):
                square = 0.0
                for i in range(dim):
                    component = 0.0
                    for k in range(dim):
                        component += inverse[k, i] * shape[q, k, node]
                    square += component * component
                total += np.sqrt(square)
            out[cell] = max(out[cell], total)


@cache
def gradient_kernel(dim: int):
    """Kernel `gradient(values, inverse, shape, work, out)`, to be called by others.

    Values are those of the nodes of a cell, shape (num_nodes, dim), `inverse` its J^-1 and `shape`
    the derivatives at a point, shape (dim, num_nodes); `out` takes the gradient, `work` is of its
    shape.
    """

    @njit
    def gradient(values, inverse, shape, work, out):
        for i in range(dim):
            for k in range(dim):
                work[i, k] = 0.0
        for n in range(len(values)):
            for i in range(dim):
                for k in range(dim):
                    work[i, k] += values[n, i] * shape[k, n]
        for i in range(dim):
            for j in range(dim):
                total = 0.0
                for k in range(dim):
                    total += work[i, k] * inverse[k, j]
                out[i, j] = total

    return gradient
