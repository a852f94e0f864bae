# SPDX-License-Identifier: LGPL-3.0-or-later
"""The time loop, and what joins bulk and interactions within one step."""

from typing import TYPE_CHECKING

from xper_fx.support.lazy import importer

if TYPE_CHECKING:
    from xper_fx.simulation.path import DissipationControl as DissipationControl
    from xper_fx.simulation.path import GrowthControl as GrowthControl
    from xper_fx.simulation.simulation import Simulation as Simulation
    from xper_fx.simulation.step_record import StepRecord as StepRecord

_MODULE_OF = {
    "DissipationControl": "path",
    "GrowthControl": "path",
    "Simulation": "simulation",
    "StepRecord": "step_record",
}

__all__ = list(_MODULE_OF)
__getattr__ = importer(__name__, _MODULE_OF)
