# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Errors of the quantities that one asks for, from runs that are finer.

A run has q_h, one with a quarter of the accuracy asked for (or half of the step given) q_f. Where
the error is c e, proportional to the accuracy e, it is

    q_h - q = (q_h - q_f) / (1 - 4^-n)

after n such refinements (Richardson 1911). A step of half the size leaves a quarter of a
second-order error and half of a first-order one, of which one refinement gives 2/3 and two give
4/5. Where the control has no shorter step to take a finer run has half of the mean step of the run
before. An error that comes and goes with the step, as those of largest forces among waves do, may
be nearly the same in two runs, hardly in three. Where two runs differ by far more than the first
estimates of itself, one of them went another way, as a plate may that breaks alike on either side,
and a third tells which.

`benchmarks/estimate_coverage.py --quantities` compares these errors with true ones.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation
from xper_fx.study.quantities import Quantity, Value
from xper_fx.support.checks import require_count, require_kind, require_positive

# What a finer run is asked for beside the run before, and the least number of its steps beside that
# one's with which it counts as finer.
_FINER, _MORE_STEPS = 0.25, 1.7
# An error over that of the run as a whole, as it estimates it, and over what was asked for, from
# which on a third run is made.
_DISAGREE = 2.0


class Estimated(NamedTuple):
    """A quantity of a run and its error.

    Attributes:
        value: of the run with the options given.
        error: estimated, as the quantity measures it (`Quantity.error`), relative for most.
        finer: of the finest run.
    """

    value: Value
    error: float
    finer: Value


def estimate_errors(
    build: Callable[[], Scene],
    end_time: float,
    quantities: Mapping[str, Quantity],
    *,
    refinements: int | None = None,
    **options: Any,
) -> dict[str, Estimated]:
    """Run a scene as the options say, and finer, and compare what is asked for.

    A finer run takes two to four times as long as the one before. What a mesh leaves is not part of
    the errors: `build` has one mesh.

    Args:
        build: makes the scene, anew for each run.
        end_time: s.
        quantities: by name, of `xf.quantities` or one's own.
        refinements: how many finer runs are made, each finer than the one before. If None, one, and
            a second if one of the errors is more than twice what was asked for and twice what the
            run estimates of itself.
        options: of `Simulation`; `accuracy`, or a `step`, or both.

    Returns:
        By name.

    Raises:
        TypeError: quantities that are no mapping, a build that cannot be called.
        ValueError: neither an accuracy nor a step, no refinement, a path, whose states do not hang
            on the step, a quantity that is an error by itself.
        ConvergenceError: of a run.
    """
    require_kind("quantities", quantities, Mapping)
    if not callable(build):
        raise TypeError(f"build should be a function that makes a scene, got {build!r}.")
    require_positive("end_time", end_time)
    if refinements is not None:
        require_count("refinements", refinements, 1)
    for name, quantity in quantities.items():
        if not getattr(quantity, "has_reference", True):
            raise ValueError(f"{name!r} is an error by itself, {quantity!r}: read it from the run.")
    if options.get("accuracy") is None and not isinstance(options.get("step"), float | int):
        raise ValueError(
            "estimate_errors refines what is asked for: give accuracy=..., or a step in s."
        )
    if options.get("path") is not None:
        raise ValueError(
            "The states on a path do not hang on the step: compare another growth or energy."
        )
    first = last = _run(build, end_time, quantities, options)
    told = np.inf if first.estimated is None else first.estimated
    doubtful = _DISAGREE * max(told, options.get("accuracy") or 0.0)
    for number in range(1, (refinements or 2) + 1):
        options, last = _finer(build, end_time, quantities, options, last)
        of_difference = 1.0 / (1.0 - _FINER**number)
        errors = {
            name: of_difference * quantity.error(first.values[name], last.values[name])
            for name, quantity in quantities.items()
        }
        if refinements is None and max(errors.values(), default=0.0) <= doubtful:
            break
    return {
        name: Estimated(first.values[name], errors[name], last.values[name]) for name in quantities
    }


class _Run(NamedTuple):
    """What a run gives."""

    values: dict[str, Value]  #: of the quantities
    steps: int  #: how many it takes
    mean_step: float  #: their mean size (s)
    scheme: str | None  #: of the bulk, None without any
    estimated: float | None  #: error that the run estimates of itself, None if it does not


def _finer(
    build: Callable[[], Scene],
    end_time: float,
    quantities: Mapping[str, Quantity],
    options: Mapping[str, Any],
    coarse: _Run,
) -> tuple[dict[str, Any], _Run]:
    """Options of a run that is finer than one with the options given, and that run."""
    tighter = {
        name: _FINER * options[name]
        for name in ("accuracy", "tolerance", "newton_tolerance")
        if isinstance(options.get(name), float)
    }
    if isinstance(options.get("step"), float | int):
        tighter["step"] = 0.5 * options["step"]
    tighter["scheme"] = coarse.scheme  # picked, it could be another with another step
    tighter = {**options, **tighter}
    run = _run(build, end_time, quantities, tighter)
    if run.steps < _MORE_STEPS * coarse.steps:
        tighter["step"] = 0.5 * coarse.mean_step
        run = _run(build, end_time, quantities, tighter)
    return tighter, run


def _run(
    build: Callable[[], Scene],
    end_time: float,
    quantities: Mapping[str, Quantity],
    options: Mapping[str, Any],
) -> _Run:
    """Run a scene with options of `Simulation`."""
    simulation, count = Simulation(build(), **options), 0
    start = simulation.time
    seen: dict[str, Any] = dict.fromkeys(quantities)
    for step in simulation.steps(end_time):
        count += 1
        for name, quantity in quantities.items():
            seen[name] = quantity.observe(simulation, step, seen[name])
    values = {name: q.value(simulation, seen[name]) for name, q in quantities.items()}
    scheme = None if simulation.scene.bodies is None else simulation.options.scheme
    mean = (end_time - start) / max(count, 1)
    return _Run(values, count, mean, scheme, simulation.estimated_error)
