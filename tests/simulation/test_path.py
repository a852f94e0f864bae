# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static runs whose load is found: a bar on its exact curve, snap-back, ledger, restart, errors."""

from dataclasses import replace
from functools import partial
from itertools import islice

import numpy as np
import pytest
from scenes import BOTTOM, LEFT, RIGHT, TOP, box_bodies

import xper_fx as xf
from xper_fx.nscd.laws import CohesiveZone
from xper_fx.output import checkpoint
from xper_fx.simulation.law_checks import check_path_has_bonds

E, HEIGHT = 30e9, 1.0
BOND = CohesiveZone(1e14, 100.0, 3e6)


def bar(length, bond=BOND, loads=None, dim=2, kind=xf.materials.LinearElastic, **options):
    """Two elastic halves and a bond, pulled along x, without lateral strain."""
    lengths, cells = (length, HEIGHT, HEIGHT)[:dim], (2, 1, 1)[:dim]
    cell = "quadrilateral" if dim == 2 else "hexahedron"
    bodies = box_bodies(lengths, cells, cell, label=lambda x: x[0] > 0.5 * length)
    held = [(LEFT, 0), (BOTTOM, 1), (5, 2)][:dim] + ([(6, 2)] if dim == 3 else [])
    loads = loads or [xf.PrescribedDisplacement(RIGHT, 0, lambda t: 1e-6 * t)]
    material = kind(E, 0.0, 2400.0)
    supports = [xf.PrescribedDisplacement(side, axis, 0.0) for side, axis in held]
    supports.append(xf.PrescribedDisplacement(RIGHT, 1, 0.0))
    return xf.Scene(
        bodies, {1: material}, default_interaction=bond, loads=[*supports, *loads], **options
    )


def follow(scene, path=None, **options):
    path = xf.GrowthControl(**options) if path is None else path
    return xf.Simulation(scene, 1.0, inertia=False, path=path)


def on_the_curve(simulation, bond=BOND):
    """Largest opening and the traction that the bond's curve has there."""
    x = simulation.interactions.gather("opening_max").max()
    y = (x - bond.elastic_opening) / (bond.critical_opening - bond.elastic_opening)
    return x, bond.strength * (1.0 - min(max(y, 0.0), 1.0) ** 2)


# Length at which the bar gives as much as the bond softens at most.
CRITICAL = E / BOND.softening_slope


def test_a_step_past_a_snap_back_is_told(caplog):
    """A bar of three critical lengths frees 1/2 of what it spends; small steps follow it back."""
    for growth, told in ((0.3, True), (0.1, False)):
        caplog.clear()
        simulation = follow(bar(3.0 * CRITICAL), growth=growth)
        *_, step = simulation.steps(1e6 * 3.0 * CRITICAL * BOND.strength / E * 1.5)
        lost = step.energies["dissipated_numerical"]
        words = [record.getMessage() for record in caplog.records]
        assert any("passes by a snap-back" in line for line in words) == told
        assert len(simulation.path.limit_points) == (0 if told else 2)
        assert lost > 30.0 if told else abs(lost) < 5.0
        assert step.energies["dissipated_cohesion"] == pytest.approx(100.0, rel=1e-9)


@pytest.mark.parametrize("control", [xf.GrowthControl(), xf.DissipationControl(3.0)])
def test_a_bond_that_weakens_from_the_first_opening_is_followed(control):
    """Tvergaard's curve (27/4) s y (1 - y)^2 has no elastic part to measure a first step by."""
    bond = CohesiveZone(None, 100.0, 3e6, curve=xf.laws.curves.Tvergaard())
    simulation, largest = follow(bar(0.1, bond=bond), control), 0.0
    for _ in simulation.steps(200.0):
        y = simulation.interactions.gather("opening_max").max() / (16.0 * 100.0 / (9.0 * 3e6))
        traction = 6.75 * 3e6 * y * max(1.0 - y, 0.0) ** 2
        force = simulation.reaction(RIGHT)[0]
        assert force == pytest.approx(traction, rel=1e-6, abs=1e-3)
        largest = max(largest, force)
    assert largest == pytest.approx(3e6, rel=0.02)
    assert simulation.ledger.energies.dissipated_cohesion == pytest.approx(100.0, rel=1e-9)


@pytest.mark.parametrize("share, dim", [(0.3, 2), (20.0, 2), (200.0, 2), (20.0, 3)])
def test_a_bar_stays_on_its_curve(share, dim):
    """Displacement = s L / E + x, s = R (1 - y^2); beyond a critical length the bar snaps back."""
    length = share * CRITICAL
    simulation = follow(bar(length, dim=dim))
    area = HEIGHT ** (dim - 1)
    times, spent = [], []
    for step in simulation.steps(1e6):
        x, traction = on_the_curve(simulation)
        if x >= 0.998 * BOND.critical_opening:
            break
        assert simulation.reaction(RIGHT)[0] == pytest.approx(traction * area, rel=1e-6)
        moved = traction * length / E + x
        assert 1e-6 * step.time == pytest.approx(moved, rel=1e-6)
        times.append(step.time)
        spent.append(step.energies["dissipated_cohesion"])
        # area under the curve less what the bond holds
        y = (x - BOND.elastic_opening) / (BOND.critical_opening - BOND.elastic_opening)
        whole = BOND.strength * (
            0.5 * BOND.elastic_opening
            + (BOND.critical_opening - BOND.elastic_opening) * (y - y**3 / 3.0)
        )
        assert spent[-1] == pytest.approx((whole - 0.5 * traction * x) * area, rel=1e-6)
        of_energy = simulation.interactions.gather("spent")
        np.testing.assert_allclose(of_energy, spent[-1] / (100.0 * area), rtol=1e-6, atol=1e-12)
        assert abs(step.energies["closure"]) < 1e-9 * step.energies["external_work"]
    assert 3 < len(times) < 60
    assert np.all(np.diff(spent) > 0.0)
    falls = np.diff(times) < 0.0
    assert np.any(falls) == (share > 1.0)
    # the load turns once, where it falls first; a long bar could bend open at one of its two points
    turns = np.flatnonzero(np.diff(np.sign(np.diff(times))))
    assert simulation.path.limit_points == [times[i + 1] for i in turns]
    assert len(turns) == (share > 1.0)


def test_where_rates_of_bonds_tell_nothing_a_step_is_not_made_twice(monkeypatch):
    """They have no factors then, and the step from rest is the next one's, which is shorter."""
    simulation = follow(bar(CRITICAL))
    scheme, asked = simulation.scheme, []
    next(simulation.steps(1e6))
    attempt = scheme.attempt

    def fails(*args, **given):
        if given.get("growth") is not None:
            asked.append((simulation.path.share, given["guess"] is not None))
        return attempt(*args, **given)._replace(converged=False)

    monkeypatch.setattr(scheme, "attempt", fails)
    monkeypatch.setattr("xper_fx.bulk.rates._MOST", 0)
    with pytest.raises(xf.ConvergenceError):
        next(simulation.steps(1e6))
    assert len(asked) > 5 and len(set(asked)) == len(asked)


# Energies (J/m^2) that bonds dissipate in a step.
SPENT = 7.0


@pytest.mark.parametrize("share, dim", [(0.3, 2), (20.0, 3)])
def test_each_step_dissipates_what_it_is_to(share, dim):
    """Over the peak and back, on the exact curve; the elastic part goes by within a step."""
    length = share * CRITICAL
    simulation = follow(bar(length, dim=dim), xf.DissipationControl(SPENT))
    before, steps = 0.0, 0
    for step in simulation.steps(1e6):
        x, traction = on_the_curve(simulation)
        spent = step.energies["dissipated_cohesion"]
        if 100.0 - before < 2.0 * SPENT:
            break
        assert spent - before == pytest.approx(SPENT, rel=1e-9)
        assert 1e-6 * step.time == pytest.approx(traction * length / E + x, rel=1e-6)
        assert abs(step.energies["closure"]) < 1e-9 * step.energies["external_work"]
        before, steps = spent, steps + 1
    assert steps == 13
    assert spent - before == pytest.approx(0.5 * (100.0 - before), rel=1e-9)
    *_, last = simulation.steps(1e6)
    assert last.energies["dissipated_cohesion"] == pytest.approx(100.0, rel=1e-6)


def cantilever():
    """The interface of two arms, whose bonds weaken over some facets."""
    length, height, crack = 40e-3, 1.5e-3, 10e-3
    mesh = xf.crossed_rectangle((0.0, -height), (length, height), (40, 2))
    tags = xf.tag_facets(mesh, {
        LEFT: lambda x: (x[0] < 1e-9) & (x[1] < 1e-9),
        BOTTOM: lambda x: (x[0] < 1e-9) & (x[1] > -1e-9),
        RIGHT: lambda x: x[0] > length - 1e-9,
        7: lambda x: (abs(x[1]) < 1e-9) & (x[0] < crack + 1e-9),
    })  # fmt: skip
    upper = mesh.geometry.x[xf.geometry_dofmap(mesh)].mean(axis=1)[:, 1] > 0.0
    pulls = [(LEFT, 1, lambda t: -1e-3 * t), (BOTTOM, 1, lambda t: 1e-3 * t)]
    held = [(RIGHT, axis, 0.0) for axis in (0, 1)]
    return xf.Scene(
        xf.explode(mesh, upper.astype(int), facet_tags=tags),
        {1: xf.materials.LinearElastic(126e9, 0.3, 1600.0)},
        default_interaction=CohesiveZone(5e14, 281.0, 20e6), facet_interactions={7: None},
        loads=[xf.PrescribedDisplacement(*load) for load in (*pulls, *held)],
    )  # fmt: skip


def test_both_controls_find_the_same_path():
    """A crack through arms: the same states, where bonds have dissipated the same."""
    by_growth = follow(cantilever())
    *_, step = islice(by_growth.steps(1.0), 15)
    spent = step.energies["dissipated_cohesion"]
    assert spent > 4.0 * 281.0 * 1e-3
    energy, done = 0.3 * 281.0 * 1e-3, 0.0
    by_energy = follow(cantilever(), xf.DissipationControl(energy))
    path, shares = by_energy.path, []
    for same in by_energy.steps(1.0):
        now = same.energies["dissipated_cohesion"]
        shares.append((now - done) / energy)
        done = now
        if spent - done < 1e-9 * spent:
            break
        if spent - done < path.share * energy:
            path.shorten((spent - done) / (path.share * energy))
    # but for the first and the last steps, and one at the most that was made again
    assert sum(share == pytest.approx(1.0, rel=1e-6) for share in shares) >= len(shares) - 3 > 8
    assert same.time == pytest.approx(step.time, rel=1e-6)
    jumps = [simulation.interactions.gather("jump") for simulation in (by_growth, by_energy)]
    np.testing.assert_allclose(jumps[1], jumps[0], atol=1e-6 * np.abs(jumps[0]).max())


@pytest.mark.slow
def test_a_path_turns_where_another_bond_leads():
    """A bond beside a ligament opens until a stronger one behind both snaps back: the first closes.

    With the secant of the stronger bond it opens, along its curve it closes, until it leads.
    """
    length = 20.0
    bodies = box_bodies(
        (length, HEIGHT), (3, 2), "quadrilateral",
        label=lambda x: np.where(
            x[0] > 2.0 * length / 3.0, 2, (x[0] < length / 3.0) & (x[1] < 0.5 * HEIGHT)
        ),
        interior={
            7: lambda x: abs(x[1] - 0.5 * HEIGHT) < 1e-9,
            8: lambda x: abs(x[0] - 2.0 * length / 3.0) < 1e-9,
        },
    )  # fmt: skip
    held = [(LEFT, 0), (BOTTOM, 1), (TOP, 1), (RIGHT, 1)]
    loads = [xf.PrescribedDisplacement(side, axis, 0.0) for side, axis in held]
    loads.append(xf.PrescribedDisplacement(RIGHT, 0, lambda t: 1e-6 * t))
    weak, strong = CohesiveZone(1e14, 100.0, 1e6), CohesiveZone(1e14, 100.0, 2e6)
    simulation = follow(xf.Scene(
        bodies, {1: xf.materials.LinearElastic(E, 0.0, 2400.0)}, loads=loads,
        default_interaction=weak, facet_interactions={7: None, 8: strong},
    ))  # fmt: skip
    peak = 0.0
    for step in simulation.steps(1e6):
        peak = max(peak, simulation.reaction(RIGHT)[0])
        assert abs(step.energies["closure"]) < 1e-6 * step.energies["external_work"]
    assert 0.99 < peak / (strong.strength * HEIGHT) <= 1.0
    both = 0.5 * HEIGHT * 100.0 + HEIGHT * 100.0
    assert step.energies["dissipated_cohesion"] == pytest.approx(both, rel=1e-6)


def bonds_in_a_row():
    """Three parts and two bonds, the first of which is a little weaker."""
    length = 1.0
    bodies = box_bodies(
        (length, HEIGHT), (3, 1), "quadrilateral",
        label=lambda x: (x[0] > length / 3.0).astype(int) + (x[0] > 2.0 * length / 3.0),
        interior={8: lambda x: abs(x[0] - 2.0 * length / 3.0) < 1e-9},
    )  # fmt: skip
    held = [(LEFT, 0), (BOTTOM, 1), (TOP, 1)]
    loads = [xf.PrescribedDisplacement(side, axis, 0.0) for side, axis in held]
    loads.append(xf.PrescribedDisplacement(RIGHT, 0, lambda t: 1e-6 * t))
    return xf.Scene(
        bodies, {1: xf.materials.LinearElastic(E, 0.0, 2400.0)}, loads=loads,
        default_interaction=CohesiveZone(1e14, 100.0, 2.9e6), facet_interactions={8: BOND},
    )  # fmt: skip


def test_a_path_goes_to_its_end_where_a_part_comes_loose():
    """The weaker bond breaks, and no load opens the other."""
    simulation = follow(bonds_in_a_row())
    *_, last = simulation.steps(1e3)
    assert last.time == 1e3
    assert last.energies["dissipated_cohesion"] == pytest.approx(100.0 * HEIGHT, rel=1e-9)
    assert abs(simulation.reaction(RIGHT)[0]) < 1e-6 * BOND.strength


def test_parts_that_are_free_of_each_other_take_no_corrections_for_rounding():
    """Of strains at finite strain, where all is loose: no force is left but rounding."""
    simulation = follow(bar(20.0 * CRITICAL, kind=xf.materials.NeoHookean))
    records = list(simulation.steps(1e6))
    assert simulation.interactions.gather("spent").min() > 0.999
    assert max(record.newton_iterations for record in records) < 10
    assert abs(simulation.reaction(RIGHT)[0]) < 1e-9 * BOND.strength


@pytest.mark.parametrize("path", [xf.GrowthControl(0.1), xf.DissipationControl(2e-3)])
def test_bonds_within_a_part_that_came_loose_open_by_no_rounding(path):
    """Two rows of two blocks, of which the load takes two off: what joins these is left alone."""
    blocks = box_bodies(
        (2.0, 1.0), (4, 2), label=lambda x: 2 * (x[0] > 1.0).astype(int) + (x[1] > 0.5)
    )
    bond = xf.laws.MixedMode(1e2, (0.1, 0.2), (0.1, 0.2), 2.0)
    loads = [
        xf.PrescribedDisplacement(LEFT, 0, 0.0), xf.PrescribedDisplacement(BOTTOM, 1, 0.0),
        xf.PrescribedDisplacement(RIGHT, 0, lambda t: 1e-3 * t),
    ]  # fmt: skip
    matter = xf.materials.LinearElastic(1.0, 0.3, 1.0)
    simulation = follow(xf.Scene(blocks, {1: matter}, default_interaction=bond, loads=loads), path)
    *_, last = simulation.steps(4e3)
    assert last.time == 4e3
    assert last.energies["dissipated_cohesion"] == pytest.approx(0.1, rel=1e-6)
    spent = simulation.interactions.gather("spent")
    assert np.unique(spent.round(9)).tolist() == [0.0, 1.0]


@pytest.mark.parametrize("longest", [0.2, 1.0])
def test_dissipation_control_goes_to_its_end_where_a_part_comes_loose(longest):
    """A step asks for more than the weaker bond has left; that breaks, the whole one does not."""
    simulation = follow(bonds_in_a_row(), xf.DissipationControl(2.0, longest=longest))
    *_, last = simulation.steps(1e3)
    assert last.time == 1e3
    assert last.energies["dissipated_cohesion"] == pytest.approx(100.0 * HEIGHT, rel=1e-9)
    assert simulation.interactions.gather("spent").round(9).tolist() == [1.0, 1.0, 0.0, 0.0]


def test_a_path_that_stops_says_what_failed(monkeypatch):
    """The weaker bond breaks, and no load opens the whole one."""
    monkeypatch.setattr("xper_fx.nscd.growth.GrowthLimit.allows", lambda *_: False)
    simulation = follow(bonds_in_a_row(), longest=0.2)
    with pytest.raises(xf.ConvergenceError, match=r"share of 1e-06 of what") as caught:
        for _ in simulation.steps(1e3):
            pass
    assert caught.value.failure.startswith("no load keeps all bonds within")
    assert caught.value.failure in str(caught.value)
    assert simulation.interactions.gather("spent").max() > 0.99


def test_contacts_are_looked_for_in_vain_three_times_in_a_step(monkeypatch):
    """No load opens the whole bond: most attempts at the last step do without."""
    from xper_fx.bulk import monolithic_scheme

    searches, find = [], monolithic_scheme.find_contacts

    def counted(step, *options):
        searches.append(step.state.time)
        return find(step, *options)

    monkeypatch.setattr("xper_fx.nscd.growth.GrowthLimit.allows", lambda *_: False)
    monkeypatch.setattr(monolithic_scheme, "find_contacts", counted)
    simulation = follow(bonds_in_a_row(), longest=0.2)
    with pytest.raises(xf.ConvergenceError):
        for _ in simulation.steps(1e3):
            pass
    assert searches.count(simulation.time) == 3


@pytest.mark.parametrize("path", [
    xf.GrowthControl(longest=0.02), xf.DissipationControl(7.0, longest=0.02)
])  # fmt: skip
@pytest.mark.parametrize("end", [450.0, 499.9, 1e3])
def test_no_step_changes_the_load_by_more_than_it_may(path, end):
    """Up to an end before the peak, at it and beyond a snap-back; the states are on the curve."""
    length = 20.0 * CRITICAL
    simulation = follow(bar(length), path)
    times = [0.0]
    for step in simulation.steps(end):
        times.append(step.time)
        x, traction = on_the_curve(simulation)
        if not 0.0 < x < 0.998 * BOND.critical_opening:
            continue
        if step.energies["dissipated_cohesion"] > 0.0:
            assert simulation.reaction(RIGHT)[0] == pytest.approx(traction * HEIGHT, rel=1e-6)
            assert 1e-6 * step.time == pytest.approx(traction * length / E + x, rel=1e-6)
        assert abs(step.energies["closure"]) < 1e-9 * step.energies["external_work"]
    assert times[-1] == end
    changes = np.abs(np.diff(times)) / end
    assert changes.max() == pytest.approx(0.02, rel=1e-9)
    if end < 500.0:
        assert np.all(np.diff(times) > 0.0) and len(times) < 65
        assert step.energies["dissipated_cohesion"] < 1.0
    else:
        assert min(times[20:]) < 100.0
        assert step.energies["dissipated_cohesion"] == pytest.approx(100.0 * HEIGHT, rel=1e-6)


def test_the_first_steps_up_to_a_load_are_those_of_no_bound():
    """Where steps are shorter than they may be, the path is the same to the last digit."""
    times = [
        [step.time for step in islice(follow(cantilever(), longest=longest).steps(1.0), 15)]
        for longest in (0.05, 1.0)
    ]
    assert times[0] == times[1]


def test_matter_that_flows_in_place_of_bonds_is_followed():
    """Its stress hangs on the steps: those of a path that bonds do not hinder are equal ones."""

    def flows(young, poisson, density):
        hardening = xf.materials.Linear(1e9)
        return xf.materials.J2SmallStrain(young, poisson, 1e6, hardening, density)

    bond = CohesiveZone(1e14, 1e4, 30e6)
    along_path = follow(bar(1.0, bond, kind=flows))
    times = [step.time for step in along_path.steps(200.0)]
    np.testing.assert_allclose(times, 10.0 * np.arange(1, 21), rtol=1e-12)
    given = xf.Simulation(bar(1.0, bond, kind=flows), 10.0, inertia=False)
    *_, last = given.steps(200.0)
    assert last.energies["dissipated_plastic"] > 0.0
    forces = [simulation.reaction(RIGHT)[0] for simulation in (along_path, given)]
    assert forces[0] == pytest.approx(forces[1], rel=1e-6)


@pytest.mark.parametrize("path", [None, xf.DissipationControl(20.0)])
def test_loads_that_are_not_linear_in_time(path):
    """u = 1.5 u_peak sin(pi t): the bar snaps back on its curve, to where the bond is broken.

    Over the time by which velocities are defined, 1 s, this load changes the other way.
    """
    length = 20.0 * CRITICAL
    largest = 1.5 * (BOND.strength * length / E + BOND.elastic_opening)
    load = xf.PrescribedDisplacement(RIGHT, 0, lambda t: largest * np.sin(np.pi * t))
    simulation = follow(bar(length, loads=[load]), path)
    for step in simulation.steps(0.45):
        moved = largest * np.sin(np.pi * step.time)
        x, traction = on_the_curve(simulation)
        force = simulation.reaction(RIGHT)[0]
        stretched = force * length / E + (x if x > BOND.elastic_opening else force / 1e14)
        assert stretched == pytest.approx(moved, rel=1e-6)
        assert x <= BOND.elastic_opening or force == pytest.approx(traction, rel=1e-6, abs=1e-3)
    assert step.time == pytest.approx(0.45)
    assert x > BOND.critical_opening
    assert len(simulation.path.limit_points) == 2


PATHS = [xf.GrowthControl(), xf.DissipationControl(SPENT)]


@pytest.mark.parametrize("path", PATHS)
def test_a_snap_back_passes_by_a_hold(path):
    """Loads rise to half the peak, are held for 0.2 s, and rise on: the bar snaps back below that.

    The hold is longer than a step may be, and takes no part in the path: states lie on the curve.
    """
    length = 20.0 * CRITICAL
    peak = BOND.strength * length / E + BOND.elastic_opening

    def moved(time):
        return peak * np.interp(time, [0.0, 0.3, 0.5, 1.0], [0.0, 0.5, 0.5, 1.5])

    load = xf.PrescribedDisplacement(RIGHT, 0, moved)
    simulation = follow(bar(length, loads=[load]), path)
    times = []
    for step in simulation.steps(1.0):
        x, traction = on_the_curve(simulation)
        force = simulation.reaction(RIGHT)[0]
        stretched = force * length / E + (x if x > BOND.elastic_opening else force / 1e14)
        assert stretched == pytest.approx(moved(step.time), rel=1e-6)
        assert x <= BOND.elastic_opening or force == pytest.approx(traction, rel=1e-6, abs=1e-3)
        times.append(step.time)
    assert times[-1] == pytest.approx(1.0)
    assert x > BOND.critical_opening
    high, low = simulation.path.limit_points
    assert high > 0.7 and low < 0.1
    back = times[times.index(high) : times.index(low) + 1]
    assert not any(0.3 + 1e-9 < time < 0.5 - 1e-9 for time in back)
    assert len(times) < 60


@pytest.mark.parametrize("path", PATHS)
def test_a_load_that_falls_again_unloads(path):
    """Up to 0.9 of the peak and back, before any bond has opened; then beyond it."""
    for share, largest in ((20.0, 0.9), (0.3, 1.2)):
        length = share * CRITICAL
        peak = BOND.strength * length / E + BOND.elastic_opening
        load = xf.PrescribedDisplacement(
            RIGHT, 0, lambda t, u=largest * peak: np.interp(t, [0.0, 0.5, 1.0], [0.0, u, 0.0])
        )
        simulation = follow(bar(length, loads=[load]), path)
        forces = {s.time: simulation.reaction(RIGHT)[0] for s in simulation.steps(1.0)}
        assert max(forces) == pytest.approx(1.0)
        assert max(forces.values()) > 0.89 * BOND.strength
        assert abs(forces[max(forces)]) < 1e-6 * BOND.strength
        opened = simulation.interactions.gather("opening_max").max()
        assert (opened > BOND.elastic_opening) == (largest > 1.0)
        assert simulation.path.limit_points == []


def test_advice_knows_loads_that_turn_from_those_that_bend(monkeypatch):
    """Near the largest load it names that; before, where loads but bend, what took turns."""
    monkeypatch.setattr("xper_fx.simulation.path._LEAST", 0.3)
    load = xf.PrescribedDisplacement(RIGHT, 0, lambda t: 1e-9 * np.sin(np.pi * t))
    for stop, told in ((0.475, "The loads turn or stand still"), (0.2, "The bond at")):

        def may_be(self, outcome, size, back, stop=stop):
            return outcome.converged and outcome.state.time < stop

        monkeypatch.setattr("xper_fx.simulation.path_step.PathStep._may_be", may_be)
        with pytest.raises(xf.ConvergenceError, match=told) as caught:
            for _ in follow(bar(1.0, loads=[load])).steps(1.0):
                pass
        assert stop - 0.05 <= caught.value.time < stop


def test_loads_to_and_fro_are_followed():
    """Ever further, and back to none: where nothing opens the time of the loads goes on.

    The bond asks there for a load beyond all of them, or for none, and lips close and part.
    """
    length = 0.3 * CRITICAL
    peak = BOND.strength * length / E + BOND.elastic_opening
    load = xf.PrescribedDisplacement(RIGHT, 0, lambda t: 3.0 * peak * t * np.sin(6.0 * np.pi * t))
    simulation = follow(bar(length, loads=[load]))
    rows = [(s.time, simulation.reaction(RIGHT)[0]) for s in simulation.steps(1.0)]
    times, loads = np.array(rows).T
    assert np.all(np.diff(times) > 0.0) and times[-1] == 1.0 and len(rows) < 40
    assert loads.max() == pytest.approx(BOND.strength, rel=1e-3)
    pressed = (times > 0.9) & (times < 0.96)
    ends = 3.0 * peak * times[pressed] * np.sin(6.0 * np.pi * times[pressed])
    assert pressed.any() and loads[pressed] == pytest.approx(E * ends / length, rel=1e-6)
    assert abs(loads[-1]) < 1e-9 * BOND.strength


@pytest.mark.parametrize(
    ("share", "turns", "amplitude"),
    [(0.3, 3, 1.5), (0.3, 5, 3.0), (1.0, 3, 3.0), (1.0, 5, 1.5), (3.0, 3, 1.5), (3.0, 5, 3.0)],
)
def test_loads_that_end_at_none_are_followed(share, turns, amplitude):
    """Lips of a broken bond close by what rounding leaves, and answer with the whole bond's spring.

    And where the load turns just before the end of a step, bonds do not open on towards it, back
    in time: there is no way on beyond the largest load. Each of the two stopped some of these.
    """
    length = share * CRITICAL
    peak = BOND.strength * length / E + BOND.elastic_opening

    def end(t):
        return peak * (amplitude * t * np.sin(2.0 * np.pi * turns * t))

    simulation = follow(bar(length, loads=[xf.PrescribedDisplacement(RIGHT, 0, end)]))
    rows = [(s.time, simulation.reaction(RIGHT)[0]) for s in simulation.steps(1.0)]
    times, loads = np.array(rows).T
    assert times[-1] == 1.0 and len(rows) < 60
    assert loads.max() == pytest.approx(BOND.strength, rel=0.1)
    assert abs(loads[-1]) < 1e-9 * BOND.strength
    if share < 1.0:
        assert np.all(np.diff(times) > 0.0)
    opened = simulation.interactions.gather("opening_max").max()
    assert opened > BOND.elastic_opening
    pressed = loads < -1e-3 * BOND.strength
    assert loads[pressed] == pytest.approx(E * end(times[pressed]) / length, rel=1e-6)


@pytest.mark.parametrize(
    ("share", "control", "load"),
    [
        (0.3, xf.GrowthControl(), lambda t: 1.5 * (1.0 - abs(2.0 * t - 1.0))),
        (0.3, xf.DissipationControl(10.0), lambda t: 1.5 * (1.0 - abs(2.0 * t - 1.0))),
        (3.0, xf.GrowthControl(), lambda t: 1.2 * np.sin(4.0 * np.pi * t) * (0.75 + t)),
    ],
)
def test_ends_are_where_they_are_driven_when_loads_turn(share, control, load):
    """The bond has opened when the load turns. It unloads: no end goes on as it did before.

    Or the load bends so that it has changed twice as much after the step as after its half.
    """
    length = share * CRITICAL
    peak = BOND.strength * length / E + BOND.elastic_opening
    ends = [xf.PrescribedDisplacement(RIGHT, 0, lambda t: peak * load(t))]
    simulation, spent = follow(bar(length, loads=ends), control), []
    end = 1.0 if share < 1.0 else 0.25
    for step in simulation.steps(end):
        assert abs(simulation.mean_displacement(RIGHT)[0] - peak * load(step.time)) < 1e-9 * peak
        spent.append(step.energies["dissipated_cohesion"])
    assert step.time == pytest.approx(end) and len(spent) < 60
    assert spent[-1] > 5.0 and spent[-1] == pytest.approx(spent[len(spent) * 3 // 4], rel=1e-9)


def arch(stones: int) -> xf.Scene:
    """Half a circle of stones with joints of mortar: its weight, and then a load on one stone.

    Its springers are held.
    """
    inner, thick = 0.9, 0.2
    mesh = xf.crossed_rectangle((0.0, 0.0), (np.pi, thick), (2 * stones, 4))
    angle, height, _ = mesh.geometry.x.T.copy()
    stone = mesh.geometry.x[xf.geometry_dofmap(mesh)].mean(axis=1)[:, 0] * stones / np.pi
    mesh.geometry.x[:, 0] = -(inner + height) * np.cos(angle)
    mesh.geometry.x[:, 1] = (inner + height) * np.sin(angle)
    loaded = -np.cos(np.pi * (stones // 4 + np.arange(2)) / stones)
    tags = {
        BOTTOM: lambda x: x[1] < 1e-9,
        TOP: lambda x: (
            (np.hypot(*x[:2]) > inner + 0.9 * thick)
            & (x[0] > (inner + thick) * loaded[0] - 1e-9)
            & (x[0] < (inner + thick) * loaded[1] + 1e-9)
        ),
    }
    return xf.Scene(
        xf.explode(mesh, stone.astype(int), facet_tags=xf.tag_facets(mesh, tags)),
        {1: xf.materials.LinearElastic(1e10, 0.2, 2000.0)},
        default_interaction=xf.laws.CohesiveZone(1e11, 1.0, 5e4, friction=0.7),
        loads=[
            *(xf.PrescribedDisplacement(BOTTOM, k, 0.0) for k in (0, 1)),
            xf.Gravity(lambda t: (0.0, -9.81 * min(t, 1.0))),
            xf.SurfaceTraction(TOP, lambda t: (0.0, -1e3 * max(t - 1.0, 0.0))),
        ],
    )


def test_loads_that_follow_each_other_are_followed():
    """The second load closes joints that the first one opened, though none has weakened.

    Such a path stopped where the second load begins, as its openings go back.
    """
    scene = arch(12)
    along = xf.Simulation(scene, 0.05, inertia=False, path=xf.GrowthControl())
    rows = [(s.time, *along.mean_displacement(TOP)) for s in along.steps(8.0)]
    steps = xf.Simulation(scene, 0.5, inertia=False)
    for _ in steps.steps(8.0):
        pass
    assert np.all(np.diff(np.array(rows)[:, 0]) > 0.0)
    assert rows[-1][1:] == pytest.approx(tuple(steps.mean_displacement(TOP)), rel=1e-4)
    assert along.ledger.energies.dissipated_cohesion == 0.0


def test_bonds_that_ask_for_no_load_do_not_stop_the_path(monkeypatch):
    """As of parts that have come loose: loads are given, and iterations shorten no step."""

    def none(limit, *_):
        limit.idle = False

    monkeypatch.setattr("xper_fx.nscd.growth.GrowthLimit.change", none)
    simulation = follow(bar(0.3 * CRITICAL), longest=1.0)
    *_, last = simulation.steps(1.0)
    assert last.time == pytest.approx(1.0)
    assert simulation.reaction(RIGHT)[0] == pytest.approx(E * 1e-6 / (0.3 * CRITICAL), rel=0.01)
    path = xf.GrowthControl().follower()
    path.share, path.idles, path.coasts = 1e-3, True, True
    path.succeeded(1.0, 60, 0.0, 0, False)
    assert path.share == 2e-3


def test_a_load_that_was_refused_is_not_tried_again(monkeypatch):
    """A step that is made again with less does not bear the load that it was refused."""
    simulation = follow(bar(0.1), longest=0.01)
    steps = simulation.steps(200.0)
    for _ in range(3):
        next(steps)
    attempt, asked = simulation.scheme.attempt, []

    def fails(state, size, growth=None, guess=None, **others):
        if growth is None:
            asked.append((size, guess is None))
        outcome = attempt(state, size, growth=growth, guess=guess, **others)
        return outcome._replace(converged=False)

    monkeypatch.setattr(simulation.scheme, "attempt", fails)
    with pytest.raises(xf.ConvergenceError):
        next(steps)
    assert len(asked) > 2
    assert len(asked) == len(set(asked))


def test_a_load_that_changes_too_much_is_told(monkeypatch):
    monkeypatch.setattr("xper_fx.simulation.path._LEAST", 0.5)
    with pytest.raises(xf.ConvergenceError, match="changes by more than a step may") as caught:
        for _ in follow(bar(200.0 * CRITICAL), longest=1e-3, growth=0.5).steps(6e3):
            pass
    assert caught.value.time > 4e3
    assert caught.value.newton_residual < 1e-8


def test_states_that_lead_back_are_not_called_residuals(monkeypatch):
    """Each state is found far within the tolerance, and none goes on."""
    monkeypatch.setattr("xper_fx.nscd.growth.GrowthLimit.turns_back", lambda *_: True)
    with pytest.raises(xf.ConvergenceError, match=r"1 at .* 1e-06 .*leads back") as caught:
        next(follow(bar(1.0)).steps(1e6))
    assert caught.value.newton_residual < 1e-8


def test_a_load_that_dissipates_nothing_the_other_way():
    """Pressed, the parts dissipate nothing however far: the energy has one end alone."""
    simulation = follow(bonds_in_a_row(), xf.DissipationControl(2.0, longest=0.2))
    step = next(simulation.steps(1e3))
    assert step.energies["dissipated_cohesion"] == pytest.approx(2.0, rel=1e-9)


def test_a_force_that_falls():
    """Under a force the load has its peak at the strength, and goes to nothing."""
    loads = [xf.SurfaceTraction(RIGHT, (lambda t: 1e5 * t, 0.0))]
    soft = CohesiveZone(1e12, 100.0, 3e6)
    simulation = follow(bar(0.5, soft, loads), growth=0.1)
    forces = []
    for step in simulation.steps(1e6):
        x, traction = on_the_curve(simulation, soft)
        if x >= 0.998 * soft.critical_opening:
            break
        assert 1e5 * step.time == pytest.approx(traction, rel=1e-6)
        forces.append(1e5 * step.time)
    assert max(forces) == pytest.approx(soft.strength, rel=2e-3)
    assert forces[-1] < 0.9 * soft.strength


@pytest.mark.parametrize("stiffness", [3e12, 3e15])
def test_broken_is_what_has_spent_its_energy(stiffness):
    """At 90 % the secant stiffness of the stiffer bond is 1e-4 already."""
    simulation = follow(bar(0.3 * CRITICAL, CohesiveZone(stiffness, 100.0, 3e6)), growth=0.02)
    for _ in simulation.steps(1e6):
        spent = simulation.interactions.gather("spent")
        if spent.max() > 0.9:
            break
    assert spent.max() < 0.99
    left = simulation.interactions.gather("damage").max()
    assert (left < 1e-3) == (stiffness > 1e13)
    broken = xf.output.broken_points
    assert not broken(simulation).any() and broken(simulation, share=0.9).all()
    assert xf.output.find_fragments(simulation).max() == 0
    assert xf.output.find_fragments(simulation, share=0.9).max() == 1


def test_the_path_goes_to_its_end():
    """Beyond the last bond there is no growth, and the load goes on to the end time."""
    simulation = follow(bar(0.3 * CRITICAL))
    *_, last = simulation.steps(1e4)
    assert last.time == 1e4
    assert last.energies["dissipated_cohesion"] == pytest.approx(100.0 * HEIGHT, rel=1e-6)
    assert abs(simulation.reaction(RIGHT)[0]) < 1e-6 * BOND.strength * HEIGHT


def test_a_path_that_branches_is_told(caplog):
    """A bar that may bend can open at either end of its bond, once it softens enough."""
    scene = bar(20.0 * CRITICAL)
    loads = [load for load in scene.loads if load.facets == LEFT or load.component == 0]
    loads.append(xf.PrescribedDisplacement(LEFT, 1, 0.0))
    simulation = follow(replace(scene, loads=loads), growth=0.05)
    with caplog.at_level("WARNING", logger="xper_fx"):
        for step in simulation.steps(1e6):
            if step.energies["dissipated_cohesion"] > 20.0:
                break
    assert simulation.path.branches
    assert sum("the path branches" in r.message for r in caplog.records) == 1


def test_what_does_not_break_bears_on():
    """A bar beside the bonded one, whole: its force and its work once the bond is broken."""
    length, end = 0.3 * CRITICAL, 1e3
    bodies = box_bodies(
        (length, HEIGHT), (2, 2), "quadrilateral",
        label=lambda x: np.where(x[1] < 0.5 * HEIGHT, 2, x[0] > 0.5 * length),
        interior={7: lambda x: abs(x[1] - 0.5 * HEIGHT) < 1e-9},
    )  # fmt: skip
    held = [(LEFT, 0), (LEFT, 1), (RIGHT, 1)]
    loads = [xf.PrescribedDisplacement(side, axis, 0.0) for side, axis in held]
    loads.append(xf.PrescribedDisplacement(RIGHT, 0, lambda t: 1e-6 * t))
    simulation = follow(xf.Scene(
        bodies, {1: xf.materials.LinearElastic(E, 0.0, 2400.0)}, loads=loads,
        default_interaction=BOND, facet_interactions={7: None},
    ))  # fmt: skip
    *_, last = simulation.steps(end)
    assert last.time == end
    force = E * 1e-6 * end / length * 0.5 * HEIGHT
    assert simulation.reaction(RIGHT)[0] == pytest.approx(force, rel=1e-6)
    assert last.energies["elastic"] == pytest.approx(0.5 * force * 1e-6 * end, rel=1e-6)
    assert abs(last.energies["closure"]) < 1e-9 * last.energies["external_work"]


def test_damage_of_the_end_is_refused_by_other_solvers():
    law = CohesiveZone(1e14, 100.0, 3e6, damage="end")
    with pytest.raises(ValueError, match='takes solver="monolithic"'):
        xf.Simulation(bar(1.0, law), 1e-6)


@pytest.mark.parametrize(
    "kind, path",
    [
        (xf.materials.LinearElastic, xf.GrowthControl()),
        (xf.materials.NeoHookean, xf.GrowthControl()),
        (xf.materials.LinearElastic, xf.DissipationControl(7.0)),
    ],
)
def test_a_path_is_restarted(tmp_path, kind, path):
    """The same bits from a state that was saved on the way."""
    whole, first, second = (follow(bar(20.0 * CRITICAL, kind=kind), path) for _ in range(3))
    records = []
    for step in whole.steps(1e6):
        records.append(step)
        if len(records) == 10:
            break
    for number, _ in enumerate(first.steps(1e6), 1):
        if number == 5:
            break
    checkpoint.save(tmp_path / "state.h5", first)
    checkpoint.restore(tmp_path / "state.h5", second)
    np.testing.assert_equal(second.path.saved(), first.path.saved())
    guesses = [simulation.path.guess(simulation.state, 1.0) for simulation in (first, second)]
    assert guesses[0][0] == guesses[1][0] != first.time
    np.testing.assert_array_equal(guesses[0][1], guesses[1][1])
    for step, expected in zip(second.steps(1e6), records[5:], strict=False):
        assert step == expected


def test_paths_that_cannot_be_followed_are_refused():
    with pytest.raises(ValueError, match="inertia=False"):
        xf.Simulation(bar(1.0), 1.0, path=xf.GrowthControl())
    with pytest.raises(TypeError, match="GrowthControl or an xf.DissipationControl, got 'growth'"):
        xf.Simulation(bar(1.0), 1.0, inertia=False, path="growth")
    with pytest.raises(ValueError, match="growth"):
        xf.GrowthControl(growth=-1.0)
    for share in ({"growth": 1e-17}, {"relative": 1e-17}):
        with pytest.raises(ValueError, match="should be at least 1e-06"):
            xf.GrowthControl(**share)
    for control in (xf.GrowthControl, partial(xf.DissipationControl, 1.0)):
        with pytest.raises(ValueError, match="longest should be a finite number above zero"):
            control(longest=0.0)
        with pytest.raises(ValueError, match="longest should be at least 1e-06, or no path ends"):
            control(longest=1e-17)
    for law in (CohesiveZone(1e14, 100.0, 3e6, damage="mean"), xf.laws.PerfectBond()):
        with pytest.raises(ValueError, match="no point of the scene has a law"):
            follow(bar(1.0, law))
    kernels = BOND.in_statics().kernels(2)._replace(cost=None)
    with pytest.raises(ValueError, match="a growth and no cost"):
        check_path_has_bonds([kernels], xf.DissipationControl.asks, False)
    check_path_has_bonds([kernels], xf.GrowthControl.asks, False)
    with pytest.raises(ValueError, match="A bulk with viscosity needs a time"):
        follow(bar(1.0, damping=xf.RayleighDamping(stiffness=1e-9)))
    whole = box_bodies((1.0, 1.0), (1, 1), label=0)
    held = [xf.PrescribedDisplacement(LEFT, axis, 0.0) for axis in (0, 1)]
    steel = {1: xf.materials.LinearElastic(E, 0.0, 2400.0)}
    with pytest.raises(ValueError, match="no point of the scene has a law"):
        follow(xf.Scene(whole, steel, loads=held))


def test_a_snap_is_told(caplog):
    """Under a displacement a long bar jumps to its broken state, with what it held."""
    moved = [xf.PrescribedDisplacement(RIGHT, 0, lambda t: 1e-5 * t)]
    simulation = xf.Simulation(bar(20.0 * CRITICAL, loads=moved), 25.0, inertia=False)
    with caplog.at_level("WARNING", logger="xper_fx"):
        *_, last = simulation.steps(100.0)
    told = [r.message for r in caplog.records if "snaps" in r.message]
    assert len(told) == 1 and "GrowthControl" in told[0]
    assert last.energies["dissipated_cohesion"] == pytest.approx(100.0 * HEIGHT, rel=1e-6)
    freed = last.energies["dissipated_numerical"]
    # what the bar held at its peak and took up in the step, less what the bond took
    held = 0.5 * BOND.strength * (BOND.strength / E * 20.0 * CRITICAL + 25e-5) * HEIGHT
    assert freed == pytest.approx(held - 100.0 * HEIGHT, rel=0.01)


@pytest.mark.slow
def test_viscous_bonds_snap_in_time():
    """Where the load alone finds no equilibrium; the viscosity takes up part of what is freed."""
    law = CohesiveZone(1e12, 100.0, 3e6, viscosity=0.1)
    length = 20.0 * E / law.softening_slope
    snaps = law.strength * length / E + law.elastic_opening
    moved = xf.PrescribedDisplacement(
        RIGHT, 0, lambda t: snaps * min(96.0 * t, 0.96 + 0.08 * t)
    )  # fmt: skip
    simulation = xf.Simulation(
        bar(length, law, [moved]), 1e-2, inertia=False, max_halvings=16
    )  # fmt: skip
    before, peak = 0.0, 0.0
    for step in simulation.steps(1.0):
        viscous = step.energies["dissipated_viscous_bonds"]
        assert viscous >= before
        before, peak = viscous, max(peak, simulation.reaction(RIGHT)[0])
        assert abs(step.energies["closure"]) < 1e-8 * step.energies["external_work"]
    assert step.energies["dissipated_cohesion"] == pytest.approx(100.0 * HEIGHT, rel=1e-9)
    assert simulation.reaction(RIGHT)[0] == pytest.approx(0.0, abs=1e-6 * law.strength)
    assert viscous > 0.3 * (0.5 * peak**2 * length / E - 100.0 * HEIGHT)


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("share", [0.3, 20.0])
def test_lips_that_are_pressed_do_not_lead_the_path(path, share):
    """How closed lips move is rounding: it tells neither a load nor which way goes on."""
    length = share * CRITICAL
    pressed = [xf.PrescribedDisplacement(RIGHT, 0, lambda t: -1e-6 * t)]
    simulation = follow(bar(length, loads=pressed), path)
    times = [step.time for step in simulation.steps(1e3)]
    np.testing.assert_allclose(times, 50.0 * np.arange(1, 21), rtol=1e-12)
    assert simulation.reaction(RIGHT)[0] == pytest.approx(-1e-3 * E * HEIGHT / length, rel=1e-9)


def test_an_end_before_the_present_is_refused():
    simulation = follow(bar(1.0))
    next(simulation.steps(1e6))
    with pytest.raises(ValueError, match="lies before the present time"):
        next(simulation.steps(0.5 * simulation.time))
