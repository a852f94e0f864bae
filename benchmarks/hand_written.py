# SPDX-License-Identifier: LGPL-3.0-or-later
"""A step of a frictionless elastic scene beside the same problem written by hand.

    OPENBLAS_NUM_THREADS=1 ./fenicsx python3 benchmarks/hand_written.py [--sizes N ...] [--spells S]

Two scenes, linear elasticity in the plane, crossed triangles, theta = 1/2, a fixed step:

- layers: two plates on each other, touching without friction, each one body of many cells;
- cells: one plate whose every triangle is a body.

The bottom is held, the top pressed down (and dragged along where layers may slide). By hand: plain
DOLFINx assembles K and the lumped mass once, SciPy factors as the library does (NumPy inverts the
blocks of cells), one matrix product a step, Signorini's law in a Numba Gauss-Seidel loop on the
Delassus matrix of the normals (dense for layers, rows for cells) in the order of the mesh, to the
criterion of `nscd/solvers/nlgs.py`. Both give displacements, velocities, reactions on the held
faces, and, with --ledger, kinetic and elastic energy, work of the supports and what impacts
dissipate. Cells are held apart at position level: at velocity level what counts as closed hangs on
impulses, which are not unique where cells surround a vertex.

Spells of steps of either take turns within one run; the ratio printed is the median over pairs of
spells of processor time a step. Answers are compared first, solved to 1e-11.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import scipy.sparse as sp
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, DiagonalType, create_rectangle
from mpi4py import MPI
from scipy.sparse.linalg import splu

from xper_fx.bodies.explode import EACH_CELL, explode
from xper_fx.bodies.meshes import crossed_rectangle, tag_facets
from xper_fx.cache import njit
from xper_fx.forms.loads import PrescribedVelocity
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import SignoriniCoulomb
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.compat import geometry_dofmap

YOUNG, POISSON, DENSITY = 210e9, 0.3, 7800.0
WIDTH, NUM_LAYERS = 0.1, 2
PRESS, DRAG = -1.0, 0.2  # m/s
BOTTOM, TOP, LEFT, RIGHT = 1, 2, 3, 4
CONTACT = {"layers": "velocity", "cells": "position"}


def step_of(quads: int) -> float:
    """Five times what a wave takes across a triangle (s)."""
    speed = np.sqrt(YOUNG * (1 - POISSON) / ((1 + POISSON) * (1 - 2 * POISSON)) / DENSITY)
    return 5 * WIDTH / quads / 4 / speed


def midpoints(mesh) -> np.ndarray:
    """Midpoints of the cells, shape (num_cells, 2), m."""
    return mesh.geometry.x[geometry_dofmap(mesh)].mean(axis=1)[:, :2]


# -- by the library


def by_library(kind: str, quads: int, tolerance: float) -> Simulation:
    """The scene: `quads` a side of the whole square."""
    mesh = crossed_rectangle((0.0, 0.0), (WIDTH, WIDTH), (quads, quads), MPI.COMM_SELF)
    near = 1e-9 * WIDTH
    tags = tag_facets(
        mesh,
        {
            BOTTOM: lambda x: x[1] < near,
            TOP: lambda x: x[1] > WIDTH - near,
            LEFT: lambda x: x[0] < near,
            RIGHT: lambda x: x[0] > WIDTH - near,
        },
    )
    loads = [PrescribedVelocity(BOTTOM, 1, 0.0), PrescribedVelocity(TOP, 1, PRESS)]
    if kind == "layers":
        middle = midpoints(mesh)[:, 1]
        labels = np.floor(middle / WIDTH * NUM_LAYERS).astype(int)
        loads += [PrescribedVelocity(BOTTOM, 0, 0.0), PrescribedVelocity(TOP, 0, DRAG)]
    else:
        labels = EACH_CELL
        loads += [PrescribedVelocity(LEFT, 0, 0.0), PrescribedVelocity(RIGHT, 0, 0.0)]
    scene = Scene(
        explode(mesh, labels, facet_tags=tags),
        {1: LinearElastic(YOUNG, POISSON, DENSITY)},
        default_interaction=SignoriniCoulomb(contact=CONTACT[kind]),
        loads=loads,
    )
    return Simulation(
        scene, step_of(quads), solver="nlgs", tolerance=tolerance, max_sweeps=200_000,
        num_threads=1,
    )  # fmt: skip


def keyed_library(simulation: Simulation) -> tuple[np.ndarray, np.ndarray]:
    """Keys and (q, v) of the nodes."""
    bodies, V = simulation.scene.bodies, simulation.forms.V
    centre = midpoints(bodies.mesh)
    cells = V.dofmap.list
    of_body = np.empty((bodies.num_bodies, 2))
    of_body[bodies.body_of_cell] = centre
    if bodies.num_bodies == NUM_LAYERS:
        of_body = np.arange(NUM_LAYERS)[:, None] * [0.0, 1.0]
    owner = np.empty((V.dofmap.index_map.size_local, 2))
    owner[cells] = of_body[bodies.body_of_cell][:, None]
    state = simulation.state
    values = np.hstack([a.reshape(-1, 2) for a in (state.displacement, state.velocity)])
    return np.hstack([owner, V.tabulate_dof_coordinates()[:, :2]]), values


# -- by hand


@njit
def converged(changes, known, change, tolerance):
    """Whether the error that the last change and the contraction stand for is within bounds."""
    if change <= 16 * 2.220446049250313e-16:
        return change <= tolerance
    window = min(4, known - 1)
    if window == 0:
        return False
    rho = (changes[known - 1] / changes[known - 1 - window]) ** (1.0 / window)
    return rho < 1.0 and change * max(1.0, rho / (1.0 - rho)) <= tolerance


@njit(fastmath={"contract"}, error_model="numpy")
def sweep_dense(w, u, r, least, changes, tolerance):
    """Gauss-Seidel on u = u_free + W r, W dense, u kept up to date."""
    n = len(r)
    for i in range(n):
        if r[i] != 0.0:
            for j in range(n):
                u[j] += w[i, j] * r[i]
    for count in range(len(changes)):
        changed, total = 0.0, 0.0
        for i in range(n):
            b = u[i] - w[i, i] * r[i]
            new = 0.0 if b >= least[i] else (least[i] - b) / w[i, i]
            dr = new - r[i]
            total += new * new
            if dr != 0.0:
                r[i] = new
                changed += dr * dr
                for j in range(n):
                    u[j] += w[i, j] * dr
        changes[count] = np.sqrt(changed / total) if total > 0.0 else 0.0
        if converged(changes, count + 1, changes[count], tolerance):
            return count + 1
    return -1


@njit(fastmath={"contract"}, error_model="numpy")
def sweep_rows(indptr, indices, data, diagonal, free, r, least, changes, tolerance):
    """Gauss-Seidel on u = u_free + W r, W by rows."""
    n = len(r)
    for count in range(len(changes)):
        changed, total = 0.0, 0.0
        for i in range(n):
            u = free[i]
            for e in range(indptr[i], indptr[i + 1]):
                u += data[e] * r[indices[e]]
            b = u - diagonal[i] * r[i]
            new = 0.0 if b >= least[i] else (least[i] - b) / diagonal[i]
            dr = new - r[i]
            total += new * new
            if dr != 0.0:
                r[i] = new
                changed += dr * dr
        changes[count] = np.sqrt(changed / total) if total > 0.0 else 0.0
        if converged(changes, count + 1, changes[count], tolerance):
            return count + 1
    return -1


@njit(fastmath={"contract"}, error_model="numpy")
def least_velocity(step, gap, u, w, r, out):
    """Velocity-level Signorini: 0 where the mid-step gap is closed, else nothing."""
    for i in range(len(out)):
        closed = gap[i] + 0.5 * step * u[i] <= 1e-3 * step * w[i] * r[i]
        out[i] = 0.0 if closed else -np.inf


@njit(fastmath={"contract"}, error_model="numpy")
def least_to_stay_apart(step, gap, u, out):
    """Position-level Signorini: no overlap at the end of the step."""
    for i in range(len(out)):
        out[i] = -(gap[i] + 0.5 * step * u[i]) / (0.5 * step)


@njit(fastmath={"contract"}, error_model="numpy")
def normal_jumps(nodes, normal, v, out):
    """Relative normal velocities."""
    for i in range(len(out)):
        c, a = 2 * nodes[i, 0], 2 * nodes[i, 1]
        out[i] = normal[i, 0] * (v[c] - v[a]) + normal[i, 1] * (v[c + 1] - v[a + 1])


@njit(fastmath={"contract"}, error_model="numpy")
def spread(nodes, normal, r, p):
    """p = H r."""
    p[:] = 0.0
    for i in range(len(r)):
        c, a = 2 * nodes[i, 0], 2 * nodes[i, 1]
        x, y = normal[i, 0] * r[i], normal[i, 1] * r[i]
        p[c] += x
        p[c + 1] += y
        p[a] -= x
        p[a + 1] -= y


@njit(fastmath={"contract"}, error_model="numpy")
def multiply_cells(blocks, x, out):
    """out = A x, A in a 6 x 6 block a cell."""
    for c in range(len(blocks)):
        for i in range(6):
            total = 0.0
            for j in range(6):
                total += blocks[c, i, j] * x[6 * c + j]
            out[6 * c + i] = total


@njit(fastmath={"contract"}, error_model="numpy")
def right_side(mass, v, step, force, moved, fixed, out):
    """2 M v - h f - Mt s_p on the free dofs, zero on the prescribed ones."""
    for i in range(len(v)):
        out[i] = 0.0 if fixed[i] else 2.0 * mass[i] * v[i] - step * force[i] - moved[i]


@njit(fastmath={"contract"}, error_model="numpy")
def advance(step, sums, q, v, before):
    """v1 = s - v0, q1 = q0 + h s / 2; v0 is left in `before`."""
    for i in range(len(q)):
        before[i] = v[i]
        v[i] = sums[i] - v[i]
        q[i] += 0.5 * step * sums[i]


class ByHand:
    """The problem in arrays. With s = v0 + v1 the theta scheme of theta = 1/2 reads

    Mt s = 2 M v0 - h K q0 + H r,  Mt = M + h^2 K / 4,  q1 = q0 + h s / 2.
    """

    def __init__(self, kind: str, quads: int, tolerance: float, ledger: bool):
        self.step, self.tolerance, self.ledger = step_of(quads), tolerance, ledger
        self.cells = kind == "cells"
        heights = 1 if self.cells else NUM_LAYERS
        stiffness, mass, xs = [], [], []
        for layer in range(heights):
            mesh = create_rectangle(
                MPI.COMM_SELF,
                [[0.0, layer * WIDTH / heights], [WIDTH, (layer + 1) * WIDTH / heights]],
                [quads, quads // heights],
                CellType.triangle,
                diagonal=DiagonalType.crossed,
            )
            family = "DG" if self.cells else "Lagrange"
            V = fem.functionspace(mesh, (family, 1, (2,)))
            u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
            lam = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
            mu = YOUNG / (2 * (1 + POISSON))
            e = ufl.sym(ufl.grad(u))
            form = ufl.inner(lam * ufl.tr(e) * ufl.Identity(2) + 2 * mu * e, ufl.grad(v)) * ufl.dx
            matrix = fem.assemble_matrix(fem.form(form))
            matrix.scatter_reverse()
            stiffness.append(sp.csr_array(matrix.to_scipy()))
            one = fem.functionspace(mesh, (family, 1))
            lumped = fem.assemble_vector(fem.form(DENSITY * ufl.TestFunction(one) * ufl.dx)).array
            mass.append(np.repeat(lumped, 2))
            xs.append(V.tabulate_dof_coordinates()[:, :2])
        self.stiffness, self.mass = sp.block_diag(stiffness, format="csr"), np.concatenate(mass)
        self.x = np.concatenate(xs)
        count = len(self.mass)
        if self.cells:
            self._pairs_of_cells(mesh, V)
            owner = np.repeat(midpoints(mesh), 3, axis=0)
            self.owner = np.empty_like(owner)
            self.owner[V.dofmap.list.ravel()] = owner
        else:
            self._pairs_of_layers(xs)
            number = np.repeat(np.arange(heights), [len(x) for x in xs])
            self.owner = number[:, None] * [0.0, 1.0]
        # motions: of s, twice the velocity but in the first step, which starts from rest
        bottom, top = self._on_side(V, 1)
        fixed, self.motion = np.zeros((count // 2, 2), bool), np.zeros((count // 2, 2))
        fixed[bottom | top, 1] = True
        self.motion[top, 1] = PRESS
        if self.cells:
            fixed[np.any(self._on_side(V, 0), axis=0), 0] = True
        else:
            fixed[bottom | top, 0] = True
            self.motion[top, 0] = DRAG
        self.fixed, self.motion = fixed.ravel(), self.motion.ravel()
        self.held = np.flatnonzero(self.fixed)
        self._factor(sp.diags_array(self.mass) + self.step**2 / 4 * self.stiffness, xs)
        self.q, self.v = np.zeros((2, count))
        self.force, self.before, self.p, self.right, self.sums = np.zeros((5, count))
        n = len(self.nodes)
        self.r, self.jump, self.u, self.least, self.free, self.u0 = np.zeros((6, n))
        self.changes = np.empty(200_000)
        self.sweeps = 0
        self.work = self.impact = 0.0

    def _on_side(self, V, axis):
        """Nodes on the lower and on the upper end of an axis; of cells, of those with an edge."""
        near = 1e-9 * WIDTH
        sides = np.stack([self.x[:, axis] < near, self.x[:, axis] > WIDTH - near])
        if self.cells:
            cells = V.dofmap.list
            edge = sides[:, cells].sum(axis=2) > 1
            sides[:, cells] &= edge[:, :, None]
        return sides

    def _pairs_of_layers(self, xs):
        """Two points on each facet of an interface: a node of each side, from left to right."""
        pairs = []
        offsets = np.concatenate([[0], np.cumsum([len(x) for x in xs])])
        for low in range(len(xs) - 1):
            height = (low + 1) * WIDTH / len(xs)
            sides = [
                np.flatnonzero(np.abs(xs[b][:, 1] - height) < 1e-9 * WIDTH) for b in (low, low + 1)
            ]
            below, above = (
                offsets[b] + side[np.argsort(xs[b][side, 0])]
                for b, side in zip((low, low + 1), sides, strict=True)
            )
            nodes = np.stack([above, below], axis=1)
            pairs.append(np.stack([nodes[:-1], nodes[1:]], axis=1).reshape(-1, 2))
        self.nodes = np.concatenate(pairs)
        self.normal = np.tile([0.0, 1.0], (len(self.nodes), 1))

    def _pairs_of_cells(self, mesh, V):
        """Two points on each interior edge, in the order of the mesh."""
        mesh.topology.create_connectivity(1, 2)
        mesh.topology.create_connectivity(1, 0)
        vertices = geometry_dofmap(mesh)
        cells_of = mesh.topology.connectivity(1, 2)
        pairs, normals = [], []
        dofs, x = V.dofmap.list, mesh.geometry.x
        for edge in range(mesh.topology.index_map(1).size_local):
            cells = cells_of.links(edge)
            if len(cells) < 2:
                continue
            first, second = vertices[cells[0]], vertices[cells[1]]
            common = np.intersect1d(first, second)
            along = x[common[1], :2] - x[common[0], :2]
            normal = np.array([along[1], -along[0]]) / np.linalg.norm(along)
            if normal @ (x[first, :2].mean(axis=0) - x[second, :2].mean(axis=0)) < 0.0:
                normal = -normal
            for vertex in common:
                pairs.append(
                    [dofs[cells[0]][first == vertex][0], dofs[cells[1]][second == vertex][0]]
                )
                normals.append(normal)
        self.nodes, self.normal = np.array(pairs), np.array(normals)

    def _factor(self, matrix, xs):
        """Factor once; W on the normals, and what prescribed motions push."""
        matrix = matrix.tocsr()
        free = ~self.fixed
        self.push = matrix[:, self.held]
        n = len(self.nodes)
        rows = (2 * self.nodes[:, :, None] + np.arange(2)).reshape(n, 4)
        values = np.concatenate([self.normal, -self.normal], axis=1)
        h = sp.csr_array(
            (values.ravel(), (rows.ravel(), np.repeat(np.arange(n), 4))), shape=(len(free), n)
        )
        if self.cells:
            dense = matrix.tobsr((6, 6))
            blocks = np.empty((len(free) // 6, 6, 6))
            blocks[dense.indices] = dense.data
            held = self.fixed.reshape(-1, 6)
            blocks[held[:, :, None] | held[:, None, :]] = 0.0
            blocks[:, range(6), range(6)] += held
            w = np.linalg.inv(blocks)
            w[:, range(6), range(6)] -= held
            self.w = 0.5 * (w + w.transpose(0, 2, 1))
            starts = np.arange(len(w))
            big = sp.bsr_array((self.w, starts, np.arange(len(w) + 1))).tocsr()
            delassus = (h.T @ big @ h).tocsr()
            delassus.sort_indices()
            self.rows = delassus.indptr, delassus.indices, delassus.data
            self.diagonal = delassus.diagonal()
            dense = self.stiffness.tobsr((6, 6))
            self.k = np.empty_like(w)
            self.k[dense.indices] = dense.data
            return
        self.factors, first = [], 0
        for x in xs:
            own = np.arange(first, first + 2 * len(x))
            own = own[free[own]]
            lu = splu(
                sp.csc_matrix(matrix[own][:, own]), permc_spec="MMD_AT_PLUS_A",
                options={"SymmetricMode": True, "DiagPivotThresh": 0.0},
            )  # fmt: skip
            self.factors.append((own, lu))
            first += 2 * len(x)
        columns = h.toarray()
        for own, lu in self.factors:
            columns[own] = lu.solve(columns[own])
        columns[self.held] = 0.0
        self.delassus = np.ascontiguousarray(h.T @ columns)
        self.diagonal = self.delassus.diagonal().copy()

    def _solve(self, right, out):
        if self.cells:
            multiply_cells(self.w, right, out)
            return
        for own, lu in self.factors:
            out[own] = lu.solve(right[own])

    def make_step(self) -> int:
        """One step; the sweeps it took."""
        step, sums = self.step, self.sums
        given = self.motion[self.held] + self.v[self.held]
        moved = self.push @ given
        right_side(self.mass, self.v, step, self.force, moved, self.fixed, self.right)
        self._solve(self.right, sums)
        sums[self.held] = given
        if self.cells:
            least_to_stay_apart(step, self.jump, self.u0, self.least)
        else:
            least_velocity(step, self.jump, self.u0, self.diagonal, self.r, self.least)
        np.subtract(sums, self.v, out=self.right)
        normal_jumps(self.nodes, self.normal, self.right, self.free)
        if self.cells:
            self.sweeps = sweep_rows(
                *self.rows, self.diagonal, self.free, self.r, self.least, self.changes,
                self.tolerance,
            )  # fmt: skip
        else:
            self.sweeps = sweep_dense(
                self.delassus, self.free, self.r, self.least, self.changes, self.tolerance
            )
        spread(self.nodes, self.normal, self.r, self.p)
        self._solve(self.p, self.right)
        self.right[self.held] = 0.0
        sums += self.right
        advance(step, sums, self.q, self.v, self.before)
        normal_jumps(self.nodes, self.normal, self.v, self.u)
        start = self.force[self.held]
        if self.ledger:
            old_jump = self.jump.copy()
        self.jump += 0.5 * step * (self.u + self.u0)
        self.u0[:] = self.u
        if self.cells:
            multiply_cells(self.k, self.q, self.force)
        else:
            self.force = self.stiffness @ self.q
        held = self.held
        change = self.v[held] - self.before[held]
        self.reactions = (
            self.mass[held] * change + 0.5 * step * (start + self.force[held]) - self.p[held]
        )
        if self.ledger:
            self.kinetic = 0.5 * self.v @ (self.mass * self.v)
            self.elastic = 0.5 * self.q @ self.force
            self.work += 0.5 * sums[held] @ self.reactions
            self.impact -= self.r @ (self.jump - old_jump) / step
        return self.sweeps

    def keyed(self) -> tuple[np.ndarray, np.ndarray]:
        """Keys and (q, v) of the nodes."""
        values = np.hstack([a.reshape(-1, 2) for a in (self.q, self.v)])
        return np.hstack([self.owner, self.x]), values


# -- comparison


def difference(simulation: Simulation, hand: ByHand) -> float:
    """Largest relative difference of displacements, of velocities and of the top's reaction."""
    sorted_ = []
    for keys, values in (keyed_library(simulation), hand.keyed()):
        order = np.lexsort(np.round(keys / WIDTH, 9).T)
        sorted_.append((keys[order], values[order]))
    (a, x), (b, y) = sorted_
    if not np.allclose(a, b, rtol=0.0, atol=1e-9 * WIDTH):
        raise RuntimeError("the nodes of the two problems do not match")
    parts = [np.abs(x[:, p] - y[:, p]).max() / np.abs(x[:, p]).max() for p in ([0, 1], [2, 3])]
    ours = simulation.reaction(TOP)[1]
    top = (hand.held % 2 == 1) & (hand.x[hand.held // 2, 1] > (1 - 1e-9) * WIDTH)
    theirs = hand.reactions[top].sum() / hand.step
    return max(*parts, abs(ours - theirs) / abs(ours))


def library_steps(simulation: Simulation, count: int) -> int:
    """Make steps; sweeps in all."""
    end = simulation.time + count * simulation.step_size
    return sum(record.sweeps for record in simulation.steps(end))


def hand_steps(hand: ByHand, count: int) -> int:
    """Make steps; sweeps in all."""
    return sum(hand.make_step() for _ in range(count))


def measure(kind: str, quads: int, options) -> None:
    """Compare answers, then times, and print a line."""
    simulation = by_library(kind, quads, 1e-11)
    hand = ByHand(kind, quads, 1e-11, ledger=False)
    library_steps(simulation, options.check)
    hand_steps(hand, options.check)
    off = difference(simulation, hand)
    simulation = by_library(kind, quads, options.tolerance)
    pair = [
        (library_steps, simulation),
        (hand_steps, ByHand(kind, quads, options.tolerance, options.ledger)),
    ]
    seconds, sweeps = np.zeros((options.spells, 2)), np.zeros(2)
    for run, target in pair:
        run(target, options.steps)  # compiles, and begins the motion
    for spell in range(options.spells):
        for which in (0, 1) if spell % 2 else (1, 0):
            run, target = pair[which]
            start = time.process_time()
            sweeps[which] += run(target, options.steps)
            seconds[spell, which] = time.process_time() - start
    each = 1e6 * np.median(seconds, axis=0) / options.steps
    ratio = np.median(seconds[:, 0] / seconds[:, 1])
    mean = sweeps / options.spells / options.steps
    group = simulation.interactions.groups[0]
    print(
        f"{kind:7s} {simulation.bulk.num_dofs:7d} {len(group):7d}  {each[0]:9.0f}  {each[1]:9.0f}"
        f"  {ratio:6.3f}  {mean[0]:6.1f} {mean[1]:6.1f}  {group.nbytes / len(group):7.0f}"
        f"  {off:10.1e}",
        flush=True,
    )


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinds", nargs="+", default=["layers", "cells"])
    parser.add_argument(
        "--sizes", type=int, nargs="+", default=[8, 16, 32, 64], help="quads a side"
    )
    parser.add_argument("--steps", type=int, default=10, help="steps of a spell")
    parser.add_argument("--spells", type=int, default=40, help="spells of each, taken in turns")
    parser.add_argument("--check", type=int, default=20, help="steps whose answers are compared")
    parser.add_argument("--tolerance", type=float, default=1e-6)
    parser.add_argument("--ledger", action="store_true", help="energies by hand too")
    options = parser.parse_args()
    print(
        "kind       dofs  points  library us    hand us   ratio  sweeps (l, h)  B/point  difference"
    )
    for kind in options.kinds:
        for quads in options.sizes:
            measure(kind, quads, options)


if __name__ == "__main__":
    main()
