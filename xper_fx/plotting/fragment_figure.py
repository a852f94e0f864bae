# SPDX-License-Identifier: LGPL-3.0-or-later
"""How many fragments there are of each size, and how much of the mass they hold."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from xper_fx.plotting.figure_checks import checked_unit, require_mapping
from xper_fx.plotting.figures import COLOURS, new_figure
from xper_fx.support.checks import require_count, require_numbers

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Least ratio of the ends of the axis of sizes.
_DECADE = 10.0


def plot_fragments(
    sizes: Mapping[str, tuple[npt.ArrayLike, npt.ArrayLike]],
    path: str | os.PathLike[str] | None = None,
    *,
    length_unit: tuple[str, float] = ("mm", 1e-3),
    classes: int = 12,
    title: str = "",
) -> Figure:
    """Draw the cumulative number of fragments, and the share of the mass in classes of size.

    On the left the number of fragments of a size and above, against the size, both logarithmic. On
    the right the mass in classes of size, relative to the mass of all, with the sum over smaller
    ones: what would fall through a sieve.

    Args:
        sizes: by label diameter (m) and mass (kg; 2D: kg/m) of the fragments, both of shape (n,).
        path: where to save the figure, if at all.
        length_unit: name of the unit of the sizes and its value in m.
        classes: of size, equally wide on a logarithmic axis.
        title: of the figure.

    Returns:
        The figure.

    Raises:
        ValueError: no fragments, a diameter or mass that is not above zero and finite, as many of
            one as of the other not being there.
        TypeError: no mapping, something that is no number.
        ImportError: matplotlib is missing.
    """
    require_mapping("sizes", sizes, "label: (diameter, mass)")
    unit, scale = checked_unit("length_unit", length_unit)
    require_count("classes", classes, 1)
    if not sizes:
        raise ValueError("There are no fragments to draw.")
    curves = {label: _checked(label, given, scale) for label, given in sizes.items()}
    every = np.concatenate([diameter for diameter, _ in curves.values()])
    low, high = every.min() / 1.1, every.max() * 1.1
    widen = max(_DECADE / (high / low), 1.0) ** 0.5
    edges = np.geomspace(low / widen, high * widen, classes + 1)

    def draw(figure: Figure, axes: Any) -> None:
        from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

        left, right = axes
        for number, (label, (diameter, mass)) in enumerate(curves.items()):
            colour = COLOURS[number % len(COLOURS)]
            size, above = np.unique(diameter, return_counts=True)
            above = np.cumsum(above[::-1])[::-1]
            # steps end where the largest fragment does
            left.plot(
                np.append(size, size[-1]),
                np.append(above, 0.5),
                drawstyle="steps-pre",
                color=colour,
                label=label,
            )
            share = np.histogram(diameter, edges, weights=mass)[0] / mass.sum()
            right.stairs(share, edges, color=colour, fill=True, alpha=0.3, label="in a class")
            order = np.argsort(diameter, kind="stable")
            passing = np.cumsum(mass[order]) / mass.sum()
            right.step(
                np.concatenate([edges[:1], diameter[order], edges[-1:]]),
                np.concatenate([[0.0], passing, [1.0]]),
                where="post",
                color=colour,
                lw=1.2,
                label="up to d",
            )
        most = max(len(diameter) for diameter, _ in curves.values())
        left.set(yscale="log", ylim=(0.8, 1.4 * most), ylabel="fragments of diameter d and above")
        right.set(ylim=(0.0, 1.03), ylabel="share of the mass")
        for panel in axes:
            panel.set(xscale="log", xlim=(edges[0], edges[-1]), xlabel=f"diameter d ({unit})")
            panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            panel.xaxis.set_minor_formatter(NullFormatter())
        for axis in (left.xaxis, right.xaxis, left.yaxis):
            axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        # of the first label, which stands for all
        right.legend(*(found[:2] for found in right.get_legend_handles_labels()), loc="upper left")
        figure.suptitle(title, fontsize=9.0)
        if any(curves):
            figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=4)

    return new_figure(path, draw, (7.0, 3.4), ncols=2)


def _checked(
    label: str, given: tuple[npt.ArrayLike, npt.ArrayLike], scale: float
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Diameters in the unit of the figure, and masses."""
    try:
        diameter, mass = given
    except (TypeError, ValueError):
        raise TypeError(f"sizes[{label!r}] should be (diameter, mass), got {given!r}.") from None
    diameter = require_numbers("A diameter", diameter)
    mass = require_numbers("A mass", mass)
    if diameter.ndim != 1 or mass.shape != diameter.shape or not diameter.size:
        raise ValueError(
            f"{label!r} needs a diameter and a mass of each fragment, one or more, got shapes "
            f"{diameter.shape} and {mass.shape}."
        )
    for name, values in (("diameter", diameter), ("mass", mass)):
        wrong = ~(np.isfinite(values) & (values > 0.0))
        if wrong.any():
            raise ValueError(
                f"A {name} of {label!r} should be above zero and finite, got {values[wrong][0]:g}."
            )
    return diameter / scale, mass
