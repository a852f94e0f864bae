# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Springs that hold bodies which interactions alone hold, for a run without inertia.

The stiffness K of a body that floats is singular. With a unit vector for each of its free rigid
motions R, the columns of C, and C^T R regular, Kt = K + C rho C^T is not, and

    Kt^-1 C rho = R (C^T R)^-1:       a force on the springs moves the body as a whole.

Newton's step with Kt, residual with K, is that of springs which let go after each iteration: where
it comes to rest they bear nothing, whatever rho and whatever the laws of the interactions (the
proximal point algorithm; Rockafellar 1976). A solver that knows of the springs takes their forces
for unknowns instead, which the motions v of the anchored dofs since the last iterate determine,
C^T v = s / rho: with the equation above this is R^T (f + H r) = 0, the equilibrium of the body, and
s its rigid motion (Farhat and Roux 1991). Both leave K unregularised.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from xper_fx.bulk.layout import BodyLayout
from xper_fx.bulk.rigid_motions import free_rigid_modes

# rho beside the stiffness of the dof: soft beside what holds a body in its scene, so that few
# iterations are needed, and not so soft that rounding of its motion as a whole hides its strain.
_SOFTNESS = 1e-4
# Motion of bodies on the springs, beside the displacements, that rounding of their forces gives.
ROUNDING = 1e-12 / _SOFTNESS
# What a motion of unit mean square leaves on the dofs of a body that interact, below which it is
# not held: a body on a hinge.
_HINGE = 1e-8


def anchored_dofs(layout: BodyLayout, x: np.ndarray, interacting: np.ndarray) -> np.ndarray:
    """Dofs of interacting nodes that hold every body, as many as it has free rigid motions.

    Args:
        layout: the bodies.
        x: positions of the nodes, shape (num_nodes, dim), m.
        interacting: nodes at which interactions act.

    Returns:
        Shape (n,), dofs, body by body.

    Raises:
        ValueError: the interactions of a body leave it free to turn.
    """
    acts = np.zeros(len(layout.nodes), bool)
    acts[interacting] = True
    chosen = []
    for body, (first, last) in enumerate(zip(layout.offsets[:-1], layout.offsets[1:], strict=True)):
        nodes = layout.nodes[first:last]
        held = layout.prescribed[layout.dofs(nodes)].reshape(-1, layout.dim)
        modes = free_rigid_modes(x[nodes], held)
        if modes.shape[1] == 0:
            continue
        here = np.repeat(acts[nodes], layout.dim)
        _, triangle, order = scipy.linalg.qr(modes[here].T, mode="economic", pivoting=True)
        pivots = np.abs(np.diagonal(triangle))
        scale = 1.0 / np.sqrt(len(modes))
        if len(pivots) < modes.shape[1] or pivots.min() <= _HINGE * scale:
            raise ValueError(
                f"Without inertia interactions should hold body {body}, and they act at "
                f"{np.count_nonzero(acts[nodes])} node(s) of it, which leaves it free to turn: "
                "let it share a facet with its neighbours or take inertia=True."
            )
        chosen.append(layout.dofs(nodes)[here][order[: modes.shape[1]]])
    return np.concatenate(chosen) if chosen else np.zeros(0, np.int64)


def spring_stiffness(diagonal: np.ndarray) -> np.ndarray:
    """rho of springs on dofs whose entries on the diagonal of the stiffness are given."""
    return _SOFTNESS * diagonal
