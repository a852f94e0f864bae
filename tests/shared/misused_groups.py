# SPDX-License-Identifier: LGPL-3.0-or-later
"""All misuses, by the group in whose process they are made."""

from __future__ import annotations

import misused_late as late
import misused_runs as runs
import misused_scenes as scenes
import misused_static_tools as static_tools
import misused_tools as tools
import misused_values as values

GROUPS = {
    "materials": values.materials,
    "laws": values.laws,
    "rigid bodies": values.rigid_bodies,
    "small parts": values.small_parts,
    "scenes": scenes.scenes,
    "loads": scenes.loads,
    "options": runs.options,
    "steps": runs.steps,
    "records": runs.records,
    "meshes": tools.meshes,
    "grains": tools.grains,
    "friction": tools.friction,
    "studies": tools.studies,
    "figures": tools.figures,
    "shapes": late.shapes,
    "results": late.studied,
    "late": late.late,
    "static tools": static_tools.static_tools,
}
