# SPDX-License-Identifier: LGPL-3.0-or-later
"""The local Signorini problem with Coulomb friction in 3D; `coulomb.py` states it.

Without a bound the root is that of `nscd/local_solvers/exact.py`.
"""

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import SINGULAR
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.nscd.laws.signorini import NO_SLIP, OPEN, SLIP, STICK
from xper_fx.nscd.local_solvers.exact import slide

# Bound on the steps (by 4) that bracket a root: all of floating point, and an end for NaN.
_DOUBLINGS = 1100


@njit(fastmath={"contract"}, **LEAN_ENTRY)
def coulomb_space(b, w, v_min, shift, mu, bound):
    if b[0] >= v_min or w[0] <= SINGULAR * (w[3] + w[5]):
        return (0.0, 0.0, 0.0), OPEN
    push = (v_min - b[0]) / w[0]
    inverse = 1.0 / w[0]
    s11 = w[3] - w[1] * w[1] * inverse
    s12 = w[4] - w[1] * w[2] * inverse
    s22 = w[5] - w[2] * w[2] * inverse
    g1 = b[1] + shift[0] + w[1] * push
    g2 = b[2] + shift[1] + w[2] * push
    # Eigenbasis of S: (S + lambda I)^-1 is then two divisions.
    half = 0.5 * (s11 - s22)
    radius = np.sqrt(half * half + s12 * s12)
    mean = 0.5 * (s11 + s22)
    large = mean + radius
    if radius > 0.0:
        c2 = half / radius
        c = np.sqrt(0.5 * (1.0 + c2)) if c2 > -1.0 else 0.0
        s = np.sqrt(0.5 * (1.0 - c2)) if c2 < 1.0 else 0.0
        if s12 < 0.0:
            s = -s
    else:
        c, s = 1.0, 0.0
    # det / large, free of the cancellation in mean - radius
    small = (s11 * s22 - s12 * s12) / large if large > 0.0 else 0.0
    ga, gb = c * g1 + s * g2, c * g2 - s * g1
    wa, wb = (c * w[1] + s * w[2]) * inverse, (c * w[2] - s * w[1]) * inverse
    tiny = SINGULAR * (w[3] + w[5])
    singular = small <= tiny
    if singular:
        # S is singular along b, perhaps along a: such a direction carries nothing if W vanishes
        # along it or the slip is stopped anyway; else it slides, and `tiny` only bounds divisions.
        still = NO_SLIP * (
            abs(b[1]) + abs(b[2]) + abs(shift[0]) + abs(shift[1]) + (abs(w[1]) + abs(w[2])) * push
        )
        if abs(gb) <= still or small + wb * wb * w[0] <= tiny or mu * abs(wb) >= 1.0:
            gb = 0.0
        small = max(small, tiny)
        if large <= tiny:
            if abs(ga) <= still or large + wa * wa * w[0] <= tiny or mu * abs(wa) >= 1.0:
                ga = 0.0
            large = tiny
        if ga == 0.0 and gb == 0.0:
            return (push, 0.0, 0.0), STICK
    ra, rb = -ga / large, -gb / small
    normal = push - wa * ra - wb * rb
    limit = mu * normal + bound
    if normal >= 0.0 and ra * ra + rb * rb <= limit * limit:
        return (normal, c * ra - s * rb, s * ra + c * rb), STICK
    if mu == 0.0 and bound == 0.0:
        return (push, 0.0, 0.0), SLIP
    if bound == 0.0 and not singular:
        normal, ra, rb, _, _ = slide(push, ga / large, gb / large, wa, wb, small / large, mu, 0.0)
        return (normal, c * ra - s * rb, s * ra + c * rb), SLIP
    # f(lambda) = |r_T| - mu r_N - bound: bracket the root, then Newton kept inside the bracket.
    low, high = 0.0, large
    if limit < 0.0 or ra * ra + rb * rb > limit * limit:
        for _ in range(_DOUBLINGS):
            ra, rb = -ga / (large + high), -gb / (small + high)
            if np.sqrt(ra * ra + rb * rb) <= mu * (push - wa * ra - wb * rb) + bound:
                break
            low, high = high, 4.0 * high
    else:  # |r_T| is within the bound, but r_N < 0
        high = 0.0
    lam = low
    for _ in range(100):
        da, db = 1.0 / (large + lam), 1.0 / (small + lam)
        ra, rb = -ga * da, -gb * db
        size = np.sqrt(ra * ra + rb * rb)
        f = size - mu * (push - wa * ra - wb * rb) - bound
        if f > 0.0:
            low = lam
        else:
            high = lam
        slope = -(ra * ra * da + rb * rb * db) / size - mu * (wa * ra * da + wb * rb * db)
        step = -f / slope if slope < 0.0 else 0.0
        trial = lam + step
        if not (low < trial < high):
            trial = 0.5 * (low + high)
        if abs(trial - lam) <= 1e-15 * (lam + small) or high - low <= 1e-15 * high:
            lam = trial
            break
        lam = trial
    ra, rb = -ga / (large + lam), -gb / (small + lam)
    normal = push - wa * ra - wb * rb
    if normal < 0.0 and bound > 0.0:
        # The largest lambda with r_N = 0: push (large + l)(small + l) + ... is a quadratic.
        half_b = 0.5 * (push * (large + small) + wa * ga + wb * gb)
        c0 = push * large * small + wa * ga * small + wb * gb * large
        root = np.sqrt(max(half_b * half_b - push * c0, 0.0))
        lam = (root - half_b) / push if half_b <= 0.0 else -c0 / (root + half_b)
        ra, rb = -ga / (large + lam), -gb / (small + lam)
        return (0.0, c * ra - s * rb, s * ra + c * rb), SLIP
    normal = max(normal, 0.0)
    size = np.sqrt(ra * ra + rb * rb)
    if size > 0.0:  # exactly on the limit: the last rounding must not leave it
        ratio = (mu * normal + bound) / size
        ra, rb = ra * ratio, rb * ratio
    return (normal, c * ra - s * rb, s * ra + c * rb), SLIP
