# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lists of rigid bodies: walls of blocks, columns, arches, packings of grains, boxes."""

from typing import TYPE_CHECKING

from xper_fx.support.lazy import importer

if TYPE_CHECKING:
    from xper_fx.nscd.rigid.assemblies.courses import column as column
    from xper_fx.nscd.rigid.assemblies.courses import masonry_wall as masonry_wall
    from xper_fx.nscd.rigid.assemblies.enclosure import box as box
    from xper_fx.nscd.rigid.assemblies.loose_grains import packing as packing
    from xper_fx.nscd.rigid.assemblies.placing import moved as moved
    from xper_fx.nscd.rigid.assemblies.voussoirs import arch as arch

_MODULE_OF = {
    "arch": "voussoirs",
    "box": "enclosure",
    "column": "courses",
    "masonry_wall": "courses",
    "moved": "placing",
    "packing": "loose_grains",
}

__all__ = list(_MODULE_OF)
__getattr__ = importer(__name__, _MODULE_OF)
