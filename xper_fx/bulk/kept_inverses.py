# SPDX-License-Identifier: LGPL-3.0-or-later
"""The inverses w of the iteration matrix that an implicit bulk keeps, one for each step size.

A linear bulk has the same one whenever it is made, and keeps those of the step and of its halves.
That of another bulk hangs on the state at which it was made, which a checkpoint therefore holds.

Without inertia, damping, rates and interactions the matrix is h^2 theta^2 K: one inverse, made at
whatever step size, is that of all others but for a factor.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import NamedTuple

import numpy as np

from xper_fx.bulk.body_inverse import CellwiseInverse, ClusterInverse
from xper_fx.bulk.bulk import Bulk
from xper_fx.bulk.sparse_blocks import BlockMatrix
from xper_fx.forms.dynamics import BulkForms
from xper_fx.support.profile import Stopwatch
from xper_fx.support.saved_rows import Rows

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


class _ScaledInverse:
    """A multiple of an inverse of bodies without interactions; see `xper_fx.bulk.body_inverse`."""

    def __init__(self, inverse, factor: float):
        self._inverse, self._factor = inverse, factor

    def advance(self, residual: np.ndarray) -> np.ndarray:
        """Newton's increment of all velocities, shape (num_dofs,)."""
        return self._factor * self._inverse.advance(residual)

    def learn(self, velocity: np.ndarray, residual: np.ndarray, trusted: bool) -> None:
        """Nothing, as no interactions answer."""

    def unlearn(self) -> None:
        """Nothing, as nothing was learnt."""


class KeptInverses:
    """Inverses by step size.

    Args:
        interacting: nodes at which interactions act.
        theta: weight of the end of the step, in [1/2, 1].
        stopwatch: where phases are timed.
    """

    def __init__(self, bulk: Bulk, interacting: np.ndarray, theta: float, stopwatch: Stopwatch):
        self.bulk, self.theta, self._stopwatch = bulk, theta, stopwatch
        self._interacting = interacting
        self._interacts = bulk.ranks.max(len(interacting)) > 0
        alike = bulk.inertia is None and bulk.damping is None and not bulk.forms.viscous
        self._scales = alike and not self._interacts
        self._inverses: dict[float, CellwiseInverse | ClusterInverse] = {}
        self._made_at: dict[float, _Origin] = {}
        stopwatch.owns("inverse", lambda: self.nbytes)

    def at(self, step: float, displacement: np.ndarray, renew: bool = False):
        """The inverse for a step size; for a bulk that is not linear, near `displacement`."""
        if step in self._inverses and not renew:
            return self._inverses[step]
        if self._scales and self._inverses:
            if not renew:
                [(made, inverse)] = self._inverses.items()
                return _ScaledInverse(inverse, (made / step) ** 2)
            self.drop(step)
        with self._stopwatch.phase("inverse"):
            bulk, layout = self.bulk, self.bulk.layout
            if bulk.floating:
                from xper_fx.bulk.floating_bodies import AnchoredInverse

                x = bulk.forms.V.tabulate_dof_coordinates()[:, : bulk.dim]
                anchored = partial(AnchoredInverse, layout, x, self._interacting, bulk.numbers)
                inverse = bulk.ranks.together(anchored)
            elif layout.uniform:
                inverse = CellwiseInverse(layout)
            else:
                inverse = ClusterInverse(layout, self._interacting)
            stiffness = bulk.stiffness if bulk.linear else bulk.tangent(displacement)
            matrix = self._iteration_matrix(step, stiffness, checked=not renew)
            self._factor(inverse, matrix, renew)
            inverse = bulk.with_border(inverse, stiffness, step, self.theta, self._interacts)
            if step not in self._inverses and len(self._inverses) >= _KEPT:
                self.drop(next(iter(self._inverses)))
            self._inverses[step] = inverse
            if not bulk.linear:
                self._made_at[step] = _Origin.of(bulk.forms, displacement)
        return inverse

    def _factor(self, inverse, matrix: BlockMatrix, renew: bool) -> None:
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

    def drop(self, step: float) -> None:
        """Forget the inverse for a step size."""
        for kept in list(self._inverses) if self._scales else [step]:
            self._inverses.pop(kept, None)
            self._made_at.pop(kept, None)

    def _iteration_matrix(self, step: float, stiffness: BlockMatrix, checked: bool) -> BlockMatrix:
        bulk, scaled = self.bulk, step * self.theta
        matrix = bulk.unknowns.condense(stiffness).copy()
        matrix.data[:] *= scaled**2
        if bulk.damping is not None:
            bulk.damping.add_to(matrix, scaled)
        if bulk.inertia is None:
            return matrix
        mass = bulk.mass[: matrix.size]
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

    @property
    def nbytes(self) -> int:
        """Memory held by inverses, in bytes."""
        return sum(i.nbytes for i in self._inverses.values())

    def holds(self, step: float) -> bool:
        """Whether `at` gives the one that a run had for a step size: kept, or always alike."""
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
            self.at(kept["step"], self.bulk.unknowns.from_cells(kept), renew=True)
        forms.restore_by_cell(present)
