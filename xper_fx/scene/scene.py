# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scene: what a user composes - bodies, materials, interactions, loads.

Everything is checked here, before any work.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Integral
from typing import TYPE_CHECKING

import numpy as np

from xper_fx.bodies.explode import Bodies
from xper_fx.forms.loads import (
    BodyForce,
    Gravity,
    PrescribedDisplacement,
    PrescribedVelocity,
    RayleighDamping,
    SurfaceTraction,
    value_at,
)
from xper_fx.materials.material import InelasticMaterial, Material
from xper_fx.nscd.laws.law import Law
from xper_fx.scene.contact import Contact
from xper_fx.support.checks import (
    require_integer,
    require_number,
    require_numbers,
    require_positive,
)

if TYPE_CHECKING:
    from xper_fx.nscd.rigid.bodies import RigidBodies
    from xper_fx.nscd.rigid.body import RigidBody
    from xper_fx.periodic.drive import MacroscopicDrive
    from xper_fx.scene.tie import Tie

Field = Callable[[np.ndarray], np.ndarray]
Load = BodyForce | Gravity | SurfaceTraction | PrescribedVelocity | PrescribedDisplacement
_Motion = PrescribedVelocity | PrescribedDisplacement


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
        bodies: the exploded mesh; None where all bodies are rigid.
        materials: material of each cell tag.
        interactions: law of each pair of cell tags, in any order, `{(1, 2): law}`; None as a law
            leaves these facets free.
        default_interaction: law of the pairs not named; without it every pair must be named.
        facet_interactions: law of facing facets by their facet tag; it has precedence (precracks).
        walls: fixed obstacles.
        loads: forces and prescribed motions.
        damping: viscous damping.
        initial_velocity: function of positions, shape (3, n) -> (dim, n), m/s, or such a function
            for some of the cell tags (bodies that touch and move apart); rest if None. Dofs with a
            prescribed displacement start at its rate.
        order: order of the Lagrange space, 1 or 2.
        points: "nodal" or "gauss", where interactions act on a facet (see `nscd/facets.py`).
            Nodal points are right but for cohesive bonds on tetrahedra of order 2, where a
            uniform traction needs Gauss points (nodal ones were off by 2.6 % in a patch test).
        ties: laws between surfaces meshed apart, whose nodes do not match (`xper_fx/scene/tie.py`);
            for triangles and tetrahedra of order 1.
        macroscopic: what drives a periodic cell (bodies made with a `lattice`); such a scene has
            no loads, walls, ties or damping, and `initial_velocity` is that of the fluctuation.
        rigid: rigid bodies; of the loads gravity acts on them.
        surfaces: cell tags of the meshed bodies that make up a group, by the group's name; their
            outer facets, and those that fracture frees, are what `contacts` of the group touch.
        contacts: between which groups (rigid bodies by their `group`, surfaces by their name)
            contacts are looked for in each step, and their laws.
        resolve_overlaps: whether rigid bodies that overlap at the start are moved apart; they are
            refused otherwise.

    Attributes:
        rigid_bodies: the rigid bodies as arrays, None without any.

    Raises:
        ValueError: a tag without material or law, a tag that occurs nowhere, an order or a rule
            that does not exist, a rigid body that no contact names, rigid bodies that overlap.
        TypeError: something that is no material, law or load.
    """

    bodies: Bodies | None = None
    materials: Mapping[int, Material | InelasticMaterial] = field(default_factory=dict)
    interactions: Mapping[tuple[int, int], Law | None] = field(default_factory=dict)
    default_interaction: Law | None = None
    facet_interactions: Mapping[int, Law | None] = field(default_factory=dict)
    walls: Sequence[Wall] = ()
    loads: Sequence[Load] = ()
    damping: RayleighDamping | None = None
    initial_velocity: Field | Mapping[int, Field] | None = None
    order: int = 1
    points: str = "nodal"
    macroscopic: MacroscopicDrive | None = None
    ties: Sequence[Tie] = ()
    rigid: Sequence[RigidBody] = ()
    surfaces: Mapping[str, Sequence[int]] = field(default_factory=dict)
    contacts: Sequence[Contact] = ()
    resolve_overlaps: bool = False
    rigid_bodies: RigidBodies | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        self._check_containers()
        if not isinstance(self.order, Integral) or self.order not in (1, 2):
            raise ValueError(f"order should be 1 or 2, got {self.order}.")
        if not isinstance(self.points, str) or self.points not in ("nodal", "gauss"):
            raise ValueError(f'points should be "nodal" or "gauss", got {self.points!r}.')
        if len(self.rigid):
            from xper_fx.nscd.rigid.bodies import RigidBodies

            self.rigid_bodies = RigidBodies(self.rigid)
        if self.bodies is None:
            self._check_without_mesh()
        else:
            self._check_with_mesh()
        self._check_loads()
        self._check_contacts()

    def _check_containers(self) -> None:
        """Mappings and lists, each with an example of what is meant."""
        for name, example in (
            ("materials", "{1: LinearElastic(...)}"),
            ("interactions", "{(1, 2): CohesiveZone(...)}"),
            ("facet_interactions", "{7: SignoriniCoulomb()}"),
            ("surfaces", '{"beam": [1]}'),
        ):
            given = getattr(self, name)
            if not isinstance(given, Mapping):
                raise TypeError(f"{name} should be a mapping such as {example}, got {given!r}.")
        for name in ("walls", "loads", "ties", "rigid", "contacts"):
            given = getattr(self, name)
            if not isinstance(given, Sequence) or isinstance(given, str):
                raise TypeError(f"{name} should be a list, [...], got {given!r}.")
        for pair in self.interactions:
            if not (isinstance(pair, tuple) and len(pair) == 2 and all(map(_is_tag, pair))):
                raise TypeError(f"interactions names {pair!r}; it should name pairs of cell tags.")
        for name in ("materials", "facet_interactions"):
            for tag in getattr(self, name):
                if not _is_tag(tag):
                    raise TypeError(f"{name} names {tag!r}; it should name tags, integers.")
        for name, tags in self.surfaces.items():
            if isinstance(tags, str) or not np.iterable(tags) or not all(map(_is_tag, tags)):
                raise TypeError(
                    f"The surface {name!r} should be a list of cell tags, got {tags!r}."
                )

    def _check_without_mesh(self) -> None:
        if self.rigid_bodies is None:
            raise ValueError("A scene needs bodies: an exploded mesh, rigid bodies, or both.")
        for name in (
            "materials", "interactions", "facet_interactions", "walls", "damping",
            "initial_velocity", "macroscopic", "surfaces",
        ):  # fmt: skip
            if getattr(self, name):
                raise ValueError(f"A scene without a mesh has no {name}; leave it out.")
        for load in self.loads:
            if not isinstance(load, Gravity):
                raise ValueError(
                    f"Of the loads only gravity acts on rigid bodies, got {load!r}: a RigidBody "
                    "takes its `force`, `torque` and `prescribed` velocities itself."
                )

    def _check_with_mesh(self) -> None:
        if not isinstance(self.bodies, Bodies):
            raise TypeError(
                f"bodies is {self.bodies!r}; `xper_fx.bodies.explode.explode` makes them."
            )
        if self.rigid_bodies is not None and self.rigid_bodies.dim != self.dim:
            raise ValueError(
                f"The mesh has dimension {self.dim}, the rigid bodies {self.rigid_bodies.dim}."
            )
        self._check_periodicity()
        self._check_materials()
        self._check_initial_velocity()
        self._check_walls()
        self._check_ties()
        self._check_tags()
        self._check_motions()
        self.law_of_facet()

    @property
    def dim(self) -> int:
        """Dimension of space."""
        if self.bodies is None:
            return self.rigid_bodies.dim
        return self.bodies.mesh.geometry.dim

    @property
    def gravity(self) -> np.ndarray | None:
        """Sum of the gravities among the loads, shape (dim,), m/s^2; None without any."""
        given = [load.value for load in self.loads if isinstance(load, Gravity)]
        return np.sum(given, axis=0) if given else None

    def _check_contacts(self) -> None:
        rigid = () if self.rigid_bodies is None else self.rigid_bodies.groups
        for load in self.loads if rigid else ():
            if isinstance(load, Gravity) and any(map(callable, load.value)):
                raise ValueError("Gravity on rigid bodies is constant, got a function of time.")
        for name, tags in self.surfaces.items():
            if name in rigid:
                raise ValueError(f"{name!r} names a surface and a group of rigid bodies.")
            unknown = set(tags) - set(self.materials)
            if unknown or not tags:
                raise ValueError(
                    f"The surface {name!r} needs cell tags that occur, got {list(tags)}; those "
                    f"that do: {sorted(self.materials)}."
                )
        groups, named = {*rigid, *self.surfaces}, set()
        for contact in self.contacts:
            if not isinstance(contact, Contact):
                raise TypeError(f"{contact!r} is no Contact.")
            if contact.law is not None:
                _check_law(contact.law)
            pair = tuple(sorted(contact.between))
            if set(pair) - groups:
                raise ValueError(
                    f"{contact.between} names groups {sorted(set(pair) - groups)}, which do not "
                    f"exist; those that do: {sorted(groups)}."
                )
            if pair in named:
                raise ValueError(f"Two contacts are between {pair}; name the pair once.")
            named.add(pair)
        alone = groups - {name for pair in named for name in pair}
        for name in sorted(alone & set(rigid)):
            first = int(np.argmax(self.rigid_bodies.group_of == rigid.index(name)))
            raise ValueError(
                f"No contact names the group {name!r}, to which rigid body {first} belongs: it "
                "would pass through everything. Name it in `contacts`, with None as a law if "
                "nothing shall happen."
            )
        if alone:
            raise ValueError(f"No contact names the surfaces {sorted(alone)}; leave them out.")
        touching = [
            c.between for c in self.contacts if c.law is not None and {*c.between} <= {*rigid}
        ]
        if touching:
            from xper_fx.scene.initial_overlaps import separate

            separate(self.rigid_bodies, touching, self.resolve_overlaps)

    def _check_periodicity(self) -> None:
        if self.macroscopic is None:
            if self.bodies.lattice is not None:
                raise ValueError(
                    "The bodies are a periodic cell and nothing drives it; give `macroscopic`, a "
                    "MacroscopicDrive."
                )
            return
        from xper_fx.periodic.drive import MacroscopicDrive

        if not isinstance(self.macroscopic, MacroscopicDrive):
            raise TypeError(f"macroscopic is {self.macroscopic!r}; expected a MacroscopicDrive.")
        if self.bodies.lattice is None:
            raise ValueError(
                "A macroscopic drive needs a periodic cell: give the `lattice` to `explode`."
            )
        self.macroscopic.check(self.dim)
        for name in ("loads", "walls", "ties", "damping", "rigid", "contacts"):
            if getattr(self, name):
                raise ValueError(
                    f"A periodic cell is driven by `macroscopic` alone; {name} should be left out, "
                    f"got {getattr(self, name)!r}."
                )

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
            answers = hasattr(material, "energy") or hasattr(material, "response")
            if not (hasattr(material, "density") and hasattr(material, "linear") and answers):
                raise TypeError(
                    f"The material of cell tag {tag} is {material!r}; it needs `density`, `linear` "
                    "and an `energy` or a `response` (see materials/material.py)."
                )
            inelastic = hasattr(material, "response")
            variables = getattr(material, "variables", None)
            if inelastic and (material.linear or not isinstance(variables, Mapping)):
                raise TypeError(
                    f"The material of cell tag {tag} is {material!r}; with a `response` it needs "
                    "`linear = False` and a mapping `variables`, empty if it has none."
                )
            if not inelastic and variables:
                raise TypeError(
                    f"The material of cell tag {tag} is {material!r}; with `variables` it needs a "
                    "`response`, not an `energy`."
                )
            require_positive(f"The density of the material of cell tag {tag}", material.density)

    def _check_initial_velocity(self) -> None:
        given = self.initial_velocity
        if isinstance(given, Mapping):
            unknown = set(given) - set(self.materials)
            if unknown:
                raise ValueError(
                    f"initial_velocity names cell tags {sorted(unknown)}, which occur nowhere; "
                    f"tags that do: {sorted(self.materials)}."
                )
        for field_ in given.values() if isinstance(given, Mapping) else (given,):
            if field_ is not None and not callable(field_):
                raise TypeError(f"initial_velocity should be a function, got {field_!r}.")

    def _check_loads(self) -> None:
        if self.damping is not None and not isinstance(self.damping, RayleighDamping):
            raise TypeError(f"damping should be a RayleighDamping or None, got {self.damping!r}.")
        for load in self.loads:
            if not isinstance(load, Load):
                raise TypeError(f"{load!r} is no load; forms/loads.py has those there are.")
            name, values = type(load).__name__, (load.value,)
            if not isinstance(load, _Motion):
                if not isinstance(load.value, Sequence | np.ndarray) or (
                    np.shape(load.value) != (self.dim,)
                ):
                    raise ValueError(
                        f"{name} has the value {load.value!r}; it should have {self.dim} "
                        "components, one a dimension of the scene."
                    )
                values = load.value
            elif not (isinstance(load.component, Integral) and 0 <= load.component < self.dim):
                raise ValueError(
                    f"{name} on tag {load.facets} has component {load.component}; it should be "
                    f"0 to {self.dim - 1}."
                )
            for value in values:
                start = value_at(value, 0.0) if callable(value) else value
                if not np.isfinite(require_number(f"The value of {load}", start)):
                    raise ValueError(f"{load} has the value {value}; it should be finite.")
            if isinstance(load, PrescribedDisplacement) and value_at(load.value, 0.0) != 0.0:
                raise ValueError(
                    f"{name} on tag {load.facets} is {value_at(load.value, 0.0)} m at the start, "
                    "where displacements are zero; give a function of time that starts at zero."
                )

    def _check_walls(self) -> None:
        for wall in self.walls:
            if not isinstance(wall, Wall):
                raise TypeError(f"{wall!r} is no Wall.")
            _check_law(wall.law)
            for name in ("point", "normal"):
                if np.ndim(require_numbers(f"A wall's {name}", getattr(wall, name))) != 1:
                    raise ValueError(
                        f"A wall's {name} should have {self.dim} components, got "
                        f"{getattr(wall, name)!r}."
                    )
            if len(wall.normal) != self.dim or len(wall.point) != self.dim:
                raise ValueError(
                    f"A wall's point and normal should have {self.dim} components, got "
                    f"{tuple(wall.point)} and {tuple(wall.normal)}."
                )
            if not np.all(np.isfinite([*wall.point, *wall.normal])):
                raise ValueError(
                    f"A wall's point and normal should be finite, got {tuple(wall.point)} and "
                    f"{tuple(wall.normal)}."
                )
            if not np.linalg.norm(wall.normal) > 0.0:
                raise ValueError(f"A wall's normal should not vanish, got {tuple(wall.normal)}.")

    def _check_ties(self) -> None:
        for tie in self.ties:
            if not all(hasattr(tie, name) for name in ("candidates", "antagonists", "law", "rule")):
                raise TypeError(f"{tie!r} is no Tie: give xf.Tie objects.")
            _check_law(tie.law)
            cell = self.bodies.mesh.topology.cell_name()
            if self.order != 1 or cell not in ("triangle", "tetrahedron"):
                raise ValueError(
                    "Ties need triangles or tetrahedra of order 1, whose surfaces are of segments "
                    f"or triangles; got {cell} cells of order {self.order}."
                )
            for facets in (tie.candidates, tie.antagonists):
                if facets not in self.bodies.facet_tags.values:
                    raise ValueError(
                        f"A tie names facet tag {facets}, which occurs nowhere; tags that do: "
                        f"{sorted(set(self.bodies.facet_tags.values.tolist()))}."
                    )

    def _check_tags(self) -> None:
        present = set(self.bodies.facet_tags.values.tolist())
        named = [load for load in self.loads if hasattr(load, "facets")]
        for item in (*named, *self.walls):
            require_integer(f"The facet tag of a {type(item).__name__}", item.facets)
            if item.facets not in present:
                raise ValueError(
                    f"{type(item).__name__} names facet tag {item.facets}, which occurs nowhere; "
                    f"tags that do: {sorted(present)}."
                )
        between = set(self.bodies.facets.tag.tolist())
        for tag in self.facet_interactions:
            if tag not in between:
                raise ValueError(
                    f"facet_interactions names facet tag {tag}, which no facet between two bodies "
                    f"has; those that do: {sorted(between - {0})}."
                )

    def _check_motions(self) -> None:
        """Two motions may share a node and a component only if they are the same motion."""
        motions = [load for load in self.loads if isinstance(load, _Motion)]
        if not motions:
            return
        mesh, tags = self.bodies.mesh, self.bodies.facet_tags
        fdim = mesh.topology.dim - 1
        mesh.topology.create_connectivity(fdim, 0)
        vertices_of = mesh.topology.connectivity(fdim, 0)
        vertices = {
            tag: set(np.concatenate([vertices_of.links(f) for f in tags.find(tag)]).tolist())
            for tag in {m.facets for m in motions}
        }
        for a, first in enumerate(motions):
            for second in motions[a + 1 :]:
                same = type(first) is type(second) and first.value == second.value
                if first.component != second.component or same:
                    continue
                if vertices[first.facets] & vertices[second.facets]:
                    raise ValueError(
                        f"{first} and {second} prescribe the same component of the same nodes; "
                        "let their facets be apart or give both the same value."
                    )

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
            _check_law(law)
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


def _is_tag(tag: object) -> bool:
    return isinstance(tag, Integral)


def _check_law(law: Law) -> None:
    """Raise TypeError unless `law` is an interaction law."""
    if not all(hasattr(law, name) for name in ("kernels", "parameters", "initial_state")):
        raise TypeError(f"{law!r} is no interaction law; nscd/laws has those there are.")
