# SPDX-License-Identifier: LGPL-3.0-or-later
"""Surfaces of meshed bodies as arrays: oriented facets, and the bonds that hide some of them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np


@dataclass(frozen=True, eq=False)
class Surface:
    """Facets of meshed bodies, all that are or may become free.

    Facets of one body share the nodes where they meet. Where two bodies are bonded each has its own
    facet, and the bond names the nodes that coincide.

    Raises:
        ValueError: shapes or numbers that do not fit.
    """

    #: node numbers, shape (f, dim), int: edges in 2D, their outward normal the direction from the
    #: first node to the second turned by -90 degrees; triangles in 3D, nodes counter-clockwise seen
    #: from outside
    facets: np.ndarray
    body: np.ndarray  #: mesh body of each facet, shape (f,), int
    num_nodes: int  #: number of nodes of the mesh, those of no facet included
    #: number of the group of each facet, shape (f,), int; None: all of group 0
    group: np.ndarray | None = None
    groups: tuple[str, ...] = ("surface",)  #: names of the groups
    #: number of the bond that hides each facet, -1 for an outer one, shape (f,), int; None: all are
    #: outer ones
    bond: np.ndarray | None = None
    #: nodes that a bond joins, matched, shape (num_bonds, 2, m), int
    bond_nodes: np.ndarray = field(default_factory=lambda: np.empty((0, 2, 1), np.int32))
    #: bodies that a bond joins, shape (num_bonds, 2), int
    bond_bodies: np.ndarray = field(default_factory=lambda: np.empty((0, 2), np.int32))
    #: of the material behind each facet (m), shape (f,): contacts are not sought deeper than a
    #: share of it. None: the facets' sizes alone bound the depth.
    thickness: np.ndarray | None = None

    def __post_init__(self) -> None:
        facets = np.ascontiguousarray(self.facets, dtype=np.int32)
        if facets.ndim != 2 or facets.shape[1] not in (2, 3):
            raise ValueError(
                f"Facets should have the shape (number, 2) or (number, 3), got {facets.shape}; "
                "cut quadrilaterals into triangles."
            )
        count = len(facets)
        columns = {
            "body": self.body,
            "group": np.zeros(count, np.int32) if self.group is None else self.group,
            "bond": np.full(count, -1, np.int32) if self.bond is None else self.bond,
        }
        for name, column in columns.items():
            column = np.ascontiguousarray(column, dtype=np.int32)
            if column.shape != (count,):
                raise ValueError(f"{name} should be of shape ({count},), got {column.shape}.")
            object.__setattr__(self, name, column)
        thickness = np.full(count, np.inf) if self.thickness is None else self.thickness
        thickness = np.ascontiguousarray(thickness, dtype=float)
        if thickness.shape != (count,) or not (thickness > 0.0).all():
            raise ValueError(f"thickness should be {count} positive numbers.")
        object.__setattr__(self, "facets", facets)
        object.__setattr__(self, "thickness", thickness)
        object.__setattr__(self, "bond_nodes", np.asarray(self.bond_nodes, dtype=np.int32))
        object.__setattr__(self, "bond_bodies", np.asarray(self.bond_bodies, dtype=np.int32))
        if count and (facets.min() < 0 or facets.max() >= self.num_nodes):
            raise ValueError(
                f"Facets name nodes {facets.min()} to {facets.max()}; there are {self.num_nodes}."
            )
        if count and not 0 <= self.group.min() <= self.group.max() < len(self.groups):
            raise ValueError(
                f"Facets are of groups {self.group.min()} to {self.group.max()}; there are "
                f"{len(self.groups)}: {list(self.groups)}."
            )
        if count and self.bond.max() >= len(self.bond_nodes):
            raise ValueError(
                f"Facets are hidden by bonds up to {self.bond.max()}; bond_nodes has "
                f"{len(self.bond_nodes)}."
            )
        if len(self.bond_bodies) != len(self.bond_nodes):
            raise ValueError(
                f"bond_bodies has {len(self.bond_bodies)} bonds, bond_nodes "
                f"{len(self.bond_nodes)}: there should be as many."
            )

    @property
    def dim(self) -> int:
        """Dimension of space."""
        return self.facets.shape[1]

    def __len__(self) -> int:
        """Number of facets."""
        return len(self.facets)

    def compact(self) -> tuple[Surface, np.ndarray]:
        """The same facets and bonds with nodes of no facet and no bond left out.

        Returns:
            The surface, and the numbers that its nodes have here, shape (num_nodes,), ascending.
        """
        named = np.concatenate([self.facets.ravel(), self.bond_nodes.ravel()])
        nodes, place = np.unique(named, return_inverse=True)
        facets, bond_nodes = np.split(place.ravel(), [self.facets.size])
        return replace(
            self, facets=facets.reshape(self.facets.shape), num_nodes=len(nodes),
            bond_nodes=bond_nodes.reshape(self.bond_nodes.shape),
        ), nodes  # fmt: skip

    def measure(self, x: np.ndarray) -> np.ndarray:
        """Length or area of the facets at positions x, shape (num_nodes, dim); m or m^2."""
        corner = x[self.facets]
        if self.dim == 2:
            return np.linalg.norm(corner[:, 1] - corner[:, 0], axis=1)
        return 0.5 * np.linalg.norm(self._crossed(corner), axis=1)

    def size(self, x: np.ndarray) -> np.ndarray:
        """Length of an edge, smallest height of a triangle (m), shape (f,)."""
        if self.dim == 2:
            return self.measure(x)
        corner = x[self.facets]
        longest = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(axis=1)
        return np.linalg.norm(self._crossed(corner), axis=1) / longest

    def around(self, values: np.ndarray) -> np.ndarray:
        """The largest of values of the facets that share a node with each, shape (f,)."""
        at_node = np.zeros(self.num_nodes)
        np.maximum.at(at_node, self.facets.ravel(), np.repeat(values, self.dim))
        return at_node[self.facets].max(axis=1, initial=0.0)

    def checked(self, x: np.ndarray) -> np.ndarray:
        """Positions of the nodes, shape (num_nodes, dim), m.

        Raises:
            ValueError: they are not finite, or do not fit.
        """
        x = np.ascontiguousarray(x, dtype=float)
        expected = (self.num_nodes, self.dim)
        if x.shape != expected or not np.isfinite(x).all():
            raise ValueError(
                f"Positions should be finite and of shape {expected}, got {x.shape}"
                + (", not all finite." if x.shape == expected else ".")
            )
        return x

    @staticmethod
    def _crossed(corner: np.ndarray) -> np.ndarray:
        return np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
