# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures of a run with bodies that move far: cells as they are, rigid bodies, contact forces."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from xper_fx.nscd.rigid.outline import body_outlines
from xper_fx.output.contact_forces import find_contact_forces
from xper_fx.output.recorder import Recorder
from xper_fx.plotting.figures import new_figure
from xper_fx.support.checks import require_count, require_kind, require_numbers, require_vector

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_RIGID = "#8a8a8a"
# Width of the line of the largest contact force (points).
_WIDEST = 3.0
_SHADES = 20


@dataclass(frozen=True)
class Frame:
    """The bodies at one time (2D).

    Attributes:
        title: of the picture.
        cells: corners of the meshed cells, shape (num_cells, 3, 2), m.
        values: what colours them, shape (num_cells,).
        rigid: corners of the triangles of rigid bodies, shape (num_triangles, 3, 2), m.
        chains: segments from the middles of bodies to their contacts, shape (m, 2, 2), m.
        forces: force that each segment stands for, shape (m,), N/m.
    """

    title: str
    cells: npt.NDArray[np.float64]
    values: npt.NDArray[np.float64]
    rigid: npt.NDArray[np.float64]
    chains: npt.NDArray[np.float64]
    forces: npt.NDArray[np.float64]


def take_frame(recorder: Recorder, values: npt.ArrayLike, title: str) -> Frame:
    """The bodies of a recorder's simulation as they are now.

    Args:
        recorder: of a simulation in the plane with a mesh of triangles.
        values: what colours the cells, shape (num_cells,).
        title: of the picture.

    Raises:
        TypeError: no recorder, values that are no numbers.
        ValueError: a scene that is no mesh of triangles, another number of values than cells.
    """
    require_kind("recorder", recorder, Recorder)
    simulation = recorder.simulation
    mesh = None if simulation.scene.bodies is None else simulation.scene.bodies.mesh
    if mesh is None or mesh.topology.cell_name() != "triangle":
        raise ValueError("A frame is of a mesh of triangles, which the scene has not.")
    values = require_numbers("values", values)
    if values.shape != (len(recorder.cells),):
        raise ValueError(
            f"values should be one a cell, shape ({len(recorder.cells)},), got {values.shape}."
        )
    bodies = simulation.scene.bodies
    cells = (bodies.mesh.geometry.x[:, :2] + recorder.vertex_displacement())[recorder.cells]
    middles, rigid = _middles(cells, bodies.body_of_cell), np.empty((0, 3, 2))
    if simulation.rigid is not None:
        state = simulation.rigid.state
        triangles = body_outlines(simulation.rigid.bodies)
        rigid = triangles.positions(state.position, state.turn.rotation)[triangles.cells]
        bounded = np.isfinite(simulation.rigid.bodies.bounding_radius)
        middles = np.concatenate([middles, np.where(bounded[:, None], state.position, np.nan)])
    contacts = find_contact_forces(simulation)
    points = np.broadcast_to(contacts.position[:, None], (len(contacts.position), 2, 2))
    chains = np.stack([points, middles[contacts.bodies]], axis=2).reshape(-1, 2, 2)
    forces = np.repeat(np.linalg.norm(contacts.force, axis=1), 2)
    # a wall has no middle
    ended = np.isfinite(chains).all(axis=(1, 2))
    return Frame(title, cells, values, rigid, chains[ended], forces[ended])


def _middles(cells: np.ndarray, body: np.ndarray) -> np.ndarray:
    """Middles of bodies, means of their cells' weighted by area."""
    along, aside = cells[:, 1] - cells[:, 0], cells[:, 2] - cells[:, 0]
    area = np.abs(along[:, 0] * aside[:, 1] - along[:, 1] * aside[:, 0])
    first = cells.mean(axis=1) * area[:, None]
    total = np.bincount(body, area)
    return np.column_stack([np.bincount(body, column) for column in first.T]) / total[:, None]


def plot_frames(
    frames: Sequence[Frame],
    path: str | os.PathLike[str] | None = None,
    *,
    window: tuple[float, float, float, float],
    columns: int = 3,
    label: str | None = None,
    limits: tuple[float, float] | None = None,
    chains: bool = False,
) -> Figure:
    """Draw frames side by side.

    Args:
        frames: in the order of time.
        path: where to save the figure, if at all.
        window: what is shown, (left, right, bottom, top), m.
        columns: frames in a row.
        label: of a colour bar; None: values are numbers of a kind, 0 to 19 and round again, and
            negative ones are left white.
        limits: of the colour bar; None takes the middle 98 % of all values.
        chains: whether contact forces are drawn, the largest one of a frame equally wide.

    Returns:
        The figure.

    Raises:
        ValueError: no frames, a window without size, a number out of range.
        TypeError: something that is no frame or no number.
        ImportError: matplotlib is missing.
    """
    if not frames:
        raise ValueError("There are no frames to draw.")
    for frame in frames:
        require_kind("A frame", frame, Frame)
    columns = min(require_count("columns", columns, 1), len(frames))
    rows = -(-len(frames) // columns)
    left, right, bottom, top = require_vector("window", window, (4,))
    if not (left < right and bottom < top):
        raise ValueError(f"window should have left < right and bottom < top, got {window!r}.")
    if limits is not None:
        limits = require_vector("limits", limits, (2,))
    width = 10.0 / columns
    height = width * (top - bottom) / (right - left) + 0.3
    kinds = label is None
    if limits is None:
        limits = np.percentile(np.concatenate([f.values for f in frames]), [1.0, 99.0])

    def draw(figure: Figure, grid: Any) -> None:
        from matplotlib import colormaps
        from matplotlib.cm import ScalarMappable
        from matplotlib.collections import LineCollection, PolyCollection
        from matplotlib.colors import Normalize

        scale = ScalarMappable(Normalize(*limits), "viridis")
        for axes in grid.ravel()[len(frames) :]:
            axes.set_visible(False)
        for axes, frame in zip(grid.ravel(), frames, strict=False):
            if kinds:
                colour = colormaps["tab20"](frame.values.astype(int) % _SHADES)
                colour[frame.values < 0] = 1.0
            else:
                colour = scale.to_rgba(frame.values)
            edge = "0.35" if kinds else "face"
            axes.add_collection(
                PolyCollection(frame.rigid, facecolors=_RIGID, edgecolors=_RIGID, linewidths=0.2)
            )
            axes.add_collection(
                PolyCollection(frame.cells, facecolors=colour, edgecolors=edge, linewidths=0.15)
            )
            if chains and len(frame.forces):
                widths = _WIDEST * frame.forces / frame.forces.max()
                axes.add_collection(
                    LineCollection(
                        frame.chains, linewidths=widths, colors="#D55E00", capstyle="round"
                    )
                )
            axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal", title=frame.title)
            axes.set_xticks([])
            axes.set_yticks([])
        if not kinds:
            figure.colorbar(scale, ax=grid, label=label, shrink=0.8)

    return new_figure(path, draw, (10.0, rows * height), nrows=rows, ncols=columns, squeeze=False)
