# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where the energy of a broken plate goes: cracks, friction, lips that close; by step and mesh.

    OPENBLAS_NUM_THREADS=1 ./fenicsx python3 benchmarks/rubble_energy.py [--cells 20 40]

The notched plate as printed, and with fracture energies that its mesh resolves, pulled to the same
strain with steps of 0.95, 0.48 and 0.24 of the critical one, and on two meshes. Energies are shares
of the external work at the end.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "demos"))

import notched_plate as plate

import xper_fx as xf

COURANTS = (0.95, 0.475, 0.2375)
TERMS = ("dissipated_cohesion", "dissipated_friction", "dissipated_impact")


def shares(cells: int, toughening: float, courant: float, strain: float) -> dict[str, float]:
    """External work (J/m) and what it became, as shares of it."""
    scene = plate.notched_plate(cells, "strong", toughening=toughening)
    critical = xf.Simulation(scene, num_threads=1).bulk.critical_step()
    end = strain * plate.SIZE / (2.0 * plate.SPEED)
    step = end / np.ceil(end / (courant * critical))
    simulation = xf.Simulation(scene, step, scheme="explicit", num_threads=1)
    *_, last = simulation.steps(end)
    e = last.energies
    held = e["kinetic"] + e["elastic"] + e["cohesive"]
    return {"work": e["external_work"], "held": held / e["external_work"]} | {
        name.removeprefix("dissipated_"): e[name] / e["external_work"] for name in TERMS
    }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Energy of rubble, by step and mesh.")
    parser.add_argument("--cells", type=int, nargs="+", default=[20, 40])
    cells = parser.parse_args().cells
    print("| plate | quads | step / critical | work (mJ/m) | cracks | friction | closing lips |")
    print("|---" * 7 + "|")
    for name, toughening, strain in (
        ("as printed", 1.0, 0.006),
        ("resolved", plate.toughening(), 0.012),
    ):
        for count in cells:
            for courant in COURANTS:
                s = shares(count, toughening, courant, strain)
                print(
                    f"| {name} | {count} | {courant:g} | {1e3 * s['work']:.3g} | "
                    f"{100 * s['cohesion']:.1f} % | {100 * s['friction']:.1f} % | "
                    f"{100 * s['impact']:.1f} % |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
