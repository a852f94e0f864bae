# SPDX-License-Identifier: LGPL-3.0-or-later
r"""A notched bar that snaps back, against an arc-length solution written apart from the package.

    ./fenicsx python3 benchmarks/snap_back.py [--rows 20] [--figure FILE]

A bar of two materials, clamped at its ends, is pulled apart. The halves are bonded along the middle
but for an edge notch, so that the bonds open and slide. The bar is so long that it gives more than
the bonds soften once the crack grows: the displacement of its end and the load go back together.

The package follows the path by growth control and by dissipation control. The other solution
shares no code with it: stiffness matrices of the halves from plain forms of DOLFINx, interface
elements with two Gauss points a facet,

    f = B^T A g(max(x, x_r)) K J,   J = B u,   x = |(<J_n>+, J_t)|,   K_n = 1000 K where J_n < 0,

with their tangent in NumPy, and Newton's method on displacements u and load factor l for

    R(u, l) = 0,   |B (u - u_0)|^2 = s^2

(Crisfield 1981, on the jumps, as de Borst 1987 advises where damage localises). s adapts to the
iterations, and the sign of dl is that with which jumps go on as in the last step.

Compared are the loads and the displacements of the end where the bonds have dissipated the same.
The other solution has some hundred steps, small ones where a point starts to weaken, as the path
has a corner there, and is interpolated between them: that is what the largest differences are.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, DiagonalType, create_rectangle, meshtags
from mpi4py import MPI
from scipy.interpolate import PchipInterpolator
from scipy.sparse.linalg import splu

import xper_fx as xf
from xper_fx.plotting import new_figure

LENGTH, HEIGHT, NOTCH = 0.4, 0.1, 0.3  # m, m, share of the height
YOUNG, POISSON = (30e9, 10e9), 0.2  # left and right, plane strain
TOUGHNESS, STRENGTH, STIFFNESS = 20.0, 3e6, 3e14
# Share of what the ligament costs at which both end.
END = 0.85
# Steps in which points start to weaken, beside the longest one.
FINE = 0.01
LEFT, RIGHT, CUT = 1, 2, 3


class States(NamedTuple):
    """States along a path.

    Attributes:
        moved: displacement of the end (m).
        load: N/m.
        spent: dissipated energy (J/m).
    """

    moved: np.ndarray
    load: np.ndarray
    spent: np.ndarray


# -- the package


def follow(rows: int, control: Any, end: float = END) -> States:
    """The path of the package with `rows` facets over the height, up to a share of the ligament."""
    mesh = xf.crossed_rectangle((0, 0), (LENGTH, HEIGHT), (2 * rows, rows))
    tags = xf.tag_facets(
        mesh,
        {
            LEFT: lambda x: x[0] < 1e-9,
            RIGHT: lambda x: x[0] > LENGTH - 1e-9,
            CUT: lambda x: (abs(x[0] - 0.5 * LENGTH) < 1e-9) & (x[1] < NOTCH * HEIGHT + 1e-9),
        },
    )
    centre = mesh.geometry.x[xf.geometry_dofmap(mesh)].mean(axis=1)
    right = (centre[:, 0] > 0.5 * LENGTH).astype(np.int32)
    cells = meshtags(mesh, 2, np.arange(len(right), dtype=np.int32), 1 + right)
    held = [(LEFT, 0, 0.0), (LEFT, 1, 0.0), (RIGHT, 1, 0.0), (RIGHT, 0, lambda t: 1e-6 * t)]
    materials = {
        1 + side: xf.materials.LinearElastic(young, POISSON, 2400.0)
        for side, young in enumerate(YOUNG)
    }
    scene = xf.Scene(
        xf.explode(mesh, right, cells, tags),
        materials,
        default_interaction=xf.laws.CohesiveZone(STIFFNESS, TOUGHNESS, STRENGTH),
        facet_interactions={CUT: None},
        loads=[xf.PrescribedDisplacement(*load) for load in held],
        points="gauss",
    )
    simulation = xf.Simulation(scene, 1.0, inertia=False, path=control)
    states = [(0.0, 0.0, 0.0)]
    for step in simulation.steps(1e6):
        spent = step.energies["dissipated_cohesion"]
        states.append((1e-6 * step.time, simulation.reaction(RIGHT)[0], spent))
        if spent > end * TOUGHNESS * (1.0 - NOTCH) * HEIGHT:
            break
    return States(*np.transpose(states))


# -- apart from it


class Half(NamedTuple):
    """A half of the bar: stiffness matrix, coordinates of its nodes."""

    stiffness: sp.csr_matrix
    x: np.ndarray


def half(start: float, rows: int, young: float) -> Half:
    """The half from `start` on."""
    corners = [[start, 0.0], [start + 0.5 * LENGTH, HEIGHT]]
    mesh = create_rectangle(
        MPI.COMM_SELF, corners, (rows, rows), CellType.triangle, diagonal=DiagonalType.crossed
    )
    V = fem.functionspace(mesh, ("Lagrange", 1, (2,)))
    u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
    strain = ufl.sym(ufl.grad(u))
    mu = young / (2.0 * (1.0 + POISSON))
    lame = 2.0 * mu * POISSON / (1.0 - 2.0 * POISSON)
    stress = 2.0 * mu * strain + lame * ufl.tr(strain) * ufl.Identity(2)
    form = fem.form(ufl.inner(stress, ufl.grad(v)) * ufl.dx)
    return Half(fem.assemble_matrix(form).to_scipy().tocsr(), V.tabulate_dof_coordinates())


class Interface:
    """Interface elements: their jumps J = B u, and the history of their points."""

    def __init__(self, left: Half, right: Half):
        sides = []
        for body, first in ((left, 0), (right, len(left.x))):
            at = np.flatnonzero(abs(body.x[:, 0] - 0.5 * LENGTH) < 1e-9)
            sides.append(first + at[np.argsort(body.x[at, 1])])
        y = np.sort(left.x[sides[0], 1])
        bonded = np.flatnonzero(0.5 * (y[1:] + y[:-1]) > NOTCH * HEIGHT)
        self.area = np.repeat(0.5 * np.diff(y)[bonded], 2)
        rows, columns, entries = [], [], []
        for point, (facet, s) in enumerate((j, s) for j in bonded for s in (-1, 1)):
            near = 0.5 * (1.0 - s / np.sqrt(3.0))
            for sign, nodes in ((-1.0, sides[0]), (1.0, sides[1])):
                for node, share in ((nodes[facet], near), (nodes[facet + 1], 1.0 - near)):
                    for axis in (0, 1):
                        rows.append(2 * point + axis)
                        columns.append(2 * node + axis)
                        entries.append(sign * share)
        shape = 2 * len(self.area), 2 * (len(left.x) + len(right.x))
        self.B = sp.csr_matrix((entries, (rows, columns)), shape)
        self.d0 = STRENGTH / STIFFNESS
        self.dc = 1.5 * (TOUGHNESS / STRENGTH + self.d0 / 6.0)
        self.reached = np.full(len(self.area), self.d0)

    def opening(self, jump: np.ndarray) -> np.ndarray:
        """x of jumps, shape (n, 2)."""
        return np.hypot(np.maximum(jump[:, 0], 0.0), jump[:, 1])

    def _damage(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """g and its slope from d0 on."""
        y = np.minimum((x - self.d0) / (self.dc - self.d0), 1.0)
        g = self.d0 / x * (1.0 - y * y)
        return g, -g / x - np.where(y < 1.0, 2.0 * y * self.d0 / (x * (self.dc - self.d0)), 0.0)

    def answer(self, jump: np.ndarray, opens: np.ndarray) -> tuple[np.ndarray, sp.csr_matrix]:
        """Forces A t, shape (2 n,), and their tangent; `opens` tells which points weaken."""
        x = self.opening(jump)
        g, slope = self._damage(np.where(opens, x, self.reached))
        stiffness = np.repeat(g[:, None], 2, 1) * STIFFNESS
        stiffness[jump[:, 0] < 0.0, 0] = 1e3 * STIFFNESS
        positive = np.stack([np.maximum(jump[:, 0], 0.0), jump[:, 1]], 1)
        weakens = np.where(opens, slope / np.maximum(x, self.d0), 0.0) * STIFFNESS
        tangent = weakens[:, None, None] * positive[:, :, None] * positive[:, None, :]
        tangent[:, [0, 1], [0, 1]] += stiffness
        tangent *= self.area[:, None, None]
        blocks = sp.bsr_matrix((tangent, np.arange(len(x)), np.arange(len(x) + 1)))
        return (self.area[:, None] * stiffness * jump).ravel(), blocks.tocsr()

    def spent(self) -> float:
        """Dissipated energy (J/m): the area below the curve less what is held."""
        y = np.minimum((self.reached - self.d0) / (self.dc - self.d0), 1.0)
        below = STRENGTH * (0.5 * self.d0 + (self.dc - self.d0) * (y - y**3 / 3.0))
        held = 0.5 * STRENGTH * (1.0 - y * y) * np.minimum(self.reached, self.dc)
        return float(self.area @ (below - held))


class ArcLength:
    """The path by an arc-length method.

    Args:
        rows: facets over the height.

    Attributes:
        u, factor: displacements (m) of all nodes and of the end.
        bonds: the interface.
        iterations: of the last step.
    """

    def __init__(self, rows: int):
        bodies = half(0.0, rows, YOUNG[0]), half(0.5 * LENGTH, rows, YOUNG[1])
        self.bonds = Interface(*bodies)
        self._K = sp.block_diag([body.stiffness for body in bodies], "csr")
        x = np.repeat(np.concatenate([body.x[:, 0] for body in bodies]), 2)
        self._pulled = (x > LENGTH - 1e-9) & (np.arange(len(x)) % 2 == 0)
        self._free = np.flatnonzero((x > 1e-9) & (x < LENGTH - 1e-9))
        self.u, self.factor, self.iterations = np.zeros(len(x)), 0.0, 0
        self._before: np.ndarray | None = None

    @property
    def load(self) -> float:
        """Of the end, N/m."""
        return float((self._K[self._pulled] @ self.u).sum())

    def trial(self, arc: float) -> tuple[np.ndarray, float, np.ndarray, np.ndarray] | None:
        """A step of a length: u, l, the change of jumps, openings reached; None without a state."""
        K, bonds, free = self._K, self.bonds, self._free
        B, moves = bonds.B[:, free], K[free] @ self._pulled
        start, u, factor = bonds.B @ self.u, self.u.copy(), self.factor
        for self.iterations in range(12):
            jump = (bonds.B @ u).reshape(-1, 2)
            change, opened = jump.ravel() - start, bonds.opening(jump)
            # the first correction goes on with the points that opened last
            least = bonds.reached * (1.0 if self.iterations else 1.0 - 1e-12)
            force, tangent = bonds.answer(jump, opened > least)
            left, missing = -(K @ u + bonds.B.T @ force)[free], arc**2 - change @ change
            small = np.abs(left).max() < 1e-9 * np.abs(K[self._pulled] @ u).max()
            if self.iterations and small and abs(missing) < 1e-9 * arc**2:
                return u, factor, change, np.maximum(bonds.reached, opened)
            solver = splu((K[free][:, free] + B.T @ tangent @ B).tocsc())
            along, du = solver.solve(-moves), 0.0
            way = B @ along
            if self.iterations:
                du = solver.solve(left)
                dl = 0.5 * (missing - 2.0 * change @ (B @ du)) / (change @ way)
            else:
                sign = 1.0 if self._before is None else np.sign(way @ self._before)
                dl = sign * arc / np.linalg.norm(way)
            u[free] += du + dl * along
            factor += dl
            u[self._pulled] = factor
        return None

    def commit(self, found: tuple) -> None:
        """Take a step."""
        self.u, self.factor, self._before, self.bonds.reached = found


def arc_length(rows: int, end: float = END) -> States:
    """The path by an arc-length method, with small steps where a point starts to weaken."""
    path, states = ArcLength(rows), [(0.0, 0.0, 0.0)]
    bonds = path.bonds
    arc, most = 0.3 * bonds.d0, 5e-3 * bonds.dc * np.sqrt(len(bonds.area))
    while states[-1][2] < end * TOUGHNESS * (1.0 - NOTCH) * HEIGHT:
        found = path.trial(arc)
        if found is None:
            arc *= 0.5
            if arc < 1e-6 * bonds.d0:
                raise RuntimeError(f"The arc-length method stops at {1e6 * path.factor:g} um.")
            continue
        starts = (found[3] > bonds.d0) & (bonds.reached == bonds.d0)
        if arc > FINE * most and np.any(starts):
            arc *= 0.25
            continue
        path.commit(found)
        states.append((path.factor, path.load, bonds.spent()))
        arc = min(arc * (1.5 if path.iterations < 5 else 0.8), most)
    return States(*np.transpose(states))


def differences(path: States, other: States) -> np.ndarray:
    """Of loads and displacements beside their largest values, shape (2, n), for cracked states."""
    spent, first = np.unique(other.spent, return_index=True)
    cracked = (path.spent > spent[1]) & (path.spent < spent[-1])
    pairs = ((path.load, other.load), (path.moved, other.moved))
    apart = [
        np.abs(mine - PchipInterpolator(spent, theirs[first])(path.spent)) / theirs.max()
        for mine, theirs in pairs
    ]
    return np.array(apart)[:, cracked]


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, default=20, help="facets over the height")
    parser.add_argument("--figure", type=Path)
    options = parser.parse_args(arguments)
    other = arc_length(options.rows)
    facet = TOUGHNESS * HEIGHT / options.rows
    controls = {
        "growth control": xf.GrowthControl(),
        "dissipation control": xf.DissipationControl(0.5 * facet),
    }
    paths = {name: follow(options.rows, control) for name, control in controls.items()}
    back = other.moved.max() - other.moved[other.moved.argmax() :].min()
    print(
        f"arc length: {len(other.load) - 1} steps, peak {1e-3 * other.load.max():.3f} kN/m, "
        f"back by {back / other.moved.max():.3f} of the largest displacement"
    )
    for name, path in paths.items():
        apart = differences(path, other)
        (load, moved), (often, _) = apart.max(axis=1), np.median(apart, axis=1)
        print(
            f"{name}: {len(path.load) - 1} steps, load within {load:.1e} of the peak (median "
            f"{often:.1e}), displacement within {moved:.1e} of the largest"
        )
    if options.figure:

        def fill(figure, axes):
            axes.plot(1e6 * other.moved, 1e-3 * other.load, "k", lw=0.8, label="arc length, apart")
            for mark, (name, path) in zip("o+", paths.items(), strict=True):
                axes.plot(1e6 * path.moved, 1e-3 * path.load, mark, ms=4, mfc="none", label=name)
            axes.set(xlabel="displacement of the end (um)", ylabel="load (kN/m)")
            axes.set_xlim(0.0)
            axes.set_ylim(0.0)
            axes.legend()

        new_figure(options.figure, fill, (5.2, 3.6))


if __name__ == "__main__":
    main()
