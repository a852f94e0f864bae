# SPDX-License-Identifier: LGPL-3.0-or-later
"""The linearised interaction problem of points that several ranks share.

The equations are those of `tangent.py`,

    (w^-1 + H K H^T) dv = H g,    dr = g - K H^T dv,

with dv over the bodies of all ranks. Each rank takes D, K and g of its own points, and its part of
all vectors is that of its own bodies. Clusters of facing nodes that are cut between ranks
(`parallel/cut_clusters.py`) are solved first, each alone, by every rank that has nodes in them,
from what the residual is at all of them. The clusters that are a rank's alone follow one after the
other, as on one rank: w^-1 couples nodes of one body, so that nothing of another rank is missed,
neither there nor in the product with the matrix that the same pass gives. An iteration thus has one
exchange with neighbours and three sums: of scalar products, of a norm, and of the forces on cut
clusters moving as one.
"""

from __future__ import annotations

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.nscd.points import InteractionPoints
from xper_fx.nscd.solvers.clusters import Clusters
from xper_fx.nscd.solvers.clusters_as_one import ClustersAsOne, held_directions
from xper_fx.nscd.solvers.tangent import DIRECT, LinearisedProblem, portions


class SharedProblem(LinearisedProblem):
    """The linearised problem of all ranks; everything is done by all of them together.

    Args:
        interactions: this rank's points, with a halo.

    Attributes:
        regular, tangents, held: as those of `LinearisedProblem`.
        solvable: whether the preconditioner could be made for the last state.
    """

    def _find_clusters(self) -> Clusters:
        interactions, dim = self._interactions, self._interactions.dim
        halo, own = interactions.halo, interactions.own_inverse
        self._take_bodies(len(own.node_offsets) - 2)
        self._small = interactions.total(self._num_dofs) <= DIRECT[dim]
        found = self._cut = halo.cut_clusters(interactions)
        clusters = self._clusters = found.clusters
        self._portions = portions(interactions, clusters, found.cut, found.own, self._body)
        self._cut_portions = portions(interactions, clusters, 0, found.cut, self._body)
        ends = slice(found.cut, found.own + 1)
        self._inside = clusters._replace(
            offsets=clusters.offsets[ends], block_offsets=clusters.block_offsets[ends]
        )
        nodes = clusters.nodes[: clusters.offsets[found.cut]]
        here = np.flatnonzero(nodes < own.num_nodes)
        dims = np.arange(dim)
        self._known = (here[:, None] * dim + dims).ravel()
        self._known_dofs = (nodes[here, None] * dim + dims).ravel()
        self._moments = np.zeros(len(nodes) * dim)
        self._at_slots = np.zeros((2, interactions.inverse.num_slots * dim))
        return clusters

    def renew(self) -> None:
        """Take the present values of w."""
        super().renew()
        interactions, cut = self._interactions, self._cut
        self.regular = interactions.everywhere(self.regular)
        # what is prescribed at slots of cut clusters that are of no body here
        fixed = np.zeros(len(cut.clusters.cluster) * interactions.dim, np.bool_)
        fixed[: len(self._fixed)] = self._fixed
        at_cut = cut.clusters.nodes[: cut.clusters.offsets[cut.cut]]
        fixed.reshape(-1, interactions.dim)[at_cut] = self._told(self._fixed).reshape(
            -1, interactions.dim
        )
        self._fixed = fixed

    def _told(self, values: np.ndarray) -> np.ndarray:
        """Values of this rank's slots, and of others', at the nodes of cut clusters."""
        self._moments[self._known] = values[self._known_dofs]
        self._cut.nodes.forward(self._moments)
        return self._moments

    def linearise(self, velocity: np.ndarray) -> None:
        """Take D, K and g at a state; clusters whose springs are others are inverted again."""
        interactions, tangents, cut = self._interactions, self.tangents, self._cut
        clusters = cut.clusters
        tangents.take(interactions, velocity)
        marked = np.full(len(clusters.offsets) - 1, self._fresh)
        for g, own in zip(interactions.groups, tangents.groups, strict=True):
            self._springs(g)[2](g.couplings, own.changed, clusters.cluster, marked)
        any_cut, any_own = interactions.largest(
            np.array([marked[: cut.cut].any(), marked.any()], float)
        )
        if self._direct:
            if any_own:
                self._factor()
            return
        self.solvable = True
        if any_cut:
            marked[: cut.cut] = True
            for portion in self._cut_portions:
                self._add_up(portion, marked)
            blocks = self._blocks[: clusters.block_offsets[cut.cut]]
            cut.blocks.add_back(blocks)
            cut.blocks.forward(blocks)
            self.solvable = all(self._invert(portion, marked) for portion in self._cut_portions)
        if any_own:
            regular = self.solvable
            self._renew_blocks(marked)
            self.solvable = interactions.everywhere(self.solvable and regular)
        self._fresh = not self.solvable
        self.held = tangents.held(interactions)

    def solve(self, step: np.ndarray, bound: float, max_iterations: int):
        """The step of the impulses that the linearised laws ask for.

        Arguments and results are those of `tangent.LinearisedProblem.solve`.
        """
        iterations = self._improved(step[: self._num_dofs], bound, max_iterations)
        self._interactions.refresh_ghosts(step)
        return self.tangents.changes(self._interactions, step), iterations

    def _source(self, total: np.ndarray) -> None:
        _, forces = self._at_slots
        self.tangents.spread_source(self._interactions, forces)
        self._interactions.halo.everywhere.add_back(forces)
        total[:] = forces[: len(total)]
        self.hold(total)

    def _apply(self, x: np.ndarray, y: np.ndarray) -> None:
        motion, forces = self._at_slots
        motion[: len(x)] = x
        self._interactions.refresh_ghosts(motion)
        forces[len(x) :] = 0.0
        self.momentum(x, forces[: len(x)])
        self._pull(motion, forces)
        self._interactions.halo.everywhere.add_back(forces)
        y[:] = forces[: len(y)]
        self.hold(y)

    def _factor(self) -> None:
        interactions = self._interactions
        if self._factors is None:
            self._factors = interactions.halo.whole_matrix(interactions, self._fixed)
        elements = _by_size(self._interactions.own_inverse, self._matrix)
        for g, own in zip(interactions.groups, self.tangents.groups, strict=True):
            dofs = dofs_of_points(g.points, interactions.dim)
            elements.append((dofs, springs_of_points(g.points, own.stiffness)))
        self.solvable = self._factors.factor(elements)
        self._fresh = not self.solvable

    def _first(self, r: np.ndarray, z: np.ndarray, y: np.ndarray) -> bool:
        if self._direct:
            self._factors.solve(r, z)
            return False
        vectors = r, z, y, self._told(r), self._beside[0]
        _cut_clusters(self._cut.cut, self._clusters, self._couplings, self._blocks, vectors)
        self._sweep(self._inside, r, z, y)
        return self._within

    def _clusters_as_one(self) -> ClustersAsOne:
        interactions, cut, slots = self._interactions, self._cut, len(self._body)
        cluster = cut.clusters.cluster
        held = held_directions(cluster, cut.opened, self._fixed)
        has_own = np.zeros(len(held), np.bool_)
        has_own[cluster[:slots]] = True
        held[~has_own] = True
        # ghosts move nothing here
        cluster = np.where(np.arange(len(cluster)) < slots, cluster, len(held) - 1)
        return ClustersAsOne(
            cluster[: interactions.inverse.num_slots], held, interactions.inverse, self._matrix,
            cut.border,
        )  # fmt: skip


@njit(fastmath={"contract"}, nogil=True, **LEAN_ENTRY)
def _cut_clusters(count, clusters, couplings, blocks, vectors):
    """z = D^-1 r over the first clusters, and y = A z there, of which `couplings` are this rank's.

    Vectors are r, z, y, what r is at all nodes of these clusters, and room for a cluster.
    """
    r, z, y, moments, found = vectors
    dim, offsets = couplings.blocks.shape[1], clusters.offsets
    own = len(r) // dim
    for a in range(count):
        first, last = offsets[a], offsets[a + 1]
        n, line = (last - first) * dim, clusters.block_offsets[a]
        found[:n] = 0.0
        for j in range(n):
            factor = moments[first * dim + j]
            for i in range(n):
                found[i] += factor * blocks[line + j * n + i]
        for k in range(last - first):
            node = clusters.nodes[first + k]
            if node < own:
                for x in range(dim):
                    z[node * dim + x], y[node * dim + x] = found[k * dim + x], r[node * dim + x]
    for k in range(offsets[count]):
        i = clusters.nodes[k] * dim
        for e in range(couplings.offsets[k], couplings.offsets[k + 1]):
            j = couplings.before[e]
            for x in range(dim):
                for d in range(dim):
                    y[i + x] += couplings.blocks[e, x, d] * z[j + d]
                    y[j + d] += couplings.blocks[e, x, d] * z[i + x]


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
