# SPDX-License-Identifier: LGPL-3.0-or-later
"""A pendulum of large swings over ten thousand steps: drift and order of joints.

    ./fenicsx python3 benchmarks/joints.py [--steps 10000] [--figure joints.png]
    ./fenicsx python3 benchmarks/joints.py --chains

A bar hangs on a hinge at its end and is let go at 2 rad. Printed are, for steps of 10, 5 and
2.5 ms: the error of its period beside 4 K(sin(phi_0 / 2)) / omega_0, the largest error of its
energy in the first and in the last tenth of the run, beside the energy 2 m g a of the upright bar,
and the largest gap of the hinge in the first and in the last tenth. The figure
shows energy and gap. The second command prints how long a step of chains of 10 and 100 bars takes
that fall from the horizontal.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy.special import ellipk

import xper_fx as xf

G, HALF, START = 9.81, 0.5, 2.0


def swing(step: float, count: int) -> dict[str, np.ndarray]:
    """Angle (rad), relative error of the energy and gap of the hinge (m) after each step."""
    place = HALF * np.array([np.sin(START), -np.cos(START)])
    shape = xf.rigid.Polygon.box((0.1, 2.0 * HALF))
    bar = xf.RigidBody(shape, place, "bar", angle=START, density=10.0)
    scene = xf.Scene(
        rigid=[bar], joints=[xf.Hinge((None, bar), (0.0, 0.0))], loads=[xf.Gravity((0.0, -G))]
    )
    simulation = xf.Simulation(scene, step, num_threads=1)
    most = 2.0 * scene.rigid_bodies.mass[0] * G * HALF
    rows = []
    for record in simulation.steps(count * step):
        state, energies = simulation.rigid.state, record.energies
        angle = state.turn.rotation[0]
        end = state.position[0] - HALF * np.array([np.sin(angle), -np.cos(angle)])
        error = (energies["kinetic"] - energies["external_work"]) / most
        rows.append((record.time, angle, error, np.hypot(*end)))
    return dict(zip(("time", "angle", "energy", "gap"), np.array(rows).T, strict=True))


def period_error(run: dict[str, np.ndarray]) -> float:
    """Of the mean period, relative."""
    time, angle = run["time"], run["angle"]
    at = np.flatnonzero((angle[:-1] > 0.0) & (angle[1:] <= 0.0))
    share = angle[at] / (angle[at] - angle[at + 1])
    passes = time[at] + share * (time[at + 1] - time[at])
    inertia = (0.1**2 + (2.0 * HALF) ** 2) / 12.0 + HALF**2
    exact = 4.0 * np.sqrt(inertia / (G * HALF)) * ellipk(np.sin(START / 2.0) ** 2)
    return float(np.diff(passes).mean() / exact - 1.0)


def chain(count: int, steps: int = 100) -> float:
    """Time of a step of a chain of bars (s)."""
    length = 1.0 / count
    shape = xf.rigid.Polygon.box((length, 0.004))
    bars = [
        xf.RigidBody(shape, ((i + 0.5) * length, 0.0), "bars", density=100.0) for i in range(count)
    ]
    joints = [
        xf.Hinge((first, second), (i * length, 0.0))
        for i, (first, second) in enumerate(zip([None, *bars], bars, strict=False))
    ]
    scene = xf.Scene(rigid=bars, joints=joints, loads=[xf.Gravity((0.0, -G))])
    simulation = xf.Simulation(scene, 2e-3, num_threads=1)
    for _ in simulation.steps(0.02):  # compiles
        pass
    start = perf_counter()
    for _ in simulation.steps(0.02 + 2e-3 * steps):
        pass
    return (perf_counter() - start) / steps


def plot(runs: dict[float, dict[str, np.ndarray]], path: Path) -> None:
    """Energy and gap of all runs over time."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(7, 4.5), layout="constrained")
    for step, run in runs.items():
        label = f"h = {1e3 * step:g} ms"
        above.plot(run["energy"], lw=0.6, label=label)
        below.semilogy(np.maximum(run["gap"], 1e-9), lw=0.6)
    above.set_ylabel("error of the energy / 2 m g a")
    below.set_ylabel("gap of the hinge (m)")
    below.set_xlabel("step")
    above.legend(loc="upper right")
    figure.savefig(path, dpi=150)


def main() -> None:
    """Print the table, draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=10_000)
    parser.add_argument("--figure", type=Path)
    parser.add_argument("--chains", action="store_true")
    options = parser.parse_args()
    if options.chains:
        short, long = chain(10), chain(100)
        print(f"a step of 10 bars {1e3 * short:.2f} ms, of 100 {1e3 * long:.2f} ms")
        return
    runs = {step: swing(step, options.steps) for step in (10e-3, 5e-3, 2.5e-3)}
    tenth = max(options.steps // 10, 1)
    print(" h (ms)     period  energy first      last  gap first      last")
    for step, run in runs.items():
        energy, gap = np.abs(run["energy"]), run["gap"]
        print(
            f"{1e3 * step:7.1f}{period_error(run):11.2e}{energy[:tenth].max():14.2e}"
            f"{energy[-tenth:].max():10.2e}{gap[:tenth].max():11.2e}{gap[-tenth:].max():10.2e}"
        )
    if options.figure is not None:
        plot(runs, options.figure)


if __name__ == "__main__":
    main()
