# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The two-field periodic problem (Perales et al. 2008; 2010, section 3.2.1).

    u = (Fbar - I) X + u#,
    M d2u#/dt2 + f_int(u) = H r                     for every virtual fluctuation,
    (1/|Omega|) (int Pi dx - K / h) = Pibar         for the components driven by stress,

with K the impulse of couples on Fbar (`averages.py`), inertia acting on the fluctuation only, jumps
that are those of u# (across the cell's boundary too), and the macroscopic equations held at the end
of each step. For the unknowns of
`periodic_unknowns.py` these are the equations of any bulk,

    residual = -M (v - v0) + h [...],  with no mass and theta = 1 on the macroscopic unknowns,

so a driven component is a prescribed motion and its reaction is h |Omega| Pibar_ij.

Where ranks divide the bodies, every rank has the macroscopic unknowns and their whole equations
(`periodic_unknowns.py`), and takes the same decisions on them. In an inner product of all ranks,

    a . b = sum_r a_r . b_r (nodes) + a_G . b_G,

the first rank counts them. Where they have weights, those are sums over all bodies.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
import scipy.linalg

from xper_fx.bulk.bulk import Bulk
from xper_fx.bulk.force_balance import InBalance
from xper_fx.bulk.rigid_motions import joined_groups
from xper_fx.bulk.state import State
from xper_fx.forms.dynamics import BulkForms
from xper_fx.periodic.drive import MacroscopicDrive
from xper_fx.periodic.periodic_unknowns import CellUnknowns
from xper_fx.support.ranks import ALONE, Ranks

# Nearly incompressible: Poisson's ratio above which a volume change is refused.
_INCOMPRESSIBLE = 0.4999


class CellBulk(Bulk):
    """Mass, forces and macroscopic drive of a periodic cell.

    Args:
        forms: compiled forms.
        drive: what drives the cell.
        inertia: whether the fluctuation has inertia; see `Bulk`.
        joined: pairs of bodies between which interactions act; see `Bulk`.
        ranks: ranks that divide the cell's bodies; see `Bulk`.
        numbers: which of all bodies they are; see `Bulk`.

    Attributes:
        volume: |Omega| of the lattice, voids included, m^3 (2D: m^2).
        free: macroscopic unknowns that stresses determine, among the dim^2, shape (m,).
        largest_stress: largest component of Pibar at any committed time (Pa).
        borne: K / h of the committed step, column by column, shape (dim^2,), N m (2D: N).
    """

    unknowns: CellUnknowns

    def __init__(
        self,
        forms: BulkForms,
        drive: MacroscopicDrive,
        inertia: bool = True,
        joined: npt.ArrayLike = (),
        ranks: Ranks = ALONE,
        numbers: np.ndarray | None = None,
    ):
        self.drive = drive
        self.volume = abs(float(scipy.linalg.det(forms.bodies.lattice)))
        dim = forms.V.dofmap.index_map_bs
        self.free = np.flatnonzero(~drive.kinematic(dim))
        self.largest_stress, self.borne = 0.0, np.zeros(dim * dim)
        self._guess = np.zeros(dim * dim)
        self._guess_from = (-np.inf, np.zeros(dim * dim))
        self._compliance = np.zeros((len(self.free), len(self.free)))
        self._committed_compliance = self._compliance.copy()
        self._static = not inertia
        super().__init__(forms, inertia=inertia, joined=joined, ranks=ranks, numbers=numbers)
        self.num_common = dim * dim
        self._refuse_pressing_the_incompressible()
        self._rounding = self._forces_of_rounding() if len(self.free) else 0.0

    def _forces_of_rounding(self) -> float:
        """Forces of a macroscopic strain of 1e-14 at rest, N m (2D: N)."""
        fields = self.unknowns.fields(self.free)
        at_rest = self.tangent(np.zeros(self.num_dofs)).to_scipy()
        return 1e-14 * float(np.abs(self.ranks.sum(fields.T @ (at_rest @ fields))).max())

    def _make_unknowns(self):
        return CellUnknowns(self.forms.V, self.forms.bodies, self.ranks)

    def _prescribed(self) -> np.ndarray:
        out = np.zeros(self.num_dofs, bool)
        out[self.unknowns.macroscopic] = self.drive.kinematic(self.dim)
        if self._static and self._is_first:
            out[: self.dim] = True  # the translation of u#, which nothing else holds
        return out

    @property
    def _is_first(self) -> bool:
        """Whether this rank is the first one with bodies; all ranks ask together."""
        rank, size = self.ranks.rank, self.ranks.size
        return self.ranks.max(size - rank if self.unknowns.num_nodes else 0) == size - rank

    def _held_by_interactions(self, joined: np.ndarray) -> bool:
        """See `Bulk`: one body, or bodies joined to one; the translation is held here.

        The rotations of one body are held by ties.

        A rotation of u# about an axis is the same at two tied nodes only if the vector between
        them is along the axis.
        """
        unknowns = self.unknowns
        num_bodies = int(self.ranks.sum(len(unknowns.offsets) - 1))
        if num_bodies > 1:
            numbers = np.arange(num_bodies) if self.numbers is None else self.numbers
            _, shared, here = joined_groups(joined, numbers, self.ranks)
            if shared + self.ranks.sum(here - shared) == 1:
                return True
            raise ValueError(
                f"Without inertia every body should be held, and the cell has {num_bodies} bodies, "
                "which interactions do not join to one: take one body (a label for all cells), "
                "laws on all facets between bodies, or inertia=True."
            )
        first = np.empty((unknowns.num_nodes, self.dim))
        first[unknowns.node_of] = unknowns.position
        apart = unknowns.position - first[unknowns.node_of]
        ways = self.dim  # of ranks without the body
        if len(apart):
            size = np.ptp(unknowns.position, axis=0).max()
            ways = np.linalg.matrix_rank(apart / size, tol=1e-6)
        if not self.ranks.all(ways >= self.dim - 1):
            raise ValueError(
                "Without inertia the cell's body should be tied to itself across the boundary in "
                f"{self.dim - 1} direction(s) at least, or it is free to turn: take inertia=True."
            )
        return False

    def _nodal_mass(self) -> np.ndarray:
        """Mass of each unknown; for the norm, a macroscopic one moves all nodes by X."""
        of_nodes = super()._nodal_mass()
        on_nodes = np.bincount(self.unknowns.node_of, of_nodes)
        macroscopic = self.ranks.sum(of_nodes @ self.unknowns.position**2)
        return np.concatenate([on_nodes, macroscopic])

    def _mass(self) -> np.ndarray:
        """See `Bulk`: none on the macroscopic unknowns."""
        mass = self.weights.copy()
        mass[self.unknowns.macroscopic] = 0.0
        return mass

    def _refuse_pressing_the_incompressible(self) -> None:
        held = self.drive.kinematic(self.dim).reshape(self.dim, self.dim).diagonal()
        still = all(self.drive.gradient.get(2 * str(i + 1)) == 1.0 for i in range(self.dim))
        stiff = [
            np.max(getattr(m, "poisson", 0.0)) > _INCOMPRESSIBLE
            for m in self.forms.materials.values()
        ]
        if all(stiff) and np.all(held) and not still:
            raise ValueError(
                f"All of F11, F22{', F33' if self.dim == 3 else ''} are driven by Fbar and all "
                f"materials are nearly incompressible (Poisson's ratio above {_INCOMPRESSIBLE}): "
                "their pressure is not determined. Drive one of them by `stress`."
            )

    def macroscopic_gradient(self, displacement: np.ndarray) -> np.ndarray:
        """Fbar, shape (dim, dim)."""
        columns = displacement[self.unknowns.macroscopic].reshape(self.dim, self.dim)
        return np.eye(self.dim) + columns.T

    def macroscopic_motion(self, displacement, velocity) -> tuple[np.ndarray, ...]:
        """See `Bulk`."""
        rate = self.macroscopic_gradient(velocity) - np.eye(self.dim)
        return self.macroscopic_gradient(displacement), rate

    def macroscopic_stress(self, internal: np.ndarray) -> np.ndarray:
        """Pibar = (int Pi dx - K / h) / |Omega| of the committed step, shape (dim, dim), Pa."""
        stresses = internal[self.unknowns.macroscopic] - self.borne
        return stresses.reshape(self.dim, self.dim).T / self.volume

    def external(self, time: float) -> np.ndarray:
        """See `Bulk`: |Omega| Pibar on the components driven by stress."""
        out = np.zeros(self.num_dofs)
        out[self.unknowns.macroscopic] = self.volume * self.drive.stresses(self.dim, time)
        return out

    def prescribe(
        self, velocity, time, step, theta, displacement0, velocity0, elapsed=None
    ) -> None:
        """See `Bulk`: rates of the components driven by Fbar, a guess for the others.

        At theta = 1/2 what rings changes its sign from a step to the next, so the rate of the
        step before last is a better guess than the last.
        """
        part = self.unknowns.macroscopic
        if time - step > self._guess_from[0]:
            self._guess, self._guess_from = (
                self._guess_from[1],
                (time - step, velocity0[part].copy()),
            )
        rates = self.drive.rates(self.dim, displacement0[part], time, step, elapsed)
        velocity[part] = np.where(self.drive.kinematic(self.dim), rates, self._guess)

    def commit(self, state: State, impulses: np.ndarray, step: float) -> None:
        """See `Bulk`; the stresses reached and the compliance learnt are remembered."""
        super().commit(state, impulses, step)
        self.borne = impulses[self.unknowns.macroscopic] / step
        self._committed_compliance = self._compliance.copy()
        stress = np.abs(self.macroscopic_stress(state.internal)).max()
        self.largest_stress = max(self.largest_stress, float(stress))

    def forget(self) -> None:
        """See `Bulk`."""
        self._compliance[:] = self._committed_compliance

    def with_border(self, inverse, stiffness, step, theta, interacting):
        """See `Bulk`: bordered by the components of G that stresses determine."""
        if not len(self.free):
            return inverse
        from xper_fx.periodic.bordered import BorderedInverse

        compliance = self._compliance if interacting else None
        return BorderedInverse(
            inverse, self.unknowns, self.free, stiffness, step, theta, compliance, self.ranks
        )

    def own_dot(self, a: np.ndarray, b: np.ndarray) -> float:
        """See `Bulk`: what every rank has is counted by the first."""
        counted = slice(None) if self.ranks.rank == 0 else slice(0, self.unknowns.macroscopic.start)
        return float(a[counted] @ b[counted])

    @property
    def num_dofs_of_all(self) -> int:
        """See `Bulk`."""
        nodal = self.unknowns.macroscopic.start
        return int(self.ranks.sum(nodal)) + self.num_dofs - nodal

    def end_weight(self, theta: float) -> np.ndarray:
        """See `Bulk`: macroscopic equations hold at the end of the step."""
        out = np.full(self.num_dofs, theta)
        out[self.unknowns.macroscopic] = 1.0
        return out

    def balance(self, tolerance: float) -> InBalance:
        """See `Bulk`: of the stresses given."""
        if not len(self.free):
            return InBalance()
        from xper_fx.periodic.stress_balance import StressBalance

        return StressBalance(self, tolerance)

    def imbalance(self, residual: np.ndarray, internal: np.ndarray, step: float) -> float:
        """Error of the stresses given by a step's residual, relative to the run's largest Pibar.

        A cell that has broken bears nothing, so that what it bore is what errors compare with.
        """
        part = self.unknowns.macroscopic
        missing = np.abs(residual[part][self.free]).max() / step
        largest = max(np.abs(internal[part]).max(), self.volume * self.largest_stress)
        if missing <= max(self._rounding, np.finfo(float).eps * largest):
            return 0.0
        return missing / largest if largest > 0.0 else np.inf

    def saved(self) -> dict:
        """See `Bulk`; what the cell has learnt of its macroscopic answer besides."""
        return super().saved() | {
            "largest_stress": self.largest_stress,
            "guess": self._guess,
            "guess_time": self._guess_from[0],
            "guess_rates": self._guess_from[1],
            "borne": self.borne,
            "compliance": self._compliance.copy(),
            "committed_compliance": self._committed_compliance,
        }

    def restore(self, saved: Mapping) -> None:
        """See `Bulk`."""
        super().restore(saved)
        self.largest_stress = saved["largest_stress"]
        self.borne = saved["borne"]
        self._guess = saved["guess"]
        self._guess_from = saved["guess_time"], saved["guess_rates"]
        self._compliance[:] = saved["compliance"]  # inverses hold this array
        self._committed_compliance = saved["committed_compliance"]
