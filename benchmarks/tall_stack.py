# SPDX-License-Identifier: LGPL-3.0-or-later
"""A tower of a hundred blocks that should stand: how far it drifts, leans and sinks in ten seconds.

With default settings it does. By sweeps that just meet the tolerance (`--solver nlgs`) it leans
more and more: at the velocity level nothing takes back what they let blocks sink at one edge more
than at the other. At the position level with theta = 1 (`--contact position`) it stands by any
solver.

./fenicsx python3 benchmarks/tall_stack.py --dim 2
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from tqdm.auto import tqdm

from xper_fx.forms.loads import Gravity
from xper_fx.nscd.laws import SignoriniCoulomb
from xper_fx.nscd.rigid.body import RigidBody, wall
from xper_fx.nscd.rigid.polygon import Polygon
from xper_fx.nscd.rigid.polyhedron import Polyhedron
from xper_fx.scene.contact import Contact
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation


def tower(
    dim: int, count: int, step: float, tolerance: float, contact: str, **options
) -> Simulation:
    """Blocks with sides of 1 m on the ground, 1000 kg/m^3, friction 0.5."""
    shape = Polygon.box((1.0,) * 2) if dim == 2 else Polyhedron.box((1.0,) * 3)
    flat = (0.0,) * (dim - 1)
    bodies = [RigidBody(shape, (*flat, 0.5 + i), "blocks", density=1000.0) for i in range(count)]
    law = SignoriniCoulomb(friction=0.5, contact=contact)
    scene = Scene(
        rigid=[*bodies, wall((*flat, 0.0), (*flat, 1.0), "ground")],
        contacts=[Contact(("blocks", "blocks"), law), Contact(("blocks", "ground"), law)],
        loads=[Gravity((*flat, -9.81))],
    )
    theta = 1.0 if contact == "position" else 0.5
    return Simulation(scene, step, theta=theta, tolerance=tolerance, num_threads=1, **options)


def main(options: list[str] | None = None) -> None:
    """Run and print what the tower has done after each tenth of the time."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--dim", type=int, choices=(2, 3), default=2)
    add("--blocks", type=int, default=100)
    add("--step", type=float, default=5e-3, help="s")
    add("--tolerance", type=float, default=1e-3, help="relative violation of the laws")
    add("--contact", choices=("position", "velocity"), default="velocity")
    add("--solver", default="auto")
    add("--end", type=float, default=10.0, help="s")
    add("--quiet", action="store_true", help="no progress bar")
    args = parser.parse_args(options)
    simulation = tower(
        args.dim, args.blocks, args.step, args.tolerance, args.contact, solver=args.solver
    )
    start, last, sweeps = simulation.rigid.state.position.copy(), time.process_time(), 0
    count = round(args.end / args.step)
    look = max(1, count // 10)
    print("| time (s) | drift (m) | sinking (m) | depth (m) | kinetic (J) | sweeps | s a step |")
    print("|---|---|---|---|---|---|---|", flush=True)
    for record in tqdm(simulation.steps(args.end), total=count, disable=args.quiet):
        sweeps += record.sweeps
        if record.step % look:
            continue
        moved = simulation.rigid.state.position - start
        depth = -min(g.jump[:, 0].min() for g in simulation.interactions.contacts)
        now = time.process_time()
        print(
            f"| {record.time:.3g} | {np.abs(moved[:, :-1]).max():.1e} | "
            f"{np.abs(moved[:, -1]).max():.1e} | {depth:.1e} | {record.energies['kinetic']:.1e} | "
            f"{sweeps / look:.1f} | {(now - last) / look:.1e} |",
            flush=True,
        )
        last, sweeps = now, 0


if __name__ == "__main__":
    main()
