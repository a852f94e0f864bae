# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nonlinear Gauss-Seidel on stored blocks: one contact after the other is solved exactly.

Visit of contact a (Jean 1999): b = q_a + sum_b W_ab r_b - W_aa r_a with the impulses of the moment,
then r_a is the solution of the local problem u = b + W_aa r, Signorini-Coulomb(u, r, mu).

Components are solved one by one, each until its natural-map error is its share of what is wanted.
The error is computed only when the change of a sweep, which costs nothing to know, suggests that it
will do. A contact whose neighbours have not moved since its last visit is passed over; when all are
at rest and the error is still too large, what counts as rest is tightened and all are visited.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.friction.blocks import BlockProblem, row_product
from xper_fx.nscd.friction.error import residual_kernel
from xper_fx.nscd.local_solvers.interface import LocalSolver

# A change below this fraction of a contact's share of the error wanted moves no neighbour.
_REST = 0.1
# First sweeps, which settle what is simple, are not relaxed.
UNRELAXED = 8
# The error is also computed at sweeps 16, 32, 64, ...: history, and the outlook.
_FIRST_CHECK = 16
_LOOKS = 40
# What a global solve costs whatever its size, in contacts.
_ONCE = 60


class Sweeps(NamedTuple):
    """What the sweeps did.

    Attributes:
        sweeps: shape (num_components,), sweeps made.
        converged: shape (num_components,), bool.
        history: (sweeps made, error of the whole) at 16, 32, 64, ... sweeps, and at the end.
        visits: contacts visited.
    """

    sweeps: np.ndarray
    converged: np.ndarray
    history: list[tuple[int, float]]
    visits: int


class Iterate(NamedTuple):
    """Where sweeps over a problem are."""

    r: np.ndarray  #: shape (n, dim), impulses of the moment
    factors: np.ndarray  #: shape (n, num_factors), what the local solver keeps of each contact
    #: shape (n,), bool: contacts whose neighbours have moved since their last visit
    dirty: np.ndarray


class Stop(NamedTuple):
    """When sweeps end."""

    limit: float  #: sum over all contacts of |F|^2 that is wanted (`error.py`)
    max_sweeps: int  #: as of `sweep`
    patience: float  #: as of `sweep`


class Progress(NamedTuple):
    """What sweeps write of themselves."""

    sweeps: np.ndarray  #: shape (num_components,), as of `Sweeps`
    converged: np.ndarray  #: shape (num_components,), as of `Sweeps`
    #: shape (2, k), sum of |F|^2 at 16, 32, 64, ... sweeps of the components under way, and of
    #: those left since.
    history: np.ndarray


@cache
def _prepare_kernel(dim: int, local: LocalSolver):
    sym_row, prepare = for_dimension(dim).sym_row, local.prepare

    @njit(error_model="numpy", _nrt=False)
    def prepare_all(diagonal, mu, factors):
        for a in range(len(mu)):
            prepare(sym_row(diagonal, a), mu[a], factors, a)

    return prepare_all


@cache
def visit_kernel(dim: int, local: LocalSolver, relaxed: bool):
    """Kernel `visit(a, problem, factors, r, omega) -> |dr|^2`: solve contact a, r_a changes."""
    algebra = for_dimension(dim)
    row, set_row, sym_row = algebra.row, algebra.set_row, algebra.sym_row
    sym_vector, subtract, dot = algebra.sym_vector, algebra.subtract, algebra.dot
    add, scale = algebra.add, algebra.scale
    multiply, solve = row_product(dim), local.solve
    zeros = (0.0,) * (dim - 1)

    @njit(inline="always")
    def into_cone(r, mu):
        if r[0] <= 0.0:
            return scale(0.0, r)
        normal = (r[0],) + zeros
        tangential = subtract(r, normal)
        size = np.sqrt(dot(tangential, tangential))
        if size <= mu * r[0]:
            return r
        return add(normal, scale(mu * r[0] / size, tangential))

    @njit(inline="always")
    def visit(a, problem, factors, r, omega):
        mu = problem.mu
        w, old = sym_row(problem.diagonal, a), row(r, a)
        u = multiply(a, problem, r, row(problem.q, a))
        new = solve(subtract(u, sym_vector(w, old)), w, factors, a, mu[a], old)
        if relaxed and omega != 1.0:
            new = into_cone(add(old, scale(omega, subtract(new, old))), mu[a])
        change = subtract(new, old)
        set_row(r, a, new)
        return dot(change, change)

    return visit


@cache
def sweeps_kernel(dim: int, local: LocalSolver, relaxed: bool, symmetric: bool):
    """Kernel `run(problem, iterate, omega, stop, progress) -> visits`: all sweeps."""
    visit, squared = visit_kernel(dim, local, relaxed), residual_kernel(dim)

    @njit(inline="always")
    def sweep(first, last, backward, problem, iterate, omega, rest):
        offsets, columns = problem.offsets, problem.columns
        r, factors, dirty = iterate
        changed, visits = 0.0, 0
        for place in range(first, last):
            a = np.uintp(first + last - 1 - place if backward else place)
            if not dirty[a]:
                continue
            change = visit(a, problem, factors, r, omega)
            visits += 1
            changed += change
            moved = change > rest
            if moved:
                for k in range(np.uintp(offsets[a]), np.uintp(offsets[a + 1])):
                    dirty[columns[k]] = True
            dirty[a] = moved and relaxed and omega != 1.0  # else solved exactly
        return changed, visits

    @njit(nogil=True, fastmath={"contract"}, error_model="numpy", _nrt=False)
    def run(problem, iterate, omega, stop, progress):
        components, dirty, patience = problem.components, iterate.dirty, stop.patience
        sweeps, converged, history = progress.sweeps, progress.converged, progress.history
        total_visits = 0
        for c in range(len(components) - 1):
            first, last = components[c], components[c + 1]
            share = stop.limit * (last - first) / len(problem.mu)
            rest = _REST * _REST * share / (last - first)
            worth = 4.0 * share  # change of a sweep at which the error is computed
            next_check, number, previous = _FIRST_CHECK, 0, np.inf
            error = np.inf
            for count in range(1, stop.max_sweeps + 1):
                backward, factor = symmetric and count % 2 == 0, omega if count > UNRELAXED else 1.0
                changed, visits = sweep(first, last, backward, problem, iterate, factor, rest)
                total_visits += visits
                sweeps[c] = count
                if not np.isfinite(changed):
                    break
                if (
                    changed <= worth
                    or count == next_check
                    or count == stop.max_sweeps
                    or last == first + 1
                ):
                    error = squared(first, last, problem, iterate.r)
                    if error <= share:
                        converged[c] = True
                        break
                    worth = changed * share / error
                    if visits == 0 or changed == 0.0:
                        rest *= 0.01
                        worth = 4.0 * share
                        dirty[first:last] = True
                        if rest < 1e-40 * share:
                            break
                if count == next_check:
                    history[0, number] += error
                    # Sweeps still to come if the error goes on falling as since the last look.
                    fall = np.log(previous / error)
                    if patience < np.inf and number > 1:
                        # a global solve costs so much a contact, and so much once
                        allowed = patience * (1.0 + _ONCE / (last - first))
                        if not (0.5 * count * np.log(error / share) < allowed * fall):
                            break
                    next_check, number, previous = 2 * next_check, number + 1, error
            history[1, number] += error
        return total_visits

    return run


@cache
def _first_kernel(dim: int, local: LocalSolver, relaxed: bool, symmetric: bool):
    """`run` of `sweeps_kernel`, the factors prepared before it: one call from Python."""
    prepare_all = _prepare_kernel(dim, local)
    run = sweeps_kernel(dim, local, relaxed, symmetric)

    @njit(nogil=True, error_model="numpy", _nrt=False)
    def first(problem, iterate, omega, stop, progress):
        prepare_all(problem.diagonal, problem.mu, iterate.factors)
        return run(problem, iterate, omega, stop, progress)

    return first


def factors_of(problem: BlockProblem, local: LocalSolver) -> np.ndarray:
    """What the local solver keeps of each contact, shape (n, num_factors), renewed."""
    factors = np.empty((len(problem.mu), local.num_factors))
    _prepare_kernel(problem.dim, local)(problem.diagonal, problem.mu, factors)
    return factors


def sweep(
    problem: BlockProblem,
    local: LocalSolver,
    r: np.ndarray,
    *,
    tolerance: float,
    max_sweeps: int,
    patience: float = np.inf,
    relaxation: float = 1.0,
    symmetric: bool = False,
) -> Sweeps:
    """Sweep until the error is within the tolerance.

    Args:
        problem: the stored problem.
        r: shape (n, dim), first guess; the impulses found on return.
        tolerance: bound on `error.natural_error`.
        max_sweeps: sweeps after which a component is left.
        patience: cost of a global solve in sweeps over a large component; a component that would
            need more sweeps still, as its error falls, is left.
        relaxation: factor on the change of an impulse from the ninth sweep on, followed by a return
            to the cone, in (0, 2).
        symmetric: sweep forth and back in turn.
    """
    count = len(problem.components) - 1
    sweeps, converged = np.zeros(count, np.int64), np.zeros(count, np.bool_)
    history = np.zeros((2, _LOOKS))
    factors = np.empty((len(r), local.num_factors))
    q = problem.q.ravel()
    size_q = math.sqrt(q @ q) or 1.0
    run = _first_kernel(problem.dim, local, relaxation != 1.0, symmetric)
    visits = run(
        problem,
        Iterate(r, factors, np.ones(len(r), np.bool_)),
        relaxation,
        Stop((tolerance * size_q) ** 2, max_sweeps, patience),
        Progress(sweeps, converged, history),
    )
    errors = np.sqrt(history[0] + np.cumsum(history[1])) / size_q
    looks = [(_FIRST_CHECK << k, errors[k]) for k in range(np.count_nonzero(history[0]))]
    most = int(sweeps.max(initial=0))
    if not looks or looks[-1][0] < most:
        looks.append((most, errors[-1]))
    return Sweeps(sweeps, converged, looks, visits)
