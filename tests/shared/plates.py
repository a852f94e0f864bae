# SPDX-License-Identifier: LGPL-3.0-or-later
"""A crossed-triangle plate whose every cell is a body, in plain NumPy: the reference for nscd."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.points import InteractionPoints, frame_from_normal


@dataclass
class Plate:
    """Exploded plate: node 3 c + j is vertex j of cell c."""

    x: np.ndarray  # (num_cells, 3, 2)
    stiffness: np.ndarray  # (num_cells, 6, 6)
    mass: np.ndarray  # (num_cells, 6) lumped
    points: InteractionPoints
    lambda_mu: tuple[float, float]

    def inverse(self, step, theta, fixed=None):
        """Blocks of (M + h^2 theta^2 K)^-1 with zero rows and columns where prescribed."""
        a = step**2 * theta**2 * self.stiffness.copy()
        a[:, range(6), range(6)] += self.mass
        if fixed is None:
            return BodyInverse.from_uniform(np.linalg.inv(a), 2)
        fixed = fixed.reshape(-1, 6)
        a[fixed[:, :, None] | fixed[:, None, :]] = 0.0
        a[:, range(6), range(6)] += fixed
        w = np.linalg.inv(a)
        w[:, range(6), range(6)] -= fixed
        return BodyInverse.from_uniform(w, 2)

    def internal(self, u):
        """K u, shape (num_cells, 6)."""
        return np.einsum("cij,cj->ci", self.stiffness, u.reshape(-1, 6))


def crossed_plate(n, size, young=99e9, nu=0.325, density=7800.0) -> Plate:
    """n x n crossed quads on a square, plane strain, nodal points of half a facet each."""
    s = size / n
    grid = (n + 1) * (n + 1)
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="xy")
    i, j = i.ravel(), j.ravel()
    corner = lambda a, b: (j + b) * (n + 1) + i + a  # noqa: E731
    centre = grid + j * n + i
    v = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)]
    cells = np.stack(
        [np.stack([v[k], v[(k + 1) % 4], centre], axis=1) for k in range(4)], axis=1
    ).reshape(-1, 3)
    gx, gy = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="xy")
    xy = np.concatenate(
        [
            np.stack([gx.ravel(), gy.ravel()], axis=1) * s,
            np.stack([(i + 0.5) * s, (j + 0.5) * s], axis=1),
        ]
    )
    x = xy[cells]
    b = np.stack(
        [x[:, [1, 2, 0], 1] - x[:, [2, 0, 1], 1], x[:, [2, 0, 1], 0] - x[:, [1, 2, 0], 0]], axis=2
    )
    area = 0.5 * np.abs(b[:, 0, 0] * b[:, 1, 1] - b[:, 0, 1] * b[:, 1, 0])
    grad = b / (2 * area[:, None, None])
    strain = np.zeros((len(cells), 3, 6))
    strain[:, 0, 0::2] = grad[:, :, 0]
    strain[:, 1, 1::2] = grad[:, :, 1]
    strain[:, 2, 0::2] = grad[:, :, 1]
    strain[:, 2, 1::2] = grad[:, :, 0]
    lam, mu = young * nu / ((1 + nu) * (1 - 2 * nu)), young / (2 * (1 + nu))
    d = np.array([[lam + 2 * mu, lam, 0], [lam, lam + 2 * mu, 0], [0, 0, mu]])
    stiffness = np.einsum("cai,ab,cbj,c->cij", strain, d, strain, area)
    mass = np.repeat(density * area / 3, 6).reshape(-1, 6)
    edges = {}
    for c, cell in enumerate(cells):
        for k in range(3):
            p, q = k, (k + 1) % 3
            edges.setdefault(tuple(sorted((cell[p], cell[q]))), []).append((c, p, q))
    pairs = []
    for sides in edges.values():
        if len(sides) == 2:
            (c0, p0, q0), (c1, p1, q1) = sides
            if cells[c0, p0] != cells[c1, p1]:
                p1, q1 = q1, p1
            pairs.append((c0, p0, q0, c1, p1, q1))
    pairs = np.array(pairs)
    c0, p0, q0, c1, p1, q1 = pairs.T
    a, e = x[c0, p0], x[c0, q0]
    t = e - a
    length = np.linalg.norm(t, axis=1)
    normal = np.stack([t[:, 1], -t[:, 0]], axis=1) / length[:, None]
    towards = x[c0].mean(axis=1) - x[c1].mean(axis=1)
    normal[np.sum(normal * towards, axis=1) < 0] *= -1
    nodes = np.stack(
        [
            np.stack([3 * c0 + p0, 3 * c1 + p1], axis=1),
            np.stack([3 * c0 + q0, 3 * c1 + q1], axis=1),
        ],
        axis=1,
    ).reshape(-1, 2, 1)
    points = InteractionPoints(
        nodes.astype(np.int32),
        np.ones(nodes.shape),
        np.repeat(frame_from_normal(normal), 2, axis=0),
        np.repeat(length / 2, 2),
        np.zeros(len(nodes)),
    )
    return Plate(x, stiffness, mass, points, (lam, mu))
