# SPDX-License-Identifier: LGPL-3.0-or-later
"""Delamination of beams, small: against beam theory, J and w for each length of crack."""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from beam_delamination import (  # noqa: E402
    DCB,
    ENF,
    MIDDLE,
    MMB,
    PUSHED,
    UPPER_END,
    compare,
    delaminate,
    scene_of,
)

import xper_fx as xf  # noqa: E402

# Facets of half a millimetre, three to four in the cohesive zone.
small = partial(replace, facet=0.5e-3, across=2, growth=3e-3)
run = cache(delaminate)


@pytest.mark.parametrize("beam", [DCB, ENF, MMB], ids=lambda b: b.kind)
def test_beam_theory_is_its_own_inverse(beam):
    """A compliance gives its crack back, and G = P^2 / 2 dC/da."""
    for crack in (beam.crack, 1.3 * beam.crack):
        assert beam.crack_of(beam.compliance(crack)) == pytest.approx(crack, rel=1e-12)
        slope = (beam.compliance(crack * 1.0001) - beam.compliance(crack * 0.9999)) / (2e-4 * crack)
        assert beam.release_rate(7.0, crack) == pytest.approx(24.5 * slope, rel=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("beam", "peak", "share"),
    [
        (small(DCB, strength=28.5e6), 0.957, 1.0),
        (small(ENF), 0.962, 0.0),
        (small(MMB), 0.973, 0.507),
    ],
    ids=lambda value: getattr(value, "kind", None),
)
def test_the_crack_takes_its_toughness(beam, peak, share):
    """The peak is that of the cohesive zone: `benchmarks/` has it for other strengths."""
    found = compare(beam, run(beam))
    assert found.zone > 3.0
    assert found.share == pytest.approx(share, abs=2e-3)
    assert found.compliance == pytest.approx(1.0, abs=6e-3)
    assert found.peak == pytest.approx(peak, abs=5e-3)
    assert found.started == pytest.approx(1.0, abs=1.5e-2)
    assert found.grown == pytest.approx(1.0, abs=1e-2)
    assert found.rate == pytest.approx(1.0, abs=1e-2)
    assert found.spent == pytest.approx(1.0, abs=3e-3)
    assert abs(found.numerical) < 1e-2
    assert abs(found.closure) < 1e-7


@pytest.fixture
def bent():
    """The end-notched beam and its curve with both arms held."""
    beam = small(ENF)
    return beam, run(beam)


@pytest.mark.slow
def test_lips_alone_may_carry_an_arm(bent):
    """The lower arm is supported, the upper one lies on it: by theory both bend alike."""
    beam, held = bent
    scene = scene_of(beam)
    scene = replace(scene, loads=[load for load in scene.loads if load.facets != UPPER_END])
    lying = delaminate(beam, scene)
    assert lying.load.max() == pytest.approx(held.load.max(), rel=2e-3)
    assert lying.displacement[0] / lying.load[0] == pytest.approx(
        held.displacement[0] / held.load[0], rel=2e-3
    )
    assert lying.dissipated[-1] == pytest.approx(held.dissipated[-1], rel=3e-2)
    assert abs(lying.closure) < 1e-7


@pytest.mark.slow
def test_a_beam_that_is_moved_bears_what_one_under_a_force_does(bent):
    """The section at mid span is lowered along a path: its reaction is the load."""
    beam, held = bent
    scene = scene_of(beam)
    loads = [load for load in scene.loads if load.facets != PUSHED]
    moved = beam.starting_load * beam.compliance(beam.crack)
    loads.append(xf.PrescribedDisplacement(MIDDLE, 1, lambda t: -moved * t))
    scene = replace(scene, loads=loads)
    simulation = xf.Simulation(scene, 1.0, inertia=False, path=xf.GrowthControl(beam.step))
    forces = []
    for step in simulation.steps(1e3):
        forces.append(-simulation.reaction(MIDDLE)[1])
        if step.energies["dissipated_cohesion"] > held.dissipated[-1]:
            break
    assert max(forces) == pytest.approx(held.load.max(), rel=1e-2)
