# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid walls whose normal points away from all that may touch them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from xper_fx.nscd.rigid.bodies import RigidBodies
from xper_fx.scene.contact import Contact
from xper_fx.support.ranks import Ranks


def check_walls_look_at_bodies(
    contacts: Sequence[Contact],
    bodies: RigidBodies,
    surfaces: Mapping[str, np.ndarray],
    ranks: Ranks,
) -> None:
    """See that something of what may touch a rigid wall is in front of it at the start.

    Looked at are the centres of rigid bodies that can move, and the nodes of surfaces.

    Args:
        contacts: of the scene, which name groups that there are.
        surfaces: nodes of the meshed bodies of each surface, shape (n, dim), m, by its name.
        ranks: that know nodes of these surfaces; they call it together.

    Raises:
        ValueError: all of it is behind a wall.
    """
    walls = np.flatnonzero(np.isinf(bodies.bounding_radius))
    if not len(walls):
        return
    partners = _partners(contacts)
    moves = ~bodies.is_prescribed.all(axis=1)
    places = {
        name: bodies.position[moves & (bodies.group_of == number)]
        for number, name in enumerate(bodies.groups)
    }
    places |= surfaces
    for wall in walls:
        group = bodies.groups[bodies.group_of[wall]]
        others = [places[name] for name in partners.get(group, ()) if len(places[name])]
        turn = bodies.rotation[wall]
        # the last axis of a wall points out of it
        normal = turn[:, -1] if bodies.dim == 3 else np.array([-np.sin(turn), np.cos(turn)])
        height = [float(((x - bodies.position[wall]) @ normal).max()) for x in others]
        height = ranks.max(max(height, default=-np.inf))
        if -np.inf < height < 0.0:
            told = np.round(normal, 6) + 0.0  # no -0
            raise ValueError(
                f"Rigid body {wall}, a wall of the group {group!r}, is upside down: all bodies "
                f"that may touch it are behind it, at least {-height:.3g} m deep. Its normal "
                f"{told.tolist()} should point out of the wall, towards the bodies; "
                f"turn it round: {(0.0 - told).tolist()}."
            )


def _partners(contacts: Sequence[Contact]) -> dict[str, set[str]]:
    """By group, those that may touch it."""
    partners: dict[str, set[str]] = {}
    for contact in contacts:
        if contact.law is not None:
            for one, other in (contact.between, contact.between[::-1]):
                partners.setdefault(one, set()).add(other)
    return partners
