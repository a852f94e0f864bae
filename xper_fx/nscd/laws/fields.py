# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fields: parameters of laws that differ from point to point.

Any parameter of a law may be, in the place of a number,

- a function, compiled or not, of any of `x` (positions, shape (3, n), m), `normal` (unit normals
  from antagonist to candidate, shape (3, n)), `bodies` (numbers of the bodies on both sides, shape
  (2, n)), `materials` (cell tags of both sides, (2, n)) and `area` (of the facet, shape (n,), m^2;
  2D: m), named so; a function of one argument of another name takes x. It gives shape (n,) or a
  number;
- an array with a value for each facing facet of the scene, in the order of `bodies.facets`, shape
  (num_facets,), or for each point of each of them, shape (num_facets, points of a facet), in the
  order of `Bodies.facet_nodes`; of a mesh that is spread over ranks, of those facets that the rank
  knows; of any other mesh also for each point of the law;
- a scalar DOLFINx function, on whatever mesh covers the facets;
- a random field of this module, with its seed.

Values are taken once, at the start, for the points that a rank has, and take the memory that
numbers would: each point has a row of its parameters anyway. They are made again at a restart.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from inspect import signature
from typing import Any

import numpy as np

from xper_fx.nscd.laws.parameters import (
    EntryError,
    PointArray,
    Values,
    fields_of,
    given_fields,
    is_field,
)
from xper_fx.support.checks import require_integer, require_non_negative, require_positive

# Waves whose sum is a correlated field; positions that are worked on at a time.
_WAVES = 300
_AT_A_TIME = 4096
# Random numbers that are drawn at a time.
_DRAWN = 2**18


@dataclass(frozen=True)
class Places:
    """Where the points of a law are."""

    x: np.ndarray  #: positions, shape (3, n), m
    normal: np.ndarray  #: unit normals from antagonist to candidate, shape (3, n)
    #: numbers of those on both sides, of a mesh that is spread their labels, shape (2, n); -1 of
    #: ties and walls
    bodies: np.ndarray
    materials: np.ndarray  #: cell tags of both sides, shape (2, n); -1 of ties and walls
    area: np.ndarray  #: of the facet (m^2; 2D: m), of ties and walls that of the point, shape (n,)
    facet: np.ndarray  #: number of the facing facet, -1 of ties and walls, shape (n,)
    #: of the point among those of its law on facing facets, on all ranks, shape (n,)
    number: np.ndarray
    num_points: np.ndarray  #: how many these are, shape (n,); -1 of a mesh that is spread
    on_facet: np.ndarray  #: number of the point among those of its facet, shape (n,)
    #: of the facet among those of all ranks, sorted by midpoints as `facet` is on one rank,
    #: shape (n,); where a field draws numbers for facets
    place: np.ndarray
    num_facets: int  #: facing facets of the scene, of a mesh that is spread those known here
    num_places: int  #: facing facets of all ranks
    points_a_facet: int  #: points that each facet has

    def __len__(self) -> int:
        return len(self.area)

    def take(self, which: np.ndarray) -> Places:
        """The places of some points."""
        arrays = {n: a[..., which] for n, a in vars(self).items() if isinstance(a, np.ndarray)}
        return replace(self, **arrays)


def draws(law: Any) -> bool:
    """Whether a law has random fields."""
    return any(hasattr(item, "sample") for item in given_fields(law))


_TOLD = ("x", "normal", "bodies", "materials", "area")


def law_at(law: Any, places: Places, of_function: Mapping[int, np.ndarray]) -> Any:
    """The law with the values of its fields at its points.

    Args:
        law: with fields or without.
        places: where its points are.
        of_function: values there of its DOLFINx functions by their identity, shape (n,) each.

    Raises:
        ValueError: a value that the law refuses, or is not finite, an array of a wrong length; says
            which entry, and where.
    """

    def known(name: str, item: Any) -> Any:
        return _at_points(name, item, places, of_function) if is_field(item) else item

    values: dict[str, Any] = {}
    for name in fields_of(law):
        given = getattr(law, name)
        if isinstance(given, Mapping):
            values[name] = {key: known(key, item) for key, item in given.items()}
        elif isinstance(given, tuple):
            values[name] = tuple(known(f"{name}[{k}]", item) for k, item in enumerate(given))
        else:
            values[name] = known(name, given)
    if not values:
        return law
    try:
        return replace(law, **values)
    except EntryError as error:
        raise ValueError(f"{error} This is {_where(places, error.entry)}.") from None


def _where(places: Places, entry: int) -> str:
    position = ", ".join(f"{value:.6g}" for value in places.x[:, entry])
    facet = places.facet[entry]
    which = f"facet {facet}" if facet >= 0 else "a point of a tie or wall"
    return f"{which}, at ({position}) m"


def _at_points(
    name: str, field: Any, places: Places, of_function: Mapping[int, np.ndarray]
) -> PointArray:
    if isinstance(field, Values):
        values = _of_array(name, field.values, places)
    elif hasattr(field, "sample"):
        values = field.sample(places)
    elif id(field) in of_function:
        values = of_function[id(field)]
    else:
        values = _of_function(name, field, places)
    try:
        values = np.array(np.broadcast_to(np.asarray(values, float), (len(places),)))
    except (TypeError, ValueError):
        raise ValueError(
            f"{name} gives {type(values).__name__} of shape {np.shape(values)} for {len(places)} "
            f"points; it should give one number a point, shape ({len(places)},)."
        ) from None
    wrong = np.flatnonzero(~np.isfinite(values))
    if len(wrong):
        at = int(wrong[0])
        raise ValueError(
            f"{name} is {values[at]} at {_where(places, at)}; it should be finite everywhere: "
            "where nothing may break, give a large number or let the cells be one body."
        )
    return values.view(PointArray)


def _of_array(name: str, values: np.ndarray, places: Places) -> np.ndarray:
    if np.any(places.facet < 0):
        raise ValueError(
            f"{name} is an array, and some points of the law are on ties or walls, which are no "
            "facets: give a function of x."
        )
    if not len(places):
        return np.zeros(0)
    if values.shape == (places.num_facets,):
        return values[places.facet]
    if values.shape == (places.num_facets, places.points_a_facet):
        return values[places.facet, places.on_facet]
    if values.shape == (places.num_points[0],):
        return values[places.number]
    many = f"{len(values)} values" if values.ndim == 1 else f"values of shape {values.shape}"
    rows = (
        f"or a row of {places.points_a_facet} for its points, shape ({places.num_facets}, "
        f"{places.points_a_facet})"
    )
    if places.num_points[0] < 0:
        raise ValueError(
            f"{name} has {many}; of a mesh that is spread over ranks it should have one for each "
            f"of the {places.num_facets} facing facets that this rank knows, {rows}, in the order "
            "of `bodies.facets`: of a table of the whole mesh, table[bodies.facet_places()[0]]."
        )
    raise ValueError(
        f"{name} has {many}; it should have one for each of the {places.num_facets} facing facets "
        f"of the scene, {rows}, or one for each of the {places.num_points[0]} points of the law."
    )


def _of_function(name: str, function: Callable[..., Any], places: Places) -> Any:
    given = list(signature(getattr(function, "py_func", function)).parameters)
    if given and set(given) <= set(_TOLD):
        return function(*(getattr(places, argument) for argument in given))
    if len(given) == 1:
        return function(places.x)
    raise ValueError(
        f"{name} is a function of ({', '.join(given)}); it should take some of {', '.join(_TOLD)}."
    )


@dataclass(frozen=True)
class Weibull:
    """A random number for each facet, of Weibull's distribution (Weibull 1939).

    A facet has less than s with the probability 1 - exp(-((s - minimum) / scale)^modulus), or with
    `reference_area` A0 that to the power A / A0: larger facets are weaker, as the weakest link is.

    Args:
        scale: above the minimum, in the unit of the parameter.
        modulus: m > 0, large where values scatter little.
        seed: of the random numbers; the same on any number of ranks.
        minimum: least value.
        reference_area: A0 (m^2; 2D: m), of the facets that the scale is for; None: of any.
    """

    scale: float
    modulus: float
    seed: int
    minimum: float = 0.0
    reference_area: float | None = None

    def __post_init__(self) -> None:
        require_positive("scale", self.scale)
        require_positive("modulus", self.modulus)
        require_integer("seed", self.seed)
        require_non_negative("minimum", self.minimum)
        if self.reference_area is not None:
            require_positive("reference_area", self.reference_area)

    def sample(self, places: Places) -> np.ndarray:
        """Values at the points."""
        share = _on_facets(np.random.default_rng(self.seed).exponential, places)
        if self.reference_area is not None:
            share = share * self.reference_area / places.area
        return self.minimum + self.scale * share ** (1.0 / self.modulus)


@dataclass(frozen=True)
class Uniform:
    """A random number for each facet, each as likely between two bounds.

    Args:
        low, high: the bounds, in the unit of the parameter.
        seed: of the random numbers; the same on any number of ranks.
    """

    low: float
    high: float
    seed: int

    def __post_init__(self) -> None:
        require_non_negative("low", self.low)
        require_non_negative("high - low", self.high - self.low)
        require_integer("seed", self.seed)

    def sample(self, places: Places) -> np.ndarray:
        """Values at the points."""
        drawn = _on_facets(np.random.default_rng(self.seed).uniform, places)
        return self.low + (self.high - self.low) * drawn


@dataclass(frozen=True)
class Lognormal:
    """A lognormal random field, correlated over a length.

    The logarithm is Gaussian with the correlation exp(-(d / length)^2) at a distance d: a sum of
    waves of random directions and phases (Shinozuka and Deodatis 1991).

    Args:
        mean: of the parameter, in its unit.
        variation: standard deviation over the mean.
        length: of the correlation (m).
        seed: of the random numbers; the same on any number of ranks.
    """

    mean: float
    variation: float
    length: float
    seed: int

    def __post_init__(self) -> None:
        require_positive("mean", self.mean)
        require_non_negative("variation", self.variation)
        require_positive("length", self.length)
        require_integer("seed", self.seed)

    def sample(self, places: Places) -> np.ndarray:
        """Values at the points."""
        rng = np.random.default_rng(self.seed)
        waves = rng.normal(scale=np.sqrt(2.0) / self.length, size=(_WAVES, 3))
        phases = rng.uniform(0.0, 2.0 * np.pi, _WAVES)
        gauss = np.empty(len(places))
        for first in range(0, len(places), _AT_A_TIME):
            here = slice(first, first + _AT_A_TIME)
            gauss[here] = np.cos(places.x[:, here].T @ waves.T + phases).sum(axis=1)
        gauss *= np.sqrt(2.0 / _WAVES)
        spread = np.sqrt(np.log1p(self.variation**2))
        return self.mean * np.exp(spread * gauss - 0.5 * spread**2)


def _on_facets(draw: Callable[..., np.ndarray], places: Places) -> np.ndarray:
    """Numbers at points, of which one is drawn for each facet of all ranks, in their order."""
    if np.any(places.facet < 0):
        raise ValueError(
            "A random number for each facet is for laws between facing facets; ties and walls have "
            "no such facets: give a function of x or a Lognormal."
        )
    order = np.argsort(places.place, kind="stable")
    place, drawn = places.place[order], np.empty(len(places))
    for first in range(0, places.num_places, _DRAWN):
        block = draw(size=min(_DRAWN, places.num_places - first))
        here = slice(*np.searchsorted(place, [first, first + len(block)]))
        drawn[order[here]] = block[place[here] - first]
    return drawn
