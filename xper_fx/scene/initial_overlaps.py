# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid bodies that overlap at the start: reported, or moved apart on request.

They are moved apart by the least motion (`nscd/separation.py`), in rounds.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from xper_fx.nscd.rigid.bodies import RigidBodies
from xper_fx.nscd.rigid.motion import RigidMotion
from xper_fx.nscd.search.search_of_bodies import search_of_bodies

if TYPE_CHECKING:
    from xper_fx.nscd.separation import Separation

# Depth that counts as touching, relative to the smallest body.
_TOUCHING = 1e-6
# Rounds after which bodies are too crowded.
_ROUNDS = 100
# Overlaps that a message names.
_NAMED = 10


def separate(
    bodies: RigidBodies,
    pairs: Sequence[tuple[str, str]],
    resolve: bool,
    apart: np.ndarray,
    left: np.ndarray | None,
    lattice: np.ndarray | None,
) -> None:
    """Make sure that bodies that may touch do not overlap.

    Args:
        bodies: the bodies; with `resolve` their positions and rotations are changed.
        pairs: names of groups that may touch.
        resolve: whether to move apart what overlaps.
        apart: pairs of bodies that may overlap, as of `RigidSearch`.
        left: which bodies a run has left as they are, among which overlaps are no mistake, shape
            (n,); None without a run.
        lattice: period vectors as rows, shape (p, dim), m; None without a periodic cell.

    Raises:
        ValueError: bodies overlap, are one body given twice, or could not be moved apart.
    """
    smallest = float(bodies.shapes.bounding_radius.min())
    if not np.isfinite(smallest):
        return
    search = search_of_bodies(bodies, pairs, _TOUCHING * smallest, apart, lattice)
    separation = None
    if resolve:
        from xper_fx.nscd.separation import Separation

        separation = Separation(bodies, pairs, apart, lattice)
    for _ in range(_ROUNDS if resolve else 1):
        overlaps = search.overlaps(bodies.position, bodies.rotation, _TOUCHING * smallest)
        if left is not None and not resolve:
            overlaps = [found for found in overlaps if not left[list(found[:2])].all()]
        if not overlaps:
            return
        if separation is not None:
            _move_apart(bodies, separation)
    _refuse_twins(bodies, overlaps)
    deepest = sorted(overlaps, key=lambda overlap: -overlap[2])[:_NAMED]
    named = "; ".join(f"{i} and {j} by {depth:.3g} m" for i, j, depth in deepest)
    more = f", and {len(overlaps) - len(deepest)} more" if len(overlaps) > len(deepest) else ""
    advice = (
        f"they could not be moved apart in {_ROUNDS} rounds: give them more room"
        if resolve
        else "place them apart, or ask for it with resolve_overlaps=True"
    )
    raise ValueError(f"Rigid bodies overlap at the start: {named}{more}; {advice}.")


def _refuse_twins(bodies: RigidBodies, overlaps: Sequence[tuple[int, int, float]]) -> None:
    """Name two bodies of one shape that are in one place, which are one body given twice."""
    tables = bodies.shapes

    def shape(body: int) -> list:
        """Numbers that tell the pieces of a body."""
        told = []
        for piece in np.flatnonzero(tables.body == body):
            entry = tables.entry[piece]
            corners = tables.vertices[slice(*tables.vertex_offsets[[entry, entry + 1]])]
            told += [tables.kind[piece], tables.radius[piece], *tables.offset[piece]]
            told += [] if entry < 0 else corners.ravel().tolist()
        return told

    for i, j, _ in overlaps:
        size = bodies.bounding_radius[[i, j]].min()
        apart = np.linalg.norm(bodies.position[i] - bodies.position[j])
        if apart <= _TOUCHING * size and shape(i) == shape(j):
            raise ValueError(
                f"Rigid bodies {i} and {j} are of the same shape at the same place, "
                f"{bodies.position[i].tolist()} m, as if one body were given twice: leave one out, "
                "or place it elsewhere."
            )


def _move_apart(bodies: RigidBodies, separation: Separation) -> None:
    """One round."""
    contacts = separation.find(bodies.position, bodies.rotation)
    blocks = RigidMotion(bodies).blocks
    moved = separation.motion(contacts, contacts.gap, bodies.position, blocks)
    bodies.position += moved[:, 0]
    if bodies.dim == 2:
        bodies.rotation += moved[:, 1, 0]
    else:
        turn = Rotation.from_rotvec(moved[:, 1]).as_matrix()
        bodies.rotation[:] = turn @ bodies.rotation
