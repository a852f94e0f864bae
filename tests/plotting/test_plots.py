# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures hold the data they were given, in the units they name, and are not blank."""

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from xper_fx.output.history import HISTORY_COLUMNS
from xper_fx.plotting.figures import (
    CrackPanel,
    plot_cracks,
    plot_curves,
    plot_energies,
    plot_grains,
    plot_law,
    plot_microstructure,
)
from xper_fx.plotting.fragment_figure import plot_fragments

pytest.importorskip("matplotlib")
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.image import imread

SIZE = 50e-6


def crossed_square(num):
    """Square of crossed triangles, the middle third an inclusion: points, triangles, material."""
    grid = np.linspace(0.0, SIZE, num + 1)
    x, y = np.meshgrid(grid, grid, indexing="ij")
    corners = np.stack([x.ravel(), y.ravel()], axis=1)
    i, j = (index.ravel() for index in np.indices((num, num)))
    a = i * (num + 1) + j
    b, c, d = a + num + 1, a + num + 2, a + 1
    middle = len(corners) + np.arange(num * num)
    points = np.vstack([corners, corners[a] + SIZE / num / 2])
    triangles = np.concatenate(
        [np.stack([*pair, middle], axis=1) for pair in ((a, b), (b, c), (c, d), (d, a))]
    )
    centre = points[triangles].mean(axis=1)
    inside = (np.abs(centre / SIZE - 0.5) < 1 / 6).all(axis=1)
    return points, triangles, np.where(inside, 2, 1)


def split_panel(num=6, opening=2e-6, title=""):
    """Every cell its own body, halves pulled apart along x = SIZE / 2 by a linear opening."""
    points, triangles, material = crossed_square(num)
    exploded = points[triangles].reshape(-1, 2)
    right = np.repeat(points[triangles].mean(axis=1)[:, 0] > SIZE / 2, 3)
    displacement = np.zeros_like(exploded)
    displacement[:, 0] = np.where(right, 0.5, -0.5) * opening * exploded[:, 1] / SIZE
    heights = np.linspace(0.0, SIZE, num + 1)
    ends = np.stack([np.full(num + 1, SIZE / 2), heights], axis=1)
    segments = np.stack([ends[:-1], ends[1:]], axis=1)
    middle = np.abs(segments.mean(axis=1)[:, 1] / SIZE - 0.5) < 1 / 6
    return CrackPanel(
        exploded,
        np.arange(len(exploded)).reshape(-1, 3),
        material,
        displacement,
        segments,
        np.where(middle, 2, 0),
        title,
    )


def image(path):
    """Read a saved figure and check that it is neither blank nor cut by the page's border."""
    pixels = imread(path)[..., :3]
    assert pixels.std() > 0.05
    border = [pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]]
    assert all((edge == 1.0).all() for edge in border)
    return pixels


def has_colour(pixels, colour, at_least):
    """Whether enough pixels have about this colour."""
    near = np.abs(pixels - np.array(to_rgba(colour)[:3])).max(axis=-1) < 0.02
    return near.sum() >= at_least


def legend_texts(figure):
    legends = figure.legends + [a.get_legend() for a in figure.axes if a.get_legend()]
    return [text.get_text() for legend in legends for text in legend.get_texts()]


def overlap(figure):
    """Whether a legend lies on the data area of a panel."""
    figure.canvas.draw()
    legends = figure.legends + [a.get_legend() for a in figure.axes if a.get_legend()]
    return any(
        legend.get_window_extent().shrunk(0.98, 0.98).overlaps(axes.get_window_extent())
        for legend in legends
        for axes in figure.axes
    )


def test_microstructure(tmp_path):
    points, triangles, material = crossed_square(6)
    precrack = [[[SIZE / 2, 0.0], [SIZE / 2, SIZE / 6]]]
    figure = plot_microstructure(points, triangles, material, precrack, tmp_path / "m.png")
    (axes,) = figure.axes
    patches = [c for c in axes.collections if isinstance(c, PolyCollection)]
    assert [len(c.get_paths()) for c in patches] == [(material == 1).sum(), (material == 2).sum()]
    # The inclusion is where it is, in micrometres, and darker than the matrix.
    box = np.concatenate([path.vertices for path in patches[1].get_paths()])
    np.testing.assert_allclose([box.min(), box.max()], [50 / 3, 100 / 3])
    assert patches[0].get_facecolor()[0, 0] > patches[1].get_facecolor()[0, 0] + 0.2
    lines = [c for c in axes.collections if isinstance(c, LineCollection)]
    np.testing.assert_allclose(lines[-1].get_segments(), [[[25.0, 0.0], [25.0, 25 / 3]]])
    assert lines[-1].get_colors()[0].tolist() == [1, 1, 1, 1]
    assert lines[0].get_linewidths()[0] > lines[-1].get_linewidths()[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x (\u00b5m)", "y (\u00b5m)")
    assert legend_texts(figure) == ["matrix", "inclusion", "precrack"]
    pulls = [(a.xyann[0], a.xy[0]) for a in axes.texts]
    assert all(tip < tail < 0 for tail, tip in pulls[:5])
    assert all(tip > tail > 50 for tail, tip in pulls[5:])
    assert not overlap(figure)
    pixels = image(tmp_path / "m.png")
    assert has_colour(pixels, "#dcdcdc", 10_000) and has_colour(pixels, "#858585", 1_000)


def test_microstructure_units_and_names():
    points, triangles, material = crossed_square(3)
    figure = plot_microstructure(
        points, triangles, material, np.empty((0, 2, 2)), length_unit=("mm", 1e-3), names={2: "b"}
    )
    assert figure.axes[0].get_xlabel() == "x (mm)"
    assert figure.axes[0].get_xlim()[1] < 0.06
    assert legend_texts(figure) == ["material 1", "b"]


def test_cracks(tmp_path):
    weak, strong = split_panel(title="weak"), split_panel(opening=0.0, title="strong")
    figure = plot_cracks([weak, strong], path=tmp_path / "c.png")
    assert [axes.get_title() for axes in figure.axes] == ["weak", "strong"]
    assert figure.axes[0].get_xlim() == figure.axes[1].get_xlim()
    assert figure.axes[0].get_ylabel() == "y (\u00b5m)"
    texts = legend_texts(figure)
    assert texts[:2] == ["matrix", "inclusion"]
    assert texts[2:5] == ["matrix 33.3 \u00b5m", "interface 0.0 \u00b5m", "inclusion 16.7 \u00b5m"]
    for axes in figure.axes:
        lines = [c for c in axes.collections if isinstance(c, LineCollection)]
        # Two lips of each of the four matrix and two inclusion facets.
        assert [len(c.get_segments()) for c in lines] == [8, 0, 4]
        assert len({tuple(c.get_colors()[0]) for c in lines}) == 3
    corners = np.concatenate(
        [p.vertices for c in figure.axes[0].collections[:2] for p in c.get_paths()]
    )
    np.testing.assert_allclose([corners[:, 0].min(), corners[:, 0].max()], [-1.0, 51.0])
    assert not overlap(figure)
    pixels = image(tmp_path / "c.png")
    assert has_colour(pixels, "#E69F00", 100) and has_colour(pixels, "#C1121F", 50)


def test_one_panel_may_be_given_alone(tmp_path):
    figure = plot_cracks(split_panel(), magnification=5.0, path=tmp_path / "c.png")
    (axes,) = figure.axes
    assert "magnified 5 times" in figure.get_supxlabel()
    assert not overlap(figure)
    image(tmp_path / "c.png")


@pytest.mark.parametrize("magnification", [0.0, 1.0, 5.0])
def test_lips_move_with_their_bodies(magnification):
    panel = split_panel()
    segments = panel.crack_segments
    lips = panel.deformed_lips(magnification)
    lips = lips[np.argsort(lips[:, -1, -1, 0])]
    half = 1e-6 * magnification * segments[..., 1] / SIZE
    for lip, sign in zip(lips, (-1, 1), strict=True):
        np.testing.assert_allclose(lip[..., 0], SIZE / 2 + sign * half, rtol=1e-9)
        np.testing.assert_allclose(lip[..., 1], segments[..., 1], atol=1e-15)


def test_lips_of_half_and_boundary_segments():
    panel = split_panel()
    half = [[[SIZE / 2, 0.0], [SIZE / 2, SIZE / 12]]]
    side = [[[SIZE, 0.0], [SIZE, SIZE / 6]]]
    changed = CrackPanel(*list(vars(panel).values())[:4], np.array(half + side), [0, 0])
    lips = changed.deformed_lips(1.0)
    np.testing.assert_allclose(
        np.sort(lips[:, 0, 1, 0]), SIZE / 2 + np.array([-1, 1]) * 1e-6 / 12, rtol=1e-9
    )
    np.testing.assert_allclose(lips[0, 1], lips[1, 1])
    np.testing.assert_allclose(lips[0, 1, 1, 0], SIZE + 1e-6 / 6)
    outside = CrackPanel(*list(vars(panel).values())[:4], np.array(half) + 2 * SIZE, [0])
    with pytest.raises(ValueError, match="does not touch the mesh"):
        outside.deformed_lips()


def test_crack_lengths():
    lengths = split_panel().crack_lengths()
    assert list(lengths) == ["matrix", "interface", "inclusion"]
    np.testing.assert_allclose(list(lengths.values()), [SIZE * 2 / 3, 0.0, SIZE / 3])


OBLIQUE = np.array([[SIZE, 0.0], [0.25 * SIZE, SIZE]])
SHEARED = np.array([[1.02, 0.03], [-0.01, 0.96]])


@pytest.mark.parametrize("copies", [1, 2, 3])
def test_tiles_are_where_the_lattice_says(copies):
    """Points move by whole periods l, displacements by (F - I) l; the rest is repeated."""
    panel = split_panel(3, title="cell")
    tiled = panel.tiled(OBLIQUE, SHEARED, copies)
    count, cells, cracks = len(panel.points), len(panel.triangles), len(panel.crack_kind)
    assert len(tiled.points) == copies**2 * count
    for tile, (i, j) in enumerate(np.ndindex(copies, copies)):
        period = i * OBLIQUE[0] + j * OBLIQUE[1]
        own = slice(tile * count, (tile + 1) * count)
        np.testing.assert_allclose(tiled.points[own], panel.points + period, atol=1e-18)
        growth = np.array(
            [0.02 * period[0] + 0.03 * period[1], -0.01 * period[0] - 0.04 * period[1]]
        )
        np.testing.assert_allclose(tiled.displacement[own], panel.displacement + growth, atol=1e-18)
        own = slice(tile * cells, (tile + 1) * cells)
        assert np.array_equal(tiled.triangles[own], panel.triangles + tile * count)
        assert np.array_equal(tiled.material[own], panel.material)
        own = slice(tile * cracks, (tile + 1) * cracks)
        np.testing.assert_allclose(
            tiled.crack_segments[own], panel.crack_segments + period, atol=1e-18
        )
        assert np.array_equal(tiled.crack_kind[own], panel.crack_kind)
    assert tiled.title == f"cell, {copies} x {copies} cells"
    for kind, length in panel.crack_lengths().items():
        assert tiled.crack_lengths()[kind] == pytest.approx(copies**2 * length)


def test_tiles_of_a_uniform_strain_are_uniformly_strained():
    """u = (F - I) x in the cell is u = (F - I) x in all of them, from wherever x is measured."""
    points, triangles, material = crossed_square(3)
    panel = CrackPanel(
        points, triangles, material, points @ (SHEARED - np.eye(2)).T, np.empty((0, 2, 2)), []
    )
    tiled = panel.tiled(OBLIQUE, SHEARED)
    np.testing.assert_allclose(
        tiled.displacement, tiled.points @ (SHEARED - np.eye(2)).T, atol=1e-18
    )
    assert len(tiled.crack_kind) == 0


def test_tiled_cracks_can_be_drawn(tmp_path):
    """A crack on the cell's side has one lip in this tile and the other in the next."""
    points, triangles, material = crossed_square(3)
    heights = np.linspace(0.0, SIZE, 4)
    ends = np.stack([np.zeros(4), heights], axis=1)
    panel = CrackPanel(
        points[triangles].reshape(-1, 2),
        np.arange(3 * len(triangles)).reshape(-1, 3),
        material,
        np.zeros((3 * len(triangles), 2)),
        np.stack([ends[:-1], ends[1:]], axis=1),
        np.zeros(3, int),
    )
    gradient = np.diag([1.1, 1.0])
    tiled = panel.tiled(np.diag([SIZE, SIZE]), gradient)
    lips = tiled.deformed_lips(1.0)
    # each lip with its own tile: the first has not moved, the next has by a tenth of a period
    inner = np.isclose(tiled.crack_segments[:, 0, 0], SIZE)
    assert inner.sum() == 6
    np.testing.assert_allclose(
        np.sort(lips[:, inner][..., 0], axis=0)[:, :, 0],
        np.repeat([[SIZE], [1.1 * SIZE]], 6, axis=1),
    )
    plot_cracks(tiled, path=tmp_path / "t.png")
    image(tmp_path / "t.png")


def test_grains(tmp_path):
    """A shade a grain; the border of the inclusions, not the edges inside them, is white."""
    points, triangles, material = crossed_square(6)
    centre = points[triangles].mean(axis=1) / SIZE
    grain = 2 * (centre[:, 0] > 0.5) + (centre[:, 1] > 0.5)
    figure = plot_grains(points, triangles, grain, material == 2, tmp_path / "g.png")
    (axes,) = figure.axes
    (patches,) = (c for c in axes.collections if isinstance(c, PolyCollection))
    assert len(patches.get_paths()) == len(triangles)
    np.testing.assert_allclose(patches.get_paths()[5].vertices[:3], points[triangles[5]] * 1e6)
    colours = patches.get_facecolor()
    shades = [np.unique(colours[grain == g], axis=0) for g in range(4)]
    assert all(len(shade) == 1 for shade in shades)
    assert len({tuple(shade[0]) for shade in shades}) == 4
    (border,) = (c for c in axes.collections if isinstance(c, LineCollection))
    segments = np.array(border.get_segments())
    assert border.get_colors()[0].tolist() == [1, 1, 1, 1]
    # the middle third of the side: eight facets of a sixth of it each, on the square's outline
    assert len(segments) == 8
    lengths = np.linalg.norm(np.diff(segments, axis=1)[:, 0], axis=1)
    np.testing.assert_allclose(lengths, 50 / 6)
    away = np.abs(segments - 25.0).max(axis=2)
    np.testing.assert_allclose(away, 25 / 3)
    assert axes.get_title() == "4 grains, inclusions within white borders"
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x (\u00b5m)", "y (\u00b5m)")
    image(tmp_path / "g.png")


def test_grains_without_inclusions():
    points, triangles, material = crossed_square(3)
    figure = plot_grains(points, triangles, material, np.zeros(len(triangles), bool))
    (border,) = (c for c in figure.axes[0].collections if isinstance(c, LineCollection))
    assert len(border.get_segments()) == 0


def test_no_cracks_yet():
    panel = split_panel(opening=0.0)
    intact = CrackPanel(*list(vars(panel).values())[:4], np.empty((0, 2, 2)), np.empty(0, int))
    texts = legend_texts(plot_cracks(intact))
    assert texts[2:] == ["matrix 0.0 \u00b5m", "interface 0.0 \u00b5m", "inclusion 0.0 \u00b5m"]


def test_curves(tmp_path):
    strain = np.linspace(0.0, 0.012, 50)
    figure = plot_curves(
        [("weak", strain, 99e9 * strain), ("strong", strain, 4e8 * strain**0, {"color": "red"})],
        tmp_path / "s.png",
        title="plate",
    )
    (axes,) = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("strain (%)", "stress (MPa)")
    lines = axes.get_lines()
    np.testing.assert_allclose(lines[0].get_xdata()[-1], 1.2)
    np.testing.assert_allclose(lines[0].get_ydata()[-1], 1188.0)
    np.testing.assert_allclose(lines[1].get_ydata(), 400.0)
    assert lines[1].get_color() == "red" and lines[0].get_color() != "red"
    assert lines[0].get_linestyle() != lines[1].get_linestyle()
    assert legend_texts(figure) == ["weak", "strong"]
    assert axes.get_title() == "plate"
    assert not overlap(figure)
    image(tmp_path / "s.png")


def history():
    strain = np.linspace(0.0, 0.01, 100)
    table = {column: np.zeros(100) for column in HISTORY_COLUMNS}
    table["strain"] = strain
    table["external_work"] = 40.0 * strain**2
    table["elastic"] = 30.0 * strain**2
    table["dissipated_cohesion"] = 10.0 * strain**2
    table["closure"] = 1e-7 * strain * table["external_work"]
    return table


def test_energies(tmp_path):
    figure = plot_energies(history(), tmp_path / "e.png")
    upper, lower = figure.axes
    # Terms that are zero throughout are left out.
    assert legend_texts(figure) == ["external work", "elastic", "dissipated by cracking"]
    assert upper.get_ylabel() == "energy (mJ/m)"
    np.testing.assert_allclose(upper.get_lines()[0].get_ydata()[-1], 4.0)
    np.testing.assert_allclose(upper.get_lines()[0].get_xdata()[-1], 1.0)
    assert len({line.get_color() for line in upper.get_lines()[:3]}) == 3
    assert lower.get_yscale() == "log"
    assert lower.get_xlabel() == "strain (%)"
    np.testing.assert_allclose(lower.get_lines()[0].get_ydata()[-1], 1e-9)
    assert not overlap(figure)
    image(tmp_path / "e.png")


def test_closure_is_relative_to_the_largest_work_so_far():
    table = history()
    table["external_work"] = np.where(np.arange(100) < 50, 2.0, 1e-6)
    table["closure"] = np.full(100, -1e-8)
    line = plot_energies(table).axes[1].get_lines()[0]
    np.testing.assert_allclose(line.get_ydata(), 5e-9)


def test_perfect_closure_can_be_drawn(tmp_path):
    table = history()
    table["closure"][:] = 0.0
    plot_energies(table, tmp_path / "e.png")
    image(tmp_path / "e.png")


def test_law(tmp_path):
    opening = np.array([0.0, 0.5e-9, 1.0e-9])
    figure = plot_law(opening, [0.0, 1e9, 0.0], tmp_path / "l.png", title="Zr-Zr")
    (axes,) = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("opening (nm)", "traction (MPa)")
    np.testing.assert_allclose(axes.get_lines()[0].get_xdata(), [0.0, 0.5, 1.0])
    np.testing.assert_allclose(axes.get_lines()[0].get_ydata(), [0.0, 1000.0, 0.0])
    assert legend_texts(figure) == ["area 0.5 J/m$^2$"]
    assert not overlap(figure)
    image(tmp_path / "l.png")
    figure = plot_law(opening, {"normal": opening, "tangential": opening})
    assert legend_texts(figure) == ["normal", "tangential"]


@pytest.mark.slow
def test_a_fine_mesh_is_drawn_in_seconds(tmp_path):
    """56 x 56 crossed quadrilaterals, 12 544 bodies; it takes about half a second."""
    panel = split_panel(56)
    assert len(panel.triangles) == 12_544
    start = time.process_time()
    plot_cracks([panel, panel], path=tmp_path / "c.png")
    assert time.process_time() - start < 5.0


def test_no_global_state():
    """No pyplot, hence no figure that stays in memory, and no changed defaults."""
    program = f"""
import sys
sys.path.insert(0, {str(Path(__file__).parents[2])!r})
from xper_fx.plotting.figures import plot_curves
assert "matplotlib" not in sys.modules, "imported before it is needed"
from matplotlib import rcParams
before = rcParams.copy()
plot_curves([("a", [0.0, 1.0], [0.0, 1.0])])
assert "matplotlib.pyplot" not in sys.modules, "pyplot"
assert rcParams.copy() == before, "defaults"
"""
    subprocess.run([sys.executable, "-c", program], check=True)


def test_missing_matplotlib_names_the_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ImportError, match=r"xper_fx\[plot\]"):
        plot_curves([("a", np.arange(3.0), np.arange(3.0))])


def test_wrong_shapes_are_refused():
    points, triangles, material = crossed_square(3)
    panel = split_panel()
    with pytest.raises(ValueError, match="Points should"):
        plot_microstructure(points[:, :1], triangles, material, [])
    with pytest.raises(ValueError, match="Triangles should"):
        plot_microstructure(points, triangles[:, :2], material, [])
    with pytest.raises(ValueError, match=r"\(36,\)"):
        plot_microstructure(points, triangles, material[:-1], [])
    for field, values, match in (
        ("displacement", np.zeros((3, 2)), "Displacement should"),
        ("crack_kind", [0], "Crack segments should"),
        ("crack_kind", [0, 1, 2, 3, 0, 0], "kinds should"),
    ):
        with pytest.raises(ValueError, match=match):
            plot_cracks(CrackPanel(**{**vars(panel), field: values}))
    with pytest.raises(ValueError, match="at least one"):
        plot_cracks([])
    with pytest.raises(ValueError, match="'weak'"):
        plot_curves([("weak", np.zeros(3), np.zeros(4))])
    with pytest.raises(ValueError, match="closure"):
        plot_energies({k: v for k, v in history().items() if k != "closure"})
    with pytest.raises(ValueError, match="tractions as openings"):
        plot_law(np.zeros(3), np.zeros(4))


@pytest.mark.slow
def test_fragments_are_counted_from_the_largest_and_sieved_from_the_smallest(tmp_path):
    """Of four pieces two are of one size."""
    diameter, mass = np.array([4e-3, 1e-3, 2e-3, 2e-3]), np.array([16.0, 1.0, 4.0, 3.0])
    figure = plot_fragments(
        {"plate": (diameter, mass)}, tmp_path / "sizes.png", length_unit=("mm", 1e-3), classes=5
    )
    counted, sieved = figure.axes
    assert counted.get_xscale() == counted.get_yscale() == sieved.get_xscale() == "log"
    (number,) = counted.lines
    # steps: all four at 1 mm, three from there to 2 mm, one from there to 4 mm, then none
    assert number.get_xdata() == pytest.approx([1.0, 2.0, 4.0, 4.0])
    assert number.get_ydata() == pytest.approx([4.0, 3.0, 1.0, 0.5])
    assert number.get_drawstyle() == "steps-pre"
    (passing,) = sieved.lines
    assert passing.get_xdata()[1:-1] == pytest.approx([1.0, 2.0, 2.0, 4.0])
    assert passing.get_ydata() == pytest.approx(np.array([0, 1, 5, 8, 24, 24]) / 24)
    (classes,) = sieved.patches
    share, edges, _ = classes.get_data()
    assert share.sum() == pytest.approx(1.0)
    assert edges[1:] / edges[:-1] == pytest.approx((edges[-1] / edges[0]) ** (1 / 5))
    for size, part in ((1.0, 1 / 24), (2.0, 7 / 24), (4.0, 16 / 24)):
        assert share[np.searchsorted(edges, size) - 1] == pytest.approx(part)
    assert imread(tmp_path / "sizes.png")[..., :3].std() > 0.05
