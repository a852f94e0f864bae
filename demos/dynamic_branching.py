# SPDX-License-Identifier: LGPL-3.0-or-later
# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A crack that branches
#
# This demo illustrates how to:
#
# - take initially rigid bonds: cells that are one mesh until no admissible traction holds them
# - mesh a plate with an interior line, the notch, whose lips are free
# - follow the tip of a crack, its speed, and where it branches
#
# The plate is a benchmark of dynamic fracture (Song, Wang and Belytschko 2008, among others):
# 100 mm x 40 mm of glass, plane strain, a notch from the left edge to the middle, and a tension of
# 1 MPa that acts from the start on both long edges. Published simulations have the crack start
# after some 10 us, branch after 30 to 40 us, and stay below 60 % of the speed of Rayleigh's waves,
# here c_R = 2119 m/s.
#
# Until it cracks the plate is a mesh of ordinary finite elements, without a point more. Where no
# tractions that the bonds of a vertex bear would hold its cells together, they part; the bonds
# soften along a straight line, spend the fracture energy exactly, and leave lips that touch and
# rub.
#
# **Limitation.** Cracks follow facets, so that a path is longer than a straight one, and costs as
# much more. When and where a crack branches differs from mesh to mesh; `--seed` shifts the nodes.

import argparse
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection

import xper_fx as xf

LENGTH, HEIGHT, NOTCH_LENGTH = 0.1, 0.04, 0.05
YOUNG, POISSON, DENSITY = 32e9, 0.2, 2450.0
STRENGTH, TOUGHNESS, FRICTION = 3.08e6, 3.0, 0.2
TENSION = 1e6
TOP, BOTTOM, NOTCH = 1, 2, 3
RAYLEIGH = 2119.0

# ## Mesh
#
# Triangles of the size `facet` from a little behind the notch's tip on, four times as large at the
# left edge. The notch is a line within: its facets have a tag, and no law.


def plate(facet: float, seed: int) -> xf.Bodies:
    """The plate, each cell a body."""
    half = 0.5 * HEIGHT
    corners = [(0, -half), (LENGTH, -half), (LENGTH, half), (0, half)]
    with xf.gmsh_model("plate", {"Mesh.Algorithm": 5, "Mesh.RandomSeed": 1 + seed}) as gmsh:
        occ, model = gmsh.model.occ, gmsh.model
        points = [occ.addPoint(x, y, 0) for x, y in corners]
        mouth, tip = occ.addPoint(0, 0, 0), occ.addPoint(NOTCH_LENGTH, 0, 0)
        ring = [*points, mouth, points[0]]
        lines = [occ.addLine(a, b) for a, b in zip(ring[:-1], ring[1:], strict=True)]
        notch = occ.addLine(mouth, tip)
        surface = occ.addPlaneSurface([occ.addCurveLoop(lines)])
        occ.synchronize()
        model.mesh.embed(1, [notch], 2, surface)
        model.addPhysicalGroup(2, [surface], 1)
        for tag, line in ((BOTTOM, lines[0]), (TOP, lines[2]), (NOTCH, notch)):
            model.addPhysicalGroup(1, [line], tag)
        box = model.mesh.field.add("Box")
        sizes = {"VIn": facet, "VOut": 4 * facet, "Thickness": 0.04, "XMin": 0.045 - seed * 1e-4}
        for name, value in (sizes | {"XMax": 1, "YMin": -1, "YMax": 1}).items():
            model.mesh.field.setNumber(box, name, value)
        model.mesh.field.setAsBackgroundMesh(box)
        model.mesh.generate(2)
        mesh, cell_tags, facet_tags = xf.read_gmsh(model, 2)
    return xf.explode(mesh, cell_tags=cell_tags, facet_tags=facet_tags)


def scene(facet: float, bonds: str, seed: int = 0) -> xf.Scene:
    """The plate under tension; `bonds` are "rigid" or "elastic"."""
    law: Any
    if bonds == "rigid":
        law = xf.laws.RigidCohesiveZone(STRENGTH, TOUGHNESS, FRICTION)
    else:
        linear: Any = xf.laws.curves.Linear()
        stiffness = 20.0 * YOUNG / facet
        law = xf.laws.CohesiveZone(stiffness, TOUGHNESS, STRENGTH, friction=FRICTION, curve=linear)
    return xf.Scene(
        plate(facet, seed),
        {1: xf.materials.LinearElastic(YOUNG, POISSON, DENSITY)},
        default_interaction=law,
        facet_interactions={NOTCH: None},
        loads=[
            xf.SurfaceTraction(TOP, (0.0, TENSION)),
            xf.SurfaceTraction(BOTTOM, (0.0, -TENSION)),
        ],
    )


# ## Where the crack is
#
# The tip is the broken facet farthest to the right. A crack has branched where broken facets of one
# column of 1 mm are farther apart than four facets.


def crack(simulation: xf.Simulation, facet: float) -> dict[str, float]:
    """Time, tip and place of the first branch (m), NaN if there is none."""
    segments = xf.output.find_cracks(simulation).segments
    found = {"time": simulation.state.time, "tip": NOTCH_LENGTH, "branch": np.nan}
    if len(segments):
        x, y = segments.mean(axis=1).T
        found["tip"] = max(NOTCH_LENGTH, float(x.max()))
        column = (x / 1e-3).astype(int)
        low = np.full(column.max() + 1, np.inf)
        high = -low
        np.minimum.at(low, column, y)
        np.maximum.at(high, column, y)
        apart = np.flatnonzero(high - low > 4.0 * facet)
        if len(apart):
            found["branch"] = 1e-3 * apart[0]
    return found


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Pull the plate; returns what report and figures need."""
    simulation = xf.Simulation(
        scene(options.facet, options.bonds, options.seed), scheme="explicit",
        tolerance=options.tolerance, num_threads=options.threads,
    )  # fmt: skip
    recorder = xf.Recorder(
        simulation, options.out, end_time=options.end_time, fields=options.fields,
        parameters=vars(options), checkpoint_every=options.checkpoint_every,
        restart=options.restart,
    )  # fmt: skip
    track = []
    bar = xf.recorded_steps(recorder, options.end_time, "branching", options.quiet, options.profile)
    for record, _ in bar:
        if record.step % options.every == 0:
            track.append(crack(simulation, options.facet))
    return {
        "track": {name: np.array([t[name] for t in track]) for name in track[0]},
        "cracks": xf.output.find_cracks(simulation).segments,
        "history": xf.read_history(options.out / "history.csv"),
        "simulation": simulation,
    }


def speeds(time: np.ndarray, tip: np.ndarray, window: float = 5e-6) -> np.ndarray:
    """Mean speed of the tip over a window of time (m/s)."""
    later = np.interp(time + 0.5 * window, time, tip)
    return (later - np.interp(time - 0.5 * window, time, tip)) / window


def report(result: dict[str, Any]) -> dict[str, float]:
    """What is compared with published runs."""
    track, simulation = result["track"], result["simulation"]
    time, tip = track["time"], track["tip"]
    speed = speeds(time, tip)
    branched = np.flatnonzero(np.isfinite(track["branch"]))
    started = time[np.argmax(tip > NOTCH_LENGTH)]
    found = {
        "cells": simulation.bodies.num_bodies,
        "starts_us": 1e6 * started,
        "branches_us": np.nan, "branch_mm": np.nan,
        "fastest_over_rayleigh": float(speed.max() / RAYLEIGH),
    }  # fmt: skip
    if len(branched):
        place = track["branch"][branched[-1]]
        found["branch_mm"] = 1e3 * place
        found["branches_us"] = 1e6 * time[np.argmax(tip >= place)]
    last = {name: column[-1] for name, column in result["history"].items()}
    print(", ".join(f"{name} {value:.4g}" for name, value in found.items()))
    print(
        f"energy (J/m): external work {last['external_work']:.4f}, cracks "
        f"{last['dissipated_cohesion']:.4f}; closure error {last['closure']:.1e}"
    )
    xf.add_to_summary(
        simulation, {name: value if np.isfinite(value) else None for name, value in found.items()}
    )
    return found


def draw(result: dict[str, Any], out: Path) -> None:
    """The crack, and the speed of its tip; energies."""
    track, height = result["track"], 5e2 * HEIGHT
    figure, (above, below) = plt.subplots(2, figsize=(6.0, 4.8), layout="constrained")
    above.plot([0.0, 1e3 * NOTCH_LENGTH], [0.0, 0.0], c="0.5", lw=2)
    above.add_collection(LineCollection(list(1e3 * result["cracks"]), colors="C3", linewidths=1.2))
    above.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
    above.set(xlim=(0.0, 1e3 * LENGTH), ylim=(-height, height))
    speed = speeds(track["time"], track["tip"])
    below.plot(1e6 * track["time"], speed / RAYLEIGH)
    below.axhline(0.6, color="0.5", lw=0.8)
    below.set(xlabel="time (us)", ylabel="speed of the tip over c_R", ylim=(0.0, 1.0))
    figure.savefig(out / "branching.png", dpi=150)
    plt.close(figure)
    xf.plotting.plot_energies(result["history"], out / "energies.png", ("J/m", 1.0), against="time")


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Options of the demo."""
    parser = argparse.ArgumentParser(description="A crack that branches.")
    add = parser.add_argument
    add("--facet", type=float, default=1e-3, help="size of the triangles (m)")
    add("--bonds", choices=("rigid", "elastic"), default="rigid", help="before they weaken")
    add("--seed", type=int, default=0, help="of the mesh")
    add("--end-time", type=float, default=70e-6, help="s")
    add("--every", type=int, default=5, help="steps between looks at the crack")
    xf.add_run_options(parser, Path("results/dynamic_branching"))
    options = parser.parse_args(arguments)
    if not 0.0 < options.facet <= 2e-3:
        parser.error(f"--facet should lie in (0, 0.002] m, to resolve cracks, got {options.facet}")
    return options


def main(arguments: list[str] | None = None) -> dict[str, float]:
    """Run and draw."""
    options = parse(arguments)
    xf.prepare_folder(options.out)
    result = run(options)
    found = report(result)
    if not options.no_plot:
        draw(result, options.out)
    return found


if __name__ == "__main__":
    xf.run_together(main)
