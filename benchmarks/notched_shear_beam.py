# SPDX-License-Identifier: LGPL-3.0-or-later
"""Path of a notched beam in four-point shear, by the slide of the notch (Arrea and Ingraffea 1982).

    ./fenicsx python3 benchmarks/notched_shear_beam.py [--facet 12e-3] [--shear 1 3]

A beam of concrete, 1322 x 306 x 156 mm, with a notch of 82 mm below, on supports at -61 and 458 mm
from the notch, loaded by P at 61 and 0.13 P at -458 mm, so that its middle is sheared without a
moment. The crack runs from the notch to the right of P. The cells of the corridor are bodies. Bonds
have 2.8 MPa and 100 J/m^2 in opening, and in shear the given multiple of that strength with ten
times the energy; with 1 both are those of opening (`CohesiveZone`). For each a line has the largest
load (kN), the slide of the notch's mouth there (mm), the load where that is 0.1 and 0.2 mm, steps
and processor time.
"""

from __future__ import annotations

import argparse
from time import process_time

import numpy as np

import xper_fx as xf

YOUNG, POISSON, DENSITY = 24.8e9, 0.18, 2400.0
STRENGTH, ENERGY, DEPTH, HEIGHT, NOTCH = 2.8e6, 100.0, 0.156, 0.306, 0.082
LEFT, RIGHT, LOAD, SMALL_LOAD = 1, 2, 3, 4
CORNERS = [
    (-0.661, 0), (-0.071, 0), (-0.061, 0), (-0.003, 0), (-0.003, NOTCH), (0.003, NOTCH), (0.003, 0),
    (0.458, 0), (0.468, 0), (0.661, 0), (0.661, HEIGHT), (0.071, HEIGHT), (0.051, HEIGHT),
    (-0.448, HEIGHT), (-0.468, HEIGHT), (-0.661, HEIGHT),
]  # fmt: skip
LAST = 0.2  # slide (mm) at which a run ends


def beam(facet: float) -> xf.Bodies:
    """The beam, whose cells near the crack to come are bodies of a size (m)."""
    with xf.gmsh_model("beam", {"Mesh.Algorithm": 5}) as gmsh:
        occ, model = gmsh.model.occ, gmsh.model
        points = [occ.addPoint(x, y, 0) for x, y in CORNERS]
        after = [*points[1:], points[0]]
        lines = [occ.addLine(a, b) for a, b in zip(points, after, strict=True)]
        surface = occ.addPlaneSurface([occ.addCurveLoop(lines)])
        occ.synchronize()
        model.addPhysicalGroup(2, [surface], 1)
        for tag, line in ((LEFT, 1), (RIGHT, 7), (LOAD, 11), (SMALL_LOAD, 13)):
            model.addPhysicalGroup(1, [lines[line]], tag)
        box = model.mesh.field.add("Box")
        sizes = {"VIn": facet, "VOut": 4.0 * facet, "Thickness": 0.1}
        corridor = {"XMin": -0.02, "XMax": 0.16, "YMin": 0.05, "YMax": HEIGHT}
        for name, value in (sizes | corridor).items():
            model.mesh.field.setNumber(box, name, value)
        model.mesh.field.setAsBackgroundMesh(box)
        model.mesh.generate(2)
        mesh, cell_tags, facet_tags = xf.read_gmsh(model, 2)
    x, y, _ = mesh.geometry.x[xf.geometry_dofmap(mesh)].mean(axis=1).T
    below_load = (y > HEIGHT - 0.03) & (abs(x - 0.061) < 0.025)
    body = np.where((x > -0.03) & (x < 0.17) & (y > 0.06), 3 + np.arange(len(x)), x > 0)
    return xf.explode(mesh, np.where(below_load, 2, body), cell_tags, facet_tags)


def scene(bodies: xf.Bodies, stiffness: float, shear: float) -> xf.Scene:
    """The beam with bonds of a stiffness (Pa/m); P is 100 kN at a time of 1."""
    if shear == 1.0:
        bond = xf.laws.CohesiveZone(stiffness, ENERGY, STRENGTH, curve=xf.laws.curves.Exponential())
    else:
        strengths, energies = (STRENGTH, shear * STRENGTH), (ENERGY, 10.0 * ENERGY)
        curve = xf.laws.curves.Exponential()
        bond = xf.laws.MixedMode(stiffness, strengths, energies, 2.0, curve=curve)
    pressure = 100e3 / (0.02 * DEPTH)
    held = [
        xf.PrescribedDisplacement(LEFT, axis, 0.0, where=lambda x: np.isclose(x[0], -0.061))
        for axis in (0, 1)
    ]
    return xf.Scene(
        bodies,
        {1: xf.materials.LinearElastic(YOUNG, POISSON, DENSITY, plane="stress")},
        default_interaction=bond,
        loads=[
            *held,
            xf.PrescribedDisplacement(RIGHT, 1, 0.0, where=lambda x: np.isclose(x[0], 0.458)),
            xf.SurfaceTraction(LOAD, lambda t: (0.0, -pressure * t)),
            xf.SurfaceTraction(SMALL_LOAD, lambda t: (0.0, -0.13 * pressure * t)),
        ],
    )


def follow(simulation: xf.Simulation) -> np.ndarray:
    """Slide of the notch's mouth (mm) and load P (kN) of each step."""
    nodes = simulation.forms.V.tabulate_dof_coordinates()
    left, right = (np.argmin(np.hypot(nodes[:, 0] - x, nodes[:, 1])) for x in (-0.003, 0.003))
    rows = [(0.0, 0.0)]
    for step in simulation.steps(3.0):
        lift = simulation.state.displacement.reshape(-1, 2)[:, 1]
        rows.append((1e3 * (lift[left] - lift[right]), 100.0 * step.time))
        if rows[-1][0] > LAST:
            break
    return np.array(rows)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--facet", type=float, default=12e-3, help="(m)")
    parser.add_argument("--stiffness", type=float, default=10.0, help="of bonds, in E/h")
    parser.add_argument("--shear", type=float, nargs="+", default=[1.0, 3.0])
    options = parser.parse_args(arguments)
    bodies, begin = beam(options.facet), process_time()
    for shear in options.shear:
        bonded = scene(bodies, options.stiffness * YOUNG / options.facet, shear)
        simulation = xf.Simulation(bonded, 1.0, inertia=False, path=xf.GrowthControl())
        slide, load = follow(simulation).T
        first, second = np.interp((0.1, LAST), slide, load)
        begin, spent = process_time(), process_time() - begin
        print(
            f"{1e3 * options.facet:g} mm, {bodies.num_bodies} bodies, {options.stiffness:g} E/h, "
            f"shear {shear:g}: {load.max():.1f} kN at {slide[load.argmax()]:.3f} mm, "
            f"{first:.1f} kN at 0.1 mm, {second:.1f} kN at 0.2 mm, {len(load) - 1} steps, "
            f"{spent:.0f} s",
            flush=True,
        )


if __name__ == "__main__":
    main()
