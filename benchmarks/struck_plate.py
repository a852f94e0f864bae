# SPDX-License-Identifier: LGPL-3.0-or-later
"""What contacts cost an explicit bulk whose bonds weaken.

    ./fenicsx python3 benchmarks/struck_plate.py [--cells 20 40 80]

A steel disc strikes a ceramic plate, four times as wide as it is high, of so many squares of four
triangles across, whose pieces may strike each other. It prints the median time of a step before the
disc touches, while searched for alone, and of those in which contacts push, their number, the turns
that contacts and vertices take (sweeps over contacts), and the energies at the end.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

import xper_fx as xf

HEIGHT, RADIUS, SPEED = 5e-3, 3e-3, 30.0
ENDS = 1
CERAMIC = xf.materials.LinearElastic(young=300e9, poisson=0.2, density=3900.0)
RUB = xf.laws.SignoriniCoulomb(friction=0.3)


def plate_and_disc(cells: int) -> xf.Scene:
    """The scene; bonds are 50 times as stiff as cells."""
    width, size = 4.0 * HEIGHT, 4.0 * HEIGHT / (4 * cells)
    mesh = xf.crossed_rectangle((-0.5 * width, 0.0), (0.5 * width, HEIGHT), (4 * cells, cells))
    ends = xf.tag_facets(mesh, {ENDS: lambda x: np.abs(x[0]) > 0.5 * width - 1e-9})
    bond = xf.laws.CohesiveZone(
        50.0 * CERAMIC.young / size, fracture_energy=50.0,
        strength=xf.fields.Weibull(300e6, 10.0, seed=1),
    )  # fmt: skip
    disc = xf.RigidBody(
        xf.rigid.Disc(RADIUS), (0.0, HEIGHT + RADIUS + 2e-6), "disc", density=7800.0,
        velocity=(0.0, -SPEED),
    )  # fmt: skip
    return xf.Scene(
        xf.explode(mesh, facet_tags=ends), {1: CERAMIC}, default_interaction=bond,
        loads=[xf.PrescribedVelocity(ENDS, 0, 0.0), xf.PrescribedVelocity(ENDS, 1, 0.0)],
        rigid=[disc], surfaces={"plate": (1,)},
        contacts=[xf.Contact(pair, RUB) for pair in (("disc", "plate"), ("plate", "plate"))],
    )  # fmt: skip


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="+", default=[10, 20, 40])
    parser.add_argument("--end", type=float, default=3e-7, help="s")
    options = parser.parse_args()
    print(f"{'cells':>6} {'points':>8} {'steps':>6} {'apart, ms':>10} {'touch, ms':>10} "
          f"{'contacts':>9} {'sweeps':>7} {'cohesion, J/m':>14} {'closure, J/m':>13}")  # fmt: skip
    for cells in options.cells:
        simulation = xf.Simulation(plate_and_disc(cells), scheme="explicit", num_threads=1)
        apart, touch, sweeps, most, begun = [], [], [], 0, time.perf_counter()
        for record in simulation.steps(options.end):
            taken = time.perf_counter() - begun
            contacts = simulation.interactions.contacts
            pushing = sum(np.count_nonzero(g.impulse[:, 0]) for g in contacts)
            (touch if pushing else apart).append(taken)
            if pushing:
                sweeps.append(record.sweeps)
            most, begun = max(most, pushing), time.perf_counter()
        print(f"{cells:6d} {simulation.interactions.num_points:8d} {record.step:6d} "
              f"{1e3 * np.median(apart):10.2f} {1e3 * np.median(touch):10.2f} {most:9d} "
              f"{np.median(sweeps):7.0f} {record.energies['dissipated_cohesion']:14.4g} "
              f"{record.energies['closure']:13.2g}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
