# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bonds whose damage lags behind their curve, and the adhesion of Raous, Cangemi and Cocou."""

from __future__ import annotations

import numpy as np
import pytest
from point_mass import PointMass
from scenes import BOTTOM, LEFT, RIGHT, TOP, box_bodies
from scipy.integrate import solve_ivp

import xper_fx as xf
from xper_fx.nscd.laws.damage_curve import damage_functions
from xper_fx.nscd.laws.viscous_damage import lagging_damage

curves = xf.laws.curves

# k, C_T (Pa/m), w (J/m^2), s (Pa), b (J s/m^2): relaxation in b / (2 w), 50 us.
K, C_T, W, S, B = 1e12, 3e11, 100.0, 3e6, 1e-2
AREA = 1e-2
# The intensity of adhesion 1e-4 counts as none, and w is the area up to there.
THRESHOLD = W / (1.0 - 5e-5)
D0 = np.sqrt(THRESHOLD / K)


@xf.njit
def two_lines(x, strength, knee, end):
    if x < knee:
        return strength * (1.0 - 0.7 * x / knee)
    return 0.3 * strength * max(0.0, (end - x) / (end - knee))


def zone(curve=None, **options):
    curve = curves.Linear() if curve is None else curve
    stiffness = None if curve.own_stiffness(1.0, 1.0) is not None else K
    return xf.laws.CohesiveZone(stiffness, W, S, curve=curve, **options)


def kinked(**options):
    return xf.laws.CohesiveCurve(
        two_lines, {"strength": S, "knee": 2e-5, "end": 1e-4}, end=1e-4,
        kinks=lambda s, knee, end: (knee,), normal_stiffness=K, **options,
    )  # fmt: skip


def modes_apart(**options):
    return xf.laws.MixedMode(
        K, (S, 1.5 * S), (W, 2.0 * W), 1.6, tangential_stiffness=C_T, **options
    )


def adhesion(**options):
    return xf.laws.Adhesion(K, W, **options)


CURVES = (
    curves.Parabolic(), curves.Linear(), curves.Petersson(), curves.Trapezoidal(),
    curves.Exponential(), curves.XuNeedleman(), curves.Tvergaard(),
)  # fmt: skip
EVERY_CURVE = [
    *(pytest.param(lambda c=c: zone(c), id=type(c).__name__) for c in CURVES),
    pytest.param(kinked, id="function"),
    pytest.param(
        lambda: xf.laws.CohesiveCurve(([0.0, 2e-6, 3e-5, 9e-5], [0.0, 3e6, 1e6, 0.0])), id="table"
    ),
    pytest.param(adhesion, id="adhesion"),
]
EVERY_LAW = [pytest.param(law, id=law.__name__) for law in (zone, kinked, modes_apart, adhesion)]
each_law = pytest.mark.parametrize("make", EVERY_LAW)


def of_curve(make):
    """Shape of the curve, its functions, and what lags behind it."""
    law = make()
    curve = law.weakening().curve
    return tuple(map(float, law.shape())), damage_functions(curve), lagging_damage(curve)


# -- over a step


@pytest.mark.parametrize("make", EVERY_CURVE)
def test_whatever_the_path_a_step_pays_for_its_damage_and_its_viscosity(make):
    """Openings and viscosities at random: the equation holds, and what is lost is enough."""
    p, damage, lagging = of_curve(make)
    rng, broke = np.random.default_rng(7), 0
    for trial in range(60):
        beta0 = rng.choice([1.0, 0.6])
        x0, x_max, old = 0.0, p[0], beta0
        size = p[1] ** 2 * 10.0 ** rng.uniform(-7.0, 3.0)
        for _ in range(60):
            x1 = abs(x0 + rng.normal() * p[1] * 10.0 ** rng.uniform(-4.0, 0.0))
            q = size * 10.0 ** rng.uniform(-1.0, 1.0) if trial % 6 else 0.0
            x_c, m = lagging.followed(x0, x1, x_max, old / beta0, q, p)
            assert 0.0 <= m <= 1.0 and x_max <= x_c <= max(x0, x1, x_max)
            if x_c > x_max:
                new = min(old, damage.damage(x_c, p, beta0))
                mean = lagging.mean(x0, x1, x_max, x_c, old, new, m, p, beta0)
                assert new <= mean <= old
                lost = (old - mean) * x0**2 + (mean - new) * x1**2
                cost = 2.0 * (damage.dissipated(x_c, p, beta0) - damage.dissipated(x_max, p, beta0))
                assert cost >= -1e-15 * p[1] ** 2
                assert lost >= cost - 1e-15 * (p[1] + x0 + x1) ** 2
                if 1.001 * x_c < min(max(x0, x1), p[1]) and x0 >= x_max:
                    before, after = np.sqrt(old / beta0), np.sqrt(new / beta0)
                    pulls = m * after * (x1**2 - x_c**2)
                    pulls += (1.0 - m) * before * max(x0**2 - x_max**2, 0.0)
                    assert q * (before - after) == pytest.approx(pulls, abs=1e-9 * (q + x1**2))
                old, x_max = new, x_c
            x0 = x1
        broke += old == 0.0
    assert broke > 10


@pytest.mark.parametrize("make", EVERY_CURVE)
def test_without_viscosity_the_step_is_that_of_the_curve(make):
    p, damage, lagging = of_curve(make)
    for x0, x1 in ((0.3, 0.8), (0.999, 1.2), (1.5, 1.5 + 1e-7), (2.0, 2.5), (0.0, 400.0)):
        x0, x1 = (x * max(p[0], 1e-2 * p[1]) for x in (x0, x1))
        x_max = max(p[0], x0)
        old = damage.damage(x_max, p, 0.9) if x_max > 0.0 else 0.9
        x_c, m = lagging.followed(x0, x1, x_max, old / 0.9, 0.0, p)
        if x1 <= x_max:
            assert x_c == x_max
            continue
        new = damage.damage(x1, p, 0.9)
        assert damage.damage(x_c, p, 0.9) == pytest.approx(new, rel=1e-13)
        mean = lagging.mean(x0, x1, x_max, x_c, old, new, m, p, 0.9)
        exact = damage.mean_damage(x1, x0, x_max, old, p, 0.9)
        assert mean == pytest.approx(exact, rel=1e-8)


# -- against the differential equation


def driven(law, direction, steps, step, **options):
    """Intensities of adhesion, tractions and energies of a point that opens at 1 m/s."""
    point = PointMass(law, 1e14, direction, area=AREA, **options)
    intensities, tractions, energies = [], [], []
    for _ in range(steps):
        energies.append(point.step(step))
        intensities.append(np.sqrt(point.damage))
        tractions.append(np.linalg.norm(point.impulse) / step / AREA)
    return np.array(intensities), np.array(tractions), np.array(energies)


def intensity(stiffness, time, viscosity=B):
    """That of Raous, Cangemi and Cocou at times, for an opening at 1 m/s."""
    found = solve_ivp(
        lambda t, a: [-max(a[0] * stiffness * t * t - THRESHOLD, 0.0) / viscosity],
        (0.0, time[-1]), [1.0], "Radau", time, rtol=1e-10, atol=1e-13, max_step=time[-1] / 300,
    )  # fmt: skip
    return found.y[0]


@pytest.mark.parametrize("theta", [0.5, 1.0])
@pytest.mark.parametrize(("dim", "angle"), [(2, 0.0), (2, 0.8), (3, 1.4)])
def test_adhesion_obeys_its_equation_to_second_order(dim, angle, theta):
    law = adhesion(viscosity=B, tangential_stiffness=C_T)
    shear = np.array([1.0]) if dim == 2 else np.array([0.6, 0.8])
    direction = np.r_[np.cos(angle), np.sin(angle) * shear]
    stiffness = K * np.cos(angle) ** 2 + C_T * np.sin(angle) ** 2
    errors = []
    for steps in (50, 100, 200):
        step = 4.0 * D0 / steps
        found, _, energies = driven(law, direction, steps, step, theta=theta)
        exact = intensity(stiffness, step * np.arange(1, steps + 1))
        errors.append(np.abs(found - exact).max())
        # what adhesion costs is its loss; viscous work is b (da/dt)^2
        lost = energies.sum(axis=0) / AREA
        assert lost[1] == pytest.approx(THRESHOLD * (1.0 - found[-1]), rel=1e-11)
        speed = np.diff(np.r_[1.0, exact]) / step
        assert lost[5] == pytest.approx(B * step * (speed**2).sum(), rel=0.02)
        assert energies[:, 1:].min() >= -1e-15 * W * AREA
    assert 0.1 < exact[-1] < 0.8
    assert errors[-1] < 5e-5
    assert errors[0] / errors[2] > 11.0


@pytest.mark.parametrize("steps", [1, 5])
def test_adhesion_that_is_held_open_relaxes_exactly_in_any_step(steps):
    opening, duration = 3.0 * D0, 40e-6
    point = PointMass(adhesion(viscosity=B), np.inf, [1.0, 0.0], area=AREA, theta=1.0)
    point.step(opening)
    start = np.sqrt(point.damage)
    point.velocity[:] = 0.0
    for _ in range(steps):
        lost = np.array(point.step(duration / steps))
        assert lost[1] > 0.0 and lost[5] > 0.0
    energy = 0.5 * K * opening**2
    end = THRESHOLD / (2.0 * energy)
    assert point.jump[0] == pytest.approx(opening, rel=1e-12)
    exact = end + (start - end) * np.exp(-2.0 * energy * duration / B)
    assert start > 1.3 * exact
    assert np.sqrt(point.damage) == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("steps", [1, 2, 8])
def test_adhesion_that_closes_is_lost_until_its_energy_is_below_the_threshold(steps):
    """Opened at once to 3 d0, closed to d0 / 2 at 2 m/s: of second order, from a single step on."""
    opening, speed, duration = 3.0 * D0, 2.0, 1.25 * D0
    point = PointMass(adhesion(viscosity=B), np.inf, [1.0, 0.0], area=AREA, theta=1.0)
    point.step(opening)
    start = np.sqrt(point.damage)
    point.velocity[:] = [-speed, 0.0]
    for _ in range(steps):
        lost = point.step(duration / steps)
        # with theta = 1 the scheme takes d . beta C . d / 2, here from the pull of the bond
        pull, moved = -point.impulse[0] * steps / duration, speed * duration / steps
        assert lost.numerical == pytest.approx(0.5 * pull / point.jump[0] * moved**2, rel=1e-9)
    exact = solve_ivp(
        lambda t, a: [-max(a[0] * K * (opening - speed * t) ** 2 - THRESHOLD, 0.0) / B],
        (0.0, duration), [start], "Radau", rtol=1e-10, atol=1e-13, max_step=1e-7,
    ).y[0, -1]  # fmt: skip
    assert start - exact > 0.02
    assert start - np.sqrt(point.damage) == pytest.approx(start - exact, rel=0.6 / steps**2)


@pytest.mark.parametrize("curve", [curves.Linear(), curves.Tvergaard()], ids=repr)
def test_any_curve_lags_by_the_same_equation(curve):
    """b da/dt = -2 a (e - e_c), with e_c by inversion of the curve."""
    law = zone(curve, viscosity=B)
    p, functions = tuple(map(float, law.shape())), damage_functions(curve.functions)
    k, x = float(law.stiffnesses()[0]), np.linspace(p[0] + 1e-9 * p[1], p[1], 20001)
    share = np.sqrt([functions.damage(value, p, 1.0) for value in x])

    def rate(t, a):
        excess = t * t - np.interp(-a[0], -share, x) ** 2
        return [-max(a[0] * k * excess, 0.0) / B]

    errors = []
    for steps in (40, 80, 160):
        step = 0.9 * p[1] / steps
        time = step * np.arange(1, steps + 1)
        exact = solve_ivp(rate, (0.0, time[-1]), [1.0], "LSODA", time, rtol=1e-9, atol=1e-11).y[0]
        found, _, energies = driven(law, [1.0, 0.0], steps, step)
        errors.append(np.abs(found - exact).max())
        assert energies[:, 1:].min() >= -1e-15 * W * AREA
    assert 0.02 < exact[-1] < 0.9
    assert errors[-1] < 4e-4 and errors[0] / errors[2] > 9.0


@each_law
def test_a_slow_bond_is_that_of_its_curve_and_a_fast_one_is_stronger(make):
    direction, slow = [0.8, 0.6], make()
    end = 3e-5
    _, on_curve, _ = driven(slow, direction, 60, end / 60)
    tractions, works = [], []
    for viscosity in (1e-12, 1e-3, 1e-2, 1e-1, 1e6):
        _, found, energies = driven(make(viscosity=viscosity), direction, 60, end / 60)
        tractions.append(found)
        works.append(energies[:, 5].sum())
        assert energies[:, 1:].min() >= -1e-15 * W * AREA
    np.testing.assert_allclose(tractions[0], on_curve, rtol=1e-6, atol=1e-6 * S)
    assert works[0] < 1e-9 * W * AREA
    peaks = [found.max() for found in tractions]
    assert np.all(np.diff(peaks) > 0.01 * S)
    elastic = np.hypot(0.8 * slow.stiffnesses()[0], 0.6 * slow.stiffnesses()[1])
    assert peaks[-1] == pytest.approx(elastic * end * (1.0 - 0.5 / 60), rel=1e-3)


# -- energies


@each_law
@pytest.mark.parametrize(("steps", "theta"), [(0.5, 0.5), (20.0, 0.5), (20.0, 1.0)])
def test_a_bond_torn_by_inertia_spends_its_area_and_its_viscous_work(make, steps, theta):
    law = make(viscosity=B)
    bond = PointMass(law, 20.0 * W * AREA, [1.0, 0.0], area=AREA, theta=theta)
    before, total = bond.kinetic, np.zeros(6)
    for _ in range(400 + int(400 * steps)):
        energies = np.array(bond.step(W / S / steps))
        assert energies[1:].min() >= -1e-13 * W * AREA
        total += energies
        if bond.damage == 0.0:
            break
    assert bond.damage == 0.0
    assert total[1] == pytest.approx(law.fracture_energy * AREA, rel=1e-10)
    assert total[5] > (0.05 * W * AREA if steps == 20.0 else 0.0)
    if theta == 0.5:
        assert before - bond.kinetic == pytest.approx(total[1:].sum(), rel=1e-10)


@pytest.mark.parametrize(
    ("make", "dim", "damage"),
    [(zone, 2, "mean"), (zone, 3, "lagged"), (kinked, 2, "mean"), (modes_apart, 3, "mean"),
     (adhesion, 2, "lagged"), (adhesion, 3, "mean")],
)  # fmt: skip
def test_random_loads_dissipate_at_every_step(make, dim, damage):
    rng = np.random.default_rng(5)
    law = make(friction=0.4, friction_grows=True, viscosity=3e-3, damage=damage)
    worn = []
    for _ in range(4):
        mass = 3.0 * W * AREA
        bond = PointMass(law, mass, np.zeros(dim), area=AREA, theta=0.5)
        held = 0.0
        for _ in range(80):
            step, old, start = W / S * rng.choice([0.03, 0.2, 0.7]), bond.damage, bond.velocity
            force = 0.4 * mass / step * rng.normal(size=dim)
            energies = np.array(bond.step(step, force))
            assert energies[[1, 2, 3, 5]].min() >= -1e-12 * W * AREA
            assert bond.damage <= old
            work = 0.5 * step * float(np.sum(force * (start + bond.velocity)))
            now = bond.kinetic + energies[0]
            assert work == pytest.approx(now - held + energies[1:].sum(), abs=1e-9 * W * AREA)
            held = now
        worn.append(bond.damage)
    assert min(worn) < 0.1


def test_friction_grows_as_adhesion_is_lost():
    """mu (1 - a^2) of Coulomb beside a^2 C_T U_T, pressed and sheared."""
    law = adhesion(viscosity=B, friction=0.5, friction_grows=True)
    press, step = 1e4, D0 / 20.0
    point = PointMass(law, 1e12, [0.0, 1.0], area=AREA)
    for _ in range(120):
        before, jump = point.damage, point.jump[1]
        point.step(step, [-press, 0.0])
        middle = 0.5 * (jump + point.jump[1])
        shear = -point.impulse[1] / step
        low, high = sorted(
            beta * K * middle * AREA + 0.5 * (1.0 - beta) * press for beta in (before, point.damage)
        )
        assert low * (1.0 - 1e-9) <= shear <= high * (1.0 + 1e-9)
    assert point.damage < 0.5


def test_the_opening_that_was_followed_is_on_the_curve():
    """Torn by half, closed, held: what was followed is on the curve, and nothing goes on below."""
    point = PointMass(zone(viscosity=B), np.inf, [1.0, 0.0], area=AREA, theta=1.0)
    for _ in range(20):
        point.step(1e-6)
    worn, followed = point.damage, point.opening_max
    assert 0.0 < worn < 1.0 and followed < 20e-6
    assert zone().strength * (1.0 - (followed - 3e-6) / (zone().critical_opening - 3e-6)) == (
        pytest.approx(worn * K * followed, rel=1e-9)
    )
    point.velocity[:] = [-1.0, 0.0]
    point.step(20e-6 - 0.5 * followed)
    assert point.damage <= worn
    worn = point.damage
    spent = point.interactions.gather("spent")[0]
    point.velocity[:] = 0.0
    for _ in range(5):
        point.step(1.0)
    assert point.damage == worn and point.interactions.gather("spent")[0] == spent
    assert 0.0 < spent < 1.0


# -- in scenes

ELASTIC = xf.materials.LinearElastic(1000.0, 0.3, 1.0)


def plate(law, cells=(4, 4), **options):
    return xf.Scene(
        box_bodies((1, 1), cells), {1: ELASTIC}, default_interaction=law,
        loads=[xf.PrescribedVelocity(LEFT, 0, -1.0), xf.PrescribedVelocity(RIGHT, 0, 1.0)],
        initial_velocity=lambda x: np.stack([2.0 * x[0] - 1.0, 0.0 * x[0]]), **options,
    )  # fmt: skip


def soft(**options):
    options = {"viscosity": 2e-4, "friction": 0.3} | options
    return xf.laws.Adhesion(2e4, 0.05, **options)


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["explicit", "implicit"])
def test_the_ledger_books_viscous_work_apart_and_closes(scheme):
    simulation = xf.Simulation(plate(soft()), 1e-4, scheme=scheme, tolerance=1e-12, num_threads=1)
    before = 0.0
    for step in simulation.steps(0.03):
        work = step.energies["dissipated_viscous_bonds"]
        assert work >= before
        before = work
    energies = simulation.ledger.energies
    assert work > 0.1 * energies.dissipated_cohesion > 0.0
    assert energies.dissipated_viscous == 0.0
    assert abs(simulation.ledger.closure) < 1e-12 * energies.external_work
    spent = simulation.interactions.gather("energy")
    assert spent.shape[1] == 6 and spent[:, 5].max() > 0.0


def test_a_run_without_viscosity_has_no_column_for_it():
    simulation = xf.Simulation(plate(soft(viscosity=0.0)), 1e-4)
    assert "dissipated_viscous_bonds" not in simulation.ledger.as_columns()
    everywhere = xf.Simulation(plate(soft(viscosity=lambda x: 0.0 * x[0])), 1e-4)
    assert "dissipated_viscous_bonds" in everywhere.ledger.as_columns()


def test_solvers_agree():
    jumps = []
    for solver in ("nlgs", "newton", "accelerated", "monolithic"):
        simulation = xf.Simulation(
            plate(soft(), (2, 2)), 1e-3, scheme="implicit", theta=0.6, solver=solver,
            tolerance=1e-10, num_threads=1,
        )  # fmt: skip
        for _ in simulation.steps(0.03):
            pass
        jumps.append(simulation.interactions.gather("jump"))
        damage = simulation.interactions.gather("damage")
    assert damage.min() < 0.5
    for jump in jumps[1:]:
        np.testing.assert_allclose(jump, jumps[0], atol=1e-7 * np.abs(jumps[0]).max())


def test_viscosity_is_a_field():
    def uneven(x):
        return np.where(x[0] < 0.5, 1e-7, 1.0)

    simulation = xf.Simulation(plate(soft(viscosity=uneven)), 1e-4, scheme="explicit")
    for _ in simulation.steps(0.04):
        pass
    x = simulation.scene.bodies.facet_nodes(1).reshape(-1, 2)[:, 0]
    damage = simulation.interactions.gather("damage")
    assert damage[x < 0.45].min() < 0.3 and damage[x > 0.55].min() > 0.9


# -- static runs


def stretched(law, speed):
    """Two elastic halves and a bond, pulled at a speed."""
    scene = xf.Scene(
        box_bodies((2e-3, 1e-3), (2, 1), "quadrilateral", label=lambda x: x[0] > 1e-3),
        {1: xf.materials.LinearElastic(30e9, 0.0, 2400.0)}, default_interaction=law,
        loads=[xf.PrescribedDisplacement(LEFT, 0, 0.0), xf.PrescribedDisplacement(BOTTOM, 1, 0.0),
               xf.PrescribedDisplacement(TOP, 1, 0.0),
               xf.PrescribedDisplacement(RIGHT, 0, lambda t: speed * t)],
    )  # fmt: skip
    return scene


@pytest.mark.parametrize("speed", [1e-9, 0.3, 3.0])
def test_static_loads_are_measured_by_their_time(speed):
    """A bar in series: the traction is that of the differential equation at the speed."""
    bond, length = zone(viscosity=B), 2e-3
    steps, end = 160, 2e-5
    simulation = xf.Simulation(stretched(bond, speed), end / speed / steps, inertia=False)
    d0, dc = bond.elastic_opening, bond.critical_opening

    def traction(t, a):
        return speed * t / (length / 30e9 + 1.0 / (a * a * K))

    def rate(t, a):
        x = traction(t, a[0]) / (a[0] ** 2 * K)
        reached = S * dc / (a[0] ** 2 * K * (dc - d0) + S)  # where the curve has this damage
        return [-max(a[0] * K * (x * x - reached * reached), 0.0) / B]

    time = simulation.step_size * np.arange(1, steps + 1)
    a = solve_ivp(rate, (0.0, time[-1]), [1.0], "Radau", time, rtol=1e-9, atol=1e-12).y[0]
    pulled = []
    for step in simulation.steps(time[-1]):
        pulled.append(simulation.reaction(RIGHT)[0] / 1e-3)
        assert abs(step.energies["closure"]) < 1e-9 * step.energies["external_work"]
    exact = traction(time, a)
    np.testing.assert_allclose(pulled, exact, atol=(2e-3 if speed > 1e-6 else 1e-6) * exact.max())
    energies = simulation.ledger.energies
    work = energies.dissipated_viscous_bonds / 1e-3
    speeds = np.diff(np.r_[1.0, a]) / simulation.step_size
    assert work == pytest.approx(B * simulation.step_size * (speeds**2).sum(), rel=5e-3, abs=1e-6)
    assert abs(energies.dissipated_numerical) < 2e-3 * W * 1e-3


def test_viscous_work_vanishes_with_the_viscosity():
    """Where nothing snaps, in proportion to it; the bond spends its energy whatever it is."""
    works = []
    for viscosity in (B, 0.1 * B):
        simulation = xf.Simulation(stretched(zone(viscosity=viscosity), 0.01), 1e-4, inertia=False)
        *_, last = simulation.steps(8e-3)
        assert last.energies["dissipated_cohesion"] == pytest.approx(W * 1e-3, rel=1e-6)
        works.append(last.energies["dissipated_viscous_bonds"] / (W * 1e-3))
    assert 0.01 < works[0] < 0.05
    assert works[0] / works[1] == pytest.approx(10.0, rel=0.05)


def test_a_path_has_no_time_for_viscosity():
    with pytest.raises(ValueError, match="leave out the path .*max_halvings=16"):
        xf.Simulation(stretched(adhesion(viscosity=B), 1.0), 1.0, inertia=False,
                      path=xf.GrowthControl())  # fmt: skip


# -- bad input


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: zone(viscosity=-1.0), "viscosity should be a finite number, zero or above"),
        (lambda: modes_apart(viscosity=np.inf), "viscosity should be a finite number"),
        (lambda: adhesion(viscosity="much"), "viscosity should be a number"),
        (lambda: xf.laws.Adhesion(K, 0.0), "adhesion_energy should be a finite number above"),
        (lambda: xf.laws.Adhesion(-K, W), "normal_stiffness should be a finite number above"),
        (lambda: adhesion(damage="soon"), 'damage should be "auto"'),
    ],
)
def test_bad_numbers_are_refused(make, words):
    with pytest.raises((TypeError, ValueError), match=words):
        make()
