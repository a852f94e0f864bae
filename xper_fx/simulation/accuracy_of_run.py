# SPDX-License-Identifier: LGPL-3.0-or-later
"""The control of step and tolerance that the model of a run calls for."""

from __future__ import annotations

import math

import numpy as np

from xper_fx.bulk.bulk import Bulk
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.laws.softening import softening_numbers
from xper_fx.scene.scene import Scene
from xper_fx.simulation.accuracy_control import LARGEST_GROWTH, AccuracyControl
from xper_fx.simulation.error_estimate import ErrorEstimate
from xper_fx.simulation.load_histories import LoadHistories
from xper_fx.simulation.options import Options
from xper_fx.simulation.step_doubling import StepDoubling

# Implicit steps over the shortest from which they are cheaper than explicit ones, by the number of
# unknowns that there are fewer of; of more.
_CHEAPER, _OF_MORE = {1000: 4.0, 4000: 8.0}, 16.0
# The shortest implicit step, over the critical one.
SHORTEST = 0.7
# Phases of waves run ahead by half of what those of the trapezoidal rule lag (Hughes 1987, 9.1.3).
_OF_CENTRAL_DIFFERENCES = 0.5


def control_of(
    options: Options,
    scene: Scene,
    bulk: Bulk,
    points: Interactions | None,
    searched: bool,
    theta: float,
    held: float,
    base: float,
) -> AccuracyControl:
    """Of a run for which an accuracy is asked.

    Args:
        options, scene, bulk, points: of the run.
        searched: whether contacts are searched.
        theta: weight of the end of the step.
        held: kinetic and elastic energy at the start (J; 2D: J/m).
        base: first step (s).
    """
    softening, requested = np.inf, options.requested
    if points is not None:
        number = softening_numbers(points, base, theta).max(initial=0.0)
        softening = base / math.sqrt(number) if number > 0.0 else np.inf
    inertia, explicit = bulk.inertia is not None, options.scheme == "explicit"
    flows, interacting, doubling = bulk.forms.plastic, points is not None, None
    if not (searched or explicit):  # twice the step of an explicit bulk may be unstable
        if flows or (interacting and not inertia):
            doubling = StepDoubling(follows=flows and not inertia)
    holds = bulk.num_common == 0  # supports of a driven cell bear nothing but rounding
    estimate = ErrorEstimate(
        held,
        doubling=doubling,
        supported=holds and bulk.ranks.max(bool(bulk.layout.prescribed.any())) > 0,
        lag=1.0 - theta,
        lags=inertia or (interacting and not flows),
        ranks=bulk.ranks,
    )
    if not inertia and requested.adapts_step:
        bulk.critical_step()  # of the start, as a run has it that goes on from a checkpoint
        estimate.rounding = bulk.rounding
    if explicit and not interacting:
        estimate.lagging = _OF_CENTRAL_DIFFERENCES
    largest = LARGEST_GROWTH * base if inertia else np.inf
    return AccuracyControl(
        requested, base if inertia or not requested.adapts_step else None,
        largest=base if explicit else largest,
        softening_step=softening, interacting=interacting, estimate=estimate,
        histories=LoadHistories(scene),
    )  # fmt: skip


def first_implicit_step(bulk: Bulk) -> float:
    """Of a run that begins with an explicit bulk (s): it is cheaper from there on."""
    count = bulk.num_dofs_of_all
    times = next((times for most, times in _CHEAPER.items() if count < most), _OF_MORE)
    return times * SHORTEST * bulk.critical_step()
