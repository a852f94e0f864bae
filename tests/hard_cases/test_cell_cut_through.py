# SPDX-License-Identifier: LGPL-3.0-or-later
"""A periodic cell whose bonds across a plane are all broken: no stiffness across, until it closes.

Two half cells, bonded across x = 0 by a cohesive plane and across the middle for good.
"""

from __future__ import annotations

import numpy as np
import pytest
from cells import averaged_gradient, cell_of, cell_run

from xper_fx.materials import LinearElastic, NeoHookean
from xper_fx.materials.material import lame
from xper_fx.nscd.laws import CohesiveZone, PerfectBond
from xper_fx.periodic.drive import MacroscopicDrive
from xper_fx.support.errors import ConvergenceError

LENGTH, PLANE, BOND = 2.0, 11, 12
LAW = CohesiveZone(100.0, 1.0, 10.0, friction=0.3)
YOUNG, POISSON, LIGHT = 2000.0, 0.3, 1e-2
LAM, MU = lame(YOUNG, POISSON)


def cut_cell():
    """Two halves: tag PLANE at x = 0, tag BOND at x = 1."""

    def at(place):
        return lambda x: np.abs((x[0] - place + 1.0) % LENGTH - 1.0) < 1e-9

    return cell_of(
        (LENGTH, 1.0), (2, 1), label=lambda x: x[0] < 1.0, interior={PLANE: at(0.0), BOND: at(1.0)}
    )


def driven(drive, steps, check=None, kind=LinearElastic):
    return cell_run(
        cut_cell(), {1: kind(YOUNG, POISSON, LIGHT)}, drive,
        facet_interactions={PLANE: LAW, BOND: PerfectBond()}, step=0.05, steps=steps, theta=1.0,
        tolerance=1e-10, check=check,
    )  # fmt: skip


def opening(simulation) -> np.ndarray:
    """Jumps at the points of the plane, (n, t), m."""
    facets = simulation.scene.bodies.facets
    here = np.repeat(facets.tag == PLANE, len(simulation.interactions.points) // len(facets))
    return simulation.interactions.gather("jump")[here]


@pytest.mark.slow
@pytest.mark.parametrize("kind", [LinearElastic, NeoHookean])
def test_opened_sheared_and_closed_again(kind, figure):
    """F11 breaks the plane, opens it, then F12 shears it open, then F11 = 0.99 presses.

    Open: Pibar = 0 and the jump is (F11 - 1, F12) L; closed: P11 = (lambda + 2 mu) (F11 - 1), or
    neo-Hookean's, as if it had never been cut.
    """
    shear = ([0.0, 1.0, 2.0, 3.0], [0.0, 0.0, 0.05, 0.0])
    stretch = ([0.0, 1.0, 2.0, 3.0, 4.0], [1.0, 1.3, 1.3, 1.1, 0.99])
    drive = MacroscopicDrive(
        gradient={
            "11": lambda t: np.interp(t, *stretch), "12": lambda t: 0.0,
            "21": lambda t: np.interp(t, *shear), "22": 1.0,
        }
    )  # fmt: skip
    rows = []

    def check(simulation, record):
        state = simulation.macroscopic
        jump = np.abs(opening(simulation) - LENGTH * (state.gradient - np.eye(2))[:, 0]).max()
        rows.append([record.time, np.abs(state.stress).max(), state.stress[0, 0], jump])
        found = averaged_gradient(simulation.bulk, simulation.state.displacement)
        assert np.abs(found - state.gradient).max() < 1e-12

    simulation = driven(drive, 88, check, kind)
    time, largest, stress, jump = np.array(rows).T
    # rates jump at whole times, and waves from there die away at theta = 1
    open_ = (time > 1.3) & (time < 3.85) & (time % 1.0 > 0.25)
    assert np.count_nonzero(open_) > 30
    figure(f"cell cut through, open, {kind.__name__}", "stress / strength < 1e-5",
           largest[open_].max() / LAW.strength)  # fmt: skip
    figure(f"cell cut through, open, {kind.__name__}", "jump error / L < 1e-8",
           jump[open_].max() / LENGTH)  # fmt: skip
    exact = -0.01 * (LAM + 2.0 * MU)
    if kind is NeoHookean:
        exact = MU * (0.99 - 1.0 / 0.99) + LAM * np.log(0.99) / 0.99
    error = abs(stress[-1] / exact - 1.0)
    figure(f"cell cut through, closed again, {kind.__name__}", "stress error < 1e-6", error)
    assert largest[open_].max() < 1e-5 * LAW.strength
    assert jump[open_].max() < 1e-8 * LENGTH
    assert error < 1e-6
    spent = simulation.ledger.energies.dissipated_cohesion
    assert spent == pytest.approx(LAW.fracture_energy, rel=1e-3)


def test_a_stress_asked_of_a_cut_cell(figure):
    """P11 = 5 asked of what cannot bear it: inertia of the halves bears it and Fbar runs away.

    Nothing is hidden: Pibar is what was asked, all numbers are finite, kinetic energy is the work.
    """
    drive = MacroscopicDrive(
        gradient={"12": 0.0, "21": 0.0, "22": 1.0},
        stress={"11": lambda t: 15.0 * min(t, 1.0) if t < 1.5 else 5.0},
    )
    rows = []

    def check(simulation, record):
        e = record.energies
        rows.append([simulation.macroscopic.gradient[0, 0], *e.values()])

    simulation = driven(drive, 40, check)
    rows = np.array(rows)
    error = abs(simulation.macroscopic.stress[0, 0] / 5.0 - 1.0)
    figure("stress asked of a cut cell", "error of Pibar < 1e-8", error)
    assert np.all(np.isfinite(rows))
    assert error < 1e-8
    assert rows[-1, 0] > 10.0 and np.all(np.diff(rows[-20:, 0]) > 0.0)
    e = simulation.ledger.energies
    assert abs(simulation.ledger.closure) < 1e-9 * e.external_work
    assert e.kinetic + e.dissipated_numerical > 0.9 * e.external_work


@pytest.mark.parametrize("kind", [LinearElastic, NeoHookean])
def test_a_static_stress_on_a_body_cut_by_a_void(kind):
    """One body, a void from side to side, no inertia: P11 has nothing to hold it, and that is told.

    The state stays that of the last step that converged.
    """
    cell = cell_of((1.0, 1.0), (4, 4), hole=lambda x: x[0] > 0.75)
    drive = MacroscopicDrive(
        gradient={"12": 0.0, "21": 0.0, "22": 1.0}, stress={"11": lambda t: 10.0 * t}
    )
    with pytest.raises(ConvergenceError, match="did not converge|not finite") as caught:
        cell_run(cell, {1: kind(YOUNG, POISSON, LIGHT)}, drive, step=0.1, steps=5)
    assert caught.value.time == 0.0
