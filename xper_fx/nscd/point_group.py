# SPDX-License-Identifier: LGPL-3.0-or-later
"""The interaction points that share a law's kernels, and their history."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from xper_fx.nscd.couplings import Blocks, Couplings, Sides
from xper_fx.nscd.laws.law import LawKernels
from xper_fx.nscd.ordering import Ordering, TileBodies
from xper_fx.nscd.points import InteractionPoints

if TYPE_CHECKING:
    from xper_fx.nscd.turning_frames import TurningFrames


class PointArrays(NamedTuple):
    """What kernels of a law read and write of the points of a group; see `PointGroup`."""

    jump: np.ndarray
    velocity: np.ndarray
    impulse: np.ndarray
    committed: np.ndarray
    compliance: np.ndarray
    area: np.ndarray
    parameters: np.ndarray
    state: np.ndarray
    terms: np.ndarray
    details: np.ndarray
    energy: np.ndarray
    status: np.ndarray


@dataclass
class PointGroup:
    """The points that share a law's kernels, in their order of visit.

    Local vectors have the law's `components`: dim, or the normal's alone.
    """

    kernels: LawKernels  #: of the law
    indices: np.ndarray  #: shape (n,), the points' numbers in the scene's order
    points: InteractionPoints  #: with frames of as many rows as there are components
    ordering: Ordering  #: in which sweeps visit them
    tile_bodies: TileBodies  #: whose change marks a tile for the next sweep
    couplings: Couplings  #: what sweeps read and write
    parameters: np.ndarray  #: of the law, shape (n, ...)
    state: np.ndarray  #: shape (n, len(kernels.state_names)), history at the last committed time
    terms: np.ndarray  #: shape (n, kernels.num_terms), of the step, which each visit reads
    details: np.ndarray  #: shape (n, kernels.num_details), of the step, which not each visit reads
    compliance: np.ndarray  #: W_aa, packed symmetric (m/s per N s)
    inverse_area: np.ndarray  #: shape (n,), 1/m^2 (2D: 1/m)
    jump: np.ndarray  #: shape (n, components), at the last committed time (m)
    velocity: np.ndarray  #: shape (n, components), at the last committed time (m/s)
    #: shape (n, components), total impulse of the step in the local frame (N s)
    impulse: np.ndarray
    committed_impulse: np.ndarray  #: the same of the last committed step
    energy: np.ndarray  #: shape (n, len(kernels.energies)), of the last committed step (J; 2D: J/m)
    status: np.ndarray  #: shape (n,), int8: 0 open, 1 closed or bonded and sticking, 2 sliding
    sides: Sides  #: what kernels over the points are compiled for
    blocks: Blocks  #: what is known of the blocks of w when they are
    phase: int = 0  #: in which bodies of another rank are at the points, 0 if none are
    #: what they need to turn with their lips, None where they do not
    turning: TurningFrames | None = None

    def __len__(self) -> int:
        return len(self.indices)

    def show_frames(self) -> None:
        """Let `points` have the frames of `couplings`, the only ones that turn in each step."""
        shown, frame = self.points.frame, self.couplings.frame
        if self.turning is None or shown is frame:
            return
        shown[:, : frame.shape[1]] = frame
        if frame.shape[1] < shown.shape[1] == 2:
            shown[:, 1, 0], shown[:, 1, 1] = -frame[:, 0, 1], frame[:, 0, 0]

    def law_arrays(self) -> PointArrays:
        """The arrays as kernels of the law take them."""
        return PointArrays(
            self.jump, self.velocity, self.impulse, self.committed_impulse, self.compliance,
            self.points.area, self.parameters, self.state, self.terms, self.details, self.energy,
            self.status,
        )  # fmt: skip

    def unbonded(self) -> np.ndarray:
        """Which points nothing holds together, shape (n,).

        That is where damage is complete, or all of them if the law has no damage and knows impacts.
        """
        if "damage" in self.kernels.state_names:
            return self.state[:, self.kernels.state_names.index("damage")] == 0.0
        return np.full(len(self), "impact" in self.kernels.energies)

    def spent(self) -> np.ndarray:
        """Share of its fracture energy that the bond of each point has spent, shape (n,)."""
        if self.kernels.spent is not None:
            return self.kernels.spent(self.parameters, self.state)
        if "damage" in self.kernels.state_names:
            return 1.0 - self.state[:, self.kernels.state_names.index("damage")]
        return np.zeros(len(self))

    def arrays(self) -> dict[int, np.ndarray]:
        """The arrays held, by identity, without the blocks of w."""
        own = (
            self.indices, self.parameters, self.state, self.terms, self.details, self.compliance,
            self.inverse_area, self.jump, self.velocity, self.impulse, self.committed_impulse,
            self.energy, self.status, *self.ordering, *self.tile_bodies, *self.couplings,
            *(a for a in vars(self.points).values() if isinstance(a, np.ndarray)),
            *(self.turning or ()),
        )  # fmt: skip
        return {id(a): a for a in own if a is not None and a is not self.couplings.w}

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes, blocks of w (shared with the other groups) not counted."""
        return bytes_of_groups([self])


def bytes_of_groups(groups: Iterable[PointGroup]) -> int:
    """Memory held by groups, in bytes; what several share counts once, blocks of w do not."""
    kept: dict[int, np.ndarray] = {}
    for group in groups:
        kept |= group.arrays()
    return sum(a.nbytes for a in kept.values())


def largest_arm(groups: list[PointGroup]) -> float:
    """Largest component of a lever arm at rigid bodies (m), zero without any."""
    arms = [np.abs(g.couplings.lever_arms).max(initial=0.0) for g in groups if g.sides.lever_arms]
    return max(arms, default=0.0)
