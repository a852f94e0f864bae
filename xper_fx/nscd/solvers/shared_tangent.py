# SPDX-License-Identifier: LGPL-3.0-or-later
"""The linearised interaction problem of points that several ranks share.

The equations are those of `tangent.py`,

    (w^-1 + H K H^T) dv = H g,    dr = g - K H^T dv,

with dv over the bodies of all ranks. Each rank takes D, K and g of its own points and gives the
blocks w^-1 of its own bodies and the springs of its points; the matrix, its preconditioner and the
iterations are those of `parallel/petsc_newton.py`, which the halo hands in.
"""

from __future__ import annotations

import numpy as np

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.points import InteractionPoints
from xper_fx.nscd.solvers.tangent import DIRECT, MANY, MOSTLY, PointTangents, inverted_bodies


class SharedProblem:
    """The linearised problem of a scene; what does not depend on the state is kept.

    Everything is done by all ranks together.

    Args:
        interactions: this rank's points, with a halo.

    Attributes:
        regular, tangents: as those of `tangent.LinearisedProblem`.
        solvable: whether the preconditioner could be made for the last state.
    """

    def __init__(self, interactions: Interactions):
        self._interactions = interactions
        self.tangents = PointTangents(interactions)
        self._system = interactions.halo.linear_system(interactions)
        self._right = np.empty(interactions.inverse.num_slots * interactions.dim)
        self._dofs = [dofs_of_points(g.points, interactions.dim) for g in interactions.groups]
        self.solvable = self._direct = False
        self.renew()

    def renew(self) -> None:
        """Take the present values of w."""
        interactions = self._interactions
        inverse = interactions.own_inverse
        blocks, _, regular = inverted_bodies(inverse)
        self.regular = interactions.everywhere(regular)
        if self.regular:
            self._system.take_bodies(_by_size(inverse, blocks))
        self.tangents.forget()

    def begin(self) -> None:
        """Solve the next problems without a factorisation of the whole again."""
        self._direct = False

    def linearise(self, velocity: np.ndarray) -> None:
        """Take D, K and g at a state, v_free + w H r, shape (num_slots * dim,)."""
        interactions, tangents = self._interactions, self.tangents
        tangents.take(interactions, velocity)
        springs = [
            (dofs, springs_of_points(g.points, own.stiffness))
            for g, dofs, own in zip(interactions.groups, self._dofs, tangents.groups, strict=True)
        ]
        held = tangents.held(interactions) > MOSTLY
        kind = "whole" if self._direct else "clusters and all as one" if held else "clusters"
        self.solvable = self._system.take_springs(springs, kind)

    def solve(self, step: np.ndarray, bound: float, max_iterations: int):
        """The step of the impulses that the linearised laws ask for.

        Arguments and results are those of `tangent.LinearisedProblem.solve`.
        """
        interactions = self._interactions
        self.tangents.spread_source(interactions, self._right)
        iterations = self._system.solve(self._right, step, bound, max_iterations)
        if iterations >= MANY and self._system.size <= DIRECT[interactions.dim]:
            self._direct = True
        return self.tangents.changes(interactions, step), iterations


def dofs_of_points(points: InteractionPoints, dim: int) -> np.ndarray:
    """Degrees of freedom of each point, shape (num_points, m): those of its nodes, 2 k dim, and of
    the rotations of both sides where some have lever arms, 2 dim."""
    n, sides, k = points.nodes.shape
    nodes = points.nodes.reshape(n, sides * k)
    if points.lever_arms is not None:
        nodes = np.concatenate([nodes, points.rotation_nodes()], axis=1)
    return (nodes[:, :, None] * dim + np.arange(dim)).reshape(n, nodes.shape[1] * dim)


def springs_of_points(points: InteractionPoints, stiffness: np.ndarray) -> np.ndarray:
    """H K H^T of each point on `dofs_of_points`, shape (n, m, m).

    Args:
        points: n points.
        stiffness: K of each in its frame, shape (n, components, components), N s per m/s.
    """
    components = stiffness.shape[1]
    n, sides, k = points.nodes.shape
    dim = points.dim
    frame = points.frame[:, :components]
    world = frame.transpose(0, 2, 1) @ stiffness @ frame
    signs = np.array([1.0, -1.0])
    signed = (points.weights * signs[:, None]).reshape(n, sides * k)
    if points.lever_arms is None:
        pairs = signed[:, :, None] * signed[:, None, :]
        values = pairs[:, :, None, :, None] * world[:, None, :, None, :]
        return values.reshape(n, sides * k * dim, sides * k * dim)
    moved = np.einsum("pa,xy->pxay", signed, np.eye(dim))
    turned = np.einsum("s,psxy->pxsy", signs, _by_rotation(points.lever_arms))
    relative = np.concatenate([moved, turned], axis=2).reshape(n, dim, (sides * k + sides) * dim)
    return relative.transpose(0, 2, 1) @ world @ relative


def _by_rotation(arms: np.ndarray) -> np.ndarray:
    """A with A w = w x arm, shape (..., dim, dim); in 2D the spin is the first component of w."""
    dim = arms.shape[-1]
    a = np.zeros((*arms.shape, dim))
    if dim == 2:
        a[..., 0, 0], a[..., 1, 0] = -arms[..., 1], arms[..., 0]
        return a
    for x in range(3):
        y, z = (x + 1) % 3, (x + 2) % 3
        a[..., x, y], a[..., x, z] = arms[..., z], -arms[..., y]
    return a


def _by_size(inverse: BodyInverse, data: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Degrees of freedom and entries of the blocks of each size but the ground's."""
    sizes = np.diff(inverse.node_offsets)[:-1] * inverse.dim
    firsts = inverse.node_offsets[:-2] * inverse.dim
    found = []
    for size in np.unique(sizes).tolist():
        here = np.flatnonzero(sizes == size)
        entries = inverse.data_offsets[here][:, None] + np.arange(size * size)
        dofs = firsts[here][:, None] + np.arange(size)
        found.append((dofs, data[entries].reshape(-1, size, size)))
    return found
