# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time of one solve of each local solver, and what a faceted cone costs.

    python3 benchmarks/local_solvers.py [--points 1000] [--repeat 40]

ns a solve, one thread, by the status of the points: all open, all sticking, all slipping, with
mu = 0.3 and eigenvalues of W over a decade (a diagonal W with equal tangential entries for the
explicit solver). The points' arrays stay in the caches. b changes from visit to visit by 1 %, as it
does in a Gauss-Seidel solve on its way, and warm starts are used. `scene` is the solver of the
scene's laws (coulomb.py), which keeps nothing a point. Iterations (Newton steps on F or on the
secular equation, projections, pivots) and the share of solves that a sure solver finished come
from a separate run. Other work on the machine disturbs: variants take turns, the least counts.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension, sym_indices
from xper_fx.nscd.laws.contact_solver import contact_solver
from xper_fx.nscd.local_solvers import (
    LOCAL_SOLVERS,
    LocalSolver,
    bipotential,
    exact,
    faceting_error,
    generalized_newton,
    lcp,
    local_solver,
)

MU = 0.3
VISITS = 4  # of each point in a run
STATUSES = ("open", "stick", "slip")


def problems(dim, status, count, diagonal):
    """b of the visits, shape (VISITS, count, dim), and packed W, from known solutions."""
    rng = np.random.default_rng(0)
    q, _ = np.linalg.qr(rng.normal(size=(count, dim, dim)))
    values = 10.0 ** rng.uniform(-0.5, 0.5, (count, dim))
    if diagonal:
        q = np.broadcast_to(np.eye(dim), q.shape)
        values[:, 1:] = values[:, 1:2]
    w = np.einsum("nij,nj,nkj->nik", q, values, q)
    impulse, velocity = np.zeros((count, dim)), np.zeros((count, dim))
    along = rng.normal(size=(count, dim - 1))
    along /= np.linalg.norm(along, axis=1)[:, None]
    if status == "open":
        velocity[:] = rng.normal(size=velocity.shape)
        velocity[:, 0] = 0.1 + np.abs(velocity[:, 0])
    else:
        impulse[:, 0] = 1.0
        share = rng.uniform(0.1, 0.7, count) if status == "stick" else np.ones(count)
        impulse[:, 1:] = (MU * share)[:, None] * along
        if status == "slip":
            velocity[:, 1:] = -rng.uniform(0.5, 2.0, count)[:, None] * along
    b = velocity - np.einsum("nij,nj->ni", w, impulse)
    visits = b * (1.0 + 0.01 * rng.normal(size=(VISITS, count, dim)))
    return visits, np.ascontiguousarray(w[(slice(None), *sym_indices(dim))])


def of_the_scene(dim):
    """coulomb.py's solver as a local solver."""
    contact = contact_solver(dim, True)
    still = (0.0,) * (dim - 1)

    @njit(_nrt=False)
    def prepare(w, mu, factors, i):
        pass

    @njit(error_model="numpy", _nrt=False)
    def solve(b, w, factors, i, mu, r):
        return contact(b, w, 0.0, still, mu, 0.0)[0]

    return LocalSolver("scene", 1, prepare, solve)


def counting(dim, name):
    """Kernel that also counts iterations, or None."""
    return {
        "bipotential": lambda: bipotential.kernels(dim)[2],
        "newton": lambda: generalized_newton.solve_and_count,
        "exact": lambda: exact.solve_and_count,
        "lcp": lambda: lcp.kernels(dim, 2 if dim == 2 else 8)[3],
    }.get(name, lambda: None)()


def drivers(dim, solver, count):
    """Kernels `run(visits, w, factors, r)` and `iterations(...)`, the latter or None."""
    algebra = for_dimension(dim)
    row, set_row, sym_row = algebra.row, algebra.set_row, algebra.sym_row
    prepare, solve, mu = solver.prepare, solver.solve, MU

    @njit
    def fill(w, factors):
        for i in range(len(w)):
            prepare(sym_row(w, i), mu, factors, i)

    @njit(fastmath={"contract"}, error_model="numpy", _nrt=False)
    def run(visits, w, factors, r):
        for visit in range(visits.shape[0]):
            b = visits[visit]
            for number in range(len(w)):
                i = np.uintp(number)
                set_row(r, i, solve(row(b, i), sym_row(w, i), factors, i, mu, row(r, i)))

    if count is None:
        return fill, run, None

    @njit
    def iterations(visits, w, factors, r):
        total, finished = 0, 0
        for visit in range(visits.shape[0]):
            b = visits[visit]
            for i in range(len(w)):
                x, steps = count(row(b, i), sym_row(w, i), factors, i, mu, row(r, i))
                set_row(r, i, x)
                total += abs(steps)
                finished += steps < 0
        solves = visits.shape[0] * len(w)
        return total / solves, finished / solves

    return fill, run, iterations


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=1000)
    parser.add_argument("--repeat", type=int, default=40, help="runs, the least counts")
    options = parser.parse_args()
    print("dim  solver         open  stick   slip   floats   iterations stick, slip   finished")
    for dim in (2, 3):
        cases, best, notes = {}, {}, {}
        solvers = [local_solver(dim, name) for name in LOCAL_SOLVERS[dim]] + [of_the_scene(dim)]
        for solver in solvers:
            fill, run, iterations = drivers(dim, solver, counting(dim, solver.name))
            for status in STATUSES:
                diagonal = solver.name == "explicit"
                visits, w = problems(dim, status, options.points, diagonal)
                factors = np.zeros((options.points, solver.num_factors))
                fill(w, factors)
                r = np.zeros_like(visits[0])
                cases[solver, status] = (run, (visits, w, factors, r))
                best[solver, status] = np.inf
                if iterations is not None:
                    notes[solver, status] = iterations(visits, w, factors, r)
        for turn in range(options.repeat + 1):
            for key, (run, arguments) in cases.items():
                start = time.perf_counter()
                run(*arguments)
                if turn:
                    best[key] = min(best[key], time.perf_counter() - start)
        for solver in solvers:
            ns = [1e9 * best[solver, s] / VISITS / options.points for s in STATUSES]
            text = "".join(f" {value:6.1f}" for value in ns)
            note = ""
            if (solver, "slip") in notes:
                counts = [notes[solver, s] for s in STATUSES[1:]]
                note = f"{counts[0][0]:16.1f} {counts[1][0]:6.1f}" + "".join(
                    f" {100 * finished:7.1f}%" for _, finished in counts
                )
            print(f"{dim}D   {solver.name:12s}{text} {solver.num_factors:8d}   {note}")
    print("faceted cone, slipping, mu = 0.3, W anisotropic: largest errors over all directions")
    print("facets  floats a point   impulse    m x   missing power  m^2 x   missing length  m^2 x")
    for facets in (4, 8, 16, 32):
        impulse, power, length = faceting_error(facets, samples=360)
        print(
            f"{facets:6d}  {lcp.lcp_solver(3, facets).num_factors:14d}  {impulse:8.1e}"
            f"  {facets * impulse:5.2f}  {power:14.1e}  {facets**2 * power:5.2f}"
            f"  {length:15.1e}  {facets**2 * length:5.2f}"
        )


if __name__ == "__main__":
    main()
