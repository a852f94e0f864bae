# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Bonded bodies that spin steadily, as the discrete equations of a run have it.

With P the projector on the plane that spins, R the turn of a step by phi in it, J = dR / dphi
there, and positions from the centre of mass, look for q_n = R^n X and v_n = Omega J R^n X. The rule
q1 = q0 + h (v0 + v1) / 2 of both schemes asks for

    Omega = (2 / h) tan(phi / 2),   M (v1 - v0) / h = -kappa M R^(1/2) P X,
    kappa = (4 / h^2) sin(phi / 2)^2 / cos(phi / 2).

With S = cos(phi / 2) P + (1 - P), forces and points of an explicit bulk are those of positions
q0 + h v0 / 2 = R^(1/2) S^-1 X. An implicit one has the mean of the forces at both ends,
R^(1/2) S f(X), and points at q_m = R^(1/2) S X. All turned back by R^(1/2), the law of motion is a
static problem for X,

    explicit:   f(S^-1 X) + g = kappa M P X,      implicit:   S f(X) + g = kappa M P X,

with g what bonds bear, whose jump D, frame F and arms are those of S^-1 X or S X. The mean of the
jumps U0 and U1 of a step is, if C_N = C_T and the bond is open,

    explicit:   F_m (d0 + d1) / 2 = F S^2 D,      implicit:   F D;

else, in 2D, that of F(q0) d0 = F(q1) d1,

    explicit:   cos(phi / 2) F D,                 implicit:   F D / cos(phi / 2).

Traction r, -C times it, comes with the couple -D x f on the lips. An explicit bulk gets the couple
p after the law has had its velocities, whose mean jump then lacks (h^2 / 4) F B M^-1 p.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scenes import nodes

from xper_fx.bulk.state import State

# Of complex steps, and of differences of forces.
TINY, SMALL = 1e-30, 1e-6


class Spin(NamedTuple):
    """A steady spin about the z axis.

    Attributes:
        angle: phi, of a step (rad).
        stiffness: C_N, C_T of all bonds (Pa/m).
    """

    angle: float
    stiffness: tuple[float, float]


def turned(x: np.ndarray, angle: float) -> np.ndarray:
    """Vectors, shape (n, dim), turned about the z axis."""
    out = x.copy()
    out[:, 0] = np.cos(angle) * x[:, 0] - np.sin(angle) * x[:, 1]
    out[:, 1] = np.sin(angle) * x[:, 0] + np.cos(angle) * x[:, 1]
    return out


def frames(a: np.ndarray) -> np.ndarray:
    """Rows n, t1 (, t2) for tangents of shape (n, dim - 1, dim); complex ones too."""

    def dot(x, y):
        return np.einsum("pd,pd->p", x, y)[:, None]

    if a.shape[2] == 2:
        t = a[:, 0] / np.sqrt(dot(a[:, 0], a[:, 0]))
        return np.stack([np.stack([t[:, 1], -t[:, 0]], 1), t], 1)
    n = np.cross(a[:, 0], a[:, 1])
    n = n / np.sqrt(dot(n, n))
    # the nearest turn of axes in the plane: sum of t_alpha . a_alpha the largest
    one, two = a[:, 0] - np.cross(n, a[:, 1]), a[:, 1] + np.cross(n, a[:, 0])
    one, two = (x / np.sqrt(dot(x, x)) for x in (one, two))
    return np.stack([n, one, two], 1)


class Bonds:
    """The forces of all bonds of a run, nodal points, all sound and open, in plain NumPy."""

    def __init__(self, simulation, spin: Spin, explicit: bool):
        self.points = simulation.interactions.points
        self.x = nodes(simulation)
        self.mass = simulation.bulk.mass.reshape(self.x.shape)
        dim, cosine = self.x.shape[1], np.cos(0.5 * spin.angle)
        self.alike = spin.stiffness[0] == spin.stiffness[1]
        assert self.alike or dim == 2
        self.stiffness = np.array([spin.stiffness[0], *[spin.stiffness[1]] * (dim - 1)])
        plane = np.arange(dim) < 2
        if self.alike:
            self.scale = np.where(plane, cosine**2, 1.0) if explicit else np.ones(dim)
        else:
            self.scale = np.full(dim, cosine if explicit else 1.0 / cosine)
        # of velocities that a law does not know, beside those it does: the couple's, half of them
        self.late = 0.25 * simulation.step_size**2 if explicit else 0.0
        at = simulation.scheme.inverse(simulation.step_size, 0.0 * self.x.ravel()).nodes
        self.sides, self.lips = at[self.points.nodes[:, :, 0].T], at[self.points.lips.nodes]

    def jump(self, values: np.ndarray) -> np.ndarray:
        """Of the candidate from the antagonist."""
        return values[self.sides[0]] - values[self.sides[1]]

    def _tangents(self, u):
        lips = self.points.lips
        return lips.tangent + 0.5 * np.einsum("psja,psjd->pad", lips.gradient, u[self.lips])

    def _couples(self, y, r, d):
        """On the nodes, r . F' d of forces r by complex steps of the frames."""
        lips, out = self.points.lips, np.zeros_like(y)
        at = self._tangents(y - self.x)
        for alpha in range(at.shape[1]):
            for e in range(at.shape[2]):
                step = at.astype(complex)
                step[:, alpha, e] += 1j * TINY
                power = np.einsum("pi,pid,pd->p", r, frames(step).imag / TINY, d)
                given = 0.5 * lips.gradient[..., alpha] * power[:, None, None]
                np.add.at(out[:, e], self.lips, given)
        return out

    def forces(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """On the bodies where points look at positions y, shape as they, and tractions (Pa)."""
        d, frame = self.jump(y), frames(self._tangents(y - self.x))
        known = np.einsum("pid,pd->pi", frame, self.scale * d)
        couples, area = np.zeros_like(y), self.points.area[:, None]
        for _ in range(1 if not self.late else 8):
            late = self.late * self.jump(couples / self.mass)
            traction = -self.stiffness * (known - np.einsum("pid,pd->pi", frame, late))
            couples = self._couples(y, area * traction, d)
        force, out = np.einsum("pid,pi->pd", frame, area * traction), couples.copy()
        np.add.at(out, self.sides[0], force)
        np.add.at(out, self.sides[1], -force)
        return out, traction


class SteadySpin:
    """A steady spin of a simulation before its first step.

    Attributes:
        position, velocity: of the nodes at the start.
        traction: of the bonds, shape (num_points, dim), in their frames (Pa).
    """

    def __init__(self, simulation, spin: Spin):
        self.spin, bulk = spin, simulation.bulk
        explicit = simulation.options.scheme == "explicit"
        self._bonds = bonds = Bonds(simulation, spin, explicit)
        x, mass, cosine = bonds.x, bonds.mass, np.cos(0.5 * spin.angle)
        self.centre = (mass * x).sum(axis=0) / mass.sum(axis=0)
        plane = np.where(np.arange(x.shape[1]) < 2, 1.0, 0.0)
        shrunk = plane * cosine + (1.0 - plane)
        pull = mass * plane * (2.0 * np.sin(0.5 * spin.angle) / simulation.step_size) ** 2 / cosine

        def middle(position):
            away = position - self.centre
            return self.centre + (away / shrunk if explicit else away * shrunk)

        def left(flat):
            position = flat.reshape(x.shape)
            at = middle(position) if explicit else position
            inner = bulk.internal((at - x).ravel()).reshape(x.shape)
            inner = inner if explicit else shrunk * inner
            given, _ = bonds.forces(middle(position))
            return (inner - given - pull * (position - self.centre)).ravel()

        self.position = _solved(left, x.ravel()).reshape(x.shape)
        self.traction = bonds.forces(middle(self.position))[1]
        rate = 2.0 / simulation.step_size * np.tan(0.5 * spin.angle)
        self.velocity = rate * plane * turned(self.position - self.centre, 0.5 * np.pi)

    def give(self, simulation, angle: float = 0.0) -> None:
        """Let a run begin with this spin, turned by an angle."""
        bulk = simulation.bulk
        displacement = (self.at(angle) - self._bonds.x).ravel()
        velocity = turned(self.velocity, angle).ravel()
        internal, external = bulk.internal(displacement), bulk.external(0.0)
        simulation.state = State(0.0, displacement, velocity, internal, external)

    def at(self, angle: float) -> np.ndarray:
        """Positions after a turn."""
        return self.centre + turned(self.position - self.centre, angle)


def _solved(left, x: np.ndarray) -> np.ndarray:
    """Newton's method with differences of forces; rigid motions stay as they are."""
    for iteration in range(7):
        found = left(x)
        if iteration < 3:
            rows = np.array([left(x + step) - found for step in SMALL * np.eye(len(x))]) / SMALL
            inverse = np.linalg.pinv(rows.T, rcond=1e-8)
        x = x - inverse @ found
    assert np.abs(left(x)).max() < 1e-11
    return x
