# SPDX-License-Identifier: LGPL-3.0-or-later
"""One bond between two cells, driven: its curve, its energies, and what is left once broken.

Bonded lips meet at position level: nothing interpenetrates, which tests/bulk/test_exact_dynamics.py
shows to be wrong for impacts and which is right here.
"""

from __future__ import annotations

import numpy as np
import pytest
from scenes import BOTTOM, LEFT, RIGHT, TOP, box_bodies

from xper_fx.forms.loads import PrescribedDisplacement, PrescribedVelocity
from xper_fx.materials import LinearElastic, NeoHookean, SaintVenantKirchhoff
from xper_fx.nscd.laws import CohesiveZone
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

C, W, R_MAX, MU = 100.0, 1.0, 10.0, 0.3
STIFF = LinearElastic(1e5, 0.0, 1e-3)
WIDTH = 2.0


def law_of(**options):
    return CohesiveZone(C, W, R_MAX, **options)


def drive(
    law, normal, tangential=0.0, *, step=0.01, theta=0.5, scheme="implicit", steps=100, alike=1e-4
):
    """Two stiff cells on each other, the lower held, the upper moved; history of the bond.

    Returns:
        The simulation, and an array of rows (time, mean normal and tangential jump of the step,
        tractions, damage before the step, damage after); both points of the bond agree to `alike`.
    """
    scene = Scene(
        box_bodies((WIDTH, 2), (1, 2), "quadrilateral"),
        {1: STIFF},
        default_interaction=law,
        loads=[PrescribedDisplacement(BOTTOM, axis, 0.0) for axis in (0, 1)]
        + [PrescribedDisplacement(TOP, 0, tangential), PrescribedDisplacement(TOP, 1, normal)],
    )
    simulation = Simulation(scene, step, scheme=scheme, theta=theta, tolerance=1e-11, num_threads=1)
    points = simulation.interactions
    rows, jump0, damage0 = [], points.gather("jump"), points.gather("damage")
    for record in simulation.steps(steps * step):
        jump, traction, damage = (points.gather(n) for n in ("jump", "traction", "damage"))
        mean = theta * jump + (1 - theta) * jump0
        row = np.concatenate([mean, traction, damage0[:, None], damage[:, None]], axis=1)
        assert row[0, [0, 2, 4, 5]] == pytest.approx(row[1, [0, 2, 4, 5]], rel=alike, abs=1e-9)
        rows.append([record.time, *row.mean(axis=0)])
        jump0, damage0 = jump, damage
    return simulation, np.array(rows)


def curve(law, x):
    """Traction of monotone opening, by the law's formula (Perales et al. 2010, eq. 37)."""
    d0, dc = law.elastic_opening, law.critical_opening
    y = np.clip((x - d0) / (dc - d0), 0.0, 1.0)
    return C * np.where(x < d0, x, d0 * (1.0 - y**2))


@pytest.mark.parametrize("theta", [0.5, 1.0])
def test_opening_follows_the_curve(theta):
    """Peak Rmax, area w, the curve between: found within 2e-3 Rmax at 400 steps, peak 0.998."""
    law = law_of()
    end = 1.3 * law.critical_opening
    simulation, rows = drive(law, lambda t: end * t, step=2.5e-3, theta=theta, steps=400)
    opening, traction = rows[:, 1], -rows[:, 3]
    assert traction == pytest.approx(curve(law, opening), abs=0.02 * R_MAX)
    assert traction.max() == pytest.approx(R_MAX, rel=0.01)
    assert np.trapezoid(traction, opening) == pytest.approx(W, rel=5e-3)
    assert np.all(traction[opening > law.critical_opening + 2 * end * 2.5e-3] < 1e-12)
    assert simulation.ledger.energies.dissipated_cohesion == pytest.approx(W * WIDTH, rel=1e-9)
    assert simulation.ledger.energies.cohesive == 0.0


@pytest.mark.parametrize("steps", [5, 20, 80])
def test_breaking_spends_w_whatever_the_step(steps):
    law = law_of()
    simulation, rows = drive(
        law, lambda t: 1.5 * law.critical_opening * t, step=1.0 / steps, steps=steps
    )
    assert rows[-1, -1] == 0.0
    assert simulation.ledger.energies.dissipated_cohesion == pytest.approx(W * WIDTH, rel=1e-9)


@pytest.mark.parametrize(
    "kind, speed, step", [(SaintVenantKirchhoff, 0.2, 0.5), (NeoHookean, 0.3, 1.0)]
)
def test_breaking_soft_bodies_spends_w_though_newton_iterates(kind, speed, step):
    """What an iterate that opens too far would break is whole again in the next one."""
    law = CohesiveZone(10.0, 2e-2, 1e-1)
    scene = Scene(
        box_bodies((2.0, 1.0), (2, 1), label=lambda x: x[0] > 1.0),
        {1: kind(young=1.0, poisson=0.3, density=1.0)},
        default_interaction=law,
        loads=[PrescribedVelocity(side, axis, value)
               for side, axis, value in ((LEFT, 0, 0.0), (BOTTOM, 1, 0.0), (RIGHT, 0, speed))],
    )  # fmt: skip
    options = {"theta": 1.0, "scheme": "implicit", "solver": "nlgs", "tolerance": 1e-8}
    simulation = Simulation(scene, step, num_threads=1, **options)
    iterations = []
    while simulation.interactions.gather("damage").any():
        (record,) = simulation.steps(simulation.time + step)
        iterations.append(record.newton_iterations)
    assert len(iterations) < 8 and min(iterations) > 4
    assert simulation.ledger.energies.dissipated_cohesion == pytest.approx(2e-2, rel=1e-7)


def test_lagged_damage_overspends():
    """Damage frozen during a step spends more than w, less so as the step falls."""
    law = law_of(damage="lagged")
    spent = []
    for steps in (10, 80):
        simulation, _ = drive(
            law, lambda t: 1.5 * law.critical_opening * t, step=1.0 / steps, steps=steps
        )
        spent.append(simulation.ledger.energies.dissipated_cohesion / (W * WIDTH))
    assert spent[0] > 1.1 and 1.0 < spent[1] < 1.0 + 0.3 * (spent[0] - 1.0)


def test_unloading_on_the_secant_and_reloading():
    """Opened half way down, closed, compressed, opened again: beta C all the way, and no damage.

    In compression the lips are closed to rounding: position level contact.
    """
    law = law_of()
    half = 0.5 * (law.elastic_opening + law.critical_opening)
    path = ([0.0, 1.0, 2.0, 2.5, 3.0, 3.9], [0.0, half, 0.0, -1e-3, 0.0, 0.97 * half])
    simulation, rows = drive(law, lambda t: np.interp(t, *path), step=0.02, steps=195)
    time, opening, traction, damage = rows[:, 0], rows[:, 1], rows[:, 3], rows[:, 6]
    unloading = (time > 1.03) & (time < 1.97) | (time > 3.05)
    secant = damage[60]
    assert damage[time > 1.03] == pytest.approx(secant, rel=1e-12)
    assert secant == pytest.approx(0.75 * law.elastic_opening / half, rel=0.02)
    assert traction[unloading] == pytest.approx(-secant * C * opening[unloading], abs=1e-7)
    pressed = (time > 2.05) & (time < 2.95)
    assert np.all(traction[pressed] > 0.0) and traction.max() > 10.0
    assert opening.min() > -1e-6
    spent = simulation.ledger.energies.dissipated_cohesion
    assert 0.2 * W * WIDTH < spent < W * WIDTH
    # the step in which the lips meet stops them
    assert 0.0 <= simulation.ledger.energies.dissipated_impact < 1e-3 * spent


def test_shear_breaks_and_leaves_friction():
    """Pressed and sheared until it breaks, the bond keeps mu p; the ledger holds w and mu N s."""
    law = law_of(friction=MU)
    press = -1e-3
    simulation, rows = drive(
        law,
        lambda t: press * min(t / 0.2, 1.0),
        lambda t: 2.0 * law.critical_opening * np.clip(t - 0.2, 0.0, 1.0),
        step=5e-3,
        steps=240,
        alike=0.1,
    )
    slip, normal, shear = rows[:, 2], rows[:, 3], np.abs(rows[:, 4])
    broken = np.flatnonzero(rows[:, 5] == 0.0)
    settled = broken[20:]
    assert len(settled) > 50
    assert np.mean(normal[settled]) == pytest.approx(-press * STIFF.young / 2, rel=0.01)
    assert shear[settled] == pytest.approx(MU * normal[settled], rel=1e-6)
    assert shear.max() == pytest.approx(R_MAX + MU * np.mean(normal[settled]), rel=0.02)
    energies = simulation.ledger.energies
    assert energies.dissipated_cohesion == pytest.approx(W * WIDTH, rel=1e-9)
    slid = np.abs(slip[-1])
    expected = MU * np.mean(normal[settled]) * slid * WIDTH
    assert energies.dissipated_friction == pytest.approx(expected, rel=0.03)
    assert abs(simulation.ledger.closure) < 1e-10 * energies.external_work


@pytest.mark.slow
def test_explicit_bond_opens_along_the_same_curve():
    """The explicit bulk sees the same bond: nothing limits the step but the bulk."""
    law = law_of()
    step = 2e-5
    end = 1.3 * law.critical_opening
    simulation, rows = drive(
        law, lambda t: end * t / 0.04, step=step, scheme="explicit", steps=2000
    )
    assert step < simulation.bulk.critical_step()
    smooth = np.abs(-rows[:, 3] - curve(law, rows[:, 1]))
    assert smooth.max() < 0.02 * R_MAX
    assert simulation.ledger.energies.dissipated_cohesion == pytest.approx(W * WIDTH, rel=1e-9)
