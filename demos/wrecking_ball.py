# SPDX-License-Identifier: LGPL-3.0-or-later
# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A wrecking ball, a plain column and a post-tensioned one
#
# This demo illustrates how to:
#
# - hang a ball on a chain of bars that hinges join
# - put a tendon with a prestress through a column of blocks
# - read what hinges and tendons bear
# - draw rigid bodies and wires
#
# A ball of a tonne swings on a chain into a column of ten blocks. The plain column comes apart: of
# contacts alone, its joints bear no tension. A tendon from the ground to the top block presses the
# blocks of the other column together with the force T. It rocks as a whole and comes back, as every
# joint that opens stretches the tendon.
#
# Before anything opens, a column of the weight W and the width b that is pushed by F at the height
# h rocks at F h = (W + T) b / 2 (`tests/scene/test_joints.py`).

import argparse
import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from mpi4py import MPI
from tqdm.auto import tqdm

import xper_fx as xf

GRAVITY, DENSITY = 9.81, 2000.0
# The column: blocks, their width and height (m); the chain: links, the place it hangs from (m).
BLOCKS, WIDTH, HEIGHT = 10, 0.6, 0.3
LINKS, CRANE = 12, (-0.75, 5.2)
# The ball: radius (m), mass (kg), angle of the chain from which it is let go (rad).
RADIUS, MASS, ANGLE = 0.4, 1000.0, -1.2
# A bar of steel, 300 mm^2 over the height of the column.
STIFFNESS = 2e7

# Shares of the time at which the bodies are drawn.
SHOWN = (0.02, 0.55, 1.0)

# ## The scene


class Demolition(NamedTuple):
    """A scene and where its joints are in the list.

    Attributes:
        scene: ball, chain and column on the ground.
        tendon: number of the tendon among the joints, None in the plain column.
    """

    scene: xf.Scene
    tendon: int | None


def demolition(prestress: float) -> Demolition:
    """The ball at rest on its straight chain, and the column; a prestress (N/m) of zero is none."""
    stone = xf.rigid.Polygon.box((WIDTH, HEIGHT))
    blocks = [
        xf.RigidBody(stone, (0.0, (i + 0.5) * HEIGHT), "blocks", density=DENSITY)
        for i in range(BLOCKS)
    ]
    along = np.array([np.sin(ANGLE), -np.cos(ANGLE)])
    length = CRANE[1] - 0.75 * BLOCKS * HEIGHT - RADIUS
    nodes = np.array(CRANE) + np.linspace(0.0, length, LINKS + 1)[:, None] * along
    bar = xf.rigid.Polygon.box((length / LINKS, 0.04))
    links = [
        xf.RigidBody(bar, middle, "chain", angle=ANGLE - np.pi / 2, density=7800.0)
        for middle in 0.5 * (nodes[1:] + nodes[:-1])
    ]
    ball = xf.RigidBody(xf.rigid.Disc(RADIUS), nodes[-1] + RADIUS * along, "ball", mass=MASS)
    ground = xf.rigid.wall((0.0, 0.0), (0.0, 1.0), "ground")
    pairs = zip([None, *links], [*links, ball], nodes, strict=True)
    joints: list[xf.Hinge | xf.Tendon] = [
        xf.Hinge((first, second), node) for first, second, node in pairs
    ]
    tendon = None
    if prestress:
        tendon = len(joints)
        ends = (0.0, -0.5), (0.0, BLOCKS * HEIGHT)
        joints.append(xf.Tendon((None, blocks[-1]), ends, stiffness=STIFFNESS, prestress=prestress))
    law = xf.laws.SignoriniCoulomb(friction=0.6)
    contacts = [
        xf.Contact(("blocks", other), law) for other in ("blocks", "ball", "ground", "chain")
    ]
    contacts += [xf.Contact(("ball", "ground"), law), xf.Contact(("chain", "ball"), None)]
    contacts += [xf.Contact(("chain", other), None) for other in ("chain", "ground")]
    scene = xf.Scene(
        rigid=[*blocks, *links, ball, ground],
        joints=joints,
        contacts=contacts,
        loads=[xf.Gravity((0.0, -GRAVITY))],
    )
    return Demolition(scene, tendon)


# ## The run


class Outcome(NamedTuple):
    """What became of a column.

    Attributes:
        prestress: of its tendon (N/m).
        time, lean, tension, pull: of each step: time (s), way of the top block (m), tension of the
            tendon, force in the uppermost hinge of the chain (N/m).
        frames: time, outlines of all bodies and ends of the tendon at the times `SHOWN`.
        closure: error of the energy balance over the largest kinetic energy.
    """

    prestress: float
    time: np.ndarray
    lean: np.ndarray
    tension: np.ndarray
    pull: np.ndarray
    frames: list[tuple[float, list[np.ndarray], np.ndarray]]
    closure: float


def run(prestress: float, step: float, end: float, quiet: bool) -> Outcome:
    """Let the ball go."""
    scene, tendon = demolition(prestress)
    simulation = xf.Simulation(scene, step)
    drawn = xf.rigid.body_outlines(simulation.rigid.bodies)
    turns = np.linspace(0.0, 2.0 * np.pi, 60)
    circle = RADIUS * np.column_stack([np.cos(turns), np.sin(turns)])
    cuts = np.flatnonzero(np.diff(drawn.body_of_point)) + 1
    rows, frames, kinetic, due = [], [], 0.0, [share * end for share in SHOWN]
    total = int(np.ceil(end / step))
    for record in tqdm(simulation.steps(end), total=total, disable=quiet):
        state = simulation.rigid.state
        force = np.linalg.norm(xf.output.find_joint_forces(simulation).force, axis=1)
        top = state.position[BLOCKS - 1, 0]
        rows.append((record.time, top, 0.0 if tendon is None else force[tendon], force[0]))
        kinetic = max(kinetic, record.energies["kinetic"])
        if due and record.time >= due[0] - 0.5 * step:
            del due[0]
            angle = state.turn.rotation
            outlines = np.split(drawn.positions(state.position, angle), cuts)
            outlines[BLOCKS + LINKS] = state.position[BLOCKS + LINKS] + circle
            up = 0.5 * HEIGHT * np.array([-np.sin(angle[BLOCKS - 1]), np.cos(angle[BLOCKS - 1])])
            wire = np.array([(0.0, 0.0), state.position[BLOCKS - 1] + up])
            frames.append((record.time, outlines, wire if prestress else np.zeros((0, 2))))
    time, lean, tension, pull = np.array(rows).T
    closure = abs(simulation.ledger.closure) / kinetic
    return Outcome(prestress, time, lean, tension, pull, frames, closure)


# ## Figure


def draw(outcomes: list[Outcome], out: Path) -> None:
    """Each column at three times, and the way of its top block."""

    shades = ["#d8cbb4", "#c4b394"] * (BLOCKS // 2) + ["#6d6d6d"] * (LINKS + 1)

    def fill(_, axes):
        for row, outcome in zip(axes, outcomes, strict=True):
            for place, (time, outlines, wire) in zip(row, outcome.frames, strict=False):
                place.add_collection(
                    PolyCollection(outlines, facecolors=shades, edgecolors="#4d4d4d", lw=0.5)
                )
                if len(wire):
                    place.add_collection(
                        LineCollection([wire], colors=xf.plotting.COLOURS[1], lw=1.5)
                    )
                place.axhline(0.0, color="#4d4d4d", lw=0.8)
                place.set(
                    xlim=(-4.6, 3.4), ylim=(-0.2, 5.4), aspect="equal", title=f"{time:.2f} s",
                    xticks=[], yticks=[],
                )  # fmt: skip
            row[0].set_ylabel("post-tensioned" if outcome.prestress else "plain")
            row[-1].plot(outcome.time, outcome.lean, label="way of the top block (m)")
            row[-1].plot(outcome.time, outcome.pull / 1e5, label="pull of the chain (100 kN/m)")
            if outcome.prestress:
                row[-1].plot(outcome.time, outcome.tension / 1e6, label="tension (MN/m)")
            row[-1].set(xlabel="time (s)", ylim=(-0.6, 1.6))
            row[-1].legend(fontsize="small")

    xf.plotting.new_figure(out / "wrecking_ball.png", fill, (13.0, 5.2), nrows=2, ncols=4)


# ## Command line


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Options of the demo."""
    parser = argparse.ArgumentParser(description="A wrecking ball and two columns.")
    add = parser.add_argument
    add("--prestress", type=float, default=2e5, help="of the tendon, N/m (default 2e5)")
    add("--step", type=float, default=1e-3, help="s (default 1e-3)")
    add("--end", type=float, default=1.8, help="s (default 1.8)")
    add("--out", type=Path, default=Path("results/wrecking_ball"))
    add("--no-plot", action="store_true")
    add("--quiet", action="store_true", help="no progress bar")
    options = parser.parse_args(arguments)
    if not options.prestress > 0.0:
        parser.error(f"--prestress should be above zero, got {options.prestress}")
    return options


def main(arguments: list[str] | None = None) -> list[Outcome]:
    """Run both columns; returns their outcomes, the plain one first."""
    options = parse(arguments)
    xf.prepare_folder(options.out)
    outcomes = [
        run(prestress, options.step, options.end, options.quiet)
        for prestress in (0.0, options.prestress)
    ]
    rows = [
        {
            "prestress": outcome.prestress,
            "lean_at_end": float(outcome.lean[-1]),
            "largest_lean": float(np.abs(outcome.lean).max()),
            "largest_tension": float(outcome.tension.max()),
            "largest_pull": float(outcome.pull.max()),
            "closure": outcome.closure,
        }
        for outcome in outcomes
    ]
    for row in rows:
        print(
            f"prestress {row['prestress']:9.3g} N/m: top block at {row['lean_at_end']:+.3f} m, at "
            f"most {row['largest_lean']:.3f} m; tension {row['largest_tension']:.3g}, pull of the "
            f"chain {row['largest_pull']:.3g} N/m; closure {row['closure']:.1e}"
        )
    if MPI.COMM_WORLD.rank == 0:
        (options.out / "summary.json").write_text(json.dumps(rows, indent=1))
        if not options.no_plot:
            draw(outcomes, options.out)
    return outcomes


if __name__ == "__main__":
    xf.run_together(main)
