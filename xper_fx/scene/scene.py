# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scene: what a user composes - bodies, materials, interactions, loads.

Everything is checked here, before any work.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from numbers import Integral
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from xper_fx.bodies.explode import Bodies
from xper_fx.forms.loads import Gravity, RayleighDamping, varies, vector_at
from xper_fx.materials.material import InelasticMaterial, Material
from xper_fx.nscd.laws.law import Law
from xper_fx.scene.contact import Contact, check_contacts
from xper_fx.scene.container_checks import check_containers
from xper_fx.scene.facet_laws import facet_laws
from xper_fx.scene.initial_velocity import Field, check_initial_velocity
from xper_fx.scene.load_checks import (
    Load,
    check_initial_stresses,
    check_loads,
    check_motions,
    check_outer,
    check_places,
)
from xper_fx.scene.material_checks import check_materials
from xper_fx.scene.wall import Wall
from xper_fx.support.checks import require_flag, require_integer, require_kind
from xper_fx.support.compat import geometry_dofmap
from xper_fx.support.ranks import ALONE, Ranks

if TYPE_CHECKING:
    from xper_fx.nscd.rigid.bodies import RigidBodies
    from xper_fx.nscd.rigid.body import RigidBody
    from xper_fx.periodic.drive import MacroscopicDrive
    from xper_fx.scene.joints import Joint
    from xper_fx.scene.snapshot import Snapshot
    from xper_fx.scene.tie import Tie


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
        initial_velocity: function of positions, shape (3, n) -> (dim, n), m/s, or one of DOLFINx,
            or one for some of the cell tags each (bodies that touch and move apart); rest if None.
            Dofs with a prescribed displacement start at its rate.
        order: order of the Lagrange space, 1 or 2.
        points: "nodal" or "gauss", where interactions act on a facet (see `nscd/facets.py`).
            Nodal points are right but for cohesive bonds on tetrahedra of order 2, where a
            uniform traction needs Gauss points (nodal ones were off by 2.6 % in a patch test).
        ties: laws between surfaces meshed apart, whose nodes do not match (`xper_fx/scene/tie.py`);
            for triangles and tetrahedra of order 1.
        macroscopic: what drives a periodic cell (bodies made with a `lattice`, or rigid bodies in
            one); such a scene has no loads, walls, ties or damping, and initial velocities are
            those of the fluctuation.
        rigid: rigid bodies; of the loads gravity acts on them.
        lattice: makes a scene of rigid bodies alone periodic: edges of its box, shape (dim,), None
            for a direction without a period, or period vectors as rows, shape (p, dim), p <= dim,
            m, which they are made. The cell keeps its shape unless `macroscopic` drives it. Bodies
            may lie anywhere, as each stands for all of its images.
        surfaces: cell tags of the meshed bodies that make up a group, by the group's name; their
            outer facets, and those that fracture frees, are what `contacts` of the group touch.
        contacts: between which groups (rigid bodies by their `group`, surfaces by their name)
            contacts are looked for in each step, and their laws; each pair of groups that can meet
            is named, a group of several bodies with itself too.
        joints: hinges, sliders, welds and tendons between rigid bodies, solved with the contacts.
            Bodies that a joint other than a tendon joins do not touch each other.
        resolve_overlaps: whether rigid bodies that overlap at the start are moved apart; they are
            refused otherwise, but for those that a run has left so.
        after: state of a run, `Simulation.snapshot()`, that a simulation of this scene goes on
            from. Rigid bodies and joints go on that are the same objects in both scenes; others are
            new, placed among the bodies as the run has left them.

    Attributes:
        rigid_bodies: the rigid bodies as arrays, None without any.

    Raises:
        ValueError: a tag without material or law, a tag that occurs nowhere, an order or a rule
            that does not exist, groups that can meet and that no contact names, a rigid wall
            that looks away from all bodies, rigid bodies that overlap.
        TypeError: something that is no material, law or load.
        AttributeError: an attribute is set later; `dataclasses.replace` makes another scene.
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
    lattice: npt.ArrayLike | None = None
    surfaces: Mapping[str, Sequence[int]] = field(default_factory=dict)
    contacts: Sequence[Contact] = ()
    joints: Sequence[Joint] = ()
    resolve_overlaps: bool = False
    after: Snapshot | None = None
    rigid_bodies: RigidBodies | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        check_containers(vars(self))
        require_flag("resolve_overlaps", self.resolve_overlaps)
        if not isinstance(self.order, Integral) or self.order not in (1, 2):
            raise ValueError(f"order should be 1 or 2, got {self.order}.")
        if not isinstance(self.points, str) or self.points not in ("nodal", "gauss"):
            raise ValueError(f'points should be "nodal" or "gauss", got {self.points!r}.')
        if len(self.rigid):
            from xper_fx.nscd.rigid.bodies import RigidBodies

            self.rigid_bodies = RigidBodies(self.rigid)
        if self.after is not None:
            self._start_after()
        if self.bodies is not None and not isinstance(self.bodies, Bodies):
            raise TypeError(
                f"bodies is {self.bodies!r}; `xper_fx.bodies.explode.explode` makes them."
            )
        spread = None if self.bodies is None else self.bodies.spread
        # of a mesh that is spread a rank may find what no other one knows
        ranks = ALONE if spread is None else spread.ranks
        ranks.together(self._check)
        self._check_walls(ranks)
        ranks.together(self._separate_rigid_bodies)
        if self.bodies is not None:
            check_places(self.loads, self.bodies, self.order, ranks)
        self._fix()
        if self.after is not None:
            self.after.check(self)

    def _check(self) -> None:
        if self.bodies is None:
            self._check_without_mesh()
        else:
            self._check_with_mesh()
        if self.damping is not None and not isinstance(self.damping, RayleighDamping):
            raise TypeError(f"damping should be a RayleighDamping or None, got {self.damping!r}.")
        check_loads(self.loads, self.dim)
        self._check_joints()
        if self.contacts or not self.joints:
            check_contacts(self.contacts, self.surfaces, self.materials, self.rigid_bodies)
        self._check_meetings()

    def _fix(self) -> None:
        """Keep lists and mappings of one's own, and let no attribute be set any more."""
        for item in fields(self):
            given = getattr(self, item.name)
            if isinstance(given, list):
                object.__setattr__(self, item.name, tuple(given))
            elif isinstance(given, dict):
                object.__setattr__(self, item.name, dict(given))
        object.__setattr__(self, "_is_fixed", True)

    def __setattr__(self, name: str, value: object) -> None:
        if getattr(self, "_is_fixed", False):
            raise AttributeError(
                f"A scene is checked when it is made and does not change, got {name} = {value!r}; "
                f"make another one: dataclasses.replace(scene, {name}=...)."
            )
        object.__setattr__(self, name, value)

    def _check_without_mesh(self) -> None:
        if self.rigid_bodies is None:
            raise ValueError("A scene needs bodies: an exploded mesh, rigid bodies, or both.")
        for name in (
            "materials", "interactions", "default_interaction", "facet_interactions", "walls",
            "ties", "damping", "initial_velocity", "surfaces",
        ):  # fmt: skip
            if getattr(self, name):
                raise ValueError(f"A scene without a mesh has no {name}; leave it out.")
        if self.order != 1:
            raise ValueError(f"A scene without a mesh has no order, got {self.order}.")
        for load in self.loads:
            if not isinstance(load, Gravity):
                raise ValueError(
                    f"Of the loads only gravity acts on rigid bodies, got {load!r}: a RigidBody "
                    "takes its `force`, `torque` and `prescribed` velocities itself."
                )
        self._check_lattice()

    def _check_lattice(self) -> None:
        if self.lattice is None:
            if self.macroscopic is not None:
                raise ValueError(
                    "A macroscopic drive needs a periodic cell: give its `lattice` to the scene."
                )
            return
        from xper_fx.scene.rigid_lattice import check_grains_in_cell, lattice_of_grains

        for name, given in (("joints", self.joints), ("after", self.after)):
            if given:
                raise ValueError(
                    f"A periodic cell of rigid bodies has no `{name}`: leave it out, or give no "
                    "`lattice`. The bodies of a run are `xf.output.rigid_bodies_now(simulation)`."
                )
        self.lattice = lattice_of_grains(self.lattice, self.dim)
        check_grains_in_cell(
            self.rigid_bodies, self.lattice, self.macroscopic, self.gravity is not None
        )

    def _check_with_mesh(self) -> None:
        if self.rigid_bodies is not None and self.rigid_bodies.dim != self.dim:
            raise ValueError(
                f"The mesh has dimension {self.dim}, the rigid bodies {self.rigid_bodies.dim}."
            )
        self._check_periodicity()
        check_materials(self.materials, self.bodies.present.cells)
        check_initial_velocity(self.initial_velocity, self.materials, self.dim)
        for wall in self.walls:
            if not isinstance(wall, Wall):
                raise TypeError(f"{wall!r} is no Wall.")
            wall.check(self.dim)
        for tie in self.ties:
            if not all(hasattr(tie, name) for name in ("candidates", "antagonists", "law", "rule")):
                raise TypeError(f"{tie!r} is no Tie: give xf.Tie objects.")
            tie.check(self.bodies, self.order)
        self._check_tags()
        check_initial_stresses(self.loads, self.bodies, self.materials)
        check_motions(self.loads, self.bodies, self.order)
        check_outer(self.loads, self.walls, self.bodies)
        self.law_of_facet()

    @property
    def dim(self) -> int:
        """Dimension of space."""
        if self.bodies is None:
            return self.rigid_bodies.dim
        return self.bodies.mesh.geometry.dim

    @property
    def gravity(self) -> np.ndarray | Callable[[float], np.ndarray] | None:
        """Sum of the gravities among the loads, shape (dim,), m/s^2; None without any.

        A function of time where one of them is.
        """
        given = [load.value for load in self.loads if isinstance(load, Gravity)]
        if any(map(varies, given)):
            return lambda time: np.sum([vector_at(g, time, self.dim) for g in given], axis=0)
        return np.sum(given, axis=0) if given else None

    def _start_after(self) -> None:
        from xper_fx.scene.snapshot import Snapshot

        require_kind("after", self.after, Snapshot)
        if self.after.scene.rigid and self.rigid:
            self.after.place(self.rigid, self.rigid_bodies)

    def _check_joints(self) -> None:
        if not self.joints:
            return
        if self.rigid_bodies is None:
            raise ValueError("Joints join rigid bodies, and the scene has none: give `rigid`.")
        from xper_fx.scene.joints import check_joints

        check_joints(self.joints, self.rigid, self.rigid_bodies)

    @property
    def kept_apart(self) -> np.ndarray:
        """Pairs of rigid bodies that do not touch, as a joint joins them, shape (n, 2), int."""
        if not self.joints:
            return np.zeros((0, 2), int)
        from xper_fx.scene.joints import joined_bodies

        return joined_bodies([joint for joint in self.joints if joint.keeps_apart], self.rigid)

    def _check_meetings(self) -> None:
        """Of groups that may meet each pair is decided."""
        if not self.contacts:
            return
        from xper_fx.scene.undecided_pairs import check_pairs_decided

        pieces = {}
        if self.surfaces and self.bodies.spread is not None:
            # no rank knows what hangs together: all groups may be of several pieces each
            pieces = {name: [2 * n, 2 * n + 1] for n, name in enumerate(self.surfaces)}
        elif self.surfaces:
            from xper_fx.scene.body_pieces import pieces_of_bodies

            piece = pieces_of_bodies(self.bodies, self.law_of_facet()[1])[self.bodies.body_of_cell]
            for name, tags in self.surfaces.items():
                own = np.isin(self.bodies.material_of_cell, list(tags))
                pieces[name] = np.unique(piece[own]).tolist()
        check_pairs_decided(self.contacts, self.rigid_bodies, pieces)

    def _check_walls(self, ranks: Ranks) -> None:
        """Rigid walls look at what may touch them; ranks of a spread mesh call it together."""
        if not self.contacts or self.rigid_bodies is None:
            return
        from xper_fx.scene.upside_down_walls import check_walls_look_at_bodies

        nodes = {}
        for name, tags in self.surfaces.items():
            mesh, own = self.bodies.mesh, np.isin(self.bodies.material_of_cell, list(tags))
            nodes[name] = mesh.geometry.x[np.unique(geometry_dofmap(mesh)[own]), : self.dim]
        check_walls_look_at_bodies(self.contacts, self.rigid_bodies, nodes, ranks)

    def _separate_rigid_bodies(self) -> None:
        """Report or resolve overlaps of rigid bodies at the start."""
        rigid = set() if self.rigid_bodies is None else {*self.rigid_bodies.groups}
        touching = [c.between for c in self.contacts if c.law is not None and {*c.between} <= rigid]
        if touching:
            from xper_fx.scene.initial_overlaps import separate

            left = None if self.after is None else self.after.numbers_of(self.rigid) >= 0
            separate(
                self.rigid_bodies, touching, self.resolve_overlaps, self.kept_apart, left,
                self.lattice,
            )  # fmt: skip

    def _check_periodicity(self) -> None:
        if self.lattice is not None:
            raise ValueError(
                "The `lattice` of a scene is that of rigid bodies without a mesh: give that of a "
                "mesh to `explode`. Meshed bodies do not look for contacts across the border."
            )
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

    def _check_tags(self) -> None:
        present = self.bodies.present.facets
        named = [load for load in self.loads if hasattr(load, "facets")]
        for item in (*named, *self.walls):
            require_integer(f"The facet tag of a {type(item).__name__}", item.facets)
            if item.facets not in present:
                raise ValueError(
                    f"{type(item).__name__} names facet tag {item.facets}, which occurs nowhere; "
                    f"tags that do: {sorted(present)}."
                )
        between = {tag for *_, tag in self.bodies.present.facing}
        for tag in self.facet_interactions:
            if tag not in between:
                raise ValueError(
                    f"facet_interactions names facet tag {tag}, which no facet between two bodies "
                    f"has; those that do: {sorted(between - {0})}."
                )

    def law_of_facet(self) -> tuple[list[Law], np.ndarray]:
        """The laws between bodies and, for each facing facet, its law (`facet_laws`)."""
        laws, index = self._facet_laws
        return list(laws), index

    @cached_property
    def _facet_laws(self) -> tuple[list[Law], np.ndarray]:
        return facet_laws(
            self.bodies, self.interactions, self.default_interaction, self.facet_interactions
        )
