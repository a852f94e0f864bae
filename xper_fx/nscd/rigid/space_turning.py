# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rotation of rigid bodies between kicks in 3D: the drift.

With R from the body's axes to those of space, J the inertia in the body's axes, L the angular
momentum about the centre of mass in space and Pi = R^T L that in the body, a free body obeys
Euler's equations dPi/dt = Pi x J^-1 Pi and dR/dt = R [omega]_x with omega = J^-1 Pi. The implicit
midpoint rule over tau,

    Pi1 - Pi0 = tau Pi_m x omega_m,   omega_m = J^-1 Pi_m,   Pi_m = (Pi0 + Pi1) / 2,
    R1 = R0 cay(tau omega_m),         cay(2 a) y = y + 2 / (1 + |a|^2) (a x y + a x (a x y)),

is of second order and symmetric in time (Lewis, Simo 1994; Hairer, Lubich, Wanner 2006, VII.5).
Its first line says Pi1 = cay(-tau omega_m) Pi0, so that L is conserved exactly: it is the state
that is kept. Its product with omega_m says that the energy is, too. Newton's method finds Pi_m; a
body that turns by more than a radian in a drift takes several drifts of equal size, since beyond
two radians Newton's method may fail. A body with one moment of inertia turns about L by the exact
rotation.

A body with a prescribed spin component is *guided*. Let c be its prescribed components of the spin
in space, which keep their value in a drift, and f the free ones, whose angular momentum does not
change but for the drift's turn of J:

    (J(R1) omega1)_f = (J(R0) omega0)_f,   R1 = exp(tau (omega0 + omega1) / 2) R0,

solved by fixed points. About a fixed axis this is exact; with two free components it is of second
order. Guides work in a drift: the energy of a guided body may change there. A body without mass,
such as a wall, keeps its spin.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from xper_fx.cache import njit
from xper_fx.nscd.algebra import space
from xper_fx.nscd.kernel_options import LEAN_ENTRY, LEAN_INNER, MERGED
from xper_fx.nscd.rigid.bodies import RigidBodies
from xper_fx.nscd.rigid.plane_turning import Turn

add, dot, matrix_vector, row, scale, set_row, subtract = (
    njit(**MERGED)(getattr(function, "py_func", function))  # no kernels if Numba is off
    for function in (
        space.add,
        space.dot,
        space.matrix_vector,
        space.row,
        space.scale,
        space.set_row,
        space.subtract,
    )
)

# How a body turns in 3D.
_ROUND, _TUMBLING, _GUIDED, _MASSLESS = range(4)
# Principal moments that differ by less, relative to their mean, are equal.
_EQUAL_MOMENTS = 1e-12
# Newton stops at a correction below this, relative to the momentum: the next would be its square.
_NEWTON_STOP, _NEWTON_STEPS, _MOST_PIECES = 1e-10, 12, 4096
_GUIDED_STOP, _GUIDED_STEPS = 1e-15, 100


class SpaceTurning:
    """Rotation of bodies in 3D."""

    def __init__(self, bodies: RigidBodies):
        self.body_inertia = bodies.inertia.copy()
        prescribed = np.ascontiguousarray(bodies.is_prescribed[:, 3:])
        massive = bodies.mass > 0.0
        self.body_inverse = np.zeros_like(self.body_inertia)
        self.body_inverse[massive] = np.linalg.inv(self.body_inertia[massive])
        mean = np.trace(self.body_inertia, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
        apart = np.abs(self.body_inertia - mean).max(axis=(1, 2))
        self.how = np.where(apart <= _EQUAL_MOMENTS * mean[:, 0, 0], _ROUND, _TUMBLING)
        self.how[prescribed.any(axis=1)] = _GUIDED
        self.how[~massive] = _MASSLESS
        self.how = self.how.astype(np.int8)
        self._kinds = tuple(bool(np.any(self.how == kind)) for kind in range(4))
        round_ones = self.how == _ROUND
        self.body_inertia[round_ones] = mean[round_ones]
        self.body_inverse[round_ones] = np.eye(3) / mean[round_ones, :1, :1]
        self.prescribed = prescribed
        self.guided = np.nonzero(self.how >= _GUIDED)[0]
        self.inverse = self.body_inverse.copy()
        rotation = np.ascontiguousarray(bodies.rotation)
        inertia = rotation @ self.body_inertia @ np.swapaxes(rotation, 1, 2)
        inertia[round_ones] = self.body_inertia[round_ones]
        momentum = np.einsum("nij,nj->ni", inertia, bodies.spin)
        self.initial = Turn(rotation.copy(), momentum, bodies.spin.copy(), inertia)
        self.update_inverse(self.initial, self.inverse)

    def drift(self, size: float, turn: Turn) -> Turn:
        """Bodies after a time `size` (s) without torques but those of their guides.

        Raises:
            FloatingPointError: a velocity is not finite, or a body spins far too fast for the step.
        """
        end = Turn(*(np.empty_like(part) for part in turn))
        failed = _drift_kernel(*self._kinds)(
            size, self.how, self.body_inertia, self.body_inverse, self.prescribed, turn, end,
            np.empty_like(self.inverse),
        )  # fmt: skip
        if failed >= 0:
            raise FloatingPointError(
                f"The rotation of rigid body {failed} could not be followed over {size:.3g} s: its "
                f"spin is {turn.spin[failed]} rad/s. Take a smaller step."
            )
        return end

    def turned(self, angle: np.ndarray, turn: Turn) -> Turn:
        """Bodies turned at once by rotation vectors (rad), shape (n, 3), spins with them.

        Guided bodies keep the spin that they have in space.
        """
        by = Rotation.from_rotvec(angle).as_matrix()
        inertia = by @ turn.inertia @ np.swapaxes(by, 1, 2)
        momentum, spin = (np.einsum("nij,nj->ni", by, x) for x in (turn.momentum, turn.spin))
        spin[self.guided] = turn.spin[self.guided]
        momentum[self.guided] = np.einsum("nij,nj->ni", inertia, spin)[self.guided]
        return Turn(by @ turn.rotation, momentum, spin, inertia)

    def update_inverse(self, turn: Turn, inverse: np.ndarray) -> None:
        """Write w of the spins into `inverse`, shape (n, 3, 3): the free ones' J_ff^-1."""
        _, tumbling, guided, _ = self._kinds
        if tumbling or guided:
            _inverse_kernel(tumbling, guided)(
                self.how,
                turn.rotation,
                turn.inertia,
                self.body_inverse,
                self.prescribed,
                self.inverse,
            )
        inverse[:] = self.inverse


@njit(**MERGED)
def _cross(x, y):
    return x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]


@njit(**MERGED)
def _column(a, i, j):
    return a[i, 0, j], a[i, 1, j], a[i, 2, j]


@njit(**MERGED)
def _row(a, i, k):
    return a[i, k, 0], a[i, k, 1], a[i, k, 2]


@njit(**MERGED)
def _copy(a, i, out):
    """out[i] = a[i], without making views of them."""
    for k in range(3):
        for j in range(3):
            out[i, k, j] = a[i, k, j]


@njit(**MERGED)
def _transposed_vector(a, i, x):
    """a[i]^T x."""
    return dot(_column(a, i, 0), x), dot(_column(a, i, 1), x), dot(_column(a, i, 2), x)


@njit(**MERGED)
def _turned(x, a, once, twice):
    """x + once (a cross x) + twice (a cross (a cross x))."""
    y = _cross(a, x)
    return add(x, add(scale(once, y), scale(twice, _cross(a, y))))


@njit(**LEAN_INNER)
def _restore(a, i):
    """One step of Newton's for the nearest rotation, R (3 I - R^T R) / 2: rounding only."""
    c0, c1, c2 = _column(a, i, 0), _column(a, i, 1), _column(a, i, 2)
    g00, g11, g22 = dot(c0, c0), dot(c1, c1), dot(c2, c2)
    g01, g02, g12 = dot(c0, c1), dot(c0, c2), dot(c1, c2)
    for k in range(3):
        x, y, z = a[i, k, 0], a[i, k, 1], a[i, k, 2]
        a[i, k, 0] = 0.5 * ((3.0 - g00) * x - g01 * y - g02 * z)
        a[i, k, 1] = 0.5 * ((3.0 - g11) * y - g01 * x - g12 * z)
        a[i, k, 2] = 0.5 * ((3.0 - g22) * z - g02 * x - g12 * y)


@njit(**LEAN_INNER)
def _turn_in_space(angle, a, i):
    """a[i] becomes exp([angle]_x) a[i], for a rotation vector `angle` (rad)."""
    size = np.sqrt(dot(angle, angle))
    half = np.sin(0.5 * size) / (0.5 * size) if size > 0.0 else 1.0
    once, twice = half * np.cos(0.5 * size), 0.5 * half * half
    for j in range(3):
        x = _turned(_column(a, i, j), angle, once, twice)
        a[i, 0, j], a[i, 1, j], a[i, 2, j] = x


@njit(**LEAN_INNER)
def _turn_inertia(rotation, body, i, out):
    """out[i] = R body R^T, symmetric to the last digit."""
    for k in range(3):
        x = matrix_vector(body, i, _row(rotation, i, k))
        for j in range(k + 1):
            out[i, k, j] = out[i, j, k] = dot(_row(rotation, i, j), x)


@njit(**LEAN_INNER)
def _tumble(size, i, inverse, momentum, rotation):
    """Turn rotation[i] by one midpoint step of a free body; whether Newton settled."""
    pi0 = _transposed_vector(rotation, i, momentum)
    bound = _NEWTON_STOP * np.sqrt(dot(pi0, pi0))
    half = 0.5 * size
    pi = pi0
    for _ in range(_NEWTON_STEPS):
        spin = matrix_vector(inverse, i, pi)
        residual = subtract(subtract(pi, pi0), scale(half, _cross(pi, spin)))
        # Columns of I + half [spin]_x - half [pi]_x J^-1.
        a = scale(-half, _cross(pi, _column(inverse, i, 0)))
        b = scale(-half, _cross(pi, _column(inverse, i, 1)))
        c = scale(-half, _cross(pi, _column(inverse, i, 2)))
        a = add(a, (1.0, half * spin[2], -half * spin[1]))
        b = add(b, (-half * spin[2], 1.0, half * spin[0]))
        c = add(c, (half * spin[1], -half * spin[0], 1.0))
        bc = _cross(b, c)
        scaling = -1.0 / dot(a, bc)
        correction = scale(
            scaling, (dot(residual, bc), dot(residual, _cross(c, a)), dot(residual, _cross(a, b)))
        )
        pi = add(pi, correction)
        error = np.sqrt(dot(correction, correction))
        if error <= bound:
            a = scale(-half, matrix_vector(inverse, i, pi))
            both = 2.0 / (1.0 + dot(a, a))
            for k in range(3):
                x = _turned(_row(rotation, i, k), a, both, both)
                rotation[i, k, 0], rotation[i, k, 1], rotation[i, k, 2] = x
            return True
    return False


@njit(**LEAN_INNER)
def _tumble_in_pieces(size, i, inverse, momentum, start, rotation):
    """Turn a free body over a whole drift; whether that was possible."""
    pi = _transposed_vector(start, i, momentum)
    spin = matrix_vector(inverse, i, pi)
    angle = size * np.sqrt(dot(spin, spin))
    if not angle < _MOST_PIECES:
        return False
    pieces = 1 + int(angle)
    _copy(start, i, rotation)
    settled = True
    for _ in range(pieces):
        settled = settled and _tumble(size / pieces, i, inverse, momentum, rotation)
        _restore(rotation, i)
    return settled


@njit(**LEAN_INNER)
def _free_inverse(matrix, prescribed, i, out):
    """out[i] = the inverse of the free rows and columns of matrix[i], zeros elsewhere."""
    free = 0
    for k in range(3):
        for j in range(3):
            out[i, k, j] = 0.0
        free += 0 if prescribed[i, k] else 1
    if free == 1:
        for k in range(3):
            if not prescribed[i, k]:
                out[i, k, k] = 1.0 / matrix[i, k, k]
    elif free == 2:
        j, k = (1, 2) if prescribed[i, 0] else (0, 2) if prescribed[i, 1] else (0, 1)
        determinant = matrix[i, j, j] * matrix[i, k, k] - matrix[i, j, k] * matrix[i, k, j]
        out[i, j, j] = matrix[i, k, k] / determinant
        out[i, k, k] = matrix[i, j, j] / determinant
        out[i, j, k] = out[i, k, j] = -matrix[i, j, k] / determinant


@njit(**LEAN_INNER)
def _guide(size, i, body_inertia, prescribed, turn, end, inverse):
    """Turn a guided body; whether the fixed points settled."""
    spin0 = row(turn.spin, i)
    bound = _GUIDED_STOP * np.sqrt(dot(spin0, spin0))
    spin = spin0
    best = np.inf
    for _ in range(_GUIDED_STEPS):
        _copy(turn.rotation, i, end.rotation)
        _turn_in_space(scale(0.5 * size, add(spin0, spin)), end.rotation, i)
        _turn_inertia(end.rotation, body_inertia, i, end.inertia)
        _free_inverse(end.inertia, prescribed, i, inverse)
        missing = subtract(row(turn.momentum, i), matrix_vector(end.inertia, i, spin))
        correction = matrix_vector(inverse, i, missing)
        spin = add(spin, correction)
        error = np.sqrt(dot(correction, correction))
        # At the end corrections are rounding, and no longer fall.
        if error <= bound or (error >= best and error <= 1e4 * bound):
            _restore(end.rotation, i)
            set_row(end.spin, i, spin)
            set_row(end.momentum, i, matrix_vector(end.inertia, i, spin))
            return True
        best = error
    return False


@cache
def _drift_kernel(round_ones: bool, tumbling: bool, guided: bool, massless: bool):
    """Kernel that fills `end`, for the kinds there are; the first body that failed, -1 if none."""

    @njit(**LEAN_ENTRY)
    def drift(size, how, body_inertia, body_inverse, prescribed, turn, end, inverse):
        for i in range(len(how)):
            momentum = row(turn.momentum, i)
            settled = True
            if guided and how[i] == _GUIDED:
                settled = _guide(size, i, body_inertia, prescribed, turn, end, inverse)
            keeps_spin = massless and how[i] == _MASSLESS
            if keeps_spin or (round_ones and how[i] == _ROUND):
                spin = row(turn.spin, i)
                if not keeps_spin:
                    spin = scale(body_inverse[i, 0, 0], momentum)
                _copy(turn.rotation, i, end.rotation)
                _turn_in_space(scale(size, spin), end.rotation, i)
                _restore(end.rotation, i)
                _copy(body_inertia, i, end.inertia)
                settled = np.isfinite(dot(spin, spin))
                set_row(end.momentum, i, momentum)
                set_row(end.spin, i, spin)
            if tumbling and how[i] == _TUMBLING:
                settled = _tumble_in_pieces(
                    size, i, body_inverse, momentum, turn.rotation, end.rotation
                )
                pi = _transposed_vector(end.rotation, i, momentum)
                spin = matrix_vector(end.rotation, i, matrix_vector(body_inverse, i, pi))
                _turn_inertia(end.rotation, body_inertia, i, end.inertia)
                set_row(end.momentum, i, momentum)
                set_row(end.spin, i, spin)
            if not settled:
                return i
        return -1

    return drift


@cache
def _inverse_kernel(tumbling: bool, guided: bool):
    """Kernel that renews w of the spins of the kinds there are."""

    @njit(**LEAN_ENTRY)
    def update_inverse(how, rotation, inertia, body_inverse, prescribed, inverse):
        for i in range(len(how)):
            if tumbling and how[i] == _TUMBLING:
                _turn_inertia(rotation, body_inverse, i, inverse)
            if guided and how[i] == _GUIDED:
                _free_inverse(inertia, prescribed, i, inverse)

    return update_inverse
