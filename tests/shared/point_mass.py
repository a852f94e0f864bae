# SPDX-License-Identifier: LGPL-3.0-or-later
"""Point masses with one interaction point: the smallest run there is, for the laws' tests."""

from __future__ import annotations

import numpy as np
from solving import solve

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.points import InteractionPoints, frame_from_normal


class PointMass:
    """One mass (candidate) against the ground, or against a second mass (antagonist).

    Args:
        law: the law of the point.
        masses: one mass (kg) against the ground, or two; numpy.inf is a mass that does not feel.
        velocity: shape (num_masses, dim), at the start.
        area, gap: of the point.
        normal: unit normal, from antagonist to candidate.
        theta: of the scheme.
        couples: shape (dim, dim), symmetric, by which the inverses of the masses are multiplied: a
            push in one direction moves in the others too.
    """

    def __init__(
        self, law, masses, velocity, *, area=1.0, gap=0.0, normal=None, theta=0.5, couples=None
    ):
        self.masses = np.atleast_1d(np.asarray(masses, float))
        self.velocity = np.array(velocity, float).reshape(len(self.masses), -1)
        dim = self.dim = self.velocity.shape[1]
        self.theta, self.area = theta, area
        normal = np.eye(dim)[0] if normal is None else np.asarray(normal, float)
        points = InteractionPoints(
            np.array([[[0], [1]]], dtype=np.int32),
            np.ones((1, 2, 1)),
            frame_from_normal(normal[None]),
            np.array([area]),
            np.array([gap]),
        )
        self.frame = points.frame[0]
        couples = np.eye(dim) if couples is None else couples
        self.inverse = BodyInverse.from_uniform(couples / self.masses[:, None, None], dim)
        self.interactions = Interactions(
            points, [law], np.zeros(1, int), self.inverse, self.velocity
        )

    def step(self, h, force=0.0, **options):
        """One step under a constant force, shape (num_masses, dim) (N); returns the energies."""
        options = {"tolerance": 1e-13, "num_threads": 1} | options
        free = (
            self.velocity + h * np.broadcast_to(force, self.velocity.shape) / self.masses[:, None]
        )
        v = np.concatenate([free, np.zeros((1, self.dim))]).ravel()
        self.interactions.begin_step(h, self.theta)
        self.report = solve(self.interactions, v, **options)
        work = self.interactions.commit(v)
        self.velocity = v.reshape(-1, self.dim)[:-1].copy()
        return work

    def __getattr__(self, name):
        if name in ("jump", "impulse", "damage", "opening_max", "status"):
            return self.interactions.gather(name)[0]
        raise AttributeError(name)

    @property
    def kinetic(self):
        """Kinetic energy of the finite masses (J)."""
        finite = np.isfinite(self.masses)
        return 0.5 * np.sum(self.masses[finite, None] * self.velocity[finite] ** 2)
