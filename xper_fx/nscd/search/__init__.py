# SPDX-License-Identifier: LGPL-3.0-or-later
"""Search of contacts: which bodies may touch, and where they do."""

from typing import TYPE_CHECKING

from xper_fx.support.lazy import importer

if TYPE_CHECKING:
    from xper_fx.nscd.search.contact_pairs import Contacts as Contacts
    from xper_fx.nscd.search.grid import box_pairs as box_pairs
    from xper_fx.nscd.search.rigid_search import RigidSearch as RigidSearch

_MODULE_OF = {"Contacts": "contact_pairs", "RigidSearch": "rigid_search", "box_pairs": "grid"}

__all__ = list(_MODULE_OF)
__getattr__ = importer(__name__, _MODULE_OF)
