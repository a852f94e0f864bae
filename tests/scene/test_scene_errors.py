# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bad input: the right exception, naming what is wrong, before anything is compiled."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import BOTTOM, LEFT, RIGHT, TOP, box_bodies

from xper_fx.forms.loads import (
    BodyForce,
    Gravity,
    PrescribedDisplacement,
    PrescribedVelocity,
    RayleighDamping,
    SurfaceTraction,
)
from xper_fx.materials import LinearElastic, NeoHookean
from xper_fx.nscd.laws import CohesiveZone, PerfectBond, SignoriniCoulomb, Tresca
from xper_fx.scene import Scene, Wall
from xper_fx.simulation.simulation import Simulation

SOLID = LinearElastic(100.0, 0.3, 1.0)
BOND = PerfectBond()
NAN = float("nan")
NOTCH = 9


@pytest.fixture(scope="module")
def bodies():
    """Two materials side by side, a tagged interior facet line below the middle."""
    return box_bodies(
        (2, 2),
        (2, 2),
        material={2: lambda x: x[0] > 1.0},
        interior={NOTCH: lambda x: (np.abs(x[0] - 1) < 1e-9) & (x[1] < 1 + 1e-9)},
    )


@pytest.fixture(scope="module")
def body():
    """One body: its sides share corners, where the sides of exploded cells share nothing."""
    return box_bodies((2, 2), (2, 2), label=0)


def scene_with(bodies, **changes):
    arguments = {"materials": {1: SOLID, 2: SOLID}, "default_interaction": BOND} | changes
    return Scene(bodies, **arguments)


def test_what_is_right_is_taken(bodies):
    law = CohesiveZone(100.0, 1.0, 5.0)
    scene = scene_with(
        bodies,
        interactions={(2, 1): None, (1, 1): law},
        facet_interactions={NOTCH: SignoriniCoulomb(0.1)},
        walls=[Wall(LEFT, (0, 0), (1, 0), law)],
        loads=[
            PrescribedVelocity(BOTTOM, 1, 0.0),
            PrescribedVelocity(RIGHT, 0, np.sin),
            PrescribedVelocity(LEFT, 1, 0.0),  # shares a corner with the same motion
            BodyForce(np.array([1.0, 2.0])),
            Gravity((0, lambda t: -9.81)),
            SurfaceTraction(TOP, [0.0, 1.0]),
        ],
        initial_velocity={2: lambda x: x[:2]},
    )
    laws, index = scene.law_of_facet()
    facets = bodies.facets
    assert laws[index[facets.tag == NOTCH][0]] == SignoriniCoulomb(0.1)
    mixed = facets.materials[:, 0] != facets.materials[:, 1]
    assert np.all(index[mixed & (facets.tag == 0)] == -1) and np.any(mixed & (facets.tag == 0))
    assert all(laws[i] == law for i in index[np.all(facets.materials == 1, axis=1)])
    assert all(laws[i] == BOND for i in index[np.all(facets.materials == 2, axis=1)])


SCENES = {
    "no material": ({"materials": {1: SOLID}}, ValueError, r"Cell tags \[2\].*no material"),
    "unknown material tag": (
        {"materials": {1: SOLID, 2: SOLID, 5: SOLID}}, ValueError, r"\[5\], which occur nowhere",
    ),
    "no material at all": ({"materials": {1: SOLID, 2: "steel"}}, TypeError, "cell tag 2.*steel"),
    "no law": ({"default_interaction": None}, ValueError, r"\(1, 1\) face each other.*no inter"),
    "one law missing": (
        {"default_interaction": None, "interactions": {(1, 1): BOND, (2, 2): BOND}},
        ValueError,
        r"\(1, 2\) face each other.*no interaction law",
    ),
    "unknown pair": ({"interactions": {(1, 7): BOND}}, ValueError, r"\(1, 7\).*nowhere"),
    "two laws": (
        {"interactions": {(1, 2): BOND, (2, 1): SignoriniCoulomb()}}, ValueError, "two laws",
    ),
    "law class": ({"default_interaction": CohesiveZone}, TypeError, r"class.*CohesiveZone\("),
    "material class": (
        {"materials": {1: SOLID, 2: LinearElastic}}, TypeError, r"tag 2 is the class LinearEl",
    ),
    "no law object": ({"default_interaction": "glue"}, TypeError, "'glue' is no interaction law"),
    "unknown facet of a law": ({"facet_interactions": {77: BOND}}, ValueError, "facet tag 77"),
    "outer facet of a law": ({"facet_interactions": {TOP: BOND}}, ValueError, f"tag {TOP}, which"),
    "unknown facet of a load": (
        {"loads": [SurfaceTraction(88, (1, 0))]}, ValueError, "SurfaceTraction names facet tag 88",
    ),
    "unknown facet of a wall": (
        {"walls": [Wall(66, (0, 0), (1, 0), BOND)]}, ValueError, "Wall names facet tag 66",
    ),
    "zero normal": (
        {"walls": [Wall(LEFT, (0, 0), (0, 0), BOND)]}, ValueError, "normal should not vanish",
    ),
    "NaN normal": (
        {"walls": [Wall(LEFT, (0, 0), (NAN, 0), BOND)]}, ValueError, "should be finite",
    ),
    "infinite normal": (
        {"walls": [Wall(LEFT, (0, 0), (np.inf, 0), BOND)]}, ValueError, "should be finite",
    ),
    "normal of 3D": (
        {"walls": [Wall(LEFT, (0, 0), (1, 0, 0), BOND)]}, ValueError, "2 components",
    ),
    "law of a wall": ({"walls": [Wall(LEFT, (0, 0), (1, 0), 0.3)]}, TypeError, "no interaction"),
    "no wall": ({"walls": [LEFT]}, TypeError, "no Wall"),
    "component": (
        {"loads": [PrescribedVelocity(LEFT, 2, 0.0)]}, ValueError, "component 2.*0 to 1",
    ),
    "length of a load": ({"loads": [Gravity((0, 0, -9.81))]}, ValueError, "Gravity.*2 components"),
    "number as a force": ({"loads": [BodyForce(3.0)]}, ValueError, "BodyForce.*2 components"),
    "NaN load": ({"loads": [BodyForce((0.0, NAN))]}, ValueError, "nan.*finite"),
    "NaN motion": ({"loads": [PrescribedVelocity(LEFT, 0, NAN)]}, ValueError, "nan.*finite"),
    "no load": ({"loads": [9.81]}, TypeError, "9.81 is no load"),
    "displaced at the start": (
        {"loads": [PrescribedDisplacement(LEFT, 0, 1e-3)]}, ValueError, "0.001 m at the start",
    ),
    "contradiction": (
        {"loads": [PrescribedVelocity(LEFT, 0, 0.0), PrescribedVelocity(LEFT, 0, 1.0)]},
        ValueError,
        "same component of the same nodes",
    ),
    "damping": ({"damping": 0.1}, TypeError, "RayleighDamping"),
    "tag of a velocity": ({"initial_velocity": {4: np.sin}}, ValueError, r"\[4\], which occur no"),
    "velocity as a number": ({"initial_velocity": 3.0}, TypeError, "function, got 3.0"),
    "order": ({"order": 3}, ValueError, "order should be 1 or 2, got 3"),
    "points": ({"points": "lobatto"}, ValueError, "'lobatto'"),
}  # fmt: skip


@pytest.mark.parametrize("case", SCENES)
def test_scene_refuses(bodies, case, monkeypatch):
    def compiled(*_, **__):
        raise AssertionError("compiled before the input was checked")

    monkeypatch.setattr("xper_fx.forms.dynamics.fem.form", compiled)
    changes, error, message = SCENES[case]
    with pytest.raises(error, match=message):
        scene_with(bodies, **changes)


@pytest.mark.parametrize(
    "second", [PrescribedVelocity(TOP, 1, 2.0), PrescribedDisplacement(TOP, 1, 0.0)]
)
def test_contradiction_at_a_corner(body, bodies, second):
    loads = [PrescribedVelocity(LEFT, 1, 0.0), second]
    with pytest.raises(ValueError, match="same component of the same nodes"):
        Scene(body, {1: SOLID}, loads=loads)
    scene_with(bodies, loads=loads)  # the corner's cells have nodes of their own


def test_a_mesh_is_no_bodies(bodies):
    with pytest.raises(TypeError, match="explode"):
        scene_with(bodies.mesh)


BAD_NUMBERS = [-1.0, 0.0, NAN, float("inf")]


@pytest.mark.parametrize("value", BAD_NUMBERS)
@pytest.mark.parametrize("model", [LinearElastic, NeoHookean])
@pytest.mark.parametrize("name", ["young", "density"])
def test_materials_refuse(model, name, value):
    with pytest.raises(ValueError, match=name):
        model(**({"young": 1.0, "poisson": 0.3, "density": 1.0} | {name: value}))


@pytest.mark.parametrize("poisson", [0.5, 0.7, -1.0, NAN])
@pytest.mark.parametrize("model", [LinearElastic, NeoHookean])
def test_poisson_ratio_of_an_incompressible_solid(model, poisson):
    with pytest.raises(ValueError, match="poisson should lie strictly between -1 and 0.5"):
        model(1.0, poisson, 1.0)


@pytest.mark.parametrize("value", BAD_NUMBERS)
@pytest.mark.parametrize("name", ["normal_stiffness", "fracture_energy", "strength"])
def test_cohesive_zone_refuses(name, value):
    good = {"normal_stiffness": 100.0, "fracture_energy": 1.0, "strength": 10.0}
    with pytest.raises(ValueError, match=name):
        CohesiveZone(**(good | {name: value}))


def test_other_numbers():
    # w = Rmax d0 / 2 = Rmax^2 / (2 C) exactly
    with pytest.raises(ValueError, match="should exceed Rmax d0 / 2 = 0.5 J"):
        CohesiveZone(100.0, 0.5, 10.0)
    for make, message in (
        (lambda: CohesiveZone(100.0, 1.0, 10.0, friction=-0.1), "friction"),
        (lambda: CohesiveZone(100.0, 1.0, 10.0, initial_damage=0.0), "initial_damage"),
        (lambda: SignoriniCoulomb(NAN), "friction"),
        (lambda: SignoriniCoulomb(0.1, restitution=1.5), "restitution"),
        (lambda: SignoriniCoulomb(0.1, contact="penalty"), "penalty"),
        (lambda: Tresca(-1.0), "bound"),
        (lambda: RayleighDamping(mass=-1.0), "mass"),
        (lambda: RayleighDamping(stiffness=NAN), "stiffness"),
        (lambda: LinearElastic(1.0, 0.3, 1.0, plane="sprain"), "sprain"),
    ):
        with pytest.raises(ValueError, match=message):
            make()


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"step": -1.0}, "step"),
        ({"step": 0.0}, "step"),
        ({"step": NAN}, "step"),
        ({"theta": 0.49}, "theta should lie"),
        ({"theta": 1.01}, "theta should lie"),
        ({"theta": NAN}, "theta should lie"),
        ({"scheme": "explicit", "theta": 1.0}, "theta = 1/2"),
        ({"scheme": "leapfrog"}, "leapfrog"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"newton_tolerance": -1.0}, "newton_tolerance"),
        ({"relaxation": 2.0}, "relaxation"),
        (
            {"solver": "nlgz"},
            "one of auto, nlgs, newton, accelerated, .*, subdomains, monolithic, got 'nlgz'",
        ),
        ({"solver": "newton", "scheme": "explicit"}, "leave solver at \"auto\", got 'newton'"),
        ({"max_sweeps": 0}, "max_sweeps"),
        ({"max_newton": 0}, "max_newton"),
        ({"max_halvings": -1}, "max_halvings"),
    ],
)
def test_simulation_refuses(bodies, arguments, message):
    with pytest.raises(ValueError, match=message):
        Simulation(scene_with(bodies), **({"step": 1e-3} | arguments))


def test_a_load_that_becomes_nan_names_its_time(bodies):
    loads = [PrescribedVelocity(TOP, 1, lambda t: 1.0 if t < 2e-3 else NAN)]
    scene = scene_with(bodies, loads=loads)
    simulation = Simulation(scene, 1e-3, num_threads=1)
    with pytest.raises(ValueError, match="nan at t = 0.002"):
        list(simulation.steps(1.0))
    assert simulation.time == pytest.approx(1e-3)


@pytest.mark.parametrize("end", [NAN, float("inf")])
def test_end_time(bodies, end):
    simulation = Simulation(scene_with(bodies), 1e-3, num_threads=1)
    with pytest.raises(ValueError, match="end_time"):
        next(simulation.steps(end))


def test_a_step_at_which_rounding_hides_the_mass_is_refused():
    """h^2 K / M = 1e15 for free bodies; with both ends held there is nothing to hide."""

    def scene(loads):
        bodies = box_bodies((1.0, 1.0), (1, 1), label=0)
        return Scene(bodies, {1: LinearElastic(1.0, 0.3, 1.0)}, loads=loads)

    with pytest.raises(ValueError, match="hides the inertia"):
        next(Simulation(scene([]), 1e8).steps(1e8))
    held = [PrescribedVelocity(tag, i, 0.0) for tag in (LEFT, RIGHT) for i in (0, 1)]
    next(Simulation(scene(held), 1e8).steps(1e8))


def test_nothing_acts_on_facets_inside_of_a_body():
    """Not silently: a traction there would be left out of the forms."""
    inside = box_bodies(
        (2, 2), (2, 2), label=0, interior={NOTCH: lambda x: np.abs(x[0] - 1.0) < 1e-9}
    )
    for item in ({"loads": [SurfaceTraction(NOTCH, (1.0, 0.0))]},
                 {"walls": [Wall(NOTCH, (1, 0), (1, 0), BOND)]}):  # fmt: skip
        with pytest.raises(ValueError, match=f"tag {NOTCH}, of whose 2 facets 2 lie inside"):
            Scene(inside, {1: SOLID}, **item)


class Own:
    """A law whose kernels and numbers are given."""

    def __init__(self, kernels=None, numbers=(), state=()):
        self._given = kernels, numbers, state

    def kernels(self, dim):
        return self._given[0]

    def parameters(self):
        return self._given[1]

    def initial_state(self):
        return self._given[2]


KERNELS = BOND.kernels(2)


@pytest.mark.parametrize(
    ("law", "error", "words"),
    [
        (Own(), TypeError, "Own gives None for its kernels.*LawKernels"),
        (Own((1, 2)), TypeError, r"Own gives \(1, 2\) for its kernels"),
        (Own(KERNELS, None), TypeError, r"Own.parameters\(\) should be numbers, got None"),
        (Own(KERNELS, 3.0), ValueError, r"gives 3.0 for parameters\(\)"),
        (Own(KERNELS, (), (1.0,)), ValueError, r"initial_state\(\); .* one for each of \[\]"),
        (
            Own(CohesiveZone(1e4, 1.0, 1.0).kernels(2), (1e4, 1e4), (0.0, 1.0)),
            ValueError,
            "Own gives 2 parameters, and its kernels need 5",
        ),
    ],
)
def test_what_a_law_of_ones_own_gives(bodies, law, error, words):
    with pytest.raises(error, match=words):
        Simulation(scene_with(bodies, default_interaction=law), 1e-3, num_threads=1)
