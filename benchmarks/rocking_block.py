# SPDX-License-Identifier: LGPL-3.0-or-later
"""A free rocking block (Housner 1963): how the errors of a run fall with its step.

A block 0.5 m wide and 2 m high is let go at half the angle at which it would overturn. Until it is
upright theta'' = -p^2 sin(alpha - theta), p^2 = 3 g / (4 R); there its other edge hits the ground,
and it goes on with 1 - 1.5 sin^2(alpha) of its speed of rotation. Where the impact falls within a
step is chance, so that errors are root mean squares over eight angles around the first.

./fenicsx python3 benchmarks/rocking_block.py
"""

from __future__ import annotations

import argparse
from functools import cache

import numpy as np
from scipy.integrate import solve_ivp
from tqdm.auto import tqdm

import xper_fx as xf

WIDTH, HEIGHT, GRAVITY = 0.5, 2.0, 9.81
RADIUS, ALPHA = 0.5 * np.hypot(WIDTH, HEIGHT), np.arctan2(WIDTH, HEIGHT)
SQUARE = 0.75 * GRAVITY / RADIUS
RATIO = 1.0 - 1.5 * np.sin(ALPHA) ** 2
# When the angle is compared (s), long before the impact.
EARLY = 0.256


def rocking(angle: float, step: float, contact="velocity", theta=0.5) -> xf.Simulation:
    """The block, tilted to the right about its lower right corner (rad)."""
    cos, sin = np.cos(angle), np.sin(angle)
    centre = (
        0.5 * (WIDTH - WIDTH * cos + HEIGHT * sin),
        0.5 * (WIDTH * sin + HEIGHT * cos),
    )
    shape = xf.rigid.Polygon.box((WIDTH, HEIGHT))
    block = xf.RigidBody(shape, centre, "block", angle=-angle, density=1000.0)
    law = xf.laws.SignoriniCoulomb(friction=1.0, contact=contact)
    scene = xf.Scene(
        rigid=[block, xf.rigid.wall((0.0, 0.0), (0.0, 1.0), "ground")],
        contacts=[xf.Contact(("block", "ground"), law, reach=0.05)],
        loads=[xf.Gravity((0.0, -GRAVITY))],
    )
    return xf.Simulation(scene, step, theta=theta, tolerance=1e-9)


def course(angle: float, step: float, **scheme) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, angles and speeds of rotation up to 0.2 s after the block is upright."""
    simulation, rows = rocking(angle, step, **scheme), [(0.0, -angle, 0.0)]
    for record in simulation.steps(exact(angle)[0] + 0.2):
        turn = simulation.rigid.state.turn
        rows.append((record.time, turn.rotation.item(0), turn.spin.item(0)))
    return tuple(np.array(rows).T)


@cache
def exact(angle: float) -> tuple[float, float]:
    """When the block is upright (s), and its angle at `EARLY` (rad)."""

    def upright(time, state):
        return state[0]

    solution = solve_ivp(
        lambda time, state: (state[1], -SQUARE * np.sin(ALPHA - state[0])), (0.0, 3.0),
        (angle, 0.0), events=upright, rtol=1e-12, atol=1e-14, dense_output=True,
    )  # fmt: skip
    return float(solution.t_events[0][0]), float(solution.sol(EARLY)[0])


def speed_upright(angle: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """The speed of rotation that the block would have upright, by its energy."""
    return np.sqrt(speed**2 + 2.0 * SQUARE * (np.cos(ALPHA - abs(angle)) - np.cos(ALPHA)))


def errors(angle: float, step: float, **scheme) -> tuple[float, float, float]:
    """Of the angle (rad), the quarter of the period (s) and the ratio of speeds."""
    time, turn, speed = course(angle, step, **scheme)
    when, early = exact(angle)
    first = int(np.argmax(turn >= 0.0))
    share = -turn[first - 1] / (turn[first] - turn[first - 1])
    crossed = time[first - 1] + share * (time[first] - time[first - 1])
    at = speed_upright(turn, speed)
    margin = round(0.05 / step)
    ratio = at[first + margin] / at[first - margin]
    return -np.interp(EARLY, time, turn) - early, crossed - when, ratio - RATIO


def main(options: list[str] | None = None) -> None:
    """Print errors and their order."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--steps", type=float, nargs="+", default=[4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4], help="s")
    add("--quiet", action="store_true", help="no progress bar")
    args = parser.parse_args(options)
    tilts = ALPHA * (0.5 + 0.004 * np.arange(8))
    found = np.array(
        [
            np.sqrt(np.mean([np.square(errors(tilt, step)) for tilt in tilts], axis=0))
            for step in tqdm(args.steps, disable=args.quiet)
        ]
    )
    print("| step (s) | angle at 0.256 s (rad) | quarter period (s) | ratio of speeds |")
    print("|---|---|---|---|")
    for step, row in zip(args.steps, found, strict=True):
        print(f"| {step:g} | " + " | ".join(f"{error:.1e}" for error in row) + " |")
    orders = np.polyfit(np.log(args.steps), np.log(found), 1)[0]
    print("| order | " + " | ".join(f"{order:.2f}" for order in orders) + " |")


if __name__ == "__main__":
    main()
