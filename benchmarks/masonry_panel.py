# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Panels of bricks and mortar under weight and shear: load against displacement, limit analysis.

    ./fenicsx python3 benchmarks/masonry_panel.py [--cells 1 2] [--figure FILE]

Bricks of 0.2 m x 0.1 m, meshed and elastic, lie in running bond between a base that is held and a
beam that is pushed sideways, slowly beside what waves need. Bed joints are `MohrCoulomb`: friction,
cohesion that is lost by slip, a brittle tension cut-off; numbers are those of Lourenco and Rots
(1997) where nothing else is said. Head joints touch and carry neither shear nor tension, as Mann
and Mueller (1982) have it. The beam presses on the wall by p from the start (`InitialStress`):
nothing moves before the push.

- **rocks**: a panel as high as long, whose beam may turn;
- **slides**: the same with weak, smooth joints;
- **steps**: the beam keeps its height and does not turn, so that pressure grows with the push.

The load is compared with a **limit analysis** of rigid bricks with associated friction: the largest
load with which forces within the cones are in balance, by a linear programme, once with all joints
sound and once with all of them broken,

    max H:  sum of forces and moments on each brick = 0,  |T| <= mu N + c A,  N >= -sigma_t A,

forces acting at both ends of a bed joint. Mortar that softens and breaks reaches less than the
first. A panel whose beam may turn and whose joints are broken rocks with

    H = (P + weights) b / 2 / height

about its toe, or less by steps, and one that slides bears mu (P + weight above the joint that
slides). Where the beam is kept level, P is the one measured with the load.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from dolfinx.mesh import CellType, create_rectangle
from mpi4py import MPI
from scipy.optimize import linprog

import xper_fx as xf
from xper_fx.plotting.figures import COLOURS, new_figure

LENGTH, HEIGHT = 0.2, 0.1
BRICK = xf.materials.LinearElastic(16.7e9, 0.15, 1900.0, plane="stress")
GRAVITY, SPEED, RAMP = 9.81, 0.01, 0.05
DAMPING = 30.0  # 1/s, times the mass: 1 kN beside loads of 90 and more
TOLERANCE = 1e-9  # of impulses; joints under pressure creep with the usual one
MAGNIFIED = 30.0
BASE, BEAM, HEADS = 1, 2, 3


class Panel(NamedTuple):
    """A wall between its base and its beam.

    Attributes:
        name: of the panel.
        friction, cohesion, tension: of bed joints (Pa).
        level: whether the beam keeps its height and does not turn.
        width, courses: bricks along and across.
        pressure: p (Pa).
        slip: after which the cohesion is lost (m).
        end: displacement of the beam at the end (m).
    """

    name: str
    friction: float = 0.75
    cohesion: float = 0.35e6
    tension: float = 0.25e6
    level: bool = False
    width: int = 5
    courses: int = 10
    pressure: float = 0.3e6
    slip: float = 0.7e-3
    end: float = 3e-3

    @property
    def length(self) -> float:
        """Of the panel (m)."""
        return self.width * LENGTH

    @property
    def bricks(self) -> np.ndarray:
        """Left, right, lower and upper side of each brick, the base first, the beam last (m)."""
        length, top = self.length, self.courses * HEIGHT
        rows = [(0.0, length, -HEIGHT, 0.0)]
        for course in range(self.courses):
            ends = LENGTH * (np.arange(self.width + 1 + course % 2) - 0.5 * (course % 2))
            ends = np.clip(ends, 0.0, length)
            low = course * HEIGHT
            rows += [(a, b, low, low + HEIGHT) for a, b in zip(ends[:-1], ends[1:], strict=True)]
        return np.array([*rows, (0.0, length, top, top + HEIGHT)])

    @property
    def mortar(self) -> xf.laws.MohrCoulomb:
        """Law of the bed joints."""
        return xf.laws.MohrCoulomb(self.friction, self.cohesion, self.tension, self.slip)


PANELS = (
    Panel("rocks"),
    Panel("slides", friction=0.3, cohesion=0.1e6, tension=0.05e6),
    Panel("steps", friction=0.5, cohesion=0.15e6, tension=0.1e6, level=True),
)


def wall(panel: Panel, cells: int) -> xf.Scene:
    """The panel under its weight, the pressure and the push.

    Args:
        panel: the panel.
        cells: quadrilaterals over the height of a brick.
    """
    length, top = panel.length, panel.courses * HEIGHT
    corners = [np.array([0.0, -HEIGHT]), np.array([length, top + HEIGHT])]
    counts = [2 * cells * panel.width, cells * (panel.courses + 2)]
    mesh = create_rectangle(MPI.COMM_SELF, corners, counts, CellType.quadrilateral)
    middle = mesh.geometry.x[xf.geometry_dofmap(mesh)].mean(axis=1)[:, :, None]
    left, right, low, high = panel.bricks.T
    x, y = middle[:, 0], middle[:, 1]
    brick = np.argmax((left < x) & (x < right) & (low < y) & (y < high), axis=1)

    def upright(x: np.ndarray) -> np.ndarray:
        """Where bricks end or have their middles, within the courses."""
        halves = x[0] / (0.5 * LENGTH)
        return (abs(halves - np.round(halves)) < 1e-6) & (x[1] > -1e-6) & (x[1] < top + 1e-6)

    facets = xf.tag_facets(
        mesh,
        {
            BASE: lambda x: x[1] < 1e-6 - HEIGHT,
            BEAM: lambda x: x[1] > top + HEIGHT - 1e-6,
            HEADS: upright,
        },
    )

    def start(x: np.ndarray) -> np.ndarray:
        stress = np.zeros((2, 2, x.shape[1]))
        stress[1, 1] = BRICK.density * GRAVITY * (x[1] - top - HEIGHT) - panel.pressure
        return stress

    held = [xf.PrescribedVelocity(BASE, i, 0.0) for i in range(2)]
    pressed = xf.SurfaceTraction(BEAM, (0.0, -panel.pressure))
    return xf.Scene(
        xf.explode(mesh, brick, facet_tags=facets),
        {1: BRICK},
        default_interaction=panel.mortar,
        facet_interactions={HEADS: xf.laws.SignoriniCoulomb(contact="position")},
        loads=[
            *held,
            xf.PrescribedVelocity(BEAM, 0, lambda t: SPEED * min(t / RAMP, 1.0)),
            xf.PrescribedVelocity(BEAM, 1, 0.0) if panel.level else pressed,
            xf.Gravity((0.0, -GRAVITY)),
            xf.InitialStress(start),
        ],
        damping=xf.RayleighDamping(DAMPING),
    )


def limit(panel: Panel, sound: bool, thrust: float) -> float:
    """The largest load of rigid bricks with associated friction (N/m).

    Args:
        panel: the panel.
        sound: whether joints have their cohesion and tension.
        thrust: P on the beam (N/m).
    """
    bricks = panel.bricks
    count = len(bricks)
    centre = 0.5 * (bricks[:, ::2] + bricks[:, 1::2])
    joints = []  # place, normal, upper or right brick, lower or left brick, share of the area
    for i, (left, right, low, high) in enumerate(bricks):
        for j, (left_j, right_j, low_j, high_j) in enumerate(bricks):
            first, last = max(left, left_j), min(right, right_j)
            if np.isclose(low, high_j) and last - first > 1e-9:
                area = 0.5 * (last - first)
                joints += [((x, low), (0.0, 1.0), i, j, area) for x in (first, last)]
            if np.isclose(left, right_j) and np.isclose(low, low_j):
                joints += [((left, y), (1.0, 0.0), i, j, 0.0) for y in (low, high)]
    balance = np.zeros((3 * count, 2 * len(joints)))
    for k, (place, normal, *sides, _) in enumerate(joints):
        for column, axis in ((2 * k, normal), (2 * k + 1, (normal[1], -normal[0]))):
            for sign, brick in zip((1.0, -1.0), sides, strict=True):
                arm = np.array(place) - centre[brick]
                couple = arm[0] * axis[1] - arm[1] * axis[0]
                balance[3 * brick : 3 * brick + 3, column] += sign * np.array([*axis, couple])
    load = np.zeros(3 * count)
    load[1::3] = -np.prod(bricks[:, 1::2] - bricks[:, ::2], axis=1) * BRICK.density * GRAVITY
    load[-2] -= thrust
    push = np.zeros((3 * count, 1))
    push[-3], push[-1] = 1.0, -0.5 * HEIGHT  # on the upper side of the beam
    rows = np.arange(3, 3 * count - panel.level)
    areas = sound * np.array([joint[-1] for joint in joints])
    bed = np.array([joint[1][1] for joint in joints])
    unit = np.eye(2 * len(joints))
    cone = np.vstack([s * unit[1::2] - panel.friction * bed[:, None] * unit[::2] for s in (1, -1)])
    bounds = [b for a in areas for b in ((-panel.tension * a, None), (None, None))]
    answer = linprog(
        np.append(np.zeros(2 * len(joints)), -1.0),
        A_ub=sp.csr_array(np.hstack([cone, np.zeros((len(cone), 1))])),
        b_ub=panel.cohesion * np.tile(areas, 2),
        A_eq=sp.csr_array(np.hstack([balance, push])[rows]), b_eq=-load[rows],
        bounds=[*bounds, (0.0, None)], method="highs",
    )  # fmt: skip
    return float(answer.x[-1])


class Push(NamedTuple):
    """How a panel bears the push.

    Attributes:
        panel: the panel.
        moved: displacement of the beam (m), at some of the steps.
        load: H, shape as `moved` (N/m).
        thrust: P on the beam (N/m).
        closure: of the ledger, over the work of the loads.
        cells: corners of each quadrilateral, at the start and at the end, shape (2, n, 4, 2), m.
        brick: of each quadrilateral, shape (n,).
        seconds: that the run took.
    """

    panel: Panel
    moved: np.ndarray
    load: np.ndarray
    thrust: np.ndarray
    closure: float
    cells: np.ndarray
    brick: np.ndarray
    seconds: float

    @property
    def residual(self) -> float:
        """Mean load over the last tenth of the push (N/m)."""
        return float(self.load[self.moved > 0.9 * self.moved[-1]].mean())

    @property
    def sliding(self) -> float:
        """mu times the pressing force on the bed that has slipped the most (N/m)."""
        start, moved = self.cells[0], self.cells[1] - self.cells[0]
        course = np.floor(start[:, :, 1].mean(axis=1) / HEIGHT).astype(int) + 1
        mean = np.bincount(course, moved[:, :, 0].mean(axis=1)) / np.bincount(course)
        above = self.panel.courses + 1 - np.argmax(np.diff(mean))
        weight = above * self.panel.length * HEIGHT * BRICK.density * GRAVITY
        late = self.moved > 0.9 * self.moved[-1]
        return self.panel.friction * (self.thrust[late].mean() + weight)


def push(panel: Panel, cells: int) -> Push:
    """Push the beam.

    Args:
        panel: the panel.
        cells: quadrilaterals over the height of a brick.
    """
    simulation = xf.Simulation(
        wall(panel, cells), scheme="explicit", tolerance=TOLERANCE, num_threads=1
    )
    start, told = perf_counter(), []
    for record in simulation.steps(panel.end / SPEED + 0.5 * RAMP):
        if record.step % 20 == 0:
            moved, (load, lift) = simulation.mean_displacement(BEAM)[0], simulation.reaction(BEAM)
            told.append((moved, load, -lift if panel.level else panel.pressure * panel.length))
    seconds = perf_counter() - start
    bodies, V = simulation.scene.bodies, simulation.forms.V
    x = V.tabulate_dof_coordinates()[:, :2]
    moved = x + simulation.state.displacement.reshape(-1, 2)
    around = V.dofmap.list[:, [0, 1, 3, 2]]
    energies = record.energies
    return Push(
        panel, *np.array(told).T, energies["closure"] / energies["external_work"],
        np.array([x[around], moved[around]]), bodies.labels[bodies.body_of_cell], seconds,
    )  # fmt: skip


def report(found: Push) -> str:
    """One line."""
    panel, peak = found.panel, int(np.argmax(found.load))
    sound = limit(panel, True, found.thrust[peak])
    broken = limit(panel, False, found.thrust[-1])
    residual = found.residual
    return (
        f"{panel.name}: peak {1e-3 * found.load[peak]:.1f} kN/m at "
        f"{1e3 * found.moved[peak]:.2f} mm, "
        f"{found.load[peak] / sound:.3f} of the limit of sound joints ({1e-3 * sound:.1f}); then "
        f"{1e-3 * residual:.1f}, {residual / broken:.3f} of the limit of broken ones "
        f"({1e-3 * broken:.1f}), {residual / found.sliding:.3f} of sliding on the bed that slips "
        f"most; ledger off by {abs(found.closure):.0e}; {found.seconds:.0f} s"
    )


def draw(runs: list[Push], path: Path) -> None:
    """Load against displacement, and the panels at the end."""
    from matplotlib.collections import PolyCollection

    def drawn(figure: Any, axes: Any) -> None:
        for colour, run in zip(COLOURS, runs, strict=False):
            axes[0].plot(1e3 * run.moved, 1e-3 * run.load, color=colour, label=run.panel.name)
            broken = limit(run.panel, False, run.thrust[-1])
            axes[0].axhline(1e-3 * broken, color=colour, linestyle=":")
        axes[0].set(
            xlabel="displacement of the beam (mm)",
            ylabel="load (kN/m); dotted: limit of broken joints", ylim=(0.0, None),
        )  # fmt: skip
        axes[0].legend()
        for ax, run in zip(axes[1:], runs, strict=False):
            start, end = run.cells
            shown = start + MAGNIFIED * (end - start)
            shades = np.where(run.brick % 2 == 0, 0.8, 0.6)
            ends = (run.brick == 0) | (run.brick == run.brick.max())
            colours = np.where(ends, 0.35, shades)[:, None] * np.ones(3)
            ax.add_collection(PolyCollection(shown, facecolors=colours, edgecolors=colours))
            ax.set(aspect="equal", title=f"{run.panel.name}, displacements x {MAGNIFIED:g}")
            ax.autoscale_view()
            ax.set_axis_off()

    new_figure(path, drawn, (12.0, 3.6), ncols=4, width_ratios=[1.4, 1, 1, 1])


def main() -> None:
    """Run, report, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--cells", type=int, nargs="+", default=[1, 2], help="over the height of a brick"
    )
    parser.add_argument("--figure", type=Path, help="of the last number of cells")
    arguments = parser.parse_args()
    for cells in arguments.cells:
        print(f"{cells} over the height of a brick")
        runs = []
        for panel in PANELS:
            runs.append(push(panel, cells))
            print(report(runs[-1]), flush=True)
    if arguments.figure:
        draw(runs, arguments.figure)


if __name__ == "__main__":
    main()
