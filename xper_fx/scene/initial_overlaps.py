# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid bodies that overlap at the start: reported, or moved apart on request.

Moved apart by the contact problem itself, with displacements d in the place of velocities: with w
the inverse of the masses, d = w H r, g + H^T d >= 0, r >= 0, r (g + H^T d) = 0 is the least motion,
in the norm of the mass, that opens the gaps g. Gaps and normals change on the way, hence rounds.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from xper_fx.nscd.facets import no_points
from xper_fx.nscd.found_contacts import FoundPoints
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.laws import SignoriniCoulomb
from xper_fx.nscd.points import InteractionPoints, frame_from_normal
from xper_fx.nscd.rigid.bodies import RigidBodies
from xper_fx.nscd.rigid.motion import RigidMotion
from xper_fx.nscd.search.rigid_search import RigidSearch
from xper_fx.nscd.solvers.nlgs import NonlinearGaussSeidel
from xper_fx.nscd.solvers.solver import SolveOptions

if TYPE_CHECKING:
    from xper_fx.nscd.search.periodic_search import PeriodicSearch

# Depth that counts as touching, relative to the smallest body.
_TOUCHING = 1e-6
# Rounds after which bodies are too crowded, and sweeps of a round.
_ROUNDS, _SWEEPS = 100, 1000
# Overlaps that a message names.
_NAMED = 10


def separate(
    bodies: RigidBodies,
    pairs: Sequence[tuple[str, str]],
    resolve: bool,
    lattice: np.ndarray | None = None,
) -> None:
    """Make sure that bodies that may touch do not overlap.

    Args:
        bodies: the bodies; with `resolve` their positions and rotations are changed.
        pairs: names of groups that may touch.
        resolve: whether to move apart what overlaps.
        lattice: period vectors as rows, shape (p, dim), m; None without a periodic cell.

    Raises:
        ValueError: bodies overlap, are one body given twice, or could not be moved apart.
    """
    smallest = float(bodies.shapes.bounding_radius.min())
    if not np.isfinite(smallest):
        return
    search = _search(bodies, pairs, _TOUCHING * smallest, lattice)
    for _ in range(_ROUNDS if resolve else 1):
        overlaps = search.overlaps(bodies.position, bodies.rotation, _TOUCHING * smallest)
        if not overlaps:
            return
        if resolve:
            _move_apart(bodies, search)
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


def _search(
    bodies: RigidBodies, pairs: Sequence[tuple[str, str]], reach: float, lattice: np.ndarray | None
) -> RigidSearch | PeriodicSearch:
    if lattice is None:
        return RigidSearch(bodies, pairs, reach)
    from xper_fx.nscd.search.periodic_search import PeriodicSearch

    return PeriodicSearch(bodies, pairs, reach, lattice)


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


def _move_apart(bodies: RigidBodies, search: RigidSearch | PeriodicSearch) -> None:
    """One round."""
    dim, count = bodies.dim, len(bodies)
    contacts = search.find(bodies.position, bodies.rotation)
    prediction = RigidMotion(bodies)
    prediction.predict(1.0, 1.0, 0.0)
    rest = np.zeros((2 * count, dim))
    layer = Interactions(
        no_points(dim), [SignoriniCoulomb(contact="position")], np.zeros(0, int),
        BodyInverse.from_uniform(np.zeros((0, dim, dim)), dim), rigid_blocks=prediction.blocks,
    )  # fmt: skip
    layer.take_rigid(rest, rest)
    sides = np.ones(contacts.nodes.shape)
    centre = bodies.position[contacts.body]
    if not isinstance(search, RigidSearch):
        centre += search.offset
    points = InteractionPoints(
        (2 * contacts.body[:, :, None]).astype(np.int32), sides, frame_from_normal(contacts.normal),
        contacts.area, contacts.gap, contacts.point[:, None] - centre,
    )  # fmt: skip
    found = FoundPoints(points, np.zeros(len(points), int), contacts.key)
    layer.find_contacts([found], np.zeros((0, dim)), 1.0, 1.0)
    layer.begin_step(1.0, 1.0)
    moved = layer.free_velocities(np.zeros((0, dim)))
    options = SolveOptions(tolerance=1e-3, max_sweeps=_SWEEPS)
    NonlinearGaussSeidel().solve(layer, moved, options)
    moved = layer.rigid_part(moved).reshape(count, 2, dim)
    bodies.position += moved[:, 0]
    if dim == 2:
        bodies.rotation += moved[:, 1, 0]
    else:
        turn = Rotation.from_rotvec(moved[:, 1]).as_matrix()
        bodies.rotation[:] = turn @ bodies.rotation
