# SPDX-License-Identifier: LGPL-3.0-or-later
"""A scene made ready to be stepped: its bodies on this rank, bulk, contacts, points, energies."""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from xper_fx.bulk.bulk import Bulk
from xper_fx.forms.dynamics import BulkForms
from xper_fx.forms.loads import PrescribedDisplacement, PrescribedVelocity
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.laws.parameters import fields_of
from xper_fx.nscd.point_group import bytes_of_groups
from xper_fx.scene.facet_laws import require_kernels
from xper_fx.scene.scene import Scene
from xper_fx.scene.scene_doubts import tell_doubts
from xper_fx.simulation.domain_decomposition import decomposed
from xper_fx.simulation.energy_ledger import EnergyLedger
from xper_fx.simulation.initial_state import initial_state
from xper_fx.simulation.law_checks import check_laws_suit, check_path_has_bonds
from xper_fx.simulation.leaning_bodies import leaning_bodies
from xper_fx.simulation.not_finite import not_finite_columns
from xper_fx.simulation.one_system import takes_one_system
from xper_fx.simulation.options import Options
from xper_fx.simulation.permanent_points import ScenePoints
from xper_fx.simulation.shared_motions import condenses, share_motions, touched_by_vertex
from xper_fx.simulation.tagged_facets import TaggedFacets
from xper_fx.support.profile import Stopwatch
from xper_fx.support.ranks import Ranks
from xper_fx.support.saved_rows import in_order

if TYPE_CHECKING:
    from xper_fx.bulk.explicit import ExplicitScheme
    from xper_fx.bulk.implicit import ImplicitScheme
    from xper_fx.bulk.rigid_only import EmptyScheme
    from xper_fx.nscd.mortar import TiedPoints
    from xper_fx.nscd.rigid.motion import RigidMotion
    from xper_fx.parallel.local_bodies import LocalBodies
    from xper_fx.simulation.accuracy_control import AccuracyControl
    from xper_fx.simulation.contact_detection import Detection
    from xper_fx.simulation.healing import Healing
    from xper_fx.simulation.jointed_bodies import JointedBodies
    from xper_fx.simulation.turned_bonds import BondTurns

logger = logging.getLogger(__name__)

# Steps as shares of the critical one: without a wish, and where an explicit bulk, linear so that
# its critical step stays what it is, should be as cheap as it can.
_BELOW_LIMIT, _AT_LIMIT = 0.7, 0.95
# Snap number from which bonds are told to break within a step; the coarsest printed plates have 14.
_SPENT_AT_ONCE = 100.0


class Model:
    """What a scene and the options of a run call for.

    Args:
        options: of which it can be run.
        team: ranks that have the scene; they divide its bodies or contacts where they can.
        stopwatch: of the run.
        rank_of_body: as of `decomposed`; the scene has been checked, and doubts told, if given.
        sweeps: whether an explicit bulk sweeps over contacts and bonds together.

    Attributes:
        scene, options, stopwatch: as given.
        ranks: those that divide the bodies or their contacts: `team`, or this one alone.
        part: what this rank has of the bodies, None if one rank has all.
        division: of the contacts of rigid bodies, None if one rank has all.
        rigid_share: what this rank has of rigid bodies beside divided meshed ones, None if all.
        balance: tells when bodies should be divided anew, None where they stay.
        bodies: this rank's meshed bodies.
        bulk: of these.
        facets: what is read of those with a tag.
        rigid: motion of the rigid bodies, None without any.
        step_size: h (s) at the start.
        start: state at the start.
        points: permanent points.
        detection: searches of contacts, None if the scene names no contacts.
        joints: of rigid bodies, None without any.
        by_vertex: whether each vertex of an explicit bulk is solved alone.
        sweeps: whether sweeps over contacts and bonds have taken the place of that; as given.
        monolithic: whether bulk and interactions are solved in one system.
        scheme: of the bulk in time.
        interactions: all points, None if the scene has none.
        healing: of the overlaps of rigid bodies, None where they are left.
        bond_turns: by how much bonds have turned that should not; None where they may.
        slot_nodes: nodes, among the unknowns, in the order of slots, rigid bodies left out.
        ledger: energies.
        control: of step and tolerances, None without an accuracy.

    Raises:
        ValueError: the scene cannot be run so.
    """

    def __init__(
        self,
        scene: Scene,
        options: Options,
        team: Ranks,
        stopwatch: Stopwatch,
        rank_of_body: np.ndarray | None = None,
        sweeps: bool = False,
    ):
        self.scene, self.options, self.stopwatch = scene, options, stopwatch
        if first := rank_of_body is None:
            _check(scene, options, team)
        tells = first and team.rank == 0
        self.ranks, self.part, self.division, self.rigid_share, self.balance = decomposed(
            scene, options, team, stopwatch, rank_of_body
        )
        self.bodies = scene.bodies if self.part is None else self.part.bodies
        self.bulk, ties = self._bulk()
        self.begins_explicit = _begins_explicit(options, scene, self.bulk, self.part)
        if self.begins_explicit:
            self.options = options = replace(options, scheme="explicit")
        self.facets = TaggedFacets(self.bodies, self.bulk)
        self.rigid = self._rigid_motion()
        self.step_size = self._step_size(tells)
        self.start = initial_state(
            self.bulk, self.bodies, scene.initial_velocity, self.step_size, options.inertia
        )
        searched = any(contact.law is not None for contact in scene.contacts)
        self.sweeps, touched = sweeps, searched or self.rigid is not None
        alone = not touched or touched_by_vertex(scene, sweeps, self.ranks)
        self.by_vertex = alone and options.scheme == "explicit" and scene.points == "nodal"
        self.points = ScenePoints(scene, self.bulk, ties, self.part, self.by_vertex)
        self.detection = self._detection() if searched else None
        self._laws = (self.points if self.detection is None else self.detection).laws
        self.joints: JointedBodies | None = None
        if scene.joints:
            from xper_fx.simulation.jointed_bodies import JointedBodies

            self.joints = JointedBodies(scene, self._laws, self.division, self.rigid_share)
            self._laws = self.joints.laws
        for law in self._laws:
            require_kernels(law, scene.dim)
        if any(law.kernels(scene.dim).rolling is not None for law in self.points.laws):
            raise ValueError(
                "Rolling resistance is of rigid discs and spheres, and a law of facets or walls of "
                "meshed bodies, which have no spin, has it: give a law with rolling=0 there."
            )
        self.monolithic = takes_one_system(options, scene, self.points, searched, self.bulk)
        if not (self.monolithic or options.inertia) and self._laws and tells:
            options.requested.doubt_tolerance()
        self.scheme = self.new_scheme()
        with stopwatch.phase("interaction points"):
            self.interactions = self._interactions()
            if self.detection is not None and self.part is not None:
                self.detection.share(self.interactions, self.slot_nodes)
        if self.interactions is not None and self.interactions.fused is not None:
            if not self.by_vertex:
                prescribed = self.bulk.layout.prescribed
                share_motions(self.interactions, self.slot_nodes, prescribed, self.start)
            elif first:
                self._doubt_fracture_energies()
        self.healing = self._healing()
        self.bond_turns = self._bond_turns()
        if options.path is not None:
            laws = [] if self.interactions is None else self.interactions.laws
            there = self.ranks.union(np.unique(self.points.law_of_point))
            viscous = self.bulk.damping is not None or self.bulk.forms.viscous
            kernels = [laws[n].kernels(scene.dim) for n in there]
            check_path_has_bonds(kernels, options.path.asks, viscous)
        self._account()
        self.ledger = EnergyLedger(
            self.bulk, self.start, self.scheme.theta, self.rigid, options.scheme == "explicit",
            self._has_viscous_bonds, self.healing is not None,
            0.0 if self.joints is None else self.joints.stored,
        )  # fmt: skip
        if wrong := not_finite_columns(self.ledger.as_columns()):
            raise ValueError(
                f"At the start {wrong} are not finite: initial velocities or masses are beyond "
                "the range of floats; take other units."
            )
        self.control = _control(self)

    # Bulk

    def _bulk(self) -> tuple[Bulk, list[TiedPoints]]:
        """The bulk, and the points of each tie on this rank's candidates."""
        scene, inertia = self.scene, self.options.inertia
        ties: list[TiedPoints] = []
        if scene.bodies is None:
            from xper_fx.bulk.rigid_only import EmptyBulk

            return EmptyBulk(scene.dim), ties
        driven = PrescribedVelocity | PrescribedDisplacement
        motions = [load for load in scene.loads if isinstance(load, driven)]
        forces = [load for load in scene.loads if not isinstance(load, driven)]
        with self.stopwatch.phase("forms"):
            judged = self.options.requested.accuracy is not None
            forms = BulkForms(self.bodies, scene.order, scene.materials, forces, judged)
        if scene.ties:
            from xper_fx.scene.tie import tie_points

            ties += [
                tie_points(tie, forms.V, scene.bodies, self.part, self.ranks, forms.finite_strain)
                for tie in scene.ties
            ]
        joined = () if inertia else self._joined_bodies(ties)
        numbers = self.part and scene.bodies.numbers_on_all(self.part.body_numbers)
        if scene.macroscopic is None:
            leaning = () if inertia else leaning_bodies(scene, self.bodies)
            bulk = Bulk(
                forms, motions, scene.damping, inertia, joined, self.ranks, numbers, leaning
            )
            return bulk, ties
        from xper_fx.periodic.two_field import CellBulk

        bulk = CellBulk(forms, scene.macroscopic, inertia, joined, self.ranks, numbers)
        if bulk.floating and not self.options.allows_one_system:
            raise ValueError(
                "A static run of a periodic cell of several bodies takes the monolithic solver: "
                f'leave solver at "auto", got "{self.options.solver}".'
            )
        return bulk, ties

    def _joined_bodies(self, ties: list[TiedPoints]) -> np.ndarray:
        """Pairs of bodies between which interactions act, those known here, shape (n, 2)."""
        bodies, (_, law) = self.scene.bodies, self.scene.law_of_facet()
        facing = bodies.numbers_on_all(bodies.facets.bodies[law >= 0])
        return np.concatenate([facing, *(tied.bodies for tied in ties)])

    def _rigid_motion(self) -> RigidMotion | None:
        if self.scene.rigid_bodies is None:
            return None
        scene, bodies = self.scene, self.scene.rigid_bodies
        if scene.lattice is not None:
            from xper_fx.periodic.grain_cell import CellMotion, DrivenCellMotion

            if scene.macroscopic is not None:
                return DrivenCellMotion(bodies, scene.lattice, scene.macroscopic)
            return CellMotion(bodies, scene.lattice, scene.gravity)
        if not self.options.inertia:
            from xper_fx.nscd.rigid.driven_motion import DrivenMotion

            return DrivenMotion(bodies)
        from xper_fx.nscd.rigid.motion import RigidMotion

        return RigidMotion(bodies, scene.gravity)

    def _step_size(self, tells: bool) -> float:
        """The step asked for, or a share of the critical one.

        Raises:
            ValueError: the explicit bulk would be unstable.
        """
        step, explicit = self.options.requested.step, self.options.scheme == "explicit"
        if step is not None and not explicit:
            return float(step)
        from xper_fx.bulk.stable_step import SAFE, stable_step

        critical = stable_step(self.bulk) if explicit else self.bulk.critical_step()
        if step is None:
            at_limit = explicit and self.options.requested.adapts_step and self.bulk.linear
            return (_AT_LIMIT if at_limit else _BELOW_LIMIT) * critical
        if step > critical:
            raise ValueError(
                f"The explicit bulk is unstable at the step {step:g} s; it should be below the "
                f'critical one, {critical:.3g} s. Take a smaller step or scheme="implicit".'
            )
        if self.bulk.forms.finite_strain and step > SAFE * critical and tells:
            logger.warning(
                "The step %.3g s is %.2f of the critical one, which falls as cells are flattened "
                "or stiffen: at the first fall the step will be cut by half, for the rest of the "
                "run. Leave some room, or leave the step out: it is %.1f of the critical one then.",
                step, step / critical, _BELOW_LIMIT,
            )  # fmt: skip
        return float(step)

    def new_scheme(self) -> EmptyScheme | ExplicitScheme | ImplicitScheme:
        """The scheme that the options ask for."""
        options, interacting = self.options, self.points.interacting(self.detection)
        if self.scene.bodies is None:
            from xper_fx.bulk.rigid_only import EmptyScheme

            return EmptyScheme(self.bulk, options.theta, self.stopwatch)
        if options.scheme == "explicit":
            from xper_fx.bulk.explicit import ExplicitScheme

            by_body = not self.by_vertex
            return ExplicitScheme(self.bulk, interacting, self.stopwatch, by_body)
        if self.monolithic:
            from xper_fx.bulk.monolithic_scheme import MonolithicScheme

            Scheme = partial(
                MonolithicScheme, gives_up=options.may_leave_one_system, jumps=options.path is None
            )
        else:
            from xper_fx.bulk.implicit import ImplicitScheme as Scheme

        return Scheme(
            self.bulk, interacting, options.theta, options.requested.newton_tolerance,
            options.max_newton, self.stopwatch,
        )  # fmt: skip

    def leave_one_system(self) -> None:
        """Go on from the last step with points everywhere, and sweeps."""
        history, self.monolithic = in_order(self.interactions.saved()), False
        self.scheme = self.new_scheme()
        self.interactions = self._interactions()
        self.interactions.restore(history)
        self.stopwatch.owns("coupled system", lambda: 0)  # it is gone
        self._account()

    # Interactions

    def _detection(self) -> Detection:
        """The searches that the scene's contacts call for."""
        scene, V, laws = self.scene, getattr(self.bulk.forms, "V", None), self.points.laws
        static = not self.options.inertia
        if scene.bodies is not None and scene.bodies.spread is not None:
            from xper_fx.simulation.spread_detection import SpreadDetection

            return SpreadDetection(
                scene, self.points, V, self.part, self.ranks, self.rigid_share, static
            )
        from xper_fx.simulation.contact_detection import Detection

        detection = Detection(scene, laws, V, self.part, self.ranks, self.rigid_share, static)
        if self.division is not None:
            detection.divide(self.division)
        return detection

    def _interactions(self) -> Interactions | None:
        if not self.points.exist and self.rigid is None and self.detection is None:
            return None
        inverse = self.scheme.inverse(self.step_size, self.start.displacement)
        self.slot_nodes = inverse.nodes
        rigid_blocks, share = None if self.rigid is None else self.rigid.blocks, self.rigid_share
        own_blocks = rigid_blocks if share is None else rigid_blocks[share.here]
        points, halo = self.points.on_slots(inverse, own_blocks)
        velocity = self.start.velocity.reshape(-1, self.bulk.dim)[inverse.nodes]
        if halo is not None:
            velocity = halo.with_ghost_values(velocity)
        laws = self._laws
        if any(map(fields_of, laws)):
            from xper_fx.simulation.law_fields import laws_at_points

            laws = laws_at_points(laws, self.points, self.scene, self.ranks)
        if self.monolithic and not self.options.inertia:
            laws = [law.in_statics() if hasattr(law, "in_statics") else law for law in laws]
        check_laws_suit(
            laws, self.bulk.dim, self.points.law_of_point, points.gap, self.options.inertia,
            self.monolithic,
        )  # fmt: skip
        stepped = self.monolithic and self.options.path is None
        condensed = stepped and self.part is None and condenses(self.scene, laws)
        splits = self.by_vertex or condensed
        interactions = Interactions(
            points, laws, self.points.law_of_point, inverse.blocks, velocity,
            ordering="vertices" if splits else "tiles",
            rigid_blocks=rigid_blocks, halo=halo, splits=splits, rigid_share=share,
        )  # fmt: skip
        if not self.options.inertia:
            interactions.driven = self.rigid
        return interactions

    def _doubt_fracture_energies(self) -> None:
        """Warn of initially rigid bonds that are gone in a step, whatever they should spend."""
        from xper_fx.nscd.laws.softening import snap_of_cells

        number, point = snap_of_cells(self.interactions, self.step_size)
        largest = self.interactions.largest(number)
        if largest > _SPENT_AT_ONCE and self.ranks.rank == 0:
            where = ""
            if self.ranks.alone:  # else no rank knows which point it is
                where = f" at ({', '.join(f'{x:g}' for x in self.points.place(point))}) m"
            logger.warning(
                "initially rigid bonds%s break within a step, as their fracture energy is small: "
                "the snap number may be %.2g; a step of %.2g s would make it one, or a larger "
                "fracture energy, a lower strength or smaller cells",
                where, largest,
                self.step_size / math.sqrt(largest),
            )  # fmt: skip

    def _healing(self) -> Healing | None:
        """What takes overlaps back between rigid bodies alone, whose contacts store nothing.

        Joints do not take part in that motion, and would open; nothing holds a periodic cell.
        """
        scene = self.scene
        if not self.options.healing or self.detection is None:
            return None
        bound = scene.bodies is not None or scene.joints or scene.lattice is not None
        if bound or not scene.rigid_bodies.is_prescribed.any():  # nothing holds them
            return None
        if any("stored" in law.kernels(self.scene.dim).energies for law in self.detection.laws):
            return None
        from xper_fx.simulation.healing import Healing

        return Healing(self.rigid, [c.between for c in self.scene.contacts if c.law is not None])

    def _bond_turns(self) -> BondTurns | None:
        """How far bonds have turned, where their frames do not turn with them."""
        points, scene = self.points, self.scene
        if scene.bodies is None or self.interactions is None or self.interactions.turns:
            return None
        _, law = scene.law_of_facet()
        bonds = ["damage" in one.kernels(scene.dim).state_names for one in points.laws]
        breaks = np.array(bonds, bool)[law[points.facets_with_law]]
        if not self.ranks.max(breaks.any()):
            return None
        from xper_fx.simulation.turned_bonds import BondTurns

        return BondTurns(
            scene.bodies, self.part, self.ranks, self.bulk.forms.V, points.facets_with_law,
            points.facet_numbers, breaks, points.points_a_facet,
        )  # fmt: skip

    @property
    def _has_viscous_bonds(self) -> bool:
        laws = [] if self.interactions is None else self.interactions.laws
        return any("viscous" in law.kernels(self.scene.dim).energies for law in laws)

    def _account(self) -> None:
        """Say which phase holds which arrays."""
        owns, forms, interactions = self.stopwatch.owns, self.bulk.forms, self.interactions
        owns("forms", lambda: self.bulk.nbytes)
        if forms.has_history:
            owns("commit", lambda: forms.history_nbytes)
        if interactions is not None:
            owns("interaction points", lambda: bytes_of_groups(interactions.groups))


def _check(scene: Scene, options: Options, team: Ranks) -> None:
    """See that all ranks have the same scene, and tell what is doubted of it."""
    if not team.alone or (scene.bodies is not None and scene.bodies.spread is not None):
        from xper_fx.simulation.same_on_ranks import check_same_on_ranks

        check_same_on_ranks(scene, options, team)
    tell_doubts(scene, options.requested.step, team)


def _begins_explicit(options: Options, scene: Scene, bulk: Bulk, part: LocalBodies | None) -> bool:
    """Whether a run begins with an explicit bulk, to go on with an implicit one if need be."""
    picked = options.scheme_is_picked and options.scheme == "implicit"
    if not (picked and options.requested.adapts_step and options.inertia and options.theta == 0.5):
        return False
    if scene.bodies is None or not bulk.linear or bulk.damping is not None:
        return False
    bonds = scene.law_of_facet()[1] >= 0
    others = scene.rigid, scene.contacts, scene.walls, scene.ties, scene.joints
    num_bodies, num_cells = scene.bodies.counts
    alone = scene.macroscopic is None and not bonds.any() and not any(map(len, others))
    return alone and num_bodies < num_cells


def _control(model: Model) -> AccuracyControl | None:
    """Of step and tolerance, None if no accuracy is asked for."""
    if model.options.requested.accuracy is None:
        return None
    from xper_fx.simulation.accuracy_of_run import control_of, first_implicit_step

    held = model.ledger.energies
    control = control_of(
        model.options, model.scene, model.bulk, model.interactions, model.detection is not None,
        model.scheme.theta, held.kinetic + held.elastic, model.step_size,
    )  # fmt: skip
    found = model.detection is not None and model.rigid is None
    if found and model.ranks.sum(len(model.points.law_of_point)) == 0:
        control.wait()
    if model.begins_explicit:
        control.awaited = first_implicit_step(model.bulk)
    return control
