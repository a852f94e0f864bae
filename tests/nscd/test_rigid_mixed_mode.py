# SPDX-License-Identifier: LGPL-3.0-or-later
"""Initially rigid bonds with strengths and energies of their own in opening and in shear."""

from __future__ import annotations

import numpy as np
import pytest
from point_mass import PointMass

import xper_fx as xf

curves = xf.laws.curves
# strengths (Pa), energies (J/m^2), exponent, area
S_N, S_T, W_N, W_T, M, AREA = 3e6, 5e6, 100.0, 400.0, 1.7, 1e-2
LARGE = W_T * AREA
POWER, BENZEGGAGH = "power", "benzeggagh-kenane"
# Each curve, criterion and dimension beside some of the others: each combination is compiled.
CASES = [
    (2, curves.Linear(), POWER),
    (3, curves.Linear(), BENZEGGAGH),
    (2, curves.Parabolic(), BENZEGGAGH),
    (2, curves.Petersson(), POWER),
    (3, curves.Exponential(), POWER),
]
ANGLES = (0.0, 0.3, 0.9, 1.4, np.pi / 2)
each_dim = pytest.mark.parametrize("dim", [2, 3])


def law(**options):
    return xf.laws.RigidMixedMode((S_N, S_T), (W_N, W_T), **{"exponent": M} | options)


def along(angle, dim):
    """A direction with an angle to the normal."""
    shear = [np.sin(angle)] if dim == 2 else [0.6 * np.sin(angle), -0.8 * np.sin(angle)]
    return np.array([np.cos(angle), *shear])


def share_of_shear(angle):
    shear = (S_T * np.sin(angle)) ** 2
    return shear / ((S_N * np.cos(angle)) ** 2 + shear)


def torn(bond, step):
    """Energies until it is broken, summed."""
    total = np.zeros(6)
    while bond.damage > 0.0:
        energies = np.array(bond.step(step))
        assert energies[1] >= -1e-12 * LARGE
        total += energies
    return total


@pytest.mark.parametrize(("dim", "curve", "criterion"), CASES, ids=repr)
def test_a_mixture_spends_its_energy_at_any_step(dim, curve, criterion):
    for angle in ANGLES:
        b = share_of_shear(angle)
        if criterion == POWER:
            wanted = (((1.0 - b) / W_N) ** M + (b / W_T) ** M) ** (-1.0 / M)
        else:
            wanted = W_N + (W_T - W_N) * b**M
        for step in (1e-3, 3e-5, 4e-6):
            mixed = law(curve=curve, criterion=criterion)
            total = torn(PointMass(mixed, np.inf, along(angle, dim), area=AREA), step)
            assert total[1] == pytest.approx(wanted * AREA, rel=1e-12)
            assert abs(total[4]) < 1e-12 * LARGE


@each_dim
@pytest.mark.parametrize("angle", ANGLES)
def test_tractions_start_where_the_jump_is_normal_to_the_ellipse(dim, angle):
    """And fall on a straight line: Camacho and Ortiz, with an energy for each mixture."""
    b, direction = share_of_shear(angle), along(angle, dim)
    strength = np.hypot(S_N * np.cos(angle), S_T * np.sin(angle))
    start = np.r_[S_N**2 * direction[0], S_T**2 * direction[1:]] / strength
    assert (start[0] / S_N) ** 2 + start[1:] @ start[1:] / S_T**2 == pytest.approx(1.0)
    end = 2.0 * (W_N + (W_T - W_N) * b**M) / strength
    bond, h, x0 = PointMass(law(), np.inf, direction, area=AREA), 1e-6, 0.0
    for _ in range(40):
        bond.step(h)
        x1 = bond.jump @ direction
        mean = (1.0 - 0.5 * (x0 + x1) / end) * start
        np.testing.assert_allclose(bond.impulse / (-h * AREA), mean, rtol=1e-9, atol=1e-6 * S_N)
        x0 = x1
    assert x1 > 0.1 * end


@each_dim
@pytest.mark.parametrize("angle", [*ANGLES, 2.0, 2.8])
def test_a_sound_bond_bears_what_is_within_the_ellipse_or_pressed(dim, angle):
    mu, h = 0.4, 1e-6
    pull = along(angle, dim) * [S_N, *[S_T] * (dim - 1)]
    if pull[0] < 0.0:
        pull[1:] *= (S_T - mu * pull[0]) / np.linalg.norm(pull[1:])
    bond = PointMass(law(friction=mu), 2.0, np.zeros(dim), area=AREA)
    bond.step(h, (1.0 - 1e-9) * pull * AREA)
    assert np.abs(bond.jump).max() < 1e-22
    assert bond.impulse == pytest.approx(-(1.0 - 1e-9) * pull * AREA * h, rel=1e-12)
    over = 1e-4 * np.r_[max(pull[0], 0.0), pull[1:]]
    bond.step(h, (pull + over) * AREA)
    assert np.abs(bond.jump).max() > 1e-15
    assert bond.damage < 1.0


@each_dim
def test_random_loads_dissipate_and_close_the_balance(dim):
    rng, length = np.random.default_rng(11), 2.0 * W_N / S_N
    for viscosity, criterion in ((0.0, "power"), (0.0, "benzeggagh-kenane"), (2e5, "power")):
        mixed = law(friction=0.4, criterion=criterion, viscosity=viscosity)
        for _ in range(4):
            bond, stored = PointMass(mixed, 2.0 * W_N * AREA, np.zeros(dim), area=AREA), 0.0
            while bond.damage > 0.0:
                h = length * rng.choice([0.03, 0.2, 0.7])
                before, start = bond.kinetic, bond.jump.copy()
                force = rng.normal(size=dim) * 2.5 * S_N * AREA
                energies = np.array(bond.step(h, force))
                assert energies[[1, 2, 3, 5]].min() >= -1e-12 * LARGE
                assert energies[4] >= -1e-9 * LARGE
                lost = force @ (bond.jump - start) + before - bond.kinetic + stored - energies[0]
                assert lost == pytest.approx(energies[1:].sum(), abs=1e-11 * LARGE)
                stored = energies[0]


@each_dim
def test_an_open_bond_pulls_along_its_mean_opening_by_both_stiffnesses(dim):
    """Impulse over mean opening in shear is (S_T / S_N)^2 times that along the normal."""
    rng, seen = np.random.default_rng(5), 0
    couples = np.eye(dim) + 0.3 * (np.ones((dim, dim)) - np.eye(dim))
    for _ in range(6):
        bond = PointMass(law(), 2.0 * W_N * AREA, np.zeros(dim), area=AREA, couples=couples)
        while bond.damage > 0.0:
            h, start = 2.0 * W_N / S_N * rng.choice([0.03, 0.2]), bond.jump.copy()
            bond.step(h, rng.normal(size=dim) * 2.5 * S_N * AREA)
            mean, pull = 0.5 * (start + bond.jump), -bond.impulse
            if min(start[0], bond.jump[0]) > 1e-9 and bond.damage > 0.0:  # no contact
                ratio = (S_T / S_N) ** 2 * mean[1:] * pull[0]
                assert pull[1:] * mean[0] == pytest.approx(ratio, rel=1e-9)
                seen += 1
    assert seen > 20


def test_turning_jumps_never_heal():
    """Half opened, then turned into shear and back: damage falls where the curve there is lower."""
    driven, h = PointMass(law(), np.inf, [0.0, 0.0], area=AREA), 1e-6
    length, damage, total = 2.0 * W_N / S_N, 1.0, np.zeros(6)
    for n in range(200):
        turned = np.abs(np.sin(0.05 * n))
        wanted = (0.2 + 0.002 * n) * length * np.array([1.0 - turned, turned])
        before = driven.interactions.gather("velocity")[0]
        driven.velocity[0] = 2.0 * (wanted - driven.jump) / h - before
        energies = np.array(driven.step(h))
        assert energies[1] >= -1e-12 * LARGE
        assert driven.damage <= damage
        damage, total = driven.damage, total + energies
        np.testing.assert_allclose(driven.jump, wanted, atol=1e-12 * length)
    assert 0.2 * W_N * AREA < total[1] < W_T * AREA


def test_with_equal_modes_it_is_the_law_of_one_strength():
    one = xf.laws.RigidCohesiveZone(S_N, W_N, friction=0.2, viscosity=1e5)
    equal = xf.laws.RigidMixedMode(
        (S_N, S_N), (W_N, W_N), 1.3, friction=0.2, viscosity=1e5
    )  # fmt: skip
    rng = np.random.default_rng(2)
    bonds = [PointMass(kind, 40.0 * W_N * AREA, [0.3, 0.4], area=AREA) for kind in (one, equal)]
    while bonds[0].damage > 0.0:
        force = rng.normal(size=2) * S_N * AREA
        energies = [bond.step(4e-6, force) for bond in bonds]
        np.testing.assert_allclose(energies[0], energies[1], atol=1e-12 * W_N * AREA)
        np.testing.assert_allclose(bonds[0].jump, bonds[1].jump, rtol=1e-10, atol=1e-16)
    assert bonds[1].damage == 0.0


@pytest.mark.parametrize(("angle", "strength", "energy"), [(0.0, S_N, W_N), (np.pi / 2, S_T, W_T)])
def test_lips_are_dragged_in_both_modes(angle, strength, energy):
    """T + eta g v: g is the share that pure opening would have left with the same secant."""
    eta, h, v = 3e5, 1e-6, 2.0
    bond = PointMass(law(viscosity=eta), np.inf, v * along(angle, 2), area=AREA)
    x0, end, total = 0.0, 2.0 * energy / strength, np.zeros(6)
    for _ in range(25):
        total += bond.step(h)
        x1 = bond.jump @ along(angle, 2)
        mean = strength * (1.0 - 0.5 * (x0 + x1) / end)
        secant = mean / (0.5 * (x0 + x1)) * (S_N / strength) ** 2  # of pure opening
        share = secant / (secant + S_N**2 / (2.0 * W_N))
        pulled = -bond.impulse @ along(angle, 2) / (h * AREA)
        assert pulled == pytest.approx(mean + eta * share * (x1 - x0) / h, rel=1e-7)
        x0 = x1
    assert 0.1 * end < x1 < end
    assert abs(total[4]) < 1e-12 * LARGE


def test_the_smallest_strength_is_what_a_vertex_may_count_on():
    assert law().least_strength == S_N
    assert xf.laws.RigidMixedMode((5.0, 3.0), (1.0, 1.0), 1.0).least_strength == 3.0


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: xf.laws.RigidMixedMode(S_N, (W_N, W_T), M), "strengths should be a pair"),
        (lambda: xf.laws.RigidMixedMode((0.0, S_T), (W_N, W_T), M), r"strengths\[0\] should be"),
        (lambda: xf.laws.RigidMixedMode((S_N, S_T), (W_N, np.inf), M), r"energies\[1\] should be"),
        (lambda: law(exponent=0.0), "exponent should be a finite number above zero"),
        (lambda: law(criterion="linear"), 'criterion should be "benzeggagh-kenane" or "power"'),
        (lambda: law(curve=curves.XuNeedleman()), "stiffness of its own"),
        (lambda: law(curve=curves.Linear), "curve should be one of"),
        (lambda: law(friction_grows=1), "friction_grows"),
        (lambda: law(restitution=1.5), r"restitution should lie in \[0, 1\]"),
        (lambda: law(viscosity=-1.0), "viscosity should be a finite number"),
        (
            lambda: xf.laws.RigidMixedMode((1e300, 1.0), (1e-300, 1.0), M),
            "beyond the range of floats",
        ),
    ],
)
def test_bad_input_is_refused(make, words):
    with pytest.raises((TypeError, ValueError), match=words):
        make()


def test_no_mean_traction_leaves_the_ellipse():
    """Forces just beyond the strength, one after the other in another direction each time.

    A bond that was held opens by what tolerances leave, and then opens in another mode.
    """
    random = np.random.default_rng(0)
    weak, mass = xf.laws.RigidMixedMode((S_N, 0.3 * S_N), (W_N, 9.0 * W_N), M), 8.0 * W_N * AREA
    first = 0
    for _ in range(100):
        bond = PointMass(weak, mass, [0.0, 0.0], area=AREA)
        step = W_N / S_N / 50.0
        while bond.opening_max == 0.0:
            force = random.normal(size=2) * (1.0, 0.3) * S_N * AREA
            limit = np.hypot(max(force[0], 0.0) / S_N, force[1] / (0.3 * S_N)) / AREA
            bond.step(step, force / limit * (1.0 + 10.0 ** random.uniform(-9.0, -3.0)))
            pulled = -bond.impulse[0] / (step * AREA), -bond.impulse[1] / (step * AREA)
            used = np.hypot(max(pulled[0], 0.0) / S_N, pulled[1] / (0.3 * S_N))
            assert used <= 1.0 + 1e-6
            first += bond.opening_max > 0.0
    assert first == 100
