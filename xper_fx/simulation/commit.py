# SPDX-License-Identifier: LGPL-3.0-or-later
"""A step that has converged becomes the past: histories, energies and bodies move on."""

from __future__ import annotations

from xper_fx.bulk.state import StepOutcome
from xper_fx.nscd.stepped_points import StepWork
from xper_fx.simulation.energy_ledger import BulkEnergies
from xper_fx.simulation.model import Model


def commit_interactions(
    model: Model, outcome: StepOutcome, size: float, energies: BulkEnergies
) -> StepWork | None:
    """Let jumps and damage move on, and enter the energies of the step.

    Args:
        model: what is stepped.
        outcome: the step.
        size: h (s).
        energies: of the bulk in it.

    Returns:
        What the interactions stored and dissipated, None without any.
    """
    with model.stopwatch.phase("energy"):
        work, points = None, model.interactions
        if points is not None:
            work = points.commit(outcome.slots, not model.options.inertia)
            energies = energies._replace(damped=energies.damped - points.from_scheme)
        model.ledger.record(outcome, size, energies, work)
    return work


def commit_bodies(model: Model, outcome: StepOutcome, size: float) -> None:
    """Let bodies move on; searches take over the lips that have parted, and overlaps heal."""
    watch, displacement = model.stopwatch, outcome.state.displacement
    if model.detection is not None:
        with watch.phase("contact search"):
            expanded = model.bulk.unknowns.expand(displacement)
            model.detection.release(model.interactions, model.points.points_a_facet, expanded)
    with watch.phase("commit"):
        model.bulk.commit(displacement, outcome.state.internal, outcome.impulses, size)
        if model.rigid is not None:
            model.rigid.commit()
    if model.healing is not None:
        with watch.phase("healing"):
            healed = model.healing.heal(model.interactions, size, outcome.state.time)
            model.ledger.heal(*healed)
