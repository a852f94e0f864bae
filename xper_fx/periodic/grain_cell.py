# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Rigid bodies in a periodic cell: the two-field problem without a mesh.

With the gradient F = Fbar of the cell, a body at x has the label X = F^-1 x and the velocity

    v = v# + dF/dt X,

and its images at x + F S, S a vector of the reference lattice, have the same fluctuation v#. As for
meshed bodies (`two_field.py`) inertia acts on the fluctuation alone. Grains flow, so that labels
are those of the present positions: with constant dF/dt these are Newton's equations, and else those
of Newton without the acceleration d2F/dt2 X, which would tell an image from its body. One step of
size h is drift, kick, drift, as in `nscd/rigid/motion.py`:

    drift   F_m = F0 + h (1 - theta) dF0,    x_m = x0 + h (1 - theta) v0,    X = F_m^-1 x_m;
    kick    M (v#1 - v#0) = p,               v#0 = v0 - dF0 X,    v1 = v#1 + dF1 X,
            m_c (dF1 - dF0) = h V Pibar + sum r (x) b + K   (components driven by stress);
    drift   F1 = F_m + h theta dF1,          x1 = x_m + h theta v1.

A contact with the branch l = x_c - x_a,image between centres reads U = v#_c - v#_a + dF b (+ arms),
b = F_m^-1 l, as follows from S in v of the image, and so the impulse r on its candidate gives the
cell r (x) b. At rest the equation of the cell is

    Pibar = - (1/(h V)) sum r (x) F^-1 l,    or  sigma = Pibar F^T / J = - (1/|cell|) sum f (x) l,

the mean stress of Weber (1966) and Love, V the volume of the reference cell, tension positive.

**Kinetic stress.** When labels follow the positions, over a time tau with F' at its end,

    v#' = v# - tau dF F'^-1 v#,    change of the kinetic energy = - K : dF,
    K = tau sum m (v# + v#')/2 (x) F'^-1 v#,

exactly: K / (tau V) is the kinetic part of -Pibar. Both drifts have one; the kick of a component
driven by stress gets those of the two drifts before it. What that is late by is booked as energy of
the scheme.

**Inertia of the cell.** m_c = M |H|^2 / (12 dim), M the mass of all bodies and H the matrix of a
short basis of the lattice: what the affine motion of the bodies of a square or cubic cell has.
Means over times longer than (m_c / (V |Pibar|))^(1/2) do not depend on it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from xper_fx.forms.loads import value_at
from xper_fx.nscd.rigid.bodies import RigidBodies
from xper_fx.nscd.rigid.body import Load
from xper_fx.nscd.rigid.motion import Prediction, RigidMotion, RigidState, RigidWork
from xper_fx.nscd.search.periodic_search import short_basis
from xper_fx.periodic.drive import MacroscopicDrive


class GrainStress(NamedTuple):
    """The macroscopic side of a periodic cell of rigid bodies at a committed time."""

    gradient: np.ndarray  #: Fbar, shape (dim, dim)
    #: Pibar, the mean first Piola-Kirchhoff stress of the contacts and of the fluctuation over the
    #: last step, shape (dim, dim), Pa, tension positive
    stress: np.ndarray
    rate: np.ndarray  #: dFbar/dt at the end of the step, shape (dim, dim), 1/s

    @property
    def cauchy(self) -> np.ndarray:
        """Mean Cauchy stress Pibar Fbar^T / det Fbar, shape (dim, dim), Pa."""
        return self.stress @ self.gradient.T / np.linalg.det(self.gradient)


class CellMotion(RigidMotion):
    """Time integration of rigid bodies in a periodic cell that keeps its shape.

    Args:
        bodies, gravity: see `RigidMotion`.
        lattice: shape (p, dim), period vectors as rows, m.
    """

    def __init__(self, bodies: RigidBodies, lattice: np.ndarray, gravity: Load | None = None):
        super().__init__(bodies, gravity)
        self.lattice = lattice

    @property
    def displayed(self) -> RigidState:
        """The committed state, each body by its image in the cell at the origin.

        Of the cells that the lattice has at the time, it is the one of a short basis.
        """
        return self._in_cell(self.lattice, np.zeros_like(self.lattice))

    def _in_cell(self, vectors: np.ndarray, rates: np.ndarray) -> RigidState:
        numbers, state = short_basis(vectors), self.state
        share = state.position @ np.linalg.pinv(numbers @ vectors)
        bounded = np.isfinite(self.bodies.bounding_radius)[:, None]
        crossed = np.where(bounded, np.floor(share), 0.0) @ numbers
        return state._replace(
            position=state.position - crossed @ vectors, velocity=state.velocity - crossed @ rates
        )


class DrivenCellMotion(CellMotion):
    """Time integration of rigid bodies and of the periodic cell that they are in.

    Slots are those of `RigidMotion`, with fluctuations for velocities, and behind them the columns
    of dF/dt, two of which have a block of w as a body has.

    Args:
        bodies: none of which has prescribed translations; their velocities are fluctuations.
        lattice: shape (dim, dim), period vectors of the reference cell as rows, m.
        drive: of the cell.

    Attributes:
        gradient: Fbar, shape (dim, dim).
        rate: dFbar/dt, shape (dim, dim), 1/s.
        volume: of the reference cell, m^3 (2D: m^2).
        cell_mass: m_c, kg m^2 (2D: kg m).
        stress: Pibar of the last step, shape (dim, dim), Pa.
    """

    def __init__(self, bodies: RigidBodies, lattice: np.ndarray, drive: MacroscopicDrive):
        super().__init__(bodies, lattice)
        n, dim = len(bodies), bodies.dim
        self._drive = drive
        self._driven = drive.kinematic(dim).reshape(dim, dim).T
        self.volume = abs(float(np.linalg.det(lattice)))
        basis = short_basis(lattice) @ lattice
        self.cell_mass = float(bodies.mass.sum() * (basis**2).sum() / (12 * dim))
        self.gradient, self.rate = np.eye(dim), self._given_rates(0.0)
        self.stress, self._late = np.zeros((2, dim, dim))
        self.start = self.state = self.state._replace(
            velocity=self.state.velocity + self.state.position @ self.rate.T
        )
        blocks = np.zeros((n + (dim + 1) // 2, 2 * dim, 2 * dim))
        blocks[:n] = self._of_bodies
        self.blocks, self._of_bodies = blocks, blocks[:n]
        columns = np.zeros((2 * (len(blocks) - n), dim))
        columns[:dim] = np.where(self._driven, 0.0, 1.0 / self.cell_mass).T
        diagonal = np.arange(2 * dim)
        blocks[n:, diagonal, diagonal] = columns.reshape(-1, 2 * dim)
        self._bodies_slots = slice(0, 2 * n)
        self._cell_slots = slice(2 * n, 2 * n + dim)
        self._padding = np.zeros((len(columns) - dim, dim))

    def _given_rates(self, time: float) -> np.ndarray:
        """dF/dt of the driven components, zero for the others, 1/s."""
        rates = np.zeros(self._driven.shape)
        for name, value in self._drive.rate.items():
            rates[int(name[0]) - 1, int(name[1]) - 1] = value_at(value, time)
        return rates

    def predict(self, step: float, theta: float, time: float) -> Prediction:
        """See `RigidMotion`; the cell is kicked too.

        Raises:
            FloatingPointError: the cell is strained by its own size in the step.
        """
        prediction = super().predict(step, theta, time)
        dim, first = self.bodies.dim, step * (1.0 - theta)
        self._middle_gradient = self._drifted(self.gradient, first * self.rate)
        self._labels = np.linalg.solve(self._middle_gradient, prediction.position.T).T
        affine = self._labels @ self.rate.T
        before = self._fluctuation(self.state, self.gradient, self.rate)
        self._start[:, :dim] -= affine
        prediction.free.reshape(self._start.shape)[:, :dim] -= affine
        self._first = self._kinetic_impulse(
            first, before, self._start[:, :dim], self._middle_gradient
        )
        asked = self._drive.stresses(dim, time + step).reshape(dim, dim).T
        self._asked = step * self.volume * asked
        pushed = self.rate + (self._asked + self._late + self._first) / self.cell_mass
        free = np.where(self._driven, self._given_rates(time + step), pushed)
        return Prediction(
            prediction.position,
            prediction.rotation,
            np.concatenate([self._start.reshape(-1, dim), self.rate.T, self._padding]),
            np.concatenate([prediction.free, free.T, self._padding]),
            self._middle_gradient,
        )

    def end(self, slots: npt.ArrayLike) -> RigidState:
        """See `RigidMotion`; the end of the cell besides."""
        step, theta = self._at
        slots, dim = np.reshape(slots, (-1, self.bodies.dim)), self.bodies.dim
        rate = slots[self._cell_slots].T
        kicked = slots[self._bodies_slots].reshape(self._start.shape).copy()
        fluctuation = kicked[:, :dim].copy()
        kicked[:, :dim] += self._labels @ rate.T
        end = super().end(kicked)
        self._kicked[:, :dim] = fluctuation
        self._change[:, :dim] = self.bodies.mass[:, None] * (fluctuation - self._start[:, :dim])
        gradient = self._drifted(self._middle_gradient, step * theta * rate)
        after = self._fluctuation(end, gradient, rate)
        second = self._kinetic_impulse(step * theta, fluctuation, after, gradient)
        self._end_of_cell = gradient, rate.copy(), second
        return end

    def commit(self) -> None:
        """See `RigidMotion`."""
        super().commit()
        self.gradient, self.rate, self._late = self._end_of_cell
        self.stress = self._stress_of_step

    def work(self, contacts: npt.ArrayLike | None = None) -> RigidWork:
        """See `RigidMotion`: `kinetic` is that of the fluctuation and of the cell.

        The work of a driven component is that of its reaction, `contacts` has the part of the
        branches.
        """
        if contacts is None:
            contacts = np.zeros((2 * len(self.blocks), self.bodies.dim))
        work = super().work(contacts[self._bodies_slots])
        step, theta = self._at
        gradient, rate, second = self._end_of_cell
        pushed = contacts[self._cell_slots].T
        self._stress_of_step = -(pushed + self._first + second) / (step * self.volume)
        mean, change = theta * rate + (1.0 - theta) * self.rate, rate - self.rate
        driven, free = self._driven, ~self._driven
        taken = self._first * self.rate + second * rate  # from the fluctuation, by the drifts
        held = mean * (self.cell_mass * change - pushed)
        given = mean * (self._late + self._first)
        scheme = (theta - 0.5) * self.cell_mass * change**2
        return RigidWork(
            kinetic=self._kinetic_of_cell(self._end, gradient, rate),
            loads=work.loads + float((mean * self._asked)[free].sum()),
            contacts=work.contacts + float((mean * pushed).sum()),
            prescribed=work.prescribed + float((held - taken)[driven].sum()),
            scheme=work.scheme + float(scheme.sum() + (taken - given)[free].sum()),
        )

    def reactions(self, contacts: npt.ArrayLike | None = None) -> np.ndarray:
        """See `RigidMotion`: of bodies whose spins are prescribed."""
        if contacts is not None:
            contacts = contacts[self._bodies_slots]
        return super().reactions(contacts)

    @property
    def macroscopic(self) -> GrainStress:
        """Gradient, stress and rate of the cell at the committed time."""
        return GrainStress(self.gradient, self.stress, self.rate)

    @property
    def kinetic(self) -> float:
        """Kinetic energy of the fluctuation, of the spins and of the cell (J)."""
        return self._kinetic_of_cell(self.state, self.gradient, self.rate)

    @property
    def fluctuation(self) -> np.ndarray:
        """See `RigidMotion`: v#."""
        return self._fluctuation(self.state, self.gradient, self.rate)

    @property
    def speeds(self) -> np.ndarray:
        """See `RigidMotion`: of the fluctuation, and of the cell between neighbours."""
        own = np.linalg.norm(self.fluctuation, axis=1)
        stretching = np.linalg.norm(np.linalg.solve(self.gradient.T, self.rate.T), 2)
        return own + stretching * self.bodies.bounding_radius

    @property
    def displayed(self) -> RigidState:
        """See `CellMotion`."""
        return self._in_cell(self.lattice @ self.gradient.T, self.lattice @ self.rate.T)

    def saved(self) -> dict[str, np.ndarray]:
        """See `RigidMotion`; the cell besides."""
        return super().saved() | {
            "gradient": self.gradient,
            "rate": self.rate,
            "late": self._late,
            "stress": self.stress,
        }

    def restore(self, saved: Mapping[str, np.ndarray]) -> None:
        """See `RigidMotion`."""
        super().restore(saved)
        self.gradient, self.rate = saved["gradient"], saved["rate"]
        self._late, self.stress = saved["late"], saved["stress"]

    def _kinetic_of_cell(self, state: RigidState, gradient, rate) -> float:
        fluctuating = state._replace(velocity=self._fluctuation(state, gradient, rate))
        return self._kinetic(fluctuating) + 0.5 * self.cell_mass * float((rate**2).sum())

    @staticmethod
    def _fluctuation(state: RigidState, gradient: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """v# = v - dF/dt F^-1 x, shape (n, dim), m/s."""
        return state.velocity - np.linalg.solve(gradient, state.position.T).T @ rate.T

    def _kinetic_impulse(self, size, before, after, gradient) -> np.ndarray:
        """K of a drift of a size (s), to whose end the gradient belongs; N m s (2D: N s)."""
        mean = self.bodies.mass[:, None] * (0.5 * size) * (before + after)
        return mean.T @ np.linalg.solve(gradient, before.T).T

    @staticmethod
    def _drifted(gradient: np.ndarray, change: np.ndarray) -> np.ndarray:
        strain = np.linalg.norm(np.linalg.solve(gradient.T, change.T), 2)
        if not strain < 1.0:  # below, no state on the way is turned inside out
            raise FloatingPointError(f"The periodic cell is strained by {strain:.3g} in a step.")
        return gradient + change
