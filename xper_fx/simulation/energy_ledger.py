# SPDX-License-Identifier: LGPL-3.0-or-later
"""The energy ledger: where the work of the loads went, step by step.

With v_m = (v0 + v1) / 2 and dq = q1 - q0 = h [theta v1 + (1 - theta) v0], the theta scheme gives
exactly

    d(kinetic) = (dq / h) . I - (theta - 1/2) dv . M . dv,

I being the sum of all impulses of the step: external, internal, viscous, reactions, interactions.
The macroscopic gradient of a periodic cell has no mass; its work is the mean of |Omega| Pibar at
both ends of the step times its increment.

In impacts the last term belongs to contacts: their impulses p take -(v0 + v1) . p / 2 from the
kinetic energy, whatever theta is (`SteppedPoints.from_scheme`). What is left to the scheme,
(theta - 1/2) dv . (I - p), is of first order in the step: positive in free fall, zero at rest,
negative in an impact, -(theta - 1/2) h f . dv with f the load, as the fall before was ahead by as
much; from drop to rest they cancel.

So the ledger closes to rounding for a linear bulk, whatever breaks; `dissipated_numerical` holds
what theta > 1/2 damps. An explicit bulk holds `shadow` beside the physical energies, and conserves
the sum (`bulk/explicit.py`). For other materials (f0 + f1)/2 . dq is the stored energy's increment
to second order only, and that is what `closure` then shows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from xper_fx.bulk.bulk import Bulk
from xper_fx.bulk.state import State, StepOutcome
from xper_fx.bulk.step_energies import own_energies
from xper_fx.nscd.stepped_points import StepWork

if TYPE_CHECKING:
    from xper_fx.nscd.rigid.motion import RigidMotion, RigidWork

# Relative difference of steps that is rounding.
_SAME = 1e-9


@dataclass
class Energies:
    """Energies at a time and totals since the start (J; 2D: J/m).

    Attributes:
        external_work: work of loads and of prescribed motions.
        kinetic, elastic, cohesive: energies held.
        shadow: what the energy that an explicit bulk conserves has beside these.
        healing: total that bodies were given where overlaps were taken back (`healing.py`).
        dissipated_cohesion, dissipated_friction, dissipated_impact, dissipated_plastic,
        dissipated_viscous, dissipated_viscous_bonds, dissipated_numerical: totals lost.
    """

    external_work: float = 0.0
    kinetic: float = 0.0
    elastic: float = 0.0
    cohesive: float = 0.0
    shadow: float = 0.0
    healing: float = 0.0
    dissipated_cohesion: float = 0.0
    dissipated_friction: float = 0.0
    dissipated_impact: float = 0.0
    dissipated_plastic: float = 0.0
    dissipated_viscous: float = 0.0
    dissipated_viscous_bonds: float = 0.0
    dissipated_numerical: float = 0.0

    @property
    def held_and_lost(self) -> float:
        """Sum of what is held and what was lost."""
        return sum(vars(self).values()) - self.external_work - self.healing


class BulkEnergies(NamedTuple):
    """What a step does in the bulk (J; 2D: J/m)."""

    work: float  #: of the loads and prescribed motions in the step
    kinetic: float  #: held at its end
    elastic: float  #: held at its end
    kinetic_change: float  #: gained in the step
    elastic_change: float  #: gained in the step
    plastic: float = 0.0  #: dissipated in the step by the bulk
    viscous: float = 0.0  #: dissipated in the step by the bulk
    damped: float = 0.0  #: dissipated in the step by the scheme, above theta = 1/2
    #: of the supports at the end of a static step, moved as in the step before (W; 2D: W/m)
    power_before: float = 0.0
    power: float = 0.0  #: the same, moved as in this step
    #: of half the change of loads and reactions over a static step, |df . du| / 2, and of what
    #: drives rigid bodies.
    change_work: float = 0.0


class EnergyLedger:
    """Keeps the energies of a run.

    The works of a static step are those of forces that change linearly from what was in balance
    at its start to what is at its end: of third order in the step. The forces at the end alone,
    which theta = 1 knows, would leave half of the elastic energy to the scheme.

    Args:
        state: state at the start.
        theta: weight of the end of the step.
        rigid: motion of the rigid bodies, None without any.
        explicit: whether the bulk is explicit.
        viscous_bonds: whether laws have viscous work.
        heals: whether overlaps are taken back.
        stored: energy that interactions hold at the start (J; 2D: J/m).
    """

    def __init__(
        self,
        bulk: Bulk,
        state: State,
        theta: float,
        rigid: RigidMotion | None,
        explicit: bool,
        viscous_bonds: bool,
        heals: bool,
        stored: float = 0.0,
    ):
        self._bulk, self._theta, self._explicit = bulk, theta, explicit
        self._static, self._viscous_bonds = bulk.inertia is None, viscous_bonds
        self._heals = heals
        held = (
            bulk.kinetic_energy(state.velocity),
            bulk.elastic_energy(state.displacement, state.internal),
        )
        kinetic, elastic = bulk.ranks.sum(np.array(held)).tolist()
        kinetic += rigid.kinetic if rigid else 0.0
        self.energies = Energies(kinetic=kinetic, elastic=elastic, cohesive=stored)
        self._at_start = self.energies.held_and_lost
        self._last_step = self._entered = 0.0  # of the last: all that was given and held, summed

    @property
    def closure(self) -> float:
        """External work and healing less what they became (J; 2D: J/m); zero if balanced."""
        given = self.energies.external_work + self.energies.healing
        return given - (self.energies.held_and_lost - self._at_start)

    @property
    def from_nowhere(self) -> float:
        """Energy gained or lost for no reason, relative to what the run was given and holds."""
        given = self._given
        return self._wrong / given if given > 0.0 else 0.0

    @property
    def _given(self) -> float:
        """What the run was given and holds (J; 2D: J/m)."""
        e = self.energies
        return abs(self._at_start) + abs(e.external_work) + e.kinetic + e.elastic + e.cohesive

    @property
    def _wrong(self) -> float:
        """Energy gained or lost for no reason (J; 2D: J/m)."""
        return abs(self.closure) + max(-self.energies.dissipated_numerical, 0.0)

    def is_rounding(self, displacement: np.ndarray) -> bool:
        """Whether energy from nowhere is no more than rounding.

        Each step enters energies to an ulp, and strains of bodies that have moved to what
        displacements leave of them.

        Args:
            displacement: at the end of the last step (m).
        """
        ulps = np.finfo(float).eps * self._entered
        return self._wrong < ulps + self._bulk.rounding(displacement)

    def bulk_energies(
        self,
        before: State,
        outcome: StepOutcome,
        step: float,
        rigid: RigidWork | None = None,
        borne: np.ndarray | float = 0.0,
    ) -> BulkEnergies:
        """Energies of the bodies in a step that has converged, which is not entered yet.

        Args:
            before: state at the start of the step.
            step: h (s).
            rigid: energies of the rigid bodies, None without any.
            borne: loads and reactions at the start of the step that were in balance there, shape
                (num_dofs,), N; of use in static runs.
        """
        after = outcome.state
        nodal, held = self._bulk.unknowns.num_nodes * self._bulk.dim, borne
        of_all = outcome.energies
        if of_all is None:
            own = own_energies(self._bulk, before, outcome, step, self._theta, borne)
            of_all = self._bulk.ranks.sum(own).tolist()
        work, kinetic, elastic, viscous, plastic, damped = of_all
        if nodal < len(after.displacement):  # of a periodic cell, whose bonds bear couples
            stresses = 0.5 * (before.internal[nodal:] + after.internal[nodal:])
            borne = outcome.impulses[nodal:] / step
            stresses -= 0.5 * (borne + self._bulk.borne) if self._static else borne
            moved = after.displacement[nodal:] - before.displacement[nodal:]
            work += float(moved @ stresses)  # every rank has all of it
        if rigid is not None:
            kinetic += rigid.kinetic
            work += rigid.loads + rigid.prescribed
            damped += rigid.scheme
        return BulkEnergies(
            work,
            kinetic,
            elastic,
            kinetic - self.energies.kinetic,
            elastic - self.energies.elastic,
            plastic,
            viscous,
            damped,
            *(self._of_static_step(before, outcome, step, held, rigid) if self._static else ()),
        )

    def _of_static_step(
        self,
        before: State,
        outcome: StepOutcome,
        step: float,
        borne: np.ndarray | float,
        rigid: RigidWork | None,
    ) -> tuple[float, float, float]:
        """What `BulkEnergies` has of static steps alone; a periodic cell's gradient has no change.

        Every rank has all of a gradient.
        """
        nodal, reactions = self._bulk.unknowns.num_nodes * self._bulk.dim, outcome.reactions
        motions = np.stack([before.velocity, outcome.state.velocity])
        forces = reactions / step
        powers = self._bulk.ranks.sum(motions[:, :nodal] @ forces[:nodal])
        last, now = powers + motions[:, nodal:] @ forces[nodal:]
        given = outcome.force_impulse + reactions
        change = 0.5 * (given / step - np.broadcast_to(borne, given.shape))[:nodal]
        moved = (outcome.state.displacement - before.displacement)[:nodal]
        driven = 0.0 if rigid is None else rigid.change
        led = abs(driven) + abs(self._bulk.ranks.sum(float(moved @ change)))
        return float(last), float(now), led

    def record(
        self, outcome: StepOutcome, step: float, bulk: BulkEnergies, work: StepWork | None
    ) -> None:
        """Enter a step that has converged.

        Args:
            step: h (s).
            bulk: what `bulk_energies` gave for it.
            work: what the interactions did, None without interactions.
        """
        e = self.energies
        self._take_shadow(*outcome.shadow, step)
        e.external_work += bulk.work
        e.kinetic, e.elastic = bulk.kinetic, bulk.elastic
        e.dissipated_plastic += bulk.plastic
        e.dissipated_viscous += bulk.viscous
        e.dissipated_numerical += bulk.damped
        if work is not None:
            e.cohesive = work.stored
            e.dissipated_cohesion += work.cohesion
            e.dissipated_friction += work.friction
            e.dissipated_impact += work.impact
            e.dissipated_viscous_bonds += work.viscous
            e.dissipated_numerical += work.numerical
        self._entered += self._given

    def heal(self, work: float, gained: float) -> None:
        """Enter that overlaps were taken back after a step.

        Args:
            work: of the loads on the way (J; 2D: J/m).
            gained: by the kinetic energy (J; 2D: J/m).
        """
        e = self.energies
        e.external_work += work
        e.kinetic += gained
        e.healing += gained - work

    def _take_shadow(self, start: float, end: float, step: float) -> None:
        """Hold what the scheme conserves beside the physical energies.

        It goes with the square of the step: another step than the one before makes it another.

        Args:
            start, end: of the step (J; 2D: J/m).
            step: h (s).
        """
        if self._last_step == 0.0:
            self._at_start += start
        elif abs(step - self._last_step) > _SAME * step:
            share = 1.0 - (step / self._last_step) ** 2
            self.energies.dissipated_numerical += share * self.energies.shadow
        self._last_step = step
        self.energies.shadow = end

    def leave_shadow(self) -> None:
        """Take it as numerical dissipation, as the next scheme conserves the physical energies."""
        self.energies.dissipated_numerical += self.energies.shadow
        self.energies.shadow = 0.0

    def exchange(self, kinetic: float, stored: float) -> None:
        """Let bodies and interactions come or leave with what they hold, as if from the start.

        Args:
            kinetic: energy of all bodies that are there now (J; 2D: J/m).
            stored: energy of interactions that have come less that of those that have left.
        """
        self._at_start += kinetic - self.energies.kinetic + stored
        self.energies.kinetic = kinetic
        self.energies.cohesive += stored

    def as_columns(self) -> dict[str, float]:
        """Energies and the closure error by column name; of effects only those that there are."""
        columns = vars(self.energies) | {"closure": self.closure}
        if not self._bulk.forms.plastic:
            del columns["dissipated_plastic"]
        if not self._viscous_bonds:
            del columns["dissipated_viscous_bonds"]
        if not self._explicit:
            del columns["shadow"]
        if not self._heals:
            del columns["healing"]
        return columns

    def saved(self) -> dict[str, float]:
        """All energies, what was held at the start, the last step, the sum of what was entered."""
        other = {"at_start": self._at_start, "last_step": self._last_step}
        return vars(self.energies) | other | {"entered": self._entered}

    def restore(self, saved: Mapping[str, float]) -> None:
        """Take the energies from what `saved` gave."""
        energies = dict(saved)
        self._at_start, self._last_step = energies.pop("at_start"), energies.pop("last_step")
        self._entered = energies.pop("entered")
        self.energies = Energies(**energies)
