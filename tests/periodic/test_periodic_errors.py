# SPDX-License-Identifier: LGPL-3.0-or-later
"""Periodic cells: what is refused, and that the message says what was given and what to do."""

from __future__ import annotations

import numpy as np
import pytest
from cells import VOID, cell_of
from scenes import LEFT, TOP, box_bodies, mesh_of

from xper_fx.bodies.explode import explode
from xper_fx.forms.loads import (
    BodyForce,
    Gravity,
    PrescribedDisplacement,
    PrescribedVelocity,
    RayleighDamping,
    SurfaceTraction,
)
from xper_fx.materials import LinearElastic, NeoHookean
from xper_fx.nscd.laws import CohesiveZone, PerfectBond, SignoriniCoulomb
from xper_fx.periodic.drive import MacroscopicDrive
from xper_fx.scene import Scene, Wall
from xper_fx.simulation.simulation import Simulation

SOLID = LinearElastic(100.0, 0.3, 1.0)
LAW = CohesiveZone(100.0, 1.0, 5.0)
NAN, INF = float("nan"), float("inf")
STILL = {"11": 1.0, "12": 0.0, "21": 0.0, "22": 1.0}
DRIVE = MacroscopicDrive(gradient=STILL)


@pytest.fixture(scope="module")
def cell():
    """A body."""
    return cell_of((2, 1), (2, 1))


@pytest.fixture(scope="module")
def cells():
    """Each cell a body."""
    return cell_of((2, 1), (2, 1), label=None)


def scene_of(bodies, drive=DRIVE, **changes):
    arguments = {"materials": {1: SOLID}, "macroscopic": drive}
    if bodies.num_bodies > 1:
        arguments["default_interaction"] = LAW
    return Scene(bodies, **(arguments | changes))


def less(*names, **more):
    return {n: v for n, v in STILL.items() if n not in names} | more


# The drive


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"gradient": {"11": 1.0}, "stress": {"11": 0.0}}, "11 is given more than once.*`stress`"),
        ({"gradient": {"12": 0.0}, "rate": {"12": 0.0}}, "12 is given more than once.*`rate`"),
        ({"rate": {"22": 0.0}, "stress": {"22": 0.0}}, "22 is given more than once"),
        ({"gradient": {"xx": 1.0}}, "no component 'xx'.*\"11\""),
        ({"stress": {"1": 1.0}}, "no component '1'"),
        ({"stress": {"14": 1.0}}, "no component '14'"),
        ({"rate": {"111": 1.0}}, "no component '111'"),
        ({"gradient": {11: 1.0}}, "no component 11"),
    ],
)
def test_components_that_do_not_exist_or_come_twice(arguments, message):
    with pytest.raises(ValueError, match=message):
        MacroscopicDrive(**arguments)


@pytest.mark.parametrize(
    "drive, message",
    [
        ({"gradient": less("22")}, r"\['22'\] are not given.*gradient.*stress"),
        ({"gradient": {}}, r"\['11', '12', '21', '22'\] are not given"),
        ({"gradient": STILL | {"33": 1.0}}, r"\['33'\] do not exist in 2D"),
        (
            {"gradient": less("12", "21"), "stress": {"12": 0.0, "21": 0.0}},
            r"P12 and P21 are both given.*spin F12 - F21 is free.*gradient=\{\"21\": 0\.0\}",
        ),
        ({"stress": dict.fromkeys(STILL, 0.0)}, "P12 and P21 are both given"),
        ({"gradient": less("11") | {"11": lambda t: 1.1 + t}}, "F11 is 1.1 at the start.*1.0"),
        (
            {"gradient": less("11") | {"11": lambda t: t}},
            "F11 is 0.0; `gradient` holds Fbar, which is 1 at rest",
        ),
        ({"gradient": less("12") | {"12": lambda t: 1.0 + t}}, "F12 is 1.0 at the start"),
    ],
)
def test_drives_that_do_not_fit_the_cell(cell, drive, message):
    with pytest.raises(ValueError, match=message):
        scene_of(cell, MacroscopicDrive(**drive))


@pytest.mark.parametrize("part", ("gradient", "rate", "stress"))
@pytest.mark.parametrize("value", (NAN, INF, lambda t: NAN))
def test_values_that_are_not_finite(cell, part, value):
    """Seen before anything is computed, and named."""
    with pytest.raises(ValueError, match="11.*(finite|nan|inf)"):
        scene_of(cell, MacroscopicDrive(**{"gradient": less("11"), part: {"11": value}}
                                        if part != "gradient"
                                        else {"gradient": STILL | {"11": value}}))  # fmt: skip


def test_a_drive_in_space_names_all_that_is_missing():
    bodies = cell_of((1, 1, 1), (1, 1, 1), "hexahedron")
    with pytest.raises(ValueError, match=r"\['13', '23', '31', '32', '33'\] are not given"):
        scene_of(bodies)
    full = dict.fromkeys(("11", "22", "33"), 1.0) | dict.fromkeys(("12", "23", "21"), 0.0)
    with pytest.raises(ValueError, match="P13 and P31 are both given"):
        scene_of(bodies, MacroscopicDrive(gradient=full | {"32": 0.0}, stress={"13": 0, "31": 0}))


# The scene


def test_a_lattice_without_a_drive_and_a_drive_without_a_lattice(cell):
    with pytest.raises(ValueError, match="periodic cell and nothing drives it; give `macroscopic`"):
        Scene(cell, {1: SOLID})
    with pytest.raises(ValueError, match="needs a periodic cell: give the `lattice` to `explode`"):
        Scene(box_bodies((2, 1), (2, 1), label=0), {1: SOLID}, macroscopic=DRIVE)


@pytest.mark.parametrize("drive", ({"11": 1.0}, STILL, 1.0))
def test_what_is_no_drive(cell, drive):
    with pytest.raises(TypeError, match="macroscopic is .*expected a MacroscopicDrive"):
        scene_of(cell, drive)


@pytest.mark.parametrize(
    "changes, name",
    [
        ({"loads": [Gravity((0.0, -9.81))]}, "loads"),
        ({"loads": [BodyForce((0.0, 1.0))]}, "loads"),
        ({"loads": [SurfaceTraction(LEFT, (1.0, 0.0))]}, "loads"),
        ({"loads": [PrescribedVelocity(LEFT, 0, 0.0)]}, "loads"),
        ({"loads": [PrescribedDisplacement(TOP, 1, 0.0)]}, "loads"),
        ({"walls": [Wall(LEFT, (0, 0), (1, 0), SignoriniCoulomb())]}, "walls"),
        ({"damping": RayleighDamping(mass=1.0)}, "damping"),
    ],
)
def test_what_would_act_from_outside(cell, changes, name):
    with pytest.raises(ValueError, match=f"driven by `macroscopic` alone; {name} should be left"):
        scene_of(cell, **changes)


# The run


def test_an_explicit_bulk(cell, cells):
    for bodies in (cell, cells):
        with pytest.raises(ValueError, match='end of the step: take scheme="implicit"'):
            Simulation(scene_of(bodies), 0.1, scheme="explicit")


@pytest.mark.parametrize(
    "options, given",
    [
        ({"step": 0.1, "theta": 0.5}, "theta = 0.5"),
        ({"step": 0.1, "theta": 0.9}, "theta = 0.9"),
        ({"theta": 1.0}, "step = None"),
    ],
)
def test_a_static_run_takes_a_step_and_theta_1(cell, options, given):
    with pytest.raises(
        ValueError, match=f"takes a step or an accuracy, and theta = 1 .*got.*{given}"
    ):
        Simulation(scene_of(cell), inertia=False, **options)


def test_a_static_run_of_bodies_that_bonds_alone_hold(cells):
    """Each cell a body: nothing but impulses holds it, which the monolithic solver alone bears."""
    with pytest.raises(ValueError, match='takes the monolithic solver.*got "nlgs"'):
        Simulation(scene_of(cells), 0.1, theta=1.0, inertia=False, solver="nlgs")


@pytest.mark.parametrize("kind", (LinearElastic, NeoHookean))
def test_nearly_incompressible_with_its_volume_given(cell, kind):
    """nu -> 1/2 and F11, F22 given: the pressure is not determined."""
    rubber = kind(1.0, 0.49995, 1.0)
    pressed = MacroscopicDrive(rate={"11": 0.1}, gradient=less("11"))
    with pytest.raises(ValueError, match=r"F11, F22 are driven.*0\.4999.*Drive one .*`stress`"):
        Simulation(scene_of(cell, pressed, materials={1: rubber}), 0.1)
    # held at rest, the volume does not change
    Simulation(scene_of(cell, materials={1: rubber}), 0.1)
    free = MacroscopicDrive(gradient=less("22"), stress={"22": 0.0})
    Simulation(scene_of(cell, free, materials={1: rubber}), 0.1)
    Simulation(scene_of(cell, materials={1: kind(1.0, 0.49, 1.0)}), 0.1)


def test_nearly_incompressible_in_space():
    bodies = cell_of((1, 1, 1), (1, 1, 1), "hexahedron")
    names = [i + j for i in "123" for j in "123"]
    held = {n: float(n[0] == n[1]) for n in names if n != "11"}
    rubber = {1: NeoHookean(1.0, 0.49999, 1.0)}
    pressed = MacroscopicDrive(gradient=held, rate={"11": 0.1})
    with pytest.raises(ValueError, match="F11, F22, F33 are driven"):
        Simulation(scene_of(bodies, pressed, materials=rubber), 0.1)


# The lattice

MESH = mesh_of((2, 1), (2, 1))


@pytest.mark.parametrize(
    "lattice",
    [
        2.0,
        (2.0,),
        (2.0, 1.0, 1.0),
        [[2.0, 0.0]],
        [[2.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        np.eye(3),
        (2.0, NAN),
        (2.0, INF),
        [[2.0, 0.0], [NAN, 1.0]],
    ],
)
def test_lattices_of_a_wrong_shape(lattice):
    with pytest.raises(ValueError, match="2 edges of a box or 2 period vectors.*got"):
        explode(MESH, lattice=lattice)


@pytest.mark.parametrize("lattice", [(2.0, 0.0), [[2.0, 1.0], [4.0, 2.0]], np.zeros((2, 2))])
def test_lattices_that_span_nothing(lattice):
    with pytest.raises(ValueError, match="span no volume"):
        explode(MESH, lattice=lattice)


@pytest.mark.parametrize("lattice", ["box", [["a", "b"], ["c", "d"]], {"x": 2.0}])
def test_lattices_that_are_no_numbers(lattice):
    with pytest.raises((TypeError, ValueError)):
        explode(MESH, lattice=lattice)


def test_a_void_that_no_facet_bears():
    """Tags in `voids` that occur nowhere are a slip of the pen."""
    with pytest.raises(ValueError, match=f"{VOID}"):
        explode(MESH, lattice=(2, 1), voids=[VOID])


def test_voids_without_a_lattice():
    """Voids mean something in a periodic cell only."""
    with pytest.raises(ValueError, match="voids.*lattice"):
        explode(MESH, voids=[VOID])


def test_no_law_across_the_boundary(cells):
    """Cells that meet only across the boundary need a law as any others."""
    with pytest.raises(ValueError, match=r"\(1, 1\) face each other and have no interaction law"):
        Scene(cells, {1: SOLID}, macroscopic=DRIVE)
    with pytest.raises(ValueError, match="facet tag 5, which no facet between two bodies"):
        scene_of(cells, facet_interactions={5: PerfectBond()})


@pytest.mark.parametrize(
    "drive",
    [
        {"rate": {"11": -10.0}, "gradient": less("11")},
        {"rate": {"11": -10.0}, "gradient": less("11", "22"), "stress": {"22": 0.0}},
        {"gradient": less("11") | {"11": lambda t: 1.0 - 10.0 * t}},
    ],
)
def test_a_cell_is_not_driven_inside_out(cell, drive):
    simulation = Simulation(scene_of(cell, MacroscopicDrive(**drive)), 0.06, num_threads=1)
    with pytest.raises(ValueError, match=r"Fbar is driven to \[\[-0.2.* at t = 0.12 s.*inside out"):
        list(simulation.steps(0.3))
    assert simulation.time == pytest.approx(0.06)
