# SPDX-License-Identifier: LGPL-3.0-or-later
"""The verdict of a run: what was asked for, what was reached, what limits it, what to turn."""

from __future__ import annotations

import logging
from typing import NamedTuple

from xper_fx.simulation.bulk_resolution import bulk_resolution
from xper_fx.simulation.cohesive_scales import cohesive_scales
from xper_fx.simulation.readings import Readings

logger = logging.getLogger(__name__)

# What makes the error (`error_estimate.py`), in words, and what makes it less.
_CAUSES = {
    "time step": ("the time step", "a shorter step"),
    "material": ("plastic flow or friction within a step", "a shorter step"),
    "tolerance": ("the tolerance of the impulses", "a tighter tolerance"),
    "impacts": ("the times of impacts", "a shorter step"),
    "damping": ("what theta above 1/2 damps", "theta = 1/2"),
    "closure": ("the energy balance", "a shorter step"),
    "motion": ("displacements after impacts, which come late by up to a step", "a shorter step"),
    "waves": ("a largest force among waves that are out of phase", "a shorter step"),
    "events": ("a largest force between steps", "a shorter step"),
}
# Where the step is as short as the control goes, 0.7 of the critical step of the mesh.
_SMOOTHER = "smoother loads, or the waves resolved by a finer mesh"
_AT_THE_FLOOR = {"time step": _SMOOTHER, "waves": _SMOOTHER}
_BY_HAND = "a shorter step, given by hand"
# Share of what was asked for from which a part of the error is named.
_WORTH_NAMING = 0.25
# Facets that a cohesive length must span for results that do not depend on the mesh.
_FACETS = 3.0


class Verdict(NamedTuple):
    """The verdict of a run."""

    asked: float  #: relative error of global quantities
    estimated: float  #: relative error of global quantities
    reached: bool  #: whether the estimate is within what was asked for
    parts: dict[str, float]  #: of the estimate by what makes them, largest first
    #: error of the bulk's stresses in the energy norm at the end (`bulk_resolution.py`), None where
    #: it is not known; energies err by its square
    bulk: float | None
    #: that the shortest cohesive length of bonds that have weakened spans, None without
    facets: float | None
    #: what limits the run and what to turn, a sentence's part each, largest first
    limits: tuple[str, ...]

    @property
    def text(self) -> str:
        """All of it in one line."""
        said = f"accuracy: {self.asked:g} asked, {self.estimated:.2g} estimated"
        said += ", reached" if self.reached else ", NOT reached"
        return said + "".join(f"; {limit}" for limit in self.limits)


class Judge:
    """Tells the verdict once at an end, and again if what was reached is missed later."""

    def __init__(self) -> None:
        self._told: Verdict | None = None

    def tell(self, simulation: Readings) -> None:
        """Log the verdict of a run with an accuracy asked for, a warning where it is missed."""
        told, control = self._told, simulation.model.control
        asked = simulation.model.options.requested.accuracy
        if told is not None and (not told.reached or control.estimate.error <= asked):
            return
        found = self._told = verdict(simulation)
        if simulation.team.rank == 0:
            logger.log(logging.INFO if found.reached else logging.WARNING, "%s", found.text)


def verdict(simulation: Readings) -> Verdict | None:
    """The verdict of a run so far; None where no accuracy was asked for."""
    control = simulation.model.control
    if control is None:
        return None
    asked = simulation.model.options.requested.accuracy
    parts = {name: float(part) for name, part in control.estimate.errors.items()}
    parts = dict(sorted(parts.items(), key=lambda part: -part[1]))
    limits = []
    for name, part in parts.items():
        if part > _WORTH_NAMING * asked:
            cause, cure = _CAUSES[name]
            if cure == "a shorter step" and control.at_floor:
                cure = _AT_THE_FLOOR.get(name, _BY_HAND)
            limits.append(f"{cause} {part:.1g} ({cure})")
    snapped, one_state = control.snapped
    if snapped > 1.0:
        limits.append(
            f"initially rigid bonds snapped within a step, with snap numbers up to {snapped:.2g} "
            f"(a step of {one_state:.2g} s given by hand, or a finer mesh)"
        )
    bulk, facets = bulk_resolution(simulation), _facets(simulation)
    mesh_is_fine = True
    if facets is not None and facets < _FACETS:
        mesh_is_fine = False
        limits.append(
            f"a cohesive length spans {facets:.2g} facets, so that cracks depend on the mesh "
            f"({_FACETS:g} wanted: a finer mesh or a larger fracture energy)"
        )
    if bulk is not None and bulk**2 > asked:
        mesh_is_fine = False
        limits.append(f"the mesh leaves {bulk**2:.1g} of the elastic energy (a finer mesh)")
    error = float(control.estimate.error)
    return Verdict(
        asked, error, error <= asked and mesh_is_fine, parts, bulk, facets, tuple(limits)
    )


def _facets(simulation: Readings) -> float | None:
    """Facets in the shortest cohesive length of bonds, once some have spent energy."""
    if simulation.model.ledger.energies.dissipated_cohesion <= 0.0:
        return None
    lengths = [scale["facets_in_cohesive_length"] for scale in cohesive_scales(simulation)]
    return min(lengths, default=None)
