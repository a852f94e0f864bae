# SPDX-License-Identifier: LGPL-3.0-or-later
"""The price of each effect: what it costs to switch it on, and what leaving it out does.

The same scene runs with effects switched on one by one, from the plainest to all of them, and with
all of them but one. Effects are parameters of the scene or of `Simulation`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite

from xper_fx.scene.scene import Scene
from xper_fx.study.definition import Setting, Study
from xper_fx.study.quantities import Quantity
from xper_fx.study.results import StudyResults, percent
from xper_fx.support.checks import require_kind

SWITCHED_ON, LEFT_OUT = "switched on one by one", "one left out"
_PLAINEST = "plainest"


@dataclass(frozen=True)
class Price:
    """What an effect costs and what it is worth."""

    effect: str  #: its name; that of the plainest scene comes first
    seconds: float  #: of the run with it and those before
    time_ratio: float  #: over the plainest run's
    memory: float  #: peak of that run (bytes)
    #: time with all effects over time with all but this one; NaN if there is none
    full_ratio: float
    #: of each quantity when it alone is left out, relative to all effects
    change: Mapping[str, float]
    refused: str = ""  #: why it cannot be left out, "" if it can


def effects_study(
    name: str,
    build: Callable[..., Scene],
    end_time: float,
    quantities: Mapping[str, Quantity],
    plainest: Setting,
    effects: Mapping[str, Setting],
) -> Study:
    """The study whose results `prices` reads.

    Args:
        name, build, end_time, quantities: of the study.
        plainest: setting with everything off.
        effects: parameters that switch each effect on, by its name, in the order of switching on.

    Raises:
        TypeError: effects that are no mapping.
        ValueError: an effect turns a parameter that the plainest setting does not name.
    """
    require_kind("effects", effects, Mapping)
    for effect, parameters in effects.items():
        unknown = sorted(set(parameters) - set(plainest))
        if unknown:
            raise ValueError(
                f"The effect {effect!r} turns {unknown}, which the plainest setting does not name; "
                "say there what they are when it is off."
            )
    ladder = [plainest]
    for parameters in effects.values():
        ladder.append(ladder[-1] | parameters)
    full = ladder[-1]
    return Study(
        name,
        build,
        end_time,
        quantities,
        {SWITCHED_ON: ladder, LEFT_OUT: [without(full, plainest, k) for k in effects.values()]},
        reference=full,
        default=full,
    )


def without(full: Setting, plainest: Setting, parameters: Setting) -> Setting:
    """The full setting with some parameters as in the plainest."""
    return full | {parameter: plainest[parameter] for parameter in parameters}


def prices(results: StudyResults, effects: Sequence[str]) -> list[Price]:
    """What each effect costs and is worth.

    Args:
        results: of an `effects_study`.
        effects: names of its effects in their order.

    Returns:
        The plainest scene, then one entry for each effect.

    Raises:
        TypeError: no results.
    """
    require_kind("results", results, StudyResults)
    ladder, left_out = results.members(SWITCHED_ON), results.members(LEFT_OUT)
    time, nan = results.time, float("nan")
    first = ladder[0].cost(time)
    full = ladder[-1].cost(time)
    found = [Price(_PLAINEST, first, 1.0, ladder[0].cost("peak_memory"), nan, {})]
    for effect, run, other in zip(effects, ladder[1:], left_out, strict=True):
        seconds = run.cost(time)
        found.append(
            Price(
                effect,
                seconds,
                seconds / first,
                run.cost("peak_memory"),
                full / other.cost(time),
                other.errors,
                "" if other.done else "cannot be left out",
            )
        )
    return found


def price_table(found: Sequence[Price]) -> str:
    """Prices as a Markdown table."""
    quantities = list(dict.fromkeys(q for price in found for q in price.change))
    heads = ["effect", "s", "time over plainest", "MB", "time of all over all but it"]
    heads += [f"{q} changes by, without it" for q in quantities]
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    for p in found:
        changes = [percent(p.change[q]) if q in p.change else p.refused for q in quantities]
        cells = [
            p.effect,
            f"{p.seconds:.3g}",
            f"{p.time_ratio:.2f}",
            f"{p.memory / 1e6:.0f}",
            f"{p.full_ratio:.2f}" if isfinite(p.full_ratio) else "-",
            *changes,
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)
