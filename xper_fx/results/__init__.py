# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is read off a run: cracks, fragments, contact forces, memory, files."""

from typing import TYPE_CHECKING

from xper_fx.lazy import importer

if TYPE_CHECKING:
    from xper_fx.contact_forces import ContactForces as ContactForces
    from xper_fx.contact_forces import contact_forces as contact_forces
    from xper_fx.cracks import Cracks as Cracks
    from xper_fx.cracks import broken_points as broken_points
    from xper_fx.cracks import find_cracks as find_cracks
    from xper_fx.cracks import find_fragments as find_fragments
    from xper_fx.memory import memory_by_part as memory_by_part
    from xper_fx.output import without_times as without_times
    from xper_fx.recorder import point_coordinates as point_coordinates

_MODULE_OF = {
    "ContactForces": "contact_forces",
    "Cracks": "cracks",
    "broken_points": "cracks",
    "contact_forces": "contact_forces",
    "find_cracks": "cracks",
    "find_fragments": "cracks",
    "memory_by_part": "memory",
    "point_coordinates": "recorder",
    "without_times": "output",
}

__all__ = list(_MODULE_OF)
__getattr__ = importer("xper_fx", _MODULE_OF)
