# SPDX-License-Identifier: LGPL-3.0-or-later
"""The state of a simulation, saved and restored: what a checkpoint holds."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from xper_fx.bulk.state import State, StepOutcome, Supports
from xper_fx.nscd.solvers.solver import Solver
from xper_fx.simulation.course import Course
from xper_fx.simulation.explicit_start import leave_explicit
from xper_fx.simulation.model import Model
from xper_fx.simulation.readings import Readings
from xper_fx.simulation.shared_motions import bonds_split
from xper_fx.simulation.solver_memory import restore_memory, saved_memory
from xper_fx.support.errors import CheckpointError
from xper_fx.support.ranks import Ranks
from xper_fx.support.saved_rows import Rows

if TYPE_CHECKING:
    from xper_fx.parallel.local_bodies import LocalBodies
    from xper_fx.periodic.averages import Macroscopic
    from xper_fx.scene.scene import Scene
    from xper_fx.scene.snapshot import Snapshot
    from xper_fx.simulation.attempt import StepAttempts

logger = logging.getLogger(__name__)

_NONE = np.zeros(0)


class Restartable(Readings):
    """A simulation whose state can be saved, and which can go on from one."""

    solver: Solver
    ranks: Ranks
    part: LocalBodies | None
    step_number: int
    tolerance: float
    macroscopic: Macroscopic | None
    _given: Scene  # as it was given: that of the model may have its bodies on other ranks
    _course: Course
    _save: Callable[[], Path] | None
    _attempts: StepAttempts
    _take: Callable[[Model], None]

    def save_on_failure(self, save: Callable[[], Path] | None) -> None:
        """Save the state where a step does not converge, before the error is raised.

        Args:
            save: saves the state and returns the file; None to save nothing.

        Raises:
            TypeError: `save` cannot be called.
        """
        if save is not None and not callable(save):
            raise TypeError(f"save should be a function that returns a file's path, got {save!r}.")
        self._save = save

    def save_state(self) -> Path | None:
        """Save the state before a step that failed, as `save_on_failure` says.

        Returns:
            The file; None if nothing is to be saved, or if it could not be.
        """
        self._course = Course()
        if self._save is None:
            return None
        try:
            return self._save()
        except OSError as error:
            logger.error("the state could not be saved: %s", error)
            return None

    def saved(self) -> dict:
        """All that the rest of the run depends on, in nested dictionaries.

        Returns:
            By name numbers, texts, arrays that are the same for all processes, and `Rows`; a
            restarted run equals this one if it has the same scene and options.
        """
        model, by_cell = self.model, self.model.bulk.unknowns.by_cell
        saved = {
            "equations": self.equations,
            "step_number": self.step_number,
            "time": self.state.time,
            "last_size": self._last_size,
            "state": _forces_and_motion(self.state, by_cell),
            "bulk": model.bulk.saved(),
            "scheme": model.scheme.saved(),
            "ledger": model.ledger.saved(),
            "course": self._course.saved(),
        }
        if self._numbers_of_spread:
            saved["spread"] = 1
        if model.sweeps:
            saved["sweeps"] = 1
        if self.last is not None:
            saved["last"] = {
                "reactions": by_cell(self.last.reactions),
                "impulses": by_cell(self.last.impulses),
                "displacement_before": by_cell(self._before.displacement),
            }
        if hasattr(self.macroscopic, "hill_mandel"):
            saved["hill_mandel"] = self.macroscopic.hill_mandel
        for name, part in _parts(self):
            saved[name] = part.saved()
        if self._rigid_reactions is not None:
            saved["rigid_reactions"] = self._rigid_reactions
        if model.interactions is not None:
            saved["solvers"] = saved_memory(self.solver, model.interactions, model.ranks)
        if model.balance is not None and model.balance.is_pending:
            del saved["solvers"]  # they are of the partition that there was
        return saved

    @property
    def equations(self) -> str:
        """What a state is one of: others have other vectors, or other meanings of them."""
        options, bulk, scene = self.model.options, self.model.bulk, self.model.scene
        text = f"scheme={options.scheme!r}, theta={self.model.scheme.theta:g}, "
        text += f"inertia={options.inertia}, {len(scene.rigid)} rigid bodies"
        if scene.bodies is None:
            return text
        cells = int(bulk.ranks.sum(len(bulk.forms.bodies.parent_cell)))
        materials = {tag: type(m).__name__ for tag, m in sorted(scene.materials.items())}
        return f"{text}, {cells} cells of order {scene.order} and materials {materials}"

    @property
    def _numbers_of_spread(self) -> bool:
        """Whether cells have the numbers of a mesh that is spread over ranks."""
        bodies = self.model.scene.bodies
        return bodies is not None and bodies.spread is not None

    def saved_in_order(self) -> dict:
        """`saved` of all ranks, with arrays in the place of `Rows`: what `restore` takes."""
        # what is not divided by bodies is the same on all ranks
        alone = self.part is None or self.ranks.alone
        return _with_rows(self.saved(), Rows.in_order if alone else lambda r: self.ranks.gather(*r))

    def snapshot(self) -> Snapshot:
        """The present state, for another scene to go on from: `Scene(after=...)`.

        All ranks call it together. Time and energies go on, and those bodies and joints that are
        the same objects in both scenes, with the impulses and the history of contacts between them.
        Step, tolerance and all other options are those that the next simulation is given.
        """
        from xper_fx.scene.snapshot import Snapshot

        model = self.model
        return Snapshot(
            self._given, self.state.time, model.options.scheme, model.options.inertia,
            () if model.interactions is None else tuple(model.interactions.laws),
            None if model.joints is None else model.joints.rows, deepcopy(self.saved_in_order()),
        )  # fmt: skip

    def restore(self, saved: Mapping) -> None:
        """Go on where `saved` was taken, of the same scene.

        Args:
            saved: with the rows in order (`Rows.in_order`).

        Raises:
            ValueError: not what `saved` gave.
            CheckpointError: of other equations or unknowns; of a mesh that was spread over ranks
                where this one is not, or was not. Nothing is changed.
        """
        lacking = {"equations", "time", "step_number", "last_size", "ledger", "course"} - set(saved)
        if lacking:
            raise ValueError(
                f"What is restored is what `saved()` gave, and lacks {sorted(lacking)}."
            )
        if bool(saved.get("spread", 0)) != self._numbers_of_spread:
            now, then = ("", " not") if self._numbers_of_spread else (" not", "")
            raise CheckpointError(
                f"The state is of another scene: its mesh was{now} whole on each rank, and that of "
                f"this one is{then}. Ranks number the cells otherwise where the mesh is spread."
            )
        model = self.model
        implicit = self.equations.replace("scheme='explicit'", "scheme='implicit'")
        if model.begins_explicit and saved["equations"] == implicit:
            leave_explicit(model)
        if saved["equations"] != self.equations:
            raise CheckpointError(
                f"The state is of {saved['equations']}; this simulation is of {self.equations}. "
                "Restore it into one of the same scene, with the same scheme, theta and inertia."
            )
        with self.team.ending_all():
            self._take_up(saved)

    def _take_up(self, saved: Mapping) -> None:
        """Go on where `saved` was taken, of the same equations."""
        model = self._made_as(saved)
        from_cells = model.bulk.unknowns.from_cells
        state = saved.get("state", {})
        vectors = {
            name: state[name] if isinstance(state[name], float) else from_cells(state[name])
            for name in state
        }
        self.state = State(
            saved["time"],
            *(vectors.get(name, _NONE) for name in ("displacement", "velocity", "internal")),
            vectors.get("external", 0.0),
        )
        self.step_number, self._last_size = saved["step_number"], saved["last_size"]
        model.bulk.restore(saved.get("bulk", {}))
        picked = model.monolithic and model.options.may_leave_one_system
        if picked and "split" not in saved["interactions"]:
            model.leave_one_system()
        model.scheme.restore(saved.get("scheme", {}))
        model.ledger.restore(saved["ledger"])
        self._course = Course.restored(saved["course"])
        for name, part in _parts(self):
            if name in saved:
                part.restore(saved[name])
        if model.control is not None:
            self.tolerance = model.control.tolerance
        self._rigid_reactions = saved.get("rigid_reactions")
        if self.step_number:
            last = saved.get("last", {})
            before = from_cells(last.get("displacement_before", {}))
            self._before = replace(self.state, displacement=before)
            dofs = model.bulk.layout.prescribed_dofs
            supports = Supports(dofs, from_cells(last.get("reactions", {}))[dofs])
            self.last = StepOutcome(
                self.state, _NONE, from_cells(last.get("impulses", {})), supports,
                0.0, 0.0, 0, 0.0, 0.0, 0, 0.0, True,
            )  # fmt: skip
        if self.macroscopic is not None:
            self.macroscopic = self._macroscopic(None, None, self._last_size)
        if "hill_mandel" in saved:
            self.macroscopic = self.macroscopic._replace(hill_mandel=saved["hill_mandel"])
        interactions = model.interactions
        if interactions is None:
            return
        if model.scheme.holds(interactions.step_size):
            inverse = model.scheme.inverse(interactions.step_size, self.state.displacement)
            if interactions.bulk_inverse is not inverse.blocks:
                interactions.update_inverse(inverse.blocks)
        restore_memory(self.solver, interactions, model.ranks, saved.get("solvers", {}))

    def _made_as(self, saved: Mapping) -> Model:
        """The model, made again if `saved` is of one that has its bodies on other ranks, or sweeps.

        The latter is what `_sweep_on` makes of one.
        """
        model, attempts, scene = self.model, self._attempts, self.model.scene
        rank_of_body, balance = None, model.balance
        if balance is not None and "balance" in saved:
            rank_of_body = balance.other(saved["balance"])
        moves, sweeps = rank_of_body is not None, "sweeps" in saved
        if not moves and sweeps <= model.sweeps:
            return model
        if rank_of_body is None:
            rank_of_body = np.zeros(0, int) if balance is None else balance.rank_of_body
        if self._numbers_of_spread:
            own, rigid = np.split(rank_of_body, [self.bodies.num_bodies])
            if moves:
                from xper_fx.scene.moved_scene import moved_scene

                scene = moved_scene(scene, own)
            rank_of_body = np.concatenate([scene.bodies.spread.rank_of_body, rigid])
        options, watch = model.options, model.stopwatch
        self._take(Model(scene, options, self.team, watch, rank_of_body, sweeps))
        self._attempts.doubts = attempts.doubts
        return self.model

    def _rebalance(self) -> None:
        """Divide bodies among ranks as it was found better; all ranks call it together."""
        if self.model.balance is not None and self.model.balance.is_pending:
            with self.stopwatch.phase("balance of ranks"):
                self._make_again()

    def _sweep_on(self) -> bool:
        """Let sweeps over contacts and bonds take the place of turns, if that is possible and new.

        So they do from now on where turns of contacts and vertices end at no size of the step.
        """
        model = self.model
        if model.interactions is None or not (model.by_vertex and model.interactions.touches):
            return False
        if bonds_split(model.scene) or not (self.team.alone or model.balance is not None):
            return False
        if self.team.rank == 0:
            logger.warning(
                "step %d: contacts and vertices do not agree; sweeps go over all points from here "
                "on, which takes longer", self.step_number + 1,
            )  # fmt: skip
        self._make_again(sweeps=1)
        return True

    def _make_again(self, **changed: int) -> None:
        """Make the model again and take up the state, with something changed in it."""
        course = self._course
        if self._numbers_of_spread:
            from xper_fx.parallel.kept_rows import KeptRows

            saved = _with_rows(self.saved(), partial(KeptRows, self.ranks))
        else:
            saved = self.saved_in_order()
        if changed:
            saved.pop("solvers", None)  # they are others then; of bodies to divide none are saved
        self.restore(saved | changed)
        self._course = course


def _with_rows(tree: Mapping, taken: Callable[[Rows], Any]) -> dict:
    """A tree with something in the place of `Rows`."""
    out = {}
    for name, value in tree.items():
        if isinstance(value, Mapping):
            out[name] = _with_rows(value, taken)
        else:
            out[name] = taken(value) if isinstance(value, Rows) else value
    return out


def _forces_and_motion(state: State, by_cell: Callable) -> dict:
    """The vectors of a state, by name."""
    vectors = {n: by_cell(getattr(state, n)) for n in ("displacement", "velocity", "internal")}
    external = state.external
    return vectors | {"external": by_cell(external) if np.ndim(external) else float(external)}


def _parts(simulation: Restartable) -> list[tuple[str, object]]:
    """What there is of the parts that save themselves, in the order to restore them."""
    parts = [
        ("interactions", simulation.model.interactions), ("detection", simulation.model.detection),
        ("rigid", simulation.model.rigid), ("accuracy", simulation.model.control),
        ("path", simulation.path), ("balance", simulation.model.balance),
    ]  # fmt: skip
    return [(name, part) for name, part in parts if part is not None]
