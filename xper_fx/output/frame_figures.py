# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures of frames: bodies as they are, coloured by a quantity, and the forces between them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from xper_fx.output.frames import Colour, Frame, take_frame
from xper_fx.plotting.figures import new_figure
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.checks import require_count, require_flag, require_kind, require_vector

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

VIEW = (20.0, -60.0)
"""Height of the viewer above the horizon and angle about the vertical (degrees)."""
_WALL, _CHAIN = "#8a8a8a", "#D55E00"
# Grey of the borders of rigid bodies, and of cells whose colours are those of kinds.
_BORDER, _CELL_BORDER = 0.25, 0.35
# Largest width of a figure, largest side of a panel, width of a colour bar (inches).
_WIDTH, _PANEL, _BAR = 10.0, 6.4, 1.0
# Width of the line of the largest contact force (points).
_WIDEST = 3.0
_SHADES = 20
# What is left free around the bodies, relative to their extent.
_MARGIN = 0.03
# How opaque bodies in space are that show forces within, and the light on a face seen from aside.
_VEIL, _DIM = 0.2, 0.45


@dataclass(frozen=True)
class Look:
    """How frames are drawn."""

    bounds: np.ndarray  #: of the window, (low, high) of each axis, shape (dim, 2), m
    scale: ScalarMappable | None  #: colours of values; None for those of kinds
    chains: bool  #: whether contact forces are drawn
    view: tuple[float, float]  #: height and angle of the viewer (degrees)

    @property
    def share(self) -> float:
        """Height of a panel over its width."""
        size = np.ptp(self.bounds, axis=1)
        return float(size[1] / size[0]) if len(size) == 2 else 0.8

    @property
    def towards(self) -> np.ndarray:
        """Unit vector to the viewer (3D)."""
        up, round_ = np.radians(self.view)
        return np.array([np.cos(up) * np.cos(round_), np.cos(up) * np.sin(round_), np.sin(up)])

    def colours(self, frame: Frame) -> np.ndarray:
        """Of the faces, shape (num_faces, 4)."""
        from matplotlib import colormaps
        from matplotlib.colors import to_rgba

        known = np.isfinite(frame.values)
        values = np.where(known, frame.values, 0.0)
        if self.scale is None:
            colours = colormaps["tab20"](values.astype(int) % _SHADES)
            colours[values < 0] = 1.0
        else:
            colours = self.scale.to_rgba(values)
        colours[~known] = to_rgba(_WALL)
        return colours


def plot_bodies(
    simulation: Simulation,
    colour: Colour = "group",
    path: str | os.PathLike[str] | None = None,
    *,
    title: str | None = None,
    **drawn: Any,
) -> Figure:
    """Draw the bodies of a simulation as they are now, in 2D or 3D.

    All ranks call it together; give a `path` on one of them alone.

    Args:
        simulation: the run.
        colour: what colours the bodies, as `take_frame` takes it.
        path: where to save the figure, if at all.
        title: of the picture; None tells the time.
        drawn: how, as `plot_frames` takes it.

    Returns:
        The figure.

    Raises:
        ValueError, TypeError, ImportError: as `take_frame` and `plot_frames`.
    """
    return plot_frames([take_frame(simulation, colour, title)], path, **drawn)


def plot_frames(
    frames: Sequence[Frame],
    path: str | os.PathLike[str] | None = None,
    *,
    window: Sequence[float] | None = None,
    columns: int = 3,
    label: str | None = None,
    limits: tuple[float, float] | None = None,
    chains: bool = False,
    view: tuple[float, float] = VIEW,
) -> Figure:
    """Draw frames side by side.

    **Limitation.** In 3D faces are drawn one over the other, from the farthest middle to the
    nearest: faces much larger than what stands before them may hide it. ParaView does not err
    (`xf.Recorder`).

    Args:
        frames: in the order of time, of one scene.
        path: where to save the figure, if at all.
        window: what is shown, (left, right, bottom, top), in 3D (left, right, front, back, bottom,
            top), m; None shows all bodies but walls.
        columns: frames in a row.
        label: of a colour bar, for values of one's own; None: they are numbers of a kind, 0 to 19
            and round again, and negative ones are left white.
        limits: of the colour bar; None takes the middle 98 % of all values.
        chains: whether contact forces are drawn, the largest one of a frame equally wide.
        view: height of the viewer above the horizon and angle about the vertical, from x towards y
            (3D), degrees.

    Returns:
        The figure.

    Raises:
        ValueError: no frames, a window without size, a number out of range.
        TypeError: something that is no frame or no number.
        ImportError: matplotlib is missing.
    """
    if not isinstance(frames, Sequence) or not len(frames):
        raise ValueError(f"There are no frames to draw, got {frames!r}.")
    for frame in frames:
        require_kind("A frame", frame, Frame)
    columns = min(require_count("columns", columns, 1), len(frames))
    look = look_of(frames, window, label, limits, chains, view)
    rows = -(-len(frames) // columns)
    width = min(_WIDTH, columns * _PANEL / max(look.share, 1.0))
    return frames_figure(frames, look, path, (rows, columns), width, label or frames[0].label)


def look_of(
    frames: Sequence[Frame],
    window: Sequence[float] | None = None,
    label: str | None = None,
    limits: tuple[float, float] | None = None,
    chains: bool = False,
    view: tuple[float, float] = VIEW,
) -> Look:
    """How to draw frames, from the arguments of `plot_frames`, checked."""
    dim = frames[0].chains.shape[2]
    if window is None:
        corners = np.concatenate([face for f in frames for face in f.faces or f.walls])
        low, high = corners.min(axis=0), corners.max(axis=0)
        margin = _MARGIN * (high - low).max()
        bounds = np.stack([low - margin, high + margin], axis=1)
    else:
        bounds = require_vector("window", window, (2 * dim,)).reshape(dim, 2)
        if not (bounds[:, 0] < bounds[:, 1]).all():
            axes = ("left < right", "front < back", "bottom < top")[:: 4 - dim]
            raise ValueError(f"window should have {' and '.join(axes)}, got {window!r}.")
    view = tuple(require_vector("view", view, (2,)).tolist())
    require_flag("chains", chains)
    if limits is not None:
        low, high = require_vector("limits", limits, (2,))
        if not low < high:
            raise ValueError(f"limits should be a low and a higher number, got {limits!r}.")
    if label is None and frames[0].label is None:
        return Look(bounds, None, chains, view)
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    if limits is None:
        values = np.concatenate([frame.values for frame in frames])
        values = values[np.isfinite(values)]
        limits = np.percentile(values, [1.0, 99.0]) if len(values) else (0.0, 1.0)
    return Look(bounds, ScalarMappable(Normalize(*limits), "viridis"), chains, view)


def frames_figure(
    frames: Sequence[Frame],
    look: Look,
    path: str | os.PathLike[str] | None,
    grid: tuple[int, int],
    width: float,
    label: str | None,
) -> Figure:
    """A figure of frames, whose first axes are theirs.

    Args:
        frames: what to draw.
        look: how.
        path: where to save it, if at all.
        grid: rows and columns.
        width: of the figure (inches).
        label: of the colour bar.
    """
    from matplotlib.patches import Patch

    def draw(figure: Figure, grid: Any) -> None:
        for axes in grid.ravel()[len(frames) :]:
            axes.set_visible(False)
        for axes, frame in zip(grid.ravel(), frames, strict=False):
            draw_frame(axes, frame, look)
        if look.scale is not None:
            figure.colorbar(look.scale, ax=grid, label=label, shrink=0.8)
        names = {kind: name for frame in frames for kind, name in frame.names.items()}
        shown = [kind for kind in names if any((f.values == kind).any() for f in frames)]
        if len(shown) > 1:
            from matplotlib import colormaps

            patches = [
                Patch(color=colormaps["tab20"](kind % _SHADES), label=names[kind]) for kind in shown
            ]
            figure.legend(handles=patches, loc="outside lower center", ncols=len(shown))

    rows, columns = grid
    panel = width / columns - (_BAR if look.scale is not None and columns == 1 else 0.0)
    in_space = {"projection": "3d", "proj_type": "ortho"}
    return new_figure(
        path,
        draw,
        (width, rows * (panel * look.share + 0.3)),
        nrows=rows,
        ncols=columns,
        squeeze=False,
        subplot_kw={} if len(look.bounds) == 2 else in_space,
    )


def draw_frame(axes: Axes, frame: Frame, look: Look) -> None:
    """Draw a frame in the place of what the axes showed."""
    for artist in list(axes.collections):
        artist.remove()
    axes.set_title(frame.title)
    if len(look.bounds) == 2:
        _draw_plane(axes, frame, look)
    else:
        _draw_space(axes, frame, look)


def _widths(frame: Frame) -> np.ndarray:
    return _WIDEST * frame.forces / frame.forces.max(initial=np.finfo(float).tiny)


def _draw_plane(axes: Axes, frame: Frame, look: Look) -> None:
    from matplotlib.collections import LineCollection, PolyCollection

    colours, edged = look.colours(frame), frame.edged
    edges = colours.copy()
    if look.scale is None:
        edges[:, :3] = _CELL_BORDER
    edges[edged, :3] = _BORDER
    axes.add_collection(PolyCollection(frame.walls, facecolors=_WALL, edgecolors=_WALL, lw=0.2))
    widths = np.where(edged, 0.3, 0.15)
    axes.add_collection(
        PolyCollection(frame.faces, facecolors=colours, edgecolors=edges, linewidths=widths)
    )
    axes.add_collection(LineCollection(frame.marks, colors=str(_BORDER), linewidths=0.3))
    if look.chains:
        axes.add_collection(
            LineCollection(frame.chains, linewidths=_widths(frame), colors=_CHAIN, capstyle="round")
        )
    axes.set(xlim=look.bounds[0], ylim=look.bounds[1], aspect="equal", xticks=[], yticks=[])


def _draw_space(axes: Any, frame: Frame, look: Look) -> None:
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    towards = look.towards
    walls = [frame.walls[n] for n in np.flatnonzero(_light(frame.walls, towards) > 0.0)]
    axes.add_collection3d(Poly3DCollection(walls, facecolors="0.8", edgecolors="0.8", zorder=0))
    light = _light(frame.faces, towards)
    seen = np.flatnonzero(light > 0.0)
    colours = look.colours(frame)[seen]
    colours[:, :3] *= (_DIM + (1.0 - _DIM) * light[seen])[:, None]
    edges = np.where(frame.edged[seen, None], [*[_BORDER] * 3, 1.0], colours)
    if look.chains:
        colours[:, 3] = edges[:, 3] = _VEIL
    faces = [frame.faces[face] for face in seen]
    axes.add_collection3d(
        Poly3DCollection(faces, facecolors=colours, edgecolors=edges, linewidths=0.2, zorder=1)
    )
    if look.chains:
        axes.add_collection3d(
            Line3DCollection(
                frame.chains, linewidths=_widths(frame), colors=_CHAIN, capstyle="round", zorder=2
            )
        )
    axes.computed_zorder = False
    axes.set(xlim=look.bounds[0], ylim=look.bounds[1], zlim=look.bounds[2])
    axes.set_box_aspect(np.ptp(look.bounds, axis=1), zoom=1.2)
    axes.view_init(*look.view)
    axes.set_axis_off()


def _light(faces: Sequence[np.ndarray], towards: np.ndarray) -> np.ndarray:
    """Cosines between the normals of faces and the direction to the viewer, shape (num_faces,)."""
    if not len(faces):
        return np.empty(0)
    count = np.array([len(face) for face in faces])
    first = np.cumsum(count) - count
    corner = np.concatenate(faces)
    after = np.arange(1, len(corner) + 1)
    after[first + count - 1] = first
    normal = np.add.reduceat(np.cross(corner, corner[after]), first)
    return normal @ towards / np.maximum(np.linalg.norm(normal, axis=1), np.finfo(float).tiny)
