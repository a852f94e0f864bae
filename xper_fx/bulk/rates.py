# SPDX-License-Identifier: LGPL-3.0-or-later
r"""How a static state goes on along a path: which bonds open, and whether the load rises or falls.

A bond c at its largest opening so far softens where it opens on, and unloads along its secant where
it closes. With n_c the direction in which it opens, K_c its springs along the secant, and a_c the
impulse that it bears less for each opening of its lips, rates v of the unknowns and l of the load
obey

    (A + sum_c H_c K_c H_c^T) v = l f + sum_c H_c a_c g_c,     g_c = max(0, n_c . H_c^T v),

f what the load does. One solution for the load and one for each bond give the openings
x = l x0 + M g, and a linear complementarity problem (Bolzon, Maier and Tin-Loi 1997),

    g >= 0,    w = (I - M) g - l x0 >= 0,    g . w = 0,

for l = 1 and l = -1. Lips that touch, and press no more or not yet, are of the same kind: n is
their normal, K_c has the spring of closed lips, and a_c what that is more than the bond's.

**Friction.** Lips that are pressed and have slid in the last step along d slide on or stick. With F
for the spring of lips that stick (a multiplier's, 1 / p of the bulk's, along the normal and the
tangents alike) r_N changes by -F u_N and the bound of friction by -mu F u_N: they slide where
F d . u would be more than that and what friction bore at the start, that is where

    x = (d + mu n) . u > 0,    and then    d . r = -F d . u + (F - k) x = -k d . u + mu F u_N,

up to k / F = p or less, k the tangent of the bond there: of the same kind again, with n_c = d +
mu n and a_c = (F - k) d. mu is what the law's answer to more pressure tells. Where the bond is at
its largest opening its slip is what opens it, and where such lips stick it opens no further,
whichever way the load goes. Such lips are many, and each is one more solution: rates are told first
for lips that all do as the iterations have it, and with friction for steps that fail from there.

Where Newton's method begins from the last increment or from rest, two bonds may take turns for
ever. From v it begins with each bond on its branch, and the step takes a few iterations.

**Which solution.** There may be several, as where a crack may go on in one of two places. First
all bonds that are at their largest openings are taken to open on, and those that turn out to close
are left out. Where that leads nowhere Lemke's algorithm (Cottle, Pang and Stone 1992, section 4.4)
finds a solution or ends on a ray. Where the load turns, g = 0 solves the problem of a load that
falls, on the way back: the rate of one bond is then given, and that of the load found. Of these
solutions that one is taken in which bonds open furthest for the same change of the load.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.growth import GroupLimits, GrowthLimit
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.nscd.laws.law import LawKernels
from xper_fx.nscd.laws.signorini import SLIP
from xper_fx.nscd.point_group import PointGroup
from xper_fx.support.ranks import Ranks

# Kinks above which nothing is told: each takes a solution of the system.
_MOST = 400
# Parts of its largest opening by which the branches of a bond are told apart, and of the least one
# within which lips may touch and part.
_APART, _PARTED = 1e-4, 1e-6
# Entry of a column of Lemke's tableau, beside the largest, that counts as zero; pivots a bond.
_ZERO, _PIVOTS = 1e-12, 20
# Bonds whose rate is given in turn, and changes of the bonds that open.
_TRIED, _CHANGES = 40, 20
# Part of the pressure of lips that slide by which it is changed to find their friction, how far
# beside that they slide on, and friction above which there is some.
_SHARE, _BEYOND, _FRICTION = 1e-6, 10.0, 1e-6
# Part of its spring that a bond changes by at least where it softens.
_HELD = 1e-9
# p of the springs of closed lips (`nscd/point_tangents.py`).
MULTIPLIERS = 1e-3


@cache
def _branch_kernel(law: LawKernels):
    """Kernel: changes of the impulse if the lips of some points move to and fro."""
    algebra, solve = for_dimension(law.components), law.solve
    row, set_row, subtract = algebra.row, algebra.set_row, algebra.subtract
    scale = algebra.scale

    @njit(nogil=True, **LEAN_ENTRY)
    def branches(which, moved, points, opened, closed):
        w, parameters, terms = points.compliance, points.parameters, points.terms
        for j in range(len(which)):
            i, u = which[j], row(moved, j)
            r = row(points.impulse, i)
            base, _ = solve(i, scale(0.0, u), r, w, parameters, terms, points.details)
            new, _ = solve(i, u, r, w, parameters, terms, points.details)
            set_row(opened, j, subtract(new, base))
            new, _ = solve(i, scale(-1.0, u), r, w, parameters, terms, points.details)
            set_row(closed, j, subtract(new, base))

    return branches


class _KinksOfGroup(NamedTuple):
    """Where springs of a group are others for lips that open than for lips that close."""

    group: int  #: its number
    first: int  #: number of its first point among those of all groups that have bonds
    which: np.ndarray  #: points, shape (m,); one that softens in shear may be about to part as well
    direction: np.ndarray  #: n, shape (m, components)
    falls: np.ndarray  #: a, shape (m, components), N s per m/s
    #: by how much the lips may open in the step, shape (m,), m; infinite of closed ones
    length: np.ndarray
    rubs: bool  #: whether any lips have slid under pressure


class Kinks:
    """The kinks of all groups, whose springs become those of secants and of closed lips.

    Args:
        groups: after `begin_step`.
        stiffness: of each group, on either branch; changed.
        growth: what the step may open; it follows the bonds that `onwards` finds to open.
        scaled: h theta (s).
        ranks: that divide the bodies; each has the kinks of its points.
        friction: whether lips that have slid are kinks; else they do as the iterations have it.
    """

    def __init__(
        self,
        groups: Sequence[PointGroup],
        stiffness: Sequence[np.ndarray],
        growth: GrowthLimit,
        scaled: float,
        ranks: Ranks,
        friction: bool,
    ):
        self._groups, self._growth, self._scaled, self._ranks = groups, growth, scaled, ranks
        self._stiffness, self._friction = stiffness, friction
        bonds = growth.at_limit()
        self._kinks = []
        for limit in growth.of_groups():
            own = bonds - limit.first
            own = own[(own >= 0) & (own < len(limit.reached))]
            group, springs = groups[limit.group], stiffness[limit.group]
            self._kinks.append(_kinks_of(group, springs, own, limit, scaled, friction))
        own_count = sum(len(k.which) for k in self._kinks)
        self._first = ranks.before(own_count)
        self._own = slice(self._first, self._first + own_count)
        self._count = int(ranks.sum(own_count))

    @property
    def tell(self) -> bool:
        """Whether there are any, and not too many."""
        return 0 < self._count <= _MOST

    @property
    def rub(self) -> bool:
        """Whether lips anywhere have slid under pressure."""
        return bool(self._ranks.max(float(any(kinks.rubs for kinks in self._kinks))))

    def pushes(self) -> Iterator[list[np.ndarray]]:
        """For each kink of all ranks a_c, as impulses of each group, N s per m/s."""
        for number in range(self._count):
            pushed, first = [np.zeros_like(g.impulse) for g in self._groups], self._first
            for kinks in self._kinks:
                if 0 <= number - first < len(kinks.which):
                    i = kinks.which[number - first]
                    pushed[kinks.group][i] = kinks.falls[number - first]
                first += len(kinks.which)
            yield pushed

    def onwards(
        self,
        time: float,
        along: np.ndarray,
        driven: np.ndarray,
        ways: list[np.ndarray],
        changes: Callable[[np.ndarray, np.ndarray], list[np.ndarray]],
    ) -> tuple[float, np.ndarray, list[np.ndarray] | None] | None:
        """Time, velocities and impulses by which a step has what it may open.

        None where nothing tells. Impulses are told with friction: without them lips that are to
        stick, just within what it bears, would begin as ones that slide; else they mislead.

        The growth follows the bonds that open.

        Args:
            time: of the loads (s).
            along, driven: velocities of all unknowns and of rigid bodies that the load makes.
            ways: of all unknowns, that each of `pushes` makes.
            changes: velocities of the lips of each group that those of unknowns and bodies make.
        """
        x0 = self._openings(changes(along, driven))
        m = np.stack([self._openings(changes(way, 0.0 * driven)) for way in ways], axis=1)
        lengths = self._everywhere([k.length / self._scaled for k in self._kinks])
        found = rates_of_bonds(x0, m, lengths)
        if found is None:
            return None
        load, g = found
        own = self._own
        numbers = np.concatenate([np.zeros(0, int), *(k.first + k.which for k in self._kinks)])
        self._growth.follow(numbers[(g[own] > 0.0) & np.isfinite(lengths[own])])
        velocity = load * along + np.tensordot(g, np.stack(ways), axes=1)
        if not self._friction:
            return time + load, velocity, None
        return time + load, velocity, self._impulses(changes(velocity, load * driven), g[own])

    def _impulses(self, moved: list[np.ndarray], g: np.ndarray) -> list[np.ndarray]:
        """Impulses of each group after its lips have moved with the rates of kinks."""
        impulses = [
            group.impulse - np.einsum("pij,pj->pi", k, du)
            for group, k, du in zip(self._groups, self._stiffness, moved, strict=True)
        ]
        for kinks in self._kinks:
            rates, g = np.split(g, [len(kinks.which)])
            np.add.at(impulses[kinks.group], kinks.which, rates[:, None] * kinks.falls)
        return impulses

    def _openings(self, moved: list[np.ndarray]) -> np.ndarray:
        own = [np.einsum("pi,pi->p", k.direction, moved[k.group][k.which]) for k in self._kinks]
        return self._everywhere(own)

    def _everywhere(self, values: list[np.ndarray]) -> np.ndarray:
        """Values of this rank's kinks, group by group, among those of all."""
        out = np.zeros(self._count)
        out[self._own] = np.concatenate([np.zeros(0), *values])
        return self._ranks.sum(out)


def _kinks_of(
    group: PointGroup,
    stiffness: np.ndarray,
    bonds: np.ndarray,
    limit: GroupLimits,
    scaled: float,
    friction: bool,
) -> _KinksOfGroup:
    """Kinks of a group, whose springs become those of secants and of closed lips.

    Args:
        group: after `begin_step`.
        stiffness: of all its points, on either branch; changed.
        bonds: those at their largest openings, shape (m,).
        limit: of all its points.
        scaled: h theta (s).
        friction: as of `Kinks`.
    """
    jump = group.jump.copy()
    jump[:, 0] = np.maximum(jump[:, 0], 0.0)
    opens = jump[bonds] / np.linalg.norm(jump[bonds], axis=1)[:, None]
    near = _APART * limit.reached
    speed = near[bonds, None] / scaled
    opened, closed = _moved(group, bonds, speed * opens)
    falls = (opened + closed) / speed
    pulled = np.einsum("pij,pj->pi", stiffness[bonds], opens)
    off_curve = np.linalg.norm(pulled + opened / speed, axis=1)
    off_secant = np.linalg.norm(pulled - closed / speed, axis=1)
    firmest = np.linalg.norm(closed / speed, axis=1)
    softens = (off_curve < off_secant)[:, None, None]
    stiffness[bonds] += np.where(softens, falls[:, :, None] * opens[:, None, :], 0.0)

    reached = limit.reached[limit.reached > 0.0]
    least = _PARTED * reached.min() / scaled if len(reached) else 0.0
    shut = np.flatnonzero(jump[:, 0] < scaled * least)
    parts = np.zeros((len(shut), jump.shape[1]))
    parts[:, 0] = 1.0
    opened, closed = (change[:, 0] / least for change in _moved(group, shut, least * parts))
    weak = np.abs(group.impulse[shut, 0]) <= closed * least
    pressed = shut[~weak & (group.impulse[shut, 0] > 0.0)]
    shut, parts, free, firm = shut[weak], parts[weak], -opened[weak], closed[weak] / MULTIPLIERS
    stiffness[shut, 0, 0] = firm
    parting = (firm - free)[:, None] * parts
    slid = pressed[group.status[pressed] == SLIP]
    rubs, slides, bears, sticking = _rubbing(group, slid, near / scaled)
    rub = len(rubs) > 0
    if friction:
        stiffness[rubs] = sticking
    else:
        rubs, slides, bears = rubs[:0], slides[:0], bears[:0]
    of_bonds = np.isin(rubs, bonds)
    # friction holds a bond that sticks whichever way it goes
    goes = np.linalg.norm(falls, axis=1) > _HELD * firmest
    goes &= ~np.isin(bonds, rubs)
    bonds, opens, falls = bonds[goes], opens[goes], falls[goes]
    which = np.concatenate([bonds, shut, rubs])
    on = np.concatenate([np.ones(len(bonds), bool), np.zeros(len(shut), bool), of_bonds])
    length = np.where(on, limit.length[which], np.inf)
    directions = np.concatenate([opens, parts, slides])
    falls = np.concatenate([falls, parting, bears])
    return _KinksOfGroup(limit.group, limit.first, which, directions, falls, length, rub)


def _rubbing(group: PointGroup, pressed: np.ndarray, speed: np.ndarray) -> tuple[np.ndarray, ...]:
    """Closed lips that slid in the last step and rub: their numbers, n, a and springs of stick.

    Args:
        group: after `begin_step`.
        pressed: points that have slid, shape (m,).
        speed: of all points (m/s), over which bonds are asked.
    """
    slip = group.velocity[pressed].copy()
    slip[:, 0] = 0.0
    size = np.linalg.norm(slip, axis=1)
    slides = size > 0.0
    which, slip = pressed[slides], slip[slides] / size[slides, None]
    normal = np.zeros_like(slip)
    normal[:, 0] = 1.0
    firm = _moved(group, which, speed[which, None] * normal)[1][:, 0] / speed[which]
    press = (_SHARE * group.impulse[which, 0] / firm)[:, None]
    free, _ = _moved(group, which, _BEYOND * press * slip)
    more, _ = _moved(group, which, _BEYOND * press * slip - press * normal)
    with np.errstate(invalid="ignore"):  # of lips without friction that are about to part
        friction = -((more - free) * slip).sum(axis=1) / (more - free)[:, 0]
    along, _ = _moved(group, which, speed[which, None] * slip)
    rubs = friction > _FRICTION
    which, slip, normal = which[rubs], slip[rubs], normal[rubs]
    firm = firm[rubs, None] / MULTIPLIERS
    falls = firm * slip + along[rubs] / speed[which, None]
    sticking = firm[:, :, None] * np.eye(slip.shape[1])
    return which, slip + friction[rubs, None] * normal, falls, sticking


def _moved(group: PointGroup, which: np.ndarray, by: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Changes of impulses if lips move on by velocities, or back, shape (m, components)."""
    opened, closed = np.empty_like(by), np.empty_like(by)
    _branch_kernel(group.kernels)(which, by, group.law_arrays(), opened, closed)
    return opened, closed


def rates_of_bonds(x0: np.ndarray, m: np.ndarray, lengths: np.ndarray) -> tuple | None:
    """The rate l of the load and the rates g at which bonds open; None if there are none.

    Args:
        x0, m: see the module, shapes (n,) and (n, n).
        lengths: by which bonds may open in a step, shape (n,), m: the first one does in unit time.
    """
    matrix, best = np.eye(len(x0)) - m, (0.0, 0.0, np.zeros(0))
    solutions = [_as_before(matrix, x0, lengths)]
    if solutions[0][1] is None:
        solutions = [(load, lemke(matrix, -load * x0)) for load in (1.0, -1.0)]
        solutions.append(_of_one_bond(matrix, x0, lengths))
    for load, g in solutions:
        if g is not None:
            fastest = float((g / lengths).max())
            share = fastest / abs(load) if load != 0.0 else np.inf
            if share > best[0]:
                best = share, load / fastest, g / fastest
    return None if best[0] == 0.0 else best[1:]


def _as_before(
    matrix: np.ndarray, x0: np.ndarray, lengths: np.ndarray
) -> tuple[float, np.ndarray | None]:
    """As `rates_of_bonds`, with those that open found from all bonds, which opened until now.

    So of several ways to go on the one is taken that changes least.
    """
    opens, g = np.isfinite(lengths), np.zeros(len(x0))
    for _ in range(_CHANGES):
        try:
            part = np.linalg.solve(matrix[np.ix_(opens, opens)], x0[opens])
        except np.linalg.LinAlgError:
            break
        load = 1.0 if (part / lengths[opens]).sum() >= 0.0 else -1.0
        g[:] = 0.0
        g[opens] = load * part
        left = matrix @ g - load * x0
        wrong = np.where(opens, g < 0.0, left < -_ZERO * np.abs(x0).max())
        if not wrong.any():
            return load, g
        opens ^= wrong
    return 0.0, None


def _of_one_bond(
    matrix: np.ndarray, x0: np.ndarray, lengths: np.ndarray
) -> tuple[float, np.ndarray | None]:
    """As `rates_of_bonds`, from a bond k that opens at a given rate: where the load turns.

    There g = 0 solves the problem for a load that falls. w_k = 0 gives the load, and leaves a
    problem of the other bonds. Those that soften by most are tried.
    """
    softest = np.argsort(np.diag(matrix), kind="stable")
    for k in softest[np.isfinite(lengths[softest]) & (x0[softest] != 0.0)][:_TRIED]:
        others = np.delete(np.arange(len(x0)), k)
        ratio = x0[others] / x0[k]
        g = np.zeros(len(x0))
        g[k] = lengths[k]
        given = (matrix[others, k] - matrix[k, k] * ratio) * g[k]
        rest = lemke(matrix[np.ix_(others, others)] - np.outer(ratio, matrix[k, others]), given)
        if rest is not None:
            g[others] = rest
            return float(matrix[k] @ g / x0[k]), g
    return 0.0, None


def lemke(m: np.ndarray, q: np.ndarray) -> np.ndarray | None:
    """z >= 0 with w = M z + q >= 0 and z . w = 0; None where Lemke's algorithm ends on a ray.

    Args:
        m, q: shapes (n, n) and (n,).
    """
    n = len(q)
    scale = np.abs(q).max(initial=0.0)
    if not np.isfinite(scale) or not np.isfinite(m).all():
        return None
    if q.min(initial=0.0) >= 0.0:
        return np.zeros(n)
    # w - M z - z0 = q, of which z0 makes all right sides positive
    table = np.hstack([np.eye(n), -m, -np.ones((n, 1)), q[:, None] / scale])
    basic = np.arange(n)
    row, entering = int(np.argmin(q)), 2 * n
    for _ in range(_PIVOTS * n):
        left = int(basic[row])
        basic[row] = entering
        table[row] /= table[row, entering]
        column = table[:, entering].copy()
        column[row] = 0.0
        table -= np.outer(column, table[row])
        if left == 2 * n:
            z = np.zeros(2 * n + 1)
            z[basic] = scale * table[:, -1]
            return z[n:-1]
        entering = left + n if left < n else left - n
        column = table[:, entering]
        positive = column > _ZERO * np.abs(column).max()
        if not positive.any():
            return None
        ratios = np.full(n, np.inf)
        ratios[positive] = table[positive, -1] / column[positive]
        row = int(np.argmin(ratios))
        of_z0 = np.flatnonzero(basic == 2 * n)[0]
        if ratios[of_z0] <= ratios[row] + _ZERO * abs(ratios[row]):
            row = int(of_z0)
    return None
