# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Springs that stand for the points' laws around a state of velocities and impulses.

A law's `solve` is a map r = S(u, r), whose fixed points for a velocity u are the impulses that the
law allows. Linearised in both,

    dr = g + K' H^T dv,   K' = (I - (1 - p) S_r)^-1 S_u,   g = (I - (1 - p) S_r)^-1 (S - r).

Where the law gives the impulse by itself (a bond: S_r = 0) that is its tangent. Where it holds the
velocity (contact, stick, a perfect bond) S_r has the eigenvalue 1, the impulse is a multiplier, and
p keeps its spring finite: 1 / p times that of the compliance W that the law was given, a proximal
term. Each step of Newton's method then leaves some p of the error of a multiplier, and the
constraint is exact where the iteration ends, whatever p is (Rockafellar 1976). Which branch a point
is on S decides with W alone: 1 / W is to be the stiffness of what the point stands on, so that gaps
and impulses that are yet to be found weigh alike.

A bond that softens pushes: K has a negative eigenvalue, and where the structure is softer the
correction leads to where forces balance at the top of a hill of energy. With |K|, the absolute
values of its eigenvalues, it leads down (Greenstadt 1967), slower.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.couplings import Sides, point_velocity, spread_kernel
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.nscd.laws.law import LawKernels

# Steps of the differences, relative to the local velocity, or to a share of the one that the
# impulse makes: that of a bond may be far larger than its opening, where its law is curved.
_REACH, _OF_IMPULSE = 1e-7, 3e-3
# Speed of lips that are taken as pressed, beside the velocity that differences are taken over.
_APPROACH = 1e6
# Entry of S_r above which a point is held: its impulse is a multiplier.
_HELD = 0.5
# Pivot of I - (1 - p) S_r that counts as zero.
_SINGULAR = 1e-12


@cache
def _response_kernel(law: LawKernels, sides: Sides):
    """Kernel: S(u, r) of every point."""
    algebra = for_dimension(sides.dim, sides.components)
    row, set_row = algebra.row, algebra.set_row
    read = point_velocity(sides)
    solve = law.solve

    @njit(nogil=True, **LEAN_ENTRY)
    def respond(v, c, points, response):
        w, parameters, terms = points.compliance, points.parameters, points.terms
        for i in range(len(response)):
            u, r = read(v, c, i), row(points.impulse, i)
            new, _ = solve(i, u, r, w, parameters, terms, points.details)
            set_row(response, i, new)

    return respond


@cache
def _tangent_kernel(law: LawKernels, sides: Sides):
    """Kernel: S, K = -K', g and whether a point is held, of every point."""
    components = sides.components
    algebra = for_dimension(sides.dim, components)
    row, set_row, add, unit = algebra.row, algebra.set_row, algebra.add, algebra.unit
    subtract, dot = algebra.subtract, algebra.dot
    sym_row, sym_vector = algebra.sym_row, algebra.sym_vector
    read = point_velocity(sides)
    solve = law.solve
    columns = 2 * components + 1

    @njit(nogil=True, **LEAN_ENTRY)
    def tangents(v, c, points, least, proximal, approach, springs, a):
        # a: shape (components, 2 components + 1): I - (1 - p) S_r, S_u, S - r
        r, w, parameters = points.impulse, points.compliance, points.parameters
        terms, details = points.terms, points.details
        response, stiffness, source, held = springs
        for i in range(len(r)):
            old, u = row(r, i), add(read(v, c, i), unit(0, -approach[i]))
            base, _ = solve(i, u, old, w, parameters, terms, details)
            set_row(response, i, base)
            moved_by = sym_vector(sym_row(w, i), old)
            size = np.sqrt(max(dot(u, u), _OF_IMPULSE * _OF_IMPULSE * dot(moved_by, moved_by)))
            reach = max(_REACH * size, least)
            w_own = 0.0
            for j in range(components):
                w_own = max(w_own, dot(sym_vector(sym_row(w, i), unit(j, 1.0)), unit(j, 1.0)))
            push = reach / w_own if w_own > 0.0 else 0.0
            largest = 0.0
            for j in range(components):
                # away from where a point changes its branch: one that presses is pressed more
                sign = 1.0 if base[j] > 0.0 else -1.0
                new, _ = solve(
                    i, add(u, unit(j, -sign * reach)), old, w, parameters, terms, details
                )
                column = subtract(new, base)
                for x in range(components):
                    a[x, components + j] = -sign * column[x] / reach
                    a[x, j] = 1.0 if x == j else 0.0
                if push > 0.0:
                    change = unit(j, sign * push)
                    new, _ = solve(i, u, add(old, change), w, parameters, terms, details)
                    column = subtract(new, base)
                    for x in range(components):
                        slope = sign * column[x] / push
                        largest = max(largest, abs(slope))
                        a[x, j] -= (1.0 - proximal) * slope
            missing = subtract(base, old)
            for x in range(components):
                a[x, columns - 1] = missing[x]
            held[i] = largest > _HELD
            for p in range(components):
                best = p
                for x in range(p + 1, components):
                    if abs(a[x, p]) > abs(a[best, p]):
                        best = x
                if abs(a[best, p]) < _SINGULAR:
                    a[best, p] = _SINGULAR
                for j in range(columns):
                    a[p, j], a[best, j] = a[best, j], a[p, j]
                inverse = 1.0 / a[p, p]
                for j in range(columns):
                    a[p, j] *= inverse
                for x in range(components):
                    factor = a[x, p]
                    if x != p and factor != 0.0:
                        for j in range(columns):
                            a[x, j] -= factor * a[p, j]
            for x in range(components):
                source[i, x] = a[x, columns - 1]
                for j in range(components):
                    stiffness[i, x, j] = -a[x, components + j]

    return tangents


class PointTangents:
    """The springs of all points of a scene.

    Args:
        interactions: the points, whose compliances are those of `BodyInverse.of_nodes`.

    Attributes:
        stiffness: of each group, shape (n, components, components), K (N s per m/s).
        source: of each group, shape (n, components), g (N s).
        response: of each group, shape (n, components), S(u, r) (N s).
        held: of each group, shape (n,), whether the impulse is a multiplier.
        proximal: p of these springs.
    """

    def __init__(self, interactions: Interactions):
        self._interactions = interactions
        groups = interactions.groups
        shapes = [(len(g), g.kernels.components) for g in groups]
        self.stiffness = [np.zeros((*shape, shape[1])) for shape in shapes]
        self.source = [np.zeros(shape) for shape in shapes]
        self.response = [np.zeros(shape) for shape in shapes]
        self.held = [np.zeros(shape[0], bool) for shape in shapes]
        self._approach = [np.zeros(shape[0]) for shape in shapes]
        self.proximal = 1.0

    def linearise(
        self, velocity: np.ndarray, least: float, proximal: float, convex: bool = False
    ) -> None:
        """Take the springs around a state.

        Args:
            velocity: shape (num_slots * dim,), m/s; the impulses are the points'.
            least: velocity (m/s) that differences are at least taken over.
            proximal: p; 1 where the impulses are given, so that S_r does not count.
            convex: whether to take |K| of the symmetric part of K.
        """
        for approach in self._approach:
            approach[:] = 0.0
        self._linearise(velocity, least, proximal)
        if convex:
            for k in self.stiffness:
                values, vectors = np.linalg.eigh(0.5 * (k + k.transpose(0, 2, 1)))
                turned = 2.0 * np.maximum(-values, 0.0)[:, None, :]
                k += (vectors * turned) @ vectors.transpose(0, 2, 1)

    def press(self, velocity: np.ndarray, least: float, proximal: float) -> bool:
        """Take the springs, after `linearise`, as if lips approached that hold nothing.

        Where lips touch and no impulse is known yet, this is the other branch: closed, and stuck.

        Returns:
            Whether there are such points.
        """
        for approach, stiffness in zip(self._approach, self.stiffness, strict=True):
            approach[:] = np.where(stiffness.any(axis=(1, 2)), 0.0, _APPROACH * least)
        self._linearise(velocity, least, proximal)
        closed = zip(self._approach, self.held, strict=True)
        return any(np.any(held[approach > 0.0]) for approach, held in closed)

    def _linearise(self, velocity: np.ndarray, least: float, proximal: float) -> None:
        self.proximal = proximal
        for number, g in enumerate(self._interactions.groups):
            n, tangents = g.kernels.components, _tangent_kernel(g.kernels, g.sides)
            springs = tuple(
                each[number] for each in (self.response, self.stiffness, self.source, self.held)
            )
            room, approach = np.empty((n, 2 * n + 1)), self._approach[number]
            arrays = g.couplings, g.law_arrays()
            tangents(velocity, *arrays, least, proximal, approach, springs, room)

    def respond(self, velocity: np.ndarray) -> None:
        """Take `response` alone."""
        for g, response in zip(self._interactions.groups, self.response, strict=True):
            _response_kernel(g.kernels, g.sides)(velocity, g.couplings, g.law_arrays(), response)

    def changes(self, relative: Sequence[np.ndarray]) -> list[np.ndarray]:
        """dr of each group, shape (n, components) (N s).

        Args:
            relative: of each group, shape (n, components), change of its velocities u (m/s).
        """
        return [
            source - np.einsum("pij,pj->pi", k, du)
            for k, source, du in zip(self.stiffness, self.source, relative, strict=True)
        ]

    def spread(self, local: list[np.ndarray]) -> np.ndarray:
        """H x of what each group has at its points, of all ranks, shape (num_slots, dim)."""
        inverse = self._interactions.inverse
        total = np.zeros((inverse.num_slots, inverse.dim))
        for g, values in zip(self._interactions.groups, local, strict=True):
            spread_kernel(g.sides)(total.reshape(-1), g.couplings, values)
        if self._interactions.halo is not None:
            self._interactions.halo.everywhere.add_back(total.reshape(-1))
        return total
