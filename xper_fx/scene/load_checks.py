# SPDX-License-Identifier: LGPL-3.0-or-later
"""Whether loads fit a scene, and do not contradict each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from numbers import Integral

import numpy as np
from dolfinx.mesh import CellType, entities_to_geometry

from xper_fx.bodies.explode import Bodies
from xper_fx.bodies.meshes import facet_cells
from xper_fx.forms.loads import (
    BodyForce,
    Gravity,
    InitialStress,
    PrescribedDisplacement,
    PrescribedVelocity,
    SurfaceTraction,
    nodes_that_move,
    value_at,
    vector_at,
)
from xper_fx.materials.material import InelasticMaterial, Material
from xper_fx.scene.wall import Wall
from xper_fx.support.checks import refuse_expression, require_number
from xper_fx.support.ranks import Ranks

Motion = PrescribedVelocity | PrescribedDisplacement
# Forces from which on their works are infinite.
_LARGEST = 1e150
_OF_TIME = "a number or a function of time (s), as `lambda t: float(constant)`"
Load = BodyForce | Gravity | SurfaceTraction | InitialStress | Motion


def check_loads(loads: Sequence[Load], dim: int) -> None:
    """See that loads have numbers, and as many as they should.

    Args:
        loads: of the scene.

    Raises:
        ValueError: a wrong number of components, a value that is not finite, a displacement that
            does not start at zero.
        TypeError: something that is no load; an expression of UFL.
    """
    for load in loads:
        if not isinstance(load, Load):
            raise TypeError(f"{load!r} is no load; forms/loads.py has those there are.")
        if isinstance(load, InitialStress):
            continue  # with the mesh, `check_initial_stresses`
        name, values = type(load).__name__, (load.value,)
        for value in (load.value, *(load.value if isinstance(load.value, list | tuple) else ())):
            refuse_expression(f"The value of {name}", value, _OF_TIME)
        if not isinstance(load, Motion):
            values = load.value
            if callable(values) and not isinstance(values, type):
                try:
                    values = vector_at(values, 0.0, dim)
                except (TypeError, ValueError) as error:
                    error.add_note(f"{name} is a function of time that gives {dim} components.")
                    raise
            if (
                not isinstance(values, Sequence | np.ndarray)
                or len(values) != dim
                or any(np.ndim(value) for value in values)
            ):
                raise ValueError(
                    f"{name} has the value {load.value!r}; it should have {dim} "
                    "components, one a dimension of the scene, or be a function of time that gives "
                    "them."
                )
        elif not (isinstance(load.component, Integral) and 0 <= load.component < dim):
            raise ValueError(
                f"{name} on tag {load.facets} has component {load.component}; it should be "
                f"0 to {dim - 1}."
            )
        for value in values:
            start = value_at(value, 0.0) if callable(value) else value
            if not np.isfinite(require_number(f"The value of {load}", start)):
                raise ValueError(f"{load} has the value {value}; it should be finite.")
            if not isinstance(load, Motion) and abs(start) > _LARGEST:
                raise ValueError(
                    f"{load} has the value {value}, whose square is beyond the range of floats; "
                    "it should be finite and below 1e150."
                )
        if isinstance(load, PrescribedDisplacement) and value_at(load.value, 0.0) != 0.0:
            raise ValueError(
                f"{name} on tag {load.facets} is {value_at(load.value, 0.0)} m at the start, "
                "where displacements are zero; give a function of time that starts at zero."
            )


def check_initial_stresses(
    loads: Sequence[Load], bodies: Bodies, materials: Mapping[int, Material | InelasticMaterial]
) -> None:
    """See that initial stresses are stresses wherever there are bodies, and materials take them.

    Args:
        loads, bodies, materials: of the scene.

    Raises:
        ValueError: a stress that is none, a material that is not linear elastic.
    """
    given = [load for load in loads if isinstance(load, InitialStress)]
    for load in given:
        load.at(bodies.mesh.geometry.x.T, bodies.mesh.geometry.dim)
    others = [tag for tag, material in materials.items() if not material.linear]
    if given and others:
        raise ValueError(
            "An InitialStress is added to the stress of linear elastic materials; the one of cell "
            f"tag {others[0]} is {materials[others[0]]!r}, whose answer depends on the whole "
            "stress: load it by forces and motions in a first part of the run."
        )


def check_motions(loads: Sequence[Load], bodies: Bodies, order: int) -> None:
    """See that motions which share a node and a component are the same motion.

    Args:
        loads: of the scene, motions among them.
        order: of the elements.

    Raises:
        ValueError: two that are not.
        TypeError: a `where` that gives no booleans.
    """
    motions = [load for load in loads if isinstance(load, Motion)]
    moved = [_nodes_moved(motion, bodies, order) for motion in motions]
    for a, first in enumerate(motions):
        for b, second in enumerate(motions[a + 1 :], a + 1):
            same = type(first) is type(second) and first.value == second.value
            if first.component != second.component or same:
                continue
            if moved[a] & moved[b]:
                raise ValueError(
                    f"{first} and {second} prescribe the same component of the same nodes; "
                    "let their facets be apart or give both the same value."
                )


def check_places(loads: Sequence[Load], bodies: Bodies, order: int, ranks: Ranks) -> None:
    """See that motions whose facets occur move nodes; ranks that share a mesh call it together.

    Args:
        loads: of the scene, motions among them, each of which a rank can take by itself.
        order: of the elements.
        ranks: that share the mesh.

    Raises:
        ValueError: a `where` that holds at no node.
    """
    for motion in loads:
        if isinstance(motion, Motion) and motion.where is not None:
            if not ranks.sum(len(_nodes_moved(motion, bodies, order))):
                raise ValueError(
                    f"The `where` of {type(motion).__name__} on tag {motion.facets}, component "
                    f"{motion.component}, holds at no node of its facets; positions carry "
                    "rounding: prefer `np.isclose(x[0], 0)` to `x[0] == 0`."
                )


def _nodes_moved(motion: Motion, bodies: Bodies, order: int) -> set[tuple[int, int]]:
    """Nodes that a motion moves, each by dimension and number of what it is in the middle of.

    Elements of order 2 have nodes in the middle of edges, and of faces but for triangles.
    """
    mesh, fdim = bodies.mesh, bodies.mesh.topology.dim - 1
    facets = bodies.facet_tags.find(motion.facets)
    last = 0 if order == 1 else fdim
    if mesh.topology.cell_type == CellType.tetrahedron:
        last = min(last, 1)
    nodes, places = [], [np.zeros((0, 3))]
    for dim in range(last + 1):
        entities = facets
        if dim < fdim:
            mesh.topology.create_connectivity(fdim, dim)
            of_facet = mesh.topology.connectivity(fdim, dim)
            links = [of_facet.links(facet) for facet in facets]
            entities = np.unique(np.concatenate([np.zeros(0, np.int32), *links]))
        if not len(entities):  # on another rank
            continue
        mesh.topology.create_connectivity(dim, mesh.topology.dim)
        corners = entities_to_geometry(mesh, dim, entities).reshape(len(entities), 2**dim)
        nodes += [(dim, entity) for entity in entities.tolist()]
        places.append(mesh.geometry.x[corners].mean(axis=1))
    there = nodes_that_move(motion, np.concatenate(places).T)
    return {node for node, moves in zip(nodes, there.tolist(), strict=True) if moves}


def check_outer(loads: Sequence[Load], walls: Sequence[Wall], bodies: Bodies) -> None:
    """See that tractions and walls are on facets that have a side without the same body.

    Args:
        loads, walls: of the scene, whose tags occur.

    Raises:
        ValueError: a tag of facets inside of bodies, where nothing can act.
    """
    items = [*walls, *(load for load in loads if isinstance(load, SurfaceTraction))]
    if not items:
        return
    inside = facet_cells(bodies.mesh)[0][:, 1] >= 0
    for item in items:
        facets = bodies.facet_tags.find(item.facets)
        if count := int(inside[facets].sum()):
            raise ValueError(
                f"{type(item).__name__} names facet tag {item.facets}, of whose {len(facets)} "
                f"facets {count} lie inside of a body, where it cannot act; tag outer facets only."
            )
