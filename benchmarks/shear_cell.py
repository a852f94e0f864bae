# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plane shear of discs in a periodic cell: friction and solid fraction against the inertial number.

    ./fenicsx python3 benchmarks/shear_cell.py [--figure docs/shear_cell.png]

The shear rate dF12/dt and the normal stress P22 = -P are given; F11 and F21 are held, so that P22
is the normal stress of Cauchy and the shear goes on for ever. With the mean mass m of a disc (per
metre of depth) the inertial number is I = rate (m / P)^(1/2). Discs are those of da Cruz et al.
(2005): radii within 20 % of their mean, friction 0.4, restitution 0.1. Their laws are

    mu = -sigma_12 / sigma_22 = 0.25 + 1.1 I,     solid fraction = 0.81 - 0.3 I.

Solid fractions come out within 0.005 of theirs, friction 0.02 to 0.05 above (`docs/validation.md`).
Means are over the strain after the first unit, and errors are the standard errors of means over
pieces of half a unit. The solid fraction counts discs whole where they overlap.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import uniform
from tqdm.auto import tqdm

import xper_fx as xf

FRICTION, RESTITUTION, SPREAD = 0.4, 0.1, 0.2
# Time is in units of (m / P)^(1/2), length in mean diameters.
RADII = uniform(0.5 * (1.0 - SPREAD), SPREAD)
# Solid fraction at which the cell would be a square, strain before means begin, and of a piece.
SQUARE, FIRST, PIECE = 0.8, 1.0, 0.5
# Largest step, and largest strain in one.
STEP, STRAIN = 0.1, 2e-3


class Flow(NamedTuple):
    """Means of a flow, with their standard errors.

    Attributes:
        inertial: I, with the rate of the present cell.
        friction, fraction: mu and solid fraction, each with its error.
        asymmetry: |sigma_12 - sigma_21| / |sigma_12|.
        normal: sigma_11 / sigma_22.
        overlap: mean over the steps of the largest overlap, in mean diameters.
    """

    inertial: float
    friction: tuple[float, float]
    fraction: tuple[float, float]
    asymmetry: float
    normal: float
    overlap: float


def cell(inertial: float, count: int, seed: int) -> xf.Scene:
    """Loose discs in a cell that is sheared and pressed, with P = 1 Pa and m = 1 kg/m."""
    width = np.sqrt(count * np.pi * (RADII.var() + RADII.mean() ** 2) / SQUARE)
    grains = xf.assemblies.packing(RADII, (width, np.inf), density=1.0, seed=seed, count=count)
    radius = np.array([grain.shape.radius for grain in grains])
    density = count / (np.pi * (radius**2).sum())
    grains = [
        xf.RigidBody(grain.shape, grain.position, "grains", density=density) for grain in grains
    ]
    height = max(grain.position[1] + grain.shape.radius for grain in grains)
    law = xf.laws.SignoriniCoulomb(friction=FRICTION, restitution=RESTITUTION)
    final = np.pi * (radius**2).sum() / (SQUARE * width)
    drive = xf.MacroscopicDrive(
        rate={"12": inertial * final / height},  # of the present cell, once it is dense
        gradient={"11": 1.0, "21": 0.0},
        stress={"22": -1.0},
    )
    return xf.Scene(
        rigid=grains, lattice=(width, height), macroscopic=drive,
        contacts=[xf.Contact(("grains", "grains"), law)],
    )  # fmt: skip


def sheared(
    inertial: float, count: int, strain: float, seed: int = 0, quiet: bool = True
) -> tuple[Flow, xf.Simulation]:
    """A flow at an inertial number, and the run at its end.

    Args:
        inertial: I that is aimed at.
        count: number of discs.
        strain: at which the run ends, above 1 + two pieces.
        seed: of the discs.
        quiet: no progress bar.
    """
    scene = cell(inertial, count, seed)
    step, end = min(STEP, STRAIN / inertial), strain / inertial
    simulation = xf.Simulation(scene, step, tolerance=1e-2, solver="nlgs", num_threads=1)
    radius = np.array([grain.shape.radius for grain in scene.rigid])
    area = np.pi * (radius**2).sum() / np.linalg.det(scene.lattice)
    rows = []
    steps = tqdm(simulation.steps(end), f"I = {inertial:g}", round(end / step), disable=quiet)
    for record in steps:
        if record.time * inertial < FIRST:
            continue
        now = simulation.macroscopic
        rate = (now.rate @ np.linalg.inv(now.gradient))[0, 1]
        overlap = [-group.jump[:, 0].min(initial=0.0) for group in simulation.interactions.contacts]
        fraction = area / np.linalg.det(now.gradient)
        rows.append([rate, fraction, max(overlap, default=0.0), *now.cauchy.ravel()])
    pieces = np.array_split(np.array(rows), max(2, round((strain - FIRST) / PIECE)))
    means = np.array([piece.mean(axis=0) for piece in pieces])
    mean = means.mean(axis=0)

    def with_error(values: np.ndarray, whole: float) -> tuple[float, float]:
        return float(whole), float(values.std(ddof=1) / np.sqrt(len(values)))

    flow = Flow(
        float(mean[0]), with_error(-means[:, 4] / means[:, 6], -mean[4] / mean[6]),
        with_error(means[:, 1], mean[1]), float(abs(mean[4] - mean[5]) / abs(mean[4])),
        float(mean[3] / mean[6]), float(mean[2]),
    )  # fmt: skip
    return flow, simulation


def laws(inertial: np.ndarray | float) -> tuple:
    """Friction and solid fraction of da Cruz et al. (2005)."""
    return 0.25 + 1.1 * inertial, 0.81 - 0.3 * inertial


def draw(path: str, flows: Sequence[Flow], simulation: xf.Simulation) -> None:
    """The laws beside what was measured, and the last cell with its forces."""
    import matplotlib.pyplot as plt
    from matplotlib.collections import LineCollection, PatchCollection
    from matplotlib.patches import Circle

    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(12, 3.8), layout="constrained")
    at = np.array([flow.inertial for flow in flows])
    line = np.geomspace(0.7 * at.min(), 1.3 * at.max())
    for axes, name, number in ((left, "friction", 0), (middle, "fraction", 1)):
        value, error = np.array([getattr(flow, name) for flow in flows]).T
        axes.errorbar(at, value, error, fmt="o", capsize=3, label="measured")
        axes.plot(line, laws(line)[number], "k--", label="da Cruz et al. (2005)")
        axes.set_xscale("log")
        axes.set_xlabel("inertial number I")
    left.set_ylabel("effective friction")
    middle.set_ylabel("solid fraction")
    left.legend()
    state, now = simulation.rigid.displayed, simulation.macroscopic
    radius = [grain.shape.radius for grain in simulation.scene.rigid]
    discs = [Circle(x, r) for x, r in zip(state.position, radius, strict=True)]
    right.add_collection(PatchCollection(discs, facecolor="0.88", edgecolor="0.6", linewidth=0.4))
    forces = xf.output.find_contact_forces(simulation)
    size = np.linalg.norm(forces.force, axis=1)
    along = 0.5 * forces.force / size[:, None]
    chains = np.stack([forces.position - along, forces.position + along], axis=1)
    right.add_collection(
        LineCollection(chains, linewidths=2.5 * size / size.max(), colors="tab:red")
    )
    right.set_aspect("equal")
    right.autoscale_view()
    right.set_title(f"I = {flows[-1].inertial:.2g}, F12 = {now.gradient[0, 1]:.2f}", fontsize=10)
    right.set_axis_off()
    figure.savefig(path, dpi=150)


def main(options: list[str] | None = None) -> None:
    """Print a table, and draw the figure if asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--inertial", type=float, nargs="+", default=[3e-3, 1e-2, 3e-2, 1e-1, 2e-1])
    add("--grains", type=int, default=256)
    add("--strain", type=float, default=4.0)
    add("--seed", type=int, default=0)
    add("--figure", help="file to draw")
    add("--quiet", action="store_true", help="no progress bar")
    args = parser.parse_args(options)
    print("| I | mu | law | solid fraction | law | s11 / s22 | asymmetry | overlap |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    flows = []
    for inertial in args.inertial:
        flow, simulation = sheared(inertial, args.grains, args.strain, args.seed, args.quiet)
        flows.append(flow)
        friction, fraction = laws(flow.inertial)
        print(
            f"| {flow.inertial:.3g} | {flow.friction[0]:.3f} +- {flow.friction[1]:.3f} | "
            f"{friction:.3f} | {flow.fraction[0]:.4f} +- {flow.fraction[1]:.4f} | {fraction:.3f} | "
            f"{flow.normal:.3f} | {flow.asymmetry:.1e} | {flow.overlap:.3f} |",
            flush=True,
        )
    if args.figure:
        draw(args.figure, flows, simulation)


if __name__ == "__main__":
    main()
