# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Errors of the quantities that one asks for, from runs that are finer.

A run has q_h, one with a quarter of the accuracy asked for (or half of the step given) q_f. Where
the error is c e, proportional to the accuracy e, it is

    q_h - q = (q_h - q_f) / (1 - 4^-n)

after n such refinements (Richardson 1911). A step of half the size leaves a quarter of a
second-order error and half of a first-order one, of which one refinement gives 2/3 and two give
4/5. Where the control has no shorter step to take a finer run has half of the mean step of the run
before. An error that comes and goes with the step, as those of largest forces among waves do, may
be nearly the same in two runs, hardly in three.

`benchmarks/estimate_coverage.py --quantities` compares these errors with true ones.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation
from xper_fx.study.quantities import Quantity, Value
from xper_fx.support.checks import require_count, require_kind, require_positive

# What a finer run is asked for beside the run before, and the least number of its steps beside that
# one's with which it counts as finer.
_FINER, _MORE_STEPS = 0.25, 1.7


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
    refinements: int = 1,
    **options: Any,
) -> dict[str, Estimated]:
    """Run a scene as the options say, and finer, and compare what is asked for.

    A finer run takes two to four times as long as the one before. What a mesh leaves is not part of
    the errors: `build` has one mesh.

    Args:
        build: makes the scene, anew for each run.
        end_time: s.
        quantities: by name, of `xf.quantities` or one's own.
        refinements: how many finer runs are made, each finer than the one before; two tell errors
            that come and go with the step better than one does.
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
    values, count, (scheme, mean_step) = _run(build, end_time, quantities, options)
    finest = values
    for _ in range(refinements):
        tighter = {
            name: _FINER * options[name]
            for name in ("accuracy", "tolerance", "newton_tolerance")
            if isinstance(options.get(name), float)
        }
        if isinstance(options.get("step"), float | int):
            tighter["step"] = 0.5 * options["step"]
        tighter["scheme"] = scheme  # picked, it could be another with another step
        options, less, half = options | tighter, count, 0.5 * mean_step
        finest, count, (_, mean_step) = _run(build, end_time, quantities, options)
        if count < _MORE_STEPS * less:
            options["step"] = half
            finest, count, (_, mean_step) = _run(build, end_time, quantities, options)
    of_difference = 1.0 / (1.0 - _FINER**refinements)
    return {
        name: Estimated(
            values[name], of_difference * quantity.error(values[name], finest[name]), finest[name]
        )
        for name, quantity in quantities.items()
    }


def _run(
    build: Callable[[], Scene],
    end_time: float,
    quantities: Mapping[str, Quantity],
    options: Mapping[str, Any],
) -> tuple[dict[str, Value], int, tuple[str | None, float]]:
    """What a run gives, how many steps it takes, of which scheme and of which mean size (s)."""
    simulation, count = Simulation(build(), **options), 0
    start = simulation.time
    seen: dict[str, Any] = dict.fromkeys(quantities)
    for step in simulation.steps(end_time):
        count += 1
        for name, quantity in quantities.items():
            seen[name] = quantity.observe(simulation, step, seen[name])
    values = {name: q.value(simulation, seen[name]) for name, q in quantities.items()}
    scheme = None if simulation.scene.bodies is None else simulation.options.scheme
    return values, count, (scheme, (end_time - start) / max(count, 1))
