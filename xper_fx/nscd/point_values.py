# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is known of the permanent points of a scene, in the scene's order."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from xper_fx.nscd.algebra.small import sym_indices
from xper_fx.nscd.halo_protocol import ContactHalo, PointHalo, RigidSharing
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.laws.law import ALL_ENERGIES
from xper_fx.nscd.permanent_groups import PermanentGroups
from xper_fx.nscd.point_group import PointGroup, bytes_of_groups
from xper_fx.nscd.points import InteractionPoints

if TYPE_CHECKING:
    from xper_fx.nscd.found_contacts import FoundContacts
    from xper_fx.nscd.splitting.fused_points import FusedPoints

# Share of its fracture energy that a broken bond has spent.
BROKEN = 0.99


class PointValues:
    """Values at the interaction points of a scene, which are held law by law."""

    dim: int  #: 2 or 3
    inverse: BodyInverse  #: blocks of w
    #: what there is to exchange with other ranks, None where one rank has all bodies
    halo: PointHalo | ContactHalo | None
    committed_step: float  #: h of the last step (s)
    groups: list[PointGroup]  #: all points by law, permanent ones before those of contacts found
    fused: FusedPoints | None  #: vertices of initially rigid bonds, None without
    #: blocks of w of all rigid bodies, shape (num_rigid, 2 dim, 2 dim)
    rigid_blocks_of_all: np.ndarray
    _rigid_share: RigidSharing | None
    _permanent: PermanentGroups
    _found: FoundContacts

    # What ranks that share points agree on, so that all of them decide alike

    def total(self, value):
        """Sum over all ranks of numbers, or of arrays of one shape; the same bits on each."""
        return value if self.halo is None else self.halo.ranks.sum(value)

    def largest(self, value):
        """Largest over all ranks of numbers, or of arrays of one shape entry by entry."""
        return value if self.halo is None else self.halo.ranks.max(value)

    def everywhere(self, condition) -> bool:
        """Whether something holds on all ranks."""
        return bool(condition) if self.halo is None else self.halo.ranks.all(condition)

    def refresh_ghosts(self, velocity: np.ndarray) -> None:
        """Let ghosts follow their owners; `velocity` has shape (num_slots * dim,)."""
        if self.halo is not None:
            self.halo.everywhere.forward(velocity)

    def whole(self, values: np.ndarray) -> np.ndarray:
        """Of values at this rank's permanent points, shape (num_points, ...), those of all."""
        return values if self.halo is None else self.halo.gather(values)

    @property
    def rigid_blocks(self) -> np.ndarray:
        """Blocks of w of this rank's rigid bodies, shape (n, 2 dim, 2 dim)."""
        return self.own_of_rigid(self.rigid_blocks_of_all)

    def own_of_rigid(self, rows: np.ndarray) -> np.ndarray:
        """Of rows of all rigid bodies this rank's."""
        return rows if self._rigid_share is None else rows[self._rigid_share.here]

    def __len__(self) -> int:
        return len(self._permanent)

    @property
    def points(self) -> InteractionPoints:
        """All permanent points in the scene's order, those taken out included."""
        return self._permanent.points

    @property
    def law_of_point(self) -> np.ndarray:
        """Index into `laws` of each permanent point, shape (num_points,)."""
        return self._permanent.law_of_point

    @property
    def numbers(self) -> np.ndarray:
        """Numbers of this rank's permanent points in the scene's order, shape (num_points,)."""
        return np.arange(len(self)) if self.halo is None else self.halo.numbers

    def known_by(self, group: PointGroup) -> np.ndarray:
        """What tells the points of one law apart on all ranks, shape (n, 3), whole numbers.

        Args:
            group: of permanent points, or of contacts found.
        """
        if any(group is found for found in self._found.groups):
            return np.pad(self._found.keys_of(group), ((0, 0), (1, 0)), constant_values=1)
        return np.pad(self.numbers[group.indices, None], ((0, 0), (0, 2)))

    @property
    def num_points(self) -> int:
        """Number of permanent points, on all ranks."""
        return int(self.total(len(self)))

    def unbonded(self) -> np.ndarray:
        """Which permanent points nothing holds together, shape (num_points,).

        That is where damage is complete, or whose law has no damage and no stored energy.
        """
        return self.whole(self.local_unbonded())

    def local_unbonded(self) -> np.ndarray:
        """As `unbonded`, of this rank's points."""
        loose = np.ones(len(self), bool)
        loose[self._permanent.asleep] = False
        for g in self._permanent.groups:
            loose[g.indices] = g.unbonded()
        return loose

    def gather(self, name: str) -> np.ndarray:
        """An array over the permanent points, in the scene's order.

        Local vectors have `dim` columns, energies those of ALL_ENERGIES: what a law has no use for,
        as frictionless contact for anything tangential, reads zero.

        Args:
            name: "jump" (m), "velocity" (m/s), "impulse" (N s), "traction" (Pa, opening negative
                as it pulls the sides together), "status", "energy", "law" (index into `laws`),
                "area" (m^2; 2D: m), "spent" (share of the fracture energy that a bond has spent, 1
                where its lips have parted for good), or a history variable of the laws such as
                "damage" (NaN-free: laws without it give 0).
        """
        return self.whole(self.local(name))

    def local(self, name: str) -> np.ndarray:
        """As `gather`, of this rank's points."""
        if name == "traction":
            scale = max(self.committed_step, np.finfo(float).tiny) * self.points.area
            return self.local("impulse") / scale[:, None]
        if name == "spent":
            spent = np.ones(len(self))
            spent[self._permanent.asleep] = 0.0
            for g in self._permanent.groups:
                spent[g.indices] = g.spent()
            return spent
        if name in ("law", "area"):
            return self.law_of_point if name == "law" else self.points.area
        widths = {"compliance": self.dim * (self.dim + 1) // 2, "energy": len(ALL_ENERGIES)}
        widths |= dict.fromkeys(("jump", "velocity", "impulse"), self.dim)
        if name in widths:
            out = np.zeros((len(self), widths[name]))
            for g in self._permanent.groups:
                own = getattr(g, name)
                columns = range(own.shape[1])
                if name == "energy":
                    columns = [ALL_ENERGIES.index(energy) for energy in g.kernels.energies]
                out[np.ix_(g.indices, columns)] = own
            if name == "compliance" and self.fused is not None:
                points, apart = self.fused.compliance_of_cells()
                out[points] = apart[:, None] * np.equal(*sym_indices(self.dim))
            return out
        out = np.zeros(len(self))
        out[self._permanent.asleep] = name in ("damage", "status")
        for g in self._permanent.groups:
            if name in g.kernels.state_names:
                out[g.indices] = g.state[:, g.kernels.state_names.index(name)]
            elif hasattr(g, name):
                out[g.indices] = getattr(g, name)
        return out

    @property
    def nbytes(self) -> int:
        """Memory held by points and blocks of w, in bytes."""
        inverse = self.inverse
        blocks = inverse.data.nbytes + inverse.node_offsets.nbytes + inverse.data_offsets.nbytes
        return blocks + self._permanent.nbytes + bytes_of_groups(self.groups)
