# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a run shows of its own error, as it goes.

The error is that of global quantities: energies, work, largest force, motion, relative to the
largest energy held or to the largest force. What makes it, by name:

- **time step**: with P = dE/dt of the external work, the kinetic and the elastic energy, a scheme
  of second order leaves about h^3 |P''| / 12 a step, until what swings is out of phase
  (`swings.py`). P'' comes from three steps. Energy that an impact takes at once is no power and is
  left out. Static flow has no waves, and no history either without flow: doubled steps and the
  closure tell what steps leave there;
- **material**: `step_doubling.py`, for materials with a history and static paths with interactions;
- **tolerance**: what impulses leave of wrong sign (`StepWork.numerical`), or `_OF_IMPULSES` times
  the mean error that the solver left of the impulses themselves, whichever is more: tractions that
  err by a share shift what bonds bear and spend by some of it;
- **impacts** happen somewhere within a step: the energy that turns its way in that time. They come
  late, by half a step in the mean, and what turns one way (weights that have landed work no more)
  adds up; beside that each errs by itself, which adds as squares. It cannot exceed all there is;
- **motion**: a contact that closes within a step turns the velocities in the step's middle, up to h
  late, and the bodies are that much behind for good: h |dv| of the largest displacement, in the L2
  norm, with the mean h of the steps of impacts, weighted by what each took and by the share of the
  kinetic energy in all that was held. (A body that hits with its motion alone bounces late; what
  claps in a body full of waves hardly counts.) The other parts are not added to it;
- **damping** by theta above 1/2;
- **closure** of the energy ledger;
- **events**: a largest force between the ends of steps. It lies in the step up to the largest that
  is seen or in that after it, and exceeds it by about a third of what the force grows by in the one
  or falls by in the other, whichever is less: a smooth largest one is of second order. One that
  still grows at the end lags by 1 - theta of a step, as forces are means over steps. The force is
  that of the supports, or else the external power;
- **waves**: where waves are out of phase they add up to another largest force. A force errs by
  three times what two unrelated waves of it differ by, `_WAVES` (calibrated, as several waves do),
  times the share of the lags that is lost: of those of the energies, or half of that of the force
  itself if it is more, as its waves may be little beside all energy. (A force that falls to zero
  goes on with the other sign.) The largest errs by what it erred by when it was seen, or by how
  much a later one may exceed it with its own error (waves of a bar that snaps come after its
  largest force). Of supports alone, as powers are no waves, and with inertia. The other parts are
  not added to it.

`benchmarks/estimate_coverage.py` compares them with true errors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from xper_fx.bulk.state import StepOutcome
from xper_fx.nscd.stepped_points import StepWork
from xper_fx.simulation.energy_ledger import BulkEnergies
from xper_fx.simulation.step_doubling import StepDoubling
from xper_fx.simulation.swings import Swings
from xper_fx.support.ranks import Ranks

# Steps without damage after which bonds count as at rest.
REST = 20
# Error of global quantities over that of the impulses.
_OF_IMPULSES = 3.0
# Energy that an impact takes of the largest held; what its time errs by, and by how much it is late
# in the mean, in steps.
_AN_IMPACT, _OF_IMPACTS, _LATE = 1e-6, 1.4, 0.5
# Change of the velocities of bodies that bounce, over their velocities.
_REBOUND = 1.5
# Error of a largest force over what swings fastest of the force, where it is out of phase.
_WAVES = 3.0 * 2.0**0.5
# What the share counts that is lost of the lags of the force itself, beside that of the energies.
_OF_FORCE = 0.5
# Forces of supports beside those of the bulk that are what its iterations leave: of cells that
# stresses drive, and bodies that are held where nothing pulls.
_LITTLE_FORCE = 1e-4
# Work of the loads, relative to the largest energy, below which its power is no force to be missed.
_LITTLE_WORK = 1e-3


@dataclass
class _Parts:
    """What the error is made of (J; 2D: J/m where no unit is told)."""

    scale: float  #: largest energy held
    quiet: int = REST  #: steps since bonds were damaged
    #: numerical, closure, damped: by impulses, what the ledger misses, by theta above 1/2
    numerical: float = 0.0
    closure: float = 0.0
    damped: float = 0.0
    #: work, worked: external, and the sum of its sizes
    work: float = 0.0
    worked: float = 0.0
    #: impulses, steps: sum of the errors of the impulses (relative), steps made
    impulses: float = 0.0
    steps: int = 0
    #: force, last_force, growth: largest force seen (N, or W), that of the last step, and by how
    #: much it grew in the step of the largest
    force: float = 0.0
    last_force: float = 0.0
    growth: float = 0.0
    #: force of the last step, which changes its sign where it falls through zero
    signed: float = 0.0
    missed: float = 0.0  #: of a largest force, relative
    waves: float = 0.0  #: error of the largest force as waves are out of phase (N)
    #: squares of what steps of impacts left by their times, summed (J^2; 2D: J^2/m^2)
    impacts: float = 0.0
    struck: float = 0.0  #: energy that impacts took (J; 2D: J/m)
    #: sum of the energies that impacts took times their steps (J s; 2D: J s/m), each by the share
    #: of the kinetic energy in what was held
    late: float = 0.0
    #: largest norm of the velocities of meshed bodies since the first impact (m/s)
    fastest: float = 0.0
    moved: float = 0.0  #: largest norm of their displacements (m)


def _no_rounding(displacement: np.ndarray) -> float:
    return 0.0


class ErrorEstimate:
    """Estimates the relative error of a run.

    Args:
        energy: energy held at the start (J; 2D: J/m).
        doubling: compares steps with those of twice the size now and then, None if that is not
            called for.
        supported: whether supports bear forces, so that the largest of them is watched.
        lag: time by which the mean force of a step lags behind its end, in steps.
        lags: whether steps leave an error of their own size: not those of a bulk without inertia
            and interactions, whose states are those of its loads.
        ranks: that simulate the scene.

    Attributes:
        doubling: as given.
        rounding: of the elastic energy at a displacement (J; 2D: J/m), which loads of a static run
            may move bodies by that strain none; zero until it is set.
        lagging: what waves lag or run ahead by over what they lag with the trapezoidal rule.
        scale: the largest energy held, that of the step seen last included (J; 2D: J/m).
        noise: rounding of the elastic energy in the step seen last (J; 2D: J/m).
    """

    def __init__(
        self,
        energy: float,
        doubling: StepDoubling | None,
        supported: bool,
        lag: float,
        lags: bool,
        ranks: Ranks,
    ):
        self.doubling = doubling
        self.lagging = 1.0
        self.rounding: Callable[[np.ndarray], float] = _no_rounding
        self._supported, self._lag, self._lags, self._ranks = supported, lag, lags, ranks
        self._parts = _Parts(energy)
        self._turned = np.zeros(3)  # energies in steps of impacts, summed
        self._swings, self._force = Swings(3), Swings(1)  # of the energies, of the force
        self.scale = self.noise = self._time = 0.0  # the middle of the step that was seen last

    @property
    def error(self) -> float:
        """Relative error so far: the sum of `errors`; or `motion` or `waves` if one is more."""
        errors = self.errors
        alone = errors.pop("motion"), errors.pop("waves")
        return max(sum(errors.values()), *alone)

    @property
    def errors(self) -> dict[str, float]:
        """Relative errors so far, by what makes them."""
        parts = self._parts
        scale = parts.scale or np.inf
        impacts = np.hypot(np.sqrt(parts.impacts), _LATE * np.abs(self._turned).max())
        impulses = _OF_IMPULSES * parts.impulses / max(parts.steps, 1)
        watched = self._supported or parts.worked > _LITTLE_WORK * scale
        within = 0.0 if self.doubling is None else self.doubling.error
        return {
            "time step": self._swings.error / scale if self._lags else 0.0,
            "material": within / scale,
            "tolerance": max(self.numerical, impulses),
            "impacts": float(impacts / (scale + impacts)),
            "damping": abs(parts.damped) / scale,
            "closure": abs(parts.closure) / scale,
            "events": parts.missed if watched else 0.0,
            "motion": self._motion,
            "waves": parts.waves / (parts.force or np.inf),
        }

    @property
    def _motion(self) -> float:
        """Relative error of displacements, as impacts come late."""
        parts = self._parts
        if parts.late == 0.0 or parts.moved == 0.0:
            return 0.0
        return _REBOUND * parts.late / parts.struck * parts.fastest / parts.moved

    @property
    def numerical(self) -> float:
        """Energy of wrong sign that the impulses left so far, relative to the largest held."""
        return abs(self._parts.numerical) / (self._parts.scale or np.inf)

    @property
    def quiet(self) -> int:
        """Steps since bonds were damaged."""
        return self._parts.quiet

    def see(
        self, time: float, size: float, energies: BulkEnergies, displacement: np.ndarray
    ) -> tuple[float, float, float]:
        """Look at a step that may not be kept.

        Args:
            time: at its start (s).
            size: h (s).
            energies: of the bulk at its end.
            displacement: there (m).

        Returns:
            What it leaves, all energies together, by how much they turn from their last rates
            (both zero in the first steps), and by how much they change (J; 2D: J/m).
        """
        self.noise = self.rounding(displacement)
        self.scale = max(self._parts.scale, energies.kinetic + energies.elastic, self.noise)
        now, self._time = self._swings.now, time + 0.5 * size
        now[0], now[1], now[2] = energies.work, energies.kinetic_change, energies.elastic_change
        return self._swings.look(self._time, size)

    def take(
        self,
        size: float,
        energies: BulkEnergies,
        work: StepWork | None,
        closure: float,
        outcome: StepOutcome,
    ) -> None:
        """Take in a step that was committed, the last that was seen.

        Args:
            size: h (s).
            work: of the interactions, None without.
            closure: what the energy ledger now misses (J; 2D: J/m).
        """
        parts = self._parts
        held = energies.kinetic + energies.elastic
        if work is not None:
            share = energies.kinetic / held if held > 0.0 else 0.0
            held += work.stored
            parts.quiet = 0 if work.cohesion > 0.0 else parts.quiet + 1
            parts.numerical += work.numerical
            now = self._swings.now
            now[1] += (work.impact + work.friction) / size
            parts.impulses += min(outcome.residual, 1.0)
            strikes = share > 0.0 and work.impact > _AN_IMPACT * parts.scale
            if strikes and self._swings.steps:
                turn = size * (now - self._swings.last)
                parts.impacts += (_OF_IMPACTS * float(np.abs(turn).max())) ** 2
                self._turned = self._turned + turn
                parts.struck += work.impact
                parts.late += work.impact * size * share
        self._swings.take(self._time, size, self.lagging)
        parts.steps += 1
        parts.work += energies.work
        parts.worked += abs(energies.work)
        parts.closure = closure
        parts.damped += energies.damped
        parts.scale = max(self.scale, held, abs(parts.work))
        if work is not None:  # only what interactions strike comes late
            state = outcome.state
            vectors = state.velocity, state.displacement
            fast, moved = self._norms(vectors).tolist()
            parts.moved = max(parts.moved, moved)
            if parts.struck > 0.0:
                parts.fastest = max(parts.fastest, fast)
        force = abs(energies.work)
        if self._supported:
            impulses = outcome.supports.impulses
            force = math.sqrt(self._ranks.sum(float(impulses @ impulses)))
            if force > parts.force * size:
                state = outcome.state
                inner, moved = self._norms([state.internal, state.displacement]).tolist()
                rounding = self.noise / (moved or np.inf)
                if force < max(_LITTLE_FORCE * inner, rounding) * size:
                    force = 0.0
        self._watch(force / size, size, self._supported and energies.kinetic > 0.0)

    def _norms(self, vectors: Sequence[np.ndarray]) -> np.ndarray:
        """Norms of vectors over all ranks."""
        return np.sqrt(self._ranks.sum(np.array([vector @ vector for vector in vectors])))

    def _watch(self, force: float, size: float, waves: bool) -> None:
        """Look at the force of a step (N, or W); whether it is one of waves."""
        parts = self._parts
        waving = self._force
        signed = math.copysign(force, parts.signed + waving.now[0] * size)
        if parts.steps > 1:  # it is not known how the force grew before
            waving.now[0] = (signed - parts.signed) / size
            waving.take(self._time, size)
        parts.signed = signed
        erring = _WAVES * waving.amplitude if waves else 0.0
        if force > parts.force or force + erring > parts.force + parts.waves:
            lost = max(self._swings.out_of_phase, _OF_FORCE * waving.out_of_phase)
            erring *= lost
            parts.waves = max(parts.waves, force + erring - parts.force)
        if force > parts.force:
            parts.waves = erring
            before = parts.last_force if parts.steps > 1 else force
            parts.growth, parts.force = force - before, force
            parts.missed = self._lag * parts.growth / force
        elif parts.last_force == parts.force > 0.0:
            parts.missed = min(parts.growth, parts.force - force) / (3.0 * parts.force)
        parts.last_force = force

    def saved(self) -> dict:
        """What the error is made of."""
        saved = {
            "parts": vars(self._parts),
            "turned": self._turned,
            "time": self._time,
            "swings": self._swings.saved(),
            "force": self._force.saved(),
        }
        return saved if self.doubling is None else saved | {"doubling": self.doubling.saved()}

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave."""
        self._parts, self._turned = _Parts(**saved["parts"]), saved["turned"]
        self._time = saved["time"]
        self._swings.restore(saved["swings"])
        self._force.restore(saved["force"])
        if self.doubling is not None and "doubling" in saved:
            self.doubling.restore(saved["doubling"])
