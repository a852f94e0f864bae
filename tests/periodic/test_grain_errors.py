# SPDX-License-Identifier: LGPL-3.0-or-later
"""Periodic scenes of rigid bodies that are refused, each with what to do."""

import numpy as np
import pytest

from xper_fx.bodies.explode import explode
from xper_fx.bodies.meshes import crossed_rectangle
from xper_fx.forms.loads import Gravity
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import SignoriniCoulomb
from xper_fx.nscd.rigid import Disc, HalfPlane, RigidBody
from xper_fx.periodic.drive import MacroscopicDrive
from xper_fx.scene.contact import Contact
from xper_fx.scene.joints import Hinge
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

HELD = MacroscopicDrive(gradient={"11": 1.0, "12": 0.0, "21": 0.0, "22": 1.0})
HUNG = RigidBody(Disc(0.5), (0.2, 2.0), "g", density=1.0)
PRESSED = MacroscopicDrive(gradient={"12": 0.0, "21": 0.0}, stress={"11": -1.0, "22": -1.0})


def scene(lattice, drive=None, other=None, loads=(), joints=(), **of_disc):
    bodies = [RigidBody(Disc(0.5), (0.2, 0.6), "g", **({"density": 1.0} | of_disc))]
    bodies.append(RigidBody(Disc(0.5), (1.3, 0.6), "g", density=1.0))
    bodies += [] if other is None else [other]
    groups = {body.group for body in bodies}
    contacts = [Contact(("g", group), SignoriniCoulomb()) for group in sorted(groups)]
    return Scene(
        rigid=bodies, lattice=lattice, macroscopic=drive, contacts=contacts, loads=loads,
        joints=joints,
    )  # fmt: skip


def wall(angle=0.0):
    return RigidBody(HalfPlane(), (0.0, 0.0), "wall", angle=angle)


@pytest.mark.fast
@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"lattice": (3.0,)}, "2 edges of a box or 2 period vectors"),
        ({"lattice": "box"}, "lattice should"),
        ({"lattice": (3.0, "4")}, "lattice should"),
        ({"lattice": [[0.0, 0.0]]}, "span no volume"),
        ({"lattice": [[3.0, np.inf]]}, "finite"),
        ({"lattice": (None, None)}, "no period in any direction"),
        ({"lattice": (-3.0, 4.0)}, "positive lengths"),
        ({"lattice": (np.nan, 4.0)}, "finite"),
        ({"lattice": [[3.0, 0.0], [6.0, 0.0]]}, "span no volume"),
        ({"lattice": None, "drive": HELD}, "give its `lattice` to the scene"),
        ({"lattice": (3.0, None), "drive": HELD}, "A cell that deforms has 2 periods"),
        ({"lattice": (3.0, 4.0), "drive": "shear"}, "expected a MacroscopicDrive"),
        (
            {"lattice": (3.0, 4.0), "drive": MacroscopicDrive(rate={"11": 1.0})},
            r"Components \['12', '21', '22'\] are not given",
        ),
        (
            {
                "lattice": (3.0, 4.0),
                "drive": MacroscopicDrive(
                    gradient={"11": lambda t: 1.0 + t, "12": 0.0, "21": 0.0, "22": 1.0}
                ),
            },
            "F11 of a cell of rigid bodies is held at 1",
        ),
        (
            {"lattice": (3.0, 4.0), "drive": HELD, "loads": [Gravity((0.0, -1.0))]},
            "driven by `macroscopic` alone, and the scene has gravity",
        ),
        (
            {"lattice": (3.0, 4.0), "drive": HELD, "force": (0.0, 1.0)},
            "a force on rigid body 0",
        ),
        (
            {"lattice": (3.0, 4.0), "drive": HELD, "prescribed": {0: 0.0}},
            "translation of rigid body 0 is prescribed",
        ),
        ({"lattice": (3.0, 4.0), "other": wall()}, "wall across the period"),
        ({"lattice": (3.0, None), "other": wall(0.1)}, "wall across the period"),
        ({"lattice": (1.6, None)}, "overlap at the start: 0 and 1 by 0.5 m"),
        ({"lattice": (0.9, None)}, "touches its own image"),
        ({"lattice": (3.0, 4.0), "joints": [Hinge((None, HUNG), (0.0, 0.0))]}, "has no `joints`"),
    ],
)  # fmt: skip
def test_what_is_refused(arguments, told):
    with pytest.raises((ValueError, TypeError), match=told):
        scene(**arguments)


@pytest.mark.fast
def test_lattices_of_meshes_are_given_to_them():
    bodies = explode(crossed_rectangle((0, 0), (1, 1), (1, 1)))
    material = LinearElastic(young=1.0, poisson=0.2, density=1.0)
    with pytest.raises(ValueError, match="give that of a mesh to `explode`"):
        Scene(bodies, {1: material}, default_interaction=SignoriniCoulomb(), lattice=(1.0, 1.0))


@pytest.mark.fast
def test_a_cell_that_shrinks_onto_its_bodies_is_told_and_no_step_is_kept():
    """Both discs are wedged between images while Fbar goes on: that has no solution."""
    drive = MacroscopicDrive(rate={"11": -0.5}, gradient={"12": 0.0, "21": 0.0, "22": 1.0})
    simulation = Simulation(scene((2.4, 4.0), drive), 0.05, max_sweeps=200)
    with pytest.raises((RuntimeError, ValueError), match="converge|own image"):
        for _ in simulation.steps(2.0):
            pass
    assert simulation.macroscopic.gradient[0, 0] > 0.5


@pytest.mark.fast
def test_a_cell_that_would_turn_inside_out_is_not_stepped():
    """A gas without contacts, pressed by far more than it bears: the step is cut, and given up."""
    simulation = Simulation(scene((40.0, 40.0), PRESSED), 100.0, max_halvings=1)
    with pytest.raises(RuntimeError, match="did not converge"):
        for _ in simulation.steps(1e4):
            pass
    assert np.linalg.det(simulation.macroscopic.gradient) > 0.0
