# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Conjugate gradients on the impulses of perfect bonds: a dual domain decomposition.

Where every point is a perfect bond the interaction problem is linear,

    W r = d,    W = H^T w H,    d = -jump0 / h - H^T v_free,

the dual Schur complement problem of subdomains tied by multipliers (FETI; Farhat and Roux 1991).
Several facets tie the same two nodes, and more ties than needed meet where several subdomains do:
W is singular, d in its range, r not unique, the velocities are; conjugate gradients need no more.

**Preconditioner.** S = w^-1 on the interacting dofs of a body is its Dirichlet Schur complement, and

    M = A^T S A,    A p = argmin |H^T y - p|^2 + (a little) y . D y,    D = diag S:

jumps are shared among the nodes that meet by how much each yields, whatever ties they have and
however redundant, pairs of nodes or weighted ones. For pairs this is the scaling of Rixen and Farhat
(1999) in the algebraic form of Klawonn and Widlund (2001). The condition grows with
(1 + log(H/h))^2, H over h the elements along a subdomain's side, and not with their number, if

**a coarse space** makes subdomains that move as a whole hear of each other at once.

- With mass (Farhat, Chen and Mandel 1995): the softest motions R of w in each body, as many as it has
  rigid ones, which they are where steps are long. Iterates keep G^T (d - W r) = 0, G = H^T R, by
  search directions p with G^T W p = 0. At short steps they change little, and cost little.
- Without (Farhat and Roux 1991): the velocities a of the anchors of bodies that interactions alone hold
  (`bulk/anchors.py`) are unknowns, v = v_free + w0 H r + R a with w0 and v_free for anchors that are
  held,

      W0 r + G a = d0,    G^T r = -R^T f,    G = H^T R.

  Search directions keep G^T p = 0.

Directions are kept and made conjugate to all before: the few there are lose conjugacy otherwise.

**When it stops.** g . M g, g = d - W r, is the error of r in the energy of W within a small factor,
as M W is near one; relative to that of r it is what `tolerance` bounds. Velocities that rounding
alone keeps apart have arrived.
"""

from __future__ import annotations

from collections.abc import Callable
from weakref import WeakKeyDictionary

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from xper_fx.nscd.interactions import Anchors, Interactions
from xper_fx.nscd.inverse import BodyInverse
from xper_fx.nscd.laws.perfect_bond import PerfectBond
from xper_fx.nscd.nlgs import SolveReport

# Weight of D beside the jumps, and the least ratio of stiffnesses that it tells apart.
_LITTLE, _LEAST_RATIO = 1e-3, 1e-6
# Shift that makes a coarse matrix regular where a scene moves as a whole, beside its diagonal.
_SHIFT = 1e-13
# Rounding of the velocities of a node that several impulses act on.
_ROUNDING = 16.0 * np.finfo(float).eps
# Times that the residual is computed anew, from the impulses, before rounding has the last word.
_RENEWALS = 3


class _Blocks:
    """w body by body, and what can be made of it."""

    def __init__(self, inverse: BodyInverse):
        self.dim, self.shape = inverse.dim, (inverse.num_slots, inverse.dim)
        first = inverse.node_offsets * inverse.dim
        self.spans = list(zip(first[:-1], first[1:], strict=True))
        size = inverse.uniform_size
        if size:
            self.w = [inverse.data.reshape(-1, size, size)]
            self.spans = [(0, first[-1])]
        else:
            self.w = [
                inverse.data[a:b].reshape(1, last - first, -1)
                for (first, last), a, b in zip(
                    self.spans, inverse.data_offsets[:-1], inverse.data_offsets[1:], strict=True
                )
            ]
        diagonal = np.concatenate([np.diagonal(w, axis1=1, axis2=2).ravel() for w in self.w])
        self.free = diagonal > 0.0

    def times(self, blocks: list[np.ndarray], x: np.ndarray) -> np.ndarray:
        """Blocks times a vector, shape (num_slots * dim,)."""
        out = np.empty_like(x)
        for (first, last), block in zip(self.spans, blocks, strict=True):
            part = x[first:last].reshape(len(block), -1, 1)
            out[first:last] = np.matmul(block, part).ravel()
        return out

    def inverted(self) -> list[np.ndarray]:
        """S, zero where a motion is prescribed."""
        schur = []
        for (first, last), w in zip(self.spans, self.w, strict=True):
            fixed = (~self.free[first:last]).astype(float).reshape(len(w), -1)
            s = w.copy()
            axes = np.arange(s.shape[1])
            s[:, axes, axes] += fixed
            s = np.linalg.inv(s)
            s[:, axes, axes] -= fixed
            schur.append(0.5 * (s + s.transpose(0, 2, 1)))
        return schur

    def softest(self) -> sp.csc_array:
        """Motions to which each body yields most, as many as it has rigid ones, by columns."""
        most = self.dim * (self.dim + 1) // 2
        rows, columns, values, count = [], [], [], 0
        for (first, _), w in zip(self.spans, self.w, strict=True):
            size = w.shape[1]
            for number, block in enumerate(w):
                start = first + number * size
                kept = min(most, int(np.count_nonzero(self.free[start : start + size])))
                if not kept:
                    continue
                _, modes = scipy.linalg.eigh(block, subset_by_index=[size - kept, size - 1])
                rows.append(np.repeat(np.arange(start, start + size), kept))
                columns.append(np.tile(np.arange(count, count + kept), size))
                values.append(modes.ravel())
                count += kept
        entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
        return sp.csc_array(sp.coo_array(entries, shape=(self.free.size, count)))


class BondedSystem:
    """W, its preconditioner and the basis of its coarse space, in the axes of space, for one w.

    Args:
        interactions: points, perfect bonds all.
        coarse_space: what the basis is for.

    Attributes:
        jumps: H^T, shape (num_points * dim, num_slots * dim).
        w: blocks of w, or of w0 where there are anchors.
        motions: R of the module docstring, by columns.
        stiffness: D, shape (num_slots * dim,), N s per m/s.
    """

    def __init__(self, interactions: Interactions, coarse_space: type[NoCoarseSpace]):
        self.coarse_space = coarse_space
        self.inverse = interactions.inverse
        self.points = interactions.groups[0].points
        self.dim = interactions.dim
        self.blocks = _Blocks(self.inverse)
        self.jumps = _jumps(self.points, self.inverse.num_slots, self.dim)
        self.schur = self.blocks.inverted()
        self.stiffness = np.concatenate(
            [np.diagonal(s, axis1=1, axis2=2).ravel() for s in self.schur]
        )
        self._transposed = sp.csr_array(self.jumps.T)
        self._share = self._factored_sharing()
        self.w, self.motions = coarse_space.basis(self.blocks, interactions.anchors)

    def _factored_sharing(self):
        """Factors of H H^T + a little D on the dofs that are free."""
        free = self.blocks.free
        normal = sp.csr_array(self._transposed @ self.jumps)[free][:, free]
        _, cluster = connected_components(normal, directed=False)
        largest = np.zeros(cluster.max(initial=0) + 1)
        np.maximum.at(largest, cluster, self.stiffness[free])
        ratio = np.maximum(self.stiffness[free] / largest[cluster], _LEAST_RATIO)
        return splu(
            sp.csc_array(normal + sp.diags_array(_LITTLE * ratio)),
            permc_spec="MMD_AT_PLUS_A",
            options={"SymmetricMode": True, "DiagPivotThresh": 0.0},
        )

    def pushed(self, impulse: np.ndarray) -> np.ndarray:
        """w H r, or w0 H r, shape (num_slots * dim,)."""
        return self.blocks.times(self.w, self._transposed @ impulse)

    def precondition(self, jump: np.ndarray) -> np.ndarray:
        """M times a jump of velocities: impulses."""
        free = self.blocks.free
        moved = np.zeros(free.size)
        moved[free] = self._share.solve((self._transposed @ jump)[free])
        moved = self.blocks.times(self.schur, moved)
        moved[free] = self._share.solve(moved[free])
        moved[~free] = 0.0
        return self.jumps @ moved


def _jumps(points, num_slots: int, dim: int) -> sp.csr_array:
    """H^T in the axes of space, shape (num_points * dim, num_slots * dim)."""
    count, _, k = points.nodes.shape
    signed = points.weights * np.array([1.0, -1.0])[:, None]
    rows = np.repeat(np.arange(count), 2 * k)
    scalar = sp.coo_array((signed.ravel(), (rows, points.nodes.ravel())), shape=(count, num_slots))
    return sp.csr_array(sp.kron(scalar, sp.eye_array(dim)))


class NoCoarseSpace:
    """Conjugate gradients as they are: iterations grow with the number of subdomains."""

    size = 0

    def __init__(self, system: BondedSystem, anchors: Anchors | None):
        pass

    @staticmethod
    def basis(
        blocks: _Blocks, anchors: Anchors | None
    ) -> tuple[list[np.ndarray], sp.csc_array | None]:
        """Blocks of w to iterate with, and the motions of the coarse space."""
        return blocks.w, None

    def hold(self, free: np.ndarray) -> np.ndarray:
        """Free velocities from which impulses and motions are counted."""
        return free

    def start(self, impulse: np.ndarray, missing: np.ndarray) -> np.ndarray:
        """Change of the impulses that makes them admissible."""
        return np.zeros_like(impulse)

    def left(self, missing: np.ndarray) -> np.ndarray:
        """Jumps that impulses must still close."""
        return missing

    def admissible(self, impulse: np.ndarray) -> np.ndarray:
        """Search direction made of preconditioned jumps."""
        return impulse

    def moved(self, missing: np.ndarray) -> np.ndarray | float:
        """Velocities that close the last jumps; those of the anchors are set."""
        return 0.0


class SoftestMotions(NoCoarseSpace):
    """G^T (d - W r) = 0 for the softest motions of each body."""

    @staticmethod
    def basis(blocks, anchors):
        """See `NoCoarseSpace`."""
        return blocks.w, blocks.softest()

    def __init__(self, system: BondedSystem, anchors: Anchors | None):
        self.size = system.motions.shape[1]
        self._jumps = sp.csr_array(system.jumps @ system.motions)
        pushed = [system.pushed(column) for column in self._jumps.T.toarray()]
        self._pushed = sp.csr_array(system.jumps @ sp.csc_array(np.array(pushed).T))
        self._solve = _factored(self._jumps.T @ self._pushed)

    def start(self, impulse, missing):
        """See `NoCoarseSpace`."""
        return self._jumps @ self._solve(self._jumps.T @ missing)

    def left(self, missing):
        """See `NoCoarseSpace`: jumps but for those that `start` closes."""
        return missing - self._pushed @ self._solve(self._jumps.T @ missing)

    def admissible(self, impulse):
        """See `NoCoarseSpace`: p - G (G^T W G)^-1 G^T W p."""
        return impulse - self._jumps @ self._solve(self._pushed.T @ impulse)


class AnchoredMotions(NoCoarseSpace):
    """G^T r = -R^T f, the equilibrium of bodies that interactions alone hold."""

    @staticmethod
    def basis(blocks, anchors):
        """See `NoCoarseSpace`."""
        return _Blocks(anchors.held).w, anchors.motions

    def __init__(self, system: BondedSystem, anchors: Anchors):
        self._anchors, self._motions = anchors, system.motions
        self.size = self._motions.shape[1]
        self._jumps = sp.csr_array(system.jumps @ self._motions)
        self._solve = _factored(self._jumps.T @ self._jumps)

    def hold(self, free):
        """See `NoCoarseSpace`."""
        return free - self._motions @ self._anchors.on_springs

    def start(self, impulse, missing):
        """See `NoCoarseSpace`."""
        return -self._jumps @ self._solve(self._anchors.load + self._jumps.T @ impulse)

    def left(self, missing):
        """See `NoCoarseSpace`: jumps but for those that bodies moving as a whole close."""
        return missing - self._jumps @ self._solve(self._jumps.T @ missing)

    def admissible(self, impulse):
        """See `NoCoarseSpace`."""
        return self.left(impulse)

    def moved(self, missing):
        """See `NoCoarseSpace`."""
        self._anchors.velocity[:] = self._solve(self._jumps.T @ missing)
        return self._motions @ self._anchors.velocity


def _factored(matrix: sp.sparray) -> Callable[[np.ndarray], np.ndarray]:
    """Solver of a symmetric matrix that may be singular where the right side allows it."""
    diagonal = matrix.diagonal()
    shift = _SHIFT * np.maximum(diagonal, diagonal.max(initial=1.0) * _SHIFT)
    factors = splu(sp.csc_array(matrix + sp.diags_array(shift)))

    def solve(right):
        solution = factors.solve(right)
        return solution + factors.solve(right - matrix @ solution)

    return solve


_systems: WeakKeyDictionary[Interactions, BondedSystem] = WeakKeyDictionary()


def kept(interactions: Interactions) -> BondedSystem | None:
    """What is held for a scene, if anything."""
    return _systems.get(interactions)


def all_bonded(interactions: Interactions) -> bool:
    """Whether every point is a perfect bond."""
    groups = interactions.groups
    return len(groups) == 1 and all(isinstance(law, PerfectBond) for law in interactions.laws)


def solve(
    interactions: Interactions,
    velocity: np.ndarray,
    *,
    tolerance: float = 1e-4,
    max_sweeps: int = 10_000,
    relaxation: float = 1.0,
    num_threads: int | None = None,
    coarse_space: type[NoCoarseSpace] | None = None,
) -> SolveReport:
    """Find the impulses of the step; `velocity` becomes the end velocity.

    Args:
        interactions: points after `begin_step`, all perfect bonds, whose impulses are the first
            guess.
        velocity: shape (num_slots * dim,), the free velocity on entry, v_free + w H r on return.
        tolerance: bound on the estimated relative error of the impulses, in the energy of W.
        max_sweeps: iterations after which to give up.
        relaxation: of no use here.
        num_threads: of no use here; products with w are the BLAS's.
        coarse_space: what subdomains hear of each other at once; the one that the scene calls for
            if not given.

    Returns:
        The report, whose sweeps are iterations; not converged is reported, not raised.

    Raises:
        ValueError: a point is no perfect bond.
    """
    if not len(interactions):
        return SolveReport(True, 1, 0.0, 0.0, "subdomains")
    if not all_bonded(interactions):
        names = ", ".join(group.kernels.name for group in interactions.groups)
        raise ValueError(
            f'solver="subdomains" needs PerfectBond at every point, and there is: {names}. Take '
            '"auto", "newton" or "nlgs", which any law may be mixed with.'
        )
    anchors = interactions.anchors
    if coarse_space is None:
        coarse_space = SoftestMotions if anchors is None else AnchoredMotions
    system = _systems.get(interactions)
    if not (
        system
        and system.inverse is interactions.inverse
        and system.coarse_space is coarse_space
    ):
        system = _systems[interactions] = BondedSystem(interactions, coarse_space)
    return _Iteration(interactions, system, velocity, coarse_space(system, anchors)).run(
        tolerance, max_sweeps
    )


class _Iteration:
    """Projected conjugate gradients for one free velocity."""

    def __init__(self, interactions, system: BondedSystem, velocity: np.ndarray, coarse):
        self._system, self._coarse, self._velocity = system, coarse, velocity
        self._interactions, self._group = interactions, interactions.groups[0]
        self._free = coarse.hold(velocity.copy())
        self._wanted = self._to_space(-self._group.jump / interactions.step_size)
        self._directions: list[np.ndarray] = []
        self._responses: list[np.ndarray] = []

    def _to_space(self, local: np.ndarray) -> np.ndarray:
        return np.einsum("pij,pi->pj", self._group.points.frame, local).ravel()

    def _missing(self, impulse: np.ndarray) -> np.ndarray:
        """d - W r; sets the velocities without what anchors give."""
        self._velocity[:] = self._free + self._system.pushed(impulse)
        return self._wanted - self._system.jumps @ self._velocity

    def run(self, tolerance: float, max_iterations: int) -> SolveReport:
        """Iterate until the error is within the tolerance."""
        system, coarse, group = self._system, self._coarse, self._group
        scale = self._scale(tolerance)
        impulse = self._to_space(group.impulse)
        count, traction, converged, error = 0, 0.0, False, np.inf
        for _ in range(_RENEWALS):
            impulse += coarse.start(impulse, self._missing(impulse))
            left = coarse.left(self._missing(impulse))
            error, direction = self._error(left, scale)
            converged = error <= tolerance
            if converged or count >= max_iterations or not np.isfinite(error):
                break
            while error > tolerance and count < max_iterations:
                change, left = self._advance(direction, left)
                impulse += change
                count += 1
                error, direction = self._error(left, scale)
                if not np.isfinite(error):
                    break
            traction = self._traction(change)
        converged = converged or error <= tolerance
        self._velocity += coarse.moved(self._missing(impulse))
        local = np.einsum("pij,pj->pi", group.points.frame, impulse.reshape(-1, system.dim))
        group.impulse[:] = local
        reason = f"{count} iterations, {coarse.size} coarse unknowns"
        return SolveReport(bool(converged), max(count, 1), error, traction, "subdomains", reason)

    def _scale(self, tolerance: float) -> float:
        """Energy of the impulses looked for, or what rounding is worth at the tolerance."""
        nothing = np.zeros_like(self._wanted)
        nothing += self._coarse.start(nothing, nothing)
        left = self._coarse.left(self._missing(nothing))
        speed = float(np.abs(self._velocity).max(initial=0.0))
        rounding = _ROUNDING * speed * np.sqrt(self._system.stiffness.sum())
        energy, _ = self._energy(left)
        return max(energy, rounding / tolerance)

    def _energy(self, left: np.ndarray) -> tuple[float, np.ndarray]:
        direction = self._coarse.admissible(self._system.precondition(left))
        return float(np.sqrt(max(left @ direction, 0.0))), direction

    def _error(self, left: np.ndarray, scale: float) -> tuple[float, np.ndarray]:
        energy, direction = self._energy(left)
        return energy / scale if scale > 0.0 else energy, direction

    def _advance(self, direction: np.ndarray, left: np.ndarray):
        """One step of conjugate gradients: change of the impulses, jumps left after it."""
        for old, response in zip(self._directions, self._responses, strict=True):
            direction -= (direction @ response) * old
        response = self._system.jumps @ self._system.pushed(direction)
        length = np.sqrt(direction @ response)
        direction, response = direction / length, response / length
        self._directions.append(direction)
        self._responses.append(response)
        factor = direction @ left
        return factor * direction, self._coarse.left(left - factor * response)

    def _traction(self, change: np.ndarray) -> float:
        size = np.linalg.norm(change.reshape(-1, self._system.dim), axis=1)
        return float((size / self._group.points.area).max() / self._interactions.step_size)
