# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is simulated: bodies, materials, laws, walls, contacts, ties and loads, checked together."""

from typing import TYPE_CHECKING

from xper_fx.support.lazy import importer

if TYPE_CHECKING:
    from xper_fx.scene.contact import Contact as Contact
    from xper_fx.scene.joints import Hinge as Hinge
    from xper_fx.scene.joints import Slider as Slider
    from xper_fx.scene.joints import Tendon as Tendon
    from xper_fx.scene.joints import Weld as Weld
    from xper_fx.scene.scene import Scene as Scene
    from xper_fx.scene.tie import Tie as Tie
    from xper_fx.scene.wall import Wall as Wall

_MODULE_OF = {
    "Contact": "contact",
    "Hinge": "joints",
    "Scene": "scene",
    "Slider": "joints",
    "Tendon": "joints",
    "Tie": "tie",
    "Wall": "wall",
    "Weld": "joints",
}

__all__ = list(_MODULE_OF)
__getattr__ = importer(__name__, _MODULE_OF)
