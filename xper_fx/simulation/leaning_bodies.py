# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies that contacts may hold in a run without inertia, where no support and no bond does."""

from __future__ import annotations

import numpy as np

from xper_fx.bodies.explode import Bodies
from xper_fx.bodies.meshes import facet_cells
from xper_fx.scene.scene import Scene


def leaning_bodies(scene: Scene, bodies: Bodies) -> np.ndarray:
    """Those on walls, and those with surfaces that may touch others, in ascending order.

    Whether they are held shows in the first step only.

    Args:
        scene: of the run.
        bodies: those of the rank.
    """
    cells = [np.zeros(0, np.int32)]
    if scene.walls:
        facets = np.concatenate([bodies.facet_tags.find(wall.facets) for wall in scene.walls])
        cells.append(facet_cells(bodies.mesh)[0][facets, 0])
    touching = {name for c in scene.contacts if c.law is not None for name in c.between}
    for name in touching & set(scene.surfaces):
        cells += [bodies.cell_tags.find(tag) for tag in scene.surfaces[name]]
    return np.unique(bodies.body_of_cell[np.concatenate(cells)])
