# SPDX-License-Identifier: LGPL-3.0-or-later
"""Initially rigid bonds without inertia: what holds is one body, what opens is on its curve."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scenes import BACK, BOTTOM, LEFT, RIGHT, TOP, box_bodies, field, nodes, run
from scipy.optimize import brentq

import xper_fx as xf

NU, S, W = 0.3, 1e-2, 4e-4
DC = 2.0 * W / S
ELASTIC = xf.materials.LinearElastic(young=1.0, poisson=NU, density=1.0)
BOXES = {
    2: ("crossed", (2.0, 1.0), (4, 2)),
    3: ("tetrahedron", (2.0, 1.0, 1.0), (4, 2, 2)),
}
# Of a bar that is free to contract: in plane strain, and in space.
MODULUS = {2: 1.0 / (1.0 - NU**2), 3: 1.0}
ROLLERS = ((LEFT, 0), (BOTTOM, 1), (BACK, 2))
in_both = pytest.mark.parametrize("dim", [2, 3])


def middle(strength):
    """A strength that is higher by a quarter but in the middle of the bar."""
    return lambda x: np.where(np.abs(x[0] - 1.0) < 1e-9, 1.0, 1.25) * strength


def bond(**options):
    return xf.laws.RigidCohesiveZone(middle(S), W, **options)


def bar(dim, law, moved, steps=1.0, label=None, **options):
    """A bar whose ends are pulled apart by a function of time."""
    kind, lengths, cells = BOXES[dim]
    loads = [xf.PrescribedDisplacement(side, axis, 0.0) for side, axis in ROLLERS[:dim]]
    loads.append(xf.PrescribedDisplacement(RIGHT, 0, moved))
    scene = xf.Scene(
        box_bodies(lengths, cells, kind, label=label), {1: ELASTIC}, default_interaction=law,
        loads=loads, **options,
    )  # fmt: skip
    return static(scene, steps)


def static(scene, step=1.0, **options):
    return xf.Simulation(scene, step, inertia=False, newton_tolerance=1e-10, **options)


@pytest.mark.parametrize("order", [1, 2])
@in_both
def test_what_holds_is_one_body(dim, order):
    """Pulled, sheared and pressed, to the tolerance; no bond has opened."""
    kind, lengths, cells = BOXES[dim]
    loads = [xf.PrescribedDisplacement(LEFT, axis, 0.0) for axis in range(dim)]
    loads.append(xf.SurfaceTraction(RIGHT, (6e-4, -3e-4, 3e-4)[:dim]))
    ours = []
    for label, law in ((None, xf.laws.RigidCohesiveZone(S, W, friction=0.3)), (0, None)):
        bodies = box_bodies(lengths, cells, kind, label=label)
        scene = xf.Scene(bodies, {1: ELASTIC}, default_interaction=law, loads=loads, order=order)
        simulation = static(scene)
        (step,) = run(simulation, 1)
        ours.append((nodes(simulation), field(simulation), step.newton_iterations))
    (x, u, count), (x1, u1, _) = ours
    place = np.array([np.argmin(np.sum((x1 - p) ** 2, axis=1)) for p in x])
    assert np.abs(u - u1[place]).max() < 1e-9 * np.abs(u1).max()
    assert np.abs(u1).max() > 1e-3
    assert count <= 8


@pytest.mark.parametrize(
    "law",
    [bond(), bond(friction=0.3), xf.laws.RigidMixedMode((middle(S), 2.0 * S), (W, 3.0 * W), 1.5)],
    ids=["plain", "friction", "modes"],
)
@in_both
def test_a_bar_follows_its_curve_back_and_to_the_end(dim, law):
    """u = 2 sigma / E' + x with sigma = s (1 - x / dc); along the secant on the way back."""
    times, path = range(8), [0.0, 0.015, 0.03, 0.05, 0.02, 0.05, 0.07, 0.1]
    simulation = bar(dim, law, lambda t: float(np.interp(t, times, path)), 0.5)
    stiffness, top = MODULUS[dim] / 2.0, 0.0
    for step in simulation.steps(times[-1]):
        u = float(np.interp(step.time, times, path))
        top = max(top, u)
        softening = S * (1.0 - top / DC) / (1.0 - S / (stiffness * DC))
        expected = u * min(stiffness, max(softening, 0.0) / top)
        assert simulation.reaction(RIGHT)[0] == pytest.approx(expected, rel=1e-7, abs=1e-9 * S)
        assert abs(simulation.ledger.closure) < 1e-7 * W
    spent, area = (simulation.interactions.gather(n) for n in ("spent", "area"))
    assert spent @ area == pytest.approx(1.0, rel=1e-12)
    assert set(spent) == {0.0, 1.0}
    cohesion = simulation.ledger.energies.dissipated_cohesion
    assert cohesion == pytest.approx(W, rel=1e-12)


def test_a_viscous_bond_bears_more_the_faster_it_opens():
    """sigma = T(x1) (1 + eta (x1 - x0) / (h s)), and the work of the excess is booked apart."""
    eta, h, rate, stiffness = 0.05, 0.25, 0.015, MODULUS[2] / 2.0
    simulation = bar(2, bond(viscosity=eta), lambda t: rate * t, h)
    x = viscous = 0.0
    for step in simulation.steps(4.0):
        u = rate * step.time

        def excess(x1, u=u, x0=x):
            borne = S * (1.0 - x1 / DC) * (1.0 + eta * (x1 - x0) / (h * S))
            return stiffness * (u - x1) - borne

        if stiffness * u > S:
            x1 = brentq(excess, x, u, xtol=1e-16)
            viscous += eta * (1.0 - x1 / DC) * (x1 - x) ** 2 / h
            x = x1
        assert simulation.reaction(RIGHT)[0] == pytest.approx(stiffness * (u - x), rel=1e-6)
    assert 0.3 * DC < x < DC
    assert simulation.ledger.energies.dissipated_viscous_bonds == pytest.approx(viscous, rel=1e-5)


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_under_pressure_friction_helps_the_bond(friction):
    """Two blocks, pressed and sheared: each point bears s + mu N, and mu N is left in the end."""
    pressed, law = 0.5 * S, xf.laws.RigidCohesiveZone(S, 0.02 * W, friction=friction)
    bodies = box_bodies((1.0, 0.5), (2, 2), label=lambda x: x[1] > 0.25)
    loads = [xf.PrescribedDisplacement(BOTTOM, axis, 0.0) for axis in (0, 1)]
    loads += [
        xf.SurfaceTraction(TOP, (0.0, -pressed)),
        xf.PrescribedDisplacement(TOP, 0, lambda t: 3e-5 * t + 2e-3 * max(0.0, t - 1.0)),
    ]
    stiff = xf.materials.LinearElastic(1e3, NU, 1.0)
    simulation = static(
        xf.Scene(bodies, {1: stiff}, default_interaction=law, loads=loads), 1.0 / 32.0
    )
    points, most = simulation.interactions, -1.0
    for step in simulation.steps(2.0):
        pull = points.gather("impulse") / (step.size * points.gather("area"))[:, None]
        sound = points.gather("opening_max") == 0.0
        share = (np.abs(pull[:, 1]) - S) / (friction * pull[:, 0] if friction else S)
        most = max(most, share[sound & (pull[:, 0] > 0.0)].max(initial=-1.0))
    if friction:
        assert 0.8 < most < 1.0 + 1e-9
    else:
        assert -0.2 < most < 1e-9
    assert simulation.reaction(TOP)[0] == pytest.approx(friction * pressed, rel=1e-7, abs=1e-12)
    assert points.gather("spent").min() == 1.0
    e = simulation.ledger.energies
    assert e.dissipated_cohesion == pytest.approx(0.02 * W, rel=1e-12)
    assert (e.dissipated_friction > 0.0) == (friction > 0.0)


def test_no_traction_of_a_cracking_plate_exceeds_the_strength():
    """Bonds all around vertices, whose impulses are redundant while they hold."""
    n = 6
    mesh = xf.crossed_rectangle((0.0, 0.0), (1.0, 1.0), (n, n))
    tags = xf.tag_facets(
        mesh,
        {
            1: lambda x: (x[0] < 1e-9) & (x[1] < 1.0 / 3.0 + 1e-9),
            2: lambda x: (x[0] < 1e-9) & (x[1] > 2.0 / 3.0 - 1e-9),
            3: lambda x: x[0] > 1.0 - 1e-9,
            4: lambda x: (np.abs(x[1] - 0.5) < 1e-9) & (x[0] < 1.0 / 3.0 + 1e-9),
        },
    )
    pulls = [(1, 1, lambda t: -0.1 * t), (2, 1, lambda t: 0.1 * t), (3, 0, 0.0), (3, 1, 0.0)]
    law = xf.laws.RigidCohesiveZone(S, 3e-4, viscosity=0.01)
    scene = xf.Scene(
        xf.explode(mesh, facet_tags=tags), {1: ELASTIC}, default_interaction=law,
        facet_interactions={4: None}, loads=[xf.PrescribedDisplacement(*pull) for pull in pulls],
    )  # fmt: skip
    simulation = xf.Simulation(scene, 0.05, inertia=False, max_halvings=4)
    held = 0
    for step in simulation.steps(1.0):
        points = simulation.interactions
        impulse, area, reached = (points.gather(n) for n in ("impulse", "area", "opening_max"))
        pull = impulse / (step.size * area)[:, None]
        pull[:, 0] = np.maximum(-pull[:, 0], 0.0)
        sound = reached == 0.0
        traction = np.linalg.norm(pull[sound & (impulse[:, 0] <= 0.0)], axis=1)
        assert traction.max() < (1.0 + 1e-7) * S
        held = max(held, np.count_nonzero(traction > 0.9 * S))
    assert held > 5
    assert 0.1 < simulation.interactions.gather("spent") @ area < 0.6


def two_blocks(law, **options):
    """Two halves, each held, so that any solver may take them."""
    sides = [(side, axis) for side in (LEFT, RIGHT) for axis in (0, 1)]
    loads = [xf.PrescribedDisplacement(*side, 0.0) for side in sides]
    scene = xf.Scene(
        box_bodies((2.0, 1.0), (4, 2), label=lambda x: x[0] > 1.0), {1: ELASTIC},
        default_interaction=law, loads=loads,
    )  # fmt: skip
    return xf.Simulation(scene, 0.1, **options)


@pytest.mark.parametrize(
    ("options", "law", "words"),
    [
        ({"inertia": False, "solver": "nlgs"}, {}, 'in one system: leave solver at "auto"'),
        ({"inertia": False}, {"damage": "mean"}, 'of the end of the step: leave damage at "auto"'),
        ({"solver": "monolithic"}, {"damage": "end"}, "are for static runs"),
        ({"inertia": False, "path": xf.GrowthControl()}, {}, "A path follows the damage of bonds"),
    ],
)
def test_runs_that_cannot_be_are_refused(options, law, words):
    with pytest.raises(ValueError, match=words):
        two_blocks(xf.laws.RigidCohesiveZone(S, W, **law), **options)


def test_damage_that_lags_is_refused():
    with pytest.raises(ValueError, match='should be "auto", "mean" or "end"'):
        dataclasses.replace(bond(), damage="lagged")


@pytest.mark.slow
def test_a_fragment_that_comes_loose_is_named():
    """The middle of a bar between two weak sections, which tear together with some viscosity.

    A step ends just before, that few are tried in vain.
    """
    at = np.array([0.5, 1.5])

    def strength(x):
        return np.where(np.isclose(x[0], at[:, None]).any(axis=0), 1.0, 1.5) * S

    law = xf.laws.RigidCohesiveZone(strength, W, viscosity=0.1)
    scene = bar(2, law, lambda t: 0.04 * t).scene
    simulation = static(scene, 3.98 / 8, max_halvings=1)
    middle = r"comes loose: bodies 7, 9, .* \(16 in all\) around \(1, 0.5\), .* inertia=True"
    spent = []
    with pytest.raises(xf.ConvergenceError, match=middle):
        for record in simulation.steps(10.0):
            spent.append(record.energies["dissipated_cohesion"])
    assert spent[-1] == pytest.approx(2.0 * W, rel=0.01)


@pytest.mark.parametrize("cut", [True, False], ids=["contact alone", "one body"])
def test_no_fragment_is_named_where_no_bond_has_broken(cut):
    """A block that contact alone holds is pressed, then pulled; or there is nothing to break."""
    label = (lambda x: x[0] > 1.0) if cut else 0
    loads = [xf.PrescribedDisplacement(LEFT, axis, 0.0) for axis in range(2)]
    loads.append(xf.SurfaceTraction(RIGHT, (lambda t: 1e-2 * (t - 1.5), 0.0)))
    law = xf.laws.SignoriniCoulomb(0.3)
    bodies = box_bodies((2.0, 1.0), (4, 2), "crossed", label=label)
    matter = ELASTIC if cut else xf.materials.NeoHookean(1.0, NU, 1.0)
    scene = xf.Scene(bodies, {1: matter}, default_interaction=law, loads=loads)
    options = {} if cut else {"max_newton": 1}
    simulation = static(scene, solver="monolithic", **options)
    with pytest.raises(xf.ConvergenceError, match="There may be no equilibrium") as told:
        run(simulation, 4)
    assert "fragment" not in str(told.value)
