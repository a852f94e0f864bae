# SPDX-License-Identifier: LGPL-3.0-or-later
"""The permanent points of a scene, sorted by law: those of facets, walls and ties."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from xper_fx.nscd.facets import join_points
from xper_fx.nscd.grouping import Grouping
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.laws.law import Law
from xper_fx.nscd.ordering import vertex_of_points
from xper_fx.nscd.own_compliance import diagonals
from xper_fx.nscd.points import InteractionPoints
from xper_fx.support.saved_rows import Rows

if TYPE_CHECKING:
    from xper_fx.nscd.splitting.fused_points import FusedPoints

# What a group keeps from step to step, beside the status of its points and their frames.
_KEPT = ("jump", "velocity", "committed_impulse", "energy", "state")


class PermanentGroups:
    """The permanent points by law.

    Args:
        points: all permanent points.
        laws: the laws in use.
        law_of_point: shape (num_points,), index into `laws`.
        inverse: blocks of w.
        nodal: shape (num_slots, dim), velocities of the nodes at the start (m/s).
        phase: shape (num_points,), in which bodies of another rank are at a point.
        ordering, splits: as of `Interactions`.

    Attributes:
        law_of_point: as given.
        inverse: blocks of w, the diagonal alone where vertices split.
        grouping: makes groups of points of these laws.
        groups: the points by law; a point that is taken out is in none.
        fused: what the vertices are that initially rigid bonds hold; None where all bonds have
            points.
        turn: whether frames of some points turn with their bodies.
        uneven: by group's identity those turning points whose compliance hangs on their frame;
            None where that of all may, as w has blocks.

    Raises:
        ValueError: a law index out of range, arrays whose lengths disagree, an unknown ordering,
            or "vertices" where w couples more than a node.
    """

    def __init__(
        self,
        points: InteractionPoints,
        laws: list[Law],
        law_of_point: np.ndarray,
        inverse: BodyInverse,
        nodal: np.ndarray,
        phase: np.ndarray,
        ordering: str,
        splits: bool,
    ):
        law_of_point = np.asarray(law_of_point)
        if len(law_of_point) != len(points):
            raise ValueError(
                f"law_of_point should hold one law a point ({len(points)}), "
                f"got {len(law_of_point)}."
            )
        if len(points) and not (0 <= law_of_point.min() and law_of_point.max() < len(laws)):
            raise ValueError(
                f"law_of_point should index the {len(laws)} laws given, got values from "
                f"{law_of_point.min()} to {law_of_point.max()}."
            )
        if ordering not in ("tiles", "vertices"):
            raise ValueError(f'ordering should be "tiles" or "vertices", got {ordering!r}.')
        if ordering == "vertices" and (
            inverse.uniform_size != inverse.dim or points.nodes.shape[2] != 1
        ):
            raise ValueError(
                'ordering="vertices" needs nodal points (one node a side, got '
                f"{points.nodes.shape[2]}) and a lumped mass without bulk stiffness in w (blocks "
                f"of {inverse.dim} degrees of freedom, got {inverse.uniform_size or 'several'})."
            )
        if points.lips is not None and (w := inverse.of_lumped_mass()) is not None:
            points = replace(points, lips=points.lips.by_mass(w.sum(axis=1)))
        self.law_of_point = law_of_point.astype(np.min_scalar_type(max(len(laws) - 1, 0)))
        self._count, self._laws, self._dim = len(points), laws, inverse.dim
        self.inverse = inverse
        vertex = None
        if ordering == "vertices":
            vertex = vertex_of_points(points.nodes[:, :, 0], inverse.num_nodes + 1)
            vertex = vertex.astype(np.int32)
        self.grouping = Grouping(laws, inverse, vertex)
        rigid = [n for n, law in enumerate(laws) if splits and law.kernels(self._dim).rigid]
        if rigid:  # vertices know what moves with what: w is asked for compliances alone
            if not inverse.diagonal:
                inverse = inverse.diagonal_of_nodes()
            self.inverse = inverse
        self.groups = self.grouping.groups(
            inverse, points, law_of_point, nodal, phase, left_out=frozenset(rigid)
        )
        self.fused: FusedPoints | None = None
        # points whose groups have all of their frames are put together again when asked for
        self._points: InteractionPoints | None = points
        if rigid:
            from xper_fx.nscd.splitting.fused_points import FusedPoints

            self.fused = FusedPoints(
                points, vertex, laws, self.law_of_point, inverse, self.groups,
                lambda kernels, indices: self.grouping.as_given(
                    self.inverse, kernels, self._points, self.law_of_point, indices
                ),
            )  # fmt: skip
            self.groups = self.fused.groups
        self.turn = any(group.turning is not None for group in self.groups)
        # places and `diagonals` of the points whose compliance hangs on their frame, by group
        self.uneven: dict[int, tuple[np.ndarray, np.ndarray]] | None = None
        components = [group.kernels.components for group in self.groups]
        alike = components and min(components) == max(components) and self.fused is None
        self._points = None
        if not alike or points.lever_arms is not None:
            self._points = points.with_components(max(components, default=1))

    def __len__(self) -> int:
        return self._count

    @property
    def points(self) -> InteractionPoints:
        """All points in the scene's order, those taken out included."""
        for g in self.groups if self.turn else ():
            g.show_frames()
        if self._points is not None:
            for g in self.groups if self.fused is not None and self.turn else ():
                self._points.frame[g.indices, : g.points.frame.shape[1]] = g.points.frame
            return self._points
        where = np.empty(self._count, np.int32)
        where[np.concatenate([g.indices for g in self.groups])] = np.arange(self._count)
        return join_points([g.points for g in self.groups]).take(where)

    @property
    def asleep(self) -> np.ndarray:
        """Numbers of points that have no arrays as they are sound and rigid (`splitting/`)."""
        return np.zeros(0, int) if self.fused is None else self.fused.asleep

    def take_inverse(self, inverse: BodyInverse) -> None:
        """Take w, and find the turning points whose compliance hangs on their frame."""
        self.inverse = inverse
        turning = [g for g in self.groups if g.turning is not None]
        nodes = [a for g in turning for a in (g.points.nodes, g.turning.nodes)]
        self.lip_slots = 1 + max((int(a.max(initial=-1)) for a in nodes), default=-1)
        even = inverse.even_nodes() if turning else None
        self.uneven = None
        if even is not None:
            self.uneven = {}
            for g in turning:
                which = np.flatnonzero(~even[g.points.nodes].all(axis=(1, 2)))
                self.uneven[id(g)] = which, diagonals(g, which)

    def move(self, inverse: BodyInverse, slots: np.ndarray) -> None:
        """Put all points on other slots of the same bodies; w of those that split is diagonal.

        Args:
            inverse: blocks of w on the new slots.
            slots: shape (n,), by the old slot.
        """
        if self.fused is not None and not inverse.diagonal:
            inverse = inverse.diagonal_of_nodes()
        self.grouping = self.grouping.onto(inverse)
        moved = partial(self.grouping.moved, inverse, slots=slots)
        if self.fused is None:
            self.groups = [moved(group) for group in self.groups]
        else:
            self.fused.move(slots, inverse, moved)
            self.groups = self.fused.groups
        if self._points is not None:
            self._points = self._points.on(slots)
        self.take_inverse(inverse)

    def deactivate(self, indices: np.ndarray) -> None:
        """Take points out, for good.

        Args:
            indices: their numbers in the scene's order.
        """
        self._points = self.points
        subset = partial(self.grouping.subset, self.inverse)
        if self.fused is not None:
            self.fused.retire(indices, subset)
            return
        for number, group in enumerate(self.groups):
            kept = np.flatnonzero(~np.isin(group.indices, indices))
            if len(kept) < len(group):
                self.groups[number] = subset(group, kept)
        self.take_inverse(self.inverse)

    def saved(self, number: np.ndarray, turns: bool) -> dict[str, Rows]:
        """What the next step depends on, in the scene's order, as wide as the widest law asks for.

        Args:
            number: shape (num_points,), of this rank's points in the scene.
            turns: whether frames turn on whichever rank.
        """
        kernels = [law.kernels(self._dim) for law in self._laws]
        components = max((k.components for k in kernels), default=0)
        widths = dict.fromkeys(_KEPT, components)
        widths["energy"] = max((len(k.energies) for k in kernels), default=0)
        widths["state"] = max((len(k.state_names) for k in kernels), default=0)
        arrays = {name: np.zeros((len(self), width)) for name, width in widths.items()}
        arrays |= {"status": np.zeros(len(self), np.int8), "kept": np.zeros(len(self), bool)}
        for g in self.groups:
            arrays["kept"][g.indices] = True
            arrays["status"][g.indices] = g.status
            for name in _KEPT:
                own = getattr(g, name)
                arrays[name][g.indices, : own.shape[1]] = own
        if self.fused is not None:
            asleep = self.fused.asleep
            arrays["kept"][asleep] = True
            arrays["state"][asleep] = self._sound_states(asleep, widths["state"])
            arrays["split"] = self.fused.turn_of_points()
        if turns:  # lips that face each other no more keep a frame of some time
            arrays["frame"] = np.zeros((len(self), components, self._dim))
            for g in self.groups:
                g.show_frames()
                frame = g.points.frame
                arrays["frame"][g.indices, : frame.shape[1]] = frame
        return {name: Rows(number, values) for name, values in arrays.items()}

    def _sound_states(self, asleep: np.ndarray, width: int) -> np.ndarray:
        """Histories of initially rigid points of given numbers before anything has happened."""
        states = np.zeros((len(asleep), width))
        for number, law in enumerate(self._laws):
            here = self.law_of_point[asleep] == number
            for column, value in enumerate(law.initial_state() if here.any() else ()):
                states[here, column] = value
        return states

    def split_as(self, saved: Mapping, number: np.ndarray) -> None:
        """Let the vertices be split that were in what `saved` gave.

        Where all points had arrays, as other runs have them, it is those whose bonds have changed.

        Args:
            saved: arrays over the points of all ranks.
            number: shape (num_points,), as of `saved`.
        """
        if "split" in saved:
            self.fused.split_again(saved["split"][number])
            return
        asleep, state = self.fused.asleep, saved["state"][number]
        changed = np.any(saved["jump"][number], axis=1) | ~saved["kept"][number]
        sound = self._sound_states(asleep, state.shape[1])
        changed[asleep] |= np.any(state[asleep] != sound, axis=1)
        self.fused.split_where(changed)

    def restore(self, saved: Mapping, number: np.ndarray) -> None:
        """Take the rows of `saved` in order; vertices are split, and points gone, as they were.

        Args:
            saved: arrays over the points of all ranks.
            number: shape (num_points,), as of `saved`.
        """
        # each is read once, also by ranks without groups: others may have to send the rows
        names = [*_KEPT, "status", *(["frame"] if "frame" in saved else [])]
        rows = {name: saved[name][number] for name in names}
        for g in self.groups:
            for name in _KEPT:
                own = getattr(g, name)
                own[:] = rows[name][g.indices, : own.shape[1]]
            g.impulse[:] = g.committed_impulse
            g.status[:] = rows["status"][g.indices]
            if g.turning is not None:
                g.points.frame[:] = rows["frame"][g.indices, : g.points.frame.shape[1]]
                g.couplings.frame[:] = g.points.frame[:, : g.couplings.frame.shape[1]]

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes, that of the groups left out."""
        points = [] if self._points is None else vars(self._points).values()
        held = sum(array.nbytes for array in points if array is not None)
        held += 0 if self.fused is None else self.fused.nbytes
        return held + self.law_of_point.nbytes + self.grouping.nbytes
