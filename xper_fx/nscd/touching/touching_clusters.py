# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Contacts that a search has found between cells whose vertices are solved alone.

A contact c has nodes of several vertices, each of which moves with its cluster: the cells that
rigid bonds join there, or its own cell alone where bonds are not rigid. With H_cr the sum of the
signed weights of those of its nodes that move with cluster r, and M_r the mass of r,

    u_c = sum_r H_cr v_r,    W_cc = sum_r H_cr^2 / M_r,    v_r += H_cr p_c / M_r.

A rigid body has v and a spin s: at a side of arm a it moves with v + s x a, and an impulse p there
turns it by J^-1 (a x p). Rows of joints (`rigid/joint_rows.py`) and rolling points
(`laws/rolling.py`), which move rigid bodies alone, are swept with the contacts; where they have the
node of a rotation, they read s and turn the body by J^-1 p.

Contacts and vertices take turns. Given what bonds bear and which cells move as one, the contacts
are swept by Gauss-Seidel with these numbers; given the impulses of the contacts, each of which acts
on the corners of its nodes, the vertices that they touch are solved anew from the free velocities
of their cells, and may open. Contacts of whole vertices that hold take one turn. Where bonds and
contacts hold pieces more than once, turns by themselves would creep: impulses that a turn starts
from are mixed with those of turns before (Anderson 1965; `algebra/anderson_mixing.py`). Wedged
pieces creep by the same amount at each turn, as restitution asks for a little more than friction
lets through, and where contacts hold pieces more than once they may creep by ever less. Turns then
begin where changes that shrink as the last ones did would lead, but no farther ahead than by the
impulses themselves. A turn that began too far ahead is made again from nearer by.

**When it stops.** With dr_c what contact c still asks for after the vertices, the turns end at

    sum_c |dr_c|^2 <= tolerance^2 sum_c |r_c|^2,

or where they are within what rounding lets through: contacts ask for dr_c = dv / w_c where their
velocities are off by dv = 16 eps |v|, w_c the least compliance of their axes in the clusters that
there are, so that sum_c |r_c|^2 counts as no less than sum_c (dv / (w_c tolerance))^2 over those
that push or ask for it: heavy bodies that are near and do not touch are no measure. Bodies that
fly side by side push each other by little beside it, and turns beyond it add up roundings.

Impulses and velocities then solve exactly the problem whose free relative velocities at the
contacts differ by W_cc dr_c. No error of the impulses is estimated from it: where contacts and
closed bonds hold pieces more than once, impulses have no one value. Those of the last turn come
from a sweep, and obey their laws, as mixed ones need not.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.anderson_mixing import AndersonMixing
from xper_fx.nscd.algebra.small import for_dimension, sym_indices
from xper_fx.nscd.couplings import Couplings, Sides, lever_arm_kernels
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.nscd.laws.law import LawKernels
from xper_fx.nscd.point_group import PointGroup, largest_arm
from xper_fx.nscd.solvers.solver import SolveOptions, SolveReport

if TYPE_CHECKING:
    from xper_fx.nscd.splitting.fused_points import FusedPoints
    from xper_fx.nscd.touching.loose_vertices import LooseVertices

# Share of the tolerance to which contacts are swept between turns of the vertices, and how often
# at most: mixing is quicker than many sweeps.
_SWEPT, _MOST = 0.1, 20
# Turns remembered, and plain ones before any is mixed.
_MEMORY, _PLAIN = 8, 3
# Change of what plain turns still ask for, relative, at which they creep; growth of it, over the
# least so far, at which a turn has begun too far ahead, and how much nearer the next begins, down
# to which share.
_CREEPS, _GROWTH, _SHORTER, _SHORTEST = 1e-2, 3.0, 0.25, 1e-7
# Rounding of relative velocities beside the speeds that they are of.
_ROUNDING = 16.0 * np.finfo(float).eps
# Turns after which to give up: bonds snap to and fro, and a shorter step will do.
_TURNS = 150


class SweptContacts(NamedTuple):
    """Contacts of one law as sweeps have them: of `PointGroup`, and `nodes` of the points.

    `turned` are the couplings of those that have lever arms.
    """

    kernels: LawKernels
    sides: Sides
    turned: Couplings | None
    nodes: np.ndarray
    weights: np.ndarray
    frame: np.ndarray
    impulse: np.ndarray
    compliance: np.ndarray
    inverse_area: np.ndarray
    parameters: np.ndarray
    terms: np.ndarray
    details: np.ndarray

    @classmethod
    def of(cls, g: PointGroup) -> SweptContacts:
        """Those of a group, whose arrays they are."""
        return cls(
            g.kernels, g.sides, g.couplings if g.sides.lever_arms else None, g.points.nodes,
            g.points.weights, g.couplings.frame, g.impulse,
            g.compliance, g.inverse_area, g.parameters, g.terms, g.details,
        )  # fmt: skip


class TouchingClusters:
    """The contacts and joints of a step, and the vertices that they touch.

    Args:
        interactions: points after `begin_step`, contacts among them.
        at: the vertices.
        velocity: shape (num_slots * dim,), free velocities of the cells (m/s), which change.
        move: solves the vertices of given numbers from the velocities of their corners.
        options: of the solver.
    """

    def __init__(
        self,
        interactions: Interactions,
        at: FusedPoints | LooseVertices,
        velocity: np.ndarray,
        move: Callable[[np.ndarray], SolveReport],
        options: SolveOptions,
    ):
        self._interactions, self._options, self._move = interactions, options, move
        self._groups, self._at, self._corners = interactions.passing, at, at.corners
        self._velocity = velocity.reshape(-1, interactions.dim)
        self._free = self._velocity.copy()
        self._touched = self._touched_slots()
        touched = np.unique(at.vertex_of_slot[self._touched])
        self._vertices = touched[touched >= 0]
        self._moved = np.union1d(self._touched, self._corners.of(self._vertices))
        self._first_rigid = interactions.bulk_inverse.num_nodes
        self._rigid_w = interactions.rigid_blocks
        self._root = np.arange(len(self._velocity), dtype=np.int32)
        self._mobility = self._corners.compliance.copy()
        self._swept = [SweptContacts.of(g) for g in self._groups]
        # where contacts here have rigid bodies, blocks of these, and the first of their places
        self._turned = [contacts.turned for contacts in self._swept]
        self._rigid = self._rigid_w, self._first_rigid
        self._rounding = _ROUNDING * self._largest_speed()
        # velocities, the row of each node's cluster there, one over its mass, and rigid bodies
        self._of_clusters = self._velocity, self._root, self._mobility, *self._rigid

    def _touched_slots(self) -> np.ndarray:
        """Slots of the contacts' nodes, ascending."""
        nodes = [g.points.nodes.ravel() for g in self._groups]
        return np.unique(np.concatenate([np.zeros(0, np.int32), *nodes]))

    def solve(self, vertices: np.ndarray) -> SolveReport:
        """Find the impulses of contacts and bonds; what it returns is that of `Solver.solve`.

        Args:
            vertices: all that there are.
        """
        tolerance, most = self._options.tolerance, self._options.max_sweeps
        size = int(self._interactions.total(sum(g.impulse.size for g in self._groups)))
        memory = AndersonMixing(size, _MEMORY, _PLAIN)
        count, before, least = 0, np.inf, np.inf
        ahead, share = None, 0.0  # from where the last turn began, and how much of it was gone
        self._push(self._touched)
        report = self._move(vertices)
        for _ in range(_TURNS):
            self._find_clusters()
            residual, traction = self._sweep(acts=False)
            arrived = residual <= tolerance
            if arrived and ahead is None:
                arrived = self._interactions.evolve(self._velocity.reshape(-1)) <= tolerance
            if (arrived and ahead is None) or count >= most or not np.isfinite(residual):
                break
            if ahead is not None and residual > _GROWTH * least:  # that was too far
                memory.forget()
                share *= _SHORTER
            else:
                r = self._impulses()
                count += self._sweep_on()
                swept, share, least = self._impulses(), 1.0, min(least, residual)
                creeps = ahead is None and abs(residual - before) < _CREEPS * residual
                if arrived:
                    ahead = None
                elif creeps:
                    rate = residual / before
                    lead = rate / (1.0 - rate) if rate < 1.0 else np.inf
                    ahead = min(lead, 1.0 / residual) * (swept - r)
                else:
                    mixed = np.empty_like(r)
                    ahead = mixed - swept if memory.mix(swept - r, swept, mixed) else None
                before = residual
            if share < _SHORTEST:
                ahead = None
            self._take(swept if ahead is None else swept + share * ahead)
            self._push(self._moved)
            report = self._move(self._vertices)
        return SolveReport(
            arrived and ahead is None and report.converged, max(count, report.sweeps),
            max(residual, report.residual), traction,
        )  # fmt: skip

    def _take(self, impulses: np.ndarray) -> None:
        """Let contacts have impulses that are given one after the other."""
        first = 0
        for contacts in self._swept:
            last = first + contacts.impulse.size
            contacts.impulse.reshape(-1)[:] = impulses[first:last]
            first = last

    def _impulses(self) -> np.ndarray:
        return np.concatenate([contacts.impulse.ravel() for contacts in self._swept])

    def _impulses_on_slots(self) -> np.ndarray:
        """What contacts give each slot, shape (num_slots, dim), N s."""
        return self._interactions.spread(self._groups)

    def _push(self, slots: np.ndarray) -> None:
        """Let the impulses of contacts act on free cells, at some slots, and on rigid bodies."""
        impulses = self._impulses_on_slots()
        pushed = self._corners.compliance[slots] * impulses[slots]
        self._velocity[slots] = self._free[slots] + pushed
        count = len(self._rigid_w)
        if count:
            rigid = slice(self._first_rigid, self._first_rigid + 2 * count)
            pushed = self._rigid_w @ impulses[rigid].reshape(count, -1, 1)
            self._velocity[rigid] = self._free[rigid] + pushed.reshape(2 * count, -1)

    def _find_clusters(self) -> None:
        """Take what moves as one now; the compliances of contacts follow."""
        _take_clusters(
            self._vertices, self._at.whole, self._at.clusters, self._corners, self._root,
            self._mobility,
        )  # fmt: skip
        self._take_compliances(self._root, self._mobility)

    def _take_compliances(self, root: np.ndarray, mobility: np.ndarray) -> None:
        """Give contacts those of the clusters at their nodes.

        Args:
            root: shape (num_slots,), a slot for the cluster of each.
            mobility: shape (num_slots, dim), one over the mass of the cluster that a slot is for.
        """
        for g, turned in zip(self._groups, self._turned, strict=True):
            w = np.empty_like(g.compliance)
            _compliances(
                g.points.nodes, g.points.weights, g.points.frame,
                sym_indices(g.kernels.components), root, mobility,
                (self._rigid_w, self._first_rigid), w,
            )  # fmt: skip
            if g.sides.lever_arms:
                _add_turning(
                    turned, g.points.frame, *sym_indices(g.kernels.components), *self._rigid, w
                )
            if not np.array_equal(w, g.compliance):
                g.compliance[:] = w
                self._interactions.prepare_group(g)

    def _largest_speed(self) -> float:
        """Of slots and, by their spins, of points of rigid bodies (m/s), over all ranks."""
        speed = np.abs(self._free)
        first = self._first_rigid
        speed[first + 1 : first + 2 * len(self._rigid_w) : 2] *= largest_arm(self._groups)
        return self._interactions.largest(float(speed.max(initial=0.0)))

    def _sweep_on(self) -> int:
        """Sweep until changes are small beside the tolerance; returns how often."""
        count, change = 0, np.inf
        while count < _MOST and change > _SWEPT * self._options.tolerance:
            change, _ = self._sweep(acts=True)
            count += 1
        return count

    def _sweep(self, acts: bool) -> tuple[float, float]:
        """Visit all contacts; returns the relative change, and the largest one of a traction (Pa).

        Args:
            acts: whether impulses change; else the changes are what contacts still ask for.
        """
        changed = total = rounded = largest = 0.0
        for kernels, sides, turned, nodes, weights, frame, *others in self._swept:
            kernel = _sweep_kernel(kernels, sides)
            *sums, peak = kernel(*self._of_clusters, turned, nodes, weights, frame, acts, *others)
            changed, total, rounded = np.add((changed, total, rounded), sums).tolist()
            largest = max(largest, peak)
        total = max(total, rounded * (self._rounding / self._options.tolerance) ** 2)
        relative = np.sqrt(changed / total) if total > 0.0 else np.sqrt(changed)
        return float(relative), float(np.sqrt(largest) / self._interactions.step_size)


@njit(**LEAN_ENTRY)
def _take_clusters(vertices, whole, clusters, corners, root, mobility):
    """Slot for the cluster of each corner of some vertices, and one over the cluster's mass."""
    dim, (offsets, slot, compliance) = mobility.shape[1], corners
    for b in vertices:
        first, last = offsets[b], offsets[b + 1]
        for c in range(first, last):
            cluster = 0 if whole[b] else clusters[c]
            root[slot[c]] = slot[first + cluster]
            if c != first + cluster:
                continue
            for d in range(dim):
                mass = 0.0
                for other in range(first, last):
                    if whole[b] or clusters[other] == cluster:
                        # what is driven has no compliance, and infinite mass
                        mass += 1.0 / compliance[slot[other], d]
                mobility[slot[c], d] = 1.0 / mass


@njit(inline="always")
def _spinning(slot, rigid_w, first_rigid):
    """Rigid body whose rotation a slot is, or -1."""
    place = slot - first_rigid
    return place // 2 if 0 <= place < 2 * len(rigid_w) and place % 2 == 1 else -1


@njit(**LEAN_ENTRY)
def _compliances(nodes, weights, frame, entries, root, mobility, rigid, out):
    """W_cc of contacts, packed symmetric; of rotations with J^-1 of the body.

    `entries` are rows and columns of what is packed, `rigid` blocks of rigid bodies and their
    first slot.
    """
    (rows, cols), (rigid_w, first_rigid) = entries, rigid
    k, dim = nodes.shape[2], frame.shape[2]
    for i in range(len(nodes)):
        for entry in range(len(rows)):
            out[i, entry] = 0.0
        for a in range(2 * k):
            slot, share, counted = root[nodes[i, a // k, a % k]], 0.0, False
            for b in range(2 * k):
                if root[nodes[i, b // k, b % k]] == slot:
                    counted = counted or b < a
                    share += weights[i, b // k, b % k] if b < k else -weights[i, b // k, b % k]
            if counted:
                continue
            body = _spinning(slot, rigid_w, first_rigid)
            for entry in range(len(rows)):
                for d in range(dim):
                    if body >= 0:
                        for e in range(dim):
                            own = share * share * rigid_w[body, dim + d, dim + e]
                            turned = own * frame[i, cols[entry], e]
                            out[i, entry] += frame[i, rows[entry], d] * turned
                        continue
                    own = share * share * mobility[slot, d]
                    out[i, entry] += own * frame[i, rows[entry], d] * frame[i, cols[entry], d]


@njit(inline="always")
def _moment(c, frame, i, s, x, d):
    """Component d of a x e for the arm of a side and direction x of the frame."""
    e, g = (0, 1) if frame.shape[2] == 2 else ((d + 1) % 3, (d + 2) % 3)
    return c.lever_arms[i, s, e] * frame[i, x, g] - c.lever_arms[i, s, g] * frame[i, x, e]


@njit(**LEAN_ENTRY)
def _add_turning(c, frame, rows, cols, rigid_w, first_rigid, out):
    """Add what the spins of rigid bodies have of W_cc: with J^-1 of a body, (a x e) . J^-1 (a x f).

    `first_rigid` is the first slot of rigid bodies, which have two each.
    """
    dim = frame.shape[2]
    turns = dim if dim == 3 else 1
    for i in range(len(out)):
        for s in range(2):
            if c.rotation_dof[i, s] == c.start[i, s, 0]:
                continue
            body = (c.start[i, s, 0] // dim - first_rigid) // 2
            for entry in range(len(rows)):
                for d in range(turns):
                    for e in range(turns):
                        w = rigid_w[body, dim + d, dim + e]
                        here = _moment(c, frame, i, s, rows[entry], d)
                        out[i, entry] += here * w * _moment(c, frame, i, s, cols[entry], e)


@cache
def _sweep_kernel(law: LawKernels, sides: Sides):
    """Kernel `sweep(...)` over contacts of a law.

    It returns the sums of |dr|^2, of |r|^2 and of 1/w_c^2 where these are not zero, and the largest
    |dr|^2/area^2.
    """
    dim, k, lever_arms, components = sides.dim, sides.k, sides.lever_arms, sides.components
    turns = dim if dim == 3 else 1
    turned_by, _, moment = lever_arm_kernels(dim) if lever_arms else (None, None, None)
    algebra = for_dimension(dim, sides.components)
    row, set_row, dot, subtract = algebra.row, algebra.set_row, algebra.dot, algebra.subtract
    sym_row, sym_vector, unit = algebra.sym_row, algebra.sym_vector, algebra.unit
    to_local, to_global = algebra.to_local, algebra.to_global
    world = for_dimension(dim)
    world_row, world_set, add, scale = world.row, world.set_row, world.add, world.scale
    solve = law.solve

    @njit(inline="always")
    def signed(weights, i, s, j):
        weight = weights[i, s, j] if k > 1 else 1.0  # as of couplings
        return weight if s == 0 else -weight

    @njit(inline="always")
    def spun(w, b, f):
        if dim == 2:
            return w[b, 2, 2] * f[0], 0.0
        return (
            w[b, 3, 3] * f[0] + w[b, 3, 4] * f[1] + w[b, 3, 5] * f[2],
            w[b, 4, 3] * f[0] + w[b, 4, 4] * f[1] + w[b, 4, 5] * f[2],
            w[b, 5, 3] * f[0] + w[b, 5, 4] * f[1] + w[b, 5, 5] * f[2],
        )

    @njit(inline="always")
    def lightened(f, mobility, rigid_w, first_rigid, slot):
        body = _spinning(slot, rigid_w, first_rigid) if k == 1 else -1
        if body >= 0:
            return spun(rigid_w, body, f)
        if dim == 2:
            return f[0] * mobility[slot, 0], f[1] * mobility[slot, 1]
        return f[0] * mobility[slot, 0], f[1] * mobility[slot, 1], f[2] * mobility[slot, 2]

    @njit(**LEAN_ENTRY)
    def sweep(
        v, root, mobility, rigid_w, first_rigid, turned, nodes, weights, frame, acts, r, w,
        inverse_area, parameters, terms, details
    ):  # fmt: skip
        changed = total = rounded = largest = 0.0
        flat = v.reshape(-1)
        for i in range(len(r)):
            apart = scale(0.0, world_row(v, root[nodes[i, 0, 0]]))
            for s in range(2):
                for j in range(k):
                    there = world_row(v, root[nodes[i, s, j]])
                    apart = add(apart, scale(signed(weights, i, s, j), there))
            if lever_arms:
                apart = add(apart, turned_by(flat, turned, i, 0))
                apart = add(apart, scale(-1.0, turned_by(flat, turned, i, 1)))
            old = row(r, i)
            new, _ = solve(i, to_local(frame, i, apart), old, w, parameters, terms, details)
            change = subtract(new, old)
            size, pushes = dot(change, change), dot(new, new)
            changed += size
            total += pushes
            if size + pushes > 0.0:
                least, wi = np.inf, sym_row(w, i)
                for x in range(components):
                    along = sym_vector(wi, unit(x, 1.0))[x]
                    least = min(least, along if along > 0.0 else np.inf)
                rounded += 1.0 / (least * least)
            largest = max(largest, size * inverse_area[i] * inverse_area[i])
            if not acts or size == 0.0:
                continue
            set_row(r, i, new)
            f = to_global(frame, i, change)
            for s in range(2):
                for j in range(k):
                    slot = root[nodes[i, s, j]]
                    given = lightened(f, mobility, rigid_w, first_rigid, slot)
                    pushed = scale(signed(weights, i, s, j), given)
                    world_set(v, slot, add(world_row(v, slot), pushed))
                if lever_arms and turned.rotation_dof[i, s] != turned.start[i, s, 0]:
                    first = turned.rotation_dof[i, s]
                    body = (first // dim - first_rigid) // 2
                    g = moment(turned, i, s, scale(1.0 if s == 0 else -1.0, f))
                    for d in range(turns):
                        for e in range(turns):
                            flat[first + d] += rigid_w[body, dim + d, dim + e] * g[e]
        return changed, total, rounded, largest

    return sweep
