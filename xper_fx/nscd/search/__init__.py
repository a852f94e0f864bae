# SPDX-License-Identifier: LGPL-3.0-or-later
"""Search of contacts: which bodies may touch, and where they do."""

from xper_fx.lazy import importer

_MODULE_OF = {"Contacts": "contacts", "RigidSearch": "rigid_search", "box_pairs": "grid"}

__all__ = list(_MODULE_OF)
__getattr__ = importer(__name__, _MODULE_OF)
