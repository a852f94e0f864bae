# SPDX-License-Identifier: LGPL-3.0-or-later
"""Initially rigid bonds, one at a time."""

from __future__ import annotations

import numpy as np
import pytest
from point_mass import PointMass

import xper_fx as xf
from xper_fx.nscd.laws.softening import snap_number

curves = xf.laws.curves
W, S, AREA = 100.0, 3e6, 1e-2
SPENT = W * AREA
CURVES = (
    curves.Linear(), curves.Parabolic(), curves.Petersson(), curves.Trapezoidal(),
    curves.Exponential(),
)  # fmt: skip
each_curve = pytest.mark.parametrize("curve", CURVES, ids=repr)


def law(curve=CURVES[0], **options):
    return xf.laws.RigidCohesiveZone(S, W, curve=curve, **options)


@each_curve
@pytest.mark.parametrize(
    ("steps", "theta"), [(0.2, 0.5), (3.0, 0.5), (3.0, 0.8), (3.0, 1.0), (50.0, 0.5)]
)
@pytest.mark.parametrize("angle", [0.0, 1.0, np.pi / 2])
def test_a_bond_torn_by_inertia_spends_its_energy_at_any_step(curve, steps, theta, angle):
    """W of its energy is lost by a mass, whatever step, theta and direction."""
    bond = PointMass(
        law(curve), 8.0 * SPENT, [np.cos(angle), np.sin(angle)], area=AREA, theta=theta
    )
    before, total, length = bond.kinetic, np.zeros(6), W / S
    for _ in range(8 + int(1.5 * steps * law(curve).critical_opening / length)):
        energies = np.array(bond.step(length / steps))
        assert energies[1] >= -1e-14 * SPENT
        total += energies
    assert bond.damage == 0.0
    assert total[1] == pytest.approx(SPENT, rel=1e-12)
    if theta == 0.5:
        assert before - bond.kinetic == pytest.approx(SPENT, rel=1e-10)


def test_in_space_a_bond_spends_its_energy_in_any_direction():
    for velocity in ([1.0, 0.0, 0.0], [0.6, 0.0, 0.8], [0.0, -0.8, 0.6], [0.3, 0.2, -0.1]):
        bond = PointMass(law(), 80.0 * SPENT, velocity, area=AREA)
        total = sum(bond.step(W / S / 7.0)[1] for _ in range(160))
        assert bond.damage == 0.0
        assert total == pytest.approx(SPENT, rel=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_sound_bond_does_not_move_up_to_its_strength(dim):
    direction = np.array([0.6, 0.8, 0.0])[:dim]
    bond = PointMass(law(), 2.0, np.zeros(dim), area=AREA)
    force = S * AREA * direction
    for share in (0.5, -0.3, 1.0 - 1e-9):
        bond.step(1e-6, share * force)
        assert np.abs(bond.velocity).max() < 1e-17
        assert np.abs(bond.jump).max() < 1e-22
        assert bond.impulse == pytest.approx(-share * force * 1e-6, rel=1e-12)
        assert bond.damage == 1.0
    bond.step(1e-6, 1.0001 * force)
    assert 0.0 < bond.interactions.gather("spent")[0] < 1e-4
    assert bond.jump @ direction > 0.0


@pytest.mark.parametrize(("opened", "spent"), [(1e-9, 0.0), (1e-3, 2e-3)])
def test_a_bond_that_sweeps_leave_open_is_booked_as_open(opened, spent):
    """Its impulse could hold it; lips that are apart by more than a tolerance are no longer sound.

    With a linear curve an opening of x dc spends x (2 - x) of the energy once the bond unloads.
    """
    bond, h = PointMass(law(), 2.0, [0.0, 0.0], area=AREA), 1e-6
    bond.step(h, np.array([0.5 * S * AREA, 0.0]))
    bond.interactions.begin_step(h, 0.5)
    v = np.array([2.0 * opened * law().critical_opening / h, 0.0, 0.0, 0.0])
    energies = bond.interactions.commit(v)
    assert bond.opening_max == pytest.approx(opened * law().critical_opening if spent else 0.0)
    left = sum(energies[:2])  # stored and spent
    assert left == pytest.approx(spent * SPENT, rel=2e-3, abs=1e-15)


def test_a_bond_at_rest_books_nothing_until_it_is_prepared_again():
    """What its last step booked is not booked again, and its lips stay one for this step alone."""
    bond = PointMass(law(), 2.0, [1.0, 0.0], area=AREA)
    (group,), v = bond.interactions.groups, np.array([1.0, 0.0, 0.0, 0.0])
    bond.interactions.begin_step(1e-6, 0.5)
    group.kernels.rigid.rest(0, group.details)
    group.energy[:], group.status[:] = 1.0, 0
    assert not np.any(bond.interactions.commit(v))
    assert not np.any(group.energy) and not np.any(group.jump)
    assert group.status[0] == 1
    bond.interactions.begin_step(1e-6, 0.5)
    assert bond.interactions.commit(v).cohesion > 0.0
    assert group.jump[0, 0] > 0.0


@pytest.mark.parametrize("theta", [0.5, 0.75, 1.0])
def test_no_traction_exceeds_the_strength(theta):
    """A heavy mass opens the bond in small steps: tractions are means of the curve."""
    bond = PointMass(law(), 1e3 * SPENT, [1.0, 0.0], area=AREA, theta=theta)
    h, dc, x0 = 1e-6, law().critical_opening, 0.0
    for _ in range(30):
        work = bond.step(h)
        x1 = bond.jump[0]
        # at U_m = (x0 + x1) / 2 on a straight line; the first is its mean from 0 to x1
        mean = S * (1.0 - 0.5 * (x0 + x1) / dc)
        assert -bond.impulse[0] / (h * AREA) == pytest.approx(mean, rel=1e-7)
        assert abs(work[4]) < 1e-12 * SPENT
        x0 = x1
    assert 0.1 * dc < x1 < dc


def test_under_pressure_friction_helps_the_bond():
    """|R_T| <= s + mu |R_N| before it slips; then s is lost, and friction stays."""
    mu, pressed = 0.5, 4.0 * S * AREA
    bond = PointMass(law(friction=mu), 2.0, [0.0, 0.0], area=AREA)
    bound = S * AREA + mu * pressed
    bond.step(1e-6, [-pressed, 0.999999 * bound])
    assert np.abs(bond.jump).max() < 1e-22
    for _ in range(400):
        work = bond.step(1e-6, [-pressed, 1.01 * bound])
        assert bond.jump[0] == pytest.approx(0.0, abs=1e-7)
        assert work[2] >= 0.0 and work[1] >= 0.0
    assert bond.damage == 0.0
    assert bond.impulse == pytest.approx([1e-6 * pressed, -1e-6 * mu * pressed], rel=1e-9)
    grows = PointMass(law(friction=mu, friction_grows=True), 2.0, [0.0, 0.0], area=AREA)
    grows.step(1e-6, [-pressed, 1.001 * S * AREA])
    assert grows.jump[1] > 0.0


@pytest.mark.parametrize("theta", [0.5, 0.8])
@pytest.mark.parametrize("mass", [3e-4, 5e-5])
def test_the_snap_number_tells_whether_a_bond_has_one_state(theta, mass):
    """Pulled a little above s a mass on a linear curve has one while h^2 theta A s < 2 m dc."""
    h, dc = 1e-6, law().critical_opening
    bond = PointMass(law(), mass, [0.0, 0.0], area=AREA, theta=theta)
    bond.step(h, [0.9 * S * AREA, 0.0])
    assert snap_number(bond.interactions, theta) == 0.0
    bond.step(h, [1.01 * S * AREA, 0.0])
    number = snap_number(bond.interactions, theta)
    assert number == pytest.approx(0.5 * theta * h**2 * AREA / mass * S / dc, rel=1e-8)
    if number < 1.0:  # y = b + W r with a falling r
        moved = 0.01 * S * AREA * h**2 * theta / mass / (1.0 - number)
        assert bond.jump[0] == pytest.approx(moved, rel=1e-5)
    else:
        assert bond.damage == 0.0


def test_the_peak_tends_to_the_strength_with_the_step():
    """Under a rising load no mean traction is above the strength, nor below what a step adds."""
    rate = 3.3e13
    for h in (2e-9, 1e-9, 5e-10):
        bond = PointMass(law(), 1e-3, [0.0, 0.0], area=AREA)
        peak, n = 0.0, 0
        while bond.damage == 1.0:
            n += 1
            bond.step(h, [rate * n * h * AREA, 0.0])
            peak = max(peak, -bond.impulse[0] / (h * AREA))
        assert 0.0 <= 1.0 - peak / S <= rate * h / S


@pytest.mark.parametrize("share", [1.0, 1.5, 5.0, 100.0, 1e5])
def test_a_bond_that_opens_by_little_bears_its_strength(share):
    """Its mean traction rises to s up to twice d0 = 1e-9 w / s, then it is a rigid curve's."""
    h, d0 = 1e-6, 1e-9 * W / S
    x, dc = share * d0, 2.0 * W / S - d0
    bond = PointMass(law(), np.inf, [x / h, 0.0], area=AREA)
    bond.step(h)
    borne = 0.5 * share if share < 2.0 else 1.0 - 0.5 * (x - d0) ** 2 / (x * (dc - d0))
    assert -bond.impulse[0] / (h * AREA) == pytest.approx(borne * S, rel=1e-12)
    assert bond.damage < 1.0 or share == 1.0


@pytest.mark.parametrize("snap", [0.3, 0.99, 1.5, 12.0, 1e4])
@pytest.mark.parametrize("over", [1e-3, 1.0, 30.0])
def test_a_bond_that_opens_has_the_least_damaged_state(snap, over):
    """A force beyond the strength acts on a mass at rest, with a linear curve.

    Of 2 m x / h^2 + A T(x) = F, T the mean of the curve from 0 to x, the least x is in closed form:
    on the slope if the snap number is below 1, beyond it otherwise.
    """
    h, dc = 1e-6, law().critical_opening
    mass = h**2 * AREA * S / (4.0 * dc * snap)
    bond = PointMass(law(), mass, [0.0, 0.0], area=AREA)
    force, inertia = (1.0 + over) * S * AREA, 2.0 * mass / h**2
    opening = over * S * AREA / (inertia - 0.5 * S * AREA / dc)
    if not 0.0 < opening < dc:
        opening = (force + np.sqrt(force**2 - 4.0 * inertia * SPENT)) / (2.0 * inertia)
    bond.step(h, [0.6 * force, 0.8 * force])
    # a bond is next to rigid, which its least opening shows
    assert bond.jump == pytest.approx(opening * np.array([0.6, 0.8]), rel=1e-5, abs=0.0)


def test_a_bond_that_may_hold_or_break_in_a_long_step_holds():
    """Once weakened it could bear the force as it is, or be torn by it: its snap number is 100."""
    h, dc = 1e-6, law().critical_opening
    mass = h**2 * AREA * S / (4.0 * dc * 100.0)
    bond = PointMass(law(), mass, [0.2 * dc / (1e-3 * h), 0.0], area=AREA)
    bond.step(1e-3 * h)
    damage, opening = bond.damage, bond.opening_max
    assert 0.1 * dc < opening < 0.3 * dc
    bond.velocity[:] = bond.interactions.groups[0].velocity[:] = 0.0
    bond.step(h, [0.7 * S * AREA, 0.0])
    assert (bond.damage, bond.opening_max) == (damage, opening)


@pytest.mark.parametrize("snap", [0.3, 1e3, 1e5])
@pytest.mark.parametrize("angle", [0.0, 1.0])
def test_friction_that_grows_holds_a_bond_that_begins_to_slip(snap, angle):
    """Sheared by more than s, of which mu |R_N| bears the rest at once, but could not bear all."""
    h, mu, share = 1e-6, 0.5, 0.3
    mass = h**2 * AREA * S / (4.0 * law().critical_opening * snap)
    bond = PointMass(law(friction=mu, friction_grows=True), mass, np.zeros(3), area=AREA)
    pressed = S * AREA
    sheared = S * AREA + share * mu * pressed
    force = np.array([-pressed, sheared * np.cos(angle), sheared * np.sin(angle)])
    bond.step(h, force)
    assert bond.impulse == pytest.approx(-h * force, rel=1e-6, abs=1e-12 * h * pressed)
    assert 0.0 < bond.opening_max < 1e-7 * law().critical_opening
    assert 0.0 < bond.damage <= 1.0 - share


@pytest.mark.parametrize("snap", [0.3, 1e2, 1e5])
def test_a_drag_holds_a_bond_that_begins_to_open(snap):
    """s (1 + eta v / s) bears the force at an opening that is small; beyond, the bond is torn."""
    h, dc, over = 1e-6, law().critical_opening, 0.5
    mass = h**2 * AREA * S / (4.0 * dc * snap)
    eta = over * S * h / (1e-2 * dc)
    bond = PointMass(law(viscosity=eta), mass, [0.0, 0.0], area=AREA)
    bond.step(h, [(1.0 + over) * S * AREA, 0.0])
    opening = over * S / (eta / h + 2.0 * mass / (h**2 * AREA))
    assert bond.jump[0] == pytest.approx(opening, rel=0.05)


@pytest.mark.parametrize("restitution", [0.0, 0.4, 1.0])
def test_broken_lips_rebound_by_their_restitution(restitution):
    bond = PointMass(law(restitution=restitution), 8.0 * SPENT, [1.0, 0.3], area=AREA)
    while bond.damage > 0.0:
        bond.step(1e-5)
    bond.velocity[0, 0] = speed = -0.8
    total = np.zeros(6)
    before = bond.kinetic
    bond.step(1e-5)  # the jump in velocity is not of the step before
    while bond.velocity[0, 0] < -1e-9:
        total += bond.step(1e-5)
    assert bond.velocity[0] == pytest.approx([-restitution * speed, 0.28], abs=0.02)
    assert before - bond.kinetic == pytest.approx(total[3], rel=1e-9, abs=1e-9 * SPENT)
    assert total[3] == pytest.approx(
        0.5 * bond.masses[0] * (1.0 - restitution**2) * speed**2, abs=1e-9 * SPENT
    )


@pytest.mark.parametrize(("along", "left"), [(0.2, 0.0), (2.0, 2.0 - 0.3 * 1.5 * 0.8)])
def test_broken_lips_that_strike_aslant_stick_or_slide(along, left):
    """At velocity level Coulomb's impulse stops the slip, or takes mu (1 + e) of the approach."""
    bond = PointMass(law(friction=0.3, restitution=0.5), 8.0 * SPENT, [1.0, 0.0], area=AREA)
    while bond.damage > 0.0:
        bond.step(1e-5)
    bond.velocity[0] = [-0.8, along]
    while bond.velocity[0, 0] < 0.0:
        bond.step(1e-5)
    assert bond.velocity[0] == pytest.approx([0.4, left], abs=1e-12)


def test_unloading_follows_the_secant_and_what_is_left_is_spent():
    dc = law().critical_opening
    driven, total, h = PointMass(law(), np.inf, [0.0, 0.0], area=AREA), np.zeros(6), 1e-3
    for opening in (0.25 * dc, 0.5 * dc, 0.2 * dc, 0.4 * dc, 1.1 * dc):
        before = driven.interactions.gather("velocity")[0, 0]
        driven.velocity[0, 0] = 2.0 * (opening - driven.jump[0]) / h - before
        total += driven.step(h)
        if opening == 0.2 * dc:
            # mean of the secant's tractions at both ends
            mean = S * 0.5 * (0.5 + 0.2)
            assert driven.impulse[0] / (h * AREA) == pytest.approx(-mean, rel=1e-8)
    assert driven.damage == 0.0
    assert total[1] == pytest.approx(SPENT, rel=1e-12)


def test_random_loads_dissipate_at_every_step():
    rng = np.random.default_rng(5)
    bond = PointMass(law(friction=0.4), 2.0 * SPENT, [0.0, 0.0], area=AREA)
    dc = law().critical_opening
    for _ in range(400):
        bond.velocity += rng.normal(size=2) * 0.3
        energies = np.array(bond.step(dc * rng.choice([0.03, 0.2, 0.7])))
        assert energies[1:4].min() >= -1e-12 * SPENT
        assert energies[4] >= -1e-9 * SPENT


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: xf.laws.RigidCohesiveZone(0.0, W), "strength should be a finite number above"),
        (lambda: xf.laws.RigidCohesiveZone(np.inf, W), "strength should be a finite number"),
        (lambda: xf.laws.RigidCohesiveZone(S, -1.0), "fracture_energy should be"),
        (lambda: law(curves.XuNeedleman()), "stiffness of its own"),
        (lambda: law(curves.Linear), "curve should be one of"),
        (lambda: law(friction_grows=1), "friction_grows"),
        (lambda: law(restitution=1.5), r"restitution should lie in \[0, 1\]"),
        (lambda: xf.laws.RigidCohesiveZone(1e300, 1e-300), "beyond the range of floats"),
    ],
)
def test_bad_input_is_refused(make, words):
    with pytest.raises((TypeError, ValueError), match=words):
        make()
