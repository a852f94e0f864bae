# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where in a step NaN or infinity came up: the first along the way from forces to energies."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from xper_fx.bulk.bulk import Bulk
    from xper_fx.bulk.state import State, StepOutcome
    from xper_fx.nscd.interactions import Interactions
    from xper_fx.scene.scene import Scene


def source_of_not_finite(
    scene: Scene,
    bulk: Bulk,
    interactions: Interactions | None,
    start: State,
    outcome: StepOutcome,
    size: float,
) -> str | None:
    """What gave the first number of an attempted step that is not finite; None if all are.

    Args:
        scene: with the bodies and their materials.
        bulk: of the bodies.
        interactions: with the impulses of the attempt; None if there are none.
        start: the start of the step.
        outcome: the attempt.
        size: its h (s).
    """
    if not np.all(np.isfinite(outcome.force_impulse)):
        return "the external forces"
    return (
        _materials(scene, bulk, start, outcome.state, size)
        or _laws(interactions)
        or _bodies(outcome)
    )


def _materials(scene: Scene, bulk: Bulk, start: State, end: State, size: float) -> str | None:
    """Materials whose forces are not finite at a displacement that is."""
    if scene.bodies is None:
        return None
    bulk.forms.set_step(size)
    for displacement in (
        start.displacement,
        start.displacement + 0.5 * size * start.velocity,
        start.displacement + size * start.velocity,
        end.displacement,
    ):
        if not np.all(np.isfinite(displacement)):
            continue
        wrong = ~np.isfinite(bulk.internal(displacement))
        if np.any(wrong):
            nodes = bulk.unknowns.expand(wrong.astype(float)).reshape(-1, bulk.dim).any(axis=1)
            cells = nodes[bulk.forms.V.dofmap.list].any(axis=1)
            tags = np.unique(bulk.forms.bodies.material_of_cell[cells]).tolist()
            named = ", ".join(
                f"{type(scene.materials[tag]).__name__} of cell tag {tag}" for tag in tags
            )
            return f"the internal forces of {named}"
    return None


def _laws(interactions: Interactions | None) -> str | None:
    """Laws whose impulses are not finite."""
    if interactions is None:
        return None
    names = [
        group.kernels.name
        for group in interactions.groups
        if not np.all(np.isfinite(group.impulse))
    ]
    return f"the impulses of the law {', '.join(dict.fromkeys(names))!r}" if names else None


def _bodies(outcome: StepOutcome) -> str | None:
    """Fields of the bodies that are not finite."""
    end = outcome.state
    for name in ("velocity", "displacement", "internal"):
        if not np.all(np.isfinite(getattr(end, name))):
            return "the internal forces" if name == "internal" else f"the {name} of the bodies"
    return None


def not_finite_columns(energies: Mapping[str, float]) -> str | None:
    """Names of the energies that are not finite; None if all are."""
    names = [name for name, value in energies.items() if not math.isfinite(value)]
    return f"the energies {', '.join(names)}" if names else None
