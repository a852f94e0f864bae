# SPDX-License-Identifier: LGPL-3.0-or-later
"""The bulk as vectors: mass, internal, external and viscous forces, prescribed motions, energies.

Everything is in the numbering of `unknowns.py`. A linear bulk assembles its stiffness once and
never calls the forms again. In explicit runs its forces are had cell by cell where that serves
(`cell_forces.py`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import basix
import numpy as np
import numpy.typing as npt
from dolfinx import fem

from xper_fx.bodies.meshes import cell_measure
from xper_fx.bulk.body_dofs import BodyLayout
from xper_fx.bulk.force_balance import InBalance
from xper_fx.bulk.rigid_motions import free_rigid_motions, loose_bodies
from xper_fx.bulk.sparse_blocks import BlockMatrix, multiply
from xper_fx.bulk.state import State
from xper_fx.bulk.unknowns import NodalUnknowns
from xper_fx.forms.dynamics import BulkForms
from xper_fx.forms.loads import (
    PrescribedDisplacement,
    PrescribedVelocity,
    RayleighDamping,
    nodes_that_move,
    value_at,
)
from xper_fx.support.compat import geometry_dofmap
from xper_fx.support.ranks import ALONE, Ranks
from xper_fx.support.saved_rows import Rows

# Masses and stiffnesses are kept as far from the limits of floats as their squares need.
_SMALL = 1e-150
# Rounding of an elastic energy, relative to that which the stiffest vibration would have.
_ROUNDING = 1e-13


class Bulk:
    """Mass, forces and prescribed motions of all bodies.

    Args:
        forms: compiled forms.
        motions: prescribed velocities and displacements, which do not contradict each other.
        damping: viscous damping, None for none.
        inertia: False for a static bulk, without mass. Nothing takes its place: K is not
            regularised, so that what is prescribed must hold every body, or every group of bodies
            that interactions join.
        joined: pairs of bodies between which interactions act, shape (n, 2), at least all that
            this rank's are in.
        ranks: ranks that divide the bodies; vectors are this rank's, sums those of all.
        numbers: shape (num_bodies,), which of the bodies of all ranks this rank's are; None where
            it has all.
        leaning: which bodies contacts with walls, or such that are searched, may hold.

    Attributes:
        unknowns: what the unknowns are.
        floating: whether there are bodies without inertia that interactions alone hold.
        numbers: as given.
        inertia, damping: None where there is none.
        weights: lumped mass a dof, which gives the norm of velocities with inertia or without,
            shape (num_dofs,), kg (2D: kg/m).
        layout: nodes body by body, prescribed dofs.
        stiffness: K of a linear bulk, or at rest for damping, on the nodes of V; None without use.
        by_cell: forces of bodies that are linear simplices, if asked for; else None.
        num_common: how many of the last unknowns all ranks have, with the same values.

    Raises:
        ValueError: no inertia, and a body or a group of joined bodies that nothing holds.
    """

    def __init__(
        self,
        forms: BulkForms,
        motions: Sequence[PrescribedVelocity | PrescribedDisplacement] = (),
        damping: RayleighDamping | None = None,
        inertia: bool = True,
        joined: npt.ArrayLike = (),
        ranks: Ranks = ALONE,
        numbers: np.ndarray | None = None,
        leaning: npt.ArrayLike = (),
    ):
        self.forms, self.ranks, self.numbers = forms, ranks, numbers
        self._leaning = np.asarray(leaning, int)
        self.num_common = 0
        self.linear = forms.linear
        self.dim = forms.V.dofmap.index_map_bs
        self.unknowns = self._make_unknowns()
        self.num_dofs = self.unknowns.num_dofs
        self._motions = [(self._motion_dofs(m), m) for m in motions]
        self.layout = BodyLayout(
            self.unknowns.nodes, self.unknowns.offsets, self.dim, self._prescribed()
        )
        self.weights = np.repeat(self._nodal_mass(), self.dim)
        self._check_range("nodal masses", self.weights, "densities", _SMALL)
        self.inertia, self.floating = None, False
        if inertia:
            from xper_fx.bulk.inertia import Inertia

            self.inertia = Inertia(self._mass())
        else:
            self.floating = self._held_by_interactions(np.reshape(joined, (-1, 2)).astype(int))
        self._matrix, self.by_cell, self._critical_step = None, None, 0.0
        damps_stiffness = damping is not None and damping.stiffness > 0.0
        self.stiffness = None
        if self.linear or damps_stiffness:
            self.stiffness = self.tangent(np.zeros(self.num_dofs))
            self._matrix = None  # a linear bulk never assembles again; others want an array anew
            self._check_range("stiffnesses", np.abs(self.stiffness.data), "elastic constants")
        self.damping = None
        if damping is not None:
            from xper_fx.bulk.damping import ViscousDamping

            self.damping = ViscousDamping(
                damping, self.mass, self.stiffness if damps_stiffness else None
            )
        self._external = None
        if forms.external is not None and forms.steady:
            self._external = forms.assemble_external(0.0)

    @staticmethod
    def _check_range(name: str, values: np.ndarray, given: str, least: float = 0.0) -> None:
        """Raise a ValueError unless numbers are above `least` and their squares finite."""
        if not (values.min(initial=1.0) >= least and values.max(initial=0.0) < 1.0 / _SMALL):
            raise ValueError(
                f"The {name} are {values.min():g} to {values.max():g}, beyond the range of floats: "
                f"look at the {given}, at the size of the mesh, and at the units."
            )

    def _make_unknowns(self) -> NodalUnknowns:
        return NodalUnknowns(self.forms.V, self.forms.bodies)

    def _prescribed(self) -> np.ndarray:
        prescribed = np.zeros(self.num_dofs, bool)
        for dofs, _ in self._motions:
            prescribed[dofs] = True
        return prescribed

    def free_motions(self) -> np.ndarray:
        """In how many ways each body is free to move as a whole, shape (num_bodies,)."""
        x, held = self.nodes_of_bodies()
        return free_rigid_motions(x, self.layout.offsets, held)

    def nodes_of_bodies(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions and prescribed components of the nodes, body by body, (num_nodes, dim) both."""
        layout = self.layout
        x = self.forms.V.tabulate_dof_coordinates()[layout.nodes, : self.dim]
        return x, layout.prescribed[layout.dofs(layout.nodes)].reshape(x.shape)

    def loose_bodies(self, joined: np.ndarray) -> tuple[np.ndarray, int, np.ndarray]:
        """As `rigid_motions.loose_bodies`, for pairs of bodies, shape (n, 2)."""
        x, held = self.nodes_of_bodies()
        sizes = np.diff(self.layout.offsets)
        held[np.repeat(np.isin(np.arange(len(sizes)), self._leaning), sizes)] = True
        return loose_bodies(x, sizes, held, joined, self.numbers, self.ranks)

    def _held_by_interactions(self, joined: np.ndarray) -> bool:
        """Whether interactions hold bodies that nothing else does.

        Args:
            joined: pairs of bodies, shape (n, 2).

        Raises:
            ValueError: joined bodies, or a body alone, are free to move as a whole.
        """
        if not self.ranks.max(np.any(self.free_motions())):
            return False
        bodies, ways, _ = self.loose_bodies(joined)
        if not len(bodies):
            return True
        others = f" with the {len(bodies) - 1} it is joined to" if len(bodies) > 1 else ""
        raise ValueError(
            "Without inertia what is prescribed should hold every body, or one of those that "
            f"interactions join to it, and body {bodies[0]} is free{others} to move as a whole in "
            f"{ways} way(s) (translations and rotations): prescribe more components on its "
            "facets, let it lean on a wall, or take inertia=True."
        )

    def _mass(self) -> np.ndarray:
        """Mass of each unknown that has inertia."""
        return self.weights

    @property
    def mass(self) -> np.ndarray | None:
        """Lumped mass a dof, shape (num_dofs,), kg (2D: kg/m); None without inertia."""
        return None if self.inertia is None else self.inertia.mass

    @property
    def nbytes(self) -> int:
        """Memory of masses and matrices, inverses apart, in bytes."""
        kept = 0 if self._matrix is None else self._matrix.data.nbytes
        if self.stiffness is not None:
            k = self.stiffness
            kept += k.data.nbytes + k.indices.nbytes + k.indptr.nbytes
        if self.by_cell is not None:
            kept += self.by_cell.nbytes
        return self.weights.nbytes + kept

    def _motion_dofs(self, motion) -> np.ndarray:
        facets = self.forms.bodies.facet_tags.find(motion.facets)
        fdim = self.forms.bodies.mesh.topology.dim - 1
        nodes = fem.locate_dofs_topological(self.forms.V, fdim, facets)
        there = self.forms.V.tabulate_dof_coordinates()[nodes].T
        nodes = nodes[nodes_that_move(motion, there)]
        return nodes.astype(np.intp) * self.dim + motion.component

    def _nodal_mass(self) -> np.ndarray:
        """Mass of each node of V: a cell's mass shared as the diagonal of its consistent matrix.

        That is a third of a triangle at each vertex for order 1, and stays positive for order 2
        (Hinton, Rock, Zienkiewicz 1976), where row sums would give the vertices nothing.
        """
        V = self.forms.V
        mesh = V.mesh
        element = V.sub(0).element.basix_element
        points, weights = basix.make_quadrature(element.cell_type, 2 * element.degree)
        shape = element.tabulate(0, points)[0, :, :, 0]
        diagonal = weights @ shape**2
        measure = cell_measure(mesh.topology.cell_name(), mesh.geometry.x[geometry_dofmap(mesh)])
        share = diagonal / diagonal.sum()
        cell_mass = measure * self.forms.cell_density()
        return np.bincount(
            V.dofmap.list.ravel(),
            np.outer(cell_mass, share).ravel(),
            minlength=len(self.unknowns.node_of),
        )

    def tangent(self, displacement: np.ndarray) -> BlockMatrix:
        """K on the nodes of V at a displacement, in blocks; the next call reuses the array."""
        self.forms.u.x.array[:] = self.unknowns.expand(displacement)
        if self._matrix is None:
            self._matrix = fem.create_matrix(self.forms.tangent)
        self._matrix.set_value(0.0)
        fem.assemble_matrix(self._matrix, self.forms.tangent)
        rows = self._matrix.index_map(0).size_local
        indptr = self._matrix.indptr[: rows + 1]
        blocks = self._matrix.data.reshape(-1, self.dim, self.dim)[: indptr[-1]]
        return BlockMatrix(blocks, self._matrix.indices[: indptr[-1]], indptr)

    def internal(self, displacement: np.ndarray) -> np.ndarray:
        """Internal forces, shape (num_dofs,), N (2D: N/m)."""
        u = self.unknowns.expand(displacement)
        if self.by_cell is not None:
            force = self.by_cell(u)
        else:
            force = multiply(self.stiffness, u) if self.linear else self.forms.assemble_internal(u)
        return self.unknowns.collect(force)

    def internal_at_end(self, displacement: np.ndarray) -> np.ndarray:
        """As `internal`, of a bulk that is not linear, where energies are asked for, too."""
        return self.unknowns.collect(self.forms.internal_at_end(self.unknowns.expand(displacement)))

    def forces_by_cell(self) -> None:
        """Have forces of a linear bulk cell by cell from now on, if each body is a simplex.

        A stiffness that nothing else needs goes.
        """
        if not self.linear:
            return
        from xper_fx.bulk.cell_forces import CellForces

        self.critical_step()  # the last that asks for K
        self.by_cell = CellForces.of(self.stiffness, self.forms.V)
        if self.by_cell is not None:
            self.stiffness = None

    def external(self, time: float) -> np.ndarray | float:
        """External forces at a time (N; 2D: N/m); 0 when the scene has none."""
        if self.forms.external is None:
            return 0.0
        if self._external is not None:
            return self._external
        return self.forms.assemble_external(time)

    def momentum(self, velocity: np.ndarray) -> np.ndarray | float:
        """M v (N s; 2D: N s/m); 0 without inertia."""
        return 0.0 if self.inertia is None else self.inertia.momentum(velocity)

    def viscous(self, velocity: np.ndarray) -> np.ndarray | float:
        """C v (N; 2D: N/m); 0 when the scene has no damping."""
        return 0.0 if self.damping is None else self.damping.force(velocity)

    def kinetic_energy(self, velocity: np.ndarray) -> float:
        """v . M . v / 2 of this rank's bodies (J; 2D: J/m); 0 without inertia."""
        return 0.0 if self.inertia is None else self.inertia.energy(velocity)

    def elastic_energy(self, displacement: np.ndarray, internal: np.ndarray) -> float:
        """Stored energy of this rank's bodies (J; 2D: J/m) where internal forces are known."""
        if self.linear:
            return self.own_dot(0.5 * displacement, internal)
        return self.forms.assemble_energy(self.unknowns.expand(displacement))

    def commit(self, state: State, impulses: np.ndarray, step: float) -> None:
        """End the step, with the state there and impulses of interactions (N s)."""
        if self.forms.has_history:
            self.forms.commit(self.unknowns.expand(state.displacement))

    def forget(self) -> None:
        """Take back what an attempt at a step has taught, as it failed."""

    def with_border(self, inverse, stiffness, step: float, theta: float, interacting: bool):
        """The inverse on the bodies, completed for unknowns that belong to none."""
        return inverse

    def norm(self, velocity: np.ndarray) -> float:
        """Norm of velocities that the mass gives, with inertia or without."""
        return float(np.sqrt(self.dot(velocity, self.weights * velocity)))

    def dot(self, a: np.ndarray, b: np.ndarray) -> float:
        """Inner product of vectors of unknowns over all ranks, each unknown counted once."""
        return self.ranks.sum(self.own_dot(a, b))

    def own_dot(self, a: np.ndarray, b: np.ndarray) -> float:
        """What this rank counts of `dot`."""
        return float(a @ b)

    @property
    def num_dofs_of_all(self) -> int:
        """Number of unknowns on all ranks."""
        return int(self.ranks.sum(self.num_dofs))

    def macroscopic_motion(self, displacement, velocity) -> tuple[np.ndarray, ...]:
        """Fbar and its rate, of a periodic cell; empty for others.

        Args:
            displacement, velocity: of all unknowns, shape (num_dofs,), m and m/s.
        """
        return ()

    def end_weight(self, theta: float) -> float | np.ndarray:
        """theta of each unknown's equation, one number if it is the same for all."""
        return theta

    def balance(self, tolerance: float) -> InBalance:
        """The equations of unknowns that belong to no body, at the start of a step.

        Args:
            tolerance: relative error that they are held to.
        """
        return InBalance()

    def prescribe(
        self,
        velocity: np.ndarray,
        time: float,
        step: float,
        theta: float,
        displacement0: np.ndarray,
        velocity0: np.ndarray,
        elapsed: float | None = None,
    ) -> None:
        """Set the prescribed dofs of an end-of-step velocity.

        A displacement given at the end of the step asks for
        v1 = [(u(t1) - q0) / h - (1 - theta) v0] / theta. Where the time that elapses is not h, as
        on a path whose load is unknown, a velocity given moves by its value times that time.
        """
        share = 1.0 if elapsed is None else elapsed / step
        for dofs, motion in self._motions:
            value = value_at(motion.value, time)
            if isinstance(motion, PrescribedDisplacement):
                rate = (value - displacement0[dofs]) / step
                velocity[dofs] = (rate - (1.0 - theta) * velocity0[dofs]) / theta
            else:
                velocity[dofs] = share * value

    def start(self, velocity: np.ndarray, step: float) -> None:
        """Set the dofs of prescribed displacements to their rate at the start.

        Otherwise theta = 1/2, which takes v1 = 2 (u1 - u0) / h - v0, would ring for ever. The
        difference quotient is of second order in `step` (s).
        """
        for dofs, motion in self._motions:
            if isinstance(motion, PrescribedDisplacement):
                u0, u1, u2 = (value_at(motion.value, t) for t in (0.0, 0.5 * step, step))
                velocity[dofs] = (4.0 * u1 - u2 - 3.0 * u0) / step

    def critical_step(self, displacement: np.ndarray | None = None) -> float:
        """Largest stable step (s) of the explicit bulk alone, 2 / omega_max, at rest or not."""
        if displacement is None and self._critical_step > 0.0:
            return self._critical_step
        from xper_fx.bulk.critical_step import largest_eigenvalue

        place = np.zeros(self.num_dofs) if displacement is None else displacement
        stiffness = self.unknowns.condense(self.stiffness if self.linear else self.tangent(place))
        top = self.ranks.max(largest_eigenvalue(stiffness, self.weights, self.layout))
        critical = 2.0 / float(np.sqrt(top))
        if displacement is None:
            self._critical_step = critical
        return critical

    def rounding(self, displacement: np.ndarray) -> float:
        """Rounding of the elastic energy u . K u / 2 (J; 2D: J/m) at displacements u.

        Sums of entries of K u leave some ulps of omega^2 M u, omega of the stiffest vibration.
        """
        return _ROUNDING * (2.0 / self.critical_step() * self.norm(displacement)) ** 2

    def saved(self) -> dict:
        """What the next step depends on beside the state: internal variables."""
        history = self.forms.history_by_cell()
        return {} if history is None else {"history": Rows(self.forms.bodies.parent_cell, history)}

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave, its rows in order."""
        if self.forms.has_history:
            self.forms.restore_by_cell(saved["history"][self.forms.bodies.parent_cell])
