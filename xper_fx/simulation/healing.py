# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Overlaps of rigid bodies are taken back after a step.

Contacts at the velocity level stop bodies where they are, and they may overlap there: by at most
v h after an impact at the speed v, and by what the tolerance of the solver adds step by step. Where
a contact is deeper than `_DEEP` of the smallest body, bodies are moved by the least motion d that
leaves half of that (`nscd/separation.py`; Acary 2013). Contacts stay closed, and bear in the next
step what they bore. A heap at rest is moved about once in a hundred steps.

Velocities stay, spins in the axes of their bodies, and so does the kinetic energy. The loads f do
the work f . d, negative where they pull bodies down that are lifted. The ledger has -f . d as
`healing`: energy that bodies are given back, which they lost to impacts as they sank too far. A
speed in place of the motion (Baumgarte 1972), which opens a gap in a step, would stay: an overlap
of 1 mm at a step of 1e-3 s would be shot apart at 1 m/s.

Two kinds of contacts are not opened, and do not become deeper. Those that part by themselves, as
after a rebound, would gain height. Those of bodies that nothing holds would change the angular
momentum, by the sum of d x m v; such bodies keep theirs to rounding.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.rigid.motion import RigidMotion
from xper_fx.nscd.search.contact_pairs import Contacts
from xper_fx.nscd.separation import Separation

# Depth that is left alone, as a share of the smallest body.
_DEEP = 1e-3
# Steps in which a contact that parts by itself has opened.
_SOON = 100


class Healing:
    """Moves rigid bodies apart after steps that leave them too deep in each other.

    Args:
        rigid: motion of the bodies.
        pairs: names of groups whose contacts are healed.

    Attributes:
        depth: that is left alone (m).
        count: how often bodies were moved since the start, or since a restart.
    """

    def __init__(self, rigid: RigidMotion, pairs: Sequence[tuple[str, str]]):
        self._rigid, self._pairs = rigid, pairs
        self._separation: Separation | None = None
        self.depth = _DEEP * float(rigid.bodies.bounding_radius.min())
        self.count = 0

    @property
    def nbytes(self) -> int:
        """Memory of the lists of pairs that may overlap, in bytes."""
        return 0 if self._separation is None else self._separation.nbytes

    def heal(self, interactions: Interactions, step: float, time: float) -> tuple[float, float]:
        """Move bodies apart after a step, if they are too deep in each other.

        All ranks call it together, and move all bodies alike.

        Args:
            interactions: after `commit`.
            step: h (s).
            time: at the end of the step (s).

        Returns:
            The work of the loads, and what the kinetic energy has gained, as
            `RigidMotion.displace` has them (J; 2D: J/m); zeros where nothing is deep.
        """
        deepest = 0.0
        for g in interactions.contacts:
            soon = _soon(g.jump[:, 0], step * g.velocity[:, 0])
            deepest = max(deepest, -float(soon.min(initial=0.0)))
        if interactions.largest(deepest) <= self.depth:
            return 0.0, 0.0
        if self._separation is None:
            self._separation = Separation(self._rigid.bodies, self._pairs)
        rigid, position = self._rigid, self._rigid.state.position
        contacts = self._separation.find(position, rigid.state.turn.rotation)
        gap = contacts.gap + 0.5 * self.depth
        left = np.maximum(gap, 0.0)
        gap = np.minimum(_soon(gap, step * self._opening_speed(contacts)), left)
        gap = np.where(self._is_held(contacts), gap, left)
        rigid.renew_blocks()
        self.count += 1
        return rigid.displace(self._separation.motion(contacts, gap, position, rigid.blocks), time)

    def _opening_speed(self, contacts: Contacts) -> np.ndarray:
        """Normal velocities of contacts (m/s), positive where they open."""
        state, body = self._rigid.state, contacts.body
        arm = contacts.point[:, None] - state.position[body]
        spin = state.turn.spin[body]
        if contacts.dim == 2:
            turning = spin * np.stack([-arm[..., 1], arm[..., 0]], axis=-1)
        else:
            turning = np.cross(spin, arm)
        speed = np.einsum("csd,cd->cs", state.velocity[body] + turning, contacts.normal)
        return speed[:, 0] - speed[:, 1]

    def _is_held(self, contacts: Contacts) -> np.ndarray:
        """Whether contacts are of bodies that touch, through others, one that is prescribed."""
        prescribed = self._rigid.bodies.is_prescribed.any(axis=1)
        candidate, antagonist = contacts.body[contacts.gap <= self.depth].T
        size = len(prescribed)
        touch = coo_array((np.ones(len(candidate)), (candidate, antagonist)), shape=(size, size))
        count, part = connected_components(touch, directed=False)
        held = np.zeros(count, bool)
        held[part[prescribed]] = True
        return held[part[contacts.body[:, 0]]]


def _soon(gap: np.ndarray, opening: np.ndarray) -> np.ndarray:
    """Gaps (m) after some steps, in each of which they open by a length."""
    return gap + _SOON * np.maximum(opening, 0.0)
