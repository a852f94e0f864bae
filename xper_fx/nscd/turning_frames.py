# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Frames that turn with the lips of their points.

A step looks at the middle q_m = q0 + h theta v_theta, v_theta = theta v1 + (1 - theta) v0, or what
is known of it. With a_alpha the tangents of the middle of both lips there (`lips.py`), d the vector
from the antagonist to the candidate, omega the spin of the lips, and F the rows n, t1 (, t2),

    2D  t = a / |a|,   omega = b . adot,   b = J a / |a|^2,
    3D  n = a1 x a2 / |a1 x a2|,   (t1, t2) the rotation of the polar decomposition of (a1, a2),
        omega = sum_alpha [n (c_alpha . adot_alpha) - b_alpha (n . adot_alpha)],
        c1 = t2 / (t1 . a1 + t2 . a2),   c2 = -t1 / (t1 . a1 + t2 . a2),

with J the turn by +90 degrees and b_alpha = n x a^alpha of the dual basis; then F' = -F (omega x).
Jumps U = F d are read from the positions anew in each step: carried along they would drift. Their
rate is U' = F (d' - omega x d), so that the forces f = F^T r on the candidate and -f on the
antagonist come with the couple m = -d x f on the lips, which does the work of the frame's spin:

    r . U' = f . d' + m . omega.

Half of it acts on each lip: h_alpha = m b (2D), or c_alpha (n . m) - n (b_alpha . m), is
the force of the tangent a_alpha, and node j gets G_j,alpha h_alpha / 2. Forces and couple have no
resultant moment in q_m; with theta = 1/2 and q_m = q0 + h v0 / 2, where an explicit bulk's forces
act, angular momentum is kept to rounding, as q1 x M v1 - q0 x M v0 = q_m x M (v1 - v0).

The map H of a solver stays that of the lips alone, and the couple is given to the bodies after it
(explicit), or with the residual of the next iteration (implicit). Then, over a step,

- an open bond whose energy does not hang on the direction of the jump has U0 = F_m d0 and
  U1 = F_m d1: its opening is that of the lips, and a fracture spends what its curve says;
- any other point has U0 = F(q0) d0 and U1 = U0 + h [F_m d' - s], s = F_m (omega x d_m), which is
  F(q1) d1 to third order. Its law takes s from the velocities known when the step begins, as
  velocity0 - s / (1 - theta) (theta = 1: U0 - h s), and from those found when it ends;
- lips that nothing bonds and that have slid or folded so far that they do not face each other keep
  the frame that they had, without couple, whose arm their jump would be: debris is stable then.

The nodal points of a facet of first order have the same tangents, and so the same frame and spin:
these are found once for all points with the same lips, a *site*.

What the stored energy e gains when the next step reads the jump anew, e(U0) - e(U1 of the last
step), and the work of the couple that the first kind of point does not see, are booked as
numerical. Areas stay those of the reference configuration: A e(U) is then a potential.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.couplings import Sides
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.nscd.laws.law import STORED, LawKernels
from xper_fx.nscd.lip_kernels import lip_kernels
from xper_fx.nscd.lips import Lips, start_frames

# What is wrong with the lips of a site in a step: they flip, or stand at more than a right angle.
_FLIPPED, _FOLDED = 1, 2
# In the place of the column of a damage: of points that nothing bonds, and of bonds that last.
LOOSE, LASTING = -1, -2
# Jump of lips that nothing bonds, beside the size of a point's share of its facet, beyond which
# they do not face each other any more.
_FAR = 0.1
# Angle (rad) between lips and a frame that they have left.
_STRAYED = 0.2
# Normal opening beside the whole one below which a point counts as closed.
_CLOSED = 1e-3
# Difference of energies, relative, that is rounding.
_ALIKE = 1e-12


class LipMotion(NamedTuple):
    """How the nodes of lips move in a step, arrays over the slots, flat.

    Attributes:
        displacement: q0 (m).
        velocity: v0 (m/s).
        mean: v_theta as far as it is known (m/s).
        gradient, rate: shape (dim, dim), Fbar at q0 and its rate in v_theta (1/s), of a periodic
            cell, whose nodes move with the fluctuation; else the identity and zero.
    """

    displacement: np.ndarray
    velocity: np.ndarray
    mean: np.ndarray
    gradient: np.ndarray
    rate: np.ndarray


class TurningFrames(NamedTuple):
    """What the points of a group need besides to turn.

    Attributes:
        nodes, gradient, tangent: of the lips of each site (`lips.py`).
        start, rates: a_alpha at the start of the step and its rate, shape (sites, dim - 1, dim).
        axes: F, shape (sites, dim, dim).
        arms: b, shape (sites, 1, 2), or b_1, b_2, c_1, c_2, shape (sites, 4, 3), 1/m.
        faults: shape (sites,), uint8, whether lips flip or fold, `_FLIPPED` and `_FOLDED`.
        moment: shape (sites, 1) or (sites, 3), what couples add up to, N m s.
        site: shape (n,), int32, of each point.
        jump: d_m, shape (n, dim), m.
        spin: s, shape (n, components), m/s, of points of the second kind.
        by_spin: shape (n,), which points are of the second kind.
        kept: shape (n,), which points keep the frame that they had, without couple.
        isotropic: shape (n,), whether the energy hangs on the length of an open jump alone.
    """

    nodes: np.ndarray
    gradient: np.ndarray
    tangent: np.ndarray
    start: np.ndarray
    rates: np.ndarray
    axes: np.ndarray
    arms: np.ndarray
    faults: np.ndarray
    moment: np.ndarray
    site: np.ndarray
    jump: np.ndarray
    spin: np.ndarray
    by_spin: np.ndarray
    kept: np.ndarray
    isotropic: np.ndarray

    @classmethod
    def of(cls, lips: Lips, kernels: LawKernels, parameters, state) -> TurningFrames:
        """At the start of a run, of points with a law's parameters and state.

        Raises:
            ValueError: a law that stores energy and does not tell it.
        """
        if kernels.stored is None and "stored" in kernels.energies:
            raise ValueError(
                f'The law "{kernels.name}" stores energy and does not tell it: at finite strain, '
                "where frames turn, its kernels need `stored` (`LawKernels.stored`)."
            )
        n, _, dim = lips.tangent.shape
        isotropic = np.ones(n, bool)
        if kernels.stored is not None:
            _isotropy(kernels, dim)(parameters, state, isotropic)
        first, site = _sites(lips)
        of_sites = lips.take(first)
        m = len(first)
        return cls(
            of_sites.nodes, of_sites.gradient, of_sites.tangent,
            *np.zeros((2, m, dim - 1, dim)), np.zeros((m, dim, dim)),
            np.zeros((m, 1 if dim == 2 else 4, dim)), np.zeros(m, np.uint8),
            np.zeros((m, 1 if dim == 2 else 3)), site, np.zeros((n, dim)),
            np.zeros((n, kernels.components)), *np.zeros((2, n), bool), isotropic,
        )  # fmt: skip

    @property
    def width(self) -> int:
        """Nodes of a facet."""
        return self.nodes.shape[2]

    def take(self, indices: np.ndarray) -> TurningFrames:
        """Those of the points at `indices`, in that order."""
        used, site = np.unique(self.site[indices], return_inverse=True)
        of_sites = (array[used] for array in self[:_OF_SITES])
        of_points = (array[indices] for array in self[_OF_SITES + 1 :])
        return TurningFrames(*of_sites, site.astype(np.int32), *of_points)

    def each_its_site(self) -> TurningFrames:
        """The same points, each of which has a site of its own, in their order."""
        of_sites = (array[self.site] for array in self[:_OF_SITES])
        own = np.arange(len(self.site), dtype=np.int32)
        return TurningFrames(*of_sites, own, *self[_OF_SITES + 1 :])


# How many fields come before that of the points' sites.
_OF_SITES = TurningFrames._fields.index("site")


def _sites(lips: Lips) -> tuple[np.ndarray, np.ndarray]:
    """A point of each site, and the site of each point."""
    count = len(lips.nodes)
    parts = (lips.nodes, lips.gradient, lips.tangent)
    rows = np.hstack([np.ascontiguousarray(a).reshape(count, -1).view(np.uint8) for a in parts])
    rows = np.ascontiguousarray(rows).view(np.dtype((np.void, rows.shape[1]))).ravel()
    _, first, site = np.unique(rows, return_index=True, return_inverse=True)
    # in the order in which the points come
    order = np.argsort(first)
    place = np.empty(len(first), np.int32)
    place[order] = np.arange(len(first))
    return first[order], place[site]


def count_strayed(turning: TurningFrames, normal: np.ndarray, displacement: np.ndarray) -> int:
    """How many of some points keep a frame while their lips have turned on.

    Args:
        turning: the points.
        normal: n of their frames, shape (n, dim).
        displacement: of the slots, shape (num_slots, dim), m.
    """
    moved = displacement[turning.nodes]
    a = turning.tangent + 0.5 * np.einsum("psja,psjd->pad", turning.gradient, moved)
    a = a[turning.site]
    now = start_frames(a / np.linalg.norm(a, axis=2, keepdims=True), 1)[:, 0]
    now /= np.linalg.norm(now, axis=1, keepdims=True)
    return int(np.sum(turning.kept & (np.einsum("pd,pd->p", now, normal) < np.cos(_STRAYED))))


@cache
def _isotropy(law: LawKernels, dim: int):
    """Kernel: whether a unit jump along the normal stores what one along the tangent does."""
    unit, stored = for_dimension(dim, law.components).unit, law.stored
    along = min(1, law.components - 1)

    @njit(**LEAN_ENTRY)
    def isotropy(parameters, state, isotropic):
        for i in range(len(isotropic)):
            a = stored(i, unit(0, 1.0), 1.0, parameters, state)
            b = stored(i, unit(along, 1.0), 1.0, parameters, state)
            isotropic[i] = abs(a - b) <= _ALIKE * abs(a)

    return isotropy


@cache
def site_loop(dim: int, width: int):
    """The loop over a range of sites that finds how they stand in the step.

    Args:
        dim: dimension of space.
        width: nodes of a facet.
    """
    lips = lip_kernels(dim, 1, width)
    tangents, pushed, plus = lips.tangents, lips.pushed, lips.plus
    flips, folded, frame_of, arms_of = lips.flips, lips.folded, lips.frame, lips.arms

    @njit(nogil=True, fastmath={"contract"}, **LEAN_ENTRY)
    def turn_sites(first, last, turning, motion, reach):
        nodes, gradient = turning.nodes, turning.gradient
        for number in range(first, last):
            i = np.uintp(number)
            start = plus(
                pushed(motion.gradient, turning.tangent, i),
                1.0,
                tangents(motion.displacement, nodes, gradient, i),
            )
            rates = plus(
                pushed(motion.rate, turning.tangent, i),
                1.0,
                tangents(motion.mean, nodes, gradient, i),
            )
            a = plus(start, reach, rates)
            turning.faults[i] = _FOLDED if folded(start) else 0
            if flips(start, a):
                turning.faults[i] |= _FLIPPED
                continue
            axes = frame_of(a)
            arms = arms_of(a, axes)
            for x in range(dim - 1):
                for e in range(dim):
                    turning.start[i, x, e] = start[x][e]
                    turning.rates[i, x, e] = rates[x][e]
            for x in range(dim):
                for e in range(dim):
                    turning.axes[i, x, e] = axes[x][e]
            for x in range(len(arms)):
                for e in range(dim):
                    turning.arms[i, x, e] = arms[x][e]

    return turn_sites


@cache
def turn_loop(sides: Sides, width: int):
    """The loop over a range of points, after their sites, that gives them what a step needs.

    That is frames, jumps and velocities. Facets have `width` nodes. It returns the first point
    whose facet flips, or -1.
    """
    dim, components = sides[:2]
    own, world = for_dimension(dim, components), for_dimension(dim)
    lips = lip_kernels(dim, sides.k, width)
    set_row, subtract, scale = own.set_row, own.subtract, own.scale
    add_world, scale_world, set_world = world.add, world.scale, world.set_row
    dot_world, to_local, apart = world.dot, own.to_local, lips.apart
    turned, frame_of, local = lips.turned, lips.frame, lips.local
    arms_at, axes_at, tangents_at = lips.arms_at, lips.axes_at, lips.tangents_at

    @njit(inline="always")
    def own_part(x):
        return (x[0],) if components == 1 else x

    @njit(nogil=True, fastmath={"contract"}, **LEAN_ENTRY)
    def turn_range(
        first, last, c, gap, area, frame, turning, motion, reach, inverse, shift, no_jump, state,
        damage, jump, velocity,
    ):  # fmt: skip
        for number in range(first, last):
            i = np.uintp(number)
            site = np.uintp(turning.site[i])
            d0 = apart(motion.displacement, c, i)
            d = add_world(d0, scale_world(reach, apart(motion.mean, c, i)))
            fault = turning.faults[site]
            loose = damage == LOOSE or (damage >= 0 and state[i, damage] == 0.0)
            far = _FAR * (area[i] if dim == 2 else np.sqrt(area[i]))
            turning.kept[i] = loose and (fault != 0 or dot_world(d0, d0) > far * far)
            if turning.kept[i]:
                # lips that no longer face each other: the frame stays what it is
                turning.by_spin[i] = False
                set_row(jump, i, to_local(c.frame, i, d0))
                jump[i, 0] += gap[i]
                set_row(velocity, i, to_local(c.frame, i, apart(motion.velocity, c, i)))
                continue
            if fault & _FLIPPED:
                return number
            axes = axes_at(turning.axes, site)
            for e in range(dim):
                for x in range(components):
                    frame[i, x, e] = axes[x][e]
                for x in range(c.frame.shape[1]):
                    c.frame[i, x, e] = axes[x][e]
            set_world(turning.jump, i, d)
            fast = own_part(local(axes, apart(motion.velocity, c, i)))
            opening = dot_world(axes[0], d)
            closed = opening <= 0.0 or opening * opening <= _CLOSED * _CLOSED * dot_world(d, d)
            by_spin = not no_jump and (closed or not turning.isotropic[i])
            turning.by_spin[i] = by_spin
            if by_spin:
                rates, arms = tangents_at(turning.rates, site), arms_at(turning.arms, site)
                spin = own_part(local(axes, turned(rates, arms, axes[0], d)))
                set_row(turning.spin, i, spin)
                at_start = own_part(local(frame_of(tangents_at(turning.start, site)), d0))
                at_start = subtract(at_start, scale(shift, spin))
                fast = subtract(fast, scale(inverse, spin))
            else:
                at_start = own_part(local(axes, d0))
            set_row(jump, i, at_start)
            jump[i, 0] += gap[i]
            set_row(velocity, i, fast)
        return -1

    return turn_range


@cache
def _gained(law: LawKernels):
    """Kernel: what a point stores when its jump is read anew beyond what it did (J; 2D: J/m)."""
    stored = law.stored
    if stored is None:

        @njit(inline="always")
        def gained(i, jump, area, parameters, state, energy):
            return 0.0

    else:

        @njit(inline="always")
        def gained(i, jump, area, parameters, state, energy):
            return stored(i, jump, area, parameters, state) - energy[i, STORED]

    return gained


@cache
def settle_loop(law: LawKernels, sides: Sides, width: int):
    """The loop over a range of `which`, points of the second kind, before a step is committed.

    Jumps and velocities of the start come to be without the spin that laws were given, the spin
    is that of the velocities found. It returns what is booked as numerical less what their couples
    worked against it (J; 2D: J/m).
    """
    dim, components = sides[:2]
    own, world = for_dimension(dim, components), for_dimension(dim)
    lips = lip_kernels(dim, sides.k, width)
    row, set_row, add, scale, dot = own.row, own.set_row, own.add, own.scale, own.dot
    row_world, to_local, plus = world.row, own.to_local, lips.plus
    tangents, pushed, turned = lips.tangents, lips.pushed, lips.turned
    arms_at, normal_at = lips.arms_at, lips.normal_at
    gained = _gained(law)

    @njit(nogil=True, fastmath={"contract"}, **LEAN_ENTRY)
    def settle_range(
        first, last, which, end, c, turning, motion, theta, inverse, shift, jump, velocity, r,
        area, parameters, state, energy,
    ):  # fmt: skip
        nodes, gradient = turning.nodes, turning.gradient
        booked = 0.0
        for number in range(first, last):
            i = np.uintp(which[number])
            site = np.uintp(turning.site[i])
            spin = row(turning.spin, i)
            set_row(velocity, i, add(row(velocity, i), scale(inverse, spin)))
            set_row(jump, i, add(row(jump, i), scale(shift, spin)))
            rates = plus(
                pushed(motion.rate, turning.tangent, site),
                theta,
                tangents(end, nodes, gradient, site),
            )
            rates = plus(rates, 1.0 - theta, tangents(motion.velocity, nodes, gradient, site))
            arms, n = arms_at(turning.arms, site), normal_at(c.frame, i)
            away = turned(rates, arms, n, row_world(turning.jump, i))
            spin = to_local(c.frame, i, away)
            set_row(turning.spin, i, spin)
            booked -= dot(row(r, i), spin)
            booked -= gained(i, row(jump, i), area[i], parameters, state, energy)
        return booked

    return settle_range


@cache
def couple_loop(sides: Sides, width: int):
    """The loop that adds the impulses of the points' couples to those of the nodes.

    Couples of a site are added up first.
    """
    dim, components = sides[:2]
    own, world = for_dimension(dim, components), for_dimension(dim)
    lips = lip_kernels(dim, sides.k, width)
    row, to_global, row_world = own.row, own.to_global, world.row
    forces, moment, arms_at, normal_at = lips.forces, lips.moment, lips.arms_at, lips.normal_at
    moment_at = lips.moment_at

    @njit(fastmath={"contract"}, **LEAN_ENTRY)
    def add_couples(p, c, turning, r):
        turning.moment[:] = 0.0
        for number in range(len(r)):
            i = np.uintp(number)
            if turning.kept[i]:
                continue
            site = np.uintp(turning.site[i])
            m = moment(to_global(c.frame, i, row(r, i)), row_world(turning.jump, i))
            for e in range(len(m)):
                turning.moment[site, e] += m[e]
        nodes, gradient = turning.nodes, turning.gradient
        for number in range(len(nodes)):
            i = np.uintp(number)
            m = moment_at(turning.moment, i)
            h = forces(m, arms_at(turning.arms, i), normal_at(turning.axes, i))
            for s in range(2):
                for j in range(width):
                    at = np.uintp(dim * nodes[i, s, j])
                    for x in range(dim - 1):
                        g = 0.5 * gradient[i, s, j, x]
                        for e in range(dim):
                            p[at + np.uintp(e)] += g * h[x][e]

    return add_couples
