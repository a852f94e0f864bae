# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures of a study: error against time and memory, and the price of each effect."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from xper_fx.plotting.figures import COLOURS, new_figure
from xper_fx.study.definition import varied
from xper_fx.study.effect_prices import Price
from xper_fx.study.results import COSTS, Run, StudyResults, percent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MARKERS = ("o", "s", "^", "D", "v", "P", "X")


def plot_error_against_cost(
    results: StudyResults,
    path: str | os.PathLike[str] | None = None,
    quantities: Sequence[str] | None = None,
    costs: Sequence[str] | None = None,
    across: bool = False,
) -> Figure:
    """Draw the error of each run against what it cost, with the Pareto front.

    A row for each quantity, a column for each cost, or the other way round. Each family is a line
    through its runs in the order of the family, named at each run by the parameter that varies
    along it; the front is a grey step; the default setting has a ring. Runs with `accuracy` are
    stars, with a line up or down to the error they estimated themselves. Runs without error stand
    at the lower edge, on the line "0". Errors in the grey band are below what the reference is good
    for.

    Args:
        results: of the study.
        path: where to save the figure, if at all.
        quantities: those to draw; all if None.
        costs: entries of `COSTS`; the results' time and the peak memory if None.
        across: quantities side by side.

    Returns:
        The figure.

    Raises:
        ValueError: a quantity or cost that does not exist.
        ImportError: matplotlib is missing.
    """
    quantities = list(quantities or results.study.quantities)
    costs = list(costs or (results.time, "peak_memory"))
    for kind, given, known in (
        ("quantities", quantities, results.study.quantities),
        ("costs", costs, COSTS),
    ):
        unknown = sorted(set(given) - set(known))
        if unknown:
            raise ValueError(f"{kind} names {unknown}; these are: {sorted(known)}.")

    def draw(figure: Figure, panels: Any) -> None:
        grid = panels.T if across else panels
        for row, quantity in zip(grid, quantities, strict=True):
            for axes, cost in zip(row, costs, strict=True):
                _draw_errors(axes, results, quantity, cost, annotate=cost == costs[0])
                axes.set_xlabel("{} ({})".format(*COSTS[cost][:2]))
            row[0].set_ylabel(f"error of {quantity}")
        entries: dict[str, Any] = {}
        for axes in panels.flat:
            handles, labels = axes.get_legend_handles_labels()
            entries |= dict(zip(labels, handles, strict=True))
        figure.legend(entries.values(), entries.keys(), loc="outside upper center", ncols=4)

    shape = (len(quantities), len(costs))
    rows, columns = shape[::-1] if across else shape
    size = (0.4 + 4.2 * columns, 0.7 + 2.9 * rows)
    return new_figure(path, draw, size, nrows=rows, ncols=columns, squeeze=False)


def _draw_errors(
    axes: Axes, results: StudyResults, quantity: str, cost: str, annotate: bool
) -> None:
    """One panel."""
    runs = results.candidates(quantity)
    scale = COSTS[cost][2]
    positive = [r.errors[quantity] for r in runs if r.errors[quantity] > 0.0]
    zero = min(positive, default=1.0) / 3.0

    def at(run: Run) -> tuple[float, float]:
        return run.cost(cost) / scale, run.errors[quantity] or zero

    axes.set_yscale("log")
    if cost.endswith("seconds"):
        axes.set_xscale("log")
    for number, family in enumerate(results.study.families):
        members = [r for r in results.members(family) if any(r is run for run in runs)]
        if not members:
            continue
        x, y = np.array([at(r) for r in members]).T
        colour = COLOURS[number % len(COLOURS)]
        automatic = all(r.setting.get("accuracy") is not None for r in members)
        marker = "*" if automatic else _MARKERS[number % len(_MARKERS)]
        axes.plot(
            x, y, color=colour, marker=marker, ms=11 if automatic else 4.5, lw=1.0, label=family,
            zorder=3,
        )  # fmt: skip
        for run in members:
            estimate = run.record.get("estimated_error")
            if estimate:
                axes.plot([at(run)[0]] * 2, [at(run)[1], estimate], color=colour, lw=0.8, ls=":")
                axes.plot(at(run)[0], estimate, color=colour, marker="_", ms=9)
        if annotate:
            _name_runs(axes, members, [at(r) for r in members], colour, above=number % 2 == 0)
    if results.default is not None and any(results.default is r for r in runs):
        axes.plot(
            *at(results.default), "o", ms=13, mfc="none", mec="black", mew=1.3, zorder=4,
            label="default",
        )  # fmt: skip
    trust = results.trust(quantity)
    front = [(at(r)[0], max(at(r)[1], trust)) for r in results.front(quantity, cost)]
    if front:
        x, y = np.array(front).T
        right = max(at(r)[0] for r in runs)
        axes.step(
            [*x, right],
            [*y, y[-1]],
            where="post",
            color="0.45",
            lw=3.0,
            alpha=0.45,
            zorder=1,
            label="Pareto front",
        )
    axes.margins(0.1)
    if len(positive) < len(runs):
        axes.axhline(zero, color="0.6", lw=0.6, ls=":")
        axes.annotate(
            "0" if positive else "no error in any run",
            (0.02, zero),
            xycoords=("axes fraction", "data"),
            xytext=(0, -9),
            textcoords="offset points",
            color="0.4",
        )
    if not positive:
        axes.set(ylim=(zero / 10.0, zero * 10.0), yticks=[])
        axes.set_yticks([], minor=True)
    low = min((at(r)[1] for r in runs), default=trust)
    if trust > low:
        axes.axhspan(
            0.5 * low, trust, color="0.92", zorder=0, label="below what the reference is good for"
        )


def _name_runs(
    axes: Axes, members: list[Run], places: list[tuple[float, float]], colour: str, above: bool
) -> None:
    """Write the value of the one parameter that varies above or below each run."""
    parameters = varied([r.setting for r in members])
    if len(parameters) != 1:
        return
    for run, place in zip(members, places, strict=True):
        value = run.setting[parameters[0]]
        text = f"{value:g}" if isinstance(value, int | float) else str(value)
        axes.annotate(
            text,
            place,
            xytext=(4, 3) if above else (4, -8),
            textcoords="offset points",
            fontsize=6.5,
            color=colour,
            zorder=5,
        )


def plot_price(
    prices: Sequence[Price], path: str | os.PathLike[str] | None = None, title: str = ""
) -> Figure:
    """Draw what each effect costs and what leaving it out does to the answer.

    Args:
        prices: of `effects_price.prices`.
        path: where to save the figure, if at all.
        title: of the figure.

    Returns:
        The figure: time over the plainest scene's as effects are switched on one by one, memory
        likewise, and the change of each quantity when one effect is left out of the full scene.

    Raises:
        ImportError: matplotlib is missing.
    """
    names = [p.effect for p in prices]
    rows = np.arange(len(names))
    quantities = list(dict.fromkeys(q for p in prices for q in p.change))

    def draw(figure: Figure, panels: Any) -> None:
        time, memory, change = panels
        for axes, values, label in (
            (time, [p.time_ratio for p in prices], "time over the plainest"),
            (memory, [p.memory / 1e6 for p in prices], "peak memory (MB)"),
        ):
            axes.barh(rows, values, color=COLOURS[0], height=0.6)
            for row, value in zip(rows, values, strict=True):
                if np.isfinite(value):
                    axes.annotate(f" {value:.3g}", (value, row), va="center", fontsize=7.5)
            axes.set_xlabel(f"{label}\nwith this and those above")
            axes.margins(x=0.25)
        time.set_xscale("log")
        time.set_xlim(0.5, 4.0 * np.nanmax([p.time_ratio for p in prices]))
        height = 0.7 / max(len(quantities), 1)
        for number, quantity in enumerate(quantities):
            values = [p.change.get(quantity, np.nan) for p in prices]
            where = rows + (number - 0.5 * (len(quantities) - 1)) * height
            change.barh(
                where, 100 * np.array(values), height, color=COLOURS[1 + number], label=quantity
            )
            for row, value in zip(where, values, strict=True):
                if np.isfinite(value):
                    change.annotate(
                        f" {percent(value)}", (100 * value, row), va="center", fontsize=7.0
                    )
        for row, price in zip(rows, prices, strict=True):
            if price.refused:
                change.annotate(f" {price.refused}", (0.0, row), va="center", fontsize=7.0)
        change.set_xlabel("change of the answer (%)\nwhen it alone is left out")
        change.margins(x=0.3)
        time.set_yticks(rows, names)
        time.invert_yaxis()
        figure.suptitle(title)
        handles, labels = change.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper right", ncols=len(labels))

    size = (9.5, 1.3 + 0.42 * len(names))
    return new_figure(path, draw, size, ncols=3, sharey=True)
