# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures and animations hold the bodies where they are, with the quantities that they name."""

from __future__ import annotations

import stat

import numpy as np
import pytest
from cells import cell_of
from dolfinx.mesh import CellType, create_box
from mpi4py import MPI

import xper_fx as xf

pytest.importorskip("matplotlib")
import matplotlib
from matplotlib.collections import LineCollection, PolyCollection
from PIL import Image

GRAVITY = 10.0


def plane_scene():
    """A disc on a floor, a square in flight that spins."""
    return xf.Scene(
        rigid=[
            xf.rigid.wall((0.0, 0.0), (0.0, 1.0), "floor"),
            xf.RigidBody(xf.rigid.Disc(0.5), (0.0, 0.5), "discs", density=1.0, angle=0.3),
            xf.RigidBody(
                xf.rigid.Polygon.box((1.0, 2.0)), (3.0, 6.0), "squares", density=1.0,
                velocity=(3.0, 0.0), spin=2.0,
            ),
        ],
        contacts=[
            xf.Contact(("discs", "floor"), xf.laws.SignoriniCoulomb()),
            xf.Contact(("squares", "floor"), None),
            xf.Contact(("squares", "discs"), None),
        ],
        loads=[xf.Gravity((0.0, -GRAVITY))],
    )  # fmt: skip


def stepped(scene, end, step=0.01, **options):
    simulation = xf.Simulation(scene, step, num_threads=1, **options)
    for _ in simulation.steps(end):
        pass
    return simulation


@pytest.fixture(scope="module")
def flight():
    return stepped(plane_scene(), 0.4)


def test_colours_are_the_quantities_they_name(flight):
    size = 2.0 * np.sqrt(2.0 / np.pi)  # of a disc as large as the square
    for colour, exact in {
        "group": [1, 2],
        "speed": [0.0, 5.0],
        "spin": [0.0, 2.0],
        "rotation": [0.0, 0.8],
        "coordination": [1, 0],
        "size": [1.0, size],
    }.items():
        frame = xf.output.take_frame(flight, colour)
        np.testing.assert_allclose(frame.values, exact, atol=1e-12, err_msg=colour)
    frame = xf.output.take_frame(flight, "group")
    assert (frame.label, frame.names[2], frame.title) == (None, "squares", "0.4 s")
    own = xf.output.take_frame(flight, lambda s: [9.0, np.nan, s.time])
    np.testing.assert_array_equal(own.values, [np.nan, flight.time])


def test_a_frame_holds_bodies_marks_and_chains(flight):
    frame = xf.output.take_frame(flight)
    disc, square = frame.faces
    assert len(frame.walls) == 1 and frame.walls[0][:, 1].max() == 0.0
    np.testing.assert_allclose(np.linalg.norm(disc - [0.0, 0.5], axis=1), 0.5)
    rim = [0.5 * np.cos(0.3), 0.5 + 0.5 * np.sin(0.3)]
    np.testing.assert_allclose(frame.marks, [[[0.0, 0.5], rim]])
    c, s = np.cos(0.8), np.sin(0.8)
    centre = np.array([3.0 + 3.0 * 0.4, 6.0 - 0.5 * GRAVITY * 0.4**2])
    corners = np.array([[-0.5, -1.0], [0.5, -1.0], [0.5, 1.0], [-0.5, 1.0]])
    np.testing.assert_allclose(square, centre + corners @ np.array([[c, s], [-s, c]]), atol=1e-12)
    # the disc presses with its weight; the wall has no middle that a chain could go to
    np.testing.assert_allclose(frame.chains, [[[0.0, 0.0], [0.0, 0.5]]], atol=1e-9)
    np.testing.assert_allclose(frame.forces, [GRAVITY * np.pi / 4.0], rtol=1e-6)


def closed_volume(faces):
    """By the divergence theorem: of faces that are counter-clockwise seen from outside."""
    fans = [(f[0], f[i], f[i + 1]) for f in faces for i in range(1, len(f) - 1)]
    return sum(np.linalg.det(fan) for fan in fans) / 6.0


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_faces_in_space_look_outwards(cell):
    """Those of a mesh without its inner sides; of a sphere and of a block that has turned."""
    mesh = create_box(MPI.COMM_SELF, [[0.0] * 3, [1.0] * 3], [2, 2, 2], getattr(CellType, cell))
    cells = mesh.topology.index_map(3).size_local
    scene = xf.Scene(
        xf.explode(mesh, np.zeros(cells, int)),
        {1: xf.materials.LinearElastic(young=1e6, poisson=0.3, density=1.0)},
        rigid=[
            xf.RigidBody(xf.rigid.Sphere(1.0), (4.0, 0.0, 5.0), "any", density=1.0),
            xf.RigidBody(
                xf.rigid.Polyhedron.box((1.0, 2.0, 3.0)), (9.0, 0.0, 5.0), "any", density=1.0,
                rotation=(0.1, 0.2, 0.3, 0.9),
            ),
            xf.rigid.wall((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), "floor"),
        ],
        contacts=[xf.Contact(("any", "any"), None), xf.Contact(("any", "floor"), None)],
    )  # fmt: skip
    frame = xf.output.take_frame(xf.Simulation(scene, 1e-4), "group")
    of_mesh = [face for face, value in zip(frame.faces, frame.values, strict=True) if value == 2]
    assert len(of_mesh) == (24 if cell == "hexahedron" else 48)
    assert closed_volume(of_mesh) == pytest.approx(1.0)
    assert closed_volume(frame.faces[-6:]) == pytest.approx(6.0)
    of_sphere = frame.faces[len(of_mesh) : -6]
    assert 0.8 < closed_volume(of_sphere) / (4.0 / 3.0 * np.pi) < 1.0
    assert all((wall[:, 2] == 0.0).all() for wall in frame.walls)

    # of each body the half that faces the viewer is drawn, and the floor if it is seen from above
    for height, floors in (30.0, 2), (-30.0, 0):
        figure = xf.output.plot_frames([frame], view=(height, -60.0))
        floor, faces = figure.axes[0].collections
        figure.draw_without_rendering()
        assert len(floor.get_paths()) == floors
        assert len(faces.get_paths()) == pytest.approx(0.5 * len(frame.faces), rel=0.05)


def test_a_figure_shows_the_frame(flight, tmp_path):
    figure = xf.output.plot_bodies(
        flight, "speed", tmp_path / "now.png", chains=True, limits=(0.0, 10.0)
    )
    axes = figure.axes[0]
    walls, faces = (c for c in axes.collections if isinstance(c, PolyCollection))
    marks, chains = (c for c in axes.collections if isinstance(c, LineCollection))
    frame = xf.output.take_frame(flight)
    np.testing.assert_allclose(faces.get_paths()[1].vertices[:4], frame.faces[1])
    viridis = matplotlib.colormaps["viridis"]
    np.testing.assert_allclose(faces.get_facecolors(), viridis([0.0, 0.5]), atol=0.01)
    assert [len(c.get_paths()) for c in (walls, marks, chains)] == [1, 1, 1]
    assert figure.axes[1].get_ylabel() == "speed (m/s)"
    left, right = axes.get_xlim()
    assert left < -0.5 and right > frame.faces[1][:, 0].max()
    assert (tmp_path / "now.png").stat().st_size > 5000


def coloured(image, colour):
    """Middle of the pixels of about a colour, (x, y), and their number."""
    pixels = np.asarray(image.convert("RGB"), float) / 255.0
    near = np.abs(pixels - matplotlib.colors.to_rgb(colour)).max(axis=2) < 0.05
    return np.argwhere(near).mean(axis=0)[::-1], near.sum()


def test_a_gif_shows_bodies_fly(tmp_path):
    """The square moves by pixels as it does by metres, the disc stays where it is, and nothing is
    left where the square was; the file can be read before it is closed."""
    simulation = xf.Simulation(plane_scene(), 0.01, num_threads=1)
    window = (-1.0, 7.0, -0.5, 7.5)
    path = tmp_path / "flight.gif"
    film = xf.output.Animation(path, simulation, every=0.1, window=window, pixels=300, rate=20)
    with film:
        for number, _ in enumerate(simulation.steps(0.6)):
            film.record()
            assert len(film._figure.axes[0].collections) == 3
            if number == 30:
                with Image.open(path) as part:
                    assert part.n_frames == film.frames == 4
    with Image.open(path) as gif:
        assert (gif.n_frames, gif.info["duration"], gif.info["loop"], gif.width) == (7, 50, 0, 300)
        disc, square = (matplotlib.colormaps["tab20"](kind) for kind in (1, 2))
        places = []
        for frame in range(7):
            gif.seek(frame)
            (rest, _), (place, pixels) = coloured(gif, disc), coloured(gif, square)
            places.append(place)
            if frame == 0:
                first, many = rest, pixels
            assert np.abs(rest - first).max() < 0.5 and abs(pixels - many) < 0.05 * many
    moved = np.array(places) - places[0]
    time = 0.1 * np.arange(7)
    scale = moved[-1, 0] / (3.0 * 0.6)
    assert 20.0 < scale < 40.0
    np.testing.assert_allclose(moved[:, 0], scale * 3.0 * time, atol=1.5)
    np.testing.assert_allclose(moved[:, 1], scale * 0.5 * GRAVITY * time**2, atol=1.5)


@pytest.mark.slow
def test_a_film_changes_nothing_in_the_run(flight, tmp_path):
    filmed = xf.Simulation(plane_scene(), 0.01, num_threads=1)
    film = xf.output.Animation(
        tmp_path / "a.gif", filmed, "coordination", every=0.05, limits=(0, 6)
    )
    with film:
        for _ in filmed.steps(0.4):
            film.record()
    assert film.frames == 9
    for name in ("position", "velocity"):
        np.testing.assert_array_equal(
            getattr(filmed.rigid.state, name), getattr(flight.rigid.state, name)
        )


def test_an_mp4_is_what_ffmpeg_is_given(tmp_path, monkeypatch):
    """Without the program an error says so; with one, every frame goes through its pipe."""
    simulation = xf.Simulation(plane_scene(), 0.01, num_threads=1)
    film = {"simulation": simulation, "every": 0.05, "pixels": 200}
    monkeypatch.setitem(matplotlib.rcParams, "animation.ffmpeg_path", str(tmp_path / "ffmpeg"))
    with pytest.raises(ValueError, match="needs the program ffmpeg"):
        xf.output.Animation(tmp_path / "a.mp4", **film)
    assert not (tmp_path / "a.mp4").exists()
    # in its place a program that keeps what it is sent, in the file named last
    (tmp_path / "ffmpeg").write_text('#!/bin/sh\nfor last; do :; done\ncat > "$last"\n')
    (tmp_path / "ffmpeg").chmod(stat.S_IRWXU)
    with xf.output.Animation(tmp_path / "a.mp4", **film) as made:
        for _ in simulation.steps(0.2):
            made.record()
    with pytest.raises(ValueError, match="is closed"):
        made.record()
    width, height = made._writer.frame_size
    assert made.frames == 5 and (width % 2, height % 2) == (0, 0)
    assert (tmp_path / "a.mp4").stat().st_size == 5 * 4 * width * height


def test_a_film_of_which_nobody_took_frames(tmp_path, caplog):
    simulation = xf.Simulation(plane_scene(), 0.01, num_threads=1)
    with xf.output.Animation(tmp_path / "a.gif", simulation, every=0.05):
        for _ in simulation.steps(0.02):
            pass
    assert "call record() after each step" in caplog.text


def test_a_periodic_cell_is_drawn():
    """A run has more unknowns than its nodes have: the gradient."""
    bodies = cell_of((1, 1), (4, 2), "quadrilateral", label=lambda x: x[0] > 0.5)
    scene = xf.Scene(
        bodies, {1: xf.materials.LinearElastic(100.0, 0.3, 10.0)},
        default_interaction=xf.laws.CohesiveZone(2e3, 0.05, 1.0),
        macroscopic=xf.MacroscopicDrive({"12": 0.0, "21": 0.0, "22": 1.0}, rate={"11": 0.1}),
    )  # fmt: skip
    simulation = xf.Simulation(scene, 0.02)
    next(simulation.steps(0.02))
    assert len(xf.output.take_frame(simulation).faces) == 8
