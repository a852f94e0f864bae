# SPDX-License-Identifier: LGPL-3.0-or-later
"""First steps along the path of a Brazilian disc whose broken lips rub.

    ./fenicsx python3 benchmarks/brazilian_disc.py [--facets 3e-3 2e-3] [--friction 0.3 0.6 1]

A disc of 50 mm with two flats of 10 degrees, each triangle a body, crushed between two plates that
do not slip. Stick, slip and opening of all lips are to be found at once for the first step, before
any bond weakens. For each mesh and friction a line has the steps, the iterations of the first one,
the largest load so far and the tensile stress 2 F / (pi D) that an elastic disc has there, and the
processor time.
"""

from __future__ import annotations

import argparse
from itertools import islice
from time import process_time

import numpy as np

import xper_fx as xf

RADIUS, FLAT = 25e-3, np.radians(5.0)
YOUNG, POISSON, DENSITY = 25e9, 0.2, 2400.0
STRENGTH, ENERGY = 4e6, 60.0
BELOW, ABOVE = 1, 2


def disc(facet: float) -> xf.Bodies:
    """The disc in triangles of a size (m), each a body."""
    angles = (-np.pi / 2 - FLAT, -np.pi / 2 + FLAT, np.pi / 2 - FLAT, np.pi / 2 + FLAT)
    options = {"Mesh.Algorithm": 5, "Mesh.MeshSizeMax": facet, "Mesh.MeshSizeMin": facet}
    with xf.gmsh_model("disc", options) as gmsh:
        occ, model = gmsh.model.occ, gmsh.model
        centre = occ.addPoint(0, 0, 0)
        a, b, c, d = [occ.addPoint(RADIUS * np.cos(t), RADIUS * np.sin(t), 0) for t in angles]
        below, above = occ.addLine(a, b), occ.addLine(c, d)
        arcs = occ.addCircleArc(b, centre, c), occ.addCircleArc(d, centre, a)
        loop = occ.addCurveLoop([below, arcs[0], above, arcs[1]])
        surface = occ.addPlaneSurface([loop])
        occ.synchronize()
        model.addPhysicalGroup(2, [surface], 1)
        model.addPhysicalGroup(1, [below], BELOW)
        model.addPhysicalGroup(1, [above], ABOVE)
        model.mesh.generate(2)
        mesh, cell_tags, facet_tags = xf.read_gmsh(model, 2)
    return xf.explode(mesh, cell_tags=cell_tags, facet_tags=facet_tags)


def crush(bodies: xf.Bodies, facet: float, factor: float, friction: float) -> xf.Simulation:
    """The disc with bonds of `factor` E/h; the time is the way of the upper plate in um."""
    bond = xf.laws.CohesiveZone(factor * YOUNG / facet, ENERGY, STRENGTH, friction=friction)
    held = [xf.PrescribedDisplacement(BELOW, axis, 0.0) for axis in (0, 1)]
    held.append(xf.PrescribedDisplacement(ABOVE, 0, 0.0))
    scene = xf.Scene(
        bodies,
        {1: xf.materials.LinearElastic(YOUNG, POISSON, DENSITY)},
        default_interaction=bond,
        loads=[*held, xf.PrescribedDisplacement(ABOVE, 1, lambda t: -1e-6 * t)],
    )
    return xf.Simulation(scene, 1.0, inertia=False, path=xf.GrowthControl(), num_threads=1)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--facets", type=float, nargs="+", default=[3e-3, 2e-3], help="(m)")
    parser.add_argument("--factors", type=float, nargs="+", default=[10.0, 100.0])
    parser.add_argument("--friction", type=float, nargs="+", default=[0.3, 0.6, 1.0])
    parser.add_argument("--steps", type=int, default=2)
    options = parser.parse_args(arguments)
    for facet in options.facets:
        bodies = disc(facet)
        for factor in options.factors:
            for friction in options.friction:
                simulation = crush(bodies, facet, factor, friction)
                begin, largest, iterations = process_time(), 0.0, []
                for step in islice(simulation.steps(1e3), options.steps):
                    largest = max(largest, -simulation.reaction(ABOVE)[1])
                    iterations.append(step.newton_iterations)
                print(
                    f"{1e3 * facet:g} mm, {bodies.num_bodies} bodies, {factor:g} E/h, "
                    f"mu {friction:g}: {len(iterations)} steps, {iterations[0]} iterations in the "
                    f"first, {1e-3 * largest:.1f} kN/m, {largest / np.pi / RADIUS / 1e6:.2f} MPa, "
                    f"{process_time() - begin:.1f} s",
                    flush=True,
                )


if __name__ == "__main__":
    main()
