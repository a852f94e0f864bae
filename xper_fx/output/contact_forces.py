# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where found contacts are, between which bodies, and with what force: chains of forces."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from xper_fx.simulation.simulation import Simulation
from xper_fx.simulation.slot_bodies import body_of_slot, rigid_here
from xper_fx.support.checks import require_kind


class ContactForces(NamedTuple):
    """The contacts that pushed in a step, one row a point.

    Attributes:
        bodies: candidate and antagonist, shape (n, 2), int. Meshed bodies have the numbers they
            have in `Scene.bodies`, rigid ones come after them; of a mesh that is spread over ranks,
            their labels, after the largest of which rigid ones are numbered.
        position: of the point, shape (n, dim), m; to first order in the step. In a periodic cell
            of rigid bodies it is that at the candidate's image in the cell at the origin.
        normal: from antagonist to candidate, shape (n, dim).
        force: of the antagonist on the candidate, mean over the step, shape (n, dim), N (2D: N/m).
        couple: the same of what resists rolling, shape (n, 1) in 2D and (n, 3) in 3D, N m (2D:
            N m/m); zero where the law does not resist.
    """

    bodies: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    force: np.ndarray
    couple: np.ndarray


def find_contact_forces(simulation: Simulation) -> ContactForces:
    """Read the contacts that searches found in the last step, those of all ranks on each.

    Args:
        simulation: after a step. Facing facets that a law joins from the start are not among its
            contacts until their lips have parted.

    Raises:
        TypeError: no simulation.
    """
    require_kind("simulation", simulation, Simulation)
    dim, interactions = simulation.bulk.dim, simulation.interactions
    body, place = slot_places(simulation)
    none, turns = np.empty((0, dim)), 1 if dim == 2 else 3
    parts = [ContactForces(np.empty((0, 2), int), none, none, none, np.empty((0, turns)))]
    rolling = {} if interactions is None else {id(g.details): g for g in interactions.rolling}
    for group in [] if interactions is None else interactions.contacts:
        pushes = np.flatnonzero(group.impulse[:, 0] > 0.0)
        points = group.points.take(pushes)
        sides = np.einsum("nsk,nskd->nsd", points.weights, place[points.nodes])
        if points.lever_arms is not None:
            sides += points.lever_arms
        if simulation.scene.lattice is not None:  # the antagonist may be an image
            sides = sides[:, :1]
        impulse = np.einsum("nc,ncd->nd", group.impulse[pushes], points.frame)
        couple = np.zeros((len(pushes), turns))
        if id(group.impulse) in rolling:
            beside = rolling[id(group.impulse)]
            turned = np.einsum("nc,ncd->nd", beside.impulse, beside.couplings.frame)
            couple = turned[pushes, :turns]
        parts.append(
            ContactForces(
                body[points.nodes[:, :, 0]],
                sides.mean(axis=1),
                points.frame[:, 0],
                impulse / interactions.committed_step,
                couple / interactions.committed_step,
            )
        )
    if interactions is not None and interactions.halo is not None:
        everywhere = interactions.halo.ranks.comm.allgather(parts)
        parts = [part for there in everywhere for part in there]
    return ContactForces(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def slot_places(simulation: Simulation) -> tuple[np.ndarray, np.ndarray]:
    """Body and present place of each slot; a rigid body's centre stands in both of its own.

    All ranks call it together, as `body_of_slot`.

    Returns:
        Numbers as those of `ContactForces.bodies`, shape (num_slots,); (num_slots, dim), m.
    """
    dim = simulation.bulk.dim
    place = np.empty((0, dim))
    if simulation.scene.bodies is not None:
        x = simulation.forms.V.tabulate_dof_coordinates()[:, :dim]
        moved = simulation.displacement.x.array.reshape(-1, dim)
        place = (x + moved)[simulation.model.slot_nodes]
    if simulation.rigid is not None:
        centre = simulation.rigid.displayed.position[rigid_here(simulation)]
        place = np.concatenate([place, np.repeat(centre, 2, axis=0)])
    if simulation.part is not None:
        place = simulation.interactions.halo.with_ghost_values(place)
    return body_of_slot(simulation), place
