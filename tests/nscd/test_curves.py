# SPDX-License-Identifier: LGPL-3.0-or-later
"""Curves along which bonds weaken: the catalogue, a user's function, a table."""

from __future__ import annotations

import numpy as np
import pytest
from point_mass import PointMass
from scipy.integrate import quad

import xper_fx as xf
from xper_fx.nscd.laws.damage_curve import damage_functions

curves = xf.laws.curves

# Concrete: k (Pa/m), w (J/m^2), s (Pa).
K, W, S = 1e12, 100.0, 3e6
AREA = 1e-2

FREE = (
    curves.Parabolic(),
    curves.Linear(),
    curves.Petersson(),
    curves.Petersson(0.25, 0.75),
    curves.Trapezoidal(),
    curves.Trapezoidal(0.2),
    curves.Exponential(),
)
OWN = (curves.XuNeedleman(), curves.Tvergaard())
CATALOGUE = FREE + OWN
EXPONENTIALS = (curves.Exponential, curves.XuNeedleman)  # a shape's third number is their length


def zone(curve, **options):
    stiffness = None if curve in OWN else K
    return xf.laws.CohesiveZone(stiffness, W, S, curve=curve, **options)


@xf.njit
def hyperbola(x, strength, length):
    return strength / (1.0 + (x / length) ** 2)


@xf.njit
def two_lines(x, strength, knee, end):
    if x < knee:
        return strength * (1.0 - 0.7 * x / knee)
    return 0.3 * strength * max(0.0, (end - x) / (end - knee))


def of_function(**options):
    return xf.laws.CohesiveCurve(
        hyperbola, {"strength": S, "length": 2e-5}, end=2e-4, normal_stiffness=K, **options
    )


def with_kinks(**options):
    return xf.laws.CohesiveCurve(
        two_lines, {"strength": S, "knee": 2e-5, "end": 1e-4}, end=lambda s, knee, end: end,
        kinks=lambda s, knee, end: (knee,), normal_stiffness=K, **options,
    )  # fmt: skip


def of_table(**options):
    return xf.laws.CohesiveCurve(([0.0, 2e-6, 3e-5, 9e-5], [0.0, 3e6, 1e6, 0.0]), **options)


def adhesion(**options):
    return xf.laws.Adhesion(K, W, **options)


OTHERS = {"function": of_function, "kinks": with_kinks, "table": of_table, "adhesion": adhesion}
LAWS = [*(lambda c=c, **o: zone(c, **o) for c in CATALOGUE), *OTHERS.values()]
NAMES = [*map(repr, CATALOGUE), *OTHERS]
each_law = pytest.mark.parametrize("make", LAWS, ids=NAMES)


def traction(law, x):
    """Of a bond opened monotonically, from its compiled damage."""
    functions = damage_functions(law.weakening().curve)
    shape = tuple(map(float, law.shape()))
    return law.stiffnesses()[0] * x * functions.damage(x, shape, 1.0)


# -- curves


@each_law
def test_area_strength_and_slope_are_those_of_the_traction(make):
    law = make()
    d0, dc = float(law.elastic_opening), float(law.critical_opening)
    corners = [d0, *map(float, law.shape()[2:4])] if len(law.shape()) > 2 else [d0]
    corners = sorted({0.0, dc, *(c for c in corners if 0.0 < c < dc)})
    area = sum(
        quad(lambda x: traction(law, x), a, b, epsabs=0.0, epsrel=1e-12, limit=500)[0]
        for a, b in zip(corners[:-1], corners[1:], strict=True)
    )
    assert area == pytest.approx(law.fracture_energy, rel=2e-9)
    x = np.linspace(0.0, dc * (1.0 - 1e-12), 20001)
    t = np.array([traction(law, v) for v in x])
    assert t.max() == pytest.approx(law.strength, rel=2e-3)
    assert -np.diff(t).min() / (x[1] - x[0]) == pytest.approx(law.softening_slope, rel=1.2e-2)
    assert traction(law, 1.01 * dc) == 0.0


@pytest.mark.parametrize("curve", CATALOGUE, ids=repr)
def test_the_area_is_the_fracture_energy_given(curve):
    law = zone(curve)
    assert law.fracture_energy == W
    damage, _, dissipated, _ = damage_functions(curve.functions)
    shape = tuple(map(float, law.shape()))
    assert law.stiffnesses()[0] * dissipated(shape[1], shape, 1.0) == pytest.approx(W, rel=1e-12)


@pytest.mark.parametrize("curve", CATALOGUE, ids=repr)
def test_the_area_of_any_part_is_that_of_the_traction(curve):
    """Short parts and long ones, by forty points of Gauss between the knees."""
    inner_fall, inner_area, _ = curve.functions
    fall = xf.njit(lambda x, p: inner_fall(x, p))
    area = xf.njit(lambda a, b, g, p: inner_area(a, b, g, p))
    shape = tuple(map(float, zone(curve).shape()))
    knees = [shape[number] for number in curve.knees]
    x, weights = np.polynomial.legendre.leggauss(40)
    d0, dc = shape[:2]
    unit = shape[2] if isinstance(curve, EXPONENTIALS) else dc - d0
    for a in d0 + np.array([0.0, 1e-3, 0.5, 0.9]) * unit:
        for length in (1e-7, 1e-3, 0.099, 0.101, 0.7):
            b = min(a + length * unit, dc)
            ends = [a, *(k for k in knees if a < k < b), b]
            want = 0.0
            for low, high in zip(ends[:-1], ends[1:], strict=True):
                half, middle = 0.5 * (high - low), 0.5 * (high + low)
                values = [(middle + half * z) * fall(middle + half * z, shape) for z in x]
                want += half * float(np.dot(weights, values))
            g = fall(a, shape) if a > d0 else 1.0
            assert area(a, b, g, shape) == pytest.approx(want, rel=2e-13, abs=0.0)


def test_published_points_of_the_curves():
    petersson = zone(curves.Petersson())
    knee = 0.8 * W / S
    assert petersson.critical_opening == pytest.approx(3.6 * W / S, rel=1e-14)
    assert traction(petersson, knee + S / 3.0 / K) == pytest.approx(S / 3.0, rel=1e-12)
    plateau = zone(curves.Trapezoidal(0.5))
    dc = plateau.critical_opening
    assert 0.5 * S * (1.5 * dc - S / K) == pytest.approx(W, rel=1e-14)
    assert traction(plateau, 0.49 * dc) == pytest.approx(S, rel=1e-12)
    assert traction(plateau, 0.75 * dc) == pytest.approx(0.5 * S, rel=1e-12)
    tvergaard = zone(curves.Tvergaard())
    dc = tvergaard.critical_opening
    assert dc == pytest.approx(16.0 * W / (9.0 * S), rel=1e-14)
    assert traction(tvergaard, dc / 3.0) == pytest.approx(S, rel=1e-12)
    assert traction(tvergaard, 0.6 * dc) == pytest.approx(6.75 * S * 0.6 * 0.16, rel=1e-12)
    smooth = zone(curves.XuNeedleman())
    length = W / (np.e * S)
    assert traction(smooth, length) == pytest.approx(S, rel=1e-5)
    assert traction(smooth, 3.0 * length) == pytest.approx(3.0 * np.exp(-2.0) * S, rel=1e-5)


def test_the_traction_of_a_users_curve_is_the_users():
    law = of_function()
    for x in (2e-6, 1e-5, 4e-5, 1.9e-4):
        want = min(K * x, S / (1.0 + (x / 2e-5) ** 2))
        assert traction(law, x) == pytest.approx(want, rel=1e-13)
    d0 = law.elastic_opening
    assert K * d0 == pytest.approx(S / (1.0 + (d0 / 2e-5) ** 2), rel=1e-8)
    assert law.strength == pytest.approx(K * d0, rel=1e-12)


def test_a_function_a_table_and_a_curve_of_the_catalogue_are_one():
    """Linear softening three ways."""
    linear = zone(curves.Linear())
    d0, dc = linear.elastic_opening, linear.critical_opening

    @xf.njit
    def line(x, end):
        return S * (end - x) / (end - d0)

    users = xf.laws.CohesiveCurve(line, {"end": dc}, end=dc, normal_stiffness=K)
    table = xf.laws.CohesiveCurve(([0.0, d0, dc], [0.0, S, 0.0]))
    for law in (users, table):
        assert law.fracture_energy == pytest.approx(W, rel=1e-9)
        assert law.elastic_opening == pytest.approx(d0, rel=1e-8)
        means = [damage_functions(one.weakening().curve).mean_damage for one in (linear, law)]
        shapes = [tuple(map(float, one.shape())) for one in (linear, law)]
        for x1, x0 in ((0.3 * dc, 0.0), (0.31 * dc, 0.3 * dc), (2.0 * dc, 0.5 * dc)):
            beta = damage_functions(linear.weakening().curve).damage(x0, shapes[0], 1.0)
            a, b = (
                mean(x1, x0, x0, beta, shape, 1.0)
                for mean, shape in zip(means, shapes, strict=True)
            )
            assert a == pytest.approx(b, rel=1e-9)


# -- over steps


@pytest.mark.slow
@each_law
@pytest.mark.parametrize(("steps", "theta"), [(0.2, 0.5), (3.0, 0.5), (3.0, 0.8), (50.0, 0.5)])
def test_a_bond_torn_by_inertia_spends_its_area_at_any_step(make, steps, theta):
    law = make()
    spent = law.fracture_energy * AREA
    dc = float(law.critical_opening)
    length = max(law.fracture_energy / law.strength, dc / 20.0)
    bond = PointMass(law, 8.0 * spent, [1.0, 0.0], area=AREA, theta=theta)
    total = np.zeros(6)
    before = bond.kinetic
    for _ in range(8 + int(1.5 * steps * dc / length)):
        energies = np.array(bond.step(length / steps))
        assert energies[1] >= -1e-14 * spent
        total += energies
    assert bond.damage == 0.0
    assert total[1] == pytest.approx(spent, rel=1e-11)
    if theta == 0.5:
        assert before - bond.kinetic == pytest.approx(spent, rel=1e-9)


@each_law
def test_any_direction_spends_the_same(make):
    law = make()
    spent, dc = law.fracture_energy * AREA, float(law.critical_opening)
    for angle in (0.3, 1.1, np.pi / 2):
        velocity = [np.cos(angle), np.sin(angle)]
        bond = PointMass(law, 8.0 * spent, velocity, area=AREA, theta=0.5)
        total = sum(bond.step(dc / 5.0)[1] for _ in range(30))
        assert total == pytest.approx(spent, rel=1e-10)


@each_law
def test_random_loads_dissipate_at_every_step(make):
    rng = np.random.default_rng(5)
    law = make(friction=0.4)
    spent, dc = law.fracture_energy * AREA, float(law.critical_opening)
    mass = 2.0 * spent
    bond = PointMass(law, mass, [0.0, 0.0], area=AREA, theta=0.5)
    for _ in range(300):
        kick = rng.normal(size=2) * 0.3
        bond.velocity += kick
        energies = np.array(bond.step(dc * rng.choice([0.03, 0.2, 0.7])))
        assert energies[1:4].min() >= -1e-12 * spent
        assert energies[4] >= -1e-9 * spent


# -- bad input


@xf.njit
def rising(x, strength):
    return strength * (0.2 + x / 1e-4)


@xf.njit
def negative(x, strength):
    return strength * (1.0 - x / 5e-5)


@xf.njit
def nothing(x, strength):
    pass


@xf.njit
def kinked(x, strength):
    return strength if x < 3.3e-5 else 0.4 * strength


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: xf.laws.CohesiveZone(K, 1.0, S), "fracture_energy 1 J/m.* at the peak"),
        (lambda: zone(curves.Petersson, friction=0.0), "curve should be one of"),
        (lambda: xf.laws.CohesiveZone(K, W, S, curve=curves.Tvergaard()), "stiffness of its own"),
        (lambda: xf.laws.CohesiveZone(None, W, S), "normal_stiffness is None"),
        (lambda: curves.Petersson(0.5, 1.2), r"knee_opening should lie in \(0, 1\)"),
        (lambda: curves.Trapezoidal(1.0), r"plateau should lie in \(0, 1\)"),
        (
            lambda: xf.laws.CohesiveZone(K, 6.0, S, curve=curves.Petersson()),
            "bends at .* before the bond weakens",
        ),
        (
            lambda: xf.laws.CohesiveCurve(lambda x: x, end=1.0, normal_stiffness=K),
            "compiled by xper_fx.njit",
        ),
        (
            lambda: xf.laws.CohesiveCurve(hyperbola, {"s": S, "l": 2e-5}, normal_stiffness=K),
            "end .* is missing",
        ),
        (
            lambda: xf.laws.CohesiveCurve(hyperbola, {"s": S, "l": 2e-5}, end=1e-4),
            "normal_stiffness .* is missing",
        ),
        (
            lambda: xf.laws.CohesiveCurve(rising, {"s": S}, end=1e-4, normal_stiffness=5e9),
            "Up to its end",
        ),
        (
            lambda: xf.laws.CohesiveCurve(
                ([0.0, 1e-6, 2e-5, 3e-5, 9e-5], [0.0, 3e6, 1e6, 2.9e6, 0.0])
            ),
            "The secant .* rises at an opening of 2",
        ),
        (
            lambda: xf.laws.CohesiveCurve(negative, {"s": S}, end=1e-4, normal_stiffness=K),
            "is negative or not finite",
        ),
        (
            lambda: xf.laws.CohesiveCurve(kinked, {"s": S}, end=1e-4, normal_stiffness=K),
            "not smooth.*kinks",
        ),
        (
            lambda: xf.laws.CohesiveCurve(nothing, {"s": S}, end=1e-4, normal_stiffness=K),
            "traction should return a number .* returns none",
        ),
        (
            lambda: xf.laws.CohesiveCurve(kinked, end=1e-4, normal_stiffness=K),
            r"traction should be a function of \(x\), .* got one of \(x, strength\)",
        ),
        (
            lambda: xf.laws.CohesiveCurve(kinked, {"s": S}, end=lambda: 1.0, normal_stiffness=K),
            r"end should be a function of \(s\), .* got one of \(\)",
        ),
        (
            lambda: xf.laws.CohesiveCurve(kinked, {"s": S}, end="wide", normal_stiffness=K),
            "end should be a number, got 'wide'",
        ),
        (
            lambda: xf.laws.CohesiveCurve(
                kinked, {"s": S}, end=1e-4, normal_stiffness=K, kinks=(5e-5, 3.3e-5)
            ),
            "kinks should rise, got 5e-05 m and then 3.3e-05 m",
        ),
        (lambda: xf.laws.CohesiveCurve(([0.0, 1e-5, 1e-5], [0.0, 1.0, 0.0])), "entries 1 and 2"),
        (lambda: xf.laws.CohesiveCurve(([0.0, 1e-5], [1.0, -1.0])), "got -1.0 Pa, entry 1"),
        (lambda: xf.laws.CohesiveCurve(([0.0, 1e-5], [1.0, 1.0, 0.0])), "as many, two or more"),
    ],
)
def test_bad_curves_are_refused(make, words):
    with pytest.raises((TypeError, ValueError), match=words):
        make()


@pytest.mark.parametrize("curve", FREE, ids=repr)
def test_the_opening_of_a_damage_is_found(curve):
    """The inverse of g, from the first loss to the last."""
    damage, _, _, opening_with = damage_functions(curve.functions)
    shape = tuple(map(float, zone(curve).shape()))
    assert opening_with(1.0, shape) == shape[0]
    assert opening_with(0.0, shape) == shape[1]
    for share in (1.0 - 1e-12, 0.999, 0.7, 0.2, 1e-2, 1e-4, 1e-8):
        x = opening_with(share, shape)
        if x < shape[1]:
            assert damage(x, shape, 1.0) == pytest.approx(share, rel=1e-9)
        else:
            assert damage(shape[1] * (1.0 - 1e-9), shape, 1.0) >= share
