# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a time scheme of the bulk gives the simulation, and the state it moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.solvers.solver import SolveOptions, Solver, SolveReport


@dataclass
class State:
    """Displacement (m), velocity (m/s) of all dofs at a time (s), and the forces there (N)."""

    time: float
    displacement: np.ndarray
    velocity: np.ndarray
    internal: np.ndarray
    external: np.ndarray | float = 0.0


class StepOutcome(NamedTuple):
    """One attempted step.

    Attributes:
        state: state at the end of the step.
        slots: shape (num_slots * dim,), end velocities of the interacting nodes (m/s).
        impulses: H r on all dofs, shape (num_dofs,), N s.
        reactions: impulses on prescribed dofs, shape (num_dofs,), zero elsewhere, N s.
        force_impulse: h times the time-weighted external forces on all dofs, N s.
        viscous: viscous force acting over the step (N).
        sweeps, residual, traction_change: of the interaction solver, over all iterations.
        newton_iterations, newton_residual: of the bulk; 1 and 0 when it is linear.
        converged: whether both are within their tolerances.
    """

    state: State
    slots: np.ndarray
    impulses: np.ndarray
    reactions: np.ndarray
    force_impulse: np.ndarray | float
    viscous: np.ndarray | float
    sweeps: int
    residual: float
    traction_change: float
    newton_iterations: int
    newton_residual: float
    converged: bool


def interact(
    inverse, interactions: Interactions, solver: Solver, free: np.ndarray, options: SolveOptions
):
    """Let the interactions act on free velocities.

    Args:
        inverse: one of `xper_fx.bulk.body_inverse`.
        interactions: points after `begin_step`.
        solver: of the interactions.
        free: free velocities, shape (num_dofs,), m/s.
        options: of the solver.

    Returns:
        End velocities and H r on all dofs, velocities of the interacting nodes, solver's report.
    """
    dim, count = interactions.dim, len(inverse.nodes)
    nodes = _as_slice(inverse.nodes)
    slots = interactions.free_velocities(free.reshape(-1, dim)[nodes])
    report = solver.solve(interactions, slots, options)
    if not isinstance(report, SolveReport):
        raise TypeError(
            f"{type(solver).__name__}.solve should return a SolveReport, got {report!r}."
        )
    impulses = np.zeros_like(free)
    impulses.reshape(-1, dim)[nodes] = interactions.impulses()[:count]
    if count == inverse.num_nodes:
        velocity = free.copy()
        velocity.reshape(-1, dim)[nodes] = slots.reshape(-1, dim)[:count]
    else:
        velocity = inverse.apply(impulses)
        velocity += free
        if interactions.anchors is not None:
            velocity += inverse.moved(interactions.anchors)
    return velocity, impulses, slots, report


def _as_slice(nodes: np.ndarray) -> np.ndarray | slice:
    """Nodes that are numbered without a gap, as those of single cells are, without a list."""
    if len(nodes) and np.all(nodes[1:] - nodes[:-1] == 1):
        return slice(int(nodes[0]), int(nodes[-1]) + 1)
    return nodes


def reactions_on(prescribed: np.ndarray, impulse: Callable[[np.ndarray], np.ndarray]):
    """Impulses of the supports, zero on what is free.

    Args:
        prescribed: shape (num_dofs,), bool.
        impulse: gives those of some dofs.
    """
    out, dofs = np.zeros(len(prescribed)), np.flatnonzero(prescribed)
    out[dofs] = impulse(dofs)
    return out
