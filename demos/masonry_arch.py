# SPDX-License-Identifier: LGPL-3.0-or-later
# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A masonry arch that just stands, and one that just does not
#
# This demo illustrates how to:
#
# - make rigid blocks and let contacts with friction be found between them
# - decide by dynamics whether a structure stands under its own weight
# - check that against limit analysis, a linear programme that shares nothing with it
# - draw rigid bodies, the joints that open and the line of thrust
#
# A semicircular arch of the mean radius R and the thickness t stands if a line of thrust fits into
# it (Heyman 1966). For radial joints without end that asks for t/R >= 0.1075 (Milankovitch 1907).
# An arch of n blocks can only open at its joints, and does with a little less.
#
# The arch is put down as it is, and gravity acts from the first moment on. In that first step each
# joint is closed, all velocities are zero, and what is solved is the question of limit analysis
# itself: are there impulses in the joints, pressing and within Coulomb's cone, that leave all
# blocks at rest? So the answer does not depend on the step, and the bracket can be as narrow as the
# impulses are accurate.

import argparse
import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.collections import PolyCollection
from mpi4py import MPI
from scipy.optimize import linprog
from tqdm.auto import tqdm

import xper_fx as xf

MILANKOVITCH = 0.1075
GRAVITY = 9.81
RADIUS = 1.0
DENSITY = 2000.0

# ## The arch


@dataclass(frozen=True)
class Arch:
    """A semicircular arch of equal voussoirs with plane faces.

    Args:
        blocks: number of voussoirs.
        ratio: thickness over mean radius.
        friction: Coulomb's mu in the joints.
    """

    blocks: int
    ratio: float
    friction: float = 0.7

    @property
    def directions(self) -> np.ndarray:
        """Unit vectors along the joints, from the right springing on, shape (blocks + 1, 2)."""
        angle = np.pi * np.arange(self.blocks + 1) / self.blocks
        return np.column_stack([np.cos(angle), np.sin(angle)])

    @property
    def ends(self) -> np.ndarray:
        """Inner and outer end of each joint, shape (blocks + 1, 2, 2), m."""
        radii = RADIUS * np.array([1.0 - 0.5 * self.ratio, 1.0 + 0.5 * self.ratio])
        return radii[:, None] * self.directions[:, None]

    @property
    def voussoirs(self) -> list[xf.rigid.Polygon]:
        """From right to left: inner and outer end of a joint, outer and inner end of the next."""
        low, high = self.ends[:-1], self.ends[1:]
        return [xf.rigid.Polygon([a[0], a[1], b[1], b[0]]) for a, b in zip(low, high, strict=True)]


# ## Limit analysis
#
# Each joint passes a pressing force at either end and a shear force within Coulomb's cone. Three
# equations of equilibrium a block are linear in them: the arch can stand if the programme has a
# solution, whatever it is to minimise.


def can_stand(arch: Arch) -> bool:
    """Whether forces in the joints can balance the weight of every block."""
    along, n = arch.directions, arch.blocks
    normal = np.column_stack([-along[:, 1], along[:, 0]])
    # of a joint: pressing at its inner end, at its outer end, shear at its inner end
    force = np.stack([normal, normal, along], axis=1)
    point = arch.ends[:, [0, 1, 0]]
    balance, weight = np.zeros((n, 3, n + 1, 3)), np.zeros((n, 3))
    for k, block in enumerate(arch.voussoirs):
        mass, centre, _ = block.mass_properties(1.0 / RADIUS**2)
        weight[k, 1] = mass
        for joint, sign in ((k, 1.0), (k + 1, -1.0)):
            arm, f = point[joint] - centre, sign * force[joint]
            balance[k, :2, joint] = f.T
            balance[k, 2, joint] = (arm[:, 0] * f[:, 1] - arm[:, 1] * f[:, 0]) / RADIUS
    mu = arch.friction
    cone = np.kron(np.eye(n + 1), [[-mu, -mu, 1.0], [-mu, -mu, -1.0]])
    answer = linprog(
        np.zeros(3 * (n + 1)),
        A_ub=cone, b_ub=np.zeros(len(cone)),
        A_eq=balance.reshape(3 * n, -1), b_eq=weight.ravel(),
        bounds=[(0.0, None), (0.0, None), (None, None)] * (n + 1),
        method="highs",
    )  # fmt: skip
    return answer.status == 0


def least_ratio(blocks: int, friction: float = 0.7) -> float:
    """The least thickness over mean radius with which an arch of so many blocks can stand."""
    low, high = 0.01, 0.5
    while high - low > 1e-6:
        middle = 0.5 * (low + high)
        if can_stand(Arch(blocks, middle, friction)):
            high = middle
        else:
            low = middle
    return high


# ## Dynamics
#
# An arch stands if in two seconds, several times what the fall of another takes, no block has moved
# by a hundredth of the thickness. It falls once a block has moved by a quarter of the radius.

END, STOOD, FALLEN = 2.0, 0.01, 0.25


def simulate(arch: Arch, step: float) -> xf.Simulation:
    """The arch between two fixed blocks, its own weight the only load."""
    law = xf.laws.SignoriniCoulomb(friction=arch.friction)
    bodies = [xf.RigidBody(block, None, "voussoirs", density=DENSITY) for block in arch.voussoirs]
    height = 0.1 * RADIUS
    base = xf.rigid.Polygon.box((2.0 * arch.ratio * RADIUS, height))
    for side in (1.0, -1.0):
        held = dict.fromkeys(range(3), 0.0)
        place = (side * RADIUS, -0.5 * height)
        bodies.append(xf.RigidBody(base, place, "springings", prescribed=held))
    scene = xf.Scene(
        rigid=bodies,
        contacts=[
            xf.Contact(("voussoirs", "voussoirs"), law),
            xf.Contact(("voussoirs", "springings"), law),
        ],
        loads=[xf.Gravity((0.0, -GRAVITY))],
    )
    return xf.Simulation(scene, step, tolerance=1e-5, num_threads=1)


@dataclass(frozen=True)
class Outcome:
    """What became of an arch.

    Attributes:
        arch: which one.
        verdict: "stands", "falls" or "undecided".
        moved: largest displacement of a voussoir's centre (m).
        time: at the end (s).
        kinetic: energy at the end (J/m).
        positions: vertices of each body, the springings last.
        thrust: shape (joints, 2), where the force of each joint passes, m.
        hinges: (joint, end) of those joints that have opened at one end and press at the other,
            end being 0 for the inner one.
    """

    arch: Arch
    verdict: str
    moved: float
    time: float
    kinetic: float
    positions: list[np.ndarray]
    thrust: np.ndarray
    hinges: list[tuple[int, int]]


def run(arch: Arch, step: float) -> Outcome:
    """Let gravity act until the arch has fallen or has stood long enough."""
    simulation = simulate(arch, step)
    motion = simulation.rigid
    start = motion.state.position.copy()
    moved = 0.0
    for _ in simulation.steps(END):
        moved = float(np.linalg.norm(motion.state.position - start, axis=1).max())
        if moved > FALLEN * RADIUS:
            break
    size = arch.ratio * RADIUS
    verdict = "stands" if moved < STOOD * size else "undecided"
    verdict = "falls" if moved > FALLEN * RADIUS else verdict
    drawn = xf.rigid.body_outlines(motion.bodies)
    points = drawn.positions(motion.state.position, motion.state.turn.rotation)
    cuts = np.flatnonzero(np.diff(drawn.body_of_point)) + 1
    positions = np.split(points, cuts)
    return Outcome(
        arch, verdict, moved, simulation.time, motion.kinetic, positions,
        thrust_points(simulation), open_hinges(arch, positions),
    )  # fmt: skip


def thrust_points(simulation: xf.Simulation) -> np.ndarray:
    """The point of each joint through which its force passes, mean of its contacts by pressure."""
    contacts = xf.output.find_contact_forces(simulation)
    sums: dict[tuple[int, ...], np.ndarray] = {}
    pressures = np.einsum("nd,nd->n", contacts.force, contacts.normal)
    for pair, place, pressure in zip(contacts.bodies, contacts.position, pressures, strict=True):
        key = tuple(sorted(pair.tolist()))
        sums[key] = sums.get(key, np.zeros(3)) + pressure * np.array([*place, 1.0])
    return np.array([total[:2] / total[2] for total in sums.values()])


def open_hinges(arch: Arch, positions: list[np.ndarray]) -> list[tuple[int, int]]:
    """Joints that one end has opened by a fiftieth of the thickness more than the other."""
    size, n = arch.ratio * RADIUS, arch.blocks
    hinges = []
    for joint in range(n + 1):
        if joint in (0, n):
            block = positions[0] if joint == 0 else positions[n - 1]
            opening = (block[[0, 1]] if joint == 0 else block[[3, 2]])[:, 1]
        else:
            before, after = positions[joint - 1][[3, 2]], positions[joint][[0, 1]]
            opening = np.linalg.norm(after - before, axis=1)
        if abs(opening[0] - opening[1]) > 0.02 * size:
            hinges.append((joint, int(np.argmin(opening))))
    return hinges


# ## Figures


def draw_arch(axes, outcome: Outcome, title: str) -> None:
    """The blocks, hinges of an arch that falls, the line of thrust of one that stands."""
    n = outcome.arch.blocks
    colours = ["#d8cbb4", "#c4b394"] * n
    axes.add_collection(
        PolyCollection(
            outcome.positions, facecolors=[*colours[:n], "#858585", "#858585"],
            edgecolors="#4d4d4d", linewidths=0.5,
        )
    )  # fmt: skip
    if outcome.verdict == "stands":
        x, y = outcome.thrust.T
        order = np.argsort(np.arctan2(np.abs(y), x))  # at a springing y is rounding of any sign
        axes.plot(
            *outcome.thrust[order].T, color=xf.plotting.COLOURS[1], lw=1.2, label="line of thrust"
        )
    for number, (joint, end) in enumerate(outcome.hinges):
        block = outcome.positions[joint if joint < n else n - 1]
        place = block[(0, 1)[end] if joint < n else (3, 2)[end]]
        axes.plot(
            *place,
            "o",
            color=xf.plotting.COLOURS[0],
            ms=4.0,
            label=None if number else "hinges",
            zorder=3,
        )
    limit = RADIUS * (1.1 + outcome.arch.ratio)
    axes.set(
        xlim=(-limit, limit), ylim=(-0.12 * RADIUS, limit), aspect="equal", title=title,
        xlabel="x (m)", ylabel="y (m)",
    )  # fmt: skip
    if outcome.hinges or outcome.verdict == "stands":
        axes.legend(loc="center")


def draw(pairs: list[tuple[Outcome, ...]], bounds: dict[int, float], out: Path) -> None:
    """The arches of the largest number of blocks, and all verdicts beside limit analysis."""

    def fill(_, axes):
        for place, outcome in zip(axes, pairs[-1], strict=False):
            share = 100.0 * (outcome.arch.ratio / bounds[outcome.arch.blocks] - 1.0)
            draw_arch(
                place, outcome,
                f"{outcome.verdict} at t/R = {outcome.arch.ratio:.4f} ({share:+.1f} %), "
                f"{outcome.time:.2f} s",
            )  # fmt: skip
        numbers = sorted(bounds)
        axes[2].axhline(MILANKOVITCH, color="#858585", lw=0.8, label="Milankovitch (1907)")
        axes[2].plot(
            numbers, [bounds[n] for n in numbers], "_", ms=9.0, color=xf.plotting.COLOURS[6],
            label="limit analysis",
        )  # fmt: skip
        for verdict, marker, colour in (
            ("stands", "^", xf.plotting.COLOURS[2]),
            ("falls", "v", xf.plotting.COLOURS[1]),
        ):
            found = [o.arch for pair in pairs for o in pair if o.verdict == verdict]
            axes[2].plot(
                [arch.blocks for arch in found], [arch.ratio for arch in found], marker,
                ms=4.0, color=colour, label=verdict,
            )  # fmt: skip
        axes[2].set(xlabel="voussoirs", ylabel="t/R", title="thickness that just stands")
        axes[2].legend()

    xf.plotting.new_figure(out / "masonry_arch.png", fill, (12.0, 3.6), ncols=3)


# ## Command line


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Options of the demo."""
    parser = argparse.ArgumentParser(description="A masonry arch at its least thickness.")
    add = parser.add_argument
    add(
        "--blocks", type=int, nargs="+", default=[7, 8, 11, 12, 15, 16, 21, 30],
        help="numbers of voussoirs; the last one is drawn",
    )  # fmt: skip
    add("--margin", type=float, default=0.03, help="above and below limit analysis (default 0.03)")
    add("--ratio", type=float, help="t/R of one arch of the last number of blocks, and no others")
    add("--friction", type=float, default=0.7, help="Coulomb's mu in the joints (default 0.7)")
    add("--step", type=float, default=2e-3, help="s (default 2e-3)")
    add("--out", type=Path, default=Path("results/masonry_arch"))
    add("--no-plot", action="store_true")
    add("--quiet", action="store_true", help="no progress bar")
    options = parser.parse_args(arguments)
    if min(options.blocks) < 3:
        parser.error(f"--blocks should be at least 3, got {min(options.blocks)}")
    if not 0.0 < options.margin < 0.5:
        parser.error(f"--margin should lie between 0 and 0.5, got {options.margin}")
    if options.ratio is not None and not 0.0 < options.ratio < 1.0:
        parser.error(f"--ratio should lie between 0 and 1, got {options.ratio}")
    return options


def main(arguments: list[str] | None = None) -> dict:
    """Bracket the least thickness by dynamics; returns bounds and pairs of outcomes."""
    options = parse(arguments)
    xf.prepare_folder(options.out)
    blocks = options.blocks if options.ratio is None else options.blocks[-1:]
    bounds = {n: least_ratio(n, options.friction) for n in blocks}
    pairs, rows = [], []
    for n in tqdm(blocks, disable=options.quiet):
        above = Arch(n, (1.0 + options.margin) * bounds[n], options.friction)
        below = replace(above, ratio=(1.0 - options.margin) * bounds[n])
        arches = (above, below) if options.ratio is None else (replace(above, ratio=options.ratio),)
        pairs.append(tuple(run(arch, options.step) for arch in arches))
        for outcome in pairs[-1]:
            size = outcome.arch.ratio * RADIUS
            rows.append(
                {
                    "blocks": n,
                    "limit_analysis": bounds[n],
                    "ratio": outcome.arch.ratio,
                    "verdict": outcome.verdict,
                    "moved_over_thickness": outcome.moved / size,
                    "time": outcome.time,
                    "hinges": outcome.hinges,
                }
            )
            print(
                f"{n:3d} voussoirs, t/R = {outcome.arch.ratio:.5f} (limit analysis "
                f"{bounds[n]:.5f}): {outcome.verdict}, moved by {outcome.moved / size:.1e} t "
                f"after {outcome.time:.2f} s"
            )
    if MPI.COMM_WORLD.rank == 0:
        (options.out / "summary.json").write_text(json.dumps(rows, indent=1))
        if not options.no_plot:
            draw(pairs, bounds, options.out)
    return {"bounds": bounds, "pairs": pairs}


if __name__ == "__main__":
    xf.run_together(main)
