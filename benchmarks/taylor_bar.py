# SPDX-License-Identifier: LGPL-3.0-or-later
"""Taylor's test: a copper bar hits a rigid wall at 227 m/s, and ends as a mushroom.

    ./fenicsx python3 benchmarks/taylor_bar.py [--kind tetrahedra hexahedra] [--cells 2] [--order 2]

A bar of 32.4 mm and radius 3.2 mm, E = 117 GPa, nu = 0.35, 8930 kg/m^3, yield stress 400 MPa,
hardening 100 MPa, without friction; an explicit bulk of a quarter to 80 us, when all has come to
rest. After Wilkins and Guinan (1973). Published radii of the face at the wall: 7.12 mm (Simo 1992),
7.11 mm (Zienkiewicz and others 1998), 7.22 mm (Foulk and others 2021, hexahedra of 0.047 mm with a
mean pressure each). The code Carina has 21.42 mm of length in its own benchmark of this bar, with
tetrahedra of 15 nodes, and 5.45 mm of radius at 12 us. Cells are flattened at the wall: with
quadratic tetrahedra the stable step falls to less than a fifth.
"""

from __future__ import annotations

import argparse
import time
from typing import NamedTuple

import gmsh
import numpy as np

import xper_fx as xf

LENGTH, RADIUS, SPEED, END = 32.4e-3, 3.2e-3, 227.0, 80e-6
COPPER = xf.materials.J2FiniteStrain(
    young=117e9, poisson=0.35, yield_stress=400e6, hardening=xf.materials.Linear(100e6),
    density=8930.0,
)  # fmt: skip
FRONT, SIDE_X, SIDE_Y, REAR = 1, 2, 3, 4


class Shape(NamedTuple):
    """The bar at the end: length and largest radius (m), energies (J), the last step (s)."""

    length: float
    radius: float
    energies: dict[str, float]
    step: float


def quarter(kind: str, cells: int):
    """A quarter of the bar in three blocks, `cells` from the axis to half of the radius."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    geo, diagonal = gmsh.model.geo, RADIUS / np.sqrt(2.0)
    places = [(0, 0), (0.5 * RADIUS, 0), (0.4 * RADIUS, 0.4 * RADIUS), (0, 0.5 * RADIUS),
              (RADIUS, 0), (diagonal, diagonal), (0, RADIUS)]  # fmt: skip
    o, a, b, c, x, xy, y = (geo.addPoint(*place, 0) for place in places)
    inner = [geo.addLine(*ends) for ends in ((o, a), (a, b), (b, c), (c, o))]
    outer = [geo.addLine(a, x), geo.addCircleArc(x, o, xy), geo.addLine(xy, b),
             geo.addCircleArc(xy, o, y), geo.addLine(y, c)]  # fmt: skip
    ax, arc, down, arc_y, back = outer
    loops = (inner, [ax, arc, down, -inner[1]], [-down, arc_y, back, -inner[2]])
    surfaces = [geo.addPlaneSurface([geo.addCurveLoop(loop)]) for loop in loops]
    for line in inner + outer:
        geo.mesh.setTransfiniteCurve(line, cells + 1)
    for surface in surfaces:
        geo.mesh.setTransfiniteSurface(surface)
        if kind == "hexahedra":
            geo.mesh.setRecombine(2, surface)
    layers = round(1.2 * cells * LENGTH / RADIUS)
    grown = geo.extrude([(2, surface) for surface in surfaces], 0, 0, LENGTH,
                        numElements=[layers], recombine=kind == "hexahedra")  # fmt: skip
    geo.synchronize()
    gmsh.model.addPhysicalGroup(3, [tag for dim, tag in grown if dim == 3], 1)
    gmsh.model.mesh.generate(3)
    mesh, *_ = xf.read_gmsh(gmsh.model, 3)
    gmsh.finalize()
    return mesh


def impact(kind: str, cells: int, order: int, end: float = END) -> Shape:
    """The bar after an impact of `end` (s)."""
    mesh = quarter(kind, cells)
    tags = xf.tag_facets(mesh, {
        FRONT: lambda x: x[2] < 1e-9, SIDE_X: lambda x: x[0] < 1e-9,
        SIDE_Y: lambda x: x[1] < 1e-9, REAR: lambda x: x[2] > LENGTH - 1e-9,
    })  # fmt: skip
    one_body = np.zeros(mesh.topology.index_map(3).size_local, int)
    scene = xf.Scene(
        xf.explode(mesh, one_body, facet_tags=tags),
        {1: COPPER},
        order=order,
        walls=[xf.Wall(FRONT, (0, 0, 0), (0, 0, 1), xf.laws.SignoriniCoulomb(friction=0.0))],
        loads=[xf.PrescribedVelocity(SIDE_X, 0, 0.0), xf.PrescribedVelocity(SIDE_Y, 1, 0.0)],
        initial_velocity=lambda x: np.stack([0.0 * x[0], 0.0 * x[0], -SPEED + 0.0 * x[0]]),
    )
    simulation = xf.Simulation(scene, scheme="explicit")
    *_, record = simulation.steps(end)
    place = simulation.forms.V.tabulate_dof_coordinates()
    place = place + simulation.bulk.unknowns.expand(simulation.state.displacement).reshape(-1, 3)
    radius = np.hypot(place[:, 0], place[:, 1]).max()
    length = LENGTH + simulation.mean_displacement(REAR)[2]
    return Shape(length, radius, record.energies, record.size)


def main(arguments: list[str] | None = None) -> None:
    """Print length and radius at the end for the meshes asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kind", nargs="+", default=["tetrahedra", "hexahedra"])
    parser.add_argument("--cells", type=int, nargs="+", default=[2])
    parser.add_argument("--order", type=int, nargs="+", default=[2])
    options = parser.parse_args(arguments)
    print("| elements | order | cells | length (mm) | radius (mm) | energy balance | time (s) |")
    print("|---|---|---|---|---|---|---|")
    for kind in options.kind:
        for order in [1] if kind == "hexahedra" else options.order:
            for cells in options.cells:
                start = time.process_time()
                shape = impact(kind, cells, order)
                spent = time.process_time() - start
                balance = shape.energies["closure"] / shape.energies["dissipated_plastic"]
                print(
                    f"| {kind} | {order} | {cells} | {1e3 * shape.length:.2f} "
                    f"| {1e3 * shape.radius:.2f} | {balance:.1e} | {spent:.0f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
