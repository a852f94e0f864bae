# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Conjugate gradients on the impulses of perfect bonds: a dual domain decomposition.

Where every point is a perfect bond the interaction problem is linear,

    W r = d,    W = H^T w H,    d = -jump0 / h - H^T v_free,

the dual Schur complement problem of subdomains tied by multipliers (FETI; Farhat and Roux 1991).
Several facets tie the same two nodes, and more ties than needed meet where several subdomains do:
W is singular, d in its range, r not unique, the velocities are; conjugate gradients need no more.

**Preconditioner.** S = w^-1, of w on the nodes of a body that points act on, is its Dirichlet Schur
complement (w may have more, where contacts are searched or small bodies are alike);

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

from collections.abc import Iterator

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.solvers.jump_sharing import JumpSharing
from xper_fx.nscd.solvers.solver import SolveOptions, Solver, SolveReport
from xper_fx.support.checks import require_flag

# Shift that makes a coarse matrix regular where a scene moves as a whole, beside its diagonal.
_SHIFT = 1e-13
# Rounding of the velocities of a node that several impulses act on.
_ROUNDING = 16.0 * np.finfo(float).eps
# Times that the residual is computed anew, from the impulses, before rounding has the last word.
_RENEWALS = 4
# Error that is taken for rounding where it does not fall from a renewal to the next, at most.
_ROUGH = 1e-8


class _Blocks:
    """w body by body, the ground left out, and what can be made of it.

    Args:
        acted: which dofs of the bodies, and of others behind them, points act on.

    Attributes:
        size: degrees of freedom of the bodies.
        w: the blocks by size, each of shape (n, k, k).
        free: shape (size,), which dofs points act on and are not prescribed.
    """

    def __init__(self, inverse: BodyInverse, acted: np.ndarray):
        self.dim = inverse.dim
        first, ends = inverse.node_offsets[:-1] * inverse.dim, inverse.data_offsets[:-1]
        self.size = int(first[-1])
        if size := inverse.uniform_size:
            self.spans = [(0, self.size)]
            self.w = [inverse.data[: ends[-1]].reshape(-1, size, size)]
        else:
            self.spans = list(zip(first[:-1], first[1:], strict=True))
            self.w = [
                inverse.data[a:b].reshape(1, last - first, -1)
                for (first, last), a, b in zip(self.spans, ends[:-1], ends[1:], strict=True)
            ]
        self.free = acted[: self.size] & (self.diagonal_of(self.w) > 0.0)

    @staticmethod
    def diagonal_of(blocks: list[np.ndarray]) -> np.ndarray:
        """Diagonal of blocks, shape (size,)."""
        parts = [np.diagonal(b, axis1=1, axis2=2).ravel() for b in blocks]
        return np.concatenate([np.zeros(0), *parts])

    def times(self, blocks: list[np.ndarray], x: np.ndarray) -> np.ndarray:
        """Blocks times a vector, shape (size,)."""
        out = np.empty_like(x)
        for (first, last), block in zip(self.spans, blocks, strict=True):
            part = x[first:last].reshape(*block.shape[:2], 1)
            out[first:last] = np.matmul(block, part).ravel()
        return out

    def times_columns(self, blocks: list[np.ndarray], columns: sp.csr_array) -> sp.csr_array:
        """Blocks times a sparse matrix of few columns a body."""
        rows, places, values = _lists()
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

    def _on_free(self) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """First dof, blocks and which of their dofs are fixed, with zero rows, of each stack."""
        for (first, last), w in zip(self.spans, self.w, strict=True):
            free = self.free[first:last].reshape(w.shape[:2])
            yield first, np.where(free[:, :, None] & free[:, None, :], w, 0.0), ~free

    def inverted(self) -> list[np.ndarray]:
        """S, zero where a motion is prescribed or nothing acts."""
        schur = []
        for _, s, fixed in self._on_free():
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
        (rows, columns, values), count = _lists(), 0
        known = iter(known)
        for first, w, fixed in self._on_free():
            size = w.shape[1]
            for number, block in enumerate(w):
                start = first + number * size
                left_out = next(known)
                kept = min(most, np.count_nonzero(~fixed[number]) // 2) - left_out
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


def _lists() -> tuple[list, list, list]:
    """Rows, columns and values of a sparse matrix, to which more are appended."""
    return [np.zeros(0, int)], [np.zeros(0, int)], [np.zeros(0)]


class BondedSystem:
    """W and its preconditioner, in the axes of space, for one w.

    Vectors over points and over the dofs of bodies are those of this rank; where ranks divide the
    bodies all of them do everything together.

    Args:
        interactions: points, perfect bonds all.
        coarse_space: whether iterations have one, or bodies are on the springs of their anchors.

    Attributes:
        inverse: whose blocks the system has.
        size: degrees of freedom of this rank's bodies.
        stiffness: D, shape (size,), N s per m/s.
        motions: R0, by columns; none without anchors or a coarse space.
        coarse: the coarse space, None without.
    """

    def __init__(self, interactions: Interactions, coarse_space: bool):
        self.inverse, self._interactions = interactions.inverse, interactions
        own = interactions.own_inverse
        scalar = _scalar_jumps(interactions)
        self.jumps = sp.csr_array(sp.kron(scalar, sp.eye_array(interactions.dim)))
        self._transposed = sp.csr_array(self.jumps.T)
        acted = self._added_up(np.abs(self.jumps).sum(axis=0)) > 0.0
        self._blocks = blocks = _Blocks(own, acted)
        self.size = blocks.size
        self._schur = blocks.inverted()
        self.stiffness = blocks.diagonal_of(self._schur)
        self._sharing = JumpSharing(interactions, scalar, self.stiffness, blocks.free)
        self._w, self.coarse = blocks.w, None
        self.motions = sp.csr_array((self.size, 0))
        anchors = interactions.anchors if coarse_space else None
        known = np.zeros(len(own.node_offsets) - 2, int)
        if anchors is not None:
            self._w = _Blocks(anchors.held, acted).w
            self.motions = sp.csr_array(anchors.motions)[: self.size]
            first = anchors.motions.indices[anchors.motions.indptr[:-1]]
            known = np.bincount(own.block_of_node[first // own.dim], minlength=len(known))
        if coarse_space:
            self.coarse = CoarseSpace(self, interactions, blocks.softest(known))

    def jump_of(self, motion: np.ndarray) -> np.ndarray:
        """H^T v of velocities of bodies."""
        slots = np.zeros(self.jumps.shape[1])
        slots[: self.size] = motion
        self._interactions.refresh_ghosts(slots)
        return self.jumps @ slots

    def force_of(self, impulse: np.ndarray) -> np.ndarray:
        """H r on the dofs of bodies."""
        return self._added_up(self._transposed @ impulse)[: self.size]

    def _added_up(self, forces: np.ndarray) -> np.ndarray:
        """Forces on this rank's slots, with those that other ranks' points add; ghosts follow."""
        if self._interactions.halo is not None:
            self._interactions.halo.everywhere.add_back(forces)
        return forces

    def pushed(self, impulse: np.ndarray) -> np.ndarray:
        """w H r, or w0 H r."""
        return self._blocks.times(self._w, self.force_of(impulse))

    def pushed_columns(self, motions: sp.csr_array) -> tuple[sp.csr_array, sp.csr_array]:
        """H H^T R of motions by columns, which all ranks count alike, and w H H^T R."""
        forces = self._sharing.forces(motions)
        return forces, self._blocks.times_columns(self._w, forces)

    def precondition(self, jump: np.ndarray) -> np.ndarray:
        """M times a jump of velocities: impulses."""
        moved = self._sharing.shared(self.force_of(jump))
        moved = self._sharing.shared(self._blocks.times(self._schur, moved))
        return self.jump_of(moved)


def _scalar_jumps(interactions: Interactions) -> sp.csr_array:
    """H^T of one component, shape (num_points, num_slots)."""
    parts = [sp.csr_array((0, interactions.inverse.num_slots))]
    for points in (g.points for g in interactions.groups):
        signed = points.weights * np.array([1.0, -1.0])[:, None]
        rows = np.repeat(np.arange(len(points)), 2 * points.nodes.shape[2])
        entries = (signed.ravel(), (rows, points.nodes.ravel()))
        parts.append(sp.coo_array(entries, shape=(len(points), parts[0].shape[1])))
    return sp.vstack(parts, format="csr")


class CoarseSpace:
    """Impulses C y on which iterations are exact, and velocities a of anchors.

    One sparse factorisation solves

        C^T (g - W C y - G a) = 0,    G^T C y = e.

    Every rank makes it, of the few motions of all bodies, and has all y and a.

    Args:
        system: W, and R0.
        motions: R of this rank's bodies but for R0, by columns.
    """

    def __init__(self, system: BondedSystem, interactions: Interactions, motions: sp.csc_array):
        self._force_of, self._jump_of = system.force_of, system.jump_of
        self._total = interactions.total
        halo = interactions.halo
        counts = np.array([motions.shape[1], system.motions.shape[1]])
        of_all = counts[None] if halo is None else np.array(halo.ranks.comm.allgather(counts))
        first = np.zeros(2, int) if halo is None else of_all[: halo.ranks.rank].sum(axis=0)
        total = of_all.sum(axis=0)
        self.size, self._soft = int(total.sum()), int(total[0])
        numbers = np.concatenate(
            [first[0] + np.arange(counts[0]), total[0] + first[1] + np.arange(counts[1])]
        )
        self._anchors = slice(first[1], first[1] + counts[1])
        own = sp.coo_array(sp.hstack([motions, system.motions]))
        entries = (own.data, (own.row, numbers[own.col]))
        self._motions = sp.csr_array(sp.coo_array(entries, shape=(system.size, self.size)))
        self._back = sp.csr_array(self._motions.T)
        forces, self._pushed = system.pushed_columns(self._motions)
        square = sp.csr_array(forces.T @ self._pushed)
        border = sp.csr_array((self._back @ forces)[:, self._soft :])
        if halo is not None:
            parts = zip(*halo.ranks.comm.allgather((square, border)), strict=True)
            square, border = map(sum, parts)
        matrix = sp.block_array([[square, border], [border.T, None]], format="csr")
        # regular though motions of the whole scene, or more motions than points, are dependent
        weight = np.where(square.diagonal() > 0.0, square.diagonal(), 1.0)
        # squares of the scales that make rows of the border of order one
        beside = border[self._soft :].diagonal() ** 2 / weight[self._soft :]
        self._scale = scale = 1.0 / np.sqrt(np.concatenate([weight, beside]))
        self._matrix = sp.csr_array(sp.diags_array(scale) @ matrix @ sp.diags_array(scale))
        shift = np.full(len(scale), _SHIFT)
        shift[self.size :] *= -1.0
        self._factors = splu(sp.csc_array(self._matrix + sp.diags_array(shift)))

    def _solved(self, jump: np.ndarray, short: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """y and a of all ranks for this rank's part of C^T g and e."""
        right = self._scale * self._total(np.concatenate([jump, short]))
        solution = self._factors.solve(right)
        solution += self._factors.solve(right - self._matrix @ solution)
        solution *= self._scale
        return solution[: self.size], solution[self.size :]

    def _closing(self, missing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """y and a that close missing jumps as far as they can."""
        none = np.zeros(self.size - self._soft)
        return self._solved(self._back @ self._force_of(missing), none)

    def correction(self, missing: np.ndarray, impulse: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Impulses that close the missing jumps as far as C does, and hold floating bodies.

        With those that are there these are in equilibrium with the load R0^T f.
        """
        short = -(self._back @ self._force_of(impulse))[self._soft :]
        short[self._anchors] -= load
        y, _ = self._solved(self._back @ self._force_of(missing), short)
        return self._jump_of(self._motions @ y)

    def left(self, missing: np.ndarray) -> np.ndarray:
        """Jumps but for what C y and a close."""
        y, a = self._closing(missing)
        return missing - self._jump_of(self._pushed @ y + self._motions[:, self._soft :] @ a)

    def admissible(self, impulse: np.ndarray) -> np.ndarray:
        """A search direction from an impulse."""
        force = self._force_of(impulse)
        y, _ = self._solved(self._pushed.T @ force, (self._back @ force)[self._soft :])
        return impulse - self._jump_of(self._motions @ y)

    def anchor_velocities(self, missing: np.ndarray) -> np.ndarray:
        """a of this rank's anchors that closes the last jumps."""
        return self._closing(missing)[1][self._anchors]


def _require_bonds(interactions: Interactions) -> None:
    """Raise an error on all ranks where a point of any is no perfect bond."""
    groups = interactions.groups
    if interactions.everywhere(all(g.kernels.no_jump and not g.sides.lever_arms for g in groups)):
        return
    names, halo = [group.kernels.name for group in groups], interactions.halo
    if halo is not None:
        names = list(dict.fromkeys(sum(halo.ranks.comm.allgather(names), [])))
    raise ValueError(
        f'solver="subdomains" needs PerfectBond at every point, and there is: {", ".join(names)}. '
        'Take "auto", "newton" or "nlgs", which any law may be mixed with.'
    )


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
        if not interactions.total(len(interactions.groups)):
            return SolveReport(True, 1, 0.0, 0.0, "subdomains")
        _require_bonds(interactions)
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
        self._interactions, self._groups = interactions, interactions.groups
        self._free = velocity[: system.size].copy()
        self._load = np.zeros(0)
        if system.motions.shape[1]:
            self._load = interactions.anchors.load
            self._free -= system.motions @ interactions.anchors.on_springs
        self._wanted = self._to_space([-g.jump / interactions.step_size for g in self._groups])
        self._directions = np.empty((0, len(self._wanted)))
        self._responses = np.empty((0, len(self._wanted)))

    def _to_space(self, local: list[np.ndarray]) -> np.ndarray:
        parts = [
            np.einsum("pij,pi->pj", g.points.frame, values).ravel()
            for g, values in zip(self._groups, local, strict=True)
        ]
        return np.concatenate([np.zeros(0), *parts])

    def _missing(self, impulse: np.ndarray) -> np.ndarray:
        """d - W r; sets the velocities but for R0 a."""
        self._velocity[: self._system.size] = self._free + self._system.pushed(impulse)
        self._interactions.refresh_ghosts(self._velocity)
        return self._wanted - self._system.jumps @ self._velocity

    def _left(self, impulse: np.ndarray) -> np.ndarray:
        """Jumps left after the coarse space's correction of the impulses, which it is added to."""
        missing = self._missing(impulse)
        if self._coarse is None:
            return missing
        impulse += self._coarse.correction(missing, impulse, self._load)
        return self._coarse.left(self._missing(impulse))

    def run(self, tolerance: float, max_iterations: int) -> SolveReport:
        """Iterate until the error is within the tolerance."""
        scale = self._scale(tolerance)
        impulse = self._to_space([g.impulse for g in self._groups])
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
        by_points, first = impulse.reshape(-1, self._interactions.dim), 0
        for g in self._groups:
            own, first = by_points[first : first + len(g)], first + len(g)
            g.impulse[:] = np.einsum("pij,pj->pi", g.points.frame, own)
        size = self._coarse.size if self._coarse else 0
        reason = f"{count} iterations, {size} coarse unknowns"
        return SolveReport(arrived, max(count, 1), error, traction, "subdomains", reason)

    def _move_anchors(self, impulse: np.ndarray) -> None:
        missing = self._missing(impulse)
        if self._coarse is None or self._interactions.anchors is None:
            return
        moved = self._coarse.anchor_velocities(missing)
        self._interactions.anchors.velocity[:] = moved
        self._velocity[: self._system.size] += self._system.motions @ moved
        self._interactions.refresh_ghosts(self._velocity)

    def _scale(self, tolerance: float) -> float:
        """Energy of the impulses beyond the coarse space's; at least what rounding is worth."""
        points = self._interactions
        left = self._left(np.zeros_like(self._wanted))
        speed = points.largest(float(np.abs(self._velocity).max(initial=0.0)))
        stiffness = points.total(float(self._system.stiffness.sum()))
        rounding = _ROUNDING * speed * np.sqrt(stiffness)
        return max(self._energy(left)[0], rounding / tolerance)

    def _energy(self, left: np.ndarray) -> tuple[float, np.ndarray]:
        direction = self._system.precondition(left)
        if self._coarse is not None:
            direction = self._coarse.admissible(direction)
        square = self._interactions.total(float(left @ direction))
        return float(np.sqrt(max(square, 0.0))), direction

    def _error(self, left: np.ndarray, scale: float) -> tuple[float, np.ndarray]:
        energy, direction = self._energy(left)
        return energy / scale if scale > 0.0 else energy, direction

    def _advance(self, direction: np.ndarray, left: np.ndarray):
        """One step of conjugate gradients: change of the impulses, jumps left after it."""
        total = self._interactions.total
        direction = direction - total(self._responses @ direction) @ self._directions
        response = self._system.jump_of(self._system.pushed(direction))
        square, product = total(np.array([direction @ response, direction @ left]))
        length = np.sqrt(square)
        direction, response = direction / length, response / length
        self._directions = np.vstack([self._directions, direction])
        self._responses = np.vstack([self._responses, response])
        factor = product / length
        left = left - factor * response
        return factor * direction, left if self._coarse is None else self._coarse.left(left)

    def _traction(self, change: np.ndarray) -> float:
        size = np.linalg.norm(change.reshape(-1, self._interactions.dim), axis=1)
        area = np.concatenate([np.zeros(0), *(g.points.area for g in self._groups)])
        largest = self._interactions.largest(float((size / area).max(initial=0.0)))
        return largest / self._interactions.step_size
