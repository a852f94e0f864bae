# SPDX-License-Identifier: LGPL-3.0-or-later
"""A step that has converged becomes the past: histories, energies and bodies move on."""

from __future__ import annotations

import numpy as np

from xper_fx.bulk.state import StepOutcome
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.stepped_points import StepWork
from xper_fx.simulation.energy_ledger import BulkEnergies
from xper_fx.simulation.model import Model


def commit_interactions(
    model: Model,
    outcome: StepOutcome,
    size: float,
    energies: BulkEnergies,
    last: np.ndarray | float,
) -> StepWork | None:
    """Let jumps and damage move on, and enter the energies of the step.

    Args:
        model: what is stepped.
        size: h (s).
        energies: of the bulk in it.
        last: what interactions did to the bulk at the start of a static step (N).

    Returns:
        What the interactions stored and dissipated, None without any.
    """
    with model.stopwatch.phase("energy"):
        work, points = None, model.interactions
        if points is not None:
            work = points.commit(
                outcome.slots, not model.options.inertia, _at_start(model, last, size)
            )
            if points.from_scheme != 0.0:
                energies = energies._replace(damped=energies.damped - points.from_scheme)
        model.ledger.record(outcome, size, energies, work)
    return work


def _at_start(model: Model, last: np.ndarray | float, size: float) -> np.ndarray | None:
    """As `Interactions.commit` takes it; None where points stay, or lips turn with their bodies.

    Contacts that a search finds slide, turn, come and go between two steps.
    """
    points, bulk = model.interactions, model.bulk
    moves = model.options.inertia or model.detection is None or points.turns
    if moves or points.fused is not None or model.scene.macroscopic is not None:
        return None
    forces = np.zeros((points.own_inverse.num_nodes, bulk.dim))
    last = np.broadcast_to(last, bulk.num_dofs).reshape(-1, bulk.dim)
    forces[: len(model.slot_nodes)] = last[model.slot_nodes]
    if model.rigid is not None:
        pushed, share = model.rigid.pushed.reshape(-1, bulk.dim), model.rigid_share
        if share is not None:  # they are on every rank, which has a part of what pushes them
            counted = np.repeat(share.rank_of_body == model.ranks.rank, 2)
            pushed = np.where(counted[:, None], pushed, 0.0)
        points.own_rigid(forces)[:] = pushed
    return size * forces


def deepest(points: Interactions) -> np.ndarray:
    """How deep meshed bodies are in what they touch at the velocity level, on any rank.

    Returns:
        The largest depth beside the size of a point's share of a facet, and the largest (m).
    """
    found = np.zeros(2)
    if not any("pushed" in law.kernels(points.dim).state_names for law in points.laws):
        return found
    for g in points.groups:
        if len(g) and "pushed" in g.kernels.state_names and not g.sides.lever_arms:
            depth, size = -g.jump[:, 0], g.inverse_area ** (-1.0 / (points.dim - 1))
            found = np.maximum(found, [np.max(depth / size), np.max(depth)])
    return points.largest(found)


def commit_bodies(model: Model, outcome: StepOutcome, size: float) -> None:
    """Let bodies move on; searches take over the lips that have parted, and overlaps heal."""
    watch, displacement = model.stopwatch, outcome.state.displacement
    if model.detection is not None:
        with watch.phase("contact search"):
            expanded = model.bulk.unknowns.expand(displacement)
            model.detection.release(model.interactions, model.points.points_a_facet, expanded)
    with watch.phase("commit"):
        model.bulk.commit(outcome.state, outcome.impulses, size)
        if model.rigid is not None:
            model.rigid.commit()
    if model.healing is not None:
        with watch.phase("healing"):
            healed = model.healing.heal(model.interactions, size, outcome.state.time)
            model.ledger.heal(*healed)
