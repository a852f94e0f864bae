# SPDX-License-Identifier: LGPL-3.0-or-later
# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # Compaction of soft and rigid grains
#
# This demo illustrates how to:
#
# - put meshed and rigid bodies into one scene, with contacts between all of them
# - mesh bodies that never touched, and compact them by a wall of given velocity
# - read contact forces: the pressure on a wall, chains of forces
#
# Discs lie apart in a box; some are elastic and meshed, the others rigid, discs or polygons. The
# lid comes down at a constant speed; grains slide, jam, and the soft ones are squeezed into the
# pores, so that the packing fraction goes beyond what rigid grains could reach, at a pressure that
# rises towards Young's modulus (Cantor et al. 2020).
#
# The packing fraction is the area of the grains at the start over that of the box now.
#
# **Choices**: no gravity; neo-Hookean soft grains, as they turn and strain by tens of percent;
# theta > 1/2 damps their vibration.
#
# **Limitation.** Rigid grains must not bridge the box, because a lid of given velocity could then
# not move. Keep their share small.

import argparse
import logging
from pathlib import Path

import basix.ufl
import numpy as np
import ufl
from dolfinx.mesh import create_mesh
from mpi4py import MPI
from scipy.spatial import Delaunay
from tqdm.auto import tqdm

import xper_fx as xf

# ## Grains
#
# Sites of a square lattice, each with a grain of a random radius. A polygon has the corners of a
# regular one on the circle of its radius.

RADIUS, SPREAD = 0.05, 0.2
SPACING = 2.0 * RADIUS * (1.0 + SPREAD) + 0.01
SOFT = xf.materials.NeoHookean(young=1e6, poisson=0.3, density=1000.0)
SIDES = (0, 5, 6)
LID = 0


def soft_disc(rings: int) -> tuple[np.ndarray, np.ndarray]:
    """Mesh of the unit disc: points on rings, joined by triangles."""
    points: list[np.ndarray] = [np.zeros((1, 2))]
    for ring in range(1, rings + 1):
        angle = 2.0 * np.pi * np.arange(6 * ring) / (6 * ring)
        points.append(ring / rings * np.column_stack([np.cos(angle), np.sin(angle)]))
    nodes = np.concatenate(points)
    return nodes, Delaunay(nodes).simplices


def mesh_discs(centres: np.ndarray, radii: np.ndarray, rings: int) -> xf.Bodies:
    """Discs as bodies."""
    points, cells = soft_disc(rings)
    x = (centres[:, None] + radii[:, None, None] * points).reshape(-1, 2)
    first = len(points) * np.arange(len(centres))
    cells = (first[:, None, None] + cells).reshape(-1, 3)
    element = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
    mesh = create_mesh(MPI.COMM_SELF, cells=cells, x=x, e=ufl.Mesh(element))
    return xf.explode(
        mesh, mesh.geometry.input_global_indices[xf.geometry_dofmap(mesh)[:, 0]] // len(points)
    )


def shape_of(number: int, radius: float) -> xf.rigid.Disc | xf.rigid.Polygon:
    """Shape of a rigid grain: discs, pentagons and hexagons by turns."""
    sides = SIDES[number % len(SIDES)]
    if sides == 0:
        return xf.rigid.Disc(radius)
    angle = 2.0 * np.pi * np.arange(sides) / sides
    return xf.rigid.Polygon(radius * np.column_stack([np.cos(angle), np.sin(angle)]))


def packing(
    columns: int,
    rows: int,
    rigid_share: float,
    rings: int,
    speed: float,
    friction: float,
    seed: int,
) -> xf.Scene:
    """The scene.

    Args:
        columns, rows: of grains.
        rigid_share: share of rigid grains, in [0, 1).
        rings: of cells in a soft grain.
        speed: of the lid (m/s).
        friction: Coulomb's mu everywhere.
        seed: of radii, places and shapes.
    """
    random = np.random.default_rng(seed)
    count = columns * rows
    width, height = columns * SPACING, rows * SPACING
    site = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
    radius = RADIUS * random.uniform(1.0 - SPREAD, 1.0 + SPREAD, count)
    slack = 0.5 * SPACING - radius
    centre = (site + 0.5) * SPACING + 0.9 * slack[:, None] * random.uniform(-1.0, 1.0, (count, 2))
    hard = np.zeros(count, bool)
    hard[random.permutation(count)[: round(rigid_share * count)]] = True
    turned = random.uniform(0.0, 2.0 * np.pi, count)
    walls = [
        xf.rigid.wall((0.5 * width, height), (0.0, -1.0), "box", velocity=(0.0, -speed)),
        xf.rigid.wall((0.5 * width, 0.0), (0.0, 1.0), "box"),
        xf.rigid.wall((0.0, 0.5 * height), (1.0, 0.0), "box"),
        xf.rigid.wall((width, 0.5 * height), (-1.0, 0.0), "box"),
    ]
    grains = [
        xf.RigidBody(
            shape_of(k, radius[i]), centre[i], "hard", angle=turned[i], density=SOFT.density
        )
        for k, i in enumerate(np.flatnonzero(hard))
    ]
    groups = ("soft", "hard", "box") if grains else ("soft", "box")
    law = xf.laws.SignoriniCoulomb(friction)
    pairs = [(a, b) for n, a in enumerate(groups) for b in groups[n:] if (a, b) != ("box", "box")]
    return xf.Scene(
        mesh_discs(centre[~hard], radius[~hard], rings),
        {1: SOFT},
        surfaces={"soft": (1,)},
        rigid=walls + grains,
        contacts=[xf.Contact(pair, law) for pair in pairs],
    )


# ## One run


def fractions(scene: xf.Scene) -> tuple[float, float]:
    """Area of all grains at the start, and width of the box."""
    mesh = scene.bodies.mesh
    corner = mesh.geometry.x[xf.geometry_dofmap(mesh)][:, :, :2]
    along, aside = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    soft = 0.5 * np.abs(along[:, 0] * aside[:, 1] - along[:, 1] * aside[:, 0]).sum()
    hard = sum(
        body.shape.mass_properties(1.0).mass
        for body in scene.rigid
        if body.group == "hard" and isinstance(body.shape, xf.rigid.Disc | xf.rigid.Polygon)
    )
    return soft + hard, 2.0 * scene.rigid_bodies.position[LID, 0]


def von_mises(stress: np.ndarray) -> np.ndarray:
    """Of stresses of shape (n, 3, 3)."""
    deviator = stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
    return np.sqrt(1.5 * np.einsum("nij,nij->n", deviator, deviator))


def run(scene: xf.Scene, options: argparse.Namespace) -> dict:
    """Run the scene into the folder; returns what report and figures need."""
    simulation = xf.Simulation(
        scene,
        options.step_size,
        accuracy=options.accuracy,
        theta=options.theta,
        tolerance=options.tolerance,
        solver=options.solver,
        num_threads=options.threads,
    )
    area, width = fractions(scene)
    height = scene.rigid_bodies.position[LID, 1]
    end = (height - area / (options.packing * width)) / options.speed
    recorder = xf.Recorder(
        simulation, options.out, end_time=end, fields=options.fields,
        parameters=vars(options),
        checkpoint_every=options.checkpoint_every,
        restart=options.restart,
    )  # fmt: skip
    lid, packed = scene.bodies.num_bodies + LID, area / (width * height)
    targets = np.linspace(packed, options.packing, 4)[1:]
    curve: list[tuple[float, ...]] = []
    frames: list[xf.output.Frame] = []
    for _ in xf.recorded_steps(recorder, end, "packing", options.quiet, options.profile):
        packed = area / (width * simulation.rigid.state.position[LID, 1])
        contacts = xf.output.find_contact_forces(simulation)
        # the lid is candidate or antagonist of its contacts
        sign = (contacts.bodies == lid) @ np.array([1.0, -1.0])
        curve.append((simulation.time, packed, float(sign @ contacts.force[:, 1]) / width))
        if len(frames) < 3 and packed >= targets[len(frames)] * (1.0 - 1e-6):
            stress = von_mises(recorder.cell_stress()) / 1e3
            title = f"packing fraction {packed:.3f}"
            frames.append(xf.output.take_frame(simulation, stress, title))
    return {
        "simulation": simulation,
        "history": xf.read_history(options.out / "history.csv"),
        "curve": np.array(curve),
        "frames": frames,
        "window": (-0.02 * width, 1.02 * width, -0.02 * width, height),
    }


def report(result: dict, options: argparse.Namespace) -> None:
    """Say how dense the packing became, at what pressure, and where the work went."""
    _, packed, pressure = result["curve"].T
    last = {name: column[-1] for name, column in result["history"].items()}
    # the last time that the lid was free
    loose = np.flatnonzero(pressure < 1e-3 * SOFT.young)
    jammed = packed[loose[-1]] if len(loose) else packed[0]
    tqdm.write(
        f"\npacking fraction {packed[-1]:.3f} at a pressure of {pressure[-1] / 1e3:.1f} kPa = "
        f"{pressure[-1] / SOFT.young:.3f} E; above E / 1000 beyond {jammed:.3f}"
        f"\nenergy (J/m): work of the lid {last['external_work']:.2f}, elastic "
        f"{last['elastic']:.2f}, friction {last['dissipated_friction']:.2f}, impacts "
        f"{last['dissipated_impact']:.2f}, scheme {last['dissipated_numerical']:.2f}; closure "
        f"error {last['closure'] / last['external_work']:.1e} of the work"
    )
    tqdm.write(xf.effects_table(result["simulation"]))
    found = {"packing": packed[-1], "pressure": pressure[-1], "jammed_at": jammed}
    xf.add_to_summary(result["simulation"], found)


# ## Figures


def draw(result: dict, out: Path) -> None:
    """The packing at three densities, the pressure on the lid, and the energies."""
    xf.output.plot_frames(
        result["frames"],
        out / "packing.png",
        window=result["window"],
        label="von Mises stress (kPa)",
        chains=True,
    )
    _, packed, pressure = result["curve"].T

    def plot(figure, axes) -> None:
        axes.plot(packed, pressure / SOFT.young, color="black", lw=0.9)
        axes.set_xlabel("packing fraction")
        axes.set_ylabel("pressure on the lid / E")

    xf.plotting.new_figure(out / "pressure.png", plot, (4.5, 3.2))
    xf.plotting.plot_energies(result["history"], out / "energies.png", ("J/m", 1.0), against="time")


# ## Command line


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Options of the demo."""
    parser = argparse.ArgumentParser(description="Compaction of soft and rigid grains.")
    add = parser.add_argument
    add("--columns", type=int, default=6, help="grains along the box (default 6)")
    add("--rows", type=int, default=6, help="grains up the box (default 6)")
    add("--rigid", type=float, default=0.3, help="share of rigid grains (default 0.3)")
    add("--rings", type=int, default=3, help="of cells in a soft grain (default 3)")
    add("--speed", type=float, default=0.5, help="of the lid, m/s (default 0.5)")
    add("--friction", type=float, default=0.3, help="Coulomb's mu (default 0.3)")
    add("--packing", type=float, default=0.9, help="fraction at which it ends (default 0.9)")
    add("--seed", type=int, default=1, help="of radii, places and shapes")
    add("--step-size", type=float, default=5e-4, help="h in s (default 5e-4)")
    xf.add_run_options(parser, Path("results/granular_packing"))
    parser.set_defaults(theta=0.6)
    options = parser.parse_args(arguments)
    if not 0.0 <= options.rigid < 1.0:
        parser.error(f"--rigid should lie in [0, 1), got {options.rigid}")
    if not 0.7 <= options.packing < 1.0:
        parser.error(f"--packing should lie in [0.7, 1), got {options.packing}")
    for name in ("columns", "rows", "rings", "speed", "step_size"):
        if not getattr(options, name) > 0:
            parser.error(f"--{name.replace('_', '-')} should be above zero")
    return options


def main(arguments: list[str] | None = None) -> dict:
    """Compact the grains and draw them."""
    options = parse(arguments)
    logging.basicConfig(level=logging.WARNING)
    xf.prepare_folder(options.out)
    scene = packing(
        options.columns, options.rows, options.rigid, options.rings, options.speed,
        options.friction, options.seed,
    )  # fmt: skip
    result = run(scene, options)
    report(result, options)
    if not options.no_plot and MPI.COMM_WORLD.rank == 0:
        draw(result, options.out)
    return result


if __name__ == "__main__":
    xf.run_together(main)
