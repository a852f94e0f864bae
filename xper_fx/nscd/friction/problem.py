# SPDX-License-Identifier: LGPL-3.0-or-later
"""A frictional contact problem on its own, without any mesh: u = W r + q, Signorini-Coulomb."""

from __future__ import annotations

from functools import cached_property
from numbers import Integral, Real
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from xper_fx.nscd.friction import (
    anderson,
    automatic,
    colored,
    gauss_seidel,
    interior_point,
    nonsmooth_newton,
    problem_files,
)
from xper_fx.nscd.friction.automatic import Course
from xper_fx.nscd.friction.blocks import ORDERS, BlockProblem, store
from xper_fx.nscd.friction.error import Errors, measure
from xper_fx.nscd.friction.input_checks import SparseOrDense, checked
from xper_fx.nscd.friction.sparse_system import Elimination
from xper_fx.nscd.local_solvers import (
    LOCAL_SOLVERS,
    explicit_applies,
    local_solver,
    requires_diagonal,
)
from xper_fx.support.checks import require_vector

_GLOBAL = {
    "newton": nonsmooth_newton.solve,
    "proximal_point": nonsmooth_newton.proximal_point,
    "interior_point": interior_point.solve,
}
SOLVERS = ("auto", "nlgs", "anderson", *_GLOBAL)
# Facets of the cone beyond which a local problem is solved otherwise.
_MOST_FACETS = 1000
_DEFAULT_LOCAL = {2: "graph", 3: "exact"}


class FrictionResult(NamedTuple):
    """Impulses and velocities found, and how.

    Attributes:
        reaction: shape (n dim,), impulses r (N s), compression positive.
        velocity: shape (n dim,), u = W r + q (m/s).
        converged: whether `error` is within the tolerance.
        errors: natural-map errors and their parts in physical units.
        sweeps: largest number of Gauss-Seidel sweeps over a component, those mixed included.
        solver: names of the solvers that worked, joined by " + ".
        local_solver: name of the local solver of the sweeps, if any were made.
        history: (solver, iterations, error) as the solve went on: errors of the whole for "nlgs",
            of the part left to it for another solver; "anderson" counts mixings of 16 sweeps.
        reason: why these solvers, or why it did not converge.
    """

    reaction: np.ndarray
    velocity: np.ndarray
    converged: bool
    errors: Errors
    sweeps: int
    solver: str
    local_solver: str
    history: list[tuple[str, int, float]]
    reason: str

    @property
    def error(self) -> float:
        """Unit-free natural-map error, what the tolerance bounds."""
        return self.errors.error


class FrictionProblem:
    """Find r and u = W r + q with 0 <= u_N _|_ r_N >= 0, Coulomb friction of coefficient mu.

    At each contact the normal component comes first, then the tangential one or two; friction
    opposes slip: |r_T| <= mu r_N, and r_T = -mu r_N u_T / |u_T| where it slips.

    Args:
        W: shape (n dim, n dim), sparse (or an array), symmetric, diagonal blocks positive definite
            or, where a contact cannot move, zero with their rows and columns (m/s per N s).
        q: shape (n dim,), velocities without impulses (m/s).
        mu: shape (n,) or a number.
        dim: 2 or 3.
        source: file it came from, for messages.

    Arrays are copied and then fixed: another q is another problem.

    Raises:
        ValueError: bad input, with the entry and the file named.
    """

    def __init__(
        self,
        W: SparseOrDense,
        q: npt.ArrayLike,
        mu: npt.ArrayLike,
        dim: int,
        source: str | None = None,
    ):
        W, q, mu = checked(W, q, mu, dim, source)
        self._W, self._q, self._mu = W.copy(), q.copy(), mu.copy()
        for array in (self._W.data, self._W.indices, self._W.indptr, self._q, self._mu):
            array.flags.writeable = False
        self._dim, self.source = int(dim), source
        self._stored = {}

    @property
    def W(self) -> sp.csr_matrix:
        """Shape (n dim, n dim) (m/s per N s)."""
        return self._W

    @property
    def q(self) -> np.ndarray:
        """Shape (n dim,) (m/s)."""
        return self._q

    @property
    def mu(self) -> np.ndarray:
        """Shape (n,)."""
        return self._mu

    @property
    def dim(self) -> int:
        """2 or 3."""
        return self._dim

    @classmethod
    def read(cls, path: str | Path) -> FrictionProblem:
        """A problem from an `.npz` or FCLIB `.hdf5` file (`problem_files.read`)."""
        return cls(*problem_files.read(path), source=str(path))

    def write(self, path: str | Path) -> None:
        """Write an `.npz` or FCLIB `.hdf5` file."""
        problem_files.write(path, self.W, self.q, self.mu, self.dim, self.source or "")

    def __len__(self) -> int:
        return len(self.mu)

    def __repr__(self) -> str:
        return f"FrictionProblem({len(self)} contacts, dim {self.dim}, {self.W.nnz} entries in W)"

    def _store(self, order: str):
        if order not in self._stored:
            stored = store(self.W, self.q, self.mu, self.dim, order)
            self._stored[order] = stored, Elimination(stored.problem)
        return self._stored[order]

    @cached_property
    def _mean_diagonal(self) -> float:
        mean = float(self.W.diagonal().mean()) if len(self) else 1.0
        return mean if mean > 0.0 else 1.0

    def errors(self, reaction: np.ndarray) -> Errors:
        """The errors of given impulses, shape (n dim,), whoever found them.

        Raises:
            ValueError: another shape, or impulses that are not finite.
        TypeError: no numbers.
        """
        return self._measure(self._impulses("reaction", reaction))[1]

    def _impulses(self, name: str, value) -> np.ndarray:
        return np.ascontiguousarray(require_vector(name, value, self.q.shape))

    def _measure(self, reaction: np.ndarray) -> tuple[np.ndarray, Errors]:
        return measure(self.W, self.q, self.mu, self.dim, reaction, self._mean_diagonal)

    def solve(
        self,
        solver: str = "auto",
        local_solver: str = "auto",
        tolerance: float = 1e-8,
        *,
        guess: np.ndarray | None = None,
        max_sweeps: int = 20_000,
        relaxation: float = 1.0,
        symmetric: bool = False,
        order: str = "given",
        facets: int | None = None,
    ) -> FrictionResult:
        """Solve the problem.

        Args:
            solver: one of `SOLVERS`; "auto" starts with sweeps and goes over to others where these
                would take too long (`automatic`).
            local_solver: one of `LOCAL_SOLVERS[dim]`, for the sweeps; "auto" is the fastest exact.
            tolerance: bound on the unit-free natural-map error (`error`).
            guess: shape (n dim,), impulses to start from; zero without. The interior point starts
                on its own.
            max_sweeps: Gauss-Seidel sweeps after which an attempt with them ends (rounded up to 16
                by "anderson"; "auto" may make several); other solvers have ends of their own.
            relaxation: factor on the changes of a sweep from the ninth on, in (0, 2); "nlgs" only.
            symmetric: sweep forth and back in turn; "nlgs" only.
            order: of the visits, one of `ORDERS`: "given", "shuffled" (once and always alike), or
                "colored", which "nlgs" sweeps with Numba's threads.
            facets: facets of the cone, for the local solver "lcp" in 3D.

        Returns:
            The result; a problem that did not converge is reported with its reason, not raised.

        Raises:
            ValueError: an unknown name, or an argument out of its range.
        """
        self._check(solver, tolerance, max_sweeps, relaxation, symmetric, order, facets)
        (stored, scale, places, colors), elimination = self._store(order)
        local = self._local(local_solver, facets, stored, places)
        n, dim = len(self), self.dim
        if guess is None:
            r = np.zeros((n, dim))
        else:
            r = self._impulses("guess", guess).reshape(n, dim)[places] / scale
        course = Course()
        sweeping = {"tolerance": tolerance, "max_sweeps": max_sweeps}
        if solver == "auto":
            automatic.solve(stored, elimination, local, r, course, **sweeping)
        elif solver == "nlgs" and colors is not None:
            course.note_sweeps(
                colored.sweep(stored, colors, local, r, relaxation=relaxation, **sweeping)
            )
        elif solver == "nlgs":
            course.note_sweeps(
                gauss_seidel.sweep(
                    stored, local, r, relaxation=relaxation, symmetric=symmetric, **sweeping
                )
            )
        elif solver == "anderson":
            automatic.on_part(
                anderson.solve, stored, np.arange(n), r, course=course, name=solver, local=local,
                **sweeping,
            )  # fmt: skip
        else:
            automatic.on_part(
                _GLOBAL[solver],
                stored,
                elimination.order(np.arange(n)),
                r,
                course=course,
                name=solver,
                tolerance=tolerance,
            )
        reaction = np.empty((n, dim))
        reaction[places] = r * scale
        reaction = reaction.ravel()
        velocity, errors = self._measure(reaction)
        converged = bool(errors.error <= tolerance)
        if not converged:
            course.reasons.append(self._why_not(errors.error, tolerance))
        return FrictionResult(
            reaction, velocity, converged, errors, course.sweeps, " + ".join(course.solvers),
            local.name, course.history, "; ".join(course.reasons),
        )  # fmt: skip

    def _local(self, name: str, facets: int | None, stored: BlockProblem, places: np.ndarray):
        known = ("auto", *LOCAL_SOLVERS[self.dim])
        if name not in known:
            raise ValueError(f"local_solver should be one of {', '.join(known)}, got {name!r}.")
        if name == "auto":
            name = _DEFAULT_LOCAL[self.dim]
        local = local_solver(self.dim, name, **({} if facets is None else {"facets": facets}))
        if requires_diagonal(name):
            coupled = places[~explicit_applies(stored.diagonal)]
            if len(coupled):
                raise ValueError(
                    f'local_solver="{name}" wants diagonal blocks of W that are diagonal, with the '
                    f"same compliance along every tangent; that of contact {coupled.min()} is not "
                    f'({len(coupled)} such in all): choose "{_DEFAULT_LOCAL[self.dim]}".'
                )
        return local

    def _check(self, solver, tolerance, max_sweeps, relaxation, symmetric, order, facets) -> None:
        if solver not in SOLVERS:
            raise ValueError(f"solver should be one of {', '.join(SOLVERS)}, got {solver!r}.")
        if order not in ORDERS:
            raise ValueError(f"order should be one of {', '.join(ORDERS)}, got {order!r}.")
        for name, value, kind, wanted in (
            ("tolerance", tolerance, Real, "a number"),
            ("relaxation", relaxation, Real, "a number"),
            ("max_sweeps", max_sweeps, Integral, "an integer"),
            ("facets", 8 if facets is None else facets, Integral, "an integer"),
            ("symmetric", symmetric, bool | np.bool_, "True or False"),
        ):
            if not isinstance(value, kind):
                raise ValueError(f"{name} should be {wanted}, got {value!r}.")
        if not 0.0 < tolerance < 1.0:
            raise ValueError(f"tolerance should lie between 0 and 1, got {tolerance}.")
        if facets is not None and not 3 <= facets <= _MOST_FACETS and self.dim == 3:
            raise ValueError(f"facets should lie between 3 and {_MOST_FACETS}, got {facets}.")
        if not max_sweeps >= 1:
            raise ValueError(f"max_sweeps should be 1 or more, got {max_sweeps}.")
        if not 0.0 < relaxation < 2.0:
            raise ValueError(f"relaxation should lie between 0 and 2, got {relaxation}.")
        special = relaxation != 1.0 or symmetric or order == "colored"
        if solver != "nlgs" and special:
            raise ValueError(
                'relaxation, symmetric and order="colored" belong to solver="nlgs", got '
                f"{solver!r}."
            )
        if symmetric and order == "colored":
            raise ValueError("symmetric sweeps are not made by colours: choose another order.")

    def _why_not(self, error: float, tolerance: float) -> str:
        blocks = abs(self.W).sum(axis=1).A1.reshape(-1, self.dim)
        closing = -self.q[:: self.dim] > tolerance * np.linalg.norm(self.q)
        stuck = np.flatnonzero(~blocks.any(axis=1) & closing)
        if len(stuck):
            return (
                f"contact {stuck[0]} cannot move (its rows of W are zero) but closes with "
                f"q_N = {self.q[stuck[0] * self.dim]:.6g}: there is no solution"
                + (f" ({len(stuck)} such contacts)" if len(stuck) > 1 else "")
            )
        return f"the error came down to {error:.3g} only, of {tolerance:.3g} wanted"
