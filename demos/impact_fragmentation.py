# SPDX-License-Identifier: LGPL-3.0-or-later
# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A slab broken by a falling ball, and the heap of its pieces
#
# This demo illustrates how to:
#
# - let a rigid body strike a mesh whose cells are bodies bonded by a cohesive law
# - name contacts between groups, so that broken pieces meet again far from where they parted
# - measure fragments, and find contacts between cells that were no neighbours
#
# A slab lies on two rigid supports; a rigid disc falls on its middle. The slab breaks, and its
# pieces fall between the supports, strike each other, the supports and the floor, and pile up.
# Impact (waves cross a facet in 0.6 ms) and heap (0.4 s) fit into one run of some thousand steps
# because the slab is soft and weak: 20 MPa, 1000 kg/m^3 and 60 kPa, as of dense snow or a dry foam.
#
# **Choices**: pieces tumble, so the bulk is neo-Hookean: small strain would take a rotation for a
# strain. The cohesive length E' w / Rmax^2 is 0.12 m, 1.6 facets of the default mesh and 3.6 of
# `--cells 24`, which resolves this length. theta > 1/2 damps the vibration of pieces that have
# struck; the ledger books the energy that damping takes. Contacts act on velocities (Moreau).
# `--bonds rigid` takes bonds without a stiffness beside an explicit bulk, which nothing damps.
#
# **Limitation.** Where the coarse slab cracks depends on its mesh.
#
# **Limitation.** A penetration stays: mostly the approach of one step, more where lips that have
# turned go over from their bond to the search. Each run prints the deepest penetration.

import argparse
import logging
from pathlib import Path

import numpy as np
from tqdm.auto import tqdm

import xper_fx as xf

# ## Scene (lengths in m)

LENGTH, THICKNESS, HEIGHT = 1.0, 0.2, 0.35
SUPPORT = 0.12
RADIUS, CLEARANCE = 0.1, 2e-3
SLAB = xf.materials.NeoHookean(young=20e6, poisson=0.2, density=1000.0)
TOUGHNESS, STRENGTH = 20.0, 60e3  # J/m^2, Pa
BONDS = {
    "elastic": xf.laws.CohesiveZone(
        normal_stiffness=1e10, fracture_energy=TOUGHNESS, strength=STRENGTH, friction=0.5
    ),
    "rigid": xf.laws.RigidCohesiveZone(fracture_energy=TOUGHNESS, strength=STRENGTH, friction=0.5),
}
FRICTION = xf.laws.SignoriniCoulomb(friction=0.5)
GRAVITY = 9.81
WINDOW = (-0.05, LENGTH + 0.05, -0.04, HEIGHT + THICKNESS + 2.5 * RADIUS)


def impact(cells: int, speed: float, density: float, bonds: str = "elastic") -> xf.Scene:
    """The scene.

    Args:
        cells: squares of four triangles along the slab.
        speed: of the ball (m/s), downwards.
        density: of the ball (kg/m^3).
        bonds: a key of `BONDS`.
    """
    across = max(2, round(cells * THICKNESS / LENGTH))
    mesh = xf.crossed_rectangle((0.0, HEIGHT), (LENGTH, HEIGHT + THICKNESS), (cells, across))
    ball = (0.5 * LENGTH, HEIGHT + THICKNESS + RADIUS + CLEARANCE)
    support, fixed = xf.rigid.Polygon.box((SUPPORT, HEIGHT)), dict.fromkeys(range(3), 0.0)
    rigid = [
        xf.RigidBody(xf.rigid.Disc(RADIUS), ball, "ball", density=density, velocity=(0.0, -speed)),
        xf.rigid.wall((0.5 * LENGTH, 0.0), (0.0, 1.0), "ground"),
    ] + [
        xf.RigidBody(support, (x, 0.5 * HEIGHT), "ground", prescribed=fixed)
        for x in (0.5 * SUPPORT, LENGTH - 0.5 * SUPPORT)
    ]
    pairs = ("slab", "slab"), ("slab", "ball"), ("slab", "ground"), ("ball", "ground")
    return xf.Scene(
        xf.explode(mesh),
        {1: SLAB},
        default_interaction=BONDS[bonds],
        surfaces={"slab": (1,)},
        rigid=rigid,
        contacts=[xf.Contact(pair, FRICTION) for pair in pairs],
        loads=[xf.Gravity((0.0, -GRAVITY))],
    )


# ## One run


def neighbours(scene: xf.Scene) -> set[tuple[int, int]]:
    """Pairs of cells that share a vertex at the start."""
    mesh, bodies = scene.bodies.mesh, scene.bodies.body_of_cell
    corner = mesh.geometry.x[xf.geometry_dofmap(mesh)].reshape(-1, 3)
    _, vertex = np.unique(
        np.round(corner / (1e-6 * LENGTH)).astype(int), axis=0, return_inverse=True
    )
    at_vertex: dict[int, list[int]] = {}
    for body, number in zip(np.repeat(bodies, 3).tolist(), vertex.ravel().tolist(), strict=True):
        at_vertex.setdefault(number, []).append(body)
    return {(a, b) for bodies in at_vertex.values() for a in bodies for b in bodies}


def run(scene: xf.Scene, options: argparse.Namespace) -> dict:
    """Run the scene into the folder; returns what report and figures need."""
    explicit = options.bonds == "rigid"
    simulation = xf.Simulation(
        scene,
        None if explicit else options.step_size,  # the explicit bulk has its own
        accuracy=options.accuracy,
        scheme="explicit" if explicit else "implicit",
        theta=None if explicit else options.theta,
        tolerance=options.tolerance,
        solver=options.solver,
        num_threads=options.threads,
    )
    recorder = xf.Recorder(
        simulation,
        options.out,
        end_time=options.end_time,
        fields=options.fields,
        fragments=True,
        parameters=vars(options),
        checkpoint_every=options.checkpoint_every,
        restart=options.restart,
    )
    times = options.end_time * np.array([0.0, 0.02, 0.1, 0.25, 0.5, 1.0])
    near, met, deepest = neighbours(scene), set(), 0.0
    count, frames = scene.bodies.num_bodies, []

    def picture() -> None:
        fragment = xf.output.find_fragments(simulation)[scene.bodies.body_of_cell]
        frames.append(xf.output.take_frame(simulation, fragment, f"{1e3 * simulation.time:.0f} ms"))

    picture()
    for _ in xf.recorded_steps(
        recorder, options.end_time, "impact", options.quiet, options.profile
    ):
        if simulation.time >= times[min(len(frames), 5)] * (1.0 - 1e-9) and len(frames) < 6:
            picture()
        pairs = np.sort(xf.output.find_contact_forces(simulation).bodies, axis=1)
        met |= {tuple(p) for p in pairs[pairs[:, 1] < count].tolist()} - near
        gaps = [g.jump[:, 0].min(initial=0.0) for g in simulation.interactions.contacts]
        deepest = max(deepest, -min(gaps, default=0.0))
    return {
        "simulation": simulation,
        "history": xf.read_history(options.out / "history.csv"),
        "frames": frames,
        "fragments": xf.output.measure_fragments(simulation),
        "met": met,
        "deepest": deepest,
    }


def pieces(result: dict) -> np.ndarray:
    """Rows of the table of fragments that are pieces of the slab, the ball left out."""
    count = result["simulation"].scene.bodies.num_bodies
    return np.unique(result["fragments"].fragment[:count])


def report(result: dict, options: argparse.Namespace) -> None:
    """Say how many pieces there are, who met whom, where the energy went."""
    history, table, rows = result["history"], result["fragments"], pieces(result)
    last = {name: column[-1] for name, column in history.items()}
    found = {
        "fragments": len(rows),
        "cells_in_the_largest": int(table.bodies[rows[0]]),
        "single_cells": int(np.count_nonzero(table.bodies[rows] == 1)),
        "pairs_that_met_apart": len(result["met"]),
        "deepest_penetration": result["deepest"],
        "largest_closure": float(np.abs(history["closure"]).max()),
    }
    energy = ", ".join(
        f"{name.removeprefix('dissipated_')} {last[name]:.1f}"
        for name in last
        if name.startswith("dissipated")
    )
    tqdm.write(
        f"\n{found['fragments']} fragments of {table.bodies[rows].sum()} cells, the largest of "
        f"{found['cells_in_the_largest']}, {found['single_cells']} of one cell; "
        f"{found['pairs_that_met_apart']} pairs of cells met that were no neighbours; deepest "
        f"penetration {1e3 * result['deepest']:.2f} mm"
        f"\nenergy (J/m): work of gravity {last['external_work']:.1f}, dissipated by {energy}; "
        f"largest closure error {found['largest_closure']:.1e}"
    )
    tqdm.write(xf.cohesive_table(result["simulation"]))
    tqdm.write(xf.effects_table(result["simulation"]))
    xf.add_to_summary(result["simulation"], found)


# ## Figures


def draw(result: dict, out: Path) -> None:
    """Six times, coloured by fragment, sizes of the pieces, and the energies."""
    table, rows = result["fragments"], pieces(result)
    xf.plotting.plot_fragments({"": (table.diameter[rows], table.mass[rows])}, out / "sizes.png")
    xf.output.plot_frames(result["frames"], out / "frames.png", window=WINDOW)
    xf.plotting.plot_energies(result["history"], out / "energies.png", ("J/m", 1.0), against="time")


# ## Command line


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Options of the demo."""
    parser = argparse.ArgumentParser(description="A slab broken by a ball, and its heap.")
    add = parser.add_argument
    add("--cells", type=int, default=12, help="squares along the slab, of four cells (default 12)")
    add("--speed", type=float, default=3.0, help="of the ball, m/s (default 3)")
    add("--density", type=float, default=2500.0, help="of the ball, kg/m^3 (default 2500)")
    add("--end-time", type=float, default=0.4, help="s (default 0.4)")
    add("--step-size", type=float, default=2e-4, help="h in s (default 2e-4), of elastic bonds")
    add("--bonds", choices=BONDS, default="elastic", help="before they weaken")
    xf.add_run_options(parser, Path("results/impact_fragmentation"))
    parser.set_defaults(theta=0.55)
    options = parser.parse_args(arguments)
    if options.cells < 2:
        parser.error(f"--cells should be at least 2, got {options.cells}")
    for name in ("speed", "density", "end_time", "step_size"):
        if not getattr(options, name) > 0.0:
            parser.error(f"--{name.replace('_', '-')} should be above zero")
    return options


def main(arguments: list[str] | None = None) -> dict:
    """Break the slab and draw it."""
    options = parse(arguments)
    logging.basicConfig(level=logging.WARNING)
    xf.prepare_folder(options.out)
    scene = impact(options.cells, options.speed, options.density, options.bonds)
    result = run(scene, options)
    report(result, options)
    if not options.no_plot:
        draw(result, options.out)
    return result


if __name__ == "__main__":
    xf.run_together(main)
