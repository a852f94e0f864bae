# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid bodies as an XDMF series: their triangles, moved by the displacement."""

from __future__ import annotations

import os
from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from xper_fx.nscd.rigid.motion import RigidMotion, RigidState
from xper_fx.nscd.rigid.outline import body_outlines
from xper_fx.output.series import TimeSeries


class RigidSeries:
    """Writes the rigid bodies at the times asked for.

    In a periodic cell each body is drawn by its image in the cell at the origin, so that the
    displacement of a body that leaves the cell leaps. Points bear `displacement` (m) and `velocity`
    (m/s, of the material there). Cells bear `spin` (rad/s; a vector in 3D), `rotation` from the
    shape's axes to those of space (rad; in 3D the vector along the axis as long as the angle, at
    most pi), `body` and `group`, the numbers of `RigidBodies`, `diameter` of the disc or ball as
    large (m; NaN for walls), `half`, the side of the body's own x axis they are on, 0 or 1, which
    shows how round bodies turn, and `fragment` if asked for.

    Args:
        path: of the XDMF file.
        motion: of the bodies.
        diameter: of each body, shape (n,), m.
        after: as of `TimeSeries`.

    Attributes:
        series: the files.
        outline: triangles of the bodies, as `nscd.rigid.outline` gives them.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        motion: RigidMotion,
        diameter: np.ndarray,
        after: Mapping | None = None,
    ):
        self._group_of, self.outline = motion.bodies.group_of, body_outlines(motion.bodies)
        self._diameter = diameter[self.outline.body_of_cell]
        middle = self.outline.points[self.outline.cells].mean(axis=1)
        self._half = (middle[:, 0] > 0.0).astype(np.int32)
        self._start = self._positions(motion.start)
        self.series = TimeSeries(path, self._start, ("triangle", self.outline.cells), after)

    def _positions(self, state: RigidState) -> np.ndarray:
        return self.outline.positions(state.position, state.turn.rotation)

    def write(self, motion: RigidMotion, time: float, fragment: np.ndarray | None = None) -> None:
        """Add the committed state, as `TimeSeries.write`.

        Args:
            motion: of the bodies, perhaps another object than at the start.
            time: s.
            fragment: of each body, rigid ones last; None leaves the field out.
        """
        state = motion.displayed
        positions = self._positions(state)
        body, spin = self.outline.body_of_point, state.turn.spin
        arm = positions - state.position[body]
        rotation = state.turn.rotation
        if positions.shape[1] == 2:
            turning = spin[body] * np.column_stack([-arm[:, 1], arm[:, 0]])
            spin = spin[:, 0]
        else:
            turning = np.cross(spin[body], arm)
            rotation = Rotation.from_matrix(rotation).as_rotvec()
        owner = self.outline.body_of_cell
        cellwise = {
            "spin": spin[owner],
            "rotation": rotation[owner],
            "body": owner,
            "group": self._group_of[owner],
            "diameter": self._diameter,
            "half": self._half,
        }
        if fragment is not None:
            cellwise["fragment"] = fragment[len(fragment) - len(state.position) + owner]
        self.series.write(
            time,
            {"displacement": positions - self._start, "velocity": state.velocity[body] + turning},
            cellwise,
        )
