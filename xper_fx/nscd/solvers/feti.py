# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Conjugate gradients on the impulses of perfect bonds: a dual domain decomposition.

Where every point is a perfect bond the interaction problem is linear,

    W r = d,    W = H^T w H,    d = -jump0 / h - H^T v_free,

the dual Schur complement problem of subdomains tied by multipliers (FETI; Farhat and Roux 1991).
Several facets tie the same two nodes, and more ties than needed meet where several subdomains do:
W is singular, d in its range, r not unique, the velocities are; conjugate gradients need no more.

**Preconditioner.** S = w^-1 on the interacting dofs of a body is its Dirichlet Schur complement;

    M = A^T S A,    A p = argmin |H^T y - p|^2 + (a little) y . D y,    D = diag S:

jumps are shared among the nodes that meet by how much each yields, whatever ties they have and
however redundant, pairs of nodes or weighted ones. For pairs this is the scaling of Rixen and
Farhat (1999) in the algebraic form of Klawonn and Widlund (2001). The condition grows with (1 +
log(H/h))^2, H over h the elements along a subdomain's side, and not with their number, if

**a coarse space** makes subdomains that move as a whole hear of each other at once (Farhat and Roux
1991; with mass Farhat, Chen and Mandel 1995). Here it holds the softest motions R of w in each
body, twice as many as it has rigid ones: these, which are the softest where steps are long, and
those near uniform strains, without which a few slow modes are left where subdomains are ragged or
held. With C = H^T R iterates keep C^T (d - W r) = 0 by search directions p with C^T W p = 0.

**Bodies without mass that interactions alone hold** (`bulk/floating_bodies.py`) have their rigid
motions R0
exactly: v = v_free + w0 H r + R0 a, with w0 and v_free for anchors that are held and G = H^T R0
among the columns of C, so that

    W0 r + G a = d,    G^T r = -R0^T f,

and iterates keep C^T (d - W0 r - G a) = 0 by directions with G^T p = 0 and C^T W0 p in the range of
C^T G.

Directions are kept and made conjugate to all before: the few there are lose conjugacy otherwise.

**When it stops.** g . M g, g = d - W r, is the error of r in the energy of W within a small factor,
as M W is near one; relative to that of r, but for what the coarse space gives at once, it is what
`tolerance` bounds. Velocities that rounding alone keeps apart have arrived.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.solvers.solver import SolveOptions, Solver, SolveReport
from xper_fx.support.checks import require_flag

# Weight of D beside the jumps, and the least ratio of stiffnesses that it tells apart.
_LITTLE, _LEAST_RATIO = 1e-3, 1e-6
# Shift that makes a coarse matrix regular where a scene moves as a whole, beside its diagonal.
_SHIFT = 1e-13
# Rounding of the velocities of a node that several impulses act on.
_ROUNDING = 16.0 * np.finfo(float).eps
# Times that the residual is computed anew, from the impulses, before rounding has the last word.
_RENEWALS = 4
# Error that is taken for rounding where it does not fall from a renewal to the next, at most.
_ROUGH = 1e-8


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
        self.free = self.diagonal_of(self.w) > 0.0

    @staticmethod
    def diagonal_of(blocks: list[np.ndarray]) -> np.ndarray:
        """Diagonal of blocks, shape (num_slots * dim,)."""
        return np.concatenate([np.diagonal(b, axis1=1, axis2=2).ravel() for b in blocks])

    def times(self, blocks: list[np.ndarray], x: np.ndarray) -> np.ndarray:
        """Blocks times a vector, shape (num_slots * dim,)."""
        out = np.empty_like(x)
        for (first, last), block in zip(self.spans, blocks, strict=True):
            part = x[first:last].reshape(len(block), -1, 1)
            out[first:last] = np.matmul(block, part).ravel()
        return out

    def times_columns(self, blocks: list[np.ndarray], columns: sp.csr_array) -> sp.csr_array:
        """Blocks times a sparse matrix of few columns a body."""
        rows, places, values = [], [], []
        for (first, _), stack in zip(self.spans, blocks, strict=True):
            size = stack.shape[1]
            for number, block in enumerate(stack):
                start = first + number * size
                part = columns[start : start + size]
                here, place = np.unique(part.indices, return_inverse=True)
                dense = np.zeros((size, len(here)))
                dense[np.repeat(np.arange(size), np.diff(part.indptr)), place] = part.data
                rows.append(np.repeat(np.arange(start, start + size), len(here)))
                places.append(np.tile(here, size))
                values.append((block @ dense).ravel())
        entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(places)))
        return sp.csr_array(sp.coo_array(entries, shape=columns.shape))

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

    def softest(self, known: np.ndarray) -> sp.csc_array:
        """Motions to which each body yields most but for the first of some, by columns.

        Args:
            known: how many of each body are left out, shape (num_blocks,).
        """
        most = self.dim * (self.dim + 1)
        rows, columns, values, count = [], [], [], 0
        known = iter(known)
        for (first, _), w in zip(self.spans, self.w, strict=True):
            size = w.shape[1]
            for number, block in enumerate(w):
                start = first + number * size
                free = int(np.count_nonzero(self.free[start : start + size]))
                left_out = next(known)
                kept = min(most, free // 2) - left_out
                if kept <= 0:
                    continue
                last = size - 1 - left_out
                _, modes = scipy.linalg.eigh(block, subset_by_index=[last - kept + 1, last])
                rows.append(np.repeat(np.arange(start, start + size), kept))
                columns.append(np.tile(np.arange(count, count + kept), size))
                values.append(modes.ravel())
                count += kept
        entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
        return sp.csc_array(sp.coo_array(entries, shape=(self.free.size, count)))


class BondedSystem:
    """W and its preconditioner, in the axes of space, for one w.

    Args:
        interactions: points, perfect bonds all.
        coarse_space: whether iterations have one, or bodies are on the springs of their anchors.

    Attributes:
        jumps: H^T, shape (num_points * dim, num_slots * dim).
        stiffness: D, shape (num_slots * dim,), N s per m/s.
        motions: R0, by columns; None without anchors or a coarse space.
        coarse: the coarse space, None without.
    """

    def __init__(self, interactions: Interactions, coarse_space: bool):
        self.inverse = interactions.inverse
        self.points = interactions.groups[0].points
        self.dim = interactions.dim
        self._blocks = blocks = _Blocks(self.inverse)
        self.jumps = _jumps(self.points, self.inverse.num_slots, self.dim)
        self._schur = blocks.inverted()
        self.stiffness = blocks.diagonal_of(self._schur)
        self._transposed = sp.csr_array(self.jumps.T)
        self._share = self._factored_sharing()
        self._w, self.motions, self.coarse = blocks.w, None, None
        anchors = interactions.anchors if coarse_space else None
        known = np.zeros(len(self.inverse.node_offsets) - 1, int)
        if anchors is not None:
            self._w, self.motions = _Blocks(anchors.held).w, anchors.motions
            first = anchors.motions.indices[anchors.motions.indptr[:-1]]
            known = np.bincount(self.inverse.block_of_node[first // self.dim], minlength=len(known))
        if coarse_space:
            self.coarse = CoarseSpace(self, blocks.softest(known))

    def _factored_sharing(self):
        """Factors of H H^T + a little D on the dofs that are free."""
        free = self._blocks.free
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
        return self._blocks.times(self._w, self._transposed @ impulse)

    def product_with(self, impulses: sp.csr_array) -> sp.csr_array:
        """W times columns."""
        forces = sp.csr_array(self._transposed @ impulses)
        return sp.csr_array(self.jumps @ self._blocks.times_columns(self._w, forces))

    def precondition(self, jump: np.ndarray) -> np.ndarray:
        """M times a jump of velocities: impulses."""
        free = self._blocks.free
        moved = np.zeros(free.size)
        moved[free] = self._share.solve((self._transposed @ jump)[free])
        moved = self._blocks.times(self._schur, moved)
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


class CoarseSpace:
    """Impulses C y on which iterations are exact, and velocities a of anchors.

    One sparse factorisation solves

        C^T (g - W C y - G a) = 0,    G^T C y = e.

    Args:
        system: W, and R0.
        motions: R but for R0, by columns.
    """

    def __init__(self, system: BondedSystem, motions: sp.csc_array):
        jumps = system.jumps @ motions
        self._anchored = sp.csr_array((jumps.shape[0], 0))
        if system.motions is not None:
            self._anchored = sp.csr_array(system.jumps @ system.motions)
            jumps = sp.hstack([jumps, self._anchored])
        self._impulses = sp.csr_array(jumps)
        self._products = system.product_with(self._impulses)
        self.size = self._impulses.shape[1]
        square = self._impulses.T @ self._products
        border = self._impulses.T @ self._anchored
        matrix = sp.block_array([[square, border], [border.T, None]], format="csr")
        # regular though motions of the whole scene, or more motions than points, are dependent
        weight = np.where(square.diagonal() > 0.0, square.diagonal(), 1.0)
        scale = 1.0 / np.sqrt(np.concatenate([weight, self._border_scale(weight)]))
        self._scale = scale
        self._matrix = sp.csr_array(sp.diags_array(scale) @ matrix @ sp.diags_array(scale))
        shift = np.full(len(scale), _SHIFT)
        shift[self.size :] *= -1.0
        self._factors = splu(sp.csc_array(self._matrix + sp.diags_array(shift)))

    def _border_scale(self, weight: np.ndarray) -> np.ndarray:
        """Squares of the scales that make rows of the border of order one."""
        anchored = weight[self.size - self._anchored.shape[1] :]
        entries = sp.csr_array(self._anchored.T @ self._anchored).diagonal()
        return entries**2 / anchored

    def _solved(self, jump: np.ndarray, short: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """y and a for C^T g and e."""
        right = self._scale * np.concatenate([jump, short])
        solution = self._factors.solve(right)
        solution += self._factors.solve(right - self._matrix @ solution)
        solution *= self._scale
        return solution[: self.size], solution[self.size :]

    def correction(self, missing: np.ndarray, short: np.ndarray) -> np.ndarray:
        """Impulses that close the missing jumps as far as C does, and give G^T C y = e."""
        return self._impulses @ self._solved(self._impulses.T @ missing, short)[0]

    def left(self, missing: np.ndarray) -> np.ndarray:
        """Jumps but for what C y and a close."""
        none = np.zeros(self._anchored.shape[1])
        y, a = self._solved(self._impulses.T @ missing, none)
        return missing - self._products @ y - self._anchored @ a

    def admissible(self, impulse: np.ndarray) -> np.ndarray:
        """A search direction from an impulse."""
        y, _ = self._solved(self._products.T @ impulse, self._anchored.T @ impulse)
        return impulse - self._impulses @ y

    def short(self, impulse: np.ndarray, load: np.ndarray) -> np.ndarray:
        """What is short of the equilibrium of floating bodies, -R0^T f - G^T r."""
        return -load - self._anchored.T @ impulse

    def anchor_velocities(self, missing: np.ndarray) -> np.ndarray:
        """a that closes the last jumps."""
        none = np.zeros(self._anchored.shape[1])
        return self._solved(self._impulses.T @ missing, none)[1]


def all_bonded(interactions: Interactions) -> bool:
    """Whether every point is a perfect bond."""
    return [g.kernels.no_jump for g in interactions.groups] == [True]


class BondedGradients(Solver):
    """Conjugate gradients on the impulses of perfect bonds, with a coarse space.

    Args:
        coarse_space: False for iterations whose number grows with that of the bodies.

    Raises:
        TypeError: neither True nor False.
    """

    name = "subdomains"

    def __init__(self, coarse_space: bool = True):
        self._coarse_space = require_flag("coarse_space", coarse_space)
        self._system: BondedSystem | None = None

    def solve(
        self, interactions: Interactions, velocity: np.ndarray, options: SolveOptions
    ) -> SolveReport:
        """Find the impulses of the step, as `Solver.solve` says."""
        if not interactions.groups:
            return SolveReport(True, 1, 0.0, 0.0, "subdomains")
        if not all_bonded(interactions):
            names = ", ".join(group.kernels.name for group in interactions.groups)
            raise ValueError(
                f'solver="subdomains" needs PerfectBond at every point, and there is: {names}. '
                'Take "auto", "newton" or "nlgs", which any law may be mixed with.'
            )
        system = self._system
        if system is None or system.inverse is not interactions.inverse:
            system = self._system = BondedSystem(interactions, self._coarse_space)
        iteration = _Iteration(interactions, system, velocity)
        return iteration.run(options.tolerance, options.max_sweeps)

    def kept(self) -> list[object]:
        """The system of the last w."""
        return [] if self._system is None else [self._system]


class _Iteration:
    """Projected conjugate gradients for one free velocity."""

    def __init__(self, interactions: Interactions, system: BondedSystem, velocity: np.ndarray):
        self._system, self._coarse, self._velocity = system, system.coarse, velocity
        self._interactions, self._group = interactions, interactions.groups[0]
        self._free = velocity.copy()
        self._load = np.zeros(0)
        if system.motions is not None:
            self._load = interactions.anchors.load
            self._free -= system.motions @ interactions.anchors.on_springs
        self._wanted = self._to_space(-self._group.jump / interactions.step_size)
        self._directions: list[np.ndarray] = []
        self._responses: list[np.ndarray] = []

    def _to_space(self, local: np.ndarray) -> np.ndarray:
        return np.einsum("pij,pi->pj", self._group.points.frame, local).ravel()

    def _missing(self, impulse: np.ndarray) -> np.ndarray:
        """d - W r; sets the velocities but for R0 a."""
        self._velocity[:] = self._free + self._system.pushed(impulse)
        return self._wanted - self._system.jumps @ self._velocity

    def _left(self, impulse: np.ndarray) -> np.ndarray:
        """Jumps left after the coarse space's correction of the impulses, which it is added to."""
        missing = self._missing(impulse)
        if self._coarse is None:
            return missing
        impulse += self._coarse.correction(missing, self._coarse.short(impulse, self._load))
        return self._coarse.left(self._missing(impulse))

    def run(self, tolerance: float, max_iterations: int) -> SolveReport:
        """Iterate until the error is within the tolerance."""
        group = self._group
        scale = self._scale(tolerance)
        impulse = self._to_space(group.impulse)
        count, traction, error, arrived = 0, 0.0, np.inf, False
        for _ in range(_RENEWALS):
            before = error
            left = self._left(impulse)
            error, direction = self._error(left, scale)
            # what was reached by recurrence and does not come out anew is rounding
            arrived = error <= tolerance or (arrived and 0.5 * before < error < _ROUGH)
            if arrived or count >= max_iterations or not np.isfinite(error):
                break
            reached = error
            while reached > tolerance and count < max_iterations:
                change, left = self._advance(direction, left)
                impulse += change
                count += 1
                reached, direction = self._error(left, scale)
            arrived = reached <= tolerance
            traction = self._traction(change)
        self._move_anchors(impulse)
        local = np.einsum("pij,pj->pi", group.points.frame, impulse.reshape(-1, self._system.dim))
        group.impulse[:] = local
        size = self._coarse.size if self._coarse else 0
        reason = f"{count} iterations, {size} coarse unknowns"
        return SolveReport(arrived, max(count, 1), error, traction, "subdomains", reason)

    def _move_anchors(self, impulse: np.ndarray) -> None:
        missing = self._missing(impulse)
        if self._system.motions is not None:
            moved = self._coarse.anchor_velocities(missing)
            self._interactions.anchors.velocity[:] = moved
            self._velocity += self._system.motions @ moved

    def _scale(self, tolerance: float) -> float:
        """Energy of the impulses beyond the coarse space's; at least what rounding is worth."""
        left = self._left(np.zeros_like(self._wanted))
        speed = float(np.abs(self._velocity).max(initial=0.0))
        rounding = _ROUNDING * speed * np.sqrt(self._system.stiffness.sum())
        return max(self._energy(left)[0], rounding / tolerance)

    def _energy(self, left: np.ndarray) -> tuple[float, np.ndarray]:
        direction = self._system.precondition(left)
        if self._coarse is not None:
            direction = self._coarse.admissible(direction)
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
        left = left - factor * response
        return factor * direction, left if self._coarse is None else self._coarse.left(left)

    def _traction(self, change: np.ndarray) -> float:
        size = np.linalg.norm(change.reshape(-1, self._system.dim), axis=1)
        return float((size / self._group.points.area).max() / self._interactions.step_size)
