# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a time scheme of the bulk gives the simulation, and the state it moves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.nscd.solvers.solver import SolveOptions, Solver, SolveReport


@dataclass
class State:
    """Displacement (m), velocity (m/s) of all dofs at a time (s), and the forces there (N)."""

    time: float
    displacement: np.ndarray
    velocity: np.ndarray
    #: the internal ones, or a pair whose mean they are: few ask for them
    forces: np.ndarray | tuple[np.ndarray, np.ndarray]
    external: np.ndarray | float = 0.0  #: those of the loads

    @property
    def internal(self) -> np.ndarray:
        """Internal forces, shape (num_dofs,), N (2D: N/m)."""
        if isinstance(self.forces, tuple):
            before, after = self.forces
            self.forces = 0.5 * (before + after)
        return self.forces


class Supports(NamedTuple):
    """What the supports gave in a step."""

    dofs: np.ndarray  #: the prescribed ones, shape (num_prescribed,)
    impulses: np.ndarray  #: on them, shape (num_prescribed,), N s


class StepOutcome(NamedTuple):
    """One attempted step."""

    state: State  #: state at the end of the step
    slots: np.ndarray  #: shape (num_slots * dim,), end velocities of the interacting nodes (m/s)
    impulses: np.ndarray  #: H r on all dofs, shape (num_dofs,), N s
    supports: Supports  #: impulses on prescribed dofs
    force_impulse: np.ndarray | float  #: h times the time-weighted external forces on all dofs, N s
    viscous: np.ndarray | float  #: viscous force acting over the step (N)
    sweeps: int  #: of the interaction solver, over all iterations
    residual: float  #: of the interaction solver, over all iterations
    traction_change: float  #: of the interaction solver, over all iterations
    newton_iterations: int  #: of the bulk; 1 when it is linear
    newton_residual: float  #: of the bulk; 0 when it is linear
    converged: bool  #: whether both are within their tolerances
    #: at the start and at the end of the step, what the energy that the scheme conserves has beside
    #: the physical one (J; 2D: J/m); zero but for `bulk/explicit.py`
    shadow: tuple[float, float] = (0.0, 0.0)
    #: of a step that has not converged, what failed, in words; empty if all that is known is that
    #: the residuals are too large
    failure: str = ""
    #: of all ranks, as `own_energies` has them of each, where ranks have agreed on the outcome with
    #: them in one message; None elsewhere
    energies: list[float] | None = None

    @property
    def reactions(self) -> np.ndarray:
        """Impulses of the supports, shape (num_dofs,), zero on what is free, N s."""
        out = np.zeros(len(self.state.displacement))
        out[self.supports.dofs] = self.supports.impulses
        return out


def interact(
    inverse, interactions: Interactions, solver: Solver, free: np.ndarray, options: SolveOptions
):
    """Let the interactions act on free velocities.

    Args:
        inverse: one of `xper_fx.bulk.body_inverse`.
        interactions: points after `begin_step`.
        solver: of the interactions.
        free: free velocities, shape (num_dofs,), m/s; where the inverse is `in_order` shape
            (num_slots * dim,), of which those of the nodes, which come first, are set, and which
            become end velocities.
        options: of the solver.

    Returns:
        End velocities and H r on all dofs, velocities of the interacting nodes, solver's report.
    """
    dim, nodes = interactions.dim, inverse.nodes
    if inverse.in_order:
        slots = free
    else:
        slots = at_nodes(free, nodes, dim, interactions.inverse.num_slots).reshape(-1)
    interactions.complete(slots)
    report = solver.solve(interactions, slots, options)
    if not isinstance(report, SolveReport):
        raise TypeError(
            f"{type(solver).__name__}.solve should return a SolveReport, got {report!r}."
        )
    if inverse.in_order:
        size = inverse.num_nodes * dim
        return slots[:size], interactions.impulses().ravel()[:size], slots, report
    impulses = on_nodes(interactions.impulses(), nodes, len(free))
    if len(nodes) == inverse.num_nodes or interactions.fused is not None:
        velocity = free.copy()
        if len(nodes):
            put_on_nodes(slots.reshape(-1, dim), nodes, velocity)
    else:
        velocity = inverse.apply(impulses)
        velocity += free
        if interactions.anchors is not None:
            velocity += inverse.moved(interactions.anchors)
    return velocity, impulses, slots, report


def at_nodes(
    values: np.ndarray, nodes: np.ndarray, dim: int, rows: int | None = None
) -> np.ndarray:
    """Of values on all dofs those of some nodes, shape (rows, dim), and zeros after them.

    There are as many rows as nodes if their number is not given.
    """
    out = np.empty((len(nodes) if rows is None else rows, dim))
    if len(nodes):  # else nothing is compiled for them
        _take_from_nodes(values, nodes, out)
    out[len(nodes) :] = 0.0
    return out


@njit(**LEAN_ENTRY)
def _take_from_nodes(values, nodes, out):
    """Read values of some nodes, shape (at least num_nodes, dim), from those of all dofs."""
    dim = out.shape[1]
    for i in range(len(nodes)):
        first = np.uintp(nodes[i] * dim)
        for d in range(dim):
            out[i, d] = values[first + np.uintp(d)]


def on_nodes(values: np.ndarray, nodes: np.ndarray, num_dofs: int) -> np.ndarray:
    """Values of some nodes on all dofs, zero elsewhere, shape (num_dofs,).

    Args:
        values: shape (at least num_nodes, dim), those of the nodes first.
        nodes: shape (num_nodes,).
        num_dofs: dofs that there are.
    """
    out = np.zeros(num_dofs)
    if len(nodes):
        put_on_nodes(values, nodes, out)
    return out


@njit(**LEAN_ENTRY)
def put_on_nodes(values, nodes, out):
    """Write values of some nodes, shape (at least num_nodes, dim), into those of all dofs."""
    dim = values.shape[1]
    for i in range(len(nodes)):
        first = np.uintp(nodes[i] * dim)
        for d in range(dim):
            out[first + np.uintp(d)] = values[i, d]
