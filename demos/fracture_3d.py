# SPDX-License-Identifier: LGPL-3.0-or-later
# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # Fracture of a notched bar in three dimensions
#
# This demo illustrates how to:
#
# - mesh a solid with Gmsh and make each tetrahedron a body
# - break it, with an explicit bulk and cohesive bonds between all bodies
# - write bulk and interfaces for ParaView, and draw the surface of a crack
#
# A square bar of a brittle polymer has a slit from one side, through its thickness. Its ends are
# pulled apart. The slit is tilted about the axis that runs into the bar (`--tilt`), so that its
# front is loaded in opening and in tearing at once: the crack starts along the tilted front and
# turns, as it grows, towards the plane across the pull.
#
# **Choices**: the material is PMMA with a strength below the real one, so that the cohesive length
# E' w / Rmax^2 spans several facets; each run prints it beside its facets. The ends are free to
# contract. The initial velocity is linear along the bar, so that no shock starts from the ends.

import argparse
import logging
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tqdm.auto import tqdm

import xper_fx as xf

# ## Geometry and mesh
#
# Millimetres are turned into metres at the end. The slit is a thin box; around its front the mesh
# is as elsewhere, so that no size of facet is preferred.

LENGTH, WIDTH, DEPTH, OPENING = 20e-3, 10e-3, 3e-3, 0.4e-3
LOW, HIGH = 1, 2
SPEED = 1.0
# Of displacements in the figure.
ENLARGED = 10.0


def notched_bar(facet: float, tilt: float) -> xf.Bodies:
    """The bar along z, slit from x = 0, each cell a body.

    Args:
        facet: size of the edges (m).
        tilt: of the slit about x (degrees).
    """
    options = {"Mesh.MeshSizeMax": facet, "Mesh.MeshSizeMin": facet}
    with xf.gmsh_model("notched bar", options) as gmsh:
        solid = gmsh.model.occ
        bar = solid.addBox(0.0, -0.5 * WIDTH, -0.5 * LENGTH, WIDTH, WIDTH, LENGTH)
        slit = solid.addBox(-DEPTH, -WIDTH, -0.5 * OPENING, 2.0 * DEPTH, 2.0 * WIDTH, OPENING)
        solid.rotate([(3, slit)], 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, np.radians(tilt))
        solid.cut([(3, bar)], [(3, slit)])
        solid.synchronize()
        gmsh.model.addPhysicalGroup(3, [tag for _, tag in gmsh.model.getEntities(3)], 1)
        gmsh.model.mesh.generate(3)
        mesh, cell_tags, _ = xf.read_gmsh(gmsh.model, 3)
    small = 1e-6 * LENGTH
    ends = {
        LOW: lambda x: x[2] < -0.5 * LENGTH + small,
        HIGH: lambda x: x[2] > 0.5 * LENGTH - small,
    }
    return xf.explode(mesh, cell_tags=cell_tags, facet_tags=xf.tag_facets(mesh, ends))


# ## Scene

PMMA = xf.materials.LinearElastic(young=3.24e9, poisson=0.35, density=1190.0)
FRACTURE_ENERGY, STRENGTH = 352.0, 20e6
# C_N over E / facet: the bonds then add a few percent to the bar's compliance.
RELATIVE_STIFFNESS = 40.0


def scene_of(facet: float, tilt: float, friction: float) -> xf.Scene:
    """The bar with its bonds, pulled at both ends."""
    bond = xf.laws.CohesiveZone(
        RELATIVE_STIFFNESS * PMMA.young / facet, FRACTURE_ENERGY, STRENGTH, friction=friction
    )
    return xf.Scene(
        notched_bar(facet, tilt),
        {1: PMMA},
        default_interaction=bond,
        loads=[xf.PrescribedVelocity(LOW, 2, -SPEED), xf.PrescribedVelocity(HIGH, 2, SPEED)],
        initial_velocity=lambda x: np.array([0 * x[0], 0 * x[0], 2.0 * SPEED * x[2] / LENGTH]),
    )


# ## The crack
#
# A facet is cracked where at least two of its three points have no bond left.


class CrackSurface(NamedTuple):
    """Cracked facets: their corners on the lower lip, shape (n, 3, 3), m, and their areas (m^2)."""

    corners: np.ndarray
    area: np.ndarray

    def inclination(self, near: bool) -> float:
        """Slope dz/dy of the surface (degrees), within a slit's depth of its front or beyond."""
        x, y, z = self.corners.mean(axis=1).T
        part = (x < 2.0 * DEPTH) == near
        weight = np.sqrt(self.area[part])
        slope = np.polyfit(y[part], z[part], 1, w=weight)[0] if np.count_nonzero(part) > 2 else 0.0
        return float(np.degrees(np.arctan(slope)))


def crack_surface(simulation: xf.Simulation) -> CrackSurface:
    """The cracked facets as they are now, in the reference configuration."""
    facets = simulation.scene.bodies.facets
    number = simulation.facets_with_law
    cracked = xf.output.broken_points(simulation).reshape(len(number), 3).sum(axis=1) >= 2
    corners = xf.output.point_coordinates(simulation).reshape(len(number), 3, 3)[cracked]
    return CrackSurface(corners, facets.measure[number[cracked]])


def visible_faces(simulation: xf.Simulation) -> tuple[np.ndarray, np.ndarray]:
    """Faces of cells on the outside or cracked: geometry nodes, shape (n, 3), and which cracked."""
    bodies = simulation.scene.bodies
    number = simulation.facets_with_law
    whole = xf.output.broken_points(simulation).reshape(len(number), 3).sum(axis=1) < 2
    hidden = np.zeros((len(bodies.body_of_cell), 4), np.bool_)
    whole, cracked = number[whole], number[~whole]
    hidden[bodies.facets.cells[whole], bodies.facets.local_facets[whole]] = True
    inner = np.zeros_like(hidden)
    inner[bodies.facets.cells[cracked], bodies.facets.local_facets[cracked]] = True
    cell, face = np.nonzero(~hidden)
    nodes = xf.geometry_dofmap(bodies.mesh)[cell]
    faces = np.take_along_axis(nodes, xf.meshes.local_facet_vertices(bodies.mesh)[face], axis=1)
    # outwards: away from the vertex opposite to the face, which bears its number
    x = bodies.mesh.geometry.x
    edges = x[faces[:, 1:]] - x[faces[:, :1]]
    outward = x[faces[:, 0]] - x[nodes[np.arange(len(face)), face]]
    inside = np.einsum("fi,fi->f", np.cross(edges[:, 0], edges[:, 1]), outward) < 0.0
    faces[inside] = faces[inside][:, ::-1]
    return faces, inner[cell, face]


# ## One run


def run(scene: xf.Scene, options: argparse.Namespace) -> dict:
    """Run the scene into the folder; returns what report and figures need."""
    simulation = xf.Simulation(
        scene,
        options.step_size,
        accuracy=options.accuracy,
        scheme=options.scheme,
        theta=options.theta,
        tolerance=options.tolerance,
        solver=options.solver,
        num_threads=options.threads,
    )
    end = options.final_strain * LENGTH / (2.0 * SPEED)
    recorder = xf.Recorder(
        simulation,
        options.out,
        end_time=end,
        gauge=xf.TensileGauge(LOW, HIGH, 2, LENGTH, WIDTH**2),
        fields=options.fields,
        parameters=vars(options),
        checkpoint_every=options.checkpoint_every,
        restart=options.restart,
    )
    for _ in xf.recorded_steps(recorder, end, "bar", options.quiet, options.profile):
        pass
    return {
        "simulation": simulation,
        "history": xf.read_history(options.out / "history.csv"),
        "crack": crack_surface(simulation),
        "displacement": recorder.vertex_displacement(),
    }


def report(result: dict, options: argparse.Namespace) -> None:
    """Say what the bar bore, what the crack cost and how it turned."""
    history, crack = result["history"], result["crack"]
    simulation = result["simulation"]
    peak = int(np.argmax(history["stress"]))
    last = {name: column[-1] for name, column in history.items()}
    area = float(crack.area.sum())
    slopes = [crack.inclination(near) for near in (True, False)]
    tqdm.write(
        f"\n{simulation.scene.bodies.num_bodies} tetrahedra; peak "
        f"{history['stress'][peak] / 1e6:.2f} MPa at {100 * history['strain'][peak]:.3f} %"
        f"\ncracked {1e6 * area:.1f} mm^2 (the ligament has "
        f"{1e6 * WIDTH * (WIDTH - DEPTH):.0f}), sloping by {slopes[0]:.0f} degrees near the slit "
        f"of {options.tilt:g} and by {slopes[1]:.0f} further on"
        f"\nenergy (mJ): external work {1e3 * last['external_work']:.2f}, cracks "
        f"{1e3 * last['dissipated_cohesion']:.2f}; closure error "
        f"{last['closure'] / last['external_work']:.1e} of the work"
    )
    tqdm.write(xf.cohesive_table(simulation))
    tqdm.write(xf.effects_table(simulation))
    found = {"peak_stress": history["stress"][peak], "crack_area": area, "crack_slope": slopes}
    xf.add_to_summary(simulation, found)


# ## Figures
#
# The broken bar, its displacement enlarged, and the surface of the crack coloured by its height.


def draw(result: dict, folder: Path) -> None:
    """The broken bar and its crack, the curve and the energies."""
    from matplotlib.colors import to_rgb
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    simulation, crack = result["simulation"], result["crack"]
    x = 1e3 * simulation.scene.bodies.mesh.geometry.x
    moved = x + 1e3 * ENLARGED * result["displacement"]
    faces, cracked = visible_faces(simulation)
    colours = np.where(cracked[:, None], to_rgb("#D55E00"), to_rgb("#9db8d1"))
    height = 1e3 * crack.corners[:, :, 2].mean(axis=1)

    def equal(axes, points, view):
        low, high = points.min(axis=0), points.max(axis=0)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
        axes.set_box_aspect(high - low, zoom=0.95)
        axes.view_init(*view)
        axes.set_xlabel("x (mm)")
        axes.set_ylabel("y (mm)")
        axes.locator_params(nbins=5)

    def fill(figure, panels):
        bar, surface = panels
        bar.add_collection3d(Poly3DCollection(moved[faces], facecolors=colours, shade=True))
        equal(bar, moved.reshape(-1, 3), (18, -150))
        bar.set_zlabel("z (mm)")
        bar.set_title(f"displacement enlarged {ENLARGED:g} times")
        if not len(height):
            return
        triangles = Poly3DCollection(1e3 * crack.corners, edgecolors="0.2", linewidths=0.2)
        triangles.set_array(height)
        surface.add_collection3d(triangles)
        low = np.array([0.0, -0.5 * WIDTH, 1e-3 * height.min()])
        high = np.array([WIDTH, 0.5 * WIDTH, 1e-3 * height.max()])
        equal(surface, 1e3 * np.array([low, high]), (35, -125))
        surface.set_title("cracked facets")
        figure.colorbar(triangles, ax=surface, shrink=0.5, pad=0.12, label="height z (mm)")

    xf.plotting.new_figure(
        folder / "crack.png", fill, (9.0, 5.0), ncols=2, subplot_kw={"projection": "3d"}
    )
    history = result["history"]
    xf.plotting.plot_curves(
        [("", history["strain"], history["stress"])], folder / "stress_strain.png"
    )
    xf.plotting.plot_energies(history, folder / "energies.png", energy_unit=("mJ", 1e-3))


# ## Command line


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Options of the demo."""
    parser = argparse.ArgumentParser(description="Fracture of a notched bar of tetrahedra.")
    add = parser.add_argument
    add("--facet", type=float, default=1.2e-3, help="size of the edges, m (default 1.2e-3)")
    add("--tilt", type=float, default=30.0, help="of the slit, degrees (default 30)")
    add("--friction", type=float, default=0.0, help="Coulomb's, of the crack's lips")
    add("--scheme", choices=("implicit", "explicit"), default="explicit", help="of the bulk")
    add("--step-size", type=float, help="h in s (default: a share of the critical step)")
    add("--final-strain", type=float, default=0.0065)
    xf.add_run_options(parser, Path("results/fracture_3d"))
    options = parser.parse_args(arguments)
    if not 0.0 < options.facet <= DEPTH:
        parser.error(f"--facet should lie in (0, {DEPTH:g}] m, got {options.facet}")
    if not -45.0 <= options.tilt <= 45.0:
        parser.error(f"--tilt should lie in [-45, 45] degrees, got {options.tilt}")
    if not 0.0 < options.final_strain < 1.0:
        parser.error(f"--final-strain should lie in (0, 1), got {options.final_strain}")
    return options


def main(arguments: list[str] | None = None) -> dict:
    """Run the bar and draw it."""
    options = parse(arguments)
    logging.basicConfig(level=logging.WARNING)
    xf.prepare_folder(options.out)
    result = run(scene_of(options.facet, options.tilt, options.friction), options)
    report(result, options)
    if not options.no_plot:
        draw(result, options.out)
    return result


if __name__ == "__main__":
    xf.run_together(main)
