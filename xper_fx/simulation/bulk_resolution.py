# SPDX-License-Identifier: LGPL-3.0-or-later
r"""How well a mesh resolves the stress of the bulk: recovery of the stress at the vertices.

The stress of linear simplices jumps from cell to cell; its mean over the cells that meet at a
vertex, weighted by their measures, is one order better there. The distance of the two,

    eta^2 = d / (d + sum int s : C^-1 s),    d = sum int (s* - s) : C^-1 (s* - s)  over the cells,

estimates the error in the energy norm (Zienkiewicz and Zhu 1987). s* is linear in a cell, and means
are taken over cells of one material that hang together around the vertex: in one body, or joined by
bonds that have not spent their fracture energy. Energies err by eta^2.
"""

from __future__ import annotations

import numpy as np
from dolfinx import fem
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from xper_fx.bodies.explode import Bodies
from xper_fx.nscd.point_values import BROKEN
from xper_fx.simulation.readings import Readings
from xper_fx.support.compat import geometry_dofmap

# Cells whose stress is constant, of linear displacements.
_SIMPLICES = ("triangle", "tetrahedron")
# Elastic energy that is rounding beside what bodies have and were given, as that of one in flight.
_ROUNDING = 1e-20


def bulk_resolution(simulation: Readings) -> float | None:
    """eta: the relative error of the stresses in the energy norm, at the present state.

    Args:
        simulation: a run of simplices of order 1 whose materials have Young's moduli.

    Returns:
        0 without stress; None where the estimate does not hold.
    """
    model = simulation.model
    bodies, materials = model.scene.bodies, model.scene.materials
    if bodies is None or model.scene.order != 1:
        return None
    elastic = all(hasattr(m, "young") and hasattr(m, "poisson") for m in materials.values())
    if bodies.mesh.topology.cell_name() not in _SIMPLICES or not elastic:
        return None
    simulation.displacement  # noqa: B018  brings the state into the forms
    stress, part = model.bulk.forms.stress_evaluator(initial=False)(), model.part
    own: slice | np.ndarray = slice(None)
    if bodies.spread is not None:
        own, stress = part.cells, _of_known(bodies, part.cells, stress)
    elif part is not None:
        stress = model.ranks.gather(part.cells, stress)
    measure = _measures(bodies)
    V = model.bulk.forms.V if part is None else fem.functionspace(bodies.mesh, ("Lagrange", 1))
    group = _groups(bodies, V, _joined(simulation))
    ends = np.arange(len(group) + 1) * group.shape[1]
    takes_part = csr_array((np.repeat(measure, group.shape[1]), group.ravel(), ends))
    size = takes_part.sum(axis=0)
    recovered = takes_part.T @ stress.reshape(-1, 9) / np.where(size > 0.0, size, 1.0)[:, None]
    at_vertices = recovered.reshape(-1, 3, 3)[group]
    moduli = np.empty((2, len(measure)))
    for tag, material in materials.items():
        moduli[:, bodies.material_of_cell == tag] = [[material.young], [material.poisson]]
    of_own = measure[own], *moduli[:, own]
    distance = _energy((at_vertices - stress[:, None])[own], *of_own)
    energy = distance + _energy(stress[own, None], *of_own)
    if bodies.spread is not None:
        distance, energy = model.ranks.sum(np.array([distance, energy]))
    e = model.ledger.energies
    some = energy > _ROUNDING * (e.kinetic + abs(e.external_work))
    return float(np.sqrt(distance / energy)) if some else 0.0


def _measures(bodies: Bodies) -> np.ndarray:
    """Area or volume of each cell, shape (num_cells,)."""
    corners = bodies.mesh.geometry.x[geometry_dofmap(bodies.mesh)]
    dim = bodies.mesh.geometry.dim
    edges = (corners[:, 1:] - corners[:, :1])[:, :dim, :dim]
    return np.abs(np.linalg.det(edges)) / (2.0 if dim == 2 else 6.0)


def _of_known(bodies: Bodies, cells: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values of all cells that a rank knows of a mesh that is spread, from those of its own.

    Args:
        cells: the rank's own, shape (n,).
        values: of these, shape (n, ...).
    """
    from xper_fx.bodies.keepers import Keepers

    keepers = Keepers(bodies.spread.ranks, bodies.parent_cell)
    known = np.zeros((len(bodies.parent_cell), *values.shape[1:]))
    known[cells] = values
    return keepers.answer(keepers.sum(known))  # a cell is the own of one rank


def _joined(simulation: Readings) -> np.ndarray:
    """Facing facets whose bonds hold, shape (n,); contacts and broken ones do not."""
    number, points = simulation.facets_with_law, simulation.model.points
    if simulation.interactions is None:
        return np.zeros(0, int)
    if simulation.scene.bodies.spread is None:
        if not len(number):
            return np.zeros(0, int)
        spent = simulation.interactions.gather("spent")[: points.points_a_facet * len(number)]
        holds = (spent.reshape(len(number), -1) < BROKEN).any(axis=1)
    else:
        from xper_fx.bodies.keepers import Keepers

        place, _ = points.on_facets()
        spent = simulation.interactions.local("spent")[: len(place)]
        here = np.zeros(len(number))
        here[place[spent < BROKEN] // points.points_a_facet] = 1.0
        keepers = Keepers(simulation.model.ranks, points.facet_numbers)
        holds = keepers.answer(keepers.sum(here)) > 0.0
    laws, law = simulation.scene.law_of_facet()
    kernels = [one.kernels(simulation.bulk.dim) for one in laws]
    bonds = np.array([k.no_jump or "stored" in k.energies for k in kernels])
    return number[holds & bonds[law[number]]]


def _groups(bodies: Bodies, V: fem.FunctionSpace, joined: np.ndarray) -> np.ndarray:
    """Number of the mean that each cell's vertices take part in, shape (num_cells, num_vertices).

    Args:
        bodies: the exploded mesh.
        V: space of order 1 on it.
        joined: facing facets across which means go on.
    """
    pairs = V.dofmap.list.astype(np.int64)
    if len(joined):
        nodes = pairs.max() + 1
        one, other = bodies.facing_nodes(V)[joined].swapaxes(0, 1).reshape(2, -1)
        graph = coo_array((np.ones(len(one)), (one, other)), shape=(nodes, nodes))
        _, cluster = connected_components(graph, directed=False)
        pairs = cluster[pairs].astype(np.int64)
    _, material = np.unique(bodies.material_of_cell, return_inverse=True)
    pairs = pairs * (material.max() + 1) + material[:, None]
    return np.unique(pairs, return_inverse=True)[1].reshape(pairs.shape)


def _energy(
    stress: np.ndarray, measure: np.ndarray, young: np.ndarray, poisson: np.ndarray
) -> float:
    """int s : C^-1 s over cells in which s is linear (2 J; 2D: 2 J/m).

    Args:
        stress: at the vertices, shape (num_cells, n, 3, 3), Pa; n = 1 where it is uniform.
        measure, young, poisson: of the cells, shape (num_cells,).
    """
    n = stress.shape[1]
    # int l_i l_j = measure (1 + delta_ij) / (n (n + 1))
    total = stress.sum(axis=1)
    squares = (stress**2).sum(axis=(1, 2, 3)) + (total**2).sum(axis=(1, 2))
    traces = np.trace(stress, axis1=2, axis2=3)
    pressures = (traces**2).sum(axis=1) + traces.sum(axis=1) ** 2
    density = ((1.0 + poisson) * squares - poisson * pressures) / young
    return float((measure * density).sum() / (n * (n + 1)))
