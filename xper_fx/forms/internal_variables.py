# SPDX-License-Identifier: LGPL-3.0-or-later
"""Internal variables of the bulk at the quadrature points of its forms.

The variables of one material are stored one after the other at each point, a symmetric tensor as
its components 11, 22, 33, 12 (and 13, 23 in 3D). As each cell has one material, all materials
share one array, as wide as the longest of their lists.
"""

from __future__ import annotations

from collections.abc import Mapping

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem

from xper_fx.bodies.explode import Bodies

_PLACES = {
    2: ((0, 0), (1, 1), (2, 2), (0, 1)),
    3: ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)),
}


class History:
    """Internal variables of all materials at the end of the last committed step.

    Args:
        degree: degree of the quadrature of the forms.
        variables: initial values by name, of each cell tag whose material has any; a float, or
            3 x 3 nested tuples for a symmetric tensor.

    Raises:
        ValueError: an initial value of another shape, not finite, or a tensor that is not
            symmetric or, in 2D, has components 13 or 23.
    """

    def __init__(self, bodies: Bodies, degree: int, variables: Mapping[int, Mapping]):
        mesh = bodies.mesh
        self._places = _PLACES[mesh.geometry.dim]
        self._cells = {
            tag: np.flatnonzero(bodies.material_of_cell == tag).astype(np.int32)
            for tag in variables
        }
        start = {
            tag: {name: self._packed_value(name, value) for name, value in given.items()}
            for tag, given in variables.items()
        }
        self._slices = {tag: _slices(values) for tag, values in start.items()}
        width = max(sum(len(v) for v in values.values()) for values in start.values())
        element = basix.ufl.quadrature_element(
            mesh.topology.cell_name(), value_shape=(width,), scheme="default", degree=degree
        )
        space = fem.functionspace(mesh, element)
        self._function = fem.Function(space, name="history")
        self._dofs = space.dofmap.list
        self._values = self._function.x.array.reshape(-1, width)
        self._rows = {tag: _rows(self._dofs[cells]) for tag, cells in self._cells.items()}
        for tag, values in start.items():
            whole = np.concatenate(list(values.values()))
            self._values[self._rows[tag], : len(whole)] = whole

    @property
    def nbytes(self) -> int:
        """Memory of the variables."""
        return self._values.nbytes

    def _packed_value(self, name: str, value) -> np.ndarray:
        value = np.asarray(value, dtype=float)
        if value.shape not in ((), (3, 3)) or not np.all(np.isfinite(value)):
            raise ValueError(
                f"The initial value of the internal variable {name!r} should be a finite number "
                f"or a 3 x 3 symmetric tensor, got {value.tolist()}."
            )
        if value.shape == ():
            return value.reshape(1)
        packed = np.array([value[place] for place in self._places])
        whole = np.zeros((3, 3))
        for component, (i, j) in zip(packed, self._places, strict=True):
            whole[i, j] = whole[j, i] = component
        if not np.array_equal(whole, value):
            raise ValueError(
                f"The initial value of the internal variable {name!r} should be symmetric and, "
                f"in 2D, without components 13 and 23, got {value.tolist()}."
            )
        return packed

    def variables(self, tag: int) -> dict:
        """Committed variables of a cell tag in UFL, by name: scalars or 3 x 3 tensors."""
        out = {}
        for name, part in self._slices[tag].items():
            components = [self._function[i] for i in range(part.start, part.stop)]
            out[name] = components[0] if len(components) == 1 else self._tensor(components)
        return out

    def _tensor(self, components):
        rows = [[0.0] * 3 for _ in range(3)]
        for component, (i, j) in zip(components, self._places, strict=True):
            rows[i][j] = rows[j][i] = component
        return ufl.as_tensor(rows)

    def has(self, tag: int) -> bool:
        """Whether the material of a cell tag has any."""
        return tag in self._cells

    def packed(self, tag: int, new: Mapping) -> list:
        """New values of the variables of a cell tag, as they are stored.

        Args:
            tag: cell tag.
            new: new values by name, in UFL.

        Raises:
            ValueError: the names are not those of the variables, or a shape differs.
        """
        slices = self._slices[tag]
        if set(new) != set(slices):
            raise ValueError(
                f"The response of the material of cell tag {tag} should give new values of "
                f"{sorted(slices)}, got {sorted(new)}."
            )
        components = []
        for name, part in slices.items():
            value = ufl.as_ufl(new[name])
            shape = () if part.stop - part.start == 1 else (3, 3)
            if value.ufl_shape != shape:
                raise ValueError(
                    f"The new value of the internal variable {name!r} of cell tag {tag} should "
                    f"have the shape {shape}, got {value.ufl_shape}."
                )
            components += [value[place] for place in self._places] if shape else [value]
        return components

    def commit(self, new: Mapping[int, np.ndarray]) -> None:
        """Make new values the committed ones.

        Args:
            new: by cell tag, what `packed` gave at the points, shape (num_cells, num_points,
                components).
        """
        for tag, values in new.items():
            width = values.shape[-1]
            self._values[self._rows[tag], :width] = values.reshape(-1, width)

    def copy(self) -> dict[str, np.ndarray]:
        """Committed variables, by "name tag".

        Returns:
            Arrays of shape (num_cells of the tag, num_points, 1 or number of kept components).
        """
        return {
            f"{name} {tag}": self._values[self._dofs[self._cells[tag]], part]
            for tag, slices in self._slices.items()
            for name, part in slices.items()
        }

    def restore(self, values: Mapping[str, np.ndarray]) -> None:
        """Make what `copy` gave the committed variables.

        Raises:
            ValueError: a name or a shape that is not of this history.
        """
        present = self.copy()
        shapes = [{k: np.shape(v) for k, v in d.items()} for d in (present, values)]
        if shapes[0] != shapes[1]:
            raise ValueError(
                f"The history should have the arrays {shapes[0]}, got {shapes[1]}; take it from a "
                "run with the same mesh, order and materials."
            )
        for tag, slices in self._slices.items():
            for name, part in slices.items():
                self._values[self._dofs[self._cells[tag]], part] = values[f"{name} {tag}"]

    def by_cell(self) -> np.ndarray:
        """All committed variables, shape (num_cells, num_points, longest list of variables)."""
        return self._values[self._dofs]

    def from_cells(self, values: np.ndarray) -> None:
        """Make what `by_cell` gave the committed variables."""
        self._values[self._dofs] = values


def _slices(values: Mapping[str, np.ndarray]) -> dict[str, slice]:
    ends = np.cumsum([0] + [len(v) for v in values.values()])
    return {name: slice(a, b) for name, a, b in zip(values, ends[:-1], ends[1:], strict=True)}


def _rows(dofs: np.ndarray) -> slice | np.ndarray:
    """Numbers as an index; a slice, which is faster, where they follow each other."""
    dofs = dofs.ravel()
    first = dofs[0] if len(dofs) else 0
    follow = np.array_equal(dofs, np.arange(first, first + len(dofs)))
    return slice(first, first + len(dofs)) if follow else dofs
