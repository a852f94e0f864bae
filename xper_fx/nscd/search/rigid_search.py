# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts between rigid bodies, step after step.

Lists (Verlet 1967) hold the pairs that can touch soon: those whose gap was at most reach + skin
when the list was made. With d_i the largest displacement of a point of body i since then, measured
in axes that move with the mean of all bodies, the gap of a pair has shrunk by d_i + d_j at most: as
long as the two largest d add up to no more than the skin no contact is missed, and the list stays.

The skin is what costs least. With s the rate, per search, at which the two largest d grow, D a
body's distance from its neighbours, p pairs looked at by each search and k the price of a pair in
the making of a list over that in a search, a search costs p (1 + k s / skin) with
p ~ (1 + skin/D)^dim, least where

    dim skin^2 + (dim - 1) k s skin - k s D = 0.

Walls have no boxes: each is looked at with every body it may touch, one scalar product a search.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.nscd.rigid.bodies import RigidBodies, ShapeTables, plane_rotations
from xper_fx.nscd.rigid.shapes import DISC, HALF_PLANE, HALF_SPACE, SPHERE, check_positive
from xper_fx.nscd.search.contact_buffer import Corners, collect
from xper_fx.nscd.search.contact_pairs import Contacts
from xper_fx.nscd.search.coplanar import without_flats
from xper_fx.nscd.search.grid import labelled_box_pairs
from xper_fx.nscd.search.polygons import disc_polygon, polygon_polygon, polygon_wall
from xper_fx.nscd.search.polyhedra import polyhedron_polyhedron, polyhedron_wall, sphere_polyhedron
from xper_fx.nscd.search.spheres import ball_ball, ball_wall

# Price of a pair in the making of a list and, by kinds and dimension, in a search, in units of two
# discs in a search, as benchmarks/contact_search.py measures them (one unit: about 30 ns).
_PRICE_OF_LIST = 10.0
_PRICES = {
    2: {"ball_ball": 1.0, "ball_corner": 3.0, "corner_corner": 10.0},
    3: {"ball_ball": 1.0, "ball_corner": 5.0, "corner_corner": 45.0},
}
# Bounds of the skin, and where it starts, as shares of D.
_SKIN_BOUNDS = (1e-3, 1.0)
FIRST_SKIN = 0.1


@njit(**LEAN_ENTRY)
def _turn(entry, offsets, own, bodies, rotation, start, turned):
    """Turn the vectors of bodies, one rotation each.

    Those of the entry s of tables are `own[offsets[s]:offsets[s + 1]]`, and those of body b
    `turned[start[b]:start[b + 1]]`.
    """
    dim = rotation.shape[1]
    for k in range(len(bodies)):
        b = bodies[k]
        first = offsets[entry[b]] - start[b]
        for v in range(start[b], start[b + 1]):
            for d in range(dim):
                turned[v, d] = 0.0
                for e in range(dim):
                    turned[v, d] += rotation[k, d, e] * own[first + v, e]


def _motion(moved, turned, rotation, old_rotation, bounding_radius):
    """Sum of the two largest displacements of points of bodies, about the mean displacement.

    A body has been moved by `moved`, and has the rotation `turned`, or none that matters if that is
    negative. A rotation by phi moves a point at the radius R by 2 sin(phi/2) R, which in 2D and 3D
    is |rotation - old_rotation| R / sqrt(2) in the Frobenius norm.
    """
    away = moved - np.add.reduce(moved) / len(moved)
    length = np.sqrt(np.einsum("nd,nd->n", away, away))
    turns = (turned >= 0).nonzero()[0]
    at = turned[turns]
    change = rotation[at] - old_rotation[at]
    turning = np.sqrt(0.5 * np.einsum("nde,nde->n", change, change))
    length[turns] += turning * bounding_radius[turns]
    length.sort()
    return float(np.add.reduce(length[-2:]))


def _matrices(rotation: np.ndarray) -> np.ndarray:
    """Rotations as matrices, from angles in 2D."""
    return rotation if rotation.ndim == 3 else plane_rotations(rotation)


def _starts(tables: ShapeTables, offsets: np.ndarray) -> np.ndarray:
    """First place of each body's own copy of its entry."""
    lengths = np.append(np.diff(offsets), 0)[tables.entry]  # entry -1: none
    return np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)


class RigidSearch:
    """Search of contacts between rigid bodies.

    What is searched are the convex pieces of the bodies, one a body but for clusters; those of one
    body do not touch each other. Candidate and antagonist: the lower number of the two for two
    pieces of a kind; a disc or sphere is the candidate on a polygon or polyhedron, and everything
    on a wall. The pair's part of the key is i * num_pieces + j with i < j, below num_pieces^2.

    Attributes:
        reach: largest gap of a contact (m).
        skin: m, of the list in use.
        renewals: how often the list has been made.
        searches: how often contacts have been looked for.
        num_candidates: pairs in the list, walls' pairs left out.

    Args:
        pairs: names of groups that may touch, (a, b) or (a, a). Bodies all of whose degrees of
            freedom are prescribed do not touch each other.
        reach: largest gap of a contact (m), positive.
        apart: pairs of bodies that do not touch all the same, shape (n, 2), int.

    Raises:
        ValueError: a group that no body has, or a reach that is not a finite positive number.
    """

    def __init__(
        self,
        bodies: RigidBodies,
        pairs: Sequence[tuple[str, str]],
        reach: float,
        apart: np.ndarray | None = None,
    ):
        self.reach = check_positive("The reach (m)", reach)
        tables = without_flats(bodies.shapes)
        self._tables = tables
        self._dim = bodies.dim
        self._size, count = (len(bodies), self._dim), len(tables.kind)
        self._in_parts = count > len(bodies)
        self._apart = None if apart is None or not len(apart) else self._number(apart)
        label, self._allowed = _labels(bodies, pairs)
        self._label = label[tables.body]
        self._is_ball = np.isin(tables.kind, (DISC, SPHERE))
        is_wall = np.isin(tables.kind, (HALF_PLANE, HALF_SPACE))
        meets = self._allowed.any(axis=1)[self._label]
        self._listed = np.flatnonzero(~is_wall & meets)
        self._walls = np.flatnonzero(is_wall & meets)
        self._wall_pairs = self._pairs_with_walls()
        self._wall_normal = np.zeros((count, self._dim))

        vertex_start = _starts(tables, tables.vertex_offsets)
        face_start = _starts(tables, tables.face_offsets)
        self._corners = Corners(
            vertex_start,
            face_start,
            np.zeros((vertex_start[-1], self._dim)),
            np.zeros((face_start[-1], self._dim)),
        )
        self._cornered = np.flatnonzero(tables.entry >= 0)
        self._turned = np.full(count, -1)
        self._turned[self._cornered] = np.arange(len(self._cornered))
        self._distance = reach
        if len(self._listed):
            self._distance += 2.0 * float(np.median(tables.bounding_radius[self._listed]))
        self.skin = FIRST_SKIN * self._distance
        self.renewals = self.searches = 0
        self._searches_at_renewal = 0
        none = np.empty((0, 2), np.int32)
        self._lists = {"ball_ball": none, "ball_corner": none, "corner_corner": none}
        self._old_position: np.ndarray | None = None
        self._old_rotation: np.ndarray | None = None
        self._expected = 16
        self._own: Callable[[np.ndarray], np.ndarray] | None = None
        self._searched = self._lists | self._wall_pairs

    def divide(self, own: Callable[[np.ndarray], np.ndarray]) -> None:
        """Search a part of the pairs only, as others search the rest.

        Args:
            own: called with the bodies of each pair, shape (n, 2), whenever they have been listed
                anew; gives which of them to search, shape (n,), bool.
        """
        self._own = own

    def search_all(self) -> None:
        """Search all pairs until they are listed anew."""
        self._searched = self._lists | self._wall_pairs

    @property
    def num_candidates(self) -> int:
        """Pairs in the list."""
        return sum(len(pairs) for pairs in self._lists.values())

    @property
    def nbytes(self) -> int:
        """Memory of the lists, those of walls included, in bytes."""
        held = [*self._lists.values(), *self._wall_pairs.values()]
        return sum(pairs.nbytes for pairs in held)

    def find(self, position: np.ndarray, rotation: np.ndarray) -> Contacts:
        """The contacts whose gap is no larger than the reach.

        Args:
            position: shape (num_bodies, dim), centres of mass (m).
            rotation: angles (rad), shape (num_bodies,), in 2D; from the axes of the bodies to those
                of space, shape (num_bodies, 3, 3), in 3D.

        Raises:
            ValueError: arrays of another shape, or that are not finite.
        """
        position, rotation = self._tables.place(*self._checked(position, rotation))
        turned = rotation
        self._wall_normal[self._walls] = _matrices(rotation[self._walls])[:, :, -1]
        rotation = _matrices(rotation[self._cornered])
        if len(self._cornered):
            self._turn_corners(rotation)
        self._renew_if_needed(position, rotation)
        self.searches += 1

        tables, corners = self._tables, self._corners
        radius, bounding, wall = tables.radius, tables.bounding_radius, self._wall_normal
        balls, cornered = (position, radius), (position, corners)
        kernels = {"ball_ball": (ball_ball, *balls), "ball_wall": (ball_wall, *balls, wall)}
        if self._dim == 2:
            kernels["ball_corner"] = disc_polygon, *balls, corners
            kernels["corner_corner"] = polygon_polygon, *cornered, bounding
            kernels["corner_wall"] = polygon_wall, *cornered, bounding, wall
        else:
            kernels["ball_corner"] = sphere_polyhedron, *balls, corners, tables
            kernels["corner_corner"] = polyhedron_polyhedron, *cornered, tables, bounding
            kernels["corner_wall"] = polyhedron_wall, *cornered, tables, bounding, wall
        jobs = [
            (kernel, self._searched[name], *arguments, self.reach)
            for name, (kernel, *arguments) in kernels.items()
            if len(self._searched[name])
        ]
        contacts = collect(jobs, self._dim, self._expected)
        self._expected = len(contacts) + len(contacts) // 4 + 16
        if not self._in_parts:
            return contacts
        from xper_fx.nscd.search.whole_clusters import on_the_whole

        piece, *others = on_the_whole(contacts, tables, position, _matrices(turned))
        return Contacts(tables.body[piece], *others)

    def overlaps(
        self, position: np.ndarray, rotation: np.ndarray, tolerance: float = 0.0
    ) -> list[tuple[int, int, float]]:
        """Pairs that penetrate each other by more than the tolerance.

        Args:
            position, rotation: as in `find`.
            tolerance: m.

        Returns:
            (i, j, depth) with i < j and the depth in m, sorted by i and j.
        """
        contacts = self.find(position, rotation)
        deep = contacts.take(np.flatnonzero(contacts.gap < -tolerance))
        pair, inverse = np.unique(np.sort(deep.body, axis=1), axis=0, return_inverse=True)
        depth = np.zeros(len(pair))
        np.maximum.at(depth, inverse.ravel(), -deep.gap)
        return list(zip(*pair.T.tolist(), depth.tolist(), strict=True))

    def _checked(self, position: np.ndarray, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        count, dim = self._size
        position = np.ascontiguousarray(position, dtype=float)
        rotation = np.ascontiguousarray(rotation, dtype=float)
        shapes = (count, dim), ((count,) if dim == 2 else (count, 3, 3))
        if (position.shape, rotation.shape) != shapes:
            raise ValueError(
                f"Positions and rotations of {count} bodies should have the shapes {shapes[0]} and "
                f"{shapes[1]}, got {position.shape} and {rotation.shape}."
            )
        for name, array in (("position", position), ("rotation", rotation)):
            if not np.isfinite(array).all():
                body = int(np.argwhere(~np.isfinite(array))[0, 0])
                raise ValueError(f"The {name} of body {body} is not finite: {array[body]}.")
        return position, rotation

    def _pairs_with_walls(self) -> dict[str, np.ndarray]:
        """Bodies with the walls that they may touch, sorted by the pair's part of the key."""
        others = self._listed
        pairs = [np.empty((0, 2), np.int32)]
        for wall in self._walls:
            own = others[self._allowed[self._label[others], self._label[wall]]]
            pairs.append(np.stack([own, np.full(len(own), wall)], axis=1).astype(np.int32))
        joined = np.concatenate(pairs)
        joined = joined[np.lexsort((joined.max(axis=1), joined.min(axis=1)))]
        joined = self._touching(joined)
        ball = self._is_ball[joined[:, 0]]
        return {"ball_wall": joined[ball], "corner_wall": joined[~ball]}

    def _number(self, bodies: np.ndarray) -> np.ndarray:
        """A number of each pair, whatever the order of its bodies, the ground being one more."""
        return bodies.min(axis=1) * (self._size[0] + 1) + bodies.max(axis=1)

    def _touching(self, pairs: np.ndarray) -> np.ndarray:
        """The pairs of pieces without those of bodies that are kept apart."""
        if self._apart is None:
            return pairs
        bodies = self._tables.body[pairs].astype(np.int64)
        return pairs[~np.isin(self._number(bodies), self._apart)]

    def _turn_corners(self, rotation: np.ndarray) -> None:
        """Take rotations of the bodies that have corners, matrices."""
        tables, corners, bodies = self._tables, self._corners, self._cornered
        vertices = tables.vertex_offsets, tables.vertices
        normals = tables.face_offsets, tables.face_normal
        _turn(tables.entry, *vertices, bodies, rotation, corners.vertex_start, corners.vertex)
        _turn(tables.entry, *normals, bodies, rotation, corners.face_start, corners.normal)

    def _renew_if_needed(self, position: np.ndarray, rotation: np.ndarray) -> None:
        if self._old_position is not None and len(self._listed):
            at = self._listed
            motion = _motion(
                position[at] - self._old_position[at],
                self._turned[at],
                rotation,
                self._old_rotation,
                self._tables.bounding_radius[at],
            )
            if motion <= self.skin:
                return
            self.skin = self._best_skin(motion / (self.searches - self._searches_at_renewal))
        elif self._old_position is not None:
            return
        self._renew(position, rotation)

    def _best_skin(self, speed: float) -> float:
        """The skin of least cost, for a motion (m) per search."""
        dim = self._dim
        searching = sum(_PRICES[dim][name] * len(pairs) for name, pairs in self._lists.items())
        spent = speed * _PRICE_OF_LIST * self.num_candidates / searching if searching else 0.0
        linear = (dim - 1) * spent
        root = np.sqrt(linear**2 + 4.0 * dim * spent * self._distance)
        lowest, highest = (share * self._distance for share in _SKIN_BOUNDS)
        if spent == 0.0:
            return highest
        return float(np.clip((root - linear) / (2.0 * dim), lowest, highest))

    def _renew(self, position: np.ndarray, rotation: np.ndarray) -> None:
        tables, listed = self._tables, self._listed
        distance = self.reach + self.skin
        # A little more, so that rounding loses no pair.
        distance += 1e-9 * distance + 1e-15 * float(np.abs(position[listed]).max(initial=0.0))
        low, high = (side[listed] for side in self._boxes(position, 0.5 * distance))
        found = labelled_box_pairs(low, high, self._label[listed], self._allowed)
        pairs = listed.astype(np.int32)[found]
        i, j = pairs.T
        square = sum((x[i] - x[j]) ** 2 for x in position.T)
        radius = tables.bounding_radius
        near = square <= (radius[i] + radius[j] + distance) ** 2
        near &= tables.body[i] != tables.body[j]
        pairs = self._touching(pairs.compress(near, axis=0))
        first, second = self._is_ball[pairs].T
        mixed = pairs.compress(first != second, axis=0)
        swapped = ~self._is_ball[mixed[:, 0]]
        mixed[swapped] = mixed[swapped][:, ::-1]
        self._lists = {
            "ball_ball": pairs.compress(first & second, axis=0),
            "ball_corner": mixed,
            "corner_corner": pairs.compress(~(first | second), axis=0),
        }
        self._old_position, self._old_rotation = position.copy(), rotation
        self._searches_at_renewal = self.searches
        self.renewals += 1
        self.search_all()
        if self._own is not None:
            lists = self._searched
            own = self._own(tables.body[np.concatenate(list(lists.values()))])
            parts = np.split(own, np.cumsum([len(pairs) for pairs in lists.values()])[:-1])
            self._searched = {
                name: pairs[part] for (name, pairs), part in zip(lists.items(), parts, strict=True)
            }

    def _boxes(self, position: np.ndarray, inflation: float) -> tuple[np.ndarray, np.ndarray]:
        """Low and high corners of boxes around all pieces, each side moved out by the inflation."""
        radius, vertex, with_corners = self._tables.radius, self._corners.vertex, self._cornered
        high = np.repeat(radius[:, None], self._dim, axis=1)
        low = -high
        if len(with_corners):
            start = self._corners.vertex_start[with_corners]
            low[with_corners] = np.minimum(0.0, np.minimum.reduceat(vertex, start))
            high[with_corners] = np.maximum(0.0, np.maximum.reduceat(vertex, start))
        return position + low - inflation, position + high + inflation

    def saved(self) -> dict:
        """What the list in use was made from, and how long it has served; empty before the first.

        Returns:
            `skin` (m), `served` searches, `position` (m) of the pieces and `rotation`, matrices of
            those with corners.
        """
        if self._old_position is None:
            return {}
        return {
            "skin": self.skin,
            "served": self.searches - self._searches_at_renewal,
            "position": self._old_position,
            "rotation": self._old_rotation,
        }

    def restore(self, saved: Mapping) -> None:
        """Make the list that `saved` told of."""
        if not saved:
            return
        self.skin = saved["skin"]
        self._turn_corners(saved["rotation"])
        self._renew(saved["position"], saved["rotation"])
        self.searches += saved["served"]


def _labels(bodies: RigidBodies, pairs: Sequence[tuple[str, str]]) -> tuple[np.ndarray, np.ndarray]:
    """A label of each body, of its group and whether all is prescribed, and which may meet."""
    number = {name: g for g, name in enumerate(bodies.groups)}
    allowed = np.zeros((len(number), 2, len(number), 2), bool)
    for pair in pairs:
        if isinstance(pair, str) or len(pair) != 2:
            raise ValueError(f'A pair of groups is like ("grains", "walls"), got {pair!r}.')
        for name in pair:
            if name not in number:
                raise ValueError(
                    f"No rigid body is of the group {name!r}; groups are {sorted(number)}."
                )
        a, b = number[pair[0]], number[pair[1]]
        allowed[a, :, b, :] = allowed[b, :, a, :] = True
    allowed[:, 1, :, 1] = False
    label = 2 * bodies.group_of.astype(np.int64) + bodies.is_prescribed.all(axis=1)
    return label, allowed.reshape(2 * len(number), 2 * len(number))
