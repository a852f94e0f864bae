# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts between rigid bodies and their images in a periodic cell.

With the period vectors a_k (m) of the present cell, body j has images at x_j + sum_k n_k a_k for
all whole numbers n_k. Each pair of images has one contact per unit of the lattice, so that it is
enough to look at the bodies as they lie in the cell and at those of their images that can reach one
of them; of the images n and -n, which give the same pairs, one is taken. Bodies and images are
searched as any rigid bodies are (`rigid_search.py`).

Positions are never wrapped: a body that has crossed the cell goes on, and its contacts are told by
the n between the two positions. They keep their names however far the cell is sheared. The search
itself takes a short basis of the lattice that there is at the time, which is what resetting a cell
that has been sheared by a period amounts to (Lees and Edwards 1972).

Images and lists serve until they may miss a contact. With A the deformation of the cell since they
were made and u_i = x_i - A x_i,old what body i has moved besides, the gap of a pair whose centres
were l apart has shrunk by no more than |u_i| + |u_j| + |A - I| l and what turning adds; A of a
point's image is the same as of the point, so that u_i is that of all images.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import product

import numpy as np

from xper_fx.nscd.rigid.bodies import RigidBodies
from xper_fx.nscd.search.contact_pairs import Contacts
from xper_fx.nscd.search.coplanar import without_flats
from xper_fx.nscd.search.rigid_search import FIRST_SKIN, RigidSearch

# Relative rounding of positions, against which the search looks a little further.
_ROUNDING = 1e-12


def short_basis(vectors: np.ndarray) -> np.ndarray:
    """Whole numbers Z for which the rows of Z @ vectors are a basis that is as short as pairs of
    its vectors make each other (Gauss 1801; in 3D not always the shortest).

    Args:
        vectors: shape (p, dim), period vectors as rows, m.

    Returns:
        Shape (p, p), int64, of determinant 1 or -1.
    """
    count = len(vectors)
    numbers = np.eye(count, dtype=np.int64)
    changed = True
    while changed:
        changed = False
        for i in range(count):
            for j in range(count):
                basis = numbers @ vectors
                if i == j:
                    continue
                times = np.int64(np.rint(basis[i] @ basis[j] / (basis[j] @ basis[j])))
                if times and np.linalg.norm(basis[i] - times * basis[j]) < np.linalg.norm(basis[i]):
                    numbers[i] -= times * numbers[j]
                    changed = True
    return numbers


class _PlacedBodies:
    """Bodies and images as the `RigidBodies` that a search asks for.

    Attributes:
        piece: of the bodies' pieces, that which each of these is of, shape (num_pieces,).
    """

    def __init__(self, bodies, tables, source: np.ndarray, is_image: np.ndarray):
        self.dim, self.groups = bodies.dim, tuple(product(range(3), bodies.groups))
        kind = np.where(np.isinf(bodies.bounding_radius[source]), 2, is_image)
        self.group_of = bodies.group_of[source] + kind * len(bodies.groups)
        self.is_prescribed = bodies.is_prescribed[source]
        first = np.searchsorted(tables.body, np.arange(len(bodies) + 1))
        count = np.diff(first)[source]
        own = np.repeat(np.arange(len(source), dtype=np.int32), count)
        within = np.arange(len(own)) - np.repeat(np.cumsum(count) - count, count)
        self.piece = first[source][own] + within
        of_each = ("kind", "radius", "bounding_radius", "entry", "offset")
        parts = {name: getattr(tables, name)[self.piece] for name in of_each}
        self.shapes = tables._replace(body=own, **parts)

    def __len__(self) -> int:
        return len(self.group_of)


# Which of bodies (0), images (1) and walls (2) are looked at with which.
_KINDS = ((0, 0), (0, 1), (1, 0), (0, 2), (2, 0))


class _SearchOfImages(RigidSearch):
    """A search whose lists serve as long as it does."""

    def _renew_if_needed(self, position: np.ndarray, rotation: np.ndarray) -> None:
        if self._old_position is None:
            self._renew(position, rotation)


class PeriodicSearch:
    """Search of contacts between rigid bodies in a periodic cell.

    Candidates and antagonists are those of `RigidSearch`. A key has the pair of pieces, the p whole
    numbers of the lattice from the image of the lower body to that of the higher one, and the
    feature.

    Args:
        bodies: the bodies; walls (half-planes, half-spaces) along all period vectors.
        pairs: names of groups that may touch; see `RigidSearch`.
        reach: largest gap of a contact (m), positive.
        lattice: shape (p, dim), period vectors of the reference cell as rows, m.

    Attributes:
        offset: of the contacts found last, shape (n, 2, dim): from the positions of candidate and
            antagonist to those of their images that touch, m.
        renewals: how often images and lists have been made.
        searches: how often contacts have been looked for.
    """

    def __init__(
        self,
        bodies: RigidBodies,
        pairs: Sequence[tuple[str, str]],
        reach: float,
        lattice: np.ndarray,
    ):
        self._bodies, self._reach, self._lattice = bodies, reach, lattice
        self._tables = without_flats(bodies.shapes)
        self._pairs = [((k, a), (m, b)) for a, b in pairs for k, m in _KINDS]
        self._is_finite = np.isfinite(bodies.bounding_radius)
        radius = bodies.bounding_radius[self._is_finite]
        pieces = self._tables.body
        self._turns = np.bincount(pieces, self._tables.entry >= 0) + np.bincount(pieces) > 1
        self._largest = float(radius.max(initial=0.0))
        self._skin = FIRST_SKIN * (reach + 2.0 * float(np.median(radius)) if len(radius) else reach)
        self.offset = np.empty((0, 2, bodies.dim))
        self.renewals = self.searches = 0
        self._searches_at_renewal = 0
        self._search: _SearchOfImages | None = None
        self._own: Callable[[np.ndarray], np.ndarray] | None = None

    def divide(self, own: Callable[[np.ndarray], np.ndarray]) -> None:
        """See `RigidSearch.divide`; of a pair of bodies `own` is given one row for each image."""
        self._own = own

    def search_all(self) -> None:
        """See `RigidSearch.search_all`."""
        self._search.search_all()

    @property
    def nbytes(self) -> int:
        """Memory of images and lists, in bytes."""
        if self._search is None:
            return 0
        return self._search.nbytes + self._source.nbytes + self._shift.nbytes

    def find(
        self, position: np.ndarray, rotation: np.ndarray, gradient: np.ndarray | None = None
    ) -> Contacts:
        """The contacts whose gap is no larger than the reach, one for each pair of images.

        Args:
            position, rotation: as of `RigidSearch.find`.
            gradient: Fbar, shape (dim, dim), which makes the present cell of the reference one;
                None where the cell keeps its shape.

        Returns:
            Contacts; `point` lies where the bodies are seen from the cell at the origin.

        Raises:
            ValueError: arrays of another shape or that are not finite, a body that touches its own
                image.
        """
        position, rotation = np.asarray(position, float), np.asarray(rotation, float)
        if not np.isfinite(position).all():
            body = int(np.argwhere(~np.isfinite(position))[0, 0])
            raise ValueError(f"The position of body {body} is not finite: {position[body]}.")
        vectors = self._lattice if gradient is None else self._lattice @ gradient.T
        self._renew_if_needed(position, rotation, vectors)
        self.searches += 1
        placed = self._shift @ vectors
        contacts = self._search.find(position[self._source] + placed, rotation[self._source])
        return self._between_bodies(contacts, placed)

    overlaps = RigidSearch.overlaps

    def _renew_if_needed(self, position, rotation, vectors) -> None:
        if self._search is not None:
            motion = self._motion(position, rotation, vectors)
            if motion <= self._skin:
                return
            served = self.searches - self._searches_at_renewal
            self._skin = self._search._best_skin(motion / served)
        self._renew(position, rotation, vectors)

    def _motion(self, position, rotation, vectors) -> float:
        """By how much the gap of a pair in the list may have shrunk (m)."""
        old_position, old_rotation, old_vectors = self._old
        moved, strain = position - old_position, 0.0
        if not np.array_equal(vectors, old_vectors):  # then there are dim of them
            change = np.linalg.solve(old_vectors, vectors - old_vectors)  # (A - I)^T
            moved = moved - old_position @ change
            strain = float(np.linalg.norm(change, 2))
        moved = moved[self._is_finite]
        if not len(moved):
            return 0.0
        length = np.linalg.norm(moved - moved.mean(axis=0), axis=1)
        if rotation.ndim == 1:
            turned = 2.0 * np.abs(np.sin(0.5 * (rotation - old_rotation)))
        else:
            turned = np.sqrt(0.5 * ((rotation - old_rotation) ** 2).sum(axis=(1, 2)))
        turned = np.where(self._turns, turned, 0.0)[self._is_finite]
        length += turned * self._bodies.bounding_radius[self._is_finite]
        furthest = float(np.sort(length)[-2:].sum())
        return furthest + strain * (2.0 * self._largest + self._reach + self._skin)

    def _renew(self, position, rotation, vectors) -> None:
        """Place the images and start their search."""
        numbers = short_basis(vectors)
        basis = numbers @ vectors
        dual = np.linalg.pinv(basis)
        share = position @ dual
        cell = np.where(self._is_finite[:, None], np.floor(share), 0.0).astype(np.int64)
        share -= cell
        radius = np.where(self._is_finite, self._bodies.bounding_radius, 0.0)
        far = radius + self._largest + self._reach + self._skin
        far += _ROUNDING * np.abs(position[self._is_finite]).max(initial=0.0)
        margin = far[:, None] * np.linalg.norm(dual, axis=0)
        most = np.ceil(margin.max(axis=0, initial=0.0)).astype(int)
        source, shift = [np.arange(len(position))], [-cell]
        for n in product(*(range(-m, m + 1) for m in most)):
            if n <= (0,) * len(n):  # and of n and -n one
                continue
            image = share + n
            near = (image >= -margin) & (image <= 1.0 + margin)
            bodies = np.flatnonzero(near.all(axis=1) & self._is_finite)
            source.append(bodies)
            shift.append(np.array(n) - cell[bodies])
        source = np.concatenate(source)
        is_image = np.arange(len(source)) >= len(position)
        # Images beside their bodies: the lower of two numbers is then that of the lower body.
        order = np.argsort(source, kind="stable")
        self._source, self._shift = source[order], (np.concatenate(shift) @ numbers)[order]
        placed = _PlacedBodies(self._bodies, self._tables, self._source, is_image[order])
        self._piece, self._placed = placed.piece, placed.shapes.body
        before, self._search = self._search, _SearchOfImages(placed, self._pairs, self._reach)
        if self._own is not None:
            self._search.divide(lambda pairs: self._own(self._source[pairs]))
        if before is not None:
            self._search._expected = before._expected
        self._search.skin = self._skin
        self._old = position.copy(), rotation.copy(), vectors
        self._searches_at_renewal = self.searches
        self.renewals += 1

    def _between_bodies(self, contacts: Contacts, placed: np.ndarray) -> Contacts:
        """Contacts between images as those of their bodies, sorted by key."""
        lower, higher = np.divmod(contacts.key[:, 0], len(self._piece))
        pair = self._piece[lower] * len(self._tables.kind) + self._piece[higher]
        lower, higher = self._placed[lower], self._placed[higher]
        own = np.flatnonzero(self._source[lower] == self._source[higher])
        if len(own):
            raise ValueError(
                f"Rigid body {self._source[lower[own[0]]]} touches its own image: the periodic "
                "cell should be wider than the body and the reach of its contacts."
            )
        apart = self._shift[higher] - self._shift[lower]
        key = np.column_stack([pair, apart, contacts.key[:, 1]])
        order = np.lexsort(key.T[::-1])
        self.offset = placed[contacts.body[order]]
        body = self._source[contacts.body].astype(np.int32)
        return Contacts(body, *contacts[1:-1], key).take(order)

    def saved(self) -> dict:
        """What images and lists in use were made from; empty before the first."""
        if self._search is None:
            return {}
        names = ("position", "rotation", "vectors")
        return dict(zip(names, self._old, strict=True)) | {
            "skin": self._skin,
            "served": self.searches - self._searches_at_renewal,
        }

    def restore(self, saved: Mapping) -> None:
        """Make the images and lists that `saved` told of."""
        if not saved:
            return
        self._skin = saved["skin"]
        position, rotation, vectors = (saved[n] for n in ("position", "rotation", "vectors"))
        self._renew(position, rotation, vectors)
        placed = position[self._source] + self._shift @ vectors
        self._search.find(placed, rotation[self._source])  # lists are made where they were
        self.searches += saved["served"]
