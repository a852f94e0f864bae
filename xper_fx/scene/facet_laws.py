# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which law is between which facets."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from xper_fx.bodies.explode import Bodies
from xper_fx.nscd.laws.law import Law, LawKernels
from xper_fx.nscd.laws.parameters import fields_of
from xper_fx.support.checks import require_numbers


def require_law(law: Law) -> None:
    """Raise TypeError unless `law` is an interaction law."""
    if isinstance(law, type):
        raise TypeError(
            f"{law.__name__} is a class and no interaction law: give an object of it, "
            f"{law.__name__}(...)."
        )
    if not all(hasattr(law, name) for name in ("kernels", "parameters", "initial_state")):
        raise TypeError(f"{law!r} is no interaction law; nscd/laws has those there are.")


def require_kernels(law: Law, dim: int) -> None:
    """Raise TypeError or ValueError unless what a law's methods give can be worked with."""
    name, kernels = type(law).__name__, law.kernels(dim)
    if not isinstance(kernels, LawKernels):
        raise TypeError(
            f"The law {name} gives {kernels!r} for its kernels; `kernels(dim)` should return "
            "LawKernels (xper_fx/nscd/laws/law.py)."
        )
    if fields_of(law):
        return  # looked at where the points are known
    for what, names in (("parameters", None), ("initial_state", kernels.state_names)):
        given = getattr(law, what)()
        if require_numbers(f"{name}.{what}()", given).ndim != 1 or (
            names is not None and len(given) != len(names)
        ):
            wanted = "" if names is None else f", one for each of {list(names)}"
            raise ValueError(
                f"The law {name} gives {given!r} for {what}(); it should be a tuple of "
                f"numbers{wanted}."
            )
    others = len(kernels.state_names) + kernels.num_terms + kernels.num_details
    least = sum(count for _, count in kernels.effects) - others
    if len(law.parameters()) < least:
        raise ValueError(
            f"The law {name} gives {len(law.parameters())} parameters, and its kernels need "
            f"{least} by what `LawKernels.effects` counts beside state, terms and details."
        )


def facet_laws(
    bodies: Bodies,
    interactions: Mapping[tuple[int, int], Law | None],
    default_interaction: Law | None,
    facet_interactions: Mapping[int, Law | None],
) -> tuple[list[Law], np.ndarray]:
    """The laws between bodies and, for each facing facet, its law.

    Args:
        interactions, default_interaction, facet_interactions: as in `Scene`.

    Returns:
        The distinct laws, the same on all ranks, and shape (num_facets,): index of the law, -1
        where there is none.

    Raises:
        ValueError: a pair of cell tags with two laws or none, or that occurs nowhere.
        TypeError: a law that is none.
    """
    by_pair: dict[tuple[int, int], Law | None] = {}
    for pair, law in interactions.items():
        key = tuple(sorted(pair))
        if by_pair.get(key, law) != law:
            raise ValueError(f"Interactions give the pair {key} two laws; name it once.")
        by_pair[key] = law
    facets, facing = bodies.facets, bodies.present.facing
    pairs = np.sort(facets.materials, axis=1)
    index = np.full(len(facets), -1)
    laws: list[Law] = []

    def number(law: Law) -> int:
        require_law(law)
        if law not in laws:
            laws.append(law)
        return laws.index(law)

    present = {(low, high) for low, high, _ in facing}
    unknown = set(by_pair) - present
    if unknown:
        raise ValueError(
            f"Interactions name the pairs {sorted(unknown)}, which face each other nowhere; "
            f"pairs that do: {sorted(present)}."
        )
    others = {tag for *_, tag in facing} - set(facet_interactions)
    untagged = ~np.isin(facets.tag, list(facet_interactions))
    for pair in sorted(present):
        if not any((*pair, tag) in facing for tag in others):
            continue
        if pair not in by_pair and default_interaction is None:
            raise ValueError(
                f"Cells of tags {pair} face each other and have no interaction law; name the "
                "pair in `interactions` or give a `default_interaction`."
            )
        law = by_pair.get(pair, default_interaction)
        if law is not None:
            index[untagged & np.all(pairs == pair, axis=1)] = number(law)
    for tag, law in facet_interactions.items():
        if law is not None:
            index[facets.tag == tag] = number(law)
    return laws, index
