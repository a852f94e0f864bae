# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interaction points: where two bodies face each other, and the map H.

At a point the candidate c and the antagonist a each interpolate their velocity from `k` nodes.
With the unit normal n from a to c and the local frame (n, t) or (n, t1, t2),

    U = frame (sum_j weights_cj v_cj - sum_j weights_aj v_aj) = H^T v,      p = H r,

so U_N > 0 opens and r_N > 0 pushes the sides apart (Perales et al. 2010, eqs 18-19).

Nodes are numbered in body order; the number after the last node is the *ground*, which does not
move: a point against it is contact with a fixed obstacle.

A rigid body has two nodes, one after the other: its translation v and its rotation omega (2D: omega
in the first component). A side on it names the first, and its *arm* a from the body's centre to the
point: the side moves with v + omega x a, and an impulse f on it turns the body by a x f.

In a periodic cell of rigid bodies that deforms, the nodes of the bodies hold the fluctuation of the
velocity, and dim more nodes hold the columns of dFbar/dt. With the *branch* b of a point, the
vector from the antagonist's centre to the candidate's in the axes of the reference cell,

    U = frame (... + dFbar/dt b),       and an impulse f on the candidate gives the cell f (x) b.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from xper_fx.nscd.lips import Lips


class Branches(NamedTuple):
    """How points read a periodic cell that deforms."""

    node: int  #: first of the dim nodes that hold the columns of dFbar/dt (1/s)
    vectors: np.ndarray  #: b, shape (num_points, dim), m


@dataclass(frozen=True)
class InteractionPoints:
    """Interaction points as flat arrays."""

    nodes: np.ndarray  #: shape (num_points, 2, k), int32; [:, 0] candidate, [:, 1] antagonist
    weights: np.ndarray  #: shape (num_points, 2, k), interpolation weights (sum 1 on each side)
    #: shape (num_points, dim, dim); rows n, t1 (, t2), right-handed and orthonormal. Where nothing
    #: acts along the tangent, (num_points, 1, dim), n alone.
    frame: np.ndarray
    #: shape (num_points,), m^2 (2D: m, per metre of depth); traction = impulse / (h area)
    area: np.ndarray
    gap: np.ndarray  #: shape (num_points,), normal distance at the start (m)
    #: shape (num_points, 2, dim), of sides on rigid bodies (m), zero on the others; None if no side
    #: is on a rigid body
    lever_arms: np.ndarray | None = None
    #: shape (num_points,), of a contact of round sides (m), 1/R the sum of 1/radius; None where no
    #: law resists rolling
    round_radius: np.ndarray | None = None
    #: facets on both sides, with which frames turn (`nscd/turning_frames.py`); None where frames
    #: stay what they are
    lips: Lips | None = None
    #: of points between rigid bodies of a periodic cell that deforms; None without one
    branches: Branches | None = None

    @property
    def dim(self) -> int:
        """Dimension of space."""
        return self.frame.shape[2]

    def __len__(self) -> int:
        return len(self.area)

    def take(self, indices: np.ndarray) -> InteractionPoints:
        """The points at `indices`, in that order."""
        return InteractionPoints(
            *(np.ascontiguousarray(a[indices]) for a in self._arrays()),
            lips=None if self.lips is None else self.lips.take(indices),
            branches=None
            if self.branches is None
            else self.branches._replace(vectors=self.branches.vectors[indices]),
        )

    def with_components(self, components: int) -> InteractionPoints:
        """The points with the first rows of their frames."""
        return replace(self, frame=np.ascontiguousarray(self.frame[:, :components]))

    def on(self, slots: np.ndarray) -> InteractionPoints:
        """The points on other nodes: those that `slots`, shape (n,), has in the places of these."""
        lips = None if self.lips is None else self.lips.on(slots)
        return replace(self, nodes=slots[self.nodes].astype(np.int32), lips=lips)

    def _arrays(self):
        given = (self.nodes, self.weights, self.frame, self.area, self.gap)
        extra = (self.lever_arms, self.round_radius)
        return (*given, *(a for a in extra if a is not None))

    def rotation_nodes(self) -> np.ndarray:
        """Node of each side's rotation, or the side's own where it has no arm; (num_points, 2)."""
        first = self.nodes[:, :, 0]
        return first if self.lever_arms is None else first + np.any(self.lever_arms != 0.0, axis=2)

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        lips = 0 if self.lips is None else self.lips.nbytes
        branches = 0 if self.branches is None else self.branches.vectors.nbytes
        return sum(a.nbytes for a in self._arrays()) + lips + branches

    def relative(self, nodal: np.ndarray) -> np.ndarray:
        """H^T v: relative vectors in the local frame.

        Args:
            nodal: shape (num_nodes + 1, dim), the ground's row last.

        Returns:
            Shape (num_points, rows of the frame), candidate minus antagonist.
        """
        sides = np.einsum("psk,pskd->psd", self.weights, nodal[self.nodes])
        if self.lever_arms is not None:
            sides += _cross(nodal[self.rotation_nodes()], self.lever_arms)
        apart = sides[:, 0] - sides[:, 1]
        if self.branches is not None:
            node, vectors = self.branches
            apart += vectors @ nodal[node : node + self.dim]
        return np.einsum("pij,pj->pi", self.frame, apart)

    def nodal(self, local: np.ndarray, num_nodes: int) -> np.ndarray:
        """H r: impulses on the nodes.

        Args:
            local: shape (num_points, rows of the frame), impulses in the local frame (N s).
            num_nodes: number of nodes, the ground not counted.

        Returns:
            Shape (num_nodes + 1, dim); the ground's row receives what it takes up.
        """
        world = np.einsum("pij,pi->pj", self.frame, local)
        pushed = np.stack([world, -world], axis=1)
        signed = self.weights[..., None] * pushed[:, :, None, :]
        flat = self.nodes.ravel()
        if self.lever_arms is not None:
            flat = np.concatenate([flat, self.rotation_nodes().ravel()])
            signed = np.concatenate(
                [
                    signed.reshape(-1, self.dim),
                    _moment(self.lever_arms, pushed).reshape(-1, self.dim),
                ]
            )
        total = np.stack(
            [
                np.bincount(flat, signed[..., d].ravel(), minlength=num_nodes + 1)
                for d in range(self.dim)
            ],
            axis=1,
        )
        if self.branches is not None:
            node, vectors = self.branches
            total[node : node + self.dim] += vectors.T @ world
        return total


def _cross(spin: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """omega x a; in 2D omega is the first component of `spin`."""
    if arm.shape[-1] == 3:
        return np.cross(spin, arm)
    return spin[..., :1] * np.stack([-arm[..., 1], arm[..., 0]], axis=-1)


def _moment(arm: np.ndarray, force: np.ndarray) -> np.ndarray:
    """a x f; in 2D its only component comes first."""
    if arm.shape[-1] == 3:
        return np.cross(arm, force)
    moment = arm[..., 0] * force[..., 1] - arm[..., 1] * force[..., 0]
    return np.stack([moment, np.zeros_like(moment)], axis=-1)


def frame_from_normal(normal: np.ndarray) -> np.ndarray:
    """Local frames (n, t) or (n, t1, t2), right-handed, from unit normals.

    Args:
        normal: shape (num_points, dim).

    Returns:
        Shape (num_points, dim, dim), rows n, t1 (, t2). In 2D t is n turned by +90 degrees; in 3D
        t1 is the axis least aligned with n, made orthogonal to it.
    """
    dim = normal.shape[1]
    if dim == 2:
        tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
        return np.ascontiguousarray(np.stack([normal, tangent], axis=1))
    axis = np.eye(3)[np.argmin(np.abs(normal), axis=1)]
    first = axis - np.sum(axis * normal, axis=1, keepdims=True) * normal
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.ascontiguousarray(np.stack([normal, first, np.cross(normal, first)], axis=1))
