# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files of scenes with rigid bodies, with a mesh and without, and forces of their contacts."""

import json

import meshio
import numpy as np
import pytest
from scenes import box_bodies

from xper_fx.forms.loads import Gravity
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import SignoriniCoulomb
from xper_fx.nscd.rigid import Disc, Polygon, Polyhedron, RigidBody, Sphere, wall
from xper_fx.output.contact_forces import find_contact_forces
from xper_fx.output.history import read_history
from xper_fx.output.recorder import Recorder
from xper_fx.scene.contact import Contact
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

GRAVITY = 10.0


def read(path):
    """Points, cells and all times of a series."""
    with meshio.xdmf.TimeSeriesReader(path) as reader:
        points, cells = reader.read_points_cells()
        times = [reader.read_data(k) for k in range(reader.num_steps)]
        # of a cell field meshio gives a list with one array a kind of cell
        times = [(t, nodal, {name: a[0] for name, a in own.items()}) for t, nodal, own in times]
        return points, cells[0].data, times


def test_thrown_rigid_bodies_on_disk(tmp_path):
    # a disc that rests on a floor, a square that flies and spins
    square = RigidBody(
        Polygon.box((2.0, 2.0)), (10.0, 5.0), "flying", density=1.0, velocity=(3.0, 0.0), spin=2.0
    )
    scene = Scene(
        rigid=[
            wall((0.0, 0.0), (0.0, 1.0), "floor"),
            RigidBody(Disc(1.0), (0.0, 1.0), "resting", density=1.0),
            square,
            wall((-9.0, 0.0), (1.0, 0.0), "floor"),
        ],
        contacts=[
            Contact(("resting", "floor"), SignoriniCoulomb()),
            Contact(("flying", "floor"), None),
            Contact(("flying", "resting"), None),
        ],
        loads=[Gravity((0.0, -GRAVITY))],
    )
    simulation = Simulation(scene, 0.01, num_threads=1)
    with Recorder(simulation, tmp_path, end_time=0.1, fields=2) as recorder:
        for step in simulation.steps(0.1):
            recorder.record(step)
        assert recorder.written == sum(
            (tmp_path / name).stat().st_size for name in ("history.csv", "rigid.xdmf", "rigid.h5")
        )
    assert not (tmp_path / "bulk.xdmf").exists()
    assert len(read_history(tmp_path / "history.csv")["time"]) == 10
    counts = json.loads((tmp_path / "summary.json").read_text())["counts"]
    assert (counts["bodies"], counts["rigid_bodies"]) == (0, 4)

    points, triangles, times = read(tmp_path / "rigid.xdmf")
    assert [time for time, *_ in times] == pytest.approx([0.0, 0.05, 0.1])
    _, nodal, cellwise = times[2]
    body = cellwise["body"]
    assert np.array_equal(np.unique(body), [0, 1, 2, 3])
    assert np.array_equal(cellwise["group"], np.array([0, 1, 2, 0])[body.astype(int)])
    assert np.array_equal(np.unique(cellwise["spin"][body == 2]), [2.0])
    assert cellwise["rotation"][body == 2] == pytest.approx(0.2)
    size = {0: np.nan, 1: 2.0, 2: 4.0 / np.sqrt(np.pi), 3: np.nan}
    expected = [size[number] for number in body.astype(int)]
    assert cellwise["diameter"] == pytest.approx(expected, nan_ok=True)
    # the two halves of the square that turns, each as large, on the sides of its own axis
    now = points[:, :2] + nodal["displacement"][:, :2]
    turned = now[triangles[body == 2]].mean(axis=1) - (10.3, 5.0 - 0.5 * GRAVITY * 0.1**2)
    side = turned @ [np.cos(0.2), np.sin(0.2)] > 0.0
    assert np.array_equal(cellwise["half"][body == 2], side)
    assert cellwise["half"][body == 1].mean() == 0.5
    own = np.unique(triangles[body == 2])
    arm = points[own, :2] - (10.0, 5.0)
    assert np.abs(arm) == pytest.approx(1.0)
    c, s = np.cos(0.2), np.sin(0.2)
    turned = arm @ np.array([[c, s], [-s, c]])
    moved = turned - arm + (0.3, -0.5 * GRAVITY * 0.1**2)
    assert nodal["displacement"][own, :2] == pytest.approx(moved, abs=1e-12)
    velocity = 2.0 * turned @ np.array([[0.0, 1.0], [-1.0, 0.0]]) + (3.0, -GRAVITY * 0.1)
    assert nodal["velocity"][own, :2] == pytest.approx(velocity, abs=1e-12)
    still = np.unique(triangles[body == 0])
    assert np.abs(nodal["displacement"][still]).max() == 0.0


def test_spinning_sphere_and_box_on_disk(tmp_path):
    spin = np.array([0.0, 0.0, 3.0])
    bodies = [
        RigidBody(
            shape, (4.0 * k, 0.0, 0.0), "any", density=1.0, spin=spin,
            rotation=(0.0, 0.0, np.sin(0.05), np.cos(0.05)),
        )
        for k, shape in enumerate((Sphere(1.0), Polyhedron.box((1.0, 1.0, 1.0))))
    ]  # fmt: skip
    simulation = Simulation(Scene(rigid=bodies, contacts=[Contact(("any",) * 2, None)]), 0.1)
    with Recorder(simulation, tmp_path, end_time=0.2, fields=1) as recorder:
        for step in simulation.steps(0.2):
            recorder.record(step)
    points, triangles, times = read(tmp_path / "rigid.xdmf")
    _, nodal, cellwise = times[-1]
    assert cellwise["spin"] == pytest.approx(np.tile(spin, (len(triangles), 1)))
    # as the bodies were turned at the start, and 0.2 s of spin
    turned = cellwise["rotation"]
    assert turned == pytest.approx(np.tile(0.2 * spin + [0.0, 0.0, 0.1], (len(triangles), 1)))
    assert 0.4 < cellwise["half"].mean() < 0.6
    now = points + nodal["displacement"]
    owner = np.zeros(len(points))
    owner[triangles] = cellwise["body"][:, None]
    arm = now - np.column_stack([4.0 * owner, 0.0 * owner, 0.0 * owner])
    assert nodal["velocity"] == pytest.approx(np.cross(spin, arm), abs=1e-12)
    assert np.linalg.norm(nodal["displacement"], axis=1).max() > 0.1


def test_weight_on_a_mesh_and_on_a_disc(tmp_path):
    # a block that is meshed lies on the floor, beside it a rigid disc
    law = SignoriniCoulomb(friction=0.3)
    scene = Scene(
        box_bodies((1.0, 1.0), (2, 2), label=0),
        {1: LinearElastic(young=1e4, poisson=0.2, density=2.0)},
        surfaces={"block": (1,)},
        rigid=[
            wall((0.0, 0.0), (0.0, 1.0), "floor"),
            RigidBody(Disc(0.5), (3.0, 0.5), "disc", mass=4.0),
        ],
        contacts=[
            Contact(("block", "floor"), law),
            Contact(("floor", "disc"), law),
            Contact(("block", "disc"), None),
        ],
        loads=[Gravity((0.0, -GRAVITY))],
    )
    simulation = Simulation(scene, 0.05, theta=1.0, tolerance=1e-8, num_threads=1)
    with Recorder(simulation, tmp_path, end_time=2.0, fields=1) as recorder:
        for step in simulation.steps(2.0):
            recorder.record(step)
    assert (tmp_path / "bulk.xdmf").exists() and (tmp_path / "rigid.xdmf").exists()
    contacts = find_contact_forces(simulation)
    # bodies: the block 0, the floor 1, the disc 2; a force acts on the candidate
    on_floor = np.zeros((3, 2))
    for (candidate, antagonist), force in zip(contacts.bodies, contacts.force, strict=True):
        assert 1 in (candidate, antagonist)
        other, sign = (antagonist, 1.0) if candidate == 1 else (candidate, -1.0)
        on_floor[other] += sign * force
    assert on_floor[0] == pytest.approx([0.0, -2.0 * GRAVITY], abs=1e-3)
    assert on_floor[2] == pytest.approx([0.0, -4.0 * GRAVITY], abs=1e-3)
    assert np.abs(contacts.position[:, 1]).max() < 0.01
    disc = np.any(contacts.bodies == 2, axis=1)
    assert contacts.position[disc] == pytest.approx(np.array([[3.0, 0.0]]), abs=0.01)
    assert np.abs(contacts.normal[:, 1]) == pytest.approx(1.0)
