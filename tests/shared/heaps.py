# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid bodies under gravity, stepped by the interaction layer alone, with what they must obey."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from solving import solve

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.laws import SignoriniCoulomb
from xper_fx.nscd.points import InteractionPoints
from xper_fx.nscd.rigid.bodies import RigidBodies
from xper_fx.nscd.rigid.body import RigidBody, wall
from xper_fx.nscd.rigid.motion import RigidMotion
from xper_fx.nscd.rigid.shapes import Disc, Sphere
from xper_fx.nscd.solvers import Automatic
from xper_fx.simulation.contact_detection import Detection

GRAVITY = 9.81


class Heap:
    """Rigid bodies that touch each other and fall, theta = 1/2.

    Args:
        bodies: those of the group "grains" are free, those of "box" are walls.
        friction: Coulomb's mu of all contacts, if no law is given.
        step: h (s).
        reach: of the search (m).

    Attributes:
        layer: the interactions.
        motion: of the rigid bodies.
        report: of the last solve.
    """

    def __init__(self, bodies, friction=0.3, step=1e-3, reach=None, law=None):
        self.bodies = RigidBodies(bodies)
        dim, self.step, self.time, self.report = self.bodies.dim, step, 0.0, None
        self.motion = RigidMotion(self.bodies, (*(0.0,) * (dim - 1), -GRAVITY))
        law = law or SignoriniCoulomb(friction)
        contacts = [
            SimpleNamespace(law=law, between=("grains", group), reach=reach)
            for group in self.bodies.groups
        ]
        scene = SimpleNamespace(
            contacts=contacts, rigid_bodies=self.bodies, surfaces={}, kept_apart=None, lattice=None
        )  # fmt: skip
        self.detection = Detection(scene, [], None)
        nothing = InteractionPoints(
            np.zeros((0, 2, 1), np.int32), np.zeros((0, 2, 1)), np.zeros((0, dim, dim)),
            np.zeros(0), np.zeros(0),
        )  # fmt: skip
        self.layer = Interactions(
            nothing, self.detection.laws, np.zeros(0, int),
            BodyInverse.from_uniform(np.zeros((0, dim, dim)), dim),
            rigid_blocks=self.motion.blocks,
        )  # fmt: skip

    def search(self):
        """Predict and find the contacts of a step."""
        prediction = self.motion.predict(self.step, 0.5, self.time)
        self.layer.take_rigid(prediction.start, prediction.free)
        bulk = SimpleNamespace(dim=self.bodies.dim, num_dofs=0)
        rest, nodes = SimpleNamespace(velocity=np.zeros(0)), np.zeros(0, int)
        self.detection.renew(self.layer, nodes, bulk, rest, prediction, self.step, 0.5)
        self.layer.begin_step(self.step, 0.5)

    def free_velocity(self):
        """Free velocities of the step that was predicted, flat."""
        free = np.empty(self.layer.inverse.num_slots * self.bodies.dim)
        self.layer.complete(free)
        return free

    def solve(self, solver=Automatic, **options):
        """Solve the step and commit it."""
        velocity = self.free_velocity()
        self.report = solve(self.layer, velocity, solver, num_threads=1, **options)
        self.end(velocity)

    def end(self, velocity):
        """Commit the step with these velocities."""
        slots = velocity.reshape(-1, self.bodies.dim)
        self.motion.end(self.layer.rigid_part(slots))
        self.layer.commit(velocity)
        self.motion.commit()
        self.time += self.step

    def advance(self, steps=1, solver=Automatic, **options):
        """Make steps."""
        for _ in range(steps):
            self.search()
            self.solve(solver, **options)

    @property
    def num_contacts(self):
        """Contacts that were found."""
        return sum(len(g) for g in self.layer.contacts)


def box(width, height, dim=2):
    """Walls: a floor at zero, and sides at 0 and `width` along each horizontal axis."""

    def plane(axis, at, sign):
        point, normal = np.zeros(dim), np.zeros(dim)
        point[axis], normal[axis] = at, sign
        return wall(tuple(point), tuple(normal), "box")

    sides = [plane(axis, at, sign) for axis in range(dim - 1) for at, sign in ((0, 1), (width, -1))]
    return [plane(dim - 1, 0.0, 1.0), *sides]


def grains(count, across, radius=0.01, dim=2, density=2000.0, least=0.7, pitch=2.2):
    """Discs or spheres on a lattice in a box.

    Args:
        count: how many, `across` of them side by side along each horizontal axis.
        radius: the largest (m); the smallest is `least` times that.
        pitch: of the lattice, in radii.
    """
    rng = np.random.default_rng(0)
    shape = Disc if dim == 2 else Sphere
    pitch *= radius
    bodies = []
    for number in range(count):
        place = np.array([number // across**d % across for d in range(dim - 1)]
                         + [number // across ** (dim - 1)], float)  # fmt: skip
        place[:-1] += max(0.0, 0.5 - radius / pitch) * rng.uniform(size=dim - 1)
        bodies.append(
            RigidBody(
                shape(rng.uniform(least, 1.0) * radius), tuple((place + 0.5) * pitch), "grains",
                density=density,
            )
        )  # fmt: skip
    return bodies + box(pitch * across + 0.2 * pitch, 0.0, dim)
