# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Theta scheme with Newton (Perales et al. 2010, eqs 8-11).

With theta in [1/2, 1] and F = f_ext - f_int(q) - C v,

    M (v1 - v0) = h [theta F1 + (1 - theta) F0] + H r,   q1 = q0 + h [theta v1 + (1 - theta) v0],
    Mt = M + h theta C + h^2 theta^2 K,                  w = Mt^-1 on the dofs not prescribed,
    res^k = -M (v^k - v0) + h [(1 - theta) F0 + theta F^k],
    v_free = v^k + w res^k,                              v^{k+1} = v_free + w H r.

A linear bulk is done after one iteration, and Mt is formed and inverted once for each step size.
Bodies without inertia that interactions alone hold stand on springs that let go after each
iteration (`floating_bodies.py`), of which there are then a few.
Otherwise w is kept as long as Newton contracts well with it, and renewed when it does not.

Some unknowns may have another theta (`Bulk.end_weight`): those of a periodic cell that no mass
belongs to hold their equations at the end of the step.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from xper_fx.bulk.body_inverse import CellwiseInverse, ClusterInverse
from xper_fx.bulk.bulk import Bulk
from xper_fx.bulk.state import State, StepOutcome, interact, reactions_on
from xper_fx.bulk.step_equations import StepEquations
from xper_fx.forms.dynamics import BulkForms
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.solvers.solver import SolveOptions, Solver
from xper_fx.support.profile import Stopwatch
from xper_fx.support.saved_rows import Rows

# Contraction of Newton's corrections above which w is renewed, unless no more than a few iterations
# are left to make, which cost less.
_SLOW, _FEW = 0.2, 3
# Times that a Newton step is halved before the time step is given up.
_CUTS = 5
# Newton's correction of the positions, relative to the size of the scene, that is rounding.
_ROUNDING = 1e-14
# Newton's tolerance is at least this part of that of the impulses, which blurs it.
_BLUR = 1e-2
# h^2 theta^2 K over the mass above which less than three digits are left of the mass.
_HIDDEN = 1e13
# Inverses kept for a linear bulk: the step and its halves.
_KEPT = 4


class _Origin(NamedTuple):
    """What the matrix of a kept inverse was assembled at: all it takes to make it again."""

    displacement: np.ndarray
    history: np.ndarray | None
    form_step: float

    @classmethod
    def of(cls, forms: BulkForms, displacement: np.ndarray) -> _Origin:
        """At the forms' present step and history."""
        form_step = 0.0 if forms.step is None else float(forms.step.value)
        return cls(displacement, forms.history_by_cell(), form_step)


class ImplicitScheme:
    """Theta scheme of the bulk.

    Args:
        bulk: the bulk.
        interacting: nodes at which interactions act.
        theta: weight of the end of the step, in [1/2, 1].
        newton_tolerance: bound on the last Newton correction of the velocities, relative to the
            velocities, in the norm of the mass; with interactions it is at least a hundredth of
            their tolerance, which blurs it.
        max_newton: iterations after which a step is given up.
        stopwatch: where phases are timed.
    """

    def __init__(
        self,
        bulk: Bulk,
        interacting: np.ndarray,
        theta: float,
        newton_tolerance: float,
        max_newton: int,
        stopwatch: Stopwatch,
    ):
        self.bulk, self.theta = bulk, theta
        self._end_weight = bulk.end_weight(theta)
        self._interacting = interacting
        self._interacts = bulk.ranks.max(len(interacting)) > 0
        self._newton_tolerance, self._max_newton = newton_tolerance, max_newton
        self._tolerance = newton_tolerance
        self._stopwatch = stopwatch
        x = bulk.forms.bodies.mesh.geometry.x
        low, high = -bulk.ranks.max(-x.min(axis=0)), bulk.ranks.max(x.max(axis=0))
        self._rounding = _ROUNDING * bulk.norm(np.full(bulk.num_dofs, (high - low).max()))
        self._inverses: dict[float, CellwiseInverse | ClusterInverse] = {}
        self._made_at: dict[float, _Origin] = {}
        stopwatch.owns("inverse", lambda: self.nbytes)

    def inverse(self, step: float, displacement: np.ndarray, renew: bool = False):
        """The inverse for a step size; for a bulk that is not linear, near `displacement`."""
        if step in self._inverses and not renew:
            return self._inverses[step]
        with self._stopwatch.phase("inverse"):
            bulk, layout = self.bulk, self.bulk.layout
            if bulk.floating:
                from xper_fx.bulk.floating_bodies import AnchoredInverse

                x = bulk.forms.V.tabulate_dof_coordinates()[:, : bulk.dim]
                inverse = AnchoredInverse(layout, x, self._interacting)
            elif layout.uniform:
                inverse = CellwiseInverse(layout)
            else:
                inverse = ClusterInverse(layout, self._interacting)
            stiffness = bulk.stiffness if bulk.linear else bulk.tangent(displacement)
            matrix = self._iteration_matrix(step, stiffness, checked=not renew)
            self._factor(inverse, matrix, renew)
            inverse = bulk.with_border(inverse, stiffness, step, self.theta, self._interacts)
            if step not in self._inverses and len(self._inverses) >= _KEPT:
                self._drop(next(iter(self._inverses)))
            self._inverses[step] = inverse
            if not bulk.linear:
                self._made_at[step] = _Origin.of(bulk.forms, displacement)
        return inverse

    def _factor(self, inverse, matrix: sp.bsr_array, renew: bool) -> None:
        """Factor the iteration matrix; of an iterate that ran away it may be singular.

        Raises:
            FloatingPointError: so it is, on some rank.
        """
        singular = None
        try:
            inverse.factor(matrix)
        except (np.linalg.LinAlgError, RuntimeError) as error:
            if not renew:
                raise
            singular = error
        if renew and self.bulk.ranks.max(singular is not None):
            raise FloatingPointError(f"the iteration matrix is singular: {singular}")

    def _drop(self, step: float) -> None:
        """Forget the inverse for a step size."""
        self._inverses.pop(step, None)
        self._made_at.pop(step, None)

    def _iteration_matrix(
        self, step: float, stiffness: sp.bsr_array, checked: bool
    ) -> sp.bsr_array:
        bulk, scaled = self.bulk, step * self.theta
        matrix = bulk.unknowns.condense(stiffness).copy()
        matrix.data *= scaled**2
        if bulk.damping is not None:
            bulk.damping.add_to(matrix, scaled)
        if bulk.inertia is None:
            return matrix
        mass = bulk.mass[: matrix.shape[0]]
        if bulk.damping is not None:
            mass = mass * bulk.damping.mass_factor(scaled)
        # block rows are sorted: the diagonal block of row r is where its column is r
        rows = np.repeat(np.arange(len(matrix.indptr) - 1), np.diff(matrix.indptr))
        diagonal = np.flatnonzero(matrix.indices == rows)
        axes = np.arange(bulk.dim)
        stiff = matrix.data[diagonal[:, None], axes, axes].reshape(-1)
        if checked:
            self._require_mass_that_counts(stiff, mass, step)
        matrix.data[diagonal[:, None], axes, axes] += mass.reshape(-1, bulk.dim)
        return matrix

    def _require_mass_that_counts(self, stiff, mass, step) -> None:
        """Raise a ValueError if rounding of h^2 theta^2 K hides the mass of a free body."""
        carried = mass > 0.0
        ratio = float((stiff[carried] / mass[carried]).max(initial=0.0))
        if ratio > _HIDDEN and np.any(self.bulk.free_motions()):
            raise ValueError(
                f"At the step {step:g} s, h^2 K exceeds the mass {ratio:.0e} times, and rounding "
                "hides the inertia of bodies that nothing holds: their velocities would mean "
                "nothing. Take a smaller step, or hold the bodies and take inertia=False."
            )

    def attempt(
        self,
        state: State,
        step: float,
        interactions: Interactions | None,
        solver: Solver,
        options: SolveOptions,
    ) -> StepOutcome:
        """One step from `state`, which is not changed.

        Args:
            state: state at the start of the step.
            step: h (s).
            interactions: the points, None if the scene has none.
            solver: solver of the interactions.
            options: of the solver; its tolerance is what equations that hang on the impulses
                (`Bulk.balance`) can hold to.

        Returns:
            The outcome, converged or not.
        """
        bulk, theta, watch = self.bulk, self._end_weight, self._stopwatch
        time = state.time + step
        q0, v0 = state.displacement, state.velocity
        bulk.forms.set_step(step)
        with watch.phase("free velocity"):
            external = bulk.external(time)
            equations = StepEquations(bulk, state, step, theta)
            equations.load(external)
            velocity = v0.copy()
            bulk.prescribe(velocity, time, step, self.theta, q0, v0)
        inverse = self.inverse(step, q0)
        if interactions is not None:
            with watch.phase("interaction terms"):
                if interactions.bulk_inverse is not inverse.blocks:
                    interactions.update_inverse(inverse.blocks)
                turns = interactions.turns
                if turns:
                    from xper_fx.bulk.turning import couples_on, turn

                    turn(interactions, bulk, inverse.nodes, state, v0, step, self.theta)
                interactions.begin_step(step, self.theta)

        with watch.phase("free velocity"):
            residual, internal = equations.residual(velocity)
        sweeps, error, traction, converged = 0, 0.0, 0.0, True
        impulses, slots = np.zeros_like(v0), np.zeros(0)
        newton_before, newton = np.inf, 0.0
        bare = interactions is None
        exact = bulk.linear and not bulk.floating
        self._tolerance = self._newton_tolerance
        if not bare:
            self._tolerance = max(self._newton_tolerance, _BLUR * options.tolerance)
        balance = bulk.balance(self._tolerance if bare else options.tolerance)
        for iteration in watch.each("newton", range(1, self._max_newton + 1)):  # noqa: B007 - reported
            with watch.phase("free velocity"):
                corrected = balance.missing
                advance = inverse.advance if bare or corrected else inverse.apply
                if not bare and turns:
                    couples = couples_on(interactions, inverse.nodes, len(residual))
                    residual = residual + couples
                free = velocity + advance(residual)
            if bare:
                new = free
            else:
                if iteration > 1:  # what an earlier iterate damaged is whole again
                    with watch.phase("interaction terms"):
                        if turns:
                            mean = theta * velocity + (1.0 - theta) * v0
                            turn(interactions, bulk, inverse.nodes, state, mean, step, self.theta)
                        interactions.prepare()
                if bulk.floating:
                    interactions.take_anchors(inverse.anchors(residual))
                with watch.phase("interaction solve"):
                    new, impulses, slots, report = interact(
                        inverse, interactions, solver, free, options
                    )
                if turns:
                    impulses += couples
                sweeps += report.sweeps
                error, traction = report.residual, report.traction_change
                converged = report.converged
            previous, velocity = velocity, new
            with watch.phase("free velocity"):
                residual, internal = equations.residual(velocity)
                balance.assess(inverse, velocity, previous, residual, internal, step, newton)
            if not converged or (exact and balance.settled):
                break
            if exact:
                continue
            # For the impulses found, what is left is the bulk's nonlinearity, or what springs of
            # floating bodies bear. A step that inverts a cell (no finite energy) or leaves more
            # than it found is cut.
            if corrected and not bare:
                newton_before = np.inf  # what other unknowns stir up is no step that went wrong
            with watch.phase("free velocity"):
                # without interactions all unknowns are corrected at once
                solve = inverse.advance if bare else inverse.apply
                displacement = equations.displacement(velocity)
                newton = self._correction(solve, residual + impulses, velocity, displacement, step)
                for _ in range(_CUTS):
                    if np.isfinite(newton) and newton <= 2.0 * newton_before:
                        break
                    velocity = 0.5 * (velocity + previous)
                    residual, internal = equations.residual(velocity)
                    displacement = equations.displacement(velocity)
                    # the impulses belong to the whole step: this is not yet the end
                    left = self._correction(
                        solve, residual + impulses, velocity, displacement, step
                    )
                    newton = max(left, 2.0 * self._tolerance)
            if not np.isfinite(newton):
                break
            if newton <= self._tolerance and balance.settled:
                break
            slow = newton > _SLOW * newton_before and self._left(newton, newton_before) > _FEW
            if balance.worse or (slow and not bulk.linear):
                inverse = self.inverse(step, displacement, renew=True)
                if not bare:
                    with watch.phase("interaction terms"):
                        interactions.update_inverse(inverse.blocks)
            newton_before = newton
        converged = bulk.ranks.all(
            converged
            and newton <= self._tolerance
            and balance.settled
            and np.all(np.isfinite(velocity))
            and np.all(np.isfinite(internal))
        )
        if not converged:  # matrix and what was learnt may be those of a state gone astray
            bulk.forget()
            if not bulk.linear:
                self._drop(step)
        reactions = reactions_on(bulk.layout, lambda d: -(residual[d] + impulses[d]))
        end = State(time, equations.displacement(velocity), velocity, internal, external)
        mean_velocity = theta * velocity + (1.0 - theta) * v0
        return StepOutcome(
            end, slots, impulses, reactions, equations.force_impulse, bulk.viscous(mean_velocity),
            sweeps, error, traction, iteration, max(newton, balance.error), converged,
        )  # fmt: skip

    def _left(self, newton: float, before: float) -> float:
        """Iterations left if corrections go on to contract as they did."""
        if newton <= self._tolerance:
            return 0.0
        if newton >= before:
            return np.inf
        return np.log(self._tolerance / newton) / np.log(newton / before)

    def _correction(self, solve, residual, velocity, displacement, step) -> float:
        """Newton's next correction relative to the velocities; infinite if it is not finite."""
        correction = self.bulk.norm(solve(residual))
        # towards rest velocities vanish, and the rounding of positions is what is left
        rounding = self._rounding
        if self.bulk.floating:
            from xper_fx.bulk.floating_bodies import ROUNDING

            rounding = max(rounding, ROUNDING * self.bulk.norm(displacement))
        if correction <= rounding / (step * self.theta):
            return 0.0
        relative = correction / self.bulk.norm(velocity)
        return relative if np.isfinite(relative) else np.inf

    @property
    def nbytes(self) -> int:
        """Memory held by inverses, in bytes."""
        return sum(i.nbytes for i in self._inverses.values())

    def holds(self, step: float) -> bool:
        """Whether `inverse` gives the one that a run had for a step size: kept, or always alike."""
        return step in self._inverses or (self.bulk.linear and step > 0.0)

    def saved(self) -> dict:
        """At what the kept inverses of a bulk that is not linear were made, oldest first.

        A linear bulk has the same inverse for a step size whenever it is made.
        """
        out, unknowns = {}, self.bulk.unknowns
        for place, (step, origin) in enumerate(self._made_at.items()):
            out[str(place)] = unknowns.by_cell(origin.displacement) | {
                "step": step,
                "form_step": origin.form_step,
            }
            if origin.history is not None:
                cells = self.bulk.forms.bodies.parent_cell
                out[str(place)]["history"] = Rows(cells, origin.history)
        return out

    def restore(self, saved: Mapping) -> None:
        """Make the inverses that `saved` told of; the history of the bulk stays as it is."""
        forms = self.bulk.forms
        if self.bulk.linear:
            return
        self._inverses.clear()
        self._made_at.clear()
        present = forms.history_by_cell()
        for place in sorted(saved, key=int):
            kept = saved[place]
            if forms.has_history:
                forms.restore_by_cell(kept["history"][forms.bodies.parent_cell])
            forms.set_step(kept["form_step"])
            # renewed: at an iterate cells may have been stiffer than a new run's step is let be
            self.inverse(kept["step"], self.bulk.unknowns.from_cells(kept), renew=True)
        forms.restore_by_cell(present)
