# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bonds with strengths and energies of their own in opening and in shear."""

from __future__ import annotations

import numpy as np
import pytest
from point_mass import PointMass

import xper_fx as xf

curves = xf.laws.curves

# A laminate (AS4/PEEK) with bonds softer than a user's, so that the elastic part counts.
C_N, C_T = 2e13, 0.8e13
S_N, S_T = 80e6, 100e6
G_I, G_II, ETA = 969.0, 1719.0, 2.284
AREA = 1e-4
CURVES = (
    curves.Linear(), curves.Parabolic(), curves.Exponential(), curves.Petersson(),
    curves.Trapezoidal(0.5),
)  # fmt: skip
each_curve = pytest.mark.parametrize("curve", CURVES, ids=repr)


def bond(**options):
    options = {"tangential_stiffness": C_T} | options
    return xf.laws.MixedMode(C_N, (S_N, S_T), (G_I, G_II), ETA, **options)


def share_of_shear(angle):
    n, t = C_N * np.cos(angle) ** 2, C_T * np.sin(angle) ** 2
    return t / (n + t)


def energy(share, criterion):
    if criterion == "power":
        return (((1 - share) / G_I) ** ETA + (share / G_II) ** ETA) ** (-1 / ETA)
    return G_I + (G_II - G_I) * share**ETA


def tear(law, angle, steps, dim=2, theta=0.5):
    """Tractions and energies of a bond torn at constant speed by a heavy mass."""
    velocity = np.zeros(dim)
    velocity[0], velocity[1] = np.cos(angle), np.sin(angle)
    if dim == 3:
        velocity[1:] = np.sin(angle) * np.array([0.6, 0.8])
    point = PointMass(law, 1e14 * G_II * AREA, velocity, area=AREA, theta=theta)
    step = 4.0 * G_II / S_N / steps
    tractions, energies = [], []
    for _ in range(40 * steps):
        energies.append(point.step(step))
        tractions.append(-point.impulse / step / AREA)
        if point.damage == 0.0:
            break
    return np.array(tractions), np.array(energies)


@each_curve
@pytest.mark.parametrize("criterion", ["benzeggagh-kenane", "power"])
@pytest.mark.parametrize("angle", [0.0, 0.4, 1.0, 1.4, np.pi / 2])
@pytest.mark.parametrize("steps", [3, 40])
def test_a_straight_path_spends_what_its_mixture_costs(curve, criterion, angle, steps):
    _, energies = tear(bond(curve=curve, criterion=criterion), angle, steps)
    spent = energies[:, 1].sum() / AREA
    assert spent == pytest.approx(energy(share_of_shear(angle), criterion), rel=1e-10)
    assert energies[:, 1].min() >= -1e-12 * G_II * AREA


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("angle", [0.0, 0.5, 1.1, np.pi / 2])
def test_damage_begins_on_the_quadratic_criterion(angle, dim):
    tractions, _ = tear(bond(), angle, 4000, dim)
    t_n = tractions[:, 0]
    t_t = np.linalg.norm(tractions[:, 1:], axis=1)
    criterion = (np.maximum(t_n, 0.0) / S_N) ** 2 + (t_t / S_T) ** 2
    assert criterion.max() == pytest.approx(1.0, abs=0.02)
    peak = np.argmax(criterion)
    assert t_t[peak] * np.cos(angle) / C_T == pytest.approx(
        t_n[peak] * np.sin(angle) / C_N, abs=1e-6 * S_T / C_T
    )


def test_equal_modes_are_a_cohesive_zone():
    """In any direction, over a path that turns, unloads and goes on."""
    same = xf.laws.MixedMode(C_N, (S_N, S_N), (G_I, G_I), 1.7)
    zone = xf.laws.CohesiveZone(C_N, G_I, S_N, curve=curves.Linear())
    rng = np.random.default_rng(3)
    kicks = rng.normal(size=(120, 2))
    paths = []
    for law in (same, zone):
        point = PointMass(law, 3.0 * G_I * AREA, [0.3, 0.1], area=AREA, theta=0.5)
        path = []
        for kick in kicks:
            point.velocity += 0.4 * kick
            point.step(0.4 * G_I / S_N)
            path.append([point.damage, *np.ravel(point.jump)])
        paths.append(np.array(path))
    scale = np.abs(paths[1]).max(axis=0)
    assert paths[1][:, 0].min() < 0.5
    assert np.abs(paths[0] - paths[1]).max(axis=0) / scale == pytest.approx(0.0, abs=1e-6)


def test_alfano_and_crisfield_is_a_case():
    """Exponent 2 of theirs: failure where the openings over the final ones have the norm 1."""
    c_t = C_N * (S_T / S_N) ** 2 * G_I / G_II  # both modes have one ratio of openings
    law = xf.laws.MixedMode(
        C_N, (S_N, S_T), (G_I, G_II), 1.0, criterion="power", tangential_stiffness=c_t
    )
    shape_along = law.weakening().shape
    parameters = np.array([law.parameters()], float)
    final = 2.0 * G_I / S_N, 2.0 * G_II / S_T
    onset = S_N / C_N, S_T / c_t

    @xf.njit
    def shape(jump):
        return shape_along(0, jump, parameters)

    for angle in (0.0, 0.3, 0.9, 1.5):
        n, t = np.cos(angle), np.sin(angle)
        d0, dc = shape((n, t))
        assert np.hypot(d0 * n / onset[0], d0 * t / onset[1]) == pytest.approx(1.0, rel=1e-12)
        assert np.hypot(dc * n / final[0], dc * t / final[1]) == pytest.approx(1.0, rel=1e-12)


@each_curve
@pytest.mark.parametrize("damage", ["mean", "lagged"])
@pytest.mark.parametrize("dim", [2, 3])
def test_random_paths_of_mixity_never_gain(curve, damage, dim):
    rng = np.random.default_rng(11)
    law = bond(curve=curve, damage=damage, friction=0.3)
    broke = 0
    for _ in range(6):
        point = PointMass(law, 2.0 * G_I * AREA, np.zeros(dim), area=AREA, theta=0.5)
        for _ in range(80):
            point.velocity += 0.5 * rng.normal(size=dim)
            old = point.damage
            energies = np.array(point.step(G_I / S_N * rng.choice([0.05, 0.3, 1.0])))
            assert energies[1:4].min() >= -1e-12 * G_I * AREA
            assert point.damage <= old
        broke += point.damage == 0.0
    assert broke >= 3


def test_shear_breaks_what_opening_has_worn():
    """Damage made in one mode is there in the other; what is left is spent along its curve."""
    law = bond(curve=curves.Linear())
    point = PointMass(law, 1e9, [1.0, 0.0], area=AREA, theta=0.5)
    opened = 0.5 * (S_N / C_N + 2 * G_I / S_N)
    for _ in range(50):
        point.step(opened / 50)
    beta = point.damage
    d0, dc = S_N / C_N, 2 * G_I / S_N
    assert beta == pytest.approx(d0 / opened * (dc - opened) / (dc - d0), rel=1e-9)
    point.velocity[:] = [-1.0, 0.0]
    for _ in range(50):
        point.step(opened / 50)
    assert point.damage == beta
    point.velocity[:] = [0.0, 1.0]
    spent = 0.0
    for _ in range(400):
        spent += point.step(2 * G_II / S_T / 200)[1]
    assert point.damage == 0.0
    d0, dc = S_T / C_T, 2 * G_II / S_T
    x = d0 * dc / (beta * (dc - d0) + d0)  # where the curve of shear has this damage
    assert spent / AREA == pytest.approx(G_II * (dc - x) / (dc - d0), rel=1e-3)


@pytest.mark.parametrize("steps", [3, 60])
def test_a_worn_bond_weakens_in_another_direction_below_its_largest_opening(steps):
    """Sheared to 23 um, then opened to 16 um: of the curve of opening less is left there."""
    point = PointMass(bond(curve=curves.Linear()), 1e14, [0.0, 1.0], area=AREA, theta=1.0)
    for _ in range(50):
        point.step(23e-6 / 50)
    worn = point.damage
    d0, dc = S_T / C_T, 2 * G_II / S_T
    assert worn == pytest.approx(d0 / 23e-6 * (dc - 23e-6) / (dc - d0), rel=1e-9)
    point.velocity[:] = [0.0, -1.0]
    for _ in range(50):
        point.step(23e-6 / 50)
    point.velocity[:] = [1.0, 0.0]
    spent = sum(point.step(16e-6 / steps)[1] for _ in range(steps))
    d0, dc = S_N / C_N, 2 * G_I / S_N
    assert point.damage == pytest.approx(d0 / 16e-6 * (dc - 16e-6) / (dc - d0), rel=1e-6)
    onset = d0 * dc / (worn * (dc - d0) + d0)
    assert spent / AREA == pytest.approx(G_I * (16e-6 - onset) / (dc - d0), rel=1e-6)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"criterion": "linear"}, "criterion should be"),
        ({"curve": curves.Tvergaard()}, "stiffness of its own"),
        ({"curve": curves.Linear}, "curve should be one of"),
        ({"tangential_stiffness": 1e12}, "With .* % of shear the fracture energy"),
        ({"tangential_stiffness": -1.0}, "tangential_stiffness should be"),
    ],
)
def test_bad_numbers_are_refused(options, words):
    with pytest.raises((TypeError, ValueError), match=words):
        bond(**options)


def test_pairs_are_pairs():
    with pytest.raises(TypeError, match="strengths should be a pair"):
        xf.laws.MixedMode(C_N, S_N, (G_I, G_II), ETA)
    with pytest.raises(ValueError, match=r"fracture_energies\[1\] should be a finite number above"):
        xf.laws.MixedMode(C_N, (S_N, S_T), (G_I, -1.0), ETA)
