# SPDX-License-Identifier: LGPL-3.0-or-later
"""Whatever a user gives: a clear error where it comes in, or a run without NaN.

A clear error is one that this package raises on purpose, before a step is made; or the documented
one of a step that cannot be made.
"""

from __future__ import annotations

import math
import traceback
import warnings
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import ufl
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from scenes import BOTTOM, LEFT, RIGHT, TOP, box_bodies, mesh_of, side_tags

import xper_fx
from xper_fx.bodies.explode import explode
from xper_fx.forms.loads import (
    BodyForce,
    Gravity,
    PrescribedDisplacement,
    PrescribedVelocity,
    RayleighDamping,
    SurfaceTraction,
)
from xper_fx.materials import (
    Cubic,
    J2FiniteStrain,
    J2SmallStrain,
    Linear,
    LinearElastic,
    LinearViscoelastic,
    NeoHookean,
    Orthotropic,
    SaintVenantKirchhoff,
    Voce,
)
from xper_fx.nscd.laws import CohesiveZone, PerfectBond, SignoriniCoulomb, Tresca
from xper_fx.nscd.rigid import Disc, Polygon, RigidBodies, RigidBody, Sphere, wall
from xper_fx.output.checkpoint import restore
from xper_fx.output.recorder import Recorder
from xper_fx.periodic.drive import MacroscopicDrive
from xper_fx.scene.contact import Contact
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.errors import ConvergenceError, NotFiniteError

PACKAGE = str(Path(xper_fx.__file__).parent)
NAN, INF = float("nan"), float("inf")
REPEATABLE = {
    "derandomize": True,
    "deadline": None,
    "database": None,
    "suppress_health_check": list(HealthCheck),
    "phases": [Phase.generate],  # examples are short enough to be read unshrunk
}


def require_clear(error: Exception, *words: str) -> None:
    """It was raised on purpose by this package, and names what is wrong."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    assert last.filename.startswith(PACKAGE) and last.line.startswith("raise"), (last, error)
    message = str(error)
    assert len(message) > 20, message
    assert not words or any(word in message.lower() for word in words), (words, message)


# Constructors: junk for one or two arguments of what is good otherwise

JUNK = st.one_of(
    st.floats(),
    st.integers(-2, 3),
    st.sampled_from(
        [NAN, INF, -INF, 0.0, -1.0, 0.5, 1e300, 1e-300, 5e-324, 10**400, np.float32(0.3), True]
        + [np.float64(NAN), "2", "x", "", None, 1j, object(), len, {}, [], [1.0], [[1.0], 2.0]]
        + [np.array([]), np.array([NAN, 1.0]), (0.0, 1.0), b"1", {"a": NAN}]
    ),
)
ELASTIC = {"young": 1.0, "poisson": 0.3, "density": 1.0}
SQUARE = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]


def rigid(**given) -> RigidBodies:
    return RigidBodies([RigidBody(**given)])


BODY = {"position": (0.0, 0.0), "group": "g", "velocity": (0.0, 0.0), "force": (0.0, 0.0)}
BODY |= {"spin": 0.1, "torque": 1.0, "prescribed": {0: 1.0}, "shape": Disc(1.0)}
CONSTRUCTORS = {
    "linear elastic": (LinearElastic, ELASTIC | {"plane": "strain"}),
    "neo-Hookean": (NeoHookean, ELASTIC),
    "Saint-Venant": (SaintVenantKirchhoff, ELASTIC),
    "J2": (J2SmallStrain, ELASTIC | {"yield_stress": 0.01, "hardening": Linear(0.1)}),
    "finite J2": (J2FiniteStrain, ELASTIC | {"yield_stress": 0.01, "hardening": Linear(0.1)}),
    "linear hardening": (Linear, {"modulus": 0.1}),
    "Voce": (Voce, {"saturation": 2.0, "rate": 3.0, "modulus": 0.1}),
    "viscoelastic": (LinearViscoelastic, ELASTIC | {"prony": [(0.5, 1.0)]}),
    "cubic": (Cubic, {"c11": 2.0, "c12": 1.0, "c44": 0.6, "density": 1.0, "rotation": 0.0}),
    "orthotropic": (
        Orthotropic,
        {"young": (1.0,) * 3, "poisson": (0.1,) * 3, "shear": (0.5,) * 3, "density": 1.0}
        | {"rotation": 0.0},
    ),
    "contact": (SignoriniCoulomb, {"friction": 0.1, "restitution": 0.2}),
    "Tresca": (Tresca, {"bound": 0.1, "restitution": 0.2}),
    "cohesive zone": (
        CohesiveZone,
        {"normal_stiffness": 100.0, "fracture_energy": 1.0, "strength": 5.0}
        | {"tangential_stiffness": 90.0, "friction": 0.1, "initial_damage": 0.9},
    ),
    "damping": (RayleighDamping, {"mass": 0.1, "stiffness": 0.1}),
    "contact of groups": (
        lambda **given: Contact(law=None, **given),
        {"between": ("a", "b"), "reach": 0.1},
    ),
    "drive": (
        MacroscopicDrive,
        {"gradient": {"11": 1.0, "21": 0.0}, "rate": {"12": 0.0}, "stress": {"22": 0.0}},
    ),
    "disc": (Disc, {"radius": 1.0}),
    "sphere": (Sphere, {"radius": 1.0}),
    "polygon": (Polygon, {"vertices": SQUARE}),
    "wall": (wall, {"point": (0, 0), "normal": (0, 1), "group": "g", "velocity": (0, 0)}),
    "body of a density": (rigid, BODY | {"density": 1.0, "angle": 0.1}),
    "body of a mass": (rigid, BODY | {"mass": 1.0, "inertia": 1.0}),
    "body in space": (
        rigid,
        {"shape": Sphere(1.0), "position": (0, 0, 0), "group": "g", "rotation": (0, 0, 0, 1.0)}
        | {"mass": 1.0, "inertia": np.eye(3), "velocity": (0, 0, 0), "spin": (0, 0, 1)},
    ),
}


def numbers_in(thing) -> list[float]:
    """All numbers that an object holds."""
    if isinstance(thing, float | int | np.ndarray | np.generic):
        array = np.asarray(thing)
        return array.ravel().tolist() if array.dtype.kind in "iuf" else []
    if isinstance(thing, tuple | list):
        return [number for item in thing for number in numbers_in(item)]
    if isinstance(thing, RigidBodies):
        return numbers_in([thing.mass, thing.inertia, thing.position, thing.velocity, thing.spin])
    if is_dataclass(thing) and not isinstance(thing, RigidBody):
        return numbers_in([getattr(thing, field.name) for field in fields(thing)])
    return []


@pytest.mark.slow
@settings(max_examples=400, **REPEATABLE)
@given(st.data())
def test_constructors(data):
    name = data.draw(st.sampled_from(sorted(CONSTRUCTORS)))
    make, good = CONSTRUCTORS[name]
    changed = data.draw(
        st.dictionaries(st.sampled_from(sorted(good)), JUNK, min_size=1, max_size=2)
    )
    try:
        made = make(**(good | changed))
    except (ValueError, TypeError) as error:
        names = [word for argument in changed for word in argument.split("_")]
        values = [str(value).lower() for value in changed.values()]
        values += [key for value in changed.values() if isinstance(value, dict) for key in value]
        require_clear(error, *names, *[value for value in values if value])
    else:
        numbers = numbers_in(made)
        assert np.all(np.isfinite(numbers)), (made, numbers)


# Runs

TIMES = 3


def run_or_clear_error(make, steps: int = TIMES) -> str:
    """Make a simulation and its steps; what came of it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        try:
            simulation = make()
        except (ValueError, TypeError) as error:
            require_clear(error)
            return f"refused: {error}"
        try:
            for _ in range(steps):
                size = simulation.step_size
                for record in simulation.steps(simulation.time + size):
                    require_finite(simulation, record)
        except ConvergenceError as error:
            require_clear(error)
            require_finite(simulation, None)
            return f"gave up: {error}"
        except (ValueError, TypeError) as error:
            require_clear(error)
            assert not isinstance(error, NotFiniteError)
            require_finite(simulation, None)
            return f"stopped: {error}"
    return "ran"


def require_finite(simulation, record) -> None:
    """State, ledger and histories of the points are numbers."""
    state = simulation.state
    known = {"time": state.time, "displacement": state.displacement, "velocity": state.velocity}
    known |= {"internal": state.internal, "external": state.external}
    known |= simulation.ledger.as_columns() | simulation.forms.history()
    if record is not None:
        known |= {"size": record.size, **record.energies}
    if simulation.interactions is not None:
        names = ("jump", "velocity", "impulse", "traction", "energy", "damage", "status")
        known |= {f"points {name}": simulation.interactions.gather(name) for name in names}
    if simulation.rigid is not None:
        rigid = simulation.rigid.state
        known |= {"position": rigid.position, "rigid velocity": rigid.velocity}
        known |= {"rotation": rigid.turn.rotation, "spin": rigid.turn.spin}
    if simulation.macroscopic is not None:
        known |= {"F": simulation.macroscopic.gradient, "P": simulation.macroscopic.stress}
    for name, values in known.items():
        assert np.all(np.isfinite(values)), name


class Mine(Exception):
    """What a user's function raises."""


def nan_from(time: float):
    return lambda t: NAN if t > time else 0.0


def mostly(usual, other):
    """Few enough of the others that most scenes have at most one."""
    return st.integers(0, 11).flatmap(lambda number: other if number == 7 else usual)


WIDE = st.one_of(
    st.floats(-12.0, 12.0).map(lambda e: 10.0**e),
    st.sampled_from([0.0, -1.0, NAN, INF, 1e300, 1e-300, 5e-324, 1e150, 1e-150, 1e30, 1e-30]),
    st.floats(),
)
USUAL = st.floats(-2.0, 2.0).map(lambda e: 10.0**e)
NUMBER = mostly(USUAL, WIDE)
SIGNED = st.one_of(st.just(0.0), NUMBER, NUMBER.map(lambda x: -x))
VALUE = mostly(
    st.one_of(SIGNED, SIGNED.map(lambda v: lambda t: v * t)),
    st.one_of(
        st.floats(0.0, 0.3).map(nan_from),
        st.sampled_from(
            [lambda t: t * 1e308 * 10, lambda t: np.zeros(3), lambda t: "1", lambda t: None]
            + [lambda t: np.array([t]), math.sin, lambda t: 1j, "1", None]
        ),
    ),
)
TAG = mostly(st.sampled_from([LEFT, RIGHT, BOTTOM, TOP]), st.sampled_from([77, "left", 1.5]))
COMPONENT = mostly(st.sampled_from([0, 1]), st.sampled_from([2, -1, 0.0, None]))
VECTOR = mostly(st.tuples(VALUE, VALUE), st.sampled_from([(0.0,), 1.0, "xy", (0, 0, -9.81)]))
LOAD = st.one_of(
    st.builds(PrescribedVelocity, TAG, COMPONENT, VALUE),
    st.builds(PrescribedDisplacement, TAG, COMPONENT, VALUE),
    st.builds(BodyForce, VECTOR),
    st.builds(Gravity, VECTOR),
    st.builds(SurfaceTraction, TAG, VECTOR),
)


def broken_or_bonded(stiffness, energy, strength) -> CohesiveZone:
    return CohesiveZone(stiffness, energy, strength, friction=0.3)


@cache
def unit_mesh(kind: str):
    mesh = mesh_of((1.0, 1.0), (1, 1), kind)
    return mesh, side_tags(mesh, (1.0, 1.0)), mesh.geometry.x.copy()


def stretched_bodies(kind: str, one: bool, size: float, stretch: float):
    """A square of four triangles or one quadrilateral, scaled; one body or each cell its own."""
    mesh, facets, x = unit_mesh(kind)
    cells = mesh.topology.index_map(2).size_local
    mesh.geometry.x[:] = x * [size, size * stretch, 1.0]
    try:
        return explode(mesh, np.zeros(cells, int) if one else np.arange(cells), None, facets)
    finally:
        mesh.geometry.x[:] = x


# Few kernels, each compiled once.
LAWS = st.one_of(
    st.tuples(st.just(SignoriniCoulomb), NUMBER, st.floats(0.0, 1.0)),
    st.tuples(st.just(PerfectBond)),
    st.tuples(st.just(broken_or_bonded), NUMBER.map(lambda x: 100.0 * x), NUMBER, NUMBER),
    st.none(),
)
SIMULATIONS = st.fixed_dictionaries(
    {"step": mostly(USUAL.map(lambda h: 0.1 * h), WIDE)},
    optional={
        "theta": mostly(st.floats(0.5, 1.0), st.sampled_from([0.4, 1.1, NAN, "half", None])),
        "tolerance": mostly(st.just(1e-6), st.one_of(WIDE, st.sampled_from(["auto", "tight"]))),
        "accuracy": mostly(st.just(0.1), WIDE),
        "newton_tolerance": mostly(st.just(1e-6), WIDE),
        "relaxation": mostly(st.just(1.0), st.sampled_from([1.9, 2.0, 0.0, NAN, "x"])),
        "max_halvings": mostly(st.just(1), st.sampled_from([0, -1, 1.5])),
        "max_newton": mostly(st.just(5), st.sampled_from([1, 0, "2"])),
        "inertia": mostly(st.just(True), st.just(False)),
        "scheme": mostly(st.just("implicit"), st.sampled_from(["leapfrog", None])),
        "solver": mostly(st.just("nlgs"), st.sampled_from(["newtn", 3, ["nlgs"]])),
    },
)
LIMITS = {"max_sweeps": 50, "num_threads": 1, "max_newton": 8, "max_halvings": 2, "solver": "nlgs"}
MATERIALS = st.one_of(
    st.builds(
        lambda *numbers: (LinearElastic, numbers),
        NUMBER,
        mostly(st.floats(-0.9, 0.49), st.floats(-1.0, 0.5)),
        NUMBER,
    ),
    st.builds(
        lambda *numbers: (NeoHookean, numbers), NUMBER, mostly(st.floats(-0.5, 0.45), WIDE), NUMBER
    ),
)


def initial_velocity(value):
    return lambda x: np.full((2, x.shape[1]), value)


VELOCITIES = mostly(
    st.one_of(st.none(), SIGNED.map(initial_velocity)),
    st.sampled_from([lambda x: x, lambda x: x[0], lambda x: None, lambda x: 1j * x[:2], 3.0]),
)


@pytest.mark.slow
@settings(max_examples=60, **REPEATABLE)
@given(
    kind=st.sampled_from(["crossed", "quadrilateral"]),
    one=st.booleans(),
    size=mostly(st.sampled_from([1.0, 1e-12, 1e6]), st.sampled_from([1e-160, 1e160, 0.0])),
    stretch=mostly(st.just(1.0), st.sampled_from([1e-3, 1e6, 1e-9, 1e-14])),
    material=MATERIALS,
    law=LAWS,
    loads=st.lists(LOAD, max_size=2),
    velocity=VELOCITIES,
    damping=st.one_of(st.none(), st.tuples(NUMBER, NUMBER)),
    order=mostly(st.sampled_from([1, 2]), st.sampled_from([3, 1.0])),
    options=SIMULATIONS,
)
def test_meshed_scenes(
    kind, one, size, stretch, material, law, loads, velocity, damping, order, options
):
    def make():
        bond = law[0](*law[1:]) if isinstance(law, tuple) else law
        scene = Scene(
            stretched_bodies(kind, one, size, stretch),
            {1: material[0](*material[1])},
            default_interaction=bond,
            loads=loads,
            initial_velocity=velocity,
            damping=None if damping is None else RayleighDamping(*damping),
            order=order,
        )
        return Simulation(scene, **(LIMITS | options))

    run_or_clear_error(make)


# Rigid bodies: discs that meet each other and a floor

PLACE = st.tuples(st.floats(-3.0, 3.0), st.floats(0.0, 6.0))
PAIR = mostly(st.tuples(SIGNED, SIGNED), st.sampled_from([(1.0,), 2.0, "ab", lambda t: (t,)]))
DISCS = st.fixed_dictionaries(
    {"position": mostly(PLACE, PAIR), "radius": mostly(st.floats(0.1, 0.5), WIDE)},
    optional={
        "mass": NUMBER,
        "inertia": NUMBER,
        "density": mostly(st.none(), NUMBER),
        "velocity": PAIR,
        "spin": SIGNED,
        "angle": SIGNED,
        "prescribed": st.dictionaries(mostly(st.integers(0, 2), st.just(3)), VALUE, max_size=2),
        "force": mostly(PAIR, VALUE),
        "torque": VALUE,
    },
)


@settings(max_examples=40, **REPEATABLE)
@given(
    discs=st.lists(DISCS, min_size=1, max_size=3),
    floor=PAIR,
    law=st.tuples(NUMBER, mostly(st.floats(0.0, 1.0), WIDE)),
    reach=mostly(st.none(), WIDE),
    gravity=mostly(st.just((0.0, -9.81)), VECTOR),
    step=mostly(USUAL.map(lambda h: 0.01 * h), WIDE),
    theta=mostly(st.just(0.5), st.floats(0.0, 1.0)),
    resolve=st.booleans(),
)
def test_rigid_scenes(discs, floor, law, reach, gravity, step, theta, resolve):
    def make():
        bodies = []
        for disc in discs:
            given = {"mass": 1.0, "group": "discs"} | disc
            bodies.append(RigidBody(Disc(given.pop("radius")), **given))
        contact = SignoriniCoulomb(*law)
        scene = Scene(
            rigid=[*bodies, wall((0.0, -1.0), (0.0, 1.0), "floor", velocity=floor)],
            contacts=[
                Contact(("discs", "discs"), contact, reach),
                Contact(("discs", "floor"), contact, reach),
            ],
            loads=[Gravity(gravity)],
            resolve_overlaps=resolve,
        )
        limits = {"max_sweeps": 50, "num_threads": 1, "max_halvings": 2}
        return Simulation(scene, step, theta=theta, **limits)

    run_or_clear_error(make)


# Periodic cells


@pytest.mark.slow
@settings(max_examples=60, **REPEATABLE)
@given(
    drive=st.dictionaries(
        st.sampled_from(["11", "12", "21", "22"]),
        st.tuples(st.sampled_from(["gradient", "rate", "stress"]), VALUE),
        min_size=3,
    ),
    lattice=mostly(
        st.just((1.0, 1.0)),
        st.sampled_from([(1.0, 2.0), (NAN, 1.0), (0.0, 1.0), [[1, 0], [1, 0]], "ab", (1.0,)]),
    ),
    material=MATERIALS,
    step=mostly(USUAL.map(lambda h: 0.1 * h), WIDE),
    static=st.booleans(),
)
def test_periodic_scenes(drive, lattice, material, step, static):
    def make():
        mesh, *_ = unit_mesh("crossed")
        parts = {"gradient": {}, "rate": {}, "stress": {}}
        for name in ("11", "12", "21", "22"):
            part, value = drive.get(name, ("rate", 0.0))
            parts[part][name] = value
        scene = Scene(
            explode(mesh, np.zeros(4, int), lattice=lattice),
            {1: material[0](*material[1])},
            macroscopic=MacroscopicDrive(**parts),
        )
        options = {"inertia": False, "theta": 1.0} if static else {}
        return Simulation(scene, step, max_newton=8, max_halvings=2, **options)

    run_or_clear_error(make)


# NaN that comes up in the middle of a run


class Root:
    """Stiffness that falls with the strain until there is none: its energy is NaN beyond."""

    density, linear = 1.0, False

    def energy(self, u, constant):
        strain = ufl.tr(ufl.sym(ufl.grad(u)))
        return constant(1.0) * (1.0 - ufl.sqrt(constant(0.1) - strain)) ** 2

    def stress(self, u, constant):
        return ufl.Identity(3) * ufl.tr(ufl.sym(ufl.grad(u)))


LINEAR = LinearElastic(1.0, 0.3, 1.0)


@pytest.mark.parametrize("scheme", ["implicit", "explicit"])
def test_a_material_that_turns_nan(scheme, tmp_path):
    """The error names the material, the state before it is kept, on disk too."""
    bodies = box_bodies((2.0, 1.0), (2, 1), label=0, material={4: lambda x: x[0] > 1.0})
    loads = [
        PrescribedVelocity(tag, i, float(i == 0 and tag == RIGHT)) for tag in (LEFT, RIGHT)
        for i in (0, 1)
    ]  # fmt: skip
    scene = Scene(bodies, {1: LINEAR, 4: Root()}, loads=loads)
    simulation = Simulation(scene, 0.02, scheme=scheme)
    recorder = Recorder(simulation, tmp_path, end_time=1.0, fields=0)
    with (
        recorder,
        pytest.raises(NotFiniteError, match="internal forces of Root of cell tag 4") as caught,
    ):
        list(simulation.steps(1.0))
    error = caught.value
    assert error.time == simulation.time and error.step == simulation.step_number + 1
    assert 0.02 <= simulation.time < 0.4
    require_finite(simulation, None)
    other = Simulation(scene, 0.02, scheme=scheme)
    restore(error.saved, other)
    assert np.array_equal(other.state.displacement, simulation.state.displacement)
    simulation.save_on_failure(None)
    with pytest.raises(NotFiniteError):  # and again, from the same state
        list(simulation.steps(1.0))


LOADS = {
    "velocity": lambda value: PrescribedVelocity(RIGHT, 0, value),
    "displacement": lambda value: PrescribedDisplacement(RIGHT, 0, value),
    "force": lambda value: BodyForce((0.0, value)),
    "gravity": lambda value: Gravity((value, 0.0)),
    "traction": lambda value: SurfaceTraction(RIGHT, (value, 0.0)),
}
LATER = {
    "NaN": (NAN, ValueError, "nan at t = 0.3"),
    "infinite": (INF, ValueError, "inf at t = 0.3"),
    "an array": (np.zeros(2), TypeError, "at t = 0.3.* s; it should be a number"),
    "nothing": (None, TypeError, "None.* at t = 0.3.* s; it should be a number"),
    "raises": (Mine, Mine, "mine"),
}


@pytest.mark.parametrize("later", LATER)
@pytest.mark.parametrize("load", LOADS)
def test_a_load_that_goes_wrong(load, later):
    """From a time on; the run stops there and the state before is kept."""
    given, kind, words = LATER[later]

    def value(t):
        if t < 0.25:
            return 0.0
        if given is Mine:
            raise Mine("mine")
        return given

    bodies = box_bodies((1.0, 1.0), (1, 1), label=0)
    simulation = Simulation(Scene(bodies, {1: LINEAR}, loads=[LOADS[load](value)]), 0.1)
    with pytest.raises(kind, match=words):
        list(simulation.steps(1.0))
    assert simulation.time == pytest.approx(0.2) and simulation.step_number == 2
    require_finite(simulation, None)


def test_energies_beyond_floats():
    """State and forces are numbers, their work is not."""
    bodies = box_bodies((1.0, 1.0), (1, 1), label=0)
    loads = [PrescribedVelocity(LEFT, 0, lambda t: 0.0 if t < 0.15 else 1e200)]
    simulation = Simulation(Scene(bodies, {1: LINEAR}, loads=loads), 0.1)
    with pytest.raises(NotFiniteError, match="the energies work"):
        list(simulation.steps(1.0))
    assert simulation.time == pytest.approx(0.1)
    require_finite(simulation, None)


def test_energies_of_laws_that_are_no_numbers_leave_the_last_checkpoint(monkeypatch):
    """The jumps have moved on when they are summed: nothing is saved that does not fit together."""
    bodies = box_bodies((1.0, 1.0), (1, 1))
    scene = Scene(bodies, {1: LINEAR}, default_interaction=CohesiveZone(10.0, 1.0, 1.0))
    simulation, saved = Simulation(scene, 0.1), []
    simulation.save_on_failure(lambda: saved.append(simulation.time))
    commit = simulation.interactions.commit
    monkeypatch.setattr(
        simulation.interactions, "commit", lambda *args: commit(*args)._replace(friction=math.nan)
    )
    with pytest.raises(NotFiniteError, match="dissipated_friction"):
        list(simulation.steps(1.0))
    assert simulation.step_number == 0 and not saved
