# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid bodies as an XDMF series: their triangles, moved by the displacement."""

from __future__ import annotations

import os

import numpy as np

from xper_fx.nscd.rigid.motion import RigidMotion
from xper_fx.nscd.rigid.outline import outline
from xper_fx.output import TimeSeries


class RigidSeries:
    """Writes the rigid bodies at the times asked for.

    Points bear `displacement` (m) and `velocity` (m/s, of the material there), cells `spin` (rad/s;
    a vector in 3D), `body` and `group`, the numbers of `RigidBodies`.

    Args:
        path: of the XDMF file.
        motion: of the bodies.

    Attributes:
        outline: triangles of the bodies, as `nscd.rigid.outline` gives them.
        path, h5_path: the files.
    """

    def __init__(self, path: str | os.PathLike[str], motion: RigidMotion):
        self._motion, self.outline = motion, outline(motion.bodies)
        self._start = self._positions()
        self._series = TimeSeries(path, self._start, ("triangle", self.outline.cells))
        self.path, self.h5_path = self._series.path, self._series.h5_path

    def _positions(self) -> np.ndarray:
        state = self._motion.state
        return self.outline.positions(state.position, state.turn.rotation)

    def write(self, time: float) -> None:
        """Add the committed state at a time (s), as `TimeSeries.write`."""
        state, positions = self._motion.state, self._positions()
        body, spin = self.outline.body_of_point, state.turn.spin
        arm = positions - state.position[body]
        if positions.shape[1] == 2:
            turning = spin[body] * np.column_stack([-arm[:, 1], arm[:, 0]])
            spin = spin[:, 0]
        else:
            turning = np.cross(spin[body], arm)
        owner = self.outline.body_of_cell
        self._series.write(
            time,
            {"displacement": positions - self._start, "velocity": state.velocity[body] + turning},
            {"spin": spin[owner], "body": owner, "group": self._motion.bodies.group_of[owner]},
        )

    def close(self) -> None:
        """Close the files."""
        self._series.close()
