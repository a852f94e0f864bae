# SPDX-License-Identifier: LGPL-3.0-or-later
"""Small scenes that carry something from step to step: each is a function that gives a run.

`SCENES` has the end time of each (s), and what happens on the way, which the test checks: a scene
in which nothing happens would prove nothing.
"""

from __future__ import annotations

import numpy as np
from outside_law import LinearSoftening
from scenes import BOTTOM, LEFT, RIGHT, TOP, box_bodies

from xper_fx.bodies.explode import explode
from xper_fx.bodies.meshes import crossed_rectangle
from xper_fx.cache import njit
from xper_fx.forms.loads import (
    Gravity,
    PrescribedDisplacement,
    PrescribedVelocity,
    RayleighDamping,
    SurfaceTraction,
)
from xper_fx.materials import (
    J2FiniteStrain,
    J2SmallStrain,
    Linear,
    LinearElastic,
    LinearViscoelastic,
    SaintVenantKirchhoff,
)
from xper_fx.nscd.laws import (
    CohesiveCurve,
    CohesiveZone,
    RigidCohesiveZone,
    RigidMixedMode,
    SignoriniCoulomb,
)
from xper_fx.nscd.laws.fields import Lognormal
from xper_fx.nscd.rigid import Cluster, Disc, Part, Polygon, Polyhedron, RigidBody, wall
from xper_fx.periodic.drive import MacroscopicDrive
from xper_fx.scene import Hinge, Scene, Tendon, Wall
from xper_fx.scene.contact import Contact
from xper_fx.simulation.simulation import Simulation

ELASTIC = LinearElastic(young=1.0, poisson=0.3, density=1.0)
SVK = SaintVenantKirchhoff(young=1.0, poisson=0.3, density=1.0)
BOND = CohesiveZone(10.0, 1e-4, 1e-2, friction=0.3)
ONE = {"num_threads": 1}


def _halves(x):
    return x[0] > 1.0


def _pulled(material, speed, label=_halves, kind="crossed", **options):
    lengths, cells = ((2.0, 1.0), (4, 2)) if kind == "crossed" else ((2.0, 1.0, 1.0), (2, 1, 1))
    bodies = box_bodies(lengths, cells, kind, label=label)
    loads = [PrescribedVelocity(LEFT, 0, 0.0), PrescribedVelocity(RIGHT, 0, speed)]
    loads += options.pop("loads", [])
    options = {"default_interaction": BOND} | options
    return Scene(bodies, {1: material}, loads=loads, **options)


def explicit_plate():
    """Each cell a body, vertex blocks, adapted steps and tolerance; it breaks."""
    return Simulation(_pulled(ELASTIC, 0.05, None), accuracy=1e-2, **ONE)


def splitting_plate():
    """Vertices that split one after the other; lips close again."""
    rigid = RigidMixedMode((1e-2, 1.2e-2), (1e-5, 2e-5), 1.5, friction=0.3, viscosity=0.1)
    return Simulation(_pulled(ELASTIC, 0.05, None, default_interaction=rigid), accuracy=1e-2, **ONE)


def splitting_ahead():
    """The same, implicit: vertices get their points before they open, which turn; it breaks."""
    rigid = RigidMixedMode((1e-2, 1.2e-2), (1e-5, 2e-5), 1.5, friction=0.3)
    scene = _pulled(SVK, 0.05, None, default_interaction=rigid)
    return Simulation(scene, 0.05, solver="monolithic", **ONE)


def rigid_bar():
    """Rigid bonds without inertia, whose steps are cut; it breaks."""
    rigid = RigidMixedMode((1e-2, 1.2e-2), (2e-4, 4e-4), 1.5, friction=0.3)
    held = [PrescribedVelocity(BOTTOM, 1, 0.0)]
    scene = _pulled(ELASTIC, 0.02, default_interaction=rigid, loads=held)
    return Simulation(scene, 1.0, inertia=False, newton_tolerance=1e-10, **ONE)


def cohesive_bar():
    """Implicit, a given step, damping, a load in time; it breaks."""
    push = SurfaceTraction(TOP, (0.0, lambda t: -1e-3 * np.sin(t)))
    scene = _pulled(ELASTIC, 0.05, loads=[push], damping=RayleighDamping(mass=0.05, stiffness=0.05))
    return Simulation(scene, 0.1, theta=0.6, **ONE)


def newton_bar():
    """Newton on all points of a linear bulk whose steps adapt: springs belong to a step's w."""
    stiff = CohesiveZone(1e4, 1e-4, 1e-2, friction=0.3)
    scene = _pulled(ELASTIC, 0.05, None, default_interaction=stiff)
    return Simulation(scene, accuracy=1e-2, scheme="implicit", solver="newton", **ONE)


def finite_strain_bar():
    """The inverse of a nonlinear bulk is kept as long as it serves; steps adapt; it breaks."""
    return Simulation(_pulled(SVK, 0.2), accuracy=1e-2, scheme="implicit", **ONE)


def turning_cells():
    """Newton on all points whose bonds turn with their cells; it breaks."""
    scene = Scene(
        box_bodies((2.0, 1.0), (4, 2), "quadrilateral"),
        {1: SVK},
        default_interaction=CohesiveZone(1e3, 1e-3, 3e-2, friction=0.3),
        loads=[PrescribedVelocity(LEFT, 0, 0.0)],
        initial_velocity=lambda x: 0.1 * np.stack([0.5 - x[1], x[0] - 1.0]),
    )
    return Simulation(scene, 0.2, solver="newton", **ONE)


def cut_steps():
    """So few iterations are allowed that steps are cut, and cut again."""
    loads = [PrescribedDisplacement(TOP, 1, lambda t: 0.05 * t**2)]
    return Simulation(_pulled(SVK, 0.3, loads=loads), 1.0, max_newton=4, **ONE)


def ductile_bar():
    """J2 at finite strain, kept inverses of a history that has moved on."""
    material = J2FiniteStrain(
        young=1.0, poisson=0.3, yield_stress=5e-3, hardening=Linear(0.1), density=1.0
    )
    return Simulation(_pulled(material, 0.1, 0), 0.2, theta=1.0, **ONE)


def ductile_cells():
    """J2 at small strain, each cell a body."""
    material = J2SmallStrain(
        young=1.0, poisson=0.3, yield_stress=3e-3, hardening=Linear(0.1), density=1.0
    )
    return Simulation(_pulled(material, 0.05, None), 0.1, **ONE)


def spinning_cells():
    """Bonds that turn with their cells until they break, explicit; C_N unlike C_T, friction."""
    scene = Scene(
        box_bodies((2.0, 1.0), (4, 2)),
        {1: SVK},
        default_interaction=CohesiveZone(10.0, 1e-4, 1e-2, 8.0, friction=0.3),
        initial_velocity=lambda x: 0.3 * np.stack([0.5 - x[1], x[0] - 1.0]),
    )
    return Simulation(scene, scheme="explicit", **ONE)


@njit
def _falls(x, strength, length):
    return strength * np.exp(-x / length)


def uneven_plate():
    """A curve of one's own with a correlated strength, explicit; it breaks."""
    bond = CohesiveCurve(
        _falls, {"strength": Lognormal(1e-2, 0.2, 0.5, seed=3), "length": 0.01}, end=0.1,
        normal_stiffness=10.0, friction=np.linspace(0.1, 0.5, 42),
    )  # fmt: skip
    return Simulation(_pulled(ELASTIC, 0.05, None, default_interaction=bond), 0.05,
                      scheme="explicit", **ONE)  # fmt: skip


def solid_of_another_law():
    """Kernels from outside the package, 3D, explicit, each cell a body; it breaks."""
    law = LinearSoftening(10.0, 1e-2, 1e-4)
    scene = _pulled(ELASTIC, 0.05, None, "tetrahedron", default_interaction=law)
    return Simulation(scene, scheme="explicit", **ONE)


def viscoelastic_bar():
    """Prony series beside a bond whose damage lags, and that breaks."""
    material = LinearViscoelastic(young=1.0, poisson=0.3, prony=[(0.5, 1.0)], density=1.0)
    glue = CohesiveZone(10.0, 1e-4, 1e-2, friction=0.3, viscosity=1e-5)
    return Simulation(_pulled(material, 0.05, default_interaction=glue), 0.2, **ONE)


def solid_bar():
    """3D, order 2, Gauss points, Newton on all points."""
    law = CohesiveZone(10.0, 1e-4, 1e-2)
    scene = _pulled(
        ELASTIC, 0.05, None, "tetrahedron", order=2, points="gauss", default_interaction=law
    )
    return Simulation(scene, 0.5, solver="newton", **ONE)


def _cell(material, **options):
    mesh = crossed_rectangle((0, 0), (2, 1), (4, 2))
    bodies = explode(mesh, np.repeat(np.arange(8) % 4 // 2, 4), lattice=(2.0, 1.0))
    drive = MacroscopicDrive(
        rate={"11": 0.05}, gradient={"12": 0.0, "21": 0.0}, stress={"22": lambda t: 1e-3 * t}
    )
    scene = Scene(bodies, {1: material}, default_interaction=BOND, macroscopic=drive)
    return Simulation(scene, 0.1, **options, **ONE)


def cell():
    """A periodic cell that breaks, a stress given."""
    return _cell(ELASTIC, theta=1.0, tolerance=1e-6)


def ringing_cell():
    """The same at finite strain, at theta = 1/2: the guess alternates."""
    return _cell(SVK, tolerance=1e-6)


def ductile_cell():
    """The same with plastic flow."""
    material = J2FiniteStrain(
        young=1.0, poisson=0.3, yield_stress=3e-3, hardening=Linear(0.1), density=1.0
    )
    return _cell(material, theta=1.0, tolerance=1e-6)


def falling_bodies():
    """Discs, which resist rolling, boxes and a cross that fall on each other and slide."""
    rigid = [wall((0.0, 0.0), (0.0, 1.0), "ground")]
    bar = Polygon.box((0.2, 0.05))
    cross = Cluster([bar, *(Part(Polygon.box((0.05, 0.07)), (0.0, s * 0.06)) for s in (-1, 1))])
    rigid.append(RigidBody(cross, (-0.2, 0.12), "boxes", density=100.0, spin=-2.0))
    for i in range(3):
        rigid.append(RigidBody(Disc(0.1), (0.15 * i, 0.1 + 0.21 * i), "discs", density=100.0))
        rigid.append(
            RigidBody(Polygon.box((0.2, 0.2)), (0.5 + 0.05 * i, 0.11 + 0.22 * i), "boxes",
                      density=100.0, spin=0.5)
        )  # fmt: skip
    law = SignoriniCoulomb(friction=0.4, restitution=0.2)
    round_law = SignoriniCoulomb(friction=0.4, restitution=0.2, rolling=0.1)
    contacts = [Contact(("discs", other), round_law) for other in ("ground", "discs", "boxes")]
    contacts += [Contact(("boxes", other), law) for other in ("ground", "boxes")]
    scene = Scene(rigid=rigid, contacts=contacts, loads=[Gravity((1.0, -9.81))])
    return Simulation(scene, 5e-3, **ONE)


def tumbling_boxes():
    """Boxes in space, one of them driven by a function of time."""
    box = Polyhedron.box((0.2, 0.2, 0.1))
    rigid = [
        wall((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), "ground"),
        RigidBody(box, (0.0, 0.0, 0.06), "boxes", density=100.0, spin=(1.0, 2.0, 3.0)),
        RigidBody(box, (0.05, 0.02, 0.22), "boxes", density=100.0, spin=(3.0, 0.0, 1.0)),
        RigidBody(box, (0.3, 0.0, 0.06), "boxes", density=100.0,
                  prescribed={0: lambda t: -np.sin(9.0 * t)}),
    ]  # fmt: skip
    law = SignoriniCoulomb(friction=0.3)
    contacts = [Contact(("boxes", "ground"), law), Contact(("boxes", "boxes"), law)]
    scene = Scene(rigid=rigid, contacts=contacts, loads=[Gravity((0.0, 0.0, -9.81))])
    return Simulation(scene, 5e-3, **ONE)


def mechanism():
    """Bars on hinges with friction and a limit, a slider, wires that get taut, and contact."""
    bar = Polygon.box((1.0, 0.05))
    first = RigidBody(bar, (0.5, 0.0), "bars", density=50.0, spin=-3.0, velocity=(0.0, -1.5))
    second = RigidBody(bar, (1.5, 0.0), "bars", density=50.0)
    block = RigidBody(Disc(0.1), (2.0, 0.0), "bars", density=100.0)
    rigid = [first, second, block, wall((0.0, -0.8), (0.0, 1.0), "ground")]
    joints = [
        Hinge((None, first), (0.0, 0.0), friction=1.0, limits=(-0.6, 0.1), restitution=0.5),
        Hinge((first, second), (1.0, 0.0)),
        Hinge((second, block), (2.0, 0.0)),
        Tendon((None, second), ((1.0, 1.0), (1.2, 0.0)), length=1.1, restitution=0.3),
        Tendon((None, block), ((3.0, 1.0), (2.0, 0.0)), stiffness=100.0, prestress=5.0),
    ]
    law = SignoriniCoulomb(friction=0.3)
    contacts = [Contact(("bars", "ground"), law), Contact(("bars", "bars"), None)]
    scene = Scene(rigid=rigid, joints=joints, contacts=contacts, loads=[Gravity((1.0, -9.81))])
    return Simulation(scene, 5e-3, **ONE)


def fragments():
    """A plate flies against a wall and breaks: lips retire, pieces meet again."""
    bodies = box_bodies((2.0, 1.0), (2, 1))
    law = SignoriniCoulomb()
    scene = Scene(
        bodies,
        {1: ELASTIC},
        default_interaction=BOND,
        surfaces={"plate": (1,)},
        rigid=[wall((0.0, -0.01), (0.0, 1.0), "ground")],
        contacts=[Contact(("plate", "plate"), law), Contact(("plate", "ground"), law)],
        initial_velocity=lambda x: np.stack([0.1 * (x[0] - 1.0), -0.4 + 0.0 * x[0]]),
    )  # fmt: skip
    return Simulation(scene, 0.05, **ONE)


def splitting_blocks():
    """Blocks whose vertices split strike each other: lips retire, pieces meet again."""
    bodies = box_bodies((2.0, 1.0), (4, 2), material={2: lambda x: x[0] > 1.0 - 1e-9})
    bodies.mesh.geometry.x[bodies.mesh.geometry.x[:, 0] > 1.0, 1] += 0.1
    law = SignoriniCoulomb(0.3)
    scene = Scene(
        bodies,
        {1: SVK, 2: SVK},
        interactions={(1, 2): None},
        default_interaction=RigidCohesiveZone(1e-2, 1e-6, friction=0.3),
        surfaces={"a": (1,), "b": (2,)},
        contacts=[Contact(pair, law) for pair in (("a", "b"), ("a", "a"), ("b", "b"))],
        initial_velocity={
            tag: lambda x, v=v: np.stack([v * (1.0 - np.abs(x[1] - 0.5)), 0.0 * x[0]])
            for tag, v in ((1, 0.2), (2, -0.2))
        },
    )  # fmt: skip
    return Simulation(scene, scheme="explicit", **ONE)


def resting_block():
    """Gravity on a wall, adapted steps without an interaction that weakens."""
    scene = Scene(
        box_bodies((1.0, 1.0), (2, 2), label=0),
        {1: SVK},
        walls=[Wall(BOTTOM, (0.0, -1e-3), (0.0, 1.0), SignoriniCoulomb(0.3))],
        loads=[Gravity((2e-3, -1e-2))],
    )
    return Simulation(scene, accuracy=1e-2, **ONE)


def at_rest():
    """A static run whose steps adapt to the end time."""
    material = J2SmallStrain(
        young=1.0, poisson=0.3, yield_stress=1e-3, hardening=Linear(0.1), density=1.0
    )
    bodies = box_bodies((2.0, 1.0), (4, 2), label=0)
    loads = [
        PrescribedVelocity(LEFT, 0, 0.0), PrescribedVelocity(RIGHT, 0, 1e-3),
        PrescribedVelocity(BOTTOM, 1, 0.0),
    ]  # fmt: skip
    scene = Scene(bodies, {1: material}, loads=loads)
    return Simulation(scene, accuracy=1e-2, theta=1.0, inertia=False)


SCENES = {
    explicit_plate: (1.5, "broken"),
    splitting_plate: (1.5, "broken"),
    splitting_ahead: (1.5, "broken"),
    rigid_bar: (3.0, "broken"),
    cohesive_bar: (2.0, "broken"),
    newton_bar: (0.6, "broken"),
    finite_strain_bar: (2.0, "broken"),
    turning_cells: (3.0, "broken"),
    cut_steps: (4.0, "cut"),
    ductile_bar: (3.0, "flown"),
    ductile_cells: (2.0, "flown"),
    spinning_cells: (4.0, "broken"),
    uneven_plate: (4.0, "broken"),
    solid_of_another_law: (3.0, "broken"),
    viscoelastic_bar: (4.0, "broken"),
    solid_bar: (4.0, "broken"),
    cell: (2.0, "broken"),
    ringing_cell: (2.0, "broken"),
    ductile_cell: (2.0, "flown"),
    falling_bodies: (0.3, "touched"),
    tumbling_boxes: (0.25, "touched"),
    mechanism: (0.6, "touched"),
    fragments: (3.0, "retired"),
    splitting_blocks: (6.0, "retired"),
    resting_block: (2.0, "touched"),
    at_rest: (10.0, "flown"),
}
