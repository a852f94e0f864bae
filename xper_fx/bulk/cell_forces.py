# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Internal forces of linear bodies of one simplex each, from its gradients and its moduli.

In a simplex of order 1 with shape functions N_a the strain eps = B u is constant, and the forces
are

    f_a = V sigma grad N_a,   sigma = D eps,   K = V B^T D B

(Zienkiewicz, Taylor and Zhu 2013, section 2.3). D need not be known: with U the displacements of
the nodes that the unit strains give, B U = I, so V D = U^T K U. Gradients and moduli are 10 numbers
a triangle where K has 36, and 30 a tetrahedron where K has 144.
"""

from __future__ import annotations

from functools import cache
from math import isqrt

import numpy as np
from dolfinx.fem import FunctionSpace

from xper_fx.bulk.body_dofs import BodyLayout
from xper_fx.bulk.sparse_blocks import BlockMatrix
from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.support.threads import in_ranges

# Relative difference of V B^T D B and K that is rounding.
_SAME = 1e-10
# Cells whose blocks are looked at together: they stay in cache.
_BATCH = 1024
# Components of the strains as rows and columns, shears last and as angles (Voigt).
_VOIGT = {2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))}


@cache
def forces_kernel(dim: int):
    """Kernel `forces(first, last, gradients, moduli, u, out)` of a range of cells.

    Rows of `u` and `out`, which may be the same, are cells.
    """
    options = LEAN_ENTRY | {"nogil": True, "fastmath": {"contract"}}

    @njit(**options)
    def in_plane(first, last, gradients, moduli, u, out):
        for c in range(np.uintp(first), np.uintp(last)):
            x, y, g, d = u[c, 0], u[c, 1], gradients[c], moduli[c]
            jx, jy, kx, ky = u[c, 2] - x, u[c, 3] - y, u[c, 4] - x, u[c, 5] - y
            xx, yy = jx * g[0] + kx * g[2], jy * g[1] + ky * g[3]
            xy = jx * g[1] + jy * g[0] + kx * g[3] + ky * g[2]
            s_xx = d[0] * xx + d[1] * yy + d[2] * xy
            s_yy = d[1] * xx + d[3] * yy + d[4] * xy
            s_xy = d[2] * xx + d[4] * yy + d[5] * xy
            f_jx, f_jy = s_xx * g[0] + s_xy * g[1], s_xy * g[0] + s_yy * g[1]
            f_kx, f_ky = s_xx * g[2] + s_xy * g[3], s_xy * g[2] + s_yy * g[3]
            out[c, 0], out[c, 1] = -(f_jx + f_kx), -(f_jy + f_ky)
            out[c, 2], out[c, 3], out[c, 4], out[c, 5] = f_jx, f_jy, f_kx, f_ky

    @njit(**options)
    def in_space(first, last, gradients, moduli, u, out):
        for c in range(np.uintp(first), np.uintp(last)):
            g, d = gradients[c], moduli[c]
            xx, yy, zz, yz, xz, xy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for a in range(3):
                j = 3 * a + 3
                x, y, z = u[c, j] - u[c, 0], u[c, j + 1] - u[c, 1], u[c, j + 2] - u[c, 2]
                g_x, g_y, g_z = g[3 * a], g[3 * a + 1], g[3 * a + 2]
                xx += x * g_x
                yy += y * g_y
                zz += z * g_z
                yz += y * g_z + z * g_y
                xz += x * g_z + z * g_x
                xy += x * g_y + y * g_x
            s_xx = d[0] * xx + d[1] * yy + d[2] * zz + d[3] * yz + d[4] * xz + d[5] * xy
            s_yy = d[1] * xx + d[6] * yy + d[7] * zz + d[8] * yz + d[9] * xz + d[10] * xy
            s_zz = d[2] * xx + d[7] * yy + d[11] * zz + d[12] * yz + d[13] * xz + d[14] * xy
            s_yz = d[3] * xx + d[8] * yy + d[12] * zz + d[15] * yz + d[16] * xz + d[17] * xy
            s_xz = d[4] * xx + d[9] * yy + d[13] * zz + d[16] * yz + d[18] * xz + d[19] * xy
            s_xy = d[5] * xx + d[10] * yy + d[14] * zz + d[17] * yz + d[19] * xz + d[20] * xy
            f_x, f_y, f_z = 0.0, 0.0, 0.0
            for a in range(3):
                j = 3 * a + 3
                g_x, g_y, g_z = g[3 * a], g[3 * a + 1], g[3 * a + 2]
                x = s_xx * g_x + s_xy * g_y + s_xz * g_z
                y = s_xy * g_x + s_yy * g_y + s_yz * g_z
                z = s_xz * g_x + s_yz * g_y + s_zz * g_z
                out[c, j], out[c, j + 1], out[c, j + 2] = x, y, z
                f_x += x
                f_y += y
                f_z += z
            out[c, 0], out[c, 1], out[c, 2] = -f_x, -f_y, -f_z

    return in_plane if dim == 2 else in_space


class CellForces:
    """f = K u of bodies of one simplex of order 1 each, whose nodes are those of V in their order.

    Args:
        gradients: of all shape functions but the first, shape (num_cells, dim^2), 1/m.
        moduli: V D, upper triangle by rows, shape (num_cells, 6 or 21), N m (2D: N).

    Attributes:
        arrays: both.
        dim: dimension of space.
    """

    def __init__(self, gradients: np.ndarray, moduli: np.ndarray):
        self.arrays = gradients, moduli
        self.dim = isqrt(gradients.shape[1])

    @classmethod
    def of(cls, stiffness: BlockMatrix, V: FunctionSpace) -> CellForces | None:
        """What stands for a stiffness; None where bodies are not of one simplex of order 1 each.

        So it is where there are no bodies, or rounding leaves gradients and moduli too far from K.

        Args:
            stiffness: K on the nodes of V, in blocks of dim x dim.
            V: vector Lagrange space on the mesh of the bodies.
        """
        cells, dim = V.dofmap.list, V.dofmap.index_map_bs
        num_cells, size = cells.shape
        one_simplex = size == dim + 1 and V.mesh.topology.cell_name() in ("triangle", "tetrahedron")
        alone = one_simplex and 0 < cells.size * dim == stiffness.size
        if not alone or not np.array_equal(cells.ravel(), np.arange(cells.size)):
            return None
        x = V.tabulate_dof_coordinates()[:, :dim]
        voigt = _VOIGT[dim]
        layout = BodyLayout(cells.ravel(), np.arange(num_cells + 1) * size, dim, np.zeros(0, bool))
        place, upper = layout.place_in_body(), np.triu_indices(len(voigt))
        gradients = np.empty((num_cells, dim * dim))
        moduli, same = np.empty((num_cells, len(upper[0]))), np.empty(num_cells, bool)

        def measure(first, last):
            for low in range(first, last, _BATCH):
                at = np.arange(low, min(low + _BATCH, last))
                blocks = layout.dense_blocks(stiffness, at, place)
                edges = x[cells[at, 1:]] - x[cells[at, :1]]
                strained = np.zeros((len(at), size, dim, len(voigt)))
                of_nodes = np.linalg.inv(edges).transpose(0, 2, 1)
                strain = np.zeros((len(at), len(voigt), size, dim))
                for number, (row, column) in enumerate(voigt):
                    # a unit strain without spin; a shear of angle one has halves of it
                    strained[:, 1:, row, number] += 0.5 * edges[:, :, column]
                    strained[:, 1:, column, number] += 0.5 * edges[:, :, row]
                    strain[:, number, 1:, row] = of_nodes[:, :, column]
                    strain[:, number, 1:, column] = of_nodes[:, :, row]
                strain[:, :, 0] = -strain[:, :, 1:].sum(axis=2)
                unit = strained.reshape(len(at), size * dim, -1)
                b = strain.reshape(len(at), -1, size * dim)
                d = unit.transpose(0, 2, 1) @ blocks @ unit
                d = 0.5 * (d + d.transpose(0, 2, 1))
                error = np.abs(b.transpose(0, 2, 1) @ d @ b - blocks).max(axis=(1, 2))
                same[at] = error <= _SAME * np.abs(blocks).max(axis=(1, 2))
                gradients[at] = of_nodes.reshape(len(at), -1)
                moduli[at] = d[:, upper[0], upper[1]]

        in_ranges(measure, num_cells)
        return cls(gradients, moduli) if same.all() else None

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        return sum(array.nbytes for array in self.arrays)

    def __call__(self, u: np.ndarray) -> np.ndarray:
        """K u, shape (num_dofs of V,), N (2D: N/m)."""
        u = u.reshape(len(self.arrays[0]), -1)
        out = np.empty_like(u)
        in_ranges(forces_kernel(self.dim), len(u), *self.arrays, u, out)
        return out.reshape(-1)
