# SPDX-License-Identifier: LGPL-3.0-or-later
"""Energies of a rank's bodies in a step, as ranks add them up (`simulation/energy_ledger.py`)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from xper_fx.bulk.bulk import Bulk
    from xper_fx.bulk.state import State, StepOutcome

# How many `own_energies` has.
NUM_ENERGIES = 6


def own_energies(
    bulk: Bulk,
    before: State,
    outcome: StepOutcome,
    step: float,
    theta: float,
    borne: np.ndarray | float = 0.0,
    held: tuple[float, float] | None = None,
) -> np.ndarray:
    """Energies of this rank's bodies in a step (J; 2D: J/m).

    Args:
        before: state at the start of the step.
        step: h (s).
        theta: weight of the end of the step.
        borne: loads and reactions at the start of the step that were in balance there, shape
            (num_dofs,), N; of use in static runs.
        held: kinetic and elastic energy at the end, None where the scheme does not come by them.

    Returns:
        Work of loads and supports, kinetic and elastic energy at the end, what viscosity, plastic
        flow and the scheme took, shape (NUM_ENERGIES,).
    """
    after, force = outcome.state, outcome.viscous
    if held is None:
        kinetic = bulk.kinetic_energy(after.velocity)
        held = kinetic, bulk.elastic_energy(after.displacement, after.internal)
    lost = bulk.forms.assemble_dissipation(bulk.unknowns.expand(after.displacement))
    viscous = lost.get("viscous", 0.0)
    if isinstance(force, np.ndarray):
        if bulk.inertia is None:
            force = 0.5 * (force + bulk.viscous(before.velocity))
        viscous += float((after.displacement - before.displacement) @ force)
    work = _work_on_nodes(bulk, before, outcome, step, borne)
    damped = _damped(bulk, before, after, theta)
    return np.array([work, *held, viscous, lost.get("plastic", 0.0), damped])


def _work_on_nodes(
    bulk: Bulk, before: State, outcome: StepOutcome, step: float, borne: np.ndarray | float
) -> float:
    """Work of loads and supports on this rank's nodes in a step (J; 2D: J/m)."""
    start, end, given = before.displacement, outcome.state.displacement, outcome.force_impulse
    static = bulk.inertia is None
    if not (static or isinstance(given, np.ndarray)):  # supports alone do any
        dofs, impulse = outcome.supports
        return float((end.take(dofs) - start.take(dofs)).dot(impulse)) / step
    at = slice(bulk.unknowns.num_nodes * bulk.dim)
    impulse = (given + outcome.reactions)[at]
    if static:
        impulse = 0.5 * (impulse + step * np.broadcast_to(borne, start.shape)[at])
    return float((end[at] - start[at]) @ impulse) / step


def _damped(bulk: Bulk, before: State, after: State, theta: float) -> float:
    """What the scheme takes of this rank's bodies in a step, for theta > 1/2 (J; 2D: J/m)."""
    excess = theta - 0.5
    if excess <= 0.0 or bulk.inertia is None:
        return 0.0
    moved = after.displacement - before.displacement
    change = after.velocity - before.velocity
    nodal = bulk.unknowns.num_nodes * bulk.dim
    strained = moved[:nodal] @ (after.internal - before.internal)[:nodal]
    return excess * float(2.0 * bulk.kinetic_energy(change) + strained)
