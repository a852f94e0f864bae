# SPDX-License-Identifier: LGPL-3.0-or-later
"""Periodic cells of several bodies: cracks, bonds and friction seen from the macroscopic side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cells import averaged_gradient, cell_of, cell_run
from scipy.optimize import brentq

from xper_fx.materials import LinearElastic, NeoHookean
from xper_fx.materials.library import ZIRCALOY_4, ZIRCALOY_BOND
from xper_fx.materials.material import lame
from xper_fx.nscd.laws import CohesiveZone, PerfectBond, RigidCohesiveZone, SignoriniCoulomb
from xper_fx.output.checkpoint import restore
from xper_fx.output.recorder import Recorder
from xper_fx.periodic.averages import macroscopic_state
from xper_fx.periodic.drive import MacroscopicDrive
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.errors import ConvergenceError

LAW = CohesiveZone(100.0, 1.0, 10.0)
SOLID = (2000.0, 0.3)
LENGTH, HEIGHT = 2.0, 1.0
PLANE, BOND = 11, 12
LIGHT = 0.1
"""A density whose waves cross the cells in a small part of a step, theta = 1 damping them."""


def stack(shift=0.0, kind="crossed", cells=(4, 2)):
    """Two half cells: tag PLANE at x = shift, tag BOND half a period from it."""

    def at(place):
        return lambda x: np.abs((x[0] - place + 0.5 * LENGTH) % LENGTH - 0.5 * LENGTH) < 1e-9

    return cell_of(
        (LENGTH, HEIGHT),
        cells,
        kind,
        label=lambda x: (x[0] - shift) % LENGTH < 0.5 * LENGTH,
        interior={PLANE: at(shift), BOND: at(shift + 0.5 * LENGTH)},
    )


def consistent(stresses=0.0, bound=1e-10):
    """A check of each step: Fbar by its definition, no momentum, Hill-Mandel.

    The latter is relative to the work of the step: it means nothing where the cell stands still
    or, broken, bears less than `stresses`.
    """
    before, largest = [None], [0.0]

    def check(simulation, record):
        state = simulation.macroscopic
        moves = before[0] is None or np.abs(state.gradient - before[0]).max() > 1e-5
        before[0] = state.gradient
        found = averaged_gradient(simulation.bulk, simulation.state.displacement)
        assert np.abs(found - state.gradient).max() < 1e-12
        if moves and np.abs(state.stress).max() > stresses:
            assert state.hill_mandel < bound
        unknowns, bulk = simulation.bulk.unknowns, simulation.bulk
        if bulk.inertia is None:
            return
        momentum = (bulk.mass * simulation.state.velocity)[: unknowns.macroscopic.start]
        impulse = record.size * np.abs(simulation.state.internal).sum()
        largest[0] = max(largest[0], np.abs(momentum).sum() + impulse)
        total = momentum.reshape(-1, bulk.dim).sum(axis=0)
        assert np.abs(total).max() < 1e-10 * largest[0]

    return check


def pulled(bodies, lateral, path, step, steps, law=LAW, theta=1.0, check=None, density=LIGHT,
           kind=LinearElastic, **options):  # fmt: skip
    """A stack pulled along 11; lateral contraction held ("F22") or free ("P22")."""
    gradient = {"11": path, "12": 0.0, "21": 0.0}
    stress = {"22": 0.0} if lateral == "P22" else {}
    if lateral == "F22":
        gradient["22"] = 1.0
    return cell_run(
        bodies, {1: kind(*SOLID, density)}, MacroscopicDrive(gradient=gradient, stress=stress),
        facet_interactions={PLANE: law, BOND: PerfectBond()}, step=step, steps=steps, theta=theta,
        check=check, **options,
    )  # fmt: skip


def traction(opening, law=LAW):
    """The law's curve (Perales et al. 2010, eq. 37), monotone opening."""
    d0, dc = law.elastic_opening, law.critical_opening
    if opening <= d0:
        return law.normal_stiffness * opening
    y = min((opening - d0) / (dc - d0), 1.0)
    return law.normal_stiffness * d0 * (1.0 - y**2)


def modulus(lateral):
    """P11 over elastic strain: lambda + 2 mu held, E / (1 - nu^2) free."""
    lam, mu = lame(*SOLID)
    young, poisson = SOLID
    return lam + 2.0 * mu if lateral == "F22" else young / (1.0 - poisson**2)


def in_series(strain, lateral):
    """Opening x with modulus (strain - x / L) = traction(x)."""
    stiff = modulus(lateral)
    return brentq(
        lambda x: stiff * (strain - x / LENGTH) - traction(x), 0.0, LENGTH * strain, xtol=1e-15
    )


STAIRS, HOLDS = 10, 8


@pytest.mark.slow
@pytest.mark.parametrize(
    "lateral, shift, mesh, order",
    [
        ("F22", 1.0, ("quadrilateral", (2, 2)), 1),
        ("P22", 0.0, ("quadrilateral", (4, 1)), 2),
        ("P22", 0.5, ("crossed", (4, 2)), 1),
    ],
)
def test_cohesive_plane_in_series(lateral, shift, mesh, order):
    """stiff (F11 - 1 - x / L) = t(x), rising and falling; w is spent when all is over.

    At the boundary, in the middle, inside; any element, as the stress is uniform. A step's
    traction is a mean over the step; each strain is held until it is the curve's.
    """
    top = 1.05 * LAW.critical_opening / LENGTH
    strains = np.linspace(0.0, top, STAIRS + 1)
    # at the peak a wave damages a little too much for good: 5e-5 of the strength is left of it
    found, series = [], consistent(1e-3, bound=1e-8)

    def path(t):
        stair = np.clip(t / (HOLDS + 1), 0.0, STAIRS)
        rise = min((stair % 1.0) * (HOLDS + 1), 1.0)
        return 1.0 + np.interp(np.floor(stair + 1e-9) + (rise if rise > 1e-6 else 0.0),
                               np.arange(STAIRS + 1), strains)  # fmt: skip

    def check(simulation, record):
        series(simulation, record)
        if record.step % (HOLDS + 1) == 0:
            jump = simulation.interactions.gather("jump")
            held = np.isin(np.arange(len(jump)), _points_of(simulation, PLANE))
            assert np.ptp(jump[held, 0]) < 1e-7 and np.abs(jump[~held]).max() < 1e-7
            state = simulation.macroscopic
            found.append([state.gradient[0, 0] - 1.0, jump[held, 0].mean(), *state.stress.flat])

    simulation = pulled(
        stack(shift, *mesh),
        lateral,
        path,
        1.0,
        STAIRS * (HOLDS + 1),
        check=check,
        order=order,
        density=2.0,
    )
    found = np.array(found)
    assert len(found) == STAIRS
    assert found[:, 0] == pytest.approx(strains[1:], abs=1e-12)
    openings = np.array([in_series(e, lateral) for e in strains[1:]])
    stresses = np.array([traction(x) for x in openings])
    d0, dc = LAW.elastic_opening, LAW.critical_opening
    falling = np.count_nonzero((openings > 1.02 * d0) & (openings < 0.98 * dc))
    assert falling >= 3 and openings[0] < d0 and openings[-1] > dc
    assert found[:, 1] == pytest.approx(openings, abs=1e-6)
    assert found[:, 2] == pytest.approx(stresses, abs=5e-4)
    assert found[:, 3:5] == pytest.approx(0.0, abs=1e-6)
    lam, mu = lame(*SOLID)
    expected = lam / (lam + 2 * mu) * stresses if lateral == "F22" else 0.0 * stresses
    assert found[:, 5] == pytest.approx(expected, abs=5e-4)
    energies = simulation.ledger.energies
    assert energies.dissipated_cohesion == pytest.approx(LAW.fracture_energy * HEIGHT, rel=1e-9)


def _points_of(simulation, tag):
    """Points of facing facets that bear a tag."""
    facets = simulation.scene.bodies.facets
    per_facet = len(simulation.interactions.points) // len(facets)
    return np.flatnonzero(np.repeat(facets.tag == tag, per_facet))


@pytest.mark.parametrize("step", (0.2, 0.05))
def test_breaking_spends_w_whatever_the_step(step):
    """A few steps spend w as many do, and leave a cell without stress that can be pulled on."""
    simulation = pulled(
        stack(), "P22", lambda t: 1.0 + 0.2 * t, step, round(2.0 / step), check=consistent(1e-3)
    )
    energies = simulation.ledger.energies
    assert energies.dissipated_cohesion == pytest.approx(LAW.fracture_energy * HEIGHT, rel=1e-9)
    assert np.abs(simulation.macroscopic.stress).max() < 1e-8
    assert simulation.macroscopic.gradient[1, 1] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stresses", "tolerance"),
    [(("22",), 1e-4), (("12",), 1e-8), (("22", "12"), 1e-4), (("22", "12"), 1e-12)],
)
def test_a_broken_cell_goes_on(stresses, tolerance):
    """Once apart nothing carries stress: Pibar = 0 is all rounding, and no reason to stop."""
    gradient = {"11": lambda t: 1.0 + 0.25 * t, "22": 1.0, "12": 0.0, "21": 0.0}
    drive = MacroscopicDrive(
        gradient={n: g for n, g in gradient.items() if n not in stresses},
        stress=dict.fromkeys(stresses, 0.0),
    )
    simulation = cell_run(
        stack(1.0), {1: LinearElastic(200.0, 0.3, LIGHT)}, drive,
        facet_interactions={PLANE: LAW, BOND: PerfectBond()}, step=0.05, steps=20, theta=1.0,
        tolerance=tolerance,
    )  # fmt: skip
    assert simulation.step_number == 20
    # the halves still swing a little, freely
    assert np.abs(simulation.macroscopic.stress).max() < max(1e-4, tolerance) * LAW.strength
    assert simulation.ledger.energies.dissipated_cohesion == pytest.approx(1.0, rel=1e-3)
    cell = simulation.bulk
    bears = np.zeros(cell.num_dofs)
    misses = bears.copy()
    misses[cell.unknowns.macroscopic] = 1e-3 * cell.volume * cell.largest_stress
    assert cell.imbalance(misses, bears, 1.0) == pytest.approx(1e-3, rel=1e-12)


# Each cell a body


@pytest.mark.slow
@pytest.mark.parametrize(
    "law",
    [ZIRCALOY_BOND, CohesiveZone(2e18, 0.5, 1e9, tangential_stiffness=1e18)],
    ids=["C_T = C_N", "C_T = C_N / 2"],
)
@pytest.mark.parametrize("size, cells", [(2e-6, (1, 1)), (5e-7, (3, 2))])
def test_artificial_compliance_without_edges(size, law, cells):
    r"""1/E'* = 1/E' + (1 + 1/sqrt 2) / (s C_N) + (1/sqrt 2) / (s C_T), along x and along y."""
    c_n, c_t = law.parameters()[:2]
    plain = ZIRCALOY_4.young / (1.0 - ZIRCALOY_4.poisson**2)
    closed_form = 1.0 / plain + (1.0 + np.sqrt(0.5)) / (size * c_n) + np.sqrt(0.5) / (size * c_t)
    bodies = cell_of((cells[0] * size, cells[1] * size), cells, label=None)
    step = 1e-2 * size
    for pulled_, free in (("11", "22"), ("22", "11")):
        drive = MacroscopicDrive(
            gradient={pulled_: lambda t: 1.0 + 1e-6 * min(t / step, 1.0), "21": 0.0},
            stress={free: 0.0, "12": 0.0},
        )
        simulation = cell_run(
            bodies, {1: ZIRCALOY_4}, drive, law, step=step, steps=20, theta=1.0, tolerance=1e-10
        )
        axis = int(pulled_[0]) - 1
        found = 1e-6 / simulation.macroscopic.stress[axis, axis]
        assert found / closed_form == pytest.approx(1.0, abs=1e-8)
        assert simulation.ledger.energies.dissipated_cohesion == 0.0


MIXED = MacroscopicDrive(
    gradient={"11": lambda t: 1.0 + 0.05 * min(t, 1.0), "21": lambda t: 0.02 * min(t, 1.0)},
    stress={"22": 2.0, "12": -1.0},
)
TWO = {2: lambda x: (x[0] > 0.5) & (x[1] < 0.5)}


def phases(kind):
    return {1: kind(100.0, 0.3, LIGHT), 2: kind(300.0, 0.2, LIGHT)}


@pytest.mark.slow
@pytest.mark.parametrize("kind, order", [(LinearElastic, 2), (NeoHookean, 1)])
def test_perfectly_bonded_cells_are_the_connected_cell(kind, order):
    """Domain decomposition in the cell: N bodies glued, across its boundary too, are one."""
    states = []
    for label in (None, lambda x: x[0] > 0.7, 0):
        bodies = cell_of((1, 1), (2, 2), label=label, material=TWO)
        simulation = cell_run(
            bodies, phases(kind), MIXED, PerfectBond() if label != 0 else None, order=order,
            step=0.1, steps=20, theta=1.0, tolerance=1e-9, check=consistent(bound=1e-8),
        )  # fmt: skip
        states.append(
            np.concatenate([simulation.macroscopic.gradient, simulation.macroscopic.stress / 100])
        )
    assert np.abs(states[0] - states[2]).max() < 1e-7
    assert np.abs(states[1] - states[2]).max() < 1e-7


@pytest.mark.slow
def test_a_step_given_up_leaves_nothing_behind():
    """What a step that did not converge learnt of the cell's compliance is not used again."""
    bodies = cell_of((1, 1), (2, 2), label=None, material=TWO)
    simulation = cell_run(
        bodies, phases(NeoHookean), MIXED, PerfectBond(), order=2, step=0.25, steps=4, theta=1.0,
        tolerance=1e-11,
    )  # fmt: skip
    assert simulation.step_number > 4  # some were given up: so tight a tolerance is rounding here
    assert simulation.macroscopic.stress[1, 1] == pytest.approx(2.0, abs=1e-9)


def test_what_a_cell_has_learnt_is_kept_by_commits_and_restarts():
    """A step that fails falls back to the compliance of the last commit, after a restart too."""
    drive = MacroscopicDrive(
        rate={"11": 0.05}, gradient={"12": 0.0, "21": 0.0}, stress={"22": lambda t: 0.1 * t}
    )

    def cell(steps):
        return cell_run(
            stack(), {1: LinearElastic(*SOLID, 1.0)}, drive, LAW, steps=steps, step=0.1, theta=1.0,
            tolerance=1e-6,
        )  # fmt: skip

    bulk = cell(4).bulk
    before = bulk.saved()
    learnt = before["committed_compliance"].copy()
    assert np.abs(learnt).max() > 0.0
    np.testing.assert_array_equal(before["compliance"], learnt)
    bulk.restore(before | {"compliance": np.full_like(learnt, 7.0)})  # as an attempt would learn
    np.testing.assert_array_equal(before["compliance"], learnt)
    saved = bulk.saved()
    bulk.forget()
    np.testing.assert_array_equal(bulk.saved()["compliance"], learnt)
    other = cell(0).bulk
    assert not other.saved()["compliance"].any()
    other.restore(saved)
    np.testing.assert_array_equal(other.saved()["compliance"], 7.0 + 0.0 * learnt)
    other.forget()
    np.testing.assert_array_equal(other.saved()["compliance"], learnt)


def test_the_error_of_hills_lemma_sees_stresses_that_are_not_those_asked_for():
    """By the work that the stress missing would have done, beside that inside."""
    material = {1: LinearElastic(*SOLID, LIGHT)}
    drive = MacroscopicDrive(gradient={"11": lambda t: 1.0 + 0.01 * t, "12": 0.0, "21": 0.0},
                             stress={"22": lambda t: 3.0 * t})  # fmt: skip
    simulation = cell_run(
        cell_of((LENGTH, HEIGHT), (4, 2), label=0), material, drive, step=0.5, steps=1, theta=1.0
    )
    before = simulation.state
    list(simulation.steps(1.0))
    outcome, bulk = simulation.last, simulation.bulk
    cell = bulk.unknowns.macroscopic
    moved = outcome.state.displacement - before.displacement
    inside = abs(moved @ outcome.state.internal)
    for missing in (0.0, 0.5, -2.0):
        external = outcome.state.external.copy()
        external[cell.start + bulk.free] += bulk.volume * missing
        other = outcome._replace(state=replace(outcome.state, external=external))
        found = macroscopic_state(bulk, before, other, other.state, 0.5, 1.0).hill_mandel
        work = bulk.volume * abs(missing * moved[cell][bulk.free][0])
        least = work / (inside + bulk.largest_stress * bulk.volume * np.abs(moved[cell]).max())
        assert least - 1e-9 <= found <= work / inside + 1e-9
        assert (found > 1e-3) == (missing != 0.0)


def grains(shift):
    """Six grains of two columns each, in rows like bricks; hard grains among them."""

    def label(x):
        row = np.floor(3.0 * ((x[1] - shift[1]) % 1.0) + 1e-9)
        return 3 * row + np.floor(3.0 * ((x[0] - shift[0] - row / 6.0) % 1.0) + 1e-9)

    return label


@pytest.mark.slow
def test_grains_cut_elsewhere():
    """Grains that cross the boundary are tied to themselves: the same curve, damage included."""
    law = CohesiveZone(2e3, 0.3, 3.0, friction=0.2)
    curves = []
    for moved in ((0.0, 0.0), (1 / 6, 1 / 3)):
        label = grains(moved)
        bodies = cell_of(
            (1, 1), (6, 3), "quadrilateral", label=label,
            material={2: lambda x, label=label: label(x) % 4 == 1},
        )  # fmt: skip
        rows = []
        drive = MacroscopicDrive(
            rate={"11": 0.04, "21": 0.01}, stress={"22": lambda t: -0.5 * t, "12": 0.0}
        )
        simulation = cell_run(
            bodies, phases(LinearElastic), drive, law, step=0.1, steps=14, theta=1.0,
            tolerance=1e-8,
            check=lambda s, r, rows=rows: rows.append(
                [*s.macroscopic.stress.flat, *s.macroscopic.gradient.flat,
                 r.energies["dissipated_cohesion"], r.size]
            ),
        )  # fmt: skip
        assert bodies.num_bodies == 9
        curves.append(np.array(rows))
    assert np.all(curves[0][:, -1] == 0.1)
    assert simulation.ledger.energies.dissipated_cohesion > 1e-3
    assert np.abs(curves[1] - curves[0]).max() < 1e-6


# Contact and friction


@pytest.mark.slow
@pytest.mark.parametrize(
    "theta, sense, shift, contact",
    [
        (1.0, 1.0, 0.0, "velocity"), (1.0, -1.0, 1.0, "position"), (0.75, -1.0, 0.5, "velocity"),
        (0.75, 1.0, 0.5, "position"),
    ],
)  # fmt: skip
def test_sliding_plane(theta, sense, shift, contact):
    """Closed plane normal to 1, sheared by F21: P21 = sign mu |P11|, before it mu_elastic F21."""
    law, press, rate = SignoriniCoulomb(0.3, contact=contact), 0.01, 0.04 * sense
    drive = MacroscopicDrive(
        gradient={
            "11": lambda t: 1.0 - press * min(t, 1.0),
            "21": lambda t: rate * max(t - 1.0, 0.0),
            "12": 0.0,
            "22": 1.0,
        }
    )
    rows, consistency = [], consistent(bound=1e-8)

    def check(simulation, record):
        consistency(simulation, record)
        rows.append([record.time, *simulation.macroscopic.stress.flat])

    simulation = cell_run(
        stack(shift), {1: LinearElastic(*SOLID, LIGHT)}, drive,
        facet_interactions={PLANE: law, BOND: PerfectBond()}, step=0.05, steps=40, theta=theta,
        check=check,
    )  # fmt: skip
    rows = np.array(rows)
    pressure = -rows[-1, 1]
    lam, mu = lame(*SOLID)
    assert pressure == pytest.approx((lam + 2 * mu) * press, rel=2e-3)
    slid = rows[:, 0] > 1.0 + 1.4 * 0.3 * pressure / (mu * 0.04)
    assert np.count_nonzero(slid) > 5
    # the onset of slip sends a wave
    assert rows[slid, 3] == pytest.approx(-sense * 0.3 * rows[slid, 1], rel=2e-3)
    assert rows[-1, 3] == pytest.approx(-sense * 0.3 * rows[-1, 1], rel=1e-6)
    assert rows[slid, 2] == pytest.approx(rows[slid, 3], rel=1e-9)  # P12 = P21, small strain
    stuck = (rows[:, 0] > 1.01) & (rows[:, 0] < 1.0 + 0.8 * 0.3 * pressure / (mu * 0.04))
    assert rows[stuck, 3] == pytest.approx(mu * rate * (rows[stuck, 0] - 1.0), rel=1e-2)
    energies = simulation.ledger.energies
    slip = abs(rate) * 1.0 - 0.3 * pressure / mu
    assert energies.dissipated_friction == pytest.approx(
        0.3 * pressure * slip * LENGTH * HEIGHT, rel=0.02
    )
    assert abs(simulation.ledger.closure) < 1e-10 * energies.external_work


def test_a_plane_opens_without_stress_and_closes():
    """Signorini at position level: no Pibar while it opens; pushed back it bears the modulus."""
    path = ([0.0, 1.0, 3.0], [1.0, 1.02, 0.98])
    rows = []
    pulled(
        stack(), "F22", lambda t: np.interp(t, *path), 0.1, 30,
        law=SignoriniCoulomb(contact="position"),
        check=lambda s, r: rows.append([r.time, *s.macroscopic.stress.flat]),
    )  # fmt: skip
    rows = np.array(rows)
    open_ = rows[:, 0] < 1.95
    assert np.abs(rows[open_, 1:]).max() < 1e-3 * np.ptp(rows[:, 1])  # waves as it turns
    strain = np.interp(rows[:, 0], *path) - 1.0
    closed = rows[:, 0] > 2.15
    assert rows[closed, 1] == pytest.approx(modulus("F22") * strain[closed], rel=1e-3)


# Energy


@pytest.mark.slow
@pytest.mark.parametrize(
    "theta, label, tolerance",
    [(0.5, None, 1e-12), (1.0, grains((0.0, 0.0)), 1e-8)],
    ids=("each cell", "grains"),
)
def test_energy_closes_whatever_breaks(theta, label, tolerance):
    """external = kinetic + elastic + cohesive + dissipated, each step; no dissipation falls."""
    law = CohesiveZone(2e3, 0.02, 3.0, friction=0.2)
    bodies = cell_of((1, 1), (3, 3), "crossed", label=label, material=TWO)
    drive = MacroscopicDrive(rate={"11": 0.1, "21": 0.03}, stress={"22": -0.3, "12": 0.0})
    closures, before, consistency = [], {}, consistent(0.05, max(1e-10, 100 * tolerance))

    def check(simulation, record):
        consistency(simulation, record)
        closures.append(record.energies["closure"])
        for name, value in record.energies.items():
            if name.startswith("dissipated") and name != "dissipated_numerical":
                assert value >= before.get(name, 0.0) - 1e-15
        before.update(record.energies)

    materials = {
        t: LinearElastic(m.young, m.poisson, 1.0) for t, m in phases(LinearElastic).items()
    }
    simulation = cell_run(
        bodies, materials, drive, law, step=0.01, steps=60, theta=theta, tolerance=tolerance,
        check=check,
    )  # fmt: skip
    energies = simulation.ledger.energies
    assert energies.dissipated_cohesion > 0.01
    assert np.abs(closures).max() < 1e-12 * energies.external_work


# One run by stress, another by the strain it found


@pytest.mark.slow
@pytest.mark.parametrize("density, theta", [(50.0, 0.5), (50.0, 1.0)], ids=("waves", "damped"))
def test_stress_driven_and_strain_driven_runs_agree(density, theta):
    """A: F11 and P22 = P12 = 0. B: F11 and the F22(t), F12(t) of A. The same Pibar."""
    law = CohesiveZone(2e3, 0.3, 3.0, friction=0.2)
    bodies = cell_of((1, 1), (6, 3), "quadrilateral", label=grains((0.0, 0.0)), material=TWO)
    materials = {
        t: LinearElastic(m.young, m.poisson, density) for t, m in phases(LinearElastic).items()
    }
    step, steps = 0.1, 12

    def run(drive):
        rows = [np.eye(2).tolist() + np.zeros((2, 2)).tolist()]
        consistency = consistent(bound=1e-8)

        def check(simulation, record):
            assert record.size == step
            consistency(simulation, record)
            state = simulation.macroscopic
            rows.append([*state.gradient.tolist(), *state.stress.tolist()])

        simulation = cell_run(
            bodies, materials, drive, law, step=step, steps=steps, theta=theta,
            check=check, tolerance=1e-10,
        )  # fmt: skip
        return simulation, np.array(rows)

    given = {"11": lambda t: 1.0 + 0.06 * t, "21": lambda t: 0.01 * t}
    a, by_stress = run(MacroscopicDrive(gradient=given, stress={"22": 0.0, "12": 0.0}))
    times = step * np.arange(steps + 1)
    found = {
        "22": lambda t: np.interp(t, times, by_stress[:, 1, 1]),
        "12": lambda t: np.interp(t, times, by_stress[:, 0, 1]),
    }
    b, by_strain = run(MacroscopicDrive(gradient=given | found))
    assert a.ledger.energies.dissipated_cohesion > 1e-4
    scale = np.abs(by_stress[:, 2:]).max()
    assert np.abs(by_strain[:, 2:] - by_stress[:, 2:]).max() < 1e-7 * scale
    assert np.abs(by_stress[1:, 3, 1]).max() < 1e-9 * scale
    if density > 1.0:
        assert a.ledger.energies.kinetic > 1e-3 * a.ledger.energies.elastic


@pytest.mark.parametrize("density", (LIGHT, 1.0))
def test_a_stress_beyond_the_strength(density):
    """P11 ramps through the strength of the plane: the halves fly apart.

    What the bonds do not bear is left to the inertia of the fluctuation: Pibar is what was asked
    all along, Fbar runs away, everything stays finite and w is spent.
    """
    drive = MacroscopicDrive(
        gradient={"21": 0.0, "12": 0.0, "22": 1.0}, stress={"11": lambda t: 20.0 * t}
    )
    rows = []
    simulation = cell_run(
        stack(), {1: LinearElastic(*SOLID, density)}, drive,
        facet_interactions={PLANE: LAW, BOND: PerfectBond()}, step=0.02, steps=50, theta=1.0,
        tolerance=1e-8,
        check=lambda s, r: rows.append(
            [r.time, s.macroscopic.stress[0, 0], s.macroscopic.gradient[0, 0], *r.energies.values()]
        ),
    )  # fmt: skip
    rows = np.array(rows)
    assert np.all(np.isfinite(rows))
    assert rows[:, 1] == pytest.approx(20.0 * rows[:, 0], rel=1e-7)
    before = rows[:, 1] < 0.98 * LAW.strength
    assert rows[before, 2].max() < 1.0 + in_series(10.0 / modulus("F22") + 0.05, "F22")
    assert rows[-1, 2] > 2.0 and np.all(np.diff(rows[~before, 2]) > 0.0)
    assert simulation.ledger.energies.dissipated_cohesion == pytest.approx(1.0, rel=1e-6)
    assert simulation.ledger.energies.kinetic > 1.0


@pytest.mark.slow
def test_without_convergence_the_state_is_saved(tmp_path):
    """One Newton iteration cannot find both a stress and its impulses: ConvergenceError, a file."""
    drive = MacroscopicDrive(
        gradient={"11": lambda t: 1.0 + 0.1 * t, "21": 0.0}, stress={"22": 0.0, "12": 0.0}
    )
    bodies = cell_of((1, 1), (2, 2), label=None)
    scene = Scene(
        bodies, {1: LinearElastic(*SOLID, 1e-6)}, default_interaction=LAW, macroscopic=drive
    )
    options = {"theta": 1.0, "tolerance": 1e-10, "max_halvings": 1, "num_threads": 1}
    simulation = Simulation(scene, 0.02, max_newton=1, max_sweeps=500, **options)
    with (
        Recorder(simulation, tmp_path, end_time=1.0, fields=0),
        pytest.raises(ConvergenceError, match="of Newton.*checkpoint") as caught,
    ):
        list(simulation.steps(1.0))
    simulation = Simulation(scene, 0.02, **options | {"tolerance": 1e-8, "max_halvings": 8})
    restore(caught.value.saved, simulation)
    assert simulation.time == caught.value.time
    list(simulation.steps(0.04))
    assert simulation.macroscopic.stress[1, 1] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("dim", "kind", "cells"), [(2, "crossed", 3), (3, "hexahedron", 2)])
def test_initially_rigid_bonds_in_a_cell(dim, kind, cells):
    """Each cell a body, across the border too: one body until they open, then w to rounding."""
    solid = {1: LinearElastic(1.0, 0.3, 1.0)}
    still = {i + j: float(i == j) for i in "123"[:dim] for j in "123"[:dim] if i + j != "11"}
    drive = MacroscopicDrive(rate={"11": 0.04}, gradient=still)
    step, found = 0.02, {}
    for name, strength, label in (("one", None, 0), ("strong", 1.0, None), ("weak", 1e-2, None)):
        law = None if strength is None else RigidCohesiveZone(strength, 5e-5, friction=0.3)
        bodies = cell_of((1.0,) * dim, (cells,) * dim, kind, label=label)
        scene = Scene(bodies, solid, default_interaction=law, macroscopic=drive)
        simulation = Simulation(scene, step, tolerance=1e-9, num_threads=1)
        for _ in simulation.steps(22 * step):
            pass
        energies = simulation.ledger.energies
        assert abs(simulation.ledger.closure) < 1e-12 * energies.external_work
        found[name] = simulation
    stress = {name: run.macroscopic.stress[0, 0] for name, run in found.items()}
    assert stress["strong"] == pytest.approx(stress["one"], rel=1e-9)
    assert stress["weak"] < 0.9 * stress["one"]
    points = found["weak"].interactions
    spent, area = points.gather("spent"), points.gather("area")
    assert np.count_nonzero(spent)
    assert energies.dissipated_cohesion == pytest.approx(5e-5 * (spent @ area), rel=1e-12)
