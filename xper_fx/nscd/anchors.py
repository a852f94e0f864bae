# SPDX-License-Identifier: LGPL-3.0-or-later
"""Degrees of freedom that hold bodies which interactions alone hold."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp

from xper_fx.nscd.inverse_blocks import BodyInverse


@dataclass
class Anchors:
    """Dofs that hold bodies which interactions alone hold (`bulk/floating_bodies.py`).

    A solver may pass over them: the bodies are then on springs, and the bulk iterates until these
    bear nothing.
    """

    held: BodyInverse  #: w0, blocks of w with the anchors held
    motions: sp.csc_array  #: R, rigid motions that move one anchor each, shape (num_slots * dim, n)
    load: np.ndarray  #: R^T f of the forces that act on the bulk, shape (n,), N s
    #: velocities that the load gives the anchors, part of the free velocity, shape (n,), m/s
    on_springs: np.ndarray
    #: a, what a solver that knows of anchors gives them, shape (n,), m/s
    velocity: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.velocity = np.zeros(len(self.load))
