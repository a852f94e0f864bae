# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The contacts of a step as a `FrictionProblem`: W = H^T w H assembled, closed points alone.

With the impulses lifted to the tips of their cones, r' = r + tip n, and velocities counted from
what the laws ask for, u' = u - least n + shift,

    u' = W r' + q,    q = H^T v_free - W (tip n) - least n + shift.

A point without friction, or that cannot slide, gets a tangent that nothing couples to: its impulse
is zero. A point that no impulse can open carries none, as its law has it (`laws/coulomb.py`).

Ranks that divide the contacts all have the problem of all (`shared_contacts.py`), which the first
solves.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array, diags_array

from xper_fx.nscd.algebra.small import SINGULAR, sym_indices
from xper_fx.nscd.friction import FrictionProblem
from xper_fx.nscd.friction.problem import FrictionResult
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.laws.law import CoulombPoints
from xper_fx.nscd.opening_matrix import inverse_matrix, opening_matrix
from xper_fx.nscd.point_group import PointGroup
from xper_fx.nscd.solvers.shared_contacts import ClosedRows, share
from xper_fx.nscd.solvers.solver import (
    SolveOptions,
    Solver,
    SolveReport,
    UnsuitableSolverError,
)

# Least eigenvalue of a point's compliance, relative to its largest.
_DEFINITE = 1e-12
# Bound on friction, relative to what the tip of the cone gives, that is none.
_ROUNDING = 1e-12


class ContactProblem:
    """The closed contacts of a step, assembled; ranks that divide them make it together.

    Args:
        interactions: points after `begin_step`.
        free: shape (num_slots * dim,), free velocities (m/s); ghosts follow their owners.

    Attributes:
        problem: of the closed contacts, in the order of the groups, of those of several ranks as
            `shared_contacts.py` says; None if there are none.
        closed: of each group, which points are in it, shape (n,).

    Raises:
        UnsuitableSolverError: a law of another kind, or a contact that can move along some oblique
            directions only.
    """

    def __init__(self, interactions: Interactions, free: np.ndarray):
        self._groups, dim, halo = interactions.groups, interactions.dim, interactions.halo
        self._ranks = None if halo is None else halo.ranks
        interactions.refresh_ghosts(free)

        def closed_points() -> list[_ClosedPoints]:
            return [_ClosedPoints(g, dim, free) for g in self._groups]

        parts = closed_points() if self._ranks is None else self._ranks.together(closed_points)
        self.closed = [part.closed for part in parts]
        rows = ClosedRows.joined([part.rows for part in parts], dim, len(free))
        self._own = np.arange(len(rows.tip))
        if self._ranks is None:
            W = rows.opening @ inverse_matrix(interactions.inverse) @ rows.opening.T
        else:
            rows, W, self._own = share(interactions, rows, self.closed)
        self._tip, self.problem = rows.tip, None
        if len(rows.tip):
            W += diags_array(rows.padding.ravel())
            q = rows.free - W @ rows.tip.ravel() - rows.wanted.ravel()
            self.problem = FrictionProblem(W, q, rows.friction, dim)

    def solve(self, method: str, **options) -> FrictionResult:
        """As `FrictionProblem.solve`, from the impulses of the points as they are."""
        guess = self.impulses()

        def solved() -> FrictionResult:
            return self.problem.solve(method, guess=guess, **options)

        return solved() if self._ranks is None else self._ranks.from_first(solved)

    def impulses(self) -> np.ndarray:
        """r' of the points as they are, shape (num_closed * dim,), N s."""
        impulse, own = np.zeros((2, *self._tip.shape))
        for (first, last), g, closed in self._parts():
            own[first:last, : g.impulse.shape[1]] = g.impulse[closed]
        impulse[self._own] = own[: len(self._own)]
        if self._ranks is not None:
            impulse = self._ranks.sum(impulse)
        return (self._tip + impulse).ravel()

    def take(self, reaction: np.ndarray) -> None:
        """Give the points the impulses of a solution r', shape (num_closed * dim,), N s."""
        impulse = (reaction.reshape(self._tip.shape) - self._tip)[self._own]
        for (first, last), g, closed in self._parts():
            g.impulse[:] = 0.0
            g.impulse[closed] = impulse[first:last, : g.impulse.shape[1]]

    def _parts(self):
        ends = np.cumsum([0] + [np.count_nonzero(closed) for closed in self.closed])
        return zip(pairwise(ends), self._groups, self.closed, strict=True)


class CapturedContacts(Solver):
    """Solves nothing: keeps the problem that a step asks of its solver first.

    Attributes:
        problem: None before a step, or where no contact is closed.
    """

    name = "captured"

    def __init__(self) -> None:
        self.problem: FrictionProblem | None = None
        self._asked = False

    def solve(
        self, interactions: Interactions, velocity: np.ndarray, options: SolveOptions
    ) -> SolveReport:
        """Keep the problem; impulses are left zero."""
        if not self._asked:
            self.problem = ContactProblem(interactions, velocity).problem
            self._asked = True
        for group in interactions.groups:
            group.impulse[:] = 0.0
        return SolveReport(True, 0, 0.0, 0.0, self.name)


class _ClosedPoints:
    """What the closed points of a group give to the problem.

    Attributes:
        closed: which points they are.
        rows: of these.
    """

    def __init__(self, group: PointGroup, dim: int, free: np.ndarray):
        coulomb = group.kernels.coulomb
        points: CoulombPoints | None = None
        if coulomb is not None:
            points = coulomb(group.terms, group.details, group.parameters)
        if points is None or points.spring is not None:
            raise UnsuitableSolverError(
                f'The law "{group.kernels.name}" is not that of a FrictionProblem; it should be '
                "unilateral contact with Coulomb friction alone, as xf.laws.SignoriniCoulomb(mu)."
            )
        if np.any(points.bound > _ROUNDING * points.friction * points.tip):
            raise UnsuitableSolverError(
                f'The law "{group.kernels.name}" has a bound on friction besides Coulomb\'s cone '
                "(Tresca's, or cohesion with a tension below cohesion / friction), which a "
                "FrictionProblem does not have."
            )
        components = group.kernels.components
        W = _matrices(group.compliance, components)
        normal, tangential = W[:, 0, 0], np.einsum("njj->n", W) - W[:, 0, 0]
        self.closed = np.isfinite(points.least) & (normal > SINGULAR * tangential)
        rubs = (tangential > SINGULAR * normal)[self.closed]
        W, normal = W[self.closed], normal[self.closed]
        _require_definite(group, W[rubs])
        n = len(W)
        kept = np.zeros((n, dim), bool)
        kept[:, 0] = True
        kept[rubs, 1:components] = True
        opening = _rows(opening_matrix(group, len(free)), self.closed, kept, components)
        tip, wanted = np.zeros((2, n, dim))
        tip[:, 0] = points.tip[self.closed]
        wanted[:, 0] = points.least[self.closed]
        wanted[:, 1:] = np.where(kept[:, 1:], -points.shift[self.closed], 0.0)
        self.rows = ClosedRows(
            opening, np.where(kept, 0.0, normal[:, None]), tip, wanted, opening @ free,
            points.friction[self.closed],
        )  # fmt: skip


def _matrices(packed: np.ndarray, components: int) -> np.ndarray:
    """Symmetric matrices from packed rows, shape (n, components, components)."""
    full = np.empty((len(packed), components, components))
    i, j = sym_indices(components)
    full[:, i, j] = full[:, j, i] = packed
    return full


def _require_definite(group: PointGroup, compliance: np.ndarray) -> None:
    values = np.linalg.eigvalsh(compliance)
    if np.any(values[:, 0] <= _DEFINITE * values[:, -1]):
        raise UnsuitableSolverError(
            f'A contact with the law "{group.kernels.name}" can move along some directions only, '
            "as both of its bodies are guided; a FrictionProblem wants those that can move freely."
        )


def _rows(opening: csr_array, closed: np.ndarray, kept: np.ndarray, components: int) -> csr_array:
    """Rows of closed points, dim a point, empty where they are not kept."""
    n, dim = kept.shape
    to_rows = np.full((len(closed), components), -1)
    to_rows[closed] = np.arange(n * dim).reshape(n, dim)[:, :components]
    use = np.zeros((len(closed), components), bool)
    use[closed] = kept[:, :components]
    source = np.flatnonzero(use.ravel())
    pick = csr_array(
        (np.ones(len(source)), (to_rows.ravel()[source], source)), shape=(n * dim, use.size)
    )
    return pick @ opening
