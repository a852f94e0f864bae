# SPDX-License-Identifier: LGPL-3.0-or-later
"""Collapse loads of four published walls, arches that slide, walls put under a load at once.

The walls of Ferris and Tin-Loi (2001): blocks of 0.4 m x 0.175 m (halves at the ends of courses and
beside openings), friction 0.65, a horizontal body force beside the weight. For each, as multiples
of the weight:

- what associated friction bears, by a linear programme on the same contact points that shares
  nothing with the solvers of contact problems, and as published;
- the load at which blocks at rest begin to move (`xf.study.collapse_load`);
- what was published for friction without dilatancy: the least load that has a mechanism, which lies
  below the loads that blocks at rest can bear.

A semicircular arch under its weight: the least thickness with which it stands, by friction. With
mu of 0.3958 or more it falls by hinges alone, below 0.1075 R (Milankovitch 1907; Gilbert, Casapulla
and Ahmed 2006; Cocchetti and Rizzi 2020). With less, joints slide as well, and it must be thicker;
below 0.31 no thickness will do. Found by bisection with
`xf.study.equilibrium`, and from the statics of an arch with a joint everywhere: a thrust H and a
moment m at the crown give at the angle a from it, with W the weight up to there, which acts at x,

    N = H cos a + W sin a,  T = W cos a - H sin a,  N e = m + (1 - cos a) R H + (x - R sin a) W,

and all joints must bear |T| <= mu N and |e| <= t / 2.

./fenicsx python3 benchmarks/collapse_loads.py
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from scipy.optimize import linprog

import xper_fx as xf
from xper_fx.nscd.solvers.contact_problem import ContactProblem

LENGTH, HEIGHT, FRICTION, GRAVITY = 0.4, 0.175, 0.65, 9.81
VOUSSOIRS = 120

# Courses from the bottom: lengths of blocks in units of LENGTH, negative for an opening.
_HALVES, _WHOLE = [0.5, 1, 1, 1, 1, 0.5], [1] * 5
_FOUR, _FOUR_HALVES = [1] * 4, [0.5, 1, 1, 1, 0.5]
_SIDES, _SIDES_HALVES = [0.5, 1, -1, 1, 0.5], [1, 0.5, -1, 0.5, 1]
_THREE, _THREE_HALVES = [1, -1, 1, -1, 1], [0.5, 0.5, -1, 0.5, 0.5, -1, 0.5, 0.5]
WALLS = {
    1: [_HALVES, _WHOLE] * 3,
    2: [_HALVES, _WHOLE] * 5,
    3: [_FOUR, _FOUR_HALVES, _FOUR, *[_SIDES, _SIDES_HALVES] * 2, _SIDES, _FOUR, _FOUR_HALVES,
        _FOUR],
    4: [_HALVES, _WHOLE, _HALVES, *[_THREE, _THREE_HALVES] * 2, _THREE, _HALVES, _WHOLE, _HALVES],
}  # fmt: skip
# Multiples with associated friction and without dilatancy (Ferris and Tin-Loi 2001).
PUBLISHED = {
    1: (0.64286, 0.63982), 2: (0.58000, 0.56262), 3: (0.40369, 0.35582), 4: (0.33195, 0.29650),
}  # fmt: skip


def wall_under(courses: list[list[float]], multiple: float) -> xf.Scene:
    """A wall under its weight and a multiple of it to the right."""
    law, bodies = xf.laws.SignoriniCoulomb(friction=FRICTION), []
    for number, course in enumerate(courses):
        low, x = number * HEIGHT, 0.0
        for block in course:
            left, x = x, x + abs(block) * LENGTH
            if block > 0:
                corners = [(left, low), (x, low), (x, low + HEIGHT), (left, low + HEIGHT)]
                shape = xf.rigid.Polygon(corners)
                bodies.append(xf.RigidBody(shape, None, "blocks", density=1000.0))
    corners = [(0.0, -HEIGHT), (x, -HEIGHT), (x, 0.0), (0.0, 0.0)]
    held = dict.fromkeys(range(3), 0.0)
    bodies.append(xf.RigidBody(xf.rigid.Polygon(corners), None, "ground", prescribed=held))
    return xf.Scene(
        rigid=bodies,
        contacts=[xf.Contact(("blocks", group), law) for group in ("blocks", "ground")],
        loads=[xf.Gravity((multiple * GRAVITY, -GRAVITY))],
    )


def arch_of(thickness: float, friction: float) -> xf.Scene:
    """A semicircular arch of the mean radius 1 m on fixed springings."""
    law = xf.laws.SignoriniCoulomb(friction=friction)
    return xf.Scene(
        rigid=xf.assemblies.arch(VOUSSOIRS, 1.0, thickness, density=1000.0),
        contacts=[xf.Contact(("voussoirs", group), law) for group in ("voussoirs", "springings")],
        loads=[xf.Gravity((0.0, -GRAVITY))],
    )


def continuous_arch_stands(thickness: float, friction: float) -> bool:
    """Whether a thrust and a moment at the crown give forces that every joint bears; R = 1."""
    a = np.linspace(0.0, 0.5 * np.pi, 2001)
    sine, cosine = np.sin(a), np.cos(a)
    weight, moment = thickness * a, (1.0 - cosine) * (thickness + thickness**3 / 12.0)
    half, zero = 0.5 * thickness, np.zeros_like(a)
    rows, limits = [], []  # of H and m
    for sign in (1.0, -1.0):
        rows += [np.stack([-sign * sine - friction * cosine, zero], axis=1)]
        limits += [friction * weight * sine - sign * weight * cosine]
        rows += [np.stack([sign * (1.0 - cosine) - half * cosine, zero + sign], axis=1)]
        limits += [half * weight * sine - sign * (moment - sine * weight)]
    found = linprog(
        [0.0, 0.0], A_ub=np.concatenate(rows), b_ub=np.concatenate(limits),
        bounds=[(0.0, None), (None, None)], method="highs",
    )  # fmt: skip
    return found.status == 0


def least_thickness(stands: Callable[[float], bool], falls: float, safe: float) -> float:
    """The thickness above which an arch stands, by bisection to 1e-5."""
    while safe - falls > 1e-5:
        middle = 0.5 * (falls + safe)
        falls, safe = (falls, middle) if stands(middle) else (middle, safe)
    return safe


def print_arches() -> None:
    """The least thickness of arches, by friction."""
    print(f"\n| friction | thickness / R of {VOUSSOIRS} blocks | a joint everywhere | apart |")
    print("|---|---|---|---|", flush=True)
    for mu in (0.31, 0.32, 0.34, 0.36, 0.38, 0.39, 0.395, 0.4, 0.5, 0.7):
        blocks = least_thickness(
            lambda t, mu=mu: xf.study.equilibrium(arch_of(t, mu)).stands, 0.09, 0.3
        )
        exact = least_thickness(lambda t, mu=mu: continuous_arch_stands(t, mu), 0.09, 0.3)
        print(f"| {mu:g} | {blocks:.5f} | {exact:.5f} | {blocks / exact - 1.0:+.2%} |", flush=True)


def borne_by_associated_friction(courses: list[list[float]]) -> float:
    """The largest multiple with which forces in the cones can be in balance.

    The contact problem gives H by columns: q is H^T of free velocities, so that q of a velocity of
    one degree of freedom is a row of H.
    """
    simulation = xf.Simulation(wall_under(courses, 0.0), step=1e-3, solver="friction_problem")
    for _ in simulation.steps(1e-3):
        pass
    interactions = simulation.interactions
    num_dofs, blocks = interactions.inverse.num_slots * 2, len(simulation.scene.rigid) - 1
    dofs = (4 * np.arange(blocks)[:, None] + np.arange(3)).ravel()
    columns = np.eye(num_dofs)[dofs]
    H = np.array([ContactProblem(interactions, column).problem.q for column in columns])
    H -= ContactProblem(interactions, np.zeros(num_dofs)).problem.q
    weight = simulation.scene.rigid_bodies.mass[:blocks] * GRAVITY
    push, pull = np.zeros((2, blocks, 3))
    push[:, 0], pull[:, 1] = weight, -weight
    count = H.shape[1] // 2
    shear, normal = np.eye(2 * count)[1::2], np.eye(2 * count)[::2]
    none = np.zeros((count, 1))
    cone = np.vstack([np.hstack([sign * shear - FRICTION * normal, none]) for sign in (1.0, -1.0)])
    answer = linprog(
        np.append(np.zeros(2 * count), -1.0),
        A_ub=sp.csr_array(cone), b_ub=np.zeros(2 * count),
        A_eq=sp.csr_array(np.column_stack([H, push.ravel()])), b_eq=-pull.ravel(),
        bounds=[(0.0, None), (None, None)] * count + [(0.0, None)], method="highs",
    )  # fmt: skip
    return float(answer.x[-1])


def first_steps(courses: list[list[float]], multiple: float, solver: str) -> str:
    """Seconds of the first of 20 steps, and how fast blocks are after it in units of g h."""
    simulation = xf.Simulation(wall_under(courses, multiple), step=1e-3, solver=solver)
    start = time.perf_counter()
    try:
        for record in simulation.steps(20e-3):
            if record.step == 1:
                seconds = time.perf_counter() - start
                speed = np.abs(simulation.rigid.state.velocity).max() / (GRAVITY * 1e-3)
    except xf.ConvergenceError:
        return "no solution"
    return f"{seconds:.2f} s, {speed:.0e}"


def main(options: list[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arches", action="store_true", help="arches alone")
    parser.add_argument("--walls", type=int, nargs="+", choices=WALLS, default=list(WALLS))
    args = parser.parse_args(options)
    if args.arches:
        print_arches()
        return
    print("| wall | associated (published) | begins to move | published | s |")
    print("|---|---|---|---|---|", flush=True)
    begins = {}
    for number in args.walls:
        courses, start = WALLS[number], time.perf_counter()
        found = xf.study.collapse_load(lambda a, c=courses: wall_under(c, a), (0.0, 1.0))
        seconds, begins[number] = time.perf_counter() - start, found.stands
        bound, (associated, published) = borne_by_associated_friction(courses), PUBLISHED[number]
        print(
            f"| {number} | {bound:.5f} ({associated:.5f}) | {found.stands:.4f} | {published:.5f} | "
            f"{seconds:.1f} |",
            flush=True,
        )
    print("\n| share of the load at which wall 2 begins to move | auto | interior_point |")
    print("|---|---|---|", flush=True)
    load = begins.get(2) or 0.5689
    for share in (0.1, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99, 1.01, 1.1):
        told = [first_steps(WALLS[2], share * load, s) for s in ("auto", "interior_point")]
        print(f"| {share:g} | {told[0]} | {told[1]} |", flush=True)


if __name__ == "__main__":
    main()
