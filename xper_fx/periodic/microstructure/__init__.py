# SPDX-License-Identifier: LGPL-3.0-or-later
"""Grains: periodic Voronoi and Laguerre tessellations, and their conforming periodic meshes."""

from xper_fx.periodic.microstructure.box_cut import cut_by_box
from xper_fx.periodic.microstructure.mesh import Microstructure, mesh_tessellation
from xper_fx.periodic.microstructure.seeds import random_seeds
from xper_fx.periodic.microstructure.short_edges import lengthen_short_edges
from xper_fx.periodic.microstructure.tessellation import (
    Tessellation,
    nearest_grains,
    tessellate,
)

__all__ = [
    "Microstructure",
    "Tessellation",
    "cut_by_box",
    "lengthen_short_edges",
    "mesh_tessellation",
    "nearest_grains",
    "random_seeds",
    "tessellate",
]
