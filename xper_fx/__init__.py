# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fracture, contact and friction of multibody media by NonSmooth Contact Dynamics in FEniCSx.

`import xper_fx as xf` gives the public names below, and the namespaces `xf.laws`, `xf.loads`,
`xf.materials` and `xf.rigid`. Each is imported when it is first asked for.
"""

from typing import TYPE_CHECKING

from xper_fx.lazy import importer
from xper_fx.version import __version__ as __version__

if TYPE_CHECKING:
    from xper_fx import materials as materials
    from xper_fx.bodies import explode as explode
    from xper_fx.contacts import Contact as Contact
    from xper_fx.effects import effects_table as effects_table
    from xper_fx.errors import CheckpointError as CheckpointError
    from xper_fx.errors import ConvergenceError as ConvergenceError
    from xper_fx.errors import NotFiniteError as NotFiniteError
    from xper_fx.forms import loads as loads
    from xper_fx.forms.loads import BodyForce as BodyForce
    from xper_fx.forms.loads import Gravity as Gravity
    from xper_fx.forms.loads import PrescribedDisplacement as PrescribedDisplacement
    from xper_fx.forms.loads import PrescribedVelocity as PrescribedVelocity
    from xper_fx.forms.loads import RayleighDamping as RayleighDamping
    from xper_fx.forms.loads import SurfaceTraction as SurfaceTraction
    from xper_fx.joined_meshes import join_meshes as join_meshes
    from xper_fx.meshes import crossed_rectangle as crossed_rectangle
    from xper_fx.meshes import in_rectangles as in_rectangles
    from xper_fx.meshes import read_gmsh as read_gmsh
    from xper_fx.meshes import tag_cells as tag_cells
    from xper_fx.meshes import tag_facets as tag_facets
    from xper_fx.nscd import FrictionProblem as FrictionProblem
    from xper_fx.nscd import laws as laws
    from xper_fx.nscd import rigid as rigid
    from xper_fx.nscd.rigid import RigidBody as RigidBody
    from xper_fx.periodic.drive import MacroscopicDrive as MacroscopicDrive
    from xper_fx.recorder import CellGauge as CellGauge
    from xper_fx.recorder import Recorder as Recorder
    from xper_fx.recorder import TensileGauge as TensileGauge
    from xper_fx.scene import Scene as Scene
    from xper_fx.scene import Wall as Wall
    from xper_fx.simulation import Simulation as Simulation
    from xper_fx.study import Study as Study
    from xper_fx.ties import Tie as Tie

_MODULE_OF = {
    "BodyForce": "forms.loads",
    "CellGauge": "recorder",
    "CheckpointError": "errors",
    "Contact": "contacts",
    "ConvergenceError": "errors",
    "FrictionProblem": "nscd",
    "Gravity": "forms.loads",
    "MacroscopicDrive": "periodic.drive",
    "NotFiniteError": "errors",
    "PrescribedDisplacement": "forms.loads",
    "PrescribedVelocity": "forms.loads",
    "RayleighDamping": "forms.loads",
    "Recorder": "recorder",
    "RigidBody": "nscd.rigid",
    "Scene": "scene",
    "Simulation": "simulation",
    "Study": "study",
    "SurfaceTraction": "forms.loads",
    "TensileGauge": "recorder",
    "Tie": "ties",
    "Wall": "scene",
    "crossed_rectangle": "meshes",
    "effects_table": "effects",
    "explode": "bodies",
    "in_rectangles": "meshes",
    "join_meshes": "joined_meshes",
    "read_gmsh": "meshes",
    "tag_cells": "meshes",
    "tag_facets": "meshes",
}
_NAMESPACES = {
    "laws": "nscd.laws",
    "loads": "forms.loads",
    "materials": "materials",
    "rigid": "nscd.rigid",
}

__all__ = ["__version__", *_MODULE_OF, *_NAMESPACES]
__getattr__ = importer(__name__, _MODULE_OF, _NAMESPACES)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
