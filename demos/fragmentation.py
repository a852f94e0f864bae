# SPDX-License-Identifier: LGPL-3.0-or-later
# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A ring that flies to pieces
#
# This demo illustrates how to:
#
# - give each facet a strength of its own, drawn at random with a seed
# - take initially rigid bonds, so that unbroken facets cost nothing
# - count and measure the pieces of a run, and compare their sizes with published formulas
#
# Mott's problem: a thin ring expands with the hoop strain rate e. Its hoop stress rises until the
# weakest sections crack; waves unload what is between the cracks, and what they reach in time stays
# whole. Faster rings break into smaller pieces.
#
# E = 275 GPa, rho = 2750 kg/m^3, the strength s = 300 MPa and the fracture energy w = 100 J/m^2 are
# those of a ceramic in the literature on fragmentation. With c^2 = E / rho they give a length, a
# time and a rate,
#
#     s0 = E w / s^2 = 305.6 um,    t0 = s0 / c = 30.6 ns,    e0 = s / (E t0) = 3.57e4 /s,
#
# and mean sizes are compared with s0 f(e / e0), f being
#
# - 4.5 / (1 + 4.5 x^(2/3)), and 4.5 / (1 + 0.77 x^(1/4) + 5.4 x^(3/4)), fits to simulations of bars
#   (Zhou, Molinari and Ramesh 2006; `benchmarks/bar_fragmentation.py` says how far the sources of
#   both are known);
# - (24 / x^2)^(1/3), Grady (1982): the kinetic energy of a piece about its centre pays for it.
#
# **Limitation.** Cracks follow facets and so spend more energy than straight ones would. Pieces
# meet again at the facets along which they parted only.

import argparse
from pathlib import Path
from typing import Any

import numpy as np

import xper_fx as xf

YOUNG, POISSON, DENSITY = 275e9, 0.2, 2750.0
STRENGTH, TOUGHNESS = 300e6, 100.0
LAYERS = 3.0
WAVE = (YOUNG / DENSITY) ** 0.5
SIZE = YOUNG * TOUGHNESS / STRENGTH**2
TIME = SIZE / WAVE
RATE = STRENGTH / (YOUNG * TIME)

FORMULAS = {
    "fit with x^(2/3)": lambda x: 4.5 / (1.0 + 4.5 * x ** (2.0 / 3.0)),
    "fit of Zhou et al. 2006": lambda x: 4.5 / (1.0 + 0.77 * x**0.25 + 5.4 * x**0.75),
    "Grady 1982": lambda x: (24.0 / x**2) ** (1.0 / 3.0),
}

# ## The ring
#
# The expected size of a piece sets all lengths: the ring has `--pieces` of them around, is three
# cells thick, and has `--cells` cells in a piece.


def expected(rate: float) -> float:
    """Mean size of the pieces by the first fit (m)."""
    return SIZE * FORMULAS["fit with x^(2/3)"](rate / RATE)


def lengths(options: argparse.Namespace) -> tuple[float, float, float]:
    """Mean radius, thickness and size of a cell (m)."""
    piece = expected(options.rate)
    cell = piece / options.cells
    return options.pieces * piece / (2.0 * np.pi), LAYERS * cell, cell


def ring(options: argparse.Namespace) -> xf.Bodies:
    """The ring, each triangle a body."""
    radius, thickness, cell = lengths(options)
    sizes = {"Mesh.MeshSizeMax": cell, "Mesh.MeshSizeMin": cell, "Mesh.Algorithm": 5}
    with xf.gmsh_model("ring", sizes | {"Mesh.RandomSeed": 1 + options.seed}) as gmsh:
        occ, model = gmsh.model.occ, gmsh.model
        outer, inner = radius + 0.5 * thickness, radius - 0.5 * thickness
        discs = [[(2, occ.addDisk(0, 0, 0, r, r))] for r in (outer, inner)]
        cut, _ = occ.cut(*discs)
        occ.synchronize()
        model.addPhysicalGroup(2, [tag for _, tag in cut], 1)
        model.mesh.generate(2)
        mesh, cell_tags, _ = xf.read_gmsh(model, 2)
    return xf.explode(mesh, cell_tags=cell_tags)


def scene(options: argparse.Namespace) -> xf.Scene:
    """The ring with the velocity e x, free of stress at the start."""
    weak, strong = STRENGTH * (1.0 - options.scatter), STRENGTH * (1.0 + options.scatter)
    strength = xf.fields.Uniform(weak, strong, options.seed)
    return xf.Scene(
        ring(options),
        {1: xf.materials.LinearElastic(YOUNG, POISSON, DENSITY, plane="stress")},
        default_interaction=xf.laws.RigidCohesiveZone(strength, TOUGHNESS),
        initial_velocity=lambda x: options.rate * x[:2],
    )


# ## Run
#
# Stress reaches the strength after s / (E e); cracks are there some ten t0 later.


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Expand the ring; returns what report and figures need."""
    end_time = STRENGTH / (YOUNG * options.rate) + options.after * TIME
    simulation = xf.Simulation(scene(options), scheme="explicit", num_threads=options.threads)
    recorder = xf.Recorder(
        simulation, options.out, end_time=end_time, fields=options.fields, fragments=True,
        parameters=vars(options), checkpoint_every=options.checkpoint_every,
        restart=options.restart,
    )  # fmt: skip
    for _ in xf.recorded_steps(recorder, end_time, "expanding", options.quiet, options.profile):
        pass
    pieces = xf.output.measure_fragments(simulation)
    frame = None
    if not options.no_plot:
        cells = pieces.fragment[simulation.bodies.body_of_cell]
        frame = xf.output.take_frame(simulation, cells, f"{1e9 * end_time:.0f} ns")
    return {
        "pieces": pieces,
        "frame": frame,
        "history": xf.read_history(options.out / "history.csv"),
        "simulation": simulation,
    }


def report(result: dict[str, Any], options: argparse.Namespace) -> dict[str, float]:
    """Number and sizes of the pieces, and what their creation cost."""
    pieces, simulation = result["pieces"], result["simulation"]
    sizes = pieces.mass / (DENSITY * lengths(options)[1])  # along the ring, unstretched
    last = {name: column[-1] for name, column in result["history"].items()}
    spent = last["dissipated_cohesion"]
    found = {
        "cells": simulation.bodies.num_bodies,
        "pieces": len(pieces),
        "mean_size_um": 1e6 * float(sizes.mean()),
        "deviation_over_mean": float(sizes.std() / sizes.mean()),
        "spent": spent,
        "spent_on_borders": float(pieces.border.sum()),
        "closure_over_spent": float(last["closure"] / spent),
    }
    print(", ".join(f"{name} {value:.4g}" for name, value in found.items()))
    for name, formula in FORMULAS.items():
        size = 1e6 * SIZE * formula(options.rate / RATE)
        print(f"{name}: {size:.4g} um, found {found['mean_size_um'] / size:.2f} of it")
    xf.add_to_summary(simulation, found)
    return found


def draw(result: dict[str, Any], out: Path) -> None:
    """The pieces, a colour each; the distribution of their sizes; energies."""
    pieces = result["pieces"]
    xf.output.plot_frames([result["frame"]], out / "pieces.png")
    sizes = {f"{len(pieces)} pieces": (pieces.diameter, pieces.mass)}
    xf.plotting.plot_fragments(sizes, out / "sizes.png", length_unit=("um", 1e-6))
    xf.plotting.plot_energies(result["history"], out / "energies.png", ("J/m", 1.0), against="time")


# ## Command line


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Options of the demo."""
    parser = argparse.ArgumentParser(description="A ring that flies to pieces.")
    add = parser.add_argument
    add("--rate", type=float, default=1e5, help="e (1/s)")
    add("--scatter", type=float, default=0.05, help="half the range of strengths over s")
    add("--pieces", type=int, default=60, help="expected around")
    add("--cells", type=float, default=8.0, help="in the length of an expected piece")
    add("--after", type=float, default=20.0, help="end, over t0 after the stress is the strength")
    add("--seed", type=int, default=0, help="of strengths and mesh")
    xf.add_run_options(parser, Path("results/fragmentation"))
    options = parser.parse_args(arguments)
    for name in ("rate", "after"):
        if not getattr(options, name) > 0.0:
            parser.error(f"--{name} should be above zero, got {getattr(options, name)}")
    if not 0.0 <= options.scatter < 1.0:
        parser.error(f"--scatter should lie in [0, 1), got {options.scatter}")
    if options.pieces < 4 or options.cells < 2.0:
        parser.error("a ring has at least 4 pieces and a piece 2 cells: --pieces, --cells")
    return options


def main(arguments: list[str] | None = None) -> dict[str, float]:
    """Expand, count and draw."""
    options = parse(arguments)
    xf.prepare_folder(options.out)
    result = run(options)
    found = report(result, options)
    if not options.no_plot:
        draw(result, options.out)
    return found


if __name__ == "__main__":
    xf.run_together(main)
