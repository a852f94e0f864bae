# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The contacts of a step as a `FrictionProblem`: W = H^T w H assembled, closed points alone.

With the impulses lifted to the tips of their cones, r' = r + tip n, and velocities counted from
what the laws ask for, u' = u - least n + shift,

    u' = W r' + q,    q = H^T v_free - W (tip n) - least n + shift.

A point without friction, or that cannot slide, gets a tangent that nothing couples to: its impulse
is zero. A point that no impulse can open carries none, as its law has it (`laws/coulomb.py`).
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array, diags_array, vstack

from xper_fx.nscd.algebra.small import SINGULAR, sym_indices
from xper_fx.nscd.friction import FrictionProblem
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.laws.law import CoulombPoints
from xper_fx.nscd.opening_matrix import inverse_matrix, opening_matrix
from xper_fx.nscd.point_group import PointGroup
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
    """The closed contacts of a step, assembled.

    Args:
        interactions: points after `begin_step`.
        free: shape (num_slots * dim,), free velocities (m/s).

    Attributes:
        problem: of the closed contacts, in the order of the groups; None if there are none.
        closed: of each group, which points are in it, shape (n,).

    Raises:
        UnsuitableSolverError: a law of another kind, contacts that ranks divide, or a contact that
            can move along some oblique directions only.
    """

    def __init__(self, interactions: Interactions, free: np.ndarray):
        if interactions.halo is not None:
            raise UnsuitableSolverError("Contacts that ranks divide are not assembled.")
        self._groups, dim = interactions.groups, interactions.dim
        parts = [_ClosedPoints(g, dim, len(free)) for g in self._groups]
        self.closed = [part.closed for part in parts]
        self._tip, self.problem = np.zeros((0, dim)), None
        if not any(map(np.any, self.closed)):
            return
        opening = vstack([part.opening for part in parts]).tocsr()
        W = opening @ inverse_matrix(interactions.inverse) @ opening.T
        W += diags_array(np.concatenate([part.padding for part in parts]))
        self._tip = np.concatenate([part.tip for part in parts])
        wanted = np.concatenate([part.wanted for part in parts])
        q = opening @ free - W @ self._tip.ravel() - wanted.ravel()
        friction = np.concatenate([part.friction for part in parts])
        self.problem = FrictionProblem(W, q, friction, dim)

    def impulses(self) -> np.ndarray:
        """r' of the points as they are, shape (num_closed * dim,), N s."""
        reaction = self._tip.copy()
        for (first, last), g, closed in self._parts():
            reaction[first:last, : g.impulse.shape[1]] += g.impulse[closed]
        return reaction.ravel()

    def take(self, reaction: np.ndarray) -> None:
        """Give the points the impulses of a solution r', shape (num_closed * dim,), N s."""
        impulse = reaction.reshape(self._tip.shape) - self._tip
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
    """What the closed points of a group give to the problem, n of them.

    Attributes:
        closed: which points they are.
        opening: H^T, shape (n dim, num_dofs), rows of tangents without friction empty.
        padding: shape (n dim,), what stands for these rows on the diagonal of W.
        tip, wanted: shape (n, dim): tips, and the velocities that the laws ask for.
        friction: shape (n,).
    """

    def __init__(self, group: PointGroup, dim: int, num_dofs: int):
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
        self.opening = _rows(opening_matrix(group, num_dofs), self.closed, kept, components)
        self.padding = np.where(kept, 0.0, normal[:, None]).ravel()
        self.tip, self.wanted = np.zeros((2, n, dim))
        self.tip[:, 0] = points.tip[self.closed]
        self.wanted[:, 0] = points.least[self.closed]
        self.wanted[:, 1:] = np.where(kept[:, 1:], -points.shift[self.closed], 0.0)
        self.friction = points.friction[self.closed]


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
