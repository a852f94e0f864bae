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
the force of the tangent a_alpha, and node j gets G_j,alpha h_alpha / 2. In a periodic cell a_alpha
goes with Fbar, too, whose equation gets K = sum h_alpha (x) t_alpha. Forces and couple have no
resultant moment in q_m; with theta = 1/2 and q_m = q0 + h v0 / 2, where an explicit bulk's forces
act, angular momentum is kept to rounding, as q1 x M v1 - q0 x M v0 = q_m x M (v1 - v0).

The map H of a solver stays that of the lips alone, and the couple is given to the bodies after it
(explicit), or with the residual of the next iteration (implicit). Then, over a step,

- an open bond that was not pressed in the last step, and whose energy does not hang on the
  direction of the jump, has U0 = F_m d0 and U1 = F_m d1: its opening is that of the lips, and a
  fracture spends what its curve says;
- any other point has U0 = F(q0) d0 and U1 = U0 + h [F_m d' - s], s = F_m (omega x d_m), which for
  theta = 1/2 is F(q1) d1 to third order. Its law takes s from the velocities known when the step
  begins, as velocity0 - s / (1 - theta), and from those found when it ends. With theta = 1 the
  middle is the end, and h s = (F(q0) - F(q1)) d0 gives U1 = F(q1) d1. Its law takes F(q1) d0 for
  U0, as that of an open bond does, and the lips do not drift;
- lips that nothing bonds and that have slid or folded so far that they do not face each other keep
  the frame that they had, without couple, whose arm their jump would be: debris is stable then. A
  couple that follows an impulse r of lips which have slid by x of their facet's length adds
  (x r)^2 w / 2 to the kinetic energy, beside w r^2 of r itself with nodes alike: at a quarter 3 %.

The nodal points of a facet of first order have the same tangents, and so the same frame and spin:
these are found once for all points with the same lips, a *site*. Sites are in the order in which
points first have them, so that one pass over the points finds both.

What the stored energy e gains when the next step reads the jump anew, e(U0) - e(U1 of the last
step), and the work of the couple that the first kind of point does not see, are booked as
numerical. Areas stay those of the reference configuration: A e(U) is then a potential.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.couplings import Sides, point_velocity, prefetch
from xper_fx.nscd.kernel_options import LEAN_ENTRY, MERGED
from xper_fx.nscd.law_loops import CHUNK, ending
from xper_fx.nscd.laws.law import STORED, LawKernels
from xper_fx.nscd.lip_kernels import lip_kernels
from xper_fx.nscd.lips import Lips, start_frames


@njit(fastmath={"reassoc", "contract"}, **LEAN_ENTRY)
def work_of_couples(couples, start, end, theta):
    """Work (J; 2D: J/m) of couples on slots, all of which but the last move at `start`."""
    work = 0.0
    for i in range(len(start)):
        work += couples[i] * (theta * end[i] + (1.0 - theta) * start[i])
    return work


# What is wrong with the lips of a site in a step: they flip, or stand at more than a right angle.
_FLIPPED, _FOLDED = 1, 2
# In the place of the column of a damage: of points that nothing bonds, and of bonds that last.
LOOSE, LASTING = -1, -2
# Jump of lips that nothing bonds, beside the size of a point's share of its facet, beyond which
# they do not face each other any more: a quarter of a facet with two points, as for the search.
_FAR = 0.5
# Angle (rad) between lips and a frame that they have left.
_STRAYED = 0.2
# Points whose sites are found before them, and how many sites ahead nodes are asked for.
_AT_A_TIME, _AHEAD = 256, 8
# Normal opening beside the whole one below which a point counts as closed.
_CLOSED = 1e-3
# Difference of energies, relative, that is rounding, and speed that an impulse gives, beside those
# of the lips and with which they part.
_ALIKE = 1e-12


class LipMotion(NamedTuple):
    """How the nodes of lips move in a step, flat arrays over the slots; the last ones may lack."""

    displacement: np.ndarray  #: q0 (m)
    velocity: np.ndarray  #: v0 (m/s)
    mean: np.ndarray  #: v_theta as far as it is known (m/s)
    starts: bool  #: whether that is v0
    #: shape (dim, dim), Fbar at q0 of a periodic cell, whose nodes move with the fluctuation; else
    #: without entries
    gradient: np.ndarray
    rate: np.ndarray  #: of that Fbar in v_theta (1/s), else without entries


class TurningFrames(NamedTuple):
    """What the points of a group need besides to turn."""

    nodes: np.ndarray  #: of the lips of each site (`lips.py`)
    gradient: np.ndarray  #: G of the lips of each site
    tangent: np.ndarray  #: t_alpha of the lips of each site
    #: F at the start of the step, shape (sites, 1, 2), the normal, or (sites, 3, 3)
    start: np.ndarray
    axes: np.ndarray  #: F in the middle of the step, of the same shape
    omega: np.ndarray  #: shape (sites, 1) or (sites, 3), spin in v_theta in the axes, rad/s
    arms: np.ndarray  #: b, shape (sites, 1, 2), or b_1, b_2, c_1, c_2, shape (sites, 4, 3), 1/m
    #: shape (sites,), uint8, whether lips flip or fold, `_FLIPPED` and `_FOLDED`
    faults: np.ndarray
    moment: np.ndarray  #: shape (sites, 1) or (sites, 3), what couples add up to in the axes, N m s
    site: np.ndarray  #: shape (n,), int32, of each point
    jump: np.ndarray  #: F_m d_m, shape (n, dim), m
    by_spin: np.ndarray  #: shape (n,), which points are of the second kind
    kept: np.ndarray  #: shape (n,), which points keep the frame that they had, without couple
    #: shape (n,), whether the energy hangs on the length of an open jump alone
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
        m, turns = len(first), 1 if dim == 2 else 3
        return cls(
            of_sites.nodes, of_sites.gradient, of_sites.tangent,
            *np.zeros((2, m, turns, dim)), np.zeros((m, turns)),
            np.zeros((m, 1 if dim == 2 else 4, dim)), np.zeros(m, np.uint8),
            np.zeros((m, turns)), site, np.zeros((n, dim)),
            *np.zeros((2, n), bool), isotropic,
        )  # fmt: skip

    @property
    def width(self) -> int:
        """Nodes of a facet."""
        return self.nodes.shape[2]

    def take(self, indices: np.ndarray) -> TurningFrames:
        """Those of the points at `indices`, in that order."""
        first, site = _in_order(self.site[indices])
        of_sites = (array[self.site[indices][first]] for array in self[:_OF_SITES])
        of_points = (array[indices] for array in self[_OF_SITES + 1 :])
        return TurningFrames(*of_sites, site, *of_points)

    def each_its_site(self) -> TurningFrames:
        """The same points, each of which has a site of its own, in their order."""
        of_sites = (array[self.site] for array in self[:_OF_SITES])
        own = np.arange(len(self.site), dtype=np.int32)
        return TurningFrames(*of_sites, own, *self[_OF_SITES + 1 :])


# How many fields come before that of the points' sites.
_OF_SITES = TurningFrames._fields.index("site")


def _sites(lips: Lips) -> tuple[np.ndarray, np.ndarray]:
    """A point of each site, and the site of each point."""
    flat = [
        np.ascontiguousarray(a).reshape(len(a), math.prod(a.shape[1:])).view(np.uint8)
        for a in (lips.nodes, lips.gradient, lips.tangent)
    ]
    rows = np.ascontiguousarray(np.hstack(flat))
    return _in_order(rows.view(np.dtype((np.void, rows.shape[1]))).ravel())


def _in_order(keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where each key comes first, and the key of each entry, counted in the order of coming."""
    _, first, site = np.unique(keys, return_index=True, return_inverse=True)
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
def _find_site(dim: int, width: int):
    """Kernel that finds how a site stands in the step."""
    lips = lip_kernels(dim, 1, width)
    tangents, pushed, plus = lips.tangents, lips.pushed, lips.plus
    flips, folded, frame_of, arms_of = lips.flips, lips.folded, lips.frame, lips.arms
    spin_of = lips.spin

    @njit(fastmath={"contract"}, **MERGED)
    def find(i, turning, motion, reach):
        nodes, gradient = turning.nodes, turning.gradient
        start = plus(
            pushed(motion.gradient, turning.tangent, i, 1.0),
            1.0,
            tangents(motion.displacement, nodes, gradient, i),
        )
        rates = plus(
            pushed(motion.rate, turning.tangent, i, 0.0),
            1.0,
            tangents(motion.mean, nodes, gradient, i),
        )
        a = plus(start, reach, rates)
        flipped = flips(start, a)
        turning.faults[i] = (_FOLDED if folded(start) else 0) | (_FLIPPED if flipped else 0)
        if not flipped:
            before, axes = frame_of(start), frame_of(a)
            arms = arms_of(a, axes)
            omega = spin_of(rates, arms, axes)
            for x in range(len(omega)):
                turning.omega[i, x] = omega[x]
            for x in range(1 if dim == 2 else 3):
                for e in range(dim):
                    turning.start[i, x, e] = before[x][e]
                    turning.axes[i, x, e] = axes[x][e]
            for x in range(len(arms)):
                for e in range(dim):
                    turning.arms[i, x, e] = arms[x][e]

    return find


@cache
def site_loop(dim: int, width: int):
    """The loop over a range of sites that finds how they stand in the step.

    Args:
        width: nodes of a facet.
    """
    find = _find_site(dim, width)

    @njit(nogil=True, fastmath={"contract"}, **LEAN_ENTRY)
    def turn_sites(first, last, turning, motion, reach):
        for number in range(first, last):
            find(np.uintp(number), turning, motion, reach)

    return turn_sites


@cache
def turn_loop(sides: Sides, width: int):
    """The loop over a range of points that gives them what a step needs.

    That is frames, jumps and velocities. Facets have `width` nodes, `pressed` are the impulses of
    the last step, of which a solver may leave rounding where lips are open. Sites from `new` on are
    found on the way. Points of the second kind `stays` so if that is said: iterations on which
    a point takes turns between the kinds would not end. It returns the first point whose facet
    flips, or -1.
    """
    dim, components = sides[:2]
    own, world = for_dimension(dim, components), for_dimension(dim)
    lips = lip_kernels(dim, sides.k, width)
    find = _find_site(dim, width)
    set_row, add, subtract, scale = own.set_row, own.add, own.subtract, own.scale
    add_world, scale_world, set_world = world.add, world.scale, world.set_row
    dot_world, to_local, apart = world.dot, own.to_local, lips.apart
    turned, local, axes_at, turn_at = lips.turned, lips.local, lips.axes_at, lips.turn_at

    @njit(inline="always")
    def fetch(nodes, site, motion):
        for s in range(2):
            for j in range(width):
                at = np.uintp(dim * nodes[np.uintp(site), s, j])
                prefetch(motion.displacement, at)
                prefetch(motion.velocity, at)

    @njit(inline="always")
    def own_part(x):
        return (x[0],) if components == 1 else x

    @njit(nogil=True, fastmath={"contract"}, **LEAN_ENTRY)
    def turn_range(
        first, last, new, c, gap, area, turning, motion, reach, inverse, no_jump, state, damage,
        pressed, compliance, jump, velocity, stays,
    ):  # fmt: skip
        known = first
        for number in range(first, last):
            if number == known:
                known = min(known + _AT_A_TIME, last)
                end = new
                for i in range(number, known):
                    end = max(end, turning.site[i] + 1)
                for site in range(new, end):
                    fetch(turning.nodes, min(site + _AHEAD, len(turning.nodes) - 1), motion)
                    find(np.uintp(site), turning, motion, reach)
                new = end
            i = np.uintp(number)
            site = np.uintp(turning.site[i])
            d0, rate0 = apart(motion.displacement, c, i), apart(motion.velocity, c, i)
            fault = turning.faults[site]
            kept = damage == LOOSE or (damage >= 0 and state[i, damage] == 0.0)
            if kept:
                far = _FAR * _FAR * (area[i] * area[i] if dim == 2 else area[i])
                kept = fault != 0 or dot_world(d0, d0) > far
            turning.kept[i] = kept
            if kept:
                # lips that no longer face each other: the frame stays what it is
                turning.by_spin[i] = False
                set_row(jump, i, to_local(c.frame, i, d0))
                jump[i, 0] += gap[i]
                set_row(velocity, i, to_local(c.frame, i, rate0))
                continue
            if fault & _FLIPPED:
                return number
            axes = axes_at(turning.axes, site)
            for x in range(1 if dim == 2 else components):
                for e in range(dim):
                    c.frame[i, x, e] = axes[x][e]
            anew, fast = local(axes, d0), local(axes, rate0)
            mean = fast if motion.starts else local(axes, apart(motion.mean, c, i))
            d = add_world(anew, scale_world(reach, mean))
            set_world(turning.jump, i, d)
            closed = d[0] <= 0.0 or d[0] * d[0] <= _CLOSED * _CLOSED * dot_world(d, d)
            # what was pressed touches in the frame of the end, and may be open in the middle
            if not closed and pressed[i, 0] > 0.0:
                given, node = pressed[i, 0] * compliance[i, 0], np.uintp(c.start[i, 0, 0])
                moves = 0.0
                for e in range(dim):
                    moves += motion.velocity[node + np.uintp(e)] ** 2
                moves = max(moves, dot_world(rate0, rate0))
                closed = given * given > _ALIKE * _ALIKE * moves
            closed = closed or (stays and turning.by_spin[i])
            by_spin = not no_jump and (closed or not turning.isotropic[i])
            turning.by_spin[i] = by_spin
            # no branch, which could not be foretold
            share = 1.0 if by_spin else 0.0
            spin = own_part(turned(turn_at(turning.omega, site), d))
            set_row(velocity, i, subtract(own_part(fast), scale(share * inverse, spin)))
            there = own_part(local(axes_at(turning.start, site), d0))
            change = subtract(there, own_part(anew))
            set_row(jump, i, add(own_part(anew), scale(share if inverse > 0.0 else 0.0, change)))
            jump[i, 0] += gap[i]
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
def commit_loop(law: LawKernels, sides: Sides, width: int):
    """The loop over a range of chunks of points p, `PointArrays`, that ends a step.

    Of points of the second kind jumps and velocities of the start come to be without the spin that
    laws were given, and the spin is that of the velocities `v` found. The last column of `sums` has
    what these add to the numerical energy less what their couples worked against it, the others
    the law's energies (J; 2D: J/m).
    """
    dim, components = sides[:2]
    own, world = for_dimension(dim, components), for_dimension(dim)
    lips = lip_kernels(dim, sides.k, width)
    row, dot = own.row, own.dot
    add, subtract, scale = own.add, own.subtract, own.scale
    row_world, to_local, plus = world.row, own.to_local, lips.plus
    tangents, pushed, turned = lips.tangents, lips.pushed, lips.turned
    arms_at, axes_at, apart = lips.arms_at, lips.axes_at, lips.apart
    spin_of, local = lips.spin, lips.local
    turn_at, add_world, scale_world = lips.turn_at, world.add, world.scale
    read = point_velocity(sides)
    end_step, gained, energies = ending(law, sides), _gained(law), len(law.energies)
    turns, num_arms = (1, 1) if dim == 2 else (3, 4)

    @njit(inline="always")
    def own_part(x):
        return (x[0],) if components == 1 else x

    @njit(inline="always")
    def mixed(theta, end, start):
        if dim == 2:
            return (theta * end[0] + (1.0 - theta) * start[0],)
        return add_world(scale_world(theta, end), scale_world(1.0 - theta, start))

    # where few points are of the second kind, the processor does not foresee what they ask for
    @njit(inline="always")
    def fetch(turning, i):
        site, corners = np.uintp(turning.site[i]), np.uintp(2 * width)
        prefetch(turning.jump, i * np.uintp(dim))
        prefetch(turning.nodes, site * corners)
        prefetch(turning.gradient, site * corners * np.uintp(dim - 1))
        prefetch(turning.omega, site * np.uintp(turns))
        prefetch(turning.axes, site * np.uintp(turns * dim))
        prefetch(turning.arms, site * np.uintp(num_arms * dim))

    @njit(inline="always")
    def fetch_nodes(v, nodes, site):
        for s in range(2):
            for j in range(width):
                prefetch(v, np.uintp(dim * nodes[site, s, j]))

    @njit(nogil=True, **LEAN_ENTRY)
    def commit_range(first, last, v, c, p, step, theta, turning, motion, inverse, sums):
        nodes, gradient = turning.nodes, turning.gradient
        for chunk in range(first, last):
            booked = 0.0
            known, end_of_chunk = chunk * CHUNK, min((chunk + 1) * CHUNK, len(p.area))
            for number in range(known, end_of_chunk):
                if number == known:
                    known = min(known + _AT_A_TIME, end_of_chunk)
                    for other in range(number, known):
                        if turning.by_spin[other]:
                            fetch(turning, np.uintp(other))
                    for other in range(number, known):
                        if turning.by_spin[other]:
                            fetch_nodes(v, nodes, np.uintp(turning.site[other]))
                i = np.uintp(number)
                jump0, start, u = row(p.jump, i), row(p.velocity, i), read(v, c, i)
                by_spin = turning.by_spin[i]
                if by_spin:
                    site = np.uintp(turning.site[i])
                    d, omega = row_world(turning.jump, i), turn_at(turning.omega, site)
                    start = add(start, scale(inverse, own_part(turned(omega, d))))
                mean = add(scale(theta, u), scale(1.0 - theta, start))
                spin = scale(0.0, jump0)
                if by_spin and inverse == 0.0:
                    d0 = apart(motion.displacement, c, i)
                    there = own_part(local(axes_at(turning.start, site), d0))
                    change = subtract(there, to_local(c.frame, i, d0))
                    spin, jump0 = scale(1.0 / step, change), add(jump0, change)
                elif by_spin:
                    arms, axes = arms_at(turning.arms, site), axes_at(turning.axes, site)
                    rates = plus(
                        pushed(motion.rate, turning.tangent, site, 0.0),
                        1.0,
                        tangents(v, nodes, gradient, site),
                    )
                    end = spin_of(rates, arms, axes)
                    if motion.starts:  # what is known is that of v0
                        at_start = omega
                    else:
                        rates = plus(
                            pushed(motion.rate, turning.tangent, site, 0.0),
                            1.0,
                            tangents(motion.velocity, nodes, gradient, site),
                        )
                        at_start = spin_of(rates, arms, axes)
                    spin = own_part(turned(mixed(theta, end, at_start), d))
                if by_spin:
                    booked -= dot(row(p.impulse, i), spin)
                    booked -= gained(i, jump0, p.area[i], p.parameters, p.state, p.energy)
                    mean = subtract(mean, spin)
                end_step(i, jump0, mean, u, p, step, theta, sums[chunk])
            sums[chunk, energies] += booked

    return commit_range


@cache
def power_loop(sides: Sides, width: int):
    """The loop over a range of points that adds up r . U' for frames at the start of the step.

    With velocities `v` at the end of a static step, which has theta = 1, and impulses r; `couples`
    tells whether they come with them.
    """
    dim, components = sides[:2]
    own, world = for_dimension(dim, components), for_dimension(dim)
    lips = lip_kernels(dim, sides.k, width)
    tangents, pushed, plus, apart = lips.tangents, lips.pushed, lips.plus, lips.apart
    frame_of, arms_of, spin_of, turned = lips.frame, lips.arms, lips.spin, lips.turned
    row, dot, to_local, local, subtract = own.row, own.dot, own.to_local, lips.local, world.subtract

    @njit(inline="always")
    def own_part(x):
        return (x[0],) if components == 1 else x

    @njit(nogil=True, **LEAN_ENTRY)
    def power(first, last, v, c, turning, motion, r, couples):
        nodes, gradient, tangent, total = turning.nodes, turning.gradient, turning.tangent, 0.0
        for number in range(first, last):
            i = np.uintp(number)
            rate, site = apart(v, c, i), np.uintp(turning.site[i])
            if turning.kept[i]:
                total += dot(row(r, i), to_local(c.frame, i, rate))
                continue
            a = plus(
                pushed(motion.gradient, tangent, site, 1.0),
                1.0,
                tangents(motion.displacement, nodes, gradient, site),
            )
            axes = frame_of(a)
            change = local(axes, rate)
            if couples:
                rates = plus(
                    pushed(motion.rate, tangent, site, 0.0), 1.0, tangents(v, nodes, gradient, site)
                )
                omega = spin_of(rates, arms_of(a, axes), axes)
                d = local(axes, apart(motion.displacement, c, i))
                change = subtract(change, turned(omega, d))
            total += dot(row(r, i), own_part(change))
        return total

    return power


@cache
def couple_loop(sides: Sides, width: int):
    """The loop that adds the impulses of the points' couples to those of the nodes.

    Couples of a site are added up first. `cell`, shape (dim, dim), gets what does their work with
    the rate of Fbar, the sum of h_alpha (x) t_alpha; without entries there is none.
    """
    dim, components = sides[:2]
    own, world = for_dimension(dim, components), for_dimension(dim)
    lips = lip_kernels(dim, sides.k, width)
    row, row_world, forces, moment = own.row, world.row, lips.forces, lips.moment
    arms_at, axes_at, turn_at = lips.arms_at, lips.axes_at, lips.turn_at

    @njit(inline="always")
    def whole(x):
        if components == dim:
            return x
        return (x[0], 0.0) if dim == 2 else (x[0], 0.0, 0.0)

    @njit(fastmath={"contract"}, **LEAN_ENTRY)
    def add_couples(p, cell, turning, r):
        turning.moment[:] = 0.0
        for number in range(len(r)):
            i = np.uintp(number)
            if turning.kept[i]:
                continue
            site = np.uintp(turning.site[i])
            m = moment(whole(row(r, i)), row_world(turning.jump, i))
            for e in range(len(m)):
                turning.moment[site, e] += m[e]
        nodes, gradient, tangent = turning.nodes, turning.gradient, turning.tangent
        for number in range(len(nodes)):
            i = np.uintp(number)
            m = turn_at(turning.moment, i)
            h = forces(m, arms_at(turning.arms, i), axes_at(turning.axes, i))
            for e in range(len(cell)):
                for x in range(dim - 1):
                    for y in range(dim):
                        cell[e, y] += h[x][e] * tangent[i, x, y]
            for s in range(2):
                for j in range(width):
                    at = np.uintp(dim * nodes[i, s, j])
                    for x in range(dim - 1):
                        g = 0.5 * gradient[i, s, j, x]
                        for e in range(dim):
                            p[at + np.uintp(e)] += g * h[x][e]

    return add_couples
