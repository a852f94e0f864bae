# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fracture, contact and friction of multibody media by NonSmooth Contact Dynamics in FEniCSx.

`import xper_fx as xf` gives the public names below, and the namespaces `xf.laws`, `xf.loads`,
`xf.materials` and `xf.rigid`. Each is imported when it is first asked for.
"""

from xper_fx.lazy import importer

__version__ = "0.1.0"

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
