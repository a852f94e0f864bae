# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Bodies that interactions alone hold, in a run without inertia: their stiffness K is singular.

As many dofs of a body as it has free rigid motions R are its anchors, the columns of C, so that
C^T R is regular; R below is scaled to C^T R = 1. Let w0 be K^-1 with the anchors held. Then

    K v = f   <=>   v = w0 f + R a,   R^T f = 0,

with the velocities a of the anchors (Farhat and Roux 1991). A solver of the interactions that knows
of anchors takes a for unknowns and R^T f = 0 for their equations (`nscd/solvers/feti.py`).

Any other solver finds the body on springs at its anchors,

    w = w0 + R rho^-1 R^T = (K + C rho C^T)^-1,

which let go after each iteration of the bulk: the residual is that of K alone. Where iterations
come to rest the springs bear nothing, whatever rho and the laws are (the proximal point algorithm;
Rockafellar 1976), and K is not regularised.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from xper_fx.bulk.body_dofs import BodyLayout
from xper_fx.bulk.body_inverse import CellwiseInverse, ClusterInverse
from xper_fx.bulk.rigid_motions import free_rigid_modes
from xper_fx.bulk.sparse_blocks import BlockMatrix
from xper_fx.nscd.anchors import Anchors

# rho beside the stiffness of the dof: soft beside what holds a body in its scene, so that few
# iterations are needed, and not so soft that rounding of its motion as a whole hides its strain.
_SOFTNESS = 1e-4
# Motion of bodies on the springs, beside the displacements, that rounding of their forces gives.
ROUNDING = 1e-12 / _SOFTNESS
# What a motion of unit mean square leaves on the dofs of a body that interact, below which it is
# not held: a body on a hinge.
_HINGE = 1e-8


class AnchoredInverse:
    """w of a bulk some of whose bodies float; see `body_inverse.py` for what it offers.

    Args:
        x: positions of their nodes, shape (num_nodes, dim), m.
        interacting: nodes at which interactions act.
        numbers: shape (num_bodies,), by which all ranks know the bodies; None on one rank.

    Raises:
        ValueError: the interactions of a body leave it free to turn.
    """

    in_order = False

    def __init__(
        self,
        layout: BodyLayout,
        x: np.ndarray,
        interacting: np.ndarray,
        numbers: np.ndarray | None = None,
    ):
        self._dim = layout.dim
        self._dofs, self._motions = _anchored_motions(layout, x, interacting, numbers)
        prescribed = layout.prescribed.copy()
        prescribed[self._dofs] = True
        held = replace(layout, prescribed=prescribed)
        self._held = CellwiseInverse(held) if layout.uniform else ClusterInverse(held, interacting)
        self.nodes, self.num_nodes = self._held.nodes, self._held.num_nodes
        self._slot_motions = sp.csc_array(self._motions[layout.dofs(self.nodes)])

    def factor(self, matrix: BlockMatrix) -> None:
        """Factorise the bodies' blocks of `matrix` with their anchors held, and form w."""
        self._held.factor(matrix)
        self._springs = _SOFTNESS * matrix.to_scipy().diagonal()[self._dofs]
        self._slot_motions.resize(self._held.blocks.num_slots * self._dim, len(self._dofs))
        self.blocks = self._on_springs(self._held.blocks)

    def _on_springs(self, held):
        """w on the interacting dofs, from w0."""
        data, motions = held.data.copy(), self._slot_motions
        first_dof = held.node_offsets * self._dim
        first_rows = motions.indices[motions.indptr[:-1]]
        block_of = np.searchsorted(first_dof, first_rows, side="right") - 1
        for block in np.unique(block_of):
            own = np.flatnonzero(block_of == block)
            dense = motions[first_dof[block] : first_dof[block + 1], own].toarray()
            span = slice(held.data_offsets[block], held.data_offsets[block + 1])
            data[span] += ((dense / self._springs[own]) @ dense.T).ravel()
        return replace(held, data=data)

    def apply(self, residual: np.ndarray) -> np.ndarray:
        """W r, shape (num_dofs,)."""
        motion = self._motions @ ((self._motions.T @ residual) / self._springs)
        return self._held.apply(residual) + motion

    def advance(self, residual: np.ndarray) -> np.ndarray:
        """Newton's increment of all velocities, shape (num_dofs,)."""
        return self.apply(residual)

    def anchors(self, residual: np.ndarray) -> Anchors:
        """What a solver of the interactions should know, for a residual of the bulk (N s)."""
        load = self._motions.T @ residual
        return Anchors(self._held.blocks, self._slot_motions, load, load / self._springs)

    def moved(self, anchors: Anchors) -> np.ndarray:
        """R a: what the solver has given the anchors, shape (num_dofs,), m/s."""
        return self._motions @ anchors.velocity

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        kept = (self._motions, self._slot_motions)
        motions = sum(m.data.nbytes + m.indices.nbytes + m.indptr.nbytes for m in kept)
        return self._held.nbytes + self.blocks.data.nbytes + motions


def _anchored_motions(
    layout: BodyLayout, x: np.ndarray, interacting: np.ndarray, numbers: np.ndarray | None
) -> tuple[np.ndarray, sp.csr_array]:
    """Anchors, shape (n,), and the rigid motions that move one of them each, (num_dofs, n)."""
    acts = np.zeros(len(layout.nodes), bool)
    acts[interacting] = True
    none = np.zeros(0, np.int64)
    chosen, rows, columns, values, count = [none], [none], [none], [np.zeros(0)], 0
    for body, (first, last) in enumerate(zip(layout.offsets[:-1], layout.offsets[1:], strict=True)):
        nodes = layout.nodes[first:last]
        dofs = layout.dofs(nodes)
        modes = free_rigid_modes(x[nodes], layout.prescribed[dofs].reshape(-1, layout.dim))
        number = modes.shape[1]
        if number == 0:
            continue
        here = np.flatnonzero(np.repeat(acts[nodes], layout.dim))
        _, triangle, order = scipy.linalg.qr(modes[here].T, mode="economic", pivoting=True)
        pivots = np.abs(np.diagonal(triangle))
        if len(pivots) < number or pivots.min() <= _HINGE / np.sqrt(len(modes)):
            name = body if numbers is None else numbers[body]
            raise ValueError(
                f"Without inertia interactions should hold body {name}, and they act at "
                f"{np.count_nonzero(acts[nodes])} node(s) of it, which leaves it free to turn: "
                "let it share a facet with its neighbours or take inertia=True."
            )
        anchors = here[order[:number]]
        chosen.append(dofs[anchors])
        rows.append(np.repeat(dofs, number))
        columns.append(np.tile(np.arange(count, count + number), len(dofs)))
        values.append(scipy.linalg.solve(modes[anchors].T, modes.T).T.ravel())
        count += number
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    motions = sp.coo_array(entries, shape=(layout.prescribed.size, count))
    return np.concatenate(chosen), sp.csr_array(motions)
