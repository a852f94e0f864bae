# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which contacts a tool may close on its way through a static step.

A contact that is still open is closed by its plane, n . d < -g for a way d of the tool. At a corner
n is where the corner happens to lie from the node: a tool that goes past it at a distance would be
held by a plane that it never meets. So the search is made where the tool goes, too, and an open
contact counts if the two touch there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from xper_fx.nscd.rigid.motion import Prediction
    from xper_fx.nscd.search.contact_pairs import Contacts
    from xper_fx.nscd.search.surface_search import SurfaceSearch

# Parts of the way at which tools are looked at, and gap beside the reach that counts as closed.
_PLACES, _NEAR = (0.25, 0.5, 0.75, 1.0), 0.04


def surface_contacts(
    search: SurfaceSearch, x: np.ndarray, rigid: Prediction | None, ahead: float
) -> Contacts:
    """The contacts of surfaces, without those of tools that are open and stay so.

    Args:
        x: positions of the nodes, shape (num_nodes, dim), m.
        rigid: of the rigid bodies, None without any.
        ahead: time for which driven tools go on (s), 0 where bodies have inertia.
    """
    if rigid is None:
        return search.find(x, None, None)
    if ahead == 0.0:
        return search.find(x, rigid.position, rigid.rotation)
    way, near = ahead * rigid.free if rigid.way is None else rigid.way, _NEAR * search.reach
    soon = []
    for part in _PLACES:
        place = rigid.position + part * way[0::2]
        there = search.find(x, place, _turned(rigid.rotation, part * way[1::2]))
        soon.append(there.key[there.gap <= near, 0])
    # last, as nodes of a spread mesh are numbered as the last search knows them
    contacts = search.find(x, rigid.position, rigid.rotation)
    counts = ~np.any(contacts.body >= 0, axis=1) | (contacts.gap <= near)
    counts |= np.isin(contacts.key[:, 0], np.concatenate(soon))
    return contacts.take(np.flatnonzero(counts))


def _turned(rotation: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Angles, or matrices turned by rotation vectors."""
    if rotation.ndim == 1:
        return rotation + by[:, 0]
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(by).as_matrix() @ rotation
