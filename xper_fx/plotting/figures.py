# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures of a plane run: microstructure, cracks, stress-strain curves, energies, laws.

Every function takes plain arrays in SI units, returns a matplotlib Figure that belongs to no
window, and saves it if a path is given. Colours are told apart by colour-blind readers.
"""

import io
import itertools
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from xper_fx.plotting.figure_checks import (
    checked_mesh,
    checked_segments,
    checked_unit,
    require_mapping,
)
from xper_fx.support.checks import (
    require_count,
    require_kind,
    require_number,
    require_numbers,
    require_path,
    require_vector,
)
from xper_fx.support.files import write_file
from xper_fx.support.profile import OTHER

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from xper_fx.support.profile import PhaseRow


CRACK_KINDS: tuple[str, ...] = ("matrix", "interface", "inclusion")
"""What a crack runs through: the meaning of ``CrackPanel.crack_kind`` 0, 1, 2."""

_CRACK_COLOURS = ("#E69F00", "#0072B2", "#C1121F")
_MATERIAL_GRAYS = ("#dcdcdc", "#858585", "#b4b4b4", "#5f5f5f")
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
"""Of curves: Okabe and Ito's, without yellow, which a white page swallows."""

_LINE_STYLES = ("-", "--", "-.", (0, (1, 1)), (0, (5, 1, 1, 1, 1, 1)))
_STYLE = {
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 9.0,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "axes.linewidth": 0.8,
    "lines.linewidth": 1.5,
    "xtick.direction": "in",
    "ytick.direction": "in",
}
# Label and colour of each term: what is stored is drawn solid, what is dissipated dashed.
_ENERGY_TERMS = {
    "kinetic": ("kinetic", "#56B4E9"),
    "elastic": ("elastic", "#0072B2"),
    "cohesive": ("cohesive, stored", "#009E73"),
    "shadow": ("shadow of central differences", "#332288"),
    "healing": ("given by healing", "#117733"),
    "dissipated_cohesion": ("dissipated by cracking", "#D55E00"),
    "dissipated_friction": ("dissipated by friction", "#E69F00"),
    "dissipated_impact": ("dissipated by impacts", "#CC79A7"),
    "dissipated_plastic": ("dissipated by plasticity", "#8A2BE2"),
    "dissipated_viscous": ("dissipated by viscosity", "#7F4F24"),
    "dissipated_viscous_bonds": ("dissipated by viscous bonds", "#F0A3FF"),
    "dissipated_numerical": ("dissipated by the scheme", "#777777"),
}
# Terms that a history has if the run calls for them.
_OF_SOME_RUNS = ("dissipated_plastic", "dissipated_viscous_bonds", "shadow", "healing")

# Letters in a line of a note below a figure.
_NOTE_WIDTH = 120
# Width of a letter in the figure of a profile, beside the width of the figure.
_LETTER = 0.01


def new_figure(
    path: str | os.PathLike[str] | None,
    draw: Any,
    size: tuple[float, float],
    layout: str = "constrained",
    **subplots: Any,
) -> "Figure":
    """Make a figure in the house style, let ``draw(figure, axes)`` fill it, save it."""
    try:
        from matplotlib import rc_context
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ImportError(
            "Figures need matplotlib, which is not installed: pip install 'xper_fx[plot]'."
        ) from error
    if path is not None:
        path = require_path("path", path)
        known = Figure().canvas.get_supported_filetypes()
        if path.suffix and path.suffix[1:].lower() not in known:
            raise ValueError(
                f"'{path}' names the format {path.suffix!r}; expected one of {', '.join(known)}."
            )
    with rc_context(_STYLE):
        figure = Figure(figsize=size, layout=layout)
        draw(figure, figure.subplots(**subplots))
        if path is not None:
            image = io.BytesIO()
            path = path if path.suffix else path.with_name(f"{path.name}.png")
            figure.savefig(image, dpi=160, format=path.suffix[1:])
            write_file(path, image.getvalue())
    return figure


def _draw_materials(
    axes: "Axes",
    corners: npt.NDArray[np.float64],
    material: npt.NDArray[np.integer],
    names: Mapping[int, str],
) -> list[Any]:
    """Fill the triangles, corners of shape (num_cells, 3, 2), and return the legend's entries."""
    from matplotlib.collections import PolyCollection
    from matplotlib.patches import Patch

    handles = []
    for number, tag in enumerate(np.unique(material)):
        gray = _MATERIAL_GRAYS[number % len(_MATERIAL_GRAYS)]
        # A thin edge closes the hairlines that antialiasing leaves between neighbours.
        axes.add_collection(
            PolyCollection(
                corners[material == tag],
                facecolors=gray,
                edgecolors=gray,
                linewidths=0.3,
                rasterized=True,
            )
        )
        handles.append(
            Patch(facecolor=gray, edgecolor="none", label=names.get(int(tag), f"material {tag}"))
        )
    axes.set_aspect("equal")
    return handles


def plot_microstructure(
    points: npt.ArrayLike,
    triangles: npt.ArrayLike,
    material: npt.ArrayLike,
    precrack_segments: npt.ArrayLike,
    path: str | os.PathLike[str] | None = None,
    length_unit: tuple[str, float] = ("\u00b5m", 1e-6),
    names: Mapping[int, str] | None = None,
) -> "Figure":
    """Draw the materials, the precrack and the faces that are pulled (Perales et al. 2010, Fig. 8).

    Args:
        points: Shape (num_points, 2), m.
        triangles: Connectivity, shape (num_cells, 3).
        material: Material tag of each triangle, shape (num_cells,).
        precrack_segments: End points of the precracked facets, shape (m, 2, 2), m; may be empty.
        path: Where to save the figure, if at all.
        length_unit: Name of the unit of the axes and its value in m.
        names: Name of each material tag; 1 is "matrix" and 2 "inclusion" by default.

    Returns:
        The figure.

    Raises:
        ValueError, TypeError: If shapes do not fit, or something is no number.
        ImportError: If matplotlib is missing.
    """
    points, triangles, material = checked_mesh(points, triangles, material)
    unit, scale = checked_unit("length_unit", length_unit)
    precrack = checked_segments("precrack_segments", precrack_segments) / scale

    def draw(figure: "Figure", axes: "Axes") -> None:
        from matplotlib.collections import LineCollection
        from matplotlib.lines import Line2D
        from matplotlib.patheffects import Normal, Stroke

        handles = _draw_materials(
            axes, points[triangles] / scale, material, names or {1: "matrix", 2: "inclusion"}
        )
        if len(precrack):
            for colour, width in (("black", 4.0), ("white", 2.4)):
                axes.add_collection(
                    LineCollection(
                        precrack, colors=colour, linewidths=width, capstyle="projecting", zorder=3
                    )
                )
            outline = [Stroke(linewidth=4.0, foreground="black"), Normal()]
            handles.append(
                Line2D([], [], color="white", lw=2.4, path_effects=outline, label="precrack")
            )
        low, high = points.min(axis=0) / scale, points.max(axis=0) / scale
        size = high - low
        for side, start in ((-1, low[0]), (1, high[0])):
            for height in low[1] + size[1] * np.linspace(0.1, 0.9, 5):
                axes.annotate(
                    "",
                    xy=(start + side * 0.12 * size[0], height),
                    xytext=(start + side * 0.02 * size[0], height),
                    arrowprops={"arrowstyle": "-|>", "color": "black", "shrinkA": 0, "shrinkB": 0},
                )
        axes.set(
            xlim=(low[0] - 0.14 * size[0], high[0] + 0.14 * size[0]),
            ylim=(low[1] - 0.02 * size[1], high[1] + 0.02 * size[1]),
            xlabel=f"x ({unit})",
            ylabel=f"y ({unit})",
        )
        axes.legend(
            handles=handles, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(handles)
        )

    return new_figure(path, draw, (4.4, 4.0), layout="compressed")


def plot_grains(
    points: npt.ArrayLike,
    triangles: npt.ArrayLike,
    grain: npt.ArrayLike,
    hard: npt.ArrayLike,
    path: str | os.PathLike[str] | None = None,
    length_unit: tuple[str, float] = ("\u00b5m", 1e-6),
) -> "Figure":
    """Draw grains in shades of gray, inclusions bordered in white (Perales et al. 2010, Fig. 13).

    Args:
        points: Shape (num_points, 2), m.
        triangles: Connectivity, shape (num_cells, 3).
        grain: Grain of each triangle, shape (num_cells,), int.
        hard: Whether a triangle belongs to an inclusion, shape (num_cells,), bool.
        path: Where to save the figure, if at all.
        length_unit: Name of the unit of the axes and its value in m.

    Returns:
        The figure.

    Raises:
        ValueError, TypeError: If shapes do not fit, or something is no number.
        ImportError: If matplotlib is missing.
    """
    points, triangles, grain = checked_mesh(points, triangles, grain)
    hard = np.asarray(hard, dtype=bool)
    if hard.shape != grain.shape:
        raise ValueError(f"hard should have shape {grain.shape}, got {hard.shape}.")
    unit, scale = checked_unit("length_unit", length_unit)
    corners = points[triangles] / scale
    # a shade for each grain that neighbours in number do not share
    shade = 0.3 + 0.5 * ((0.6180339887 * grain) % 1.0)

    def draw(figure: "Figure", axes: "Axes") -> None:
        from matplotlib.collections import LineCollection, PolyCollection

        colours = np.repeat(shade[:, None], 3, axis=1)
        axes.add_collection(
            PolyCollection(
                corners, facecolors=colours, edgecolors=colours, linewidths=0.3, rasterized=True
            )
        )
        border = _border(corners[hard])
        axes.add_collection(LineCollection(border, colors="white", linewidths=2.0, zorder=3))
        axes.set_aspect("equal")
        axes.autoscale_view()
        axes.margins(0.01)
        axes.set_xlabel(f"x ({unit})")
        axes.set_ylabel(f"y ({unit})")
        axes.set_title(f"{len(np.unique(grain))} grains, inclusions within white borders")

    return new_figure(path, draw, (4.4, 4.0), layout="compressed")


def _border(corners: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the edges that only one of some triangles has, shape (m, 2, 2)."""
    edges = corners[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2, 2)
    if not len(edges):
        return edges
    size = np.ptp(edges.reshape(-1, 2), axis=0).max()
    keys = np.round(edges.mean(axis=1) * (1e9 / size)).astype(np.int64)
    _, inverse, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    return edges[count[inverse.reshape(-1)] == 1]


@dataclass(frozen=True)
class CrackPanel:
    """A cracked plate, one panel of :func:`plot_cracks`.

    Args:
        points: Reference coordinates of the exploded mesh, shape (num_points, 2), m.
        triangles: Connectivity, shape (num_cells, 3).
        material: Material tag of each triangle, shape (num_cells,).
        displacement: Displacement of the points, shape (num_points, 2), m.
        crack_segments: End points of the cracked facets in reference coordinates, on edges of
            the mesh, shape (m, 2, 2), m.
        crack_kind: What each segment runs through, shape (m,): see :data:`CRACK_KINDS`.
        title: Title of the panel.
    """

    points: npt.ArrayLike
    triangles: npt.ArrayLike
    material: npt.ArrayLike
    displacement: npt.ArrayLike
    crack_segments: npt.ArrayLike
    crack_kind: npt.ArrayLike
    title: str = ""

    def crack_lengths(self) -> dict[str, float]:
        """Return the total reference length of the cracks of each kind, m."""
        segments = np.asarray(self.crack_segments, dtype=np.float64).reshape(-1, 2, 2)
        kind = np.asarray(self.crack_kind, dtype=np.int64).reshape(-1)
        lengths = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
        totals = np.bincount(kind, weights=lengths, minlength=len(CRACK_KINDS))
        return dict(zip(CRACK_KINDS, totals.tolist(), strict=True))

    def tiled(
        self, lattice: npt.ArrayLike, gradient: npt.ArrayLike, copies: int = 2
    ) -> "CrackPanel":
        """Repeat a periodic cell along its lattice.

        Args:
            lattice: Period vectors as rows, shape (2, 2), m.
            gradient: Macroscopic gradient Fbar, shape (2, 2).
            copies: Number of cells along each period vector.

        Returns:
            The panel of `copies` x `copies` cells.

        Raises:
            ValueError, TypeError: If shapes do not fit, or something is no number.
        """
        lattice, gradient = (
            require_vector(name, given, (2, 2))
            for name, given in (("lattice", lattice), ("gradient", gradient))
        )
        require_count("copies", copies, 1)
        points, triangles, material = checked_mesh(self.points, self.triangles, self.material)
        displacement = np.asarray(self.displacement, dtype=np.float64)[:, :2]
        segments = np.asarray(self.crack_segments, dtype=np.float64).reshape(-1, 2, 2)
        steps = np.stack(np.meshgrid(*2 * [np.arange(copies)], indexing="ij"), axis=-1)
        shifts = steps.reshape(-1, 2) @ lattice
        stretch = shifts @ (gradient - np.eye(2)).T
        return CrackPanel(
            points=np.concatenate([points + shift for shift in shifts]),
            triangles=np.concatenate([triangles + k * len(points) for k in range(len(shifts))]),
            material=np.tile(material, len(shifts)),
            displacement=np.concatenate([displacement + move for move in stretch]),
            crack_segments=np.concatenate([segments + shift for shift in shifts]),
            crack_kind=np.tile(np.asarray(self.crack_kind, dtype=np.int64), len(shifts)),
            title=f"{self.title}, {copies} x {copies} cells",
        )

    def deformed_lips(self, magnification: float = 1.0) -> npt.NDArray[np.float64]:
        """Move the crack segments with the body on each side.

        Args:
            magnification: Factor on the displacement.

        Returns:
            The two lips of each segment, shape (2, m, 2, 2), m. Where there is a body on one side
            only, both are that one's.

        Raises:
            ValueError: If a segment does not touch the mesh.
        """
        from matplotlib.tri import Triangulation

        points, triangles, _ = checked_mesh(self.points, self.triangles, self.material)
        displacement = np.asarray(self.displacement, dtype=np.float64)[:, :2]
        segments = np.asarray(self.crack_segments, dtype=np.float64).reshape(-1, 2, 2)
        if not len(segments):
            return np.stack([segments, segments])
        # Coincident points are one to the search; a triangle keeps its number, hence its body.
        low = points.min(axis=0)
        size = np.ptp(points, axis=0).max()
        keys = np.round((points - low) * (1e9 / size)).astype(np.int64)
        _, first, merged = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        scaled = (points - low) / size
        find = Triangulation(
            *scaled[first].T, triangles=merged.reshape(-1)[triangles]
        ).get_trifinder()

        ends = (segments - low) / size
        along = ends[:, 1] - ends[:, 0]
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)
        lips = np.full((2, *segments.shape), np.nan)
        for lip, offset in zip(lips, (-0.05, 0.05), strict=True):
            probe = ends.mean(axis=1) + offset * across
            cell = find(*probe.T)
            inside = cell >= 0
            nodes = triangles[cell[inside]]
            # Affine interpolation of the triangle's displacement at the segment's two ends.
            basis = np.concatenate([scaled[nodes], np.ones((len(nodes), 3, 1))], axis=2)
            coefficients = np.linalg.solve(basis, displacement[nodes])
            at = np.concatenate([ends[inside], np.ones((len(nodes), 2, 1))], axis=2)
            lip[inside] = segments[inside] + magnification * (at @ coefficients)
        lips = np.where(np.isnan(lips), lips[::-1], lips)
        off = np.isnan(lips).any(axis=(0, 2, 3))
        if off.any():
            raise ValueError(
                f"The crack segment {segments[off][0].tolist()} does not touch the mesh: "
                "give the ends of mesh edges in reference coordinates."
            )
        return lips


def plot_cracks(
    panels: CrackPanel | Sequence[CrackPanel],
    magnification: float = 1.0,
    path: str | os.PathLike[str] | None = None,
    length_unit: tuple[str, float] = ("\u00b5m", 1e-6),
    names: Mapping[int, str] | None = None,
    kinds: Sequence[str] = CRACK_KINDS,
) -> "Figure":
    """Draw deformed, cracked plates side by side (Perales et al. 2010, Fig. 9).

    Open cracks are white gaps between lips in the colour of what the crack runs through; the
    legend below a panel has the length of each kind, measured in the reference configuration.

    Args:
        panels: One plate, or several to be drawn at the same scale.
        magnification: Factor on the displacement.
        path: Where to save the figure, if at all.
        length_unit: Name of the unit of axes and crack lengths and its value in m.
        names: Name of each material tag; 1 is "matrix" and 2 "inclusion" by default.
        kinds: Name of what a crack of each of the three kinds runs through.

    Returns:
        The figure.

    Raises:
        ValueError, TypeError: If shapes do not fit, a crack is not on the mesh, or something is
            no number.
        ImportError: If matplotlib is missing.
    """
    if not isinstance(panels, Sequence):
        require_kind("A panel", panels, CrackPanel)
    panels = [panels] if isinstance(panels, CrackPanel) else list(panels)
    if not panels:
        raise ValueError("Cracks need at least one panel, got none.")
    unit, scale = checked_unit("length_unit", length_unit)
    if not np.isfinite(require_number("magnification", magnification)):
        raise ValueError(f"magnification should be a finite number, got {magnification}.")
    for panel in panels:
        require_kind("A panel", panel, CrackPanel)
        points, _, _ = checked_mesh(panel.points, panel.triangles, panel.material)
        shapes = [np.shape(panel.displacement), np.shape(panel.crack_kind)]
        if shapes[0] not in ((len(points), 2), (len(points), 3)):
            raise ValueError(
                f"Displacement should have shape ({len(points)}, 2 or 3), got {shapes[0]}."
            )
        if not np.isfinite(require_numbers("displacement", panel.displacement)).all():
            raise ValueError("displacement should be finite, got NaN or infinity.")
        if np.shape(panel.crack_segments) != (*shapes[1], 2, 2) and np.size(panel.crack_segments):
            raise ValueError(
                f"Crack segments should have shape (m, 2, 2) and kinds (m,), "
                f"got {np.shape(panel.crack_segments)} and {shapes[1]}."
            )
        if np.size(panel.crack_kind) and not np.isin(panel.crack_kind, (0, 1, 2)).all():
            raise ValueError(f"Crack kinds should be 0 {CRACK_KINDS[0]}, 1 or 2.")

    def draw(figure: "Figure", row: npt.NDArray[Any]) -> None:
        from matplotlib.collections import LineCollection
        from matplotlib.lines import Line2D

        for panel, axes in zip(panels, row[0], strict=True):
            mesh = checked_mesh(panel.points, panel.triangles, panel.material)
            points, triangles, material = mesh
            moved = points + magnification * np.asarray(panel.displacement)[:, :2]
            materials = _draw_materials(
                axes, moved[triangles] / scale, material, names or {1: "matrix", 2: "inclusion"}
            )
            lips = panel.deformed_lips(magnification) / scale
            kind_of = np.asarray(panel.crack_kind).reshape(-1)
            lengths = list(panel.crack_lengths().values())
            handles = []
            for kind, colour in enumerate(_CRACK_COLOURS):
                axes.add_collection(
                    LineCollection(
                        lips[:, kind_of == kind].reshape(-1, 2, 2),
                        colors=colour,
                        linewidths=0.9,
                        zorder=3,
                    )
                )
                text = f"{kinds[kind]} {lengths[kind] / scale:.1f} {unit}"
                handles.append(Line2D([], [], color=colour, lw=2.0, label=text))
            axes.autoscale_view()
            axes.margins(0.03)
            axes.set(title=panel.title, xlabel=f"x ({unit})")
            axes.legend(
                handles=handles,
                title="cracks through",
                title_fontsize=8.0,
                loc="upper center",
                bbox_to_anchor=(0.5, -0.14),
                ncols=3,
                columnspacing=1.0,
                handlelength=1.2,
            )
        row[0, 0].set_ylabel(f"y ({unit})")
        figure.legend(handles=materials, loc="outside upper center", ncols=len(materials))
        if magnification != 1.0:
            figure.supxlabel(f"displacement magnified {magnification:g} times", fontsize=8.0)

    return new_figure(
        path,
        draw,
        (0.6 + 3.7 * len(panels), 5.0),
        layout="compressed",
        ncols=len(panels),
        sharex=True,
        sharey=True,
        squeeze=False,
    )


def plot_curves(
    curves: Sequence[tuple[Any, ...]],
    path: str | os.PathLike[str] | None = None,
    stress_unit: tuple[str, float] = ("MPa", 1e6),
    title: str = "",
) -> "Figure":
    """Draw stress against strain (Perales et al. 2010, Fig. 10).

    Args:
        curves: For each curve (label, strain, stress) or (label, strain, stress, style): strain
            dimensionless, stress in Pa, both of shape (num_steps,); style, a mapping, goes to
            ``Axes.plot``.
        path: Where to save the figure, if at all.
        stress_unit: Name of the unit of stress and its value in Pa.
        title: Title of the figure.

    Returns:
        The figure.

    Raises:
        ValueError, TypeError: If there is no curve, strain and stress differ in length, or
            something is no number.
        ImportError: If matplotlib is missing.
    """
    if not isinstance(curves, Sequence) or not len(curves):
        raise ValueError(f"curves should be a list with at least one curve, got {curves!r}.")
    checked_unit("stress_unit", stress_unit)
    for curve in curves:
        if not isinstance(curve, Sequence) or not 3 <= len(curve) <= 4:
            raise ValueError(f"A curve should be (label, strain, stress), got {curve!r}.")
        label, strain, stress, *_ = curve
        for values in (strain, stress):
            require_numbers(f"The curve '{label}'", values)
        if np.ndim(strain) != 1 or np.shape(strain) != np.shape(stress):
            raise ValueError(
                f"The curve '{label}' needs as many strains as stresses, "
                f"got shapes {np.shape(strain)} and {np.shape(stress)}."
            )

    def draw(figure: "Figure", axes: "Axes") -> None:
        for number, (label, strain, stress, *style) in enumerate(curves):
            axes.plot(
                100 * np.asarray(strain),
                np.asarray(stress) / stress_unit[1],
                **{
                    "label": label,
                    "color": COLOURS[number % len(COLOURS)],
                    "linestyle": _LINE_STYLES[number % len(_LINE_STYLES)],
                    **(style[0] if style else {}),
                },
            )
        axes.axhline(0.0, color="0.7", lw=0.6, zorder=0)
        axes.margins(x=0.0)
        axes.set(xlabel="strain (%)", ylabel=f"stress ({stress_unit[0]})", title=title)
        if len(curves) > 1:
            figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=3)

    return new_figure(path, draw, (4.6, 3.4))


def plot_energies(
    history: Mapping[str, npt.ArrayLike],
    path: str | os.PathLike[str] | None = None,
    energy_unit: tuple[str, float] = ("mJ/m", 1e-3),
    title: str = "",
    against: str = "strain",
    note: str = "",
) -> "Figure":
    """Draw the energy ledger against strain or time, and its closure error below.

    Terms that stay zero throughout, those of effects that are off, are left out.

    Args:
        history: Columns of :data:`xper_fx.output.history.HISTORY_COLUMNS`, as
            :func:`xper_fx.output.history.read_history` gives them; energies and closure in J/m
            (2D).
        path: Where to save the figure, if at all.
        energy_unit: Name of the unit of energy and its value in J/m.
        title: Title of the figure.
        against: "strain" or "time".
        note: A sentence below the figure, such as the verdict of the run.

    Returns:
        The figure: upper panel the terms, lower panel the absolute closure error divided by the
        largest external work so far; against time, where bodies may fly at the start, by the
        largest sum of terms so far.

    Raises:
        ValueError, TypeError: If there is no step, a column is missing, or it is no history.
        ImportError: If matplotlib is missing.
    """
    require_mapping("history", history, "as read_history(path) gives it")
    if against not in ("strain", "time"):
        raise ValueError(f'against should be "strain" or "time", got {against!r}.')
    checked_unit("energy_unit", energy_unit)
    terms = [t for t in _ENERGY_TERMS if t in history or t not in _OF_SOME_RUNS]
    needed = (against, "external_work", *terms, "closure")
    missing = [column for column in needed if column not in history]
    if missing:
        raise ValueError(f"The history lacks {missing}, needed for the energies.")
    data = {column: np.asarray(history[column], dtype=np.float64) for column in needed}
    if not len(data["closure"]):
        raise ValueError("The history has no step yet, so that there is nothing to draw.")
    by_strain = against == "strain"
    x = 100 * data["strain"] if by_strain else data[against]

    def draw(figure: "Figure", rows: npt.NDArray[Any]) -> None:
        upper, lower = rows
        upper.plot(
            x, data["external_work"] / energy_unit[1], color="black", lw=2.0, label="external work"
        )
        for column in terms:
            label, colour = _ENERGY_TERMS[column]
            if data[column].any():
                upper.plot(
                    x,
                    data[column] / energy_unit[1],
                    color=colour,
                    linestyle="--" if column.startswith("dissipated") else "-",
                    label=label,
                )
        upper.axhline(0.0, color="0.7", lw=0.6, zorder=0)
        upper.margins(x=0.0)
        upper.set(ylabel=f"energy ({energy_unit[0]})", title=title)
        figure.legend(*upper.get_legend_handles_labels(), loc="outside right upper")

        scale = data["external_work"] if by_strain else sum(data[column] for column in terms)
        scale = np.maximum.accumulate(np.abs(scale))
        shown = (scale > 0) & (data["closure"] != 0)
        lower.semilogy(
            x[shown], np.abs(data["closure"][shown]) / scale[shown], color="black", lw=0.8
        )
        lower.set_ylabel("|closure| / work" if by_strain else "|closure| / energy")
        lower.set_xlabel("strain (%)" if by_strain else "time (s)")
        lower.margins(x=0.0)
        if note:
            figure.supxlabel("\n".join(wrap(note, _NOTE_WIDTH)), fontsize=7, x=0.02, ha="left")

    return new_figure(path, draw, (6.4, 4.4), nrows=2, sharex=True, height_ratios=(3, 1))


def plot_law(
    opening: npt.ArrayLike,
    traction: npt.ArrayLike | Mapping[str, npt.ArrayLike],
    path: str | os.PathLike[str] | None = None,
    length_unit: tuple[str, float] = ("nm", 1e-9),
    stress_unit: tuple[str, float] = ("MPa", 1e6),
    title: str = "",
) -> "Figure":
    """Draw the traction of an interaction law against the opening.

    Args:
        opening: Shape (num_openings,), m.
        traction: Shape (num_openings,), Pa, or several such arrays by label. The area under a
            single curve, the energy spent on it, is shaded and given in J/m^2.
        path: Where to save the figure, if at all.
        length_unit: Name of the unit of opening and its value in m.
        stress_unit: Name of the unit of traction and its value in Pa.
        title: Title of the figure.

    Returns:
        The figure.

    Raises:
        ValueError, TypeError: If there is none, openings and tractions differ in length, or
            something is no number.
        ImportError: If matplotlib is missing.
    """
    opening = require_numbers("opening", opening)
    checked_unit("length_unit", length_unit)
    checked_unit("stress_unit", stress_unit)
    curves = traction if isinstance(traction, Mapping) else {"": traction}
    if not opening.size or not curves:
        raise ValueError("A law needs at least one opening and its traction, got none.")
    for label, values in curves.items():
        require_numbers("traction", values)
        if opening.ndim != 1 or np.shape(values) != opening.shape:
            raise ValueError(
                f"The law{f' {label}' if label else ''} needs as many tractions as openings, "
                f"got shapes {np.shape(values)} and {opening.shape}."
            )

    def draw(figure: "Figure", axes: "Axes") -> None:
        x = opening / length_unit[1]
        for number, (label, values) in enumerate(curves.items()):
            y = np.asarray(values, dtype=np.float64) / stress_unit[1]
            colour = COLOURS[number % len(COLOURS)]
            style = _LINE_STYLES[number % len(_LINE_STYLES)]
            axes.plot(x, y, color=colour, linestyle=style, label=label)
            if len(curves) == 1:
                area = 0.5 * np.diff(x) @ (y[1:] + y[:-1]) * stress_unit[1] * length_unit[1]
                axes.fill_between(
                    x, y, color=colour, alpha=0.15, lw=0, label=f"area {area:.4g} J/m$^2$"
                )
        axes.axhline(0.0, color="0.7", lw=0.6, zorder=0)
        axes.margins(x=0.0)
        axes.set_xlabel(f"opening ({length_unit[0]})")
        axes.set_ylabel(f"traction ({stress_unit[0]})")
        axes.set_title(title)
        handles, labels = axes.get_legend_handles_labels()
        shown = [(handle, label) for handle, label in zip(handles, labels, strict=True) if label]
        figure.legend(*zip(*shown, strict=True), loc="outside upper center", ncols=3)

    return new_figure(path, draw, (4.6, 3.4))


def plot_profile(
    rows: "Sequence[PhaseRow]", path: str | os.PathLike[str] | None = None, title: str = ""
) -> "Figure":
    """Draw where the time of a run went: a phase is as wide as its share, what is within it below.

    What a bar does not have below it is its own time; what no phase covers is drawn hatched, so
    that the first line is the whole run.

    Args:
        rows: The rows of a profile (``Stopwatch.rows``).
        path: Where to save the figure, if at all.
        title: Title of the figure.

    Returns:
        The figure.

    Raises:
        ValueError: If there are no rows.
        ImportError: If matplotlib is missing.
    """
    if not isinstance(rows, Sequence) or not len(rows):
        raise ValueError(f"rows should be those of a profile, `stopwatch.rows()`, got {rows!r}.")
    depth = max(len(row.path) for row in rows)
    top = dict.fromkeys(row.path[0] for row in rows)
    colours = dict(zip(top, itertools.cycle(COLOURS[:-1]), strict=False))
    total = sum(row.seconds for row in rows if len(row.path) == 1)

    def draw(figure: "Figure", axes: "Axes") -> None:
        right: dict[tuple[str, ...], float] = {(): 0.0}  # where the next part of a phase begins
        for row in rows:
            left = right[row.path[:-1]]
            right[row.path], right[row.path[:-1]] = left, left + row.seconds
            other = row.path == (OTHER,)
            axes.barh(
                len(row.path) - 1,
                row.seconds,
                0.94,
                left,
                edgecolor="white",
                linewidth=0.8,
                color="0.8" if other else colours[row.path[0]],
                alpha=0.8 - 0.4 * (len(row.path) - 1) / max(depth - 1, 1),
                hatch="//" if other else None,
            )
            share, name = row.share, row.path[-1]
            label, angle = f"{name}\n{100.0 * share:.1f} %", 0
            if share < _LETTER * max(map(len, label.split("\n"))):
                label, angle = name.replace(" ", "\n"), 90
            if angle == 0 or share > 2.0 * _LETTER * len(label.split("\n")):
                axes.text(
                    left + 0.5 * row.seconds,
                    len(row.path) - 1,
                    label,
                    rotation=angle,
                    ha="center",
                    va="center",
                    fontsize=7.0,
                )
        axes.set(xlim=(0.0, total), ylim=(depth - 0.5, -0.5), yticks=[])
        axes.spines[["left", "right", "top"]].set_visible(False)
        axes.set(xlabel="wall time (s)", title=title)

    return new_figure(path, draw, (8.0, 0.9 + 0.75 * depth))
