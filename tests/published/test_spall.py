# SPDX-License-Identifier: LGPL-3.0-or-later
"""A bar that spalls where a pulse comes back from its free end, against closed forms.

A pressure that rises to P within `RISE` and then falls linearly to zero within T runs along a bar
at c = sqrt(E / rho), and comes back as tension from the free end. At the distance d from this end
the peak, -P, meets P (1 - 2 d / (c T)) that still arrives, so that the tension is 2 d P / (c T). It
reaches the strength S first at

    d = S c T / (2 P),    t = RISE + (L + d) / c.

The free end has moved at most at 2 P / (rho c), and slows down by 2 S / (rho c) before it hears of
the spall, which is how experiments measure S (Novikov, Divnov and Ivanov 1966). The mean of both
parts of the pulse in the scab is P - S / 2 then, so that the scab flies off at (2 P - S) / (rho c),
less what the bond takes while it breaks (Kolsky 1953, Stress Waves in Solids).
"""

import numpy as np
import pytest

import xper_fx as xf

LENGTH, SIDE = 0.1, 5e-4  # m
YOUNG, DENSITY, STRENGTH, W = 30e9, 2400.0, 6e6, 1.0
SPEED = (YOUNG / DENSITY) ** 0.5
PRESSURE, RISE, FALL = 1.5 * STRENGTH, 5e-6, 20e-6
PLACE = 0.5 * STRENGTH / PRESSURE * SPEED * FALL
TIME = RISE + (LENGTH + PLACE) / SPEED
LOADED, FREE = 1, 2


def pulse(time):
    return PRESSURE * min(time / RISE, max(0.0, 1.0 - (time - RISE) / FALL))


@pytest.mark.slow
def test_place_time_pull_back_and_speed_of_the_scab():
    mesh = xf.crossed_rectangle((0.0, 0.0), (LENGTH, SIDE), (round(LENGTH / SIDE), 1))
    ends = {LOADED: lambda x: x[0] < 1e-9, FREE: lambda x: x[0] > LENGTH - 1e-9}
    scene = xf.Scene(
        xf.explode(mesh, facet_tags=xf.tag_facets(mesh, ends)),
        {1: xf.materials.LinearElastic(young=YOUNG, poisson=0.0, density=DENSITY)},
        default_interaction=xf.laws.RigidCohesiveZone(STRENGTH, W),
        loads=[xf.SurfaceTraction(LOADED, (pulse, 0.0))],
    )
    simulation = xf.Simulation(scene, scheme="explicit")
    records = []
    for step in simulation.steps(TIME + 2.0 * PLACE / SPEED):
        spent = step.energies["dissipated_cohesion"]
        records.append((step.time, simulation.mean_displacement(FREE)[0], spent))
    time, moved, spent = np.transpose(records)
    assert time[spent > 0.0][0] == pytest.approx(TIME, rel=0.01)

    cracks = xf.output.find_cracks(simulation)
    scab = LENGTH - cracks.segments[..., 0].max()
    assert scab == pytest.approx(PLACE, abs=2.0 * SIDE)
    assert not cracks.kind.any()

    end = np.diff(moved) / np.diff(time)
    unaware = end[time[1:] < TIME + PLACE / SPEED + 2e-6]
    peak = unaware.argmax()
    assert unaware[peak] == pytest.approx(2.0 * PRESSURE / (DENSITY * SPEED), rel=0.01)
    pull_back = unaware[peak] - unaware[peak:].min()
    assert pull_back == pytest.approx(2.0 * STRENGTH / (DENSITY * SPEED), rel=0.01)

    pieces = xf.output.measure_fragments(simulation)
    (scab,) = np.flatnonzero(pieces.centre[:, 0] > LENGTH - 0.6 * PLACE)
    flight = (2.0 * PRESSURE - STRENGTH) / (DENSITY * SPEED)
    assert 0.88 * flight < pieces.velocity[scab, 0] < flight
