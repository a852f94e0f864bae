# SPDX-License-Identifier: LGPL-3.0-or-later
"""The weak form of the bulk: internal forces from energies, external forces, stress.

For all test functions v on each body,

    f_int(u; v) = d/du [ sum_tags int W_tag(u) dx ] . v,     K = d f_int / du,
    f_ext(v) = int (b + rho g) . v dx + sum_tags int t . v ds.

Both derivatives are UFL's. What a scene does not call for has no form.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import ufl
from dolfinx import default_scalar_type, fem

from xper_fx.bodies import Bodies
from xper_fx.compat import interpolation_points
from xper_fx.forms.loads import BodyForce, Gravity, SurfaceTraction, value_at
from xper_fx.materials.material import Material

_JIT = {"timeout": 120}


class BulkForms:
    """Compiled forms of the bulk on the exploded mesh.

    Args:
        bodies: the bodies.
        order: order of the Lagrange space, 1 or 2.
        materials: material of each cell tag.
        forces: body forces, gravity, surface tractions.

    Attributes:
        V: vector Lagrange space on `bodies.mesh`.
        u: displacement the forms are evaluated at (m).
        linear: whether every material's energy is quadratic.
    """

    def __init__(
        self,
        bodies: Bodies,
        order: int,
        materials: Mapping[int, Material],
        forces: Sequence[BodyForce | Gravity | SurfaceTraction] = (),
    ):
        mesh = bodies.mesh
        dim = mesh.geometry.dim
        self.bodies, self.materials = bodies, dict(materials)
        self.V = fem.functionspace(mesh, ("Lagrange", order, (dim,)))
        self.u = fem.Function(self.V, name="displacement")
        self.linear = all(m.linear for m in self.materials.values())
        simplex = mesh.topology.cell_name() in ("triangle", "tetrahedron")
        degree = 2 * (order - 1) if simplex else 2 * order
        self._dx = ufl.Measure(
            "dx", mesh, subdomain_data=bodies.cell_tags, metadata={"quadrature_degree": degree}
        )
        test, trial = ufl.TestFunction(self.V), ufl.TrialFunction(self.V)
        energy = sum(m.energy(self.u, self._constant) * self._dx(t) for t, m in self._items())
        force = ufl.derivative(energy, self.u, test)
        self.energy = fem.form(energy, jit_options=_JIT)
        self.internal = fem.form(force, jit_options=_JIT)
        self.tangent = fem.form(ufl.derivative(force, self.u, trial), jit_options=_JIT)
        self._loads: list[tuple[fem.Constant, Sequence]] = []
        self.external = self._external_form(forces, test)

    def _items(self):
        return sorted(self.materials.items())

    def _constant(self, value):
        return fem.Constant(self.bodies.mesh, default_scalar_type(value))

    def _external_form(self, forces, test):
        mesh = self.bodies.mesh
        dim = mesh.geometry.dim
        mass_dx = ufl.Measure("dx", mesh, subdomain_data=self.bodies.cell_tags)
        ds = ufl.Measure("ds", mesh, subdomain_data=self.bodies.facet_tags)
        total = None
        for force in forces:
            vector = self._constant(np.zeros(dim))
            self._loads.append((vector, tuple(force.value)))
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
        return None if total is None else fem.form(total, jit_options=_JIT)

    @property
    def steady(self) -> bool:
        """Whether no external force depends on time."""
        return not any(callable(v) for _, values in self._loads for v in values)

    def assemble_external(self, time: float) -> np.ndarray:
        """External forces at a time, shape (num_dofs,), N (2D: N/m)."""
        for constant, values in self._loads:
            constant.value[:] = [value_at(v, time) for v in values]
        return fem.assemble_vector(self.external).array

    def assemble_internal(self, displacement: np.ndarray) -> np.ndarray:
        """Internal forces at a displacement, shape (num_dofs,), N (2D: N/m)."""
        self.u.x.array[:] = displacement
        return fem.assemble_vector(self.internal).array

    def assemble_energy(self, displacement: np.ndarray) -> float:
        """Stored energy at a displacement, J (2D: J/m)."""
        self.u.x.array[:] = displacement
        return fem.assemble_scalar(self.energy)

    def cell_density(self) -> np.ndarray:
        """Density of each cell, shape (num_cells,), kg/m^3."""
        tags = self.bodies.material_of_cell
        out = np.empty(len(tags))
        for tag, material in self._items():
            out[tags == tag] = material.density
        return out

    def stress_evaluator(self):
        """A function that evaluates the Cauchy stress at `u` in each cell.

        Returns:
            A function without arguments giving shape (num_cells, 3, 3), Pa: values at the cells'
            midpoints.
        """
        space = fem.functionspace(self.bodies.mesh, ("DG", 0, (3, 3)))
        stress = fem.Function(space, name="stress")
        points = interpolation_points(space.element)
        tags = self.bodies.material_of_cell
        pieces = [
            (
                fem.Expression(m.stress(self.u, self._constant), points, jit_options=_JIT),
                np.flatnonzero(tags == tag).astype(np.int32),
            )
            for tag, m in self._items()
        ]

        def evaluate() -> np.ndarray:
            for expression, cells in pieces:
                stress.interpolate(expression, cells)
            return stress.x.array[space.dofmap.list.ravel()[:, None] * 9 + np.arange(9)].reshape(
                -1, 3, 3
            )

        return evaluate
