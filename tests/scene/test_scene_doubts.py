# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is doubted about scenes that may be meant, and that sound scenes are left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from misused_scenes import TOUCH, blocks, disc, near_block, of_block, of_discs, of_plate
from scenes import BOTTOM

import xper_fx as xf
from xper_fx.scene.scene_doubts import scene_doubts

FLOOR = xf.rigid.wall((0.0, -1.0), (0.0, 1.0), "floor")
SWAPPED = xf.laws.MixedMode(1e12, (1.0, 2.0), (1e4, 2e4), 2.0)
ROOF = xf.rigid.wall((0.0, 9.0), (0.0, -1.0), "roof")


def doubts(scene, step=1e-5):
    return list(scene_doubts(scene, step))


def walled(point, normal):
    return of_block(walls=[xf.Wall(BOTTOM, point, normal, TOUCH)])


def bonded(stiffness):
    return of_plate(default_interaction=xf.laws.CohesiveZone(stiffness, 1e4, 1e5))


def of_material(young, density):
    return of_block(materials={1: xf.materials.LinearElastic(young, 0.3, density)})


ON_FLOOR = [("discs", "floor")]


def in_cell(*speeds):
    """Discs in a cell that is sheared, each with a velocity along x."""
    drive = xf.MacroscopicDrive(rate={"12": 1.0}, gradient={"11": 1.0, "21": 0.0, "22": 1.0})
    discs = [disc((3.0 * i, 0.0), velocity=(speed, 0.0)) for i, speed in enumerate(speeds)]
    return of_discs(*discs, lattice=(9.0, 9.0), macroscopic=drive)


@pytest.mark.parametrize(
    "scene",
    [
        lambda: of_discs(disc(), FLOOR, ROOF, pairs=[*ON_FLOOR, ("discs", "roof")]),
        lambda: of_discs(disc(), disc((3.0, 0.0)), FLOOR, pairs=[*ON_FLOOR, ("discs", "discs")]),
        lambda: of_discs(disc(angle=6.2), FLOOR, pairs=ON_FLOOR),
        lambda: walled((0.0, 0.0), (0.0, 1.0)),
        lambda: walled((0.0, -0.5), (0.1, 3.0)),
        lambda: walled((0.0, 1e-6), (0.0, 1.0)),
        lambda: bonded(1e12),
        lambda: of_plate(default_interaction=xf.laws.RigidCohesiveZone(1e4, 1e4)),
        lambda: near_block(1.3),
        lambda: in_cell(0.3, -0.3),
        lambda: blocks(1.0),
        lambda: of_material(2.1e5, 7.8e-9),  # steel in N, mm, t
        of_plate,
    ],
)
def test_sound_scenes_are_left_alone(scene):
    assert doubts(scene()) == []


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        (lambda: of_discs(disc(angle=45.0), FLOOR, pairs=ON_FLOOR), "rigid body 0 is 45 rad"),
        (lambda: walled((0.0, 0.0), (0.0, -1.0)), "tag 3 look along the normal (0.0, -1.0)"),
        (lambda: walled((0.0, 0.25), (0.0, 2.0)), "tag 3 lie up to 0.25 m inside"),
        (lambda: bonded(1e7), "1e+07 Pa/m of a cohesive law is soft"),
        (lambda: of_plate(default_interaction=SWAPPED), "1 Pa and 1e+04 J/m^2 would open by 1e+04"),
        (lambda: of_material(1e11, 7.8e-9), "3.6e+09 m/s"),
        (lambda: of_material(1.0, 1e-3), "step of 1e-12 s is short beside the 0.0316 s"),
        (lambda: in_cell(0.3, 0.1), "mean velocity [0.2, 0.0] m/s"),
        (lambda: near_block(0.5), "rigid body 0 lies in the meshed body 0"),
        (lambda: blocks(0.9), "meshed bodies 0 and 1 overlap at [0."),
    ],
)
def test_each_doubt_is_one_sentence(scene, words):
    (told,) = doubts(scene(), 1e-12 if "1e-12" in words else 1e-5)
    parts = words.split(" .* ")
    assert all(part in told for part in parts), told


def test_doubts_are_told_once_before_the_first_step(caplog):
    simulation = xf.Simulation(walled((0.0, 0.0), (0.0, -1.0)), 1e-5, num_threads=1)
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    list(simulation.steps(3e-5))
    assert len(caplog.records) == 1


def test_a_scene_keeps_what_it_was_given():
    """Lists and mappings are its own; attributes are not set."""
    solid = xf.materials.LinearElastic(1e9, 0.3, 1e3)
    materials, loads = {1: solid}, [xf.Gravity((0.0, -1.0))]
    scene = of_block(materials=materials, loads=loads)
    materials[1] = None
    loads.append(3.0)
    assert scene.materials == {1: solid} and len(scene.loads) == 1
    with pytest.raises(AttributeError, match=r"does not change.*replace\(scene, loads"):
        scene.loads = []
    assert np.array_equal(replace(scene, loads=[]).bodies.labels, scene.bodies.labels)
