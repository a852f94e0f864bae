# SPDX-License-Identifier: LGPL-3.0-or-later
"""The inverse w of an iteration matrix that couples nothing across bodies.

Three kinds, one interface: `factor` takes the matrix, `apply` gives w r on all dofs, `blocks` is
w on the interacting nodes for the interaction layer, `nodes` says which nodes these are among
`num_nodes`. `advance` is a whole Newton increment: `apply`, unless a border is added to w. Dofs
whose motion is prescribed, and unknowns that belong to no body, have zero rows and columns in w.
"""

from __future__ import annotations

import numpy as np

from xper_fx.bulk.body_dofs import BodyLayout
from xper_fx.bulk.sparse_blocks import BlockMatrix, apply_blocks, is_symmetric
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.support.threads import in_ranges

# Bodies inverted at a time: what is needed on the way stays in cache.
_BATCH = 1024


class _OnBodies:
    """An inverse to which no border is added.

    Attributes:
        in_order: whether an impulse moves no other node than that on which it acts, and the
            interacting nodes are all that there are, in the bulk's order.
    """

    in_order = False

    def advance(self, residual: np.ndarray) -> np.ndarray:
        """Newton's increment of all velocities, shape (num_dofs,)."""
        return self.apply(residual)


class CellwiseInverse(_OnBodies):
    """Bodies of one small size (each cell a body): dense blocks, inverted together.

    Args:
        layout: bodies of one size.
    """

    def __init__(self, layout: BodyLayout):
        self._layout = layout
        self.nodes = layout.nodes
        self.num_nodes = len(layout.nodes)

    def factor(self, matrix: BlockMatrix) -> None:
        """Invert the bodies' blocks of `matrix`, which is in blocks of dim x dim."""
        layout = self._layout
        size = self.num_nodes // layout.num_bodies * layout.dim
        self._w, self.blocks = BodyInverse.empty_uniform(layout.num_bodies, size, layout.dim)
        in_ranges(self._invert, layout.num_bodies, matrix, layout.place_in_body())

    def _invert(self, first: int, last: int, matrix, place) -> None:
        layout, size = self._layout, self._w.shape[1]
        diagonal = np.arange(size)
        for low in range(first, last, _BATCH):
            bodies = np.arange(low, min(low + _BATCH, last))
            blocks = layout.dense_blocks(matrix, bodies, place)
            dofs = layout.dofs(layout.nodes.reshape(layout.num_bodies, -1)[bodies].ravel())
            fixed = layout.prescribed[dofs].reshape(-1, size)
            blocks[fixed[:, :, None] | fixed[:, None, :]] = 0.0
            blocks[:, diagonal, diagonal] += fixed
            w = np.linalg.inv(blocks)
            w[:, diagonal, diagonal] -= fixed
            self._w[bodies] = 0.5 * (w + w.transpose(0, 2, 1))

    def apply(self, residual: np.ndarray) -> np.ndarray:
        """W r, shape (num_dofs,)."""
        out = np.empty_like(residual)
        in_ranges(apply_blocks(self._layout.dim), len(self._w), self._w, self.nodes, residual, out)
        out[len(self.nodes) * self._layout.dim :] = 0.0
        return out

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        return self.blocks.data.nbytes


class ClusterInverse(_OnBodies):
    """Bodies of any size: a sparse factorisation each, dense w on their interacting nodes.

    Args:
        interacting: nodes (DOLFINx numbering) at which interactions act.
    """

    def __init__(self, layout: BodyLayout, interacting: np.ndarray):
        self._layout = layout
        self.num_nodes = len(layout.nodes)
        acts = np.zeros(self.num_nodes, bool)
        acts[interacting] = True
        self._bodies = []
        nodes = []
        for first, last in zip(layout.offsets[:-1], layout.offsets[1:], strict=True):
            own = layout.nodes[first:last]
            dofs = layout.dofs(own)
            free = np.sort(dofs[~layout.prescribed[dofs]])
            contact = layout.dofs(own[acts[own]])
            known = np.flatnonzero(~layout.prescribed[contact])
            # free dofs, rows of w that are not zero, their places among the free dofs, size of w
            self._bodies.append((free, known, np.searchsorted(free, contact[known]), len(contact)))
            nodes.append(own[acts[own]])
        self.nodes = np.concatenate(nodes) if nodes else np.zeros(0, np.int64)

    def factor(self, matrix: BlockMatrix) -> None:
        """Factorise each body's free block and form w on its interacting dofs.

        Of bodies that interact it is the symmetric part of `matrix`, as plastic flow at finite
        strain has other tangents: impulses are found for a symmetric w on the interacting dofs,
        and have to move bodies by the same.
        """
        from scipy.sparse.linalg import splu

        matrix = matrix.to_scipy().tocsr()
        if any(len(known) for _, known, *_ in self._bodies) and not is_symmetric(matrix):
            matrix = (0.5 * (matrix + matrix.T)).tocsr()
        matrix.eliminate_zeros()  # of blocks; they would fill in, and cost a fifth of a solution
        self._factors, blocks = [], []
        for free, known, where, size in self._bodies:
            w = np.zeros((size, size))
            lu = None
            if len(free):
                lu = splu(
                    matrix[free][:, free].tocsc(),
                    permc_spec="MMD_AT_PLUS_A",
                    options={"SymmetricMode": True, "DiagPivotThresh": 0.0},
                )
                units = np.zeros((len(free), len(known)))
                units[where, np.arange(len(known))] = 1.0
                columns = lu.solve(units)[where]
                w[np.ix_(known, known)] = 0.5 * (columns + columns.T)
            self._factors.append(lu)
            blocks.append(w)
        self.blocks = BodyInverse.from_blocks(blocks, self._layout.dim)

    def apply(self, residual: np.ndarray) -> np.ndarray:
        """W r, shape (num_dofs,)."""
        out = np.zeros_like(residual)
        for (free, *_), lu in zip(self._bodies, self._factors, strict=True):
            if lu is not None:
                out[free] = lu.solve(residual[free])
        return out

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        factors = sum(12 * (lu.L.nnz + lu.U.nnz) for lu in self._factors if lu is not None)
        return factors + self.blocks.data.nbytes


class LumpedInverse(_OnBodies):
    """The inverse of a lumped mass, diagonal.

    Args:
        mass: shape (num_dofs,), lumped mass (kg; 2D: kg/m).
        interacting: nodes at which interactions act, in the order the layer shall use.
        by_body: whether the blocks are those of bodies, as sides with several nodes need, all of
            which lie in one block. Every node has a block otherwise.

    Attributes:
        diagonal: of w, shape (num_dofs,), zero where motions are prescribed.
    """

    def __init__(
        self, layout: BodyLayout, mass: np.ndarray, interacting: np.ndarray, by_body: bool = False
    ):
        self.diagonal = np.where(layout.prescribed, 0.0, 1.0 / mass)
        self.nodes = interacting
        self.num_nodes = len(layout.nodes)
        self.in_order = np.array_equal(interacting, np.arange(self.num_nodes))
        sizes = np.ones(len(interacting), np.int64)
        if by_body:
            sizes = np.bincount(layout.body_of_node()[interacting])
            sizes = sizes[sizes > 0]
        own = self.diagonal[layout.dofs(interacting)]
        self.blocks = BodyInverse.from_diagonal(own, sizes, layout.dim)

    def apply(self, residual: np.ndarray) -> np.ndarray:
        """W r, shape (num_dofs,)."""
        return self.diagonal * residual

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        return self.diagonal.nbytes + self.blocks.data.nbytes
