# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bonded bodies in steady spin: nothing changes but the angle; loaded then, they do not know it.

The spin is one of the discrete equations (`spinning.py`), with bonds in plain NumPy: to rounding,
no body swings, and tractions are those of the static problem of the centrifugal field.
"""

from __future__ import annotations

import numpy as np
import pytest
from scenes import LEFT, RIGHT, box_bodies, field, mesh_of, midpoints, nodes, side_tags
from spinning import Spin, SteadySpin, turned
from test_turned_bonds import momenta

from xper_fx.bodies.explode import explode
from xper_fx.forms.loads import SurfaceTraction
from xper_fx.materials import NeoHookean
from xper_fx.nscd.laws import CohesiveZone
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

YOUNG, NORMAL, TANGENTIAL, ENERGY = 100.0, 1000.0, 300.0, 0.1
# Of the spin (1/s), and steps in a quarter turn.
SPEED, STEPS = 2.0, 20


def chevron():
    """A box of two bodies that meet in two slanting planes, with z a principal axis."""
    lengths = (2, 1, 1)
    mesh = mesh_of(lengths, (2, 1, 2), "hexahedron")
    tags, x = side_tags(mesh, lengths), mesh.geometry.x
    between = np.abs(x[:, 0] - 1.0) < 1e-9
    x[between, 0] += 0.3 * np.abs(x[between, 2] - 0.5) - 0.2 * (x[between, 1] - 0.5)
    return explode(mesh, (midpoints(mesh)[0] > 1.0).astype(int), None, tags)


def spinning(bodies, bond, scheme, loads=(), poisson=0.3, steps=STEPS):
    """A run that is about to begin, with so many steps in a quarter turn."""
    scene = Scene(
        bodies,
        {1: NeoHookean(YOUNG, poisson, 1.0)},
        default_interaction=bond,
        loads=list(loads),
    )
    tight = {"tolerance": 1e-13, "num_threads": 1}
    if scheme == "implicit":
        tight["newton_tolerance"] = 1e-14
    step = 0.5 * np.pi / steps / SPEED
    return Simulation(scene, step, scheme=scheme, **tight)


def turn(simulation, steps):
    """Records of steps of full length, up to a number of them from the start of the run."""
    return simulation.steps((steps + 1e-9) * simulation.step_size)


KINDS = [
    (2, "explicit", NORMAL),
    (2, "explicit", TANGENTIAL),
    pytest.param(3, "explicit", NORMAL, marks=pytest.mark.slow),
    pytest.param(2, "implicit", TANGENTIAL, marks=pytest.mark.slow),
    pytest.param(2, "implicit", NORMAL, marks=pytest.mark.slow),
    pytest.param(3, "implicit", NORMAL, marks=pytest.mark.slow),
]


@pytest.mark.parametrize("dim, scheme, tangential", KINDS)
def test_free_spin_is_steady(dim, scheme, tangential, figure):
    """A plate of cells or a box of two bodies: energies, momenta, tractions over a turn."""
    bodies = box_bodies((2, 1), (2, 1)) if dim == 2 else chevron()
    each = 2 * STEPS if (dim, scheme) == (2, "explicit") else STEPS  # small cells move freely
    bond = CohesiveZone(NORMAL, 0.5, 8.0, tangential)
    simulation = spinning(bodies, bond, scheme, steps=each)
    steady = SteadySpin(simulation, Spin(0.5 * np.pi / each, (NORMAL, tangential)))
    steady.give(simulation)
    assert np.abs(steady.traction).max() > 1.5 and steady.traction[:, 0].max() < -0.1
    linear, angular = momenta(simulation)
    size, first, changes = np.linalg.norm(angular), None, []
    for number, record in enumerate(turn(simulation, 4 * each), start=1):
        columns = np.array(list(record.energies.values()))
        first = columns if first is None else first
        if number in (each, 2 * each, 4 * each):
            now, turning = momenta(simulation)
            momentum = max(np.abs(now - linear).max(), np.abs(turning - angular).max()) / size
            there = steady.at(0.5 * np.pi * number / each)
            apart = np.abs(nodes(simulation) + field(simulation) - there).max()
            traction = simulation.interactions.gather("traction")
            off = np.abs(traction - steady.traction).max() / np.abs(steady.traction).max()
            energy = np.abs(columns - first).max() / record.energies["kinetic"]
            changes.append((energy, momentum, off, apart))
    assert len(changes) == 3
    energy, momentum, off, apart = np.max(changes, axis=0)
    what = f"a turn of steady spin, {dim}D, {scheme}, C_T / C_N = {tangential / NORMAL}"
    figure(what, "change of any energy < 1e-10", energy)
    figure(what, "change of momenta < 1e-10", momentum)
    figure(what, "traction beside that of statics < 1e-9", off)
    assert energy < 1e-10
    assert momentum < 1e-10
    assert off < 1e-9
    assert apart < 1e-9
    assert simulation.interactions.gather("damage").min() == 1.0


def test_a_thin_bar_has_the_traction_of_the_centrifugal_field(figure):
    """rho omega^2 (l^2 - s^2) / 2 at s from the middle of a bar of half-length l, turned by 90.

    And exactly what the lumped masses beyond s ask for.
    """
    half, count, steps, stiff = 1.0, 8, 100, 1e4
    bodies = box_bodies((2.0 * half, 0.5), (count, 1), "quadrilateral")
    bond, angle = CohesiveZone(stiff, 5.0, 8.0), 0.5 * np.pi / steps
    simulation = spinning(bodies, bond, "explicit", poisson=0.0, steps=steps)
    steady = SteadySpin(simulation, Spin(angle, (stiff, stiff)))
    steady.give(simulation)
    list(turn(simulation, steps))
    pull = -simulation.interactions.gather("traction")[:, 0]
    cuts = np.repeat(bodies.facets.midpoint[:, 0], 2) - half
    expected = 0.5 * SPEED**2 * (half**2 - cuts**2)
    error = np.abs(pull / expected - 1.0).max()
    figure("thin bar in steady spin", "traction beside rho omega^2 (l^2 - s^2) / 2 < 0.04", error)
    assert error < 0.04  # it stretches by 2 %
    V = simulation.forms.V
    away = steady.position[:, 0] - steady.centre[0]
    field_of = (2.0 * np.sin(0.5 * angle) / simulation.step_size) ** 2 / np.cos(0.5 * angle)
    moments = simulation.bulk.mass[::2] * field_of * away
    for cut in np.unique(np.round(cuts, 12)):
        beyond = V.dofmap.list[midpoints(V.mesh)[0] - half > cut].ravel()
        assert 0.5 * pull[np.isclose(cuts, cut)].mean() == pytest.approx(
            moments[beyond].sum(), rel=1e-9
        )


def loads_of(dim, angle, growth):
    """Tractions on both ends that turn with them.

    Args:
        dim: of space.
        angle: at which they begin to grow (rad).
        growth: Pa/s, pressing if negative.
    """
    # a little aslant, that points do not break at once
    slant = 0.1 if growth > 0.0 else 0.0

    def traction(t, sign):
        size = sign * growth * max(t - angle / SPEED, 0.0)
        return size * np.cos(SPEED * t + slant), size * np.sin(SPEED * t + slant), 0.0

    return [
        SurfaceTraction(side, tuple(lambda t, s=sign, c=c: traction(t, s)[c] for c in range(dim)))
        for side, sign in ((RIGHT, 1.0), (LEFT, -1.0))
    ]


@pytest.mark.parametrize("dim, scheme, tangential", KINDS[:-2] + KINDS[-1:])
@pytest.mark.parametrize("growth", [6.0, -24.0])
def test_loaded_after_turning(dim, scheme, tangential, growth, figure):
    """Pulled apart or pressed along the turned axis, at 40.5 and 90 degrees.

    Strength, energy spent, gaps and all motion are those of bodies that are loaded at once.
    """
    bodies = chevron() if dim == 3 else box_bodies((2, 1), (2, 1), label=lambda x: x[0] > 1)
    bond = CohesiveZone(NORMAL, ENERGY, 3.0, tangential, friction=0.3 if dim == 2 else 0.0)
    spin = Spin(0.5 * np.pi / STEPS, (NORMAL, tangential))
    found, steady = [], None
    for quarters in (0.0, 0.45, 1.0):
        before = round(quarters * STEPS)
        loads = loads_of(dim, 0.5 * np.pi * quarters, growth)
        simulation = spinning(bodies, bond, scheme, loads)
        steady = steady or SteadySpin(simulation, spin)
        steady.give(simulation)
        list(turn(simulation, before))
        interactions, peak, least = simulation.interactions, 0.0, 0.0
        more = 3 * STEPS if growth > 0.0 else STEPS // 2
        for record in turn(simulation, before + more):  # noqa: B007 - the last is looked at
            peak = max(peak, np.linalg.norm(interactions.gather("traction"), axis=1).max())
            least = min(least, interactions.gather("jump")[:, 0].min())
            if interactions.gather("damage").max() == 0.0:
                break
        place = nodes(simulation) + field(simulation) - steady.centre
        place = turned(place, -0.5 * np.pi * quarters)
        found.append((peak, least, record.energies["dissipated_cohesion"], place))
    peak, least, spent, _ = found[0]
    explicit = scheme == "explicit"
    if growth < 0.0:
        assert interactions.gather("damage").min() == 1.0
        # an explicit bulk's law takes the spin of the start, and the couple changes it
        assert spent == 0.0 and peak > 6.0 and least > (-1e-6 if explicit else -1e-10)
    else:
        assert interactions.gather("damage").max() == 0.0
        if tangential == NORMAL:
            assert peak == pytest.approx(3.0, rel=0.02)
            whole = ENERGY * interactions.points.area.sum()
            assert spent == pytest.approx(whole, rel=1e-11)
    apart = [max(np.abs(a - b).max() for a, b in zip(f, found[0], strict=True)) for f in found]
    what = f"{'pulled' if growth > 0.0 else 'pressed'} after turning, {dim}D, {scheme}"
    figure(f"{what}, C_T / C_N = {tangential / NORMAL}", "all beside unturned < 5e-9", max(apart))
    # bodies that are pressed swing further from what Newton's method leaves
    assert max(apart) < (1e-9 if explicit else 5e-9)
