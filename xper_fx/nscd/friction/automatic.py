# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which solver for which part of a problem, and what follows when one does not get there.

1. Gauss-Seidel sweeps over each component. Most need few; one that, as its error falls, would need
   many more is left as it is.
2. The components left, together: Anderson's mixing if they are large (no factorisation), then the
   interior point; where rounding ends it above the tolerance, proximal points from there.
3. If that fails (a problem without solution, close to one, or far from monotone), component by
   component: the same, then sweeps to their end, from what there is and again from rest with over-
   and with under-relaxation, the interior point from another start, proximal points from the best
   of all these, and at last friction that grows from little to the whole.

The best impulses of all are kept at every turn: nothing is left with less than the sweeps gave.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp

from xper_fx.nscd.friction import anderson, gauss_seidel, interior_point
from xper_fx.nscd.friction import nonsmooth_newton as newton
from xper_fx.nscd.friction.blocks import BlockProblem, part
from xper_fx.nscd.friction.error import natural_error
from xper_fx.nscd.friction.gauss_seidel import Sweeps
from xper_fx.nscd.friction.sparse_system import Elimination
from xper_fx.nscd.local_solvers import LocalSolver

# Sweeps still to come, in a large component, at which another solver is worth a try.
_PATIENCE = 100
# First proximal coefficient after an interior point that ended at an error below this.
_NEAR, _NEARBY = 1e-7, 1e-4
# The same elsewhere, and the centres spent at a first and at the last attempt.
_FAR, _FEW, _MANY = 1e-2, 30, 150
# Another start of the interior point, when the first led nowhere.
_FROM_AFAR = 10.0
# Floating-point operations that an attempt may spend on factorisations, some minutes' worth, and
# how many of these it has to afford to be made.
_OPERATIONS, _LEAST_FACTORISATIONS = 5e11, 30
# What moves nothing, relative to mean(diag W) and |q|.
_ZERO = 1e-6
# Contacts from which on mixing is tried before factorising.
_LARGE = 40
# Relaxation of the first sweeps, and of those that start again from rest.
_RELAXATION, _RELAXATIONS = 1.3, (1.3, 0.8)


@dataclass
class Course:
    """What was done, in order."""

    solvers: list[str] = field(default_factory=list)  #: names of the solvers used
    sweeps: int = 0  #: largest number of Gauss-Seidel sweeps over a component
    #: (solver, iterations so far, error) - of the whole for sweeps, else of the part that was left
    #: to the solver
    history: list[tuple[str, int, float]] = field(default_factory=list)
    reasons: list[str] = field(default_factory=list)  #: why, in words

    def note(self, solver: str, history) -> None:
        if solver not in self.solvers:
            self.solvers.append(solver)
        self.history += [(solver, number, float(error)) for number, error in history]

    def note_sweeps(self, done: Sweeps) -> None:
        self.sweeps = max(self.sweeps, int(done.sweeps.max(initial=0)))
        self.note("nlgs", done.history)


def on_part(solve, problem, contacts, r, *, tolerance, course, name, **options) -> bool:
    """Solve some whole components by a global solver; keep what it finds if better.

    Args:
        solve: `solve` of `anderson`, `interior_point` or `newton`, or `newton.proximal_point` or
            `newton.continuation`.
        problem: the stored problem.
        contacts: their contacts; for a solver that factorises, in an order of elimination.
        r: shape (n, dim), impulses of the whole problem.
        tolerance: on the whole; the part gets its share.

    Returns:
        Whether the share was met.
    """
    own = part(problem, contacts)
    size_q = np.linalg.norm(own.q)
    if size_q == 0.0:
        r[contacts] = 0.0
        return True
    share = np.sqrt(len(contacts) / len(r)) * np.linalg.norm(problem.q) / size_q
    found, errors = r[contacts], []
    before = natural_error(own, found)
    reached = solve(own, found, tolerance=tolerance * share, history=errors, **options)
    course.note(name, enumerate(errors, start=1))
    if solve is anderson.solve:
        course.sweeps = max(course.sweeps, anderson.SWEEPS * len(errors))
    if natural_error(own, found) < before:
        r[contacts] = found
    return reached


def _jammed(problem: BlockProblem, r: np.ndarray) -> bool:
    """Whether the impulses prove that there is no solution.

    For d with d_N >= 0, d_T = 0 and W d = 0, a solution has d . q = d . u = sum d_N u_N >= 0. Where
    bodies are squeezed between others that do not give way, impulses grow along a d with d . q < 0.
    """
    d = np.zeros_like(r)
    d[:, 0] = np.maximum(r[:, 0], 0.0)
    size = np.linalg.norm(d)
    if size == 0.0:
        return False
    d /= size
    n, dim = d.shape
    W = sp.bsr_matrix((problem.blocks, problem.columns, problem.offsets), shape=(n * dim, n * dim))
    work = d.ravel() @ problem.q.ravel()
    moved = np.linalg.norm(W @ d.ravel())
    return moved <= _ZERO and work < -_ZERO * np.linalg.norm(problem.q)


def solve(
    problem: BlockProblem,
    elimination: Elimination,
    local: LocalSolver,
    r: np.ndarray,
    course: Course,
    *,
    tolerance: float,
    max_sweeps: int,
) -> None:
    """Solve; impulses in r, shape (n, dim), on return."""
    done = gauss_seidel.sweep(
        problem,
        local,
        r,
        tolerance=tolerance,
        max_sweeps=max_sweeps,
        patience=_PATIENCE,
        relaxation=_RELAXATION,
    )
    course.note_sweeps(done)
    converged = done.converged
    if converged.all():
        return
    fixed = ~problem.diagonal.any(axis=1)[problem.components[:-1]]  # nothing can move there
    left = np.flatnonzero(~converged & ~fixed)
    if len(left) == 0:
        return
    contacts = [np.arange(*problem.components[c : c + 2]) for c in left]
    course.reasons.append(
        f"in {len(left)} of {len(converged)} components ({sum(map(len, contacts))} contacts) "
        "sweeps brought the error down too slowly"
    )

    def attempt(solver, name, contacts, **options):
        return on_part(
            solver, problem, contacts, r, tolerance=tolerance, course=course, name=name, **options
        )

    def interior(contacts, start, max_centres):
        affordable = int(_OPERATIONS / elimination.operations(contacts))
        if affordable < _LEAST_FACTORISATIONS:
            course.reasons.append(f"{len(contacts)} contacts are too many to factorise")
            return False
        order = elimination.order(contacts)
        if attempt(interior_point.solve, "interior_point", order, start=start):
            return True
        near = natural_error(part(problem, order), r[order]) < _NEARBY
        return attempt(
            newton.proximal_point,
            "proximal_point",
            order,
            alpha=_NEAR if near else _FAR,
            max_centres=max_centres,
            max_factorisations=affordable,
        )

    def descend(contacts):
        mixable = len(contacts) >= _LARGE and max_sweeps >= anderson.SWEEPS
        if mixable and attempt(
            anderson.solve, "anderson", contacts, local=local, max_sweeps=max_sweeps
        ):
            return True
        return interior(contacts, 1.0, _FEW)

    def resweep(own, start, relaxation):
        alone, found = part(problem, own), start.copy()
        share = np.linalg.norm(problem.q) / (np.linalg.norm(alone.q) or 1.0)
        share *= np.sqrt(len(own) / len(r))
        done = gauss_seidel.sweep(
            alone,
            local,
            found,
            tolerance=tolerance * share,
            max_sweeps=max_sweeps,
            relaxation=relaxation,
        )
        course.note_sweeps(done)
        if natural_error(alone, found) < natural_error(alone, r[own]):
            r[own] = found
        return done.converged.all()

    def grow(own):
        affordable = int(_OPERATIONS / elimination.operations(own) / 6)
        return affordable >= _LEAST_FACTORISATIONS and attempt(
            newton.continuation,
            "continuation",
            elimination.order(own),
            max_factorisations=affordable,
        )

    def persist(own):
        rest = np.zeros_like(r[own])
        return (
            resweep(own, r[own], 1.0)
            or any(resweep(own, rest, relaxation) for relaxation in _RELAXATIONS)
            or interior(own, _FROM_AFAR, _MANY)
            or grow(own)
        )

    if descend(np.concatenate(contacts)):
        return
    course.reasons.append("no solver brought them to the end together")
    jammed, unsolved = [], []
    for own in contacts:
        if len(contacts) > 1 and descend(own):
            continue
        if _jammed(part(problem, own), r[own]):
            jammed += [len(own)]
        elif not persist(own):
            unsolved += [len(own)]
    if jammed:
        course.reasons.append(
            f"{len(jammed)} components ({sum(jammed)} contacts) have no solution: they close, and "
            "impulses along their normals move nothing"
        )
    if unsolved:
        course.reasons.append(
            f"{len(unsolved)} components ({sum(unsolved)} contacts) may have no solution"
        )
