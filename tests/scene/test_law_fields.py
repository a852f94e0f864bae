# SPDX-License-Identifier: LGPL-3.0-or-later
"""Parameters of laws that differ from point to point."""

from __future__ import annotations

import numpy as np
import pytest
from dolfinx import fem
from scenes import BOTTOM, box_bodies

import xper_fx as xf

ELASTIC = xf.materials.LinearElastic(1000.0, 0.3, 1.0)
curves = xf.laws.curves


def law(**parameters):
    numbers = {"normal_stiffness": 2e4, "fracture_energy": 0.05, "strength": 10.0}
    return xf.laws.CohesiveZone(**numbers | {"curve": curves.Linear()} | parameters)


def points_of(scene, **options):
    """Position, d0 and friction of each point on facets, in the scene's order."""
    simulation = xf.Simulation(scene, 1e-4, **options)
    interactions = simulation.interactions
    count = max(len(g.parameters[0]) for g in interactions.groups)
    rows = np.zeros((len(interactions), count))
    for group in interactions.groups:
        rows[group.indices, : group.parameters.shape[1]] = group.parameters
    return rows


def scene_with(default, bodies=None, **options):
    bodies = box_bodies((1, 1), (4, 3)) if bodies is None else bodies
    return xf.Scene(bodies, {1: ELASTIC}, default_interaction=default, **options)


def positions(bodies):
    return bodies.facet_nodes(1).reshape(-1, bodies.mesh.geometry.dim)


STRENGTH, D0 = 2e4, 3  # d0 times the stiffness is the strength; its column without friction


def linear(x):
    return 10.0 + 3.0 * x[0] - 2.0 * x[1]


def test_a_function_of_position_is_taken_at_each_point():
    bodies = box_bodies((1, 1), (4, 3))
    rows = points_of(scene_with(law(strength=linear), bodies))
    want = linear(positions(bodies).T)
    np.testing.assert_allclose(STRENGTH * rows[:, D0], want, rtol=1e-14)
    np.testing.assert_allclose(rows[:, D0 + 1], 2 * 0.05 / want, rtol=1e-14)


def test_functions_take_what_they_name():
    bodies = box_bodies((1, 1), (4, 3))
    f = bodies.facets

    def strength(normal, area):
        return 10.0 + np.abs(normal[1]) + area

    def friction(bodies, materials):
        assert np.all(materials == 1)
        return 0.1 + 1e-3 * np.minimum(*bodies)

    rows = points_of(scene_with(law(strength=strength, friction=friction), bodies))
    want = np.repeat(10.0 + np.abs(f.normal[:, 1]) + f.measure, 2)
    np.testing.assert_allclose(STRENGTH * rows[:, D0 + 1], want, rtol=1e-14)
    np.testing.assert_allclose(rows[:, 3], np.repeat(0.1 + 1e-3 * f.bodies.min(axis=1), 2))


@pytest.mark.parametrize("a_facet", [1, 2])
def test_arrays_are_over_facets_or_points(a_facet):
    bodies = box_bodies((1, 1), (4, 3))
    count = len(bodies.facets) * a_facet
    given = np.linspace(5.0, 15.0, count)
    want = np.repeat(given, 2) if a_facet == 1 else given
    for values in (given, given.reshape(-1, a_facet))[:a_facet]:
        rows = points_of(scene_with(law(strength=values), bodies))
        np.testing.assert_allclose(STRENGTH * rows[:, D0], want, rtol=1e-14)


def test_an_array_over_facets_is_over_all_of_the_scene_one_over_points_over_the_laws():
    bodies = box_bodies((1, 1), (4, 3), material={2: lambda x: x[0] > 0.5})
    both = bodies.facets.materials == 2
    right, left = both.all(axis=1), ~both.any(axis=1)
    of_facets = np.linspace(5.0, 15.0, len(both))
    of_points = np.linspace(6.0, 9.0, 2 * np.count_nonzero(left))
    scene = xf.Scene(
        bodies, {1: ELASTIC, 2: ELASTIC}, default_interaction=law(),
        interactions={(2, 2): law(strength=of_facets), (1, 1): law(strength=of_points)},
    )  # fmt: skip
    strength = STRENGTH * points_of(scene)[:, D0].reshape(-1, 2)
    np.testing.assert_allclose(strength[right], of_facets[right, None] * np.ones(2), rtol=1e-14)
    np.testing.assert_allclose(strength[left].ravel(), of_points, rtol=1e-14)
    np.testing.assert_allclose(strength[~right & ~left], 10.0, rtol=1e-14)


def test_a_dolfinx_function_is_evaluated_on_its_mesh():
    bodies = box_bodies((1, 1), (4, 3))
    other = box_bodies((1, 1), (5, 5)).mesh  # each cell apart
    V = fem.functionspace(other, ("Lagrange", 1))
    field = fem.Function(V)
    field.interpolate(linear)
    rows = points_of(scene_with(law(strength=field), bodies))
    np.testing.assert_allclose(STRENGTH * rows[:, D0], linear(positions(bodies).T), rtol=1e-12)
    small = fem.Function(fem.functionspace(box_bodies((0.5, 1), (2, 2)).mesh, ("Lagrange", 1)))
    with pytest.raises(ValueError, match="strength is nan at facet .*, at \\("):
        points_of(scene_with(law(strength=small), bodies))


@pytest.mark.parametrize("points", ["nodal", "gauss"])
@pytest.mark.parametrize("kind", ["crossed", "tetrahedron"])
def test_points_of_higher_order_and_dimension(points, kind):
    size, cells = ((1, 1), (3, 3)) if kind == "crossed" else ((1, 1, 1), (2, 2, 2))
    bodies = box_bodies(size, cells, kind)
    rows = points_of(
        xf.Scene(
            bodies, {1: ELASTIC}, default_interaction=law(strength=linear), points=points, order=2
        ),
        scheme="implicit",
    )
    x = bodies.facet_nodes(2)
    low, high = linear(x.reshape(-1, len(size)).T).min(), linear(x.reshape(-1, len(size)).T).max()
    got = STRENGTH * rows[:, D0].reshape(len(x), -1)
    if points == "nodal":
        want = linear(np.moveaxis(x, 2, 0))
        np.testing.assert_allclose(got, want, rtol=1e-13)
    else:  # of each facet the mean is that of a linear function, and no point is at a corner
        middle = linear(bodies.facets.midpoint.T)
        np.testing.assert_allclose(got.mean(axis=1), middle, rtol=1e-12)
        assert low < got.min() and got.max() < high


def test_walls_and_ties_take_functions_of_position():
    bodies = box_bodies((1, 1), (4, 3))
    wall = xf.Wall(
        BOTTOM, point=(0.0, 0.0), normal=(0.0, 1.0),
        law=xf.laws.SignoriniCoulomb(friction=lambda x, normal: 0.1 + 0.2 * x[0] * normal[1]),
    )  # fmt: skip
    simulation = xf.Simulation(scene_with(law(), bodies, walls=[wall]), 1e-4)
    mu = next(g.parameters[:, 1] for g in simulation.interactions.groups if g.sides and
              g.parameters.shape[1] == 3)  # fmt: skip
    np.testing.assert_allclose(np.unique(mu), 0.1 + 0.05 * np.arange(5), rtol=1e-13)


# -- random fields


def test_weibull_strengths_have_their_distribution():
    bodies = box_bodies((1, 1), (40, 40))
    random = xf.fields.Weibull(10.0, 3.0, seed=4, minimum=2.0)
    rows = points_of(scene_with(law(strength=random), bodies), scheme="explicit")
    values = STRENGTH * rows[:, D0].reshape(-1, 2)
    np.testing.assert_array_equal(values[:, 0], values[:, 1])  # one number a facet
    n = len(values)
    share = np.sort(1.0 - np.exp(-(((values[:, 0] - 2.0) / 10.0) ** 3)))
    distance = np.abs(share - (np.arange(n) + 0.5) / n).max()
    assert distance < 1.6 / np.sqrt(n)  # Kolmogorov's bound at 1 %
    again = points_of(scene_with(law(strength=random), bodies), scheme="explicit")
    np.testing.assert_array_equal(again, rows)
    other = xf.fields.Weibull(10.0, 3.0, seed=5, minimum=2.0)
    assert np.all(points_of(scene_with(law(strength=other), bodies))[:, D0] != rows[:, D0])


def test_larger_facets_are_weaker():
    bodies = box_bodies((4, 1), (8, 8))  # facets of three lengths
    area = bodies.facets.measure
    plain = xf.fields.Weibull(10.0, 3.0, seed=4)
    scaled = xf.fields.Weibull(10.0, 3.0, seed=4, reference_area=0.2)
    a, b = (points_of(scene_with(law(strength=s), bodies))[::2, D0] for s in (plain, scaled))
    np.testing.assert_allclose(b / a, (0.2 / area) ** (1.0 / 3.0), rtol=1e-12)


def test_a_lognormal_field_has_its_mean_scatter_and_length():
    places = np.random.default_rng(0).uniform(0.0, 100.0, (3, 4000))
    near = places + np.array([[0.5], [0.0], [0.0]])
    from xper_fx.nscd.laws.fields import Places

    def sample(x, seed):
        none = np.zeros(x.shape[1], int)
        where = Places(x, x, none, none, none.astype(float), *[none] * 5, 1, 1, 1)
        return xf.fields.Lognormal(8.0, 0.25, 1.0, seed).sample(where)

    values = np.concatenate([sample(places, seed) for seed in range(5)])
    assert values.mean() == pytest.approx(8.0, rel=0.01)
    assert values.std() / values.mean() == pytest.approx(0.25, rel=0.05)
    logs = np.log(values), np.log(np.concatenate([sample(near, seed) for seed in range(5)]))
    assert np.corrcoef(*logs)[0, 1] == pytest.approx(np.exp(-0.25), abs=0.02)


# -- they are as good as numbers


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["explicit", "implicit"])
def test_a_constant_field_runs_as_its_number_does(scheme):
    def last(bond):
        bodies = box_bodies((1, 1), (3, 3))
        scene = scene_with(
            bond, bodies, initial_velocity=lambda x: np.stack([4.0 * x[0], 0.0 * x[0]])
        )
        simulation = xf.Simulation(scene, 2e-3, scheme=scheme)
        for _ in simulation.steps(0.05):
            pass
        assert simulation.ledger.energies.dissipated_cohesion > 0.0
        return simulation.displacement.x.array.copy()

    number = last(law(friction=0.2))
    field = last(law(friction=lambda x: 0.2 + 0.0 * x[0], strength=lambda x: 10.0))
    np.testing.assert_array_equal(number, field)


def test_a_weak_spot_breaks_first():
    def strength(x):
        return np.where(np.abs(x[0] - 0.5) < 0.1, 6.0, 10.0)

    bodies = box_bodies((1, 1), (4, 1))
    scene = scene_with(
        law(strength=strength), bodies,
        initial_velocity=lambda x: np.stack([4.0 * (x[0] - 0.5), 0.0 * x[0]]),
    )  # fmt: skip
    simulation = xf.Simulation(scene, 1e-3, scheme="explicit")
    for _ in simulation.steps(0.05):
        damage = simulation.interactions.gather("damage")
        if damage.min() < 1.0:
            break
    assert np.all(np.abs(positions(bodies)[damage < 1.0, 0] - 0.5) < 0.1)


def test_fields_of_pairs_and_of_the_values_of_a_curve():
    @xf.njit
    def falls(x, strength, length):
        return strength * np.exp(-x / length)

    mixed = xf.laws.MixedMode(2e4, (linear, 12.0), (0.05, 0.08), 2.0)
    own = xf.laws.CohesiveCurve(
        falls, {"strength": linear, "length": 0.005}, end=lambda s, length: 10.0 * length,
        normal_stiffness=2e4,
    )  # fmt: skip
    bodies = box_bodies((1, 1), (4, 3))
    want = linear(positions(bodies).T)
    onset = points_of(scene_with(mixed, bodies))[:, 3]  # strength / stiffness
    np.testing.assert_allclose(2e4 * onset, want, rtol=1e-14)
    rows = points_of(scene_with(own, bodies))
    np.testing.assert_allclose(rows[:, 6], want, rtol=1e-14)
    d0 = rows[:, 3]
    np.testing.assert_allclose(2e4 * d0, want * np.exp(-d0 / 0.005), rtol=1e-8)


def test_a_law_without_a_stiffness_given_runs():
    bodies = box_bodies((1, 1), (4, 3))
    own = xf.laws.CohesiveZone(None, 0.05, 10.0, curve=curves.Tvergaard())
    rows = points_of(scene_with(own, bodies))
    np.testing.assert_allclose(rows[:, 0], 6.75 * 10.0 / (16 * 0.05 / 90.0), rtol=1e-14)
    soft = law(normal_stiffness=lambda x: 2e3 + x[0])
    np.testing.assert_allclose(
        points_of(scene_with(soft, bodies))[:, 0], 2e3 + positions(bodies)[:, 0], rtol=1e-14
    )


def test_friction_that_is_zero_somewhere_is_friction():
    """Kernels hang on what is given, not on the values that a rank happens to have."""
    nowhere = law(friction=lambda x: 0.0 * x[0])
    simulation = xf.Simulation(scene_with(nowhere), 1e-4)
    names = [group.kernels.name for group in simulation.interactions.groups]
    assert names == ["cohesive zone with friction"]
    wall = xf.Wall(
        BOTTOM, point=(0.0, 0.0), normal=(0.0, 1.0),
        law=xf.laws.SignoriniCoulomb(friction=lambda x: 0.0 * x[0]),
    )  # fmt: skip
    simulation = xf.Simulation(scene_with(law(), walls=[wall]), 1e-4)
    assert {g.kernels.components for g in simulation.interactions.groups} == {2}


# -- bad input


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (lambda x: np.where(x[0] > 0.6, -1.0, 10.0), "above zero, got -1.0. This is facet"),
        (lambda x: np.where(x[0] > 0.6, np.nan, 10.0), r"strength is nan at facet \d+, at \(0.6"),
        (np.ones(7), "strength has 7 values; it should have one for each of the 65 facing facets"),
        (np.ones((2, 65)), r"of shape \(2, 65\); .* shape \(65, 2\), or one for each of the 130 p"),
        (np.array([[1.0, 1.0], [1.0, -1.0]]), "above zero, got -1.0, entry 1, 1"),
        (np.r_[np.ones(64), -1.0], "above zero, got -1.0, entry 64"),
        (lambda y, z: 1.0, r"strength is a function of \(y, z\); it should take some of x"),
        (lambda x: x, r"of shape \(3, 130\) for 130 points"),
        (lambda x: "strong", "strength gives str"),
        (np.full(65, 1e3), "fracture_energy 0.05 J/m.* This is facet 0"),
        ("strong", "strength should be a number"),
    ],
)
def test_bad_fields_are_refused(given, words):
    with pytest.raises((TypeError, ValueError), match=words):
        points_of(scene_with(law(strength=given)))


def test_random_numbers_a_facet_are_for_facets():
    wall = xf.Wall(
        BOTTOM, point=(0.0, 0.0), normal=(0.0, 1.0),
        law=xf.laws.SignoriniCoulomb(friction=xf.fields.Uniform(0.1, 0.2, seed=1)),
    )  # fmt: skip
    with pytest.raises(ValueError, match="ties and walls have no such facets"):
        xf.Simulation(scene_with(law(), walls=[wall]), 1e-4)
    with pytest.raises(ValueError, match="high - low should be"):
        xf.fields.Uniform(0.2, 0.1, seed=1)
    with pytest.raises(TypeError, match="seed should be an integer"):
        xf.fields.Weibull(1.0, 2.0, seed=0.5)


def test_contacts_that_are_searched_take_numbers():
    bodies = box_bodies((1, 1), (2, 1), label=lambda x: (x[0] > 0.5).astype(int))
    contact = xf.laws.SignoriniCoulomb(friction=lambda x: 0.1 + 0.0 * x[0])
    scene = scene_with(
        law(), bodies, surfaces={"all": [1]}, contacts=[xf.Contact(("all", "all"), contact)]
    )
    with pytest.raises(ValueError, match="contacts that are searched"):
        xf.Simulation(scene, 1e-4)
