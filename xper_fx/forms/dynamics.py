# SPDX-License-Identifier: LGPL-3.0-or-later
"""The weak form of the bulk: internal forces, external forces, stress, internal variables.

For all test functions v on each body,

    f_int(u; v) = d/du [ sum int W_tag(u) dx ] . v + sum int P_tag(u; a, h) : grad v dx,
    K = d f_int / du,
    f_ext(v) = int (b + rho g) . v dx + sum_tags int t . v ds - int sigma_0 : eps(v) dx.

The first sum is over hyperelastic materials, the second over those with a response, whose nominal
stress P depends on the internal variables a committed at the start of the step and on its size h.
All derivatives are UFL's. What a scene does not call for has no form.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import basix
import numpy as np
import ufl
from dolfinx import default_scalar_type, fem

from xper_fx.bodies.explode import Bodies
from xper_fx.forms.compiled import compiled_expression, compiled_form
from xper_fx.forms.loads import (
    BodyForce,
    Gravity,
    InitialStress,
    SurfaceTraction,
    VectorValue,
    varies,
    vector_at,
)
from xper_fx.materials.kinematics import displacement_gradient, in_space
from xper_fx.materials.material import InelasticMaterial, Material, Response
from xper_fx.support.compat import interpolation_points


def at_finite_strain(materials: Mapping[int, Material | InelasticMaterial]) -> bool:
    """Whether one of some materials names that effect."""
    return any("finite strain" in getattr(m, "effects", ()) for m in materials.values())


class BulkForms:
    """Compiled forms of the bulk on the exploded mesh.

    Args:
        order: order of the Lagrange space, 1 or 2.
        materials: material of each cell tag.
        forces: body forces, gravity, surface tractions, initial stresses.
        judged: whether stresses of cells will be asked for, as of runs with an accuracy.

    Attributes:
        V: vector Lagrange space on `bodies.mesh`.
        u: displacement the forms are evaluated at (m).
        linear: whether every material's energy is quadratic.
        finite_strain: whether a material names that effect.
        step: h (s) as the forms have it, None where no material asks for it.

    Raises:
        ValueError: a material's internal variables and its response do not fit.
        TypeError: a material's energy or response is none.
    """

    def __init__(
        self,
        bodies: Bodies,
        order: int,
        materials: Mapping[int, Material | InelasticMaterial],
        forces: Sequence[BodyForce | Gravity | SurfaceTraction | InitialStress] = (),
        judged: bool = False,
    ):
        mesh = bodies.mesh
        dim = mesh.geometry.dim
        self.bodies, self.materials = bodies, dict(materials)
        self.V = fem.functionspace(mesh, ("Lagrange", order, (dim,)))
        self.u = fem.Function(self.V, name="displacement")
        self.linear = all(m.linear for m in self.materials.values())
        self.finite_strain = at_finite_strain(self.materials)
        simplex = mesh.topology.cell_name() in ("triangle", "tetrahedron")
        self._degree = 2 * (order - 1) if simplex else 2 * order
        self._dx = ufl.Measure(
            "dx",
            mesh,
            subdomain_data=bodies.cell_tags,
            metadata={"quadrature_degree": self._degree},
        )
        self._respond(judged)
        test, trial = ufl.TestFunction(self.V), ufl.TrialFunction(self.V)
        energies = [
            _checked_energy(t, m.energy(self.u, self._constant)) * self._dx(t)
            for t, m in self._items()
            if t not in self._responses
        ]
        force = sum(
            ufl.inner(r.nominal_stress, displacement_gradient(test)) * self._dx(t)
            for t, r in self._responses.items()
        )
        self._elastic_energy = self._elastic_force = None
        if energies:
            elastic = ufl.derivative(sum(energies), self.u, test)
            force += elastic
            self._elastic_energy = compiled_form(sum(energies))
            if self._responses:
                self._elastic_force = compiled_form(elastic)
        self.internal = compiled_form(force)
        self.tangent = compiled_form(ufl.derivative(force, self.u, trial))
        self._cell_energy: tuple[fem.Form, np.ndarray] | None = None
        self._loads: list[tuple[fem.Constant, VectorValue]] = []
        self._initial_stress = self._stress_at_start(forces)
        self.external = self._external_form(forces, test)

    def _items(self):
        return sorted(self.materials.items())

    def _constant(self, value):
        return fem.Constant(self.bodies.mesh, default_scalar_type(value))

    def _respond(self, judged: bool):
        """Responses of the inelastic materials, and the history they need."""
        inelastic = {t: m for t, m in self._items() if hasattr(m, "response")}
        variables = {t: m.variables for t, m in inelastic.items() if m.variables}
        self.step = self._constant(0.0) if inelastic else None
        self._history = None
        if variables:
            from xper_fx.forms.internal_variables import History

            self._history = History(self.bodies, self._degree, variables)
        self._responses = {}
        for tag, material in inelastic.items():
            old = self._history.variables(tag) if tag in variables else {}
            response = material.response(self.u, old, self.step, self._constant)
            _check_response(tag, response)
            self._responses[tag] = response
        self._at_points = None
        if inelastic:
            from xper_fx.forms.point_responses import PointResponses

            self._at_points = PointResponses(
                self.bodies, self._degree, self._responses, self.u, self.step, self._history, judged
            )

    @property
    def quadrature(self) -> tuple[np.ndarray, np.ndarray]:
        """Points of the reference cell at which stresses are, (num_points, dim), and weights."""
        cell = getattr(basix.CellType, self.bodies.mesh.topology.cell_name())
        return basix.make_quadrature(cell, self._degree)

    @property
    def flows(self) -> bool:
        """Whether a material says by how much it flows in a step."""
        return self._at_points is not None and self._at_points.flows

    def largest_increment(self, displacement: np.ndarray) -> float:
        """Largest inelastic strain that a step to a displacement adds anywhere."""
        self.u.x.array[:] = displacement
        return self._at_points.largest_increment()

    def _stress_at_start(self, forces) -> fem.Function | None:
        """Sum of the initial stresses, linear in each cell; None without any."""
        given = [force for force in forces if isinstance(force, InitialStress)]
        if not given:
            return None
        mesh = self.bodies.mesh
        dim = mesh.geometry.dim
        stress = fem.Function(fem.functionspace(mesh, ("DG", 1, (dim, dim))))
        stress.interpolate(lambda x: sum(g.at(x, dim) for g in given).reshape(dim * dim, -1))
        return stress

    def _external_form(self, forces, test):
        mesh = self.bodies.mesh
        dim = mesh.geometry.dim
        mass_dx = ufl.Measure("dx", mesh, subdomain_data=self.bodies.cell_tags)
        ds = ufl.Measure("ds", mesh, subdomain_data=self.bodies.facet_tags)
        total = None
        if self._initial_stress is not None:
            total = -ufl.inner(self._initial_stress, ufl.grad(test)) * mass_dx
        for force in forces:
            if isinstance(force, InitialStress):
                continue
            vector = self._constant(np.zeros(dim))
            value = force.value if callable(force.value) else tuple(force.value)
            self._loads.append((vector, value))
            if isinstance(force, SurfaceTraction):
                term = ufl.inner(vector, test) * ds(force.facets)
            elif isinstance(force, Gravity):
                term = sum(
                    self._constant(m.density) * ufl.inner(vector, test) * mass_dx(t)
                    for t, m in self._items()
                )
            else:
                term = ufl.inner(vector, test) * mass_dx
            total = term if total is None else total + term
        return None if total is None else compiled_form(total)

    @property
    def steady(self) -> bool:
        """Whether no external force depends on time."""
        return not any(varies(value) for _, value in self._loads)

    def assemble_external(self, time: float) -> np.ndarray:
        """External forces at a time, shape (num_dofs,), N (2D: N/m)."""
        for constant, value in self._loads:
            constant.value[:] = vector_at(value, time, len(constant.value))
        return fem.assemble_vector(self.external).array

    def set_step(self, step: float) -> None:
        """Give the forms the size h (s) of the step that they are assembled for."""
        if self.step is not None:
            self.step.value = step

    def assemble_internal(self, displacement: np.ndarray) -> np.ndarray:
        """Internal forces at a displacement, shape (num_dofs,), N (2D: N/m)."""
        self.u.x.array[:] = displacement
        return fem.assemble_vector(self.internal).array

    def internal_at_end(self, displacement: np.ndarray) -> np.ndarray:
        """As `assemble_internal`, for displacements at which energies are asked for, too.

        Inelastic materials answer once for forces and energies. Last digits differ.
        """
        if self._at_points is None:
            return self.assemble_internal(displacement)
        self.u.x.array[:] = displacement
        force = self._at_points.forces()
        if self._elastic_force is not None:
            force += fem.assemble_vector(self._elastic_force).array
        return force

    def assemble_energy(self, displacement: np.ndarray) -> float:
        """Stored energy at a displacement, J (2D: J/m).

        With internal variables: at the end of a step that leads to the displacement.
        """
        self.u.x.array[:] = displacement
        energy = 0.0
        if self._elastic_energy is not None:
            energy += fem.assemble_scalar(self._elastic_energy)
        if self._at_points is not None:
            energy += self._at_points.total("energy")
        return energy

    def cell_energies(self, displacement: np.ndarray) -> np.ndarray:
        """Stored energy of each cell at a displacement that was committed.

        Returns:
            Shape (num_cells,), J (2D: J/m).
        """
        if self._cell_energy is None:
            constants = fem.functionspace(self.bodies.mesh, ("DG", 0))
            test = ufl.TestFunction(constants)
            density = {
                t: self._responses[t].energy
                if t in self._responses
                else m.energy(self.u, self._constant)
                for t, m in self._items()
            }
            form = compiled_form(sum(e * test * self._dx(t) for t, e in density.items()))
            self._cell_energy = form, constants.dofmap.list[:, 0]
        form, dof_of_cell = self._cell_energy
        step = None if self.step is None else float(self.step.value)
        self.set_step(0.0)
        self.u.x.array[:] = displacement
        energies = fem.assemble_vector(form).array[dof_of_cell]
        if step is not None:
            self.set_step(step)
        return energies

    def assemble_dissipation(self, displacement: np.ndarray) -> dict[str, float]:
        """Energy dissipated in the bulk from the committed state to a displacement.

        Returns:
            J (2D: J/m), by "plastic" and "viscous" where a material has such a term; each zero or
            above.
        """
        if self._at_points is None:
            return {}
        self.u.x.array[:] = displacement
        return {name: self._at_points.total(name) for name in self._at_points.losses}

    @property
    def plastic(self) -> bool:
        """Whether a material dissipates by plasticity."""
        return self._at_points is not None and "plastic" in self._at_points.losses

    @property
    def viscous(self) -> bool:
        """Whether a material dissipates by viscosity."""
        return self._at_points is not None and "viscous" in self._at_points.losses

    @property
    def has_history(self) -> bool:
        """Whether a material has internal variables."""
        return self._history is not None

    @property
    def history_nbytes(self) -> int:
        """Memory of the internal variables."""
        return self._history.nbytes + self._at_points.nbytes if self.has_history else 0

    def commit(self, displacement: np.ndarray) -> None:
        """End the step at a displacement: its internal variables become the committed ones."""
        if self.has_history:
            self.u.x.array[:] = displacement
            self._at_points.commit()

    def history(self) -> dict[str, np.ndarray]:
        """Copies of the committed internal variables, empty where no material has any.

        Returns:
            By "name tag", the tag being that of the cells: shape (cells of the tag in ascending
            order, quadrature points, components), with 1 component, or 11, 22, 33, 12 (and 13, 23
            in 3D).
        """
        return self._history.copy() if self.has_history else {}

    def restore(self, history: Mapping[str, np.ndarray]) -> None:
        """Take the committed internal variables back from what `history` gave.

        Raises:
            ValueError: names or shapes of other materials or of another mesh.
        """
        if self.has_history:
            self._at_points.forget()
            self._history.restore(history)

    def history_by_cell(self) -> np.ndarray | None:
        """A copy of the committed internal variables cell by cell; None without any."""
        return self._history.by_cell() if self.has_history else None

    def restore_by_cell(self, values: np.ndarray | None) -> None:
        """Take the committed internal variables back from what `history_by_cell` gave."""
        if self.has_history:
            self._at_points.forget()
            self._history.from_cells(values)

    def cell_density(self) -> np.ndarray:
        """Density of each cell, shape (num_cells,), kg/m^3."""
        tags = self.bodies.material_of_cell
        out = np.empty(len(tags))
        for tag, material in self._items():
            out[tags == tag] = material.density
        return out

    def stress_evaluator(self, initial: bool = True):
        """A function that evaluates the Cauchy stress at `u` in each cell.

        An inelastic material is asked for a step of size zero from its committed state: after
        `commit`, with `u` where it was committed, that is the stress at the end of the step.

        Args:
            initial: whether initial stresses are part of it.

        Returns:
            A function without arguments giving shape (num_cells, 3, 3), Pa: values at the cells'
            midpoints; of inelastic materials, means over the quadrature points.
        """
        mesh = self.bodies.mesh
        points, weights = self.quadrature
        middle = interpolation_points(fem.functionspace(mesh, ("DG", 0)).element)
        tags, added = self.bodies.material_of_cell, initial and self._initial_stress is not None
        known = set() if added or not self._responses else self._at_points.whole
        pieces = []
        for tag, material in self._items():
            if tag in known:
                continue
            cells = np.flatnonzero(tags == tag).astype(np.int32)
            if tag in self._responses:
                stress, where, share = self._responses[tag].stress, points, weights
            else:
                stress, where, share = material.stress(self.u, self._constant), middle, np.ones(1)
            if added:
                stress += in_space(self._initial_stress)
            expression = compiled_expression(stress, where)
            pieces.append((expression, cells, share / share.sum()))

        def evaluate() -> np.ndarray:
            step = None if self.step is None else float(self.step.value)
            self.set_step(0.0)
            out = np.empty((len(tags), 3, 3))
            for expression, cells, share in pieces:
                values = expression.eval(mesh, cells).reshape(len(cells), len(share), 9)
                out[cells] = np.einsum("cqi,q->ci", values, share).reshape(-1, 3, 3)
            for tag in known:
                mean = np.einsum("cqij,q->cij", self._at_points.stress(tag), weights)
                out[tags == tag] = mean / weights.sum()
            if step is not None:
                self.set_step(step)
            return out

        return evaluate


def _checked_energy(tag: int, energy: Any) -> Any:
    """A material's energy density, unless it is none."""
    try:
        scalar = ufl.as_ufl(energy).ufl_shape == ()
    except (ValueError, TypeError):
        scalar = False
    if not scalar:
        raise TypeError(
            f"The energy of the material of cell tag {tag} gives {energy!r}; it should be a scalar "
            "in UFL (J/m^3), see materials/material.py."
        )
    return energy


def _check_response(tag: int, response: Response) -> None:
    """Raise unless a material's response is one."""
    if not isinstance(response, Response):
        raise TypeError(
            f"The material of cell tag {tag} responds with a {type(response).__name__}; expected "
            "a Response (see materials/material.py)."
        )
    for name in ("nominal_stress", "stress"):
        shape = getattr(ufl.as_ufl(getattr(response, name)), "ufl_shape", None)
        if shape != (3, 3):
            raise ValueError(
                f"The {name} of the material of cell tag {tag} has the shape {shape}; expected "
                "(3, 3), in plane strain too."
            )
