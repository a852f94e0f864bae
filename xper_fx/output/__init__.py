# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a run leaves, and what is read off it: series, checkpoints, cracks, fragments, forces."""

from typing import TYPE_CHECKING

from xper_fx.support.lazy import importer

if TYPE_CHECKING:
    from xper_fx.output.animation import Animation as Animation
    from xper_fx.output.connectivity import find_fragments as find_fragments
    from xper_fx.output.contact_forces import ContactForces as ContactForces
    from xper_fx.output.contact_forces import find_contact_forces as find_contact_forces
    from xper_fx.output.cracks import Cracks as Cracks
    from xper_fx.output.cracks import broken_points as broken_points
    from xper_fx.output.cracks import crack_area as crack_area
    from xper_fx.output.cracks import crack_panel as crack_panel
    from xper_fx.output.cracks import find_cracks as find_cracks
    from xper_fx.output.field_series import point_coordinates as point_coordinates
    from xper_fx.output.fragments import Fragments as Fragments
    from xper_fx.output.fragments import measure_fragments as measure_fragments
    from xper_fx.output.frame_figures import plot_bodies as plot_bodies
    from xper_fx.output.frame_figures import plot_frames as plot_frames
    from xper_fx.output.frames import Frame as Frame
    from xper_fx.output.frames import take_frame as take_frame
    from xper_fx.output.joint_forces import JointForces as JointForces
    from xper_fx.output.joint_forces import find_joint_forces as find_joint_forces
    from xper_fx.output.memory import memory_by_part as memory_by_part
    from xper_fx.output.present_bodies import rigid_bodies_now as rigid_bodies_now
    from xper_fx.output.summary import without_times as without_times

_MODULE_OF = {
    "Animation": "animation",
    "ContactForces": "contact_forces",
    "Cracks": "cracks",
    "Fragments": "fragments",
    "Frame": "frames",
    "JointForces": "joint_forces",
    "broken_points": "cracks",
    "crack_area": "cracks",
    "crack_panel": "cracks",
    "find_contact_forces": "contact_forces",
    "find_cracks": "cracks",
    "find_fragments": "connectivity",
    "find_joint_forces": "joint_forces",
    "measure_fragments": "fragments",
    "memory_by_part": "memory",
    "plot_bodies": "frame_figures",
    "plot_frames": "frame_figures",
    "point_coordinates": "field_series",
    "rigid_bodies_now": "present_bodies",
    "take_frame": "frames",
    "without_times": "summary",
}

__all__ = list(_MODULE_OF)
__getattr__ = importer(__name__, _MODULE_OF)
