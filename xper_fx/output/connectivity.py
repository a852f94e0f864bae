# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which bodies bonds still hold together.

Two bodies hang together as long as one of the points between them holds. So a facet is broken when
the bonds of all its points are: the search of contacts frees lips by the same rule, and a facet
with a sound point still carries load. A point holds nothing where its bond has spent its share of
the fracture energy or is damaged throughout, and where its law knows contact alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from xper_fx.bodies.meshes import cell_measure
from xper_fx.nscd.point_values import BROKEN
from xper_fx.output.contact_forces import slot_places
from xper_fx.simulation.simulation import Simulation
from xper_fx.simulation.slot_bodies import first_rigid
from xper_fx.support.checks import require_kind, require_number
from xper_fx.support.compat import geometry_dofmap

if TYPE_CHECKING:
    from xper_fx.bodies.spread import Spread

# Masses that differ by less, relative to that of all bodies, are equal.
_EQUAL_DIGITS = 12


def require_share(share: float) -> None:
    """Raise a ValueError unless a share lies in (0, 1], a TypeError unless it is a number."""
    if not 0.0 < require_number("share", share) <= 1.0:
        raise ValueError(f"share should lie in (0, 1], got {share}.")


def find_fragments(simulation: Simulation, share: float = BROKEN) -> npt.NDArray[np.int32]:
    """Which bodies bonds still hold together; all ranks call it together.

    Facing facets and ties hold as long as one of their points does, contacts that were found only
    where their law is a bond.

    Args:
        simulation: a run.
        share: of its fracture energy that a broken bond has spent.

    Returns:
        The fragment of each body, shape (num_bodies,), meshed bodies first, then rigid ones. 0 is
        the heaviest, and so on; of equal ones (to 12 digits of the mass of all) the one with the
        smaller number of a body comes first. Rigid bodies without mass, such as walls, belong to
        none, -1. Of a mesh that is spread over ranks it is of each body that the rank knows, and
        bodies are numbered by their labels.

    Raises:
        ValueError: a share out of (0, 1].
        TypeError: no simulation, something that is no number.
    """
    return of_bodies(simulation, find_connected(simulation, share))


class Connected(NamedTuple):
    """Fragments of bodies, by numbers of bodies that all ranks have alike."""

    #: shape (n,), ascending: those of `ContactForces.bodies`; of a mesh that is spread of bodies
    #: that this rank knows, or joins to others
    number: npt.NDArray[np.int64]
    fragment: npt.NDArray[np.int32]  #: shape (n,), as `find_fragments`

    def of(self, numbers: np.ndarray) -> npt.NDArray[np.int32]:
        """Fragments of some bodies, of any shape."""
        return self.fragment[np.searchsorted(self.number, numbers)]


def of_bodies(simulation: Simulation, connected: Connected) -> npt.NDArray[np.int32]:
    """What `find_fragments` gives; all ranks call it together."""
    if spread_of(simulation) is None:
        return connected.fragment
    return connected.of(_known(simulation))


def spread_of(simulation: Simulation) -> Spread | None:
    """How the mesh of a run is spread over ranks, None if it is not."""
    bodies = simulation.scene.bodies
    return None if bodies is None else bodies.spread


def find_connected(simulation: Simulation, share: float) -> Connected:
    """As `find_fragments`."""
    require_kind("simulation", simulation, Simulation)
    require_share(share)
    if spread_of(simulation) is not None:
        return _connected_over_ranks(simulation, share)
    mass = _masses(simulation)
    pairs = _held_pairs(simulation, share)
    pairs = pairs[(mass[pairs] > 0.0).all(axis=1)]
    graph = coo_array((np.ones(len(pairs)), tuple(pairs.T)), shape=2 * (len(mass),))
    _, label = connected_components(graph, directed=False)
    _, first, label = np.unique(label, return_index=True, return_inverse=True)
    weight = np.bincount(label, mass)
    weight = np.round(weight / max(weight.sum(), np.finfo(float).tiny), _EQUAL_DIGITS)
    rank = np.empty(len(weight), np.int32)
    rank[np.lexsort((first, -weight))] = np.arange(len(weight))
    return Connected(np.arange(len(mass)), np.where(mass > 0.0, rank[label], np.int32(-1)))


def _connected_over_ranks(simulation: Simulation, share: float) -> Connected:
    """Of a mesh that is spread."""
    from xper_fx.output.divided_fragments import number_fragments

    bodies, known, mass = simulation.scene.bodies, _known(simulation), _masses(simulation)
    ranks, held = bodies.spread.ranks, _held_pairs(simulation, share)
    walls = known[mass == 0.0]
    held = held[~np.isin(held, walls).any(axis=1)]
    named = simulation.model.points.bodies_of_own_points(), held, known[mass > 0.0]
    number = np.unique(np.concatenate([part.ravel() for part in named]))
    # bodies count where they are, rigid ones on one rank
    on_rank = np.concatenate([bodies.spread.rank_of_body, 0 * known[bodies.num_bodies :]])
    own = (on_rank == ranks.rank) & (mass > 0.0)
    of_own = np.zeros(len(number))
    of_own[np.searchsorted(number, known[own])] = mass[own]
    pairs = np.searchsorted(number, held)
    fragment = number_fragments(ranks, number, pairs, of_own, _EQUAL_DIGITS)
    place = np.searchsorted(number, walls)
    return Connected(np.insert(number, place, walls), np.insert(fragment, place, -1))


def _known(simulation: Simulation) -> np.ndarray:
    """Numbers of the bodies that a rank knows of a mesh that is spread, then of rigid ones."""
    solids = first_rigid(simulation) + np.arange(len(simulation.scene.rigid))
    return np.concatenate([simulation.scene.bodies.labels, solids])


def _masses(simulation: Simulation) -> np.ndarray:
    """Mass of each body, meshed ones first, shape (num_bodies,), kg (2D: kg/m)."""
    bodies, parts = simulation.scene.bodies, []
    if bodies is not None:
        mesh = bodies.mesh
        measure = cell_measure(mesh.topology.cell_name(), mesh.geometry.x[geometry_dofmap(mesh)])
        for tag, material in simulation.scene.materials.items():
            measure[bodies.material_of_cell == tag] *= material.density
        parts.append(np.bincount(bodies.body_of_cell, measure, minlength=bodies.num_bodies))
    if simulation.rigid is not None:
        parts.append(simulation.rigid.bodies.mass)
    return np.concatenate(parts)


def _held_pairs(simulation: Simulation, share: float) -> np.ndarray:
    """Pairs of bodies between which a point holds, shape (n, 2).

    Of a mesh that is spread those of this rank's points.
    """
    points, spread = simulation.interactions, spread_of(simulation) is not None
    of_scene = simulation.model.points
    pairs = of_scene.bodies_of_own_points() if spread else of_scene.bodies_of_points()
    if len(pairs):
        loose = points.local_unbonded() | (points.local("spent") >= share)
        pairs = pairs[~(loose if spread else points.whole(loose))[: len(pairs)]]
    if not any(_is_bond(contact.law, simulation.bulk.dim) for contact in simulation.scene.contacts):
        return pairs
    body, _ = slot_places(simulation)
    found = [np.zeros((0, 2), int)]
    for group in points.contacts:
        holds = ~(group.unbonded() | (group.spent() >= share))
        found.append(body[group.points.nodes[holds, :, 0]])
    everywhere = [np.concatenate(found)]
    if points.halo is not None and not spread:
        everywhere = points.halo.ranks.comm.allgather(everywhere[0])
    return np.concatenate([pairs, *everywhere])


def _is_bond(law, dim: int) -> bool:
    """Whether a law may hold its two sides together."""
    if law is None:
        return False
    kernels = law.kernels(dim)
    return "damage" in kernels.state_names or "impact" not in kernels.energies
