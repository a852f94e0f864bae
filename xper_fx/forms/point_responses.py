# SPDX-License-Identifier: LGPL-3.0-or-later
"""What inelastic materials answer at the points of quadrature, all of it in one pass.

Stresses, energies and new internal variables at the end of a step share nearly all of their
arithmetic: the return to the yield surface, say. Forms and expressions for each of them would do it
again and again, so that one expression has them all. Its values are kept until the displacement,
the step or the committed variables are others. Integrals are sums over points, with the weight w
and the Jacobian J of a cell,

    int a dx = sum a_q w_q |det J_q|,    f(v) = sum w_q |det J_q| P_q : grad v.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, Any

import basix
import numpy as np
import ufl
from dolfinx import fem

from xper_fx.bodies.explode import Bodies
from xper_fx.cache import njit
from xper_fx.forms.compiled import compiled_expression
from xper_fx.forms.shape_gradients import ShapeGradients
from xper_fx.materials.material import Response

if TYPE_CHECKING:
    from xper_fx.forms import internal_variables

# Energy densities that a response may have beside the stored one.
LOSSES = ("plastic", "viscous")
# Components of a stress, row by row.
_PLACES = tuple((i, j) for i in range(3) for j in range(3))


class _Pass:
    """All values of one material: an expression, where it is evaluated, and what its columns are.

    Args:
        parts: expressions by name, of any shape.
        points: of quadrature, in the reference cell, shape (num_points, dim).
        cells: of the material.
    """

    def __init__(self, parts: Mapping[str, list], points: np.ndarray, cells: np.ndarray):
        ends = np.cumsum([0] + [len(part) for part in parts.values()])
        self.columns = {
            name: slice(a, b) for name, a, b in zip(parts, ends[:-1], ends[1:], strict=True)
        }
        whole = ufl.as_vector([component for part in parts.values() for component in part])
        self._expression = compiled_expression(whole, points)
        self.cells, self._shape = cells, (len(cells), len(points), ends[-1])

    def evaluate(self, mesh) -> np.ndarray:
        """Values, shape (num_cells, num_points, num_columns)."""
        return self._expression.eval(mesh, self.cells).reshape(self._shape)


class PointResponses:
    """Responses of the inelastic materials, evaluated at the points of quadrature.

    Args:
        degree: of the quadrature of the forms.
        responses: by cell tag, at `u`.
        u: displacement the responses are evaluated at (m).
        step: h (s) as the responses have it.
        history: internal variables, None where no material has any.
        judged: whether stresses of cells will be asked for, so that those across the plane are
            worth their place.

    Attributes:
        losses: names of the energies that are dissipated.
        flows: whether a material says by how much it flows in a step.
        whole: tags of the materials whose Cauchy stress is kept, all of it.
    """

    def __init__(
        self,
        bodies: Bodies,
        degree: int,
        responses: Mapping[int, Response],
        u: fem.Function,
        step: fem.Constant,
        history: internal_variables.History | None,
        judged: bool = False,
    ):
        self._mesh, self._u, self._step, self._history = bodies.mesh, u, step, history
        cell_name = self._mesh.topology.cell_name()
        points, weights = basix.make_quadrature(getattr(basix.CellType, cell_name), degree)
        dim = self._mesh.geometry.dim
        self.losses = tuple(
            name for name in LOSSES if any(getattr(r, name) is not None for r in responses.values())
        )
        self.flows = any(r.increment is not None for r in responses.values())
        small_strain = {t for t, r in responses.items() if r.stress is r.nominal_stress}
        self.whole = small_strain if judged or dim == 3 else set()
        self._passes: dict[int, _Pass] = {}
        for tag, response in responses.items():
            parts = {"energy": [response.energy]}
            parts |= {
                name: [getattr(response, name)]
                for name in LOSSES
                if getattr(response, name) is not None
            }
            if response.increment is not None:
                parts["increment"] = _components(response.increment)
            if history is not None and history.has(tag):
                parts["new"] = history.packed(tag, response.new)
            stress = response.nominal_stress
            parts["stress"] = [stress[i, j] for i in range(dim) for j in range(dim)]
            if tag in self.whole:
                parts["across"] = [stress[i, j] for i, j in _PLACES if max(i, j) >= dim]
            cells = np.flatnonzero(bodies.material_of_cell == tag).astype(np.int32)
            self._passes[tag] = _Pass(parts, points, cells)
        jacobian = compiled_expression(abs(ufl.JacobianDeterminant(self._mesh)), points)
        self._weights = {
            tag: jacobian.eval(self._mesh, one.cells).reshape(-1, len(points)) * weights
            for tag, one in self._passes.items()
        }
        self._points, self._gradients = points, None  # forces alone need them
        self._values: dict[int, np.ndarray] = {}
        self._at: tuple[np.ndarray, float] | None = None

    @property
    def nbytes(self) -> int:
        """Memory of weights, inverse Jacobians and the values that are kept."""
        kept = [*self._weights.values(), *self._values.values()]
        if self._gradients is not None:
            kept.append(self._gradients.inverses)
        return sum(values.nbytes for values in kept)

    def _evaluate(self) -> dict[int, np.ndarray]:
        """Values of all materials at the present displacement and step."""
        u, step = self._u.x.array, float(self._step.value)
        kept = self._at is not None and self._at[1] == step and np.array_equal(self._at[0], u)
        if not kept:
            self._values = {tag: one.evaluate(self._mesh) for tag, one in self._passes.items()}
            self._at = u.copy(), step
        return self._values

    def _parts(self, name: str) -> dict[int, np.ndarray]:
        """Values of one name, of the materials that have it."""
        values = self._evaluate()
        return {
            tag: values[tag][:, :, one.columns[name]]
            for tag, one in self._passes.items()
            if name in one.columns
        }

    def total(self, name: str) -> float:
        """Integral of an energy density over the cells (J; 2D: J/m)."""
        return sum(
            float(np.einsum("cq,cq", self._weights[tag], part[:, :, 0]))
            for tag, part in self._parts(name).items()
        )

    def largest_increment(self) -> float:
        """Largest inelastic strain that the step adds anywhere."""
        parts = self._parts("increment").values()
        return max(float(np.abs(part).max(initial=0.0)) for part in parts)

    def stress(self, tag: int) -> np.ndarray:
        """Cauchy stress of one of the materials `whole`, shape (n, num_points, 3, 3), Pa."""
        values, columns = self._evaluate()[tag], self._passes[tag].columns
        within = np.array([max(place) < self._mesh.geometry.dim for place in _PLACES])
        out = np.empty((*values.shape[:2], len(_PLACES)))
        out[:, :, within] = values[:, :, columns["stress"]]
        out[:, :, ~within] = values[:, :, columns["across"]]
        return out.reshape(*values.shape[:2], 3, 3)

    def commit(self) -> None:
        """Make the new internal variables the committed ones."""
        new = self._parts("new")
        self.forget()
        self._history.commit(new)

    def forget(self) -> None:
        """Values are those of other committed variables."""
        self._at = None

    def forces(self) -> np.ndarray:
        """Internal forces of the nominal stresses, shape (num_dofs,), N (2D: N/m)."""
        if self._gradients is None:
            self._gradients = ShapeGradients.of(self._u.function_space, self._points)
        dim = self._mesh.geometry.dim
        push, out = _push_kernel(dim), np.zeros((len(self._u.x.array) // dim, dim))
        for tag, stress in self._parts("stress").items():
            push(stress, self._weights[tag], self._passes[tag].cells, self._gradients, out)
        return out.reshape(-1)


@cache
def _push_kernel(dim: int):
    """Kernel that adds the forces of some cells to those of all nodes, its loops unrolled."""

    @njit
    def push(stress, weights, cells, gradients, out):
        """Add forces.

        Args:
            stress: nominal, shape (len(cells), num_points, dim * dim), Pa.
            weights: w |det J|, shape (len(cells), num_points).
            cells: their numbers.
            gradients: a `ShapeGradients`.
            out: takes the forces, shape (num_nodes, dim).
        """
        dofmap, inverses, shape = gradients
        num_points, _, num_nodes = shape.shape
        scaled, last = np.empty((dim, dim)), inverses.shape[1] - 1
        forces = np.empty((dim, num_nodes))
        for c in range(len(cells)):
            cell = cells[c]
            forces[:] = 0.0
            for q in range(num_points):
                at = min(q, last)
                for i in range(dim):
                    for k in range(dim):
                        total = 0.0
                        for j in range(dim):
                            total += stress[c, q, i * dim + j] * inverses[cell, at, k, j]
                        scaled[i, k] = weights[c, q] * total
                for i in range(dim):
                    for node in range(num_nodes):
                        total = 0.0
                        for k in range(dim):
                            total += scaled[i, k] * shape[q, k, node]
                        forces[i, node] += total
            for node in range(num_nodes):
                for i in range(dim):
                    out[dofmap[cell, node], i] += forces[i, node]

    return push


def _components(expression: Any) -> list:
    """Components of an expression of any shape."""
    expression = ufl.as_ufl(expression)
    return [expression[i] for i in np.ndindex(expression.ufl_shape)] or [expression]
