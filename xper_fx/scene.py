# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scene: what a user composes - bodies, materials, interactions, loads.

Everything is checked here, before any work.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from xper_fx.bodies import Bodies
from xper_fx.forms.loads import (
    BodyForce,
    Gravity,
    PrescribedDisplacement,
    PrescribedVelocity,
    RayleighDamping,
    SurfaceTraction,
)
from xper_fx.materials.material import Material
from xper_fx.nscd.laws import Law

Load = BodyForce | Gravity | SurfaceTraction | PrescribedVelocity | PrescribedDisplacement


@dataclass(frozen=True)
class Wall:
    """A fixed plane obstacle that tagged facets may touch.

    Args:
        facets: facet tag of the surface that may touch it.
        point: a point of the plane (m).
        normal: out of the obstacle, towards the bodies; any length.
        law: law of contact.
    """

    facets: int
    point: Sequence[float]
    normal: Sequence[float]
    law: Law


@dataclass
class Scene:
    """Bodies, what they are made of, how they interact, what acts on them.

    Args:
        bodies: the exploded mesh.
        materials: material of each cell tag.
        interactions: law of each pair of cell tags, in any order, `{(1, 2): law}`; None as a law
            leaves these facets free.
        default_interaction: law of the pairs not named; without it every pair must be named.
        facet_interactions: law of facing facets by their facet tag; it has precedence (precracks).
        walls: fixed obstacles.
        loads: forces and prescribed motions.
        damping: viscous damping.
        initial_velocity: function of positions, shape (dim, n) -> (dim, n), m/s; rest if None.
        order: order of the Lagrange space, 1 or 2.
        points: "nodal" or "gauss", where interactions act on a facet (see `nscd/facets.py`).

    Raises:
        ValueError: a tag without material or law, a tag that occurs nowhere, an order or a rule
            that does not exist.
        TypeError: something that is no material, law or load.
    """

    bodies: Bodies
    materials: Mapping[int, Material]
    interactions: Mapping[tuple[int, int], Law | None] = field(default_factory=dict)
    default_interaction: Law | None = None
    facet_interactions: Mapping[int, Law | None] = field(default_factory=dict)
    walls: Sequence[Wall] = ()
    loads: Sequence[Load] = ()
    damping: RayleighDamping | None = None
    initial_velocity: Callable[[np.ndarray], np.ndarray] | None = None
    order: int = 1
    points: str = "nodal"

    def __post_init__(self):
        if self.order not in (1, 2):
            raise ValueError(f"order should be 1 or 2, got {self.order}.")
        if self.points not in ("nodal", "gauss"):
            raise ValueError(f'points should be "nodal" or "gauss", got {self.points!r}.')
        self._check_materials()
        self._check_loads()
        self._check_tags()
        self.law_of_facet()

    @property
    def dim(self) -> int:
        """Dimension of space."""
        return self.bodies.mesh.geometry.dim

    def _check_materials(self) -> None:
        present = set(np.unique(self.bodies.material_of_cell).tolist())
        missing, unknown = present - set(self.materials), set(self.materials) - present
        if missing:
            raise ValueError(
                f"Cell tags {sorted(missing)} occur in the mesh and have no material; "
                f"materials are given for {sorted(self.materials)}."
            )
        if unknown:
            raise ValueError(
                f"Materials are given for cell tags {sorted(unknown)}, which occur nowhere; "
                f"tags that do: {sorted(present)}."
            )
        for tag, material in self.materials.items():
            if not all(hasattr(material, name) for name in ("density", "linear", "energy")):
                raise TypeError(
                    f"The material of cell tag {tag} is {material!r}; it needs `density`, `linear` "
                    "and `energy` (see materials/material.py)."
                )

    def _check_loads(self) -> None:
        for load in self.loads:
            if not isinstance(load, Load):
                raise TypeError(f"{load!r} is no load; forms/loads.py has those there are.")
            value = load.value
            if not isinstance(load, PrescribedVelocity | PrescribedDisplacement):
                if len(value) != self.dim:
                    raise ValueError(
                        f"{type(load).__name__} has {len(value)} components; the scene has "
                        f"{self.dim} dimensions."
                    )
            for number in value if isinstance(value, Sequence) else (value,):
                if not callable(number) and not np.isfinite(number):
                    raise ValueError(f"{load} has the value {number}; it should be finite.")

    def _check_tags(self) -> None:
        present = set(self.bodies.facet_tags.values.tolist())
        named = [load.facets for load in self.loads if hasattr(load, "facets")]
        named += [wall.facets for wall in self.walls]
        for tag in named:
            if tag not in present:
                raise ValueError(
                    f"A load or wall names facet tag {tag}, which occurs nowhere; tags that do: "
                    f"{sorted(present)}."
                )
        between = set(self.bodies.facets.tag.tolist())
        for tag in self.facet_interactions:
            if tag not in between:
                raise ValueError(
                    f"facet_interactions names facet tag {tag}, which no facet between two bodies "
                    f"has; those that do: {sorted(between - {0})}."
                )
        for wall in self.walls:
            if len(wall.normal) != self.dim or len(wall.point) != self.dim:
                raise ValueError(
                    f"A wall's point and normal should have {self.dim} components, got "
                    f"{tuple(wall.point)} and {tuple(wall.normal)}."
                )
            if not np.linalg.norm(wall.normal) > 0.0:
                raise ValueError(f"A wall's normal should not vanish, got {tuple(wall.normal)}.")

    def law_of_facet(self) -> tuple[list[Law], np.ndarray]:
        """The laws between bodies and, for each facing facet, its law.

        Returns:
            The distinct laws, and shape (num_facets,): index of the law, -1 where there is none.
        """
        facets = self.bodies.facets
        by_pair: dict[tuple[int, int], Law | None] = {}
        for pair, law in self.interactions.items():
            key = tuple(sorted(pair))
            if by_pair.get(key, law) != law:
                raise ValueError(f"Interactions give the pair {key} two laws; name it once.")
            by_pair[key] = law
        pairs = np.sort(facets.materials, axis=1)
        index = np.full(len(facets), -1)
        laws: list[Law] = []

        def number(law: Law) -> int:
            if not all(hasattr(law, name) for name in ("kernels", "parameters", "initial_state")):
                raise TypeError(f"{law!r} is no interaction law; nscd/laws has those there are.")
            if law not in laws:
                laws.append(law)
            return laws.index(law)

        present = {tuple(p) for p in np.unique(pairs, axis=0).tolist()} if len(facets) else set()
        unknown = set(by_pair) - present
        if unknown:
            raise ValueError(
                f"Interactions name the pairs {sorted(unknown)}, which face each other nowhere; "
                f"pairs that do: {sorted(present)}."
            )
        untagged = ~np.isin(facets.tag, list(self.facet_interactions))
        for pair in sorted(present):
            here = untagged & np.all(pairs == pair, axis=1)
            if not np.any(here):
                continue
            if pair not in by_pair and self.default_interaction is None:
                raise ValueError(
                    f"Cells of tags {pair} face each other and have no interaction law; name the "
                    "pair in `interactions` or give a `default_interaction`."
                )
            law = by_pair.get(pair, self.default_interaction)
            if law is not None:
                index[here] = number(law)
        for tag, law in self.facet_interactions.items():
            if law is not None:
                index[facets.tag == tag] = number(law)
        return laws, index
