# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two rates a decade apart: what is inertia, and what is the material.

The composite of the periodic ductile demo as one connected body, Fbar_11 at a rate, Pibar_22 = 0,
with inertia at two rates and without inertia. The plastic matrix knows no rate, so that all that
differs from the static run is the inertia of the fluctuation; a viscous matrix (one Maxwell branch,
relaxation time 0.5 us) differs between static runs too, and that is the material. `--cracks` runs
the demo's own cell, each triangle a body, at both rates (some minutes).

    ./fenicsx python3 benchmarks/rate_study.py [--cells 20] [--cracks]
"""

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "demos"))
import periodic_ductile as demo

from xper_fx.bodies.explode import explode
from xper_fx.bodies.meshes import crossed_rectangle, in_rectangles, tag_cells
from xper_fx.materials import LinearElastic, LinearViscoelastic
from xper_fx.materials.library import DENSITY, HYDRIDE, ZIRCALOY_4, ZIRCALOY_4_DUCTILE
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

RATES = (4e4, 4e3)
STRAINS = (0.002, 0.004, 0.008)
MATRICES = {
    "plastic": ZIRCALOY_4_DUCTILE,
    "viscous": LinearViscoelastic(
        ZIRCALOY_4.young, ZIRCALOY_4.poisson, prony=((0.5, 5e-7),), density=DENSITY
    ),
}


def connected(quads: int, matrix, rate: float) -> Scene:
    """The demo's composite, uncut."""
    mesh = crossed_rectangle((0.0, 0.0), (demo.SIZE, demo.SIZE), (quads, quads))
    inside = in_rectangles(demo.UNIT * np.array(demo.LAYOUTS["bands"]))
    tags = tag_cells(mesh, {demo.INCLUSION: inside}, demo.MATRIX)
    bodies = explode(mesh, np.zeros(len(tags.values), int), tags, lattice=(demo.SIZE, demo.SIZE))
    inclusion = LinearElastic(HYDRIDE.young, HYDRIDE.poisson, DENSITY)
    return Scene(
        bodies,
        {demo.MATRIX: matrix, demo.INCLUSION: inclusion},
        macroscopic=demo.drive(rate, "free"),
    )


def curve(simulation: Simulation, rate: float, end: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Strains, stresses (Pa), and the largest share of kinetic energy in the work."""
    strain, stress, kinetic = [0.0], [0.0], 0.0
    for step in simulation.steps(end / rate):
        strain.append(float(simulation.macroscopic.gradient[0, 0]) - 1.0)
        stress.append(float(simulation.macroscopic.stress[0, 0]))
        kinetic = max(kinetic, step.energies["kinetic"] / step.energies["external_work"])
    return np.array(strain), np.array(stress), kinetic


def show(name: str, rate: float, strain, stress, kinetic, static=None) -> None:
    """One line of the table."""
    at = np.interp(STRAINS, strain, stress) / 1e6
    line = f"{name:<24}{rate:>9.0e}" + "".join(f"{s:>9.1f}" for s in at) + f"{kinetic:>11.1e}"
    if static is not None:
        apart = np.abs(stress - np.interp(strain, *static)).max() / np.abs(static[1]).max()
        line += f"{apart:>12.1e}"
    print(line)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=20)
    parser.add_argument("--steps", type=int, default=400)
    parser.add_argument("--cracks", action="store_true")
    options = parser.parse_args()
    end = STRAINS[-1]
    titles = "".join(f"{100 * s:>7.1f} %" for s in STRAINS)
    print(f"{'P11 (MPa) at':<24}{'rate 1/s':>9}{titles}{'kinetic':>11}{'off static':>12}")
    for name, matrix in MATRICES.items():
        for rate in RATES:
            scene, step = connected(options.cells, matrix, rate), end / rate / options.steps
            static = curve(Simulation(scene, step, theta=1.0, inertia=False), rate, end)
            show(f"{name}, static", rate, *static)
            moving = curve(Simulation(scene, step), rate, end)
            show(f"{name}, inertia", rate, *moving, static=static[:2])
    if options.cracks:
        for rate in RATES:
            scene = demo.periodic_composite(options.cells, rate=rate)
            run = curve(Simulation(scene, 5e-10 * max(1.0, 2e4 / rate)), rate, 0.012)
            show("each cell a body", rate, *run)
            top = int(run[1].argmax())
            print(f"{'':<24}peak {run[1][top] / 1e6:.0f} MPa at {100 * run[0][top]:.2f} %")


if __name__ == "__main__":
    main()
