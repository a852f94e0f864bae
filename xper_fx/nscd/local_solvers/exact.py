# SPDX-License-Identifier: LGPL-3.0-or-later
"""3D: the exact solution, one root of a secular equation in the eigenbasis of the compliance.

Closed, u_N = 0 gives r_N = p - c.r_T with p = -b_N / W_NN and c = W_TN / W_NN, hence

    u_T = g + S r_T,   g = b_T - c b_N,   S = W_TT - W_TN W_NT / W_NN.

Coulomb: u_T = -lambda r_T, that is r_T = -(S + lambda I)^-1 g, with lambda = 0 (stick) or
|r_T| = mu r_N. In the eigenbasis (a, b) of S, divided by its larger eigenvalue, with k the ratio
of the eigenvalues and x = lambda / larger, everything is polynomial:

    A = (k + x) g_a,  B = (1 + x) g_b,  D = (k + x)(1 + x),  N = p D + c_a A + c_b B,
    r_T = -(A, B) / D,   r_N = N / D,   slip:  h(x) = mu N / sqrt(A^2 + B^2) - 1 = 0.

h is mu r_N / |r_T| - 1: linear in x if S is isotropic, and without coupling concave and increasing
(as 1 / |r_T| is in trust-region methods), so that Newton from x = 0 climbs to the root without
passing it. Chebyshev's correction by h'' makes it cubic for a few products more: one square root
and one division, side by side, a step. A bracket holds what strong coupling may do: h(0) < 0
where sticking leaves the cone, and h >= 0 for x >= |g| (1 + mu |c|) / (mu p). With strong coupling
there may be several roots: any of them is a solution.

Only the direction of (A, B) is kept of the root: u_N = 0 and |r_T| = mu r_N then give

    r_N = p Q / (Q - mu (c_a A + c_b B)),   r_T = -mu r_N (A, B) / Q,   Q = sqrt(A^2 + B^2),

on the cone whatever error x still has; the iteration ends when the next step would turn (A, B) by
less than rounding, so isotropic S takes one step. x is kept for the next visit.

Singular S as in coulomb.py: a direction of no compliance carries nothing; one that closing does not
stop slides, if it can.
"""

import numpy as np

from xper_fx.nscd.algebra.small import SINGULAR
from xper_fx.nscd.laws.signorini import NO_SLIP
from xper_fx.nscd.local_solvers.interface import INLINE_KERNEL, INNER_KERNEL, KERNEL, LocalSolver

# Factors: 1 / W_NN (0: carries nothing), cos and sin of the eigenbasis, 1 / larger eigenvalue of S,
# ratio k (0: singular), c_a, c_b, x of the visit before (0: none).
NUM_FACTORS = 8

_STEPS = 100
# Beyond, (A, B) is along g to the last digit.
_LARGEST = 1e20


@KERNEL
def prepare(w, mu, factors, i):
    """Eigenbasis of the Schur complement S; no x yet."""
    for j in range(NUM_FACTORS):
        factors[i, j] = 0.0
    tangential = w[3] + w[5]
    if w[0] <= SINGULAR * tangential:
        return
    inverse = 1.0 / w[0]
    s11 = w[3] - w[1] * w[1] * inverse
    s12 = w[4] - w[1] * w[2] * inverse
    s22 = w[5] - w[2] * w[2] * inverse
    half = 0.5 * (s11 - s22)
    radius = np.hypot(half, s12)
    large = 0.5 * (s11 + s22) + radius
    c, s = 1.0, 0.0
    if radius > 0.0:
        # the larger of the two from its half-angle formula, the other from 2 c s = s12 / radius
        if half >= 0.0:
            c = np.sqrt(0.5 * (1.0 + half / radius))
            s = 0.5 * s12 / (radius * c)
        else:
            s = np.sqrt(0.5 * (1.0 - half / radius))
            c = 0.5 * s12 / (radius * s)
    factors[i, 0], factors[i, 1], factors[i, 2] = inverse, c, s
    factors[i, 5] = (c * w[1] + s * w[2]) * inverse
    factors[i, 6] = (c * w[2] - s * w[1]) * inverse
    if large > SINGULAR * tangential:
        small = (s11 * s22 - s12 * s12) / large  # free of the cancellation in mean - radius
        factors[i, 3] = 1.0 / large
        if small > SINGULAR * tangential:
            factors[i, 4] = small / large


@INNER_KERNEL
def _between(low, high):
    """A point of the bracket: by size first, then by halves."""
    if low < 0.01 * high:
        return np.sqrt(max(low, 1e-3 * high * min(1.0, 1.0 / high)) * high)
    return 0.5 * (low + high)


@INNER_KERNEL
def slide(push, ga, gb, ca, cb, k, mu, x):
    """Slipping impulse (r_N, r_a, r_b) in the eigenbasis, the root x, and the steps taken."""
    spread = ga * gb * (1.0 - k)
    linear = ca * ga + cb * gb
    low, high, bounded, steps = 0.0, _LARGEST, False, 0
    from_zero = x == 0.0 or k <= SINGULAR * 2.0  # near-singular: not towards huge impulses
    while steps < _STEPS:
        steps += 1
        along, across = k + x, 1.0 + x
        a, b = along * ga, across * gb
        square = a * a + b * b  # Q^2
        turned = a * ga + b * gb  # Q Q'
        n = push * along * across + ca * a + cb * b
        excess = np.sqrt(square) - mu * n
        if excess > 0.0:
            low = x
        else:
            high = x
        # h' = mu slope / Q^3, h'' = mu bend / Q^5
        slope = (push * (along + across) + linear) * square - n * turned
        bend = 2.0 * (push * square * square - slope * turned) - n * spread * spread
        inverse = 1.0 / (mu * slope)
        newton = excess * inverse
        correction = 0.5 * mu * newton * (bend * inverse)
        step = newton * square * (1.0 - min(max(correction, -0.5), 0.5))
        trial = x + step
        if slope > 0.0 and low <= trial <= high:
            x = trial
            # turn of (A, B) times the square of the relative step: what is left after this one,
            # unless it came from so far right that the turn was no measure
            left = abs(spread * step) * (step * step)
            if left <= 1e-16 * square * (along * along) and -2.0 * step <= along:
                break
        elif slope > 0.0 and trial < low and not from_zero:
            x, from_zero = 0.0, True  # the warm start was beyond the root
        else:
            if not bounded:
                bound = np.hypot(ga, gb) * (1.0 + mu * np.hypot(ca, cb)) / (mu * push)
                high = max(low, min(high, bound))
                bounded = True
            if high - low <= 1e-15 * high:
                break
            x = _between(low, high)
    a, b = (k + x) * ga, (1.0 + x) * gb
    size = np.sqrt(a * a + b * b)
    rest = size - mu * (ca * a + cb * b)
    if rest <= 0.0:  # by rounding only
        rest = mu * push * (k + x) * (1.0 + x)
    scale = push / rest
    if not (scale * size < np.inf):
        return push, 0.0, 0.0, x, steps
    scale_t = -mu * scale
    return scale * size, scale_t * a, scale_t * b, x, steps


@INLINE_KERNEL
def _guided(b, w, factors, i, mu, push):
    """S singular along the second eigenvector, perhaps along both."""
    c, s, soft, ca, cb = (factors[i, 1], factors[i, 2], factors[i, 3], factors[i, 5], factors[i, 6])
    ga = c * b[1] + s * b[2] - ca * b[0]
    gb = c * b[2] - s * b[1] - cb * b[0]
    still = NO_SLIP * (abs(b[1]) + abs(b[2]) + (abs(w[1]) + abs(w[2])) * push)
    tiny = SINGULAR * (w[3] + w[5])
    # such a direction carries nothing if W vanishes along it or the slip is stopped anyway
    if soft == 0.0:
        size = np.hypot(ga, gb)
        rest = size - mu * (ca * ga + cb * gb)
        if size <= still or (ca * ca + cb * cb) * w[0] <= tiny or rest <= NO_SLIP * size:
            return push, 0.0, 0.0
        ra, rb = -mu * push / rest * ga, -mu * push / rest * gb
        return push * size / rest, c * ra - s * rb, s * ra + c * rb
    if abs(gb) <= still or cb * cb * w[0] <= tiny or mu * abs(cb) >= 1.0:
        gb = 0.0
    if (ga == 0.0 and gb == 0.0) or mu == 0.0:
        return push, 0.0, 0.0
    k = tiny * soft  # only bounds the divisions
    ga *= soft
    gb *= soft
    ra, rb = -ga, -gb / k
    n = push - ca * ra - cb * rb
    if not (n >= 0.0 and np.hypot(ra, rb) <= mu * n):
        n, ra, rb, _, _ = slide(push, ga, gb, ca, cb, k, mu, 1.0)
    return n, c * ra - s * rb, s * ra + c * rb


@INLINE_KERNEL
def solve_and_count(b, w, factors, i, mu, r):
    """The impulse, and the steps on h it took."""
    inverse = factors[i, 0]
    if b[0] >= 0.0 or inverse == 0.0:
        return (0.0, 0.0, 0.0), 0
    push = -b[0] * inverse
    k = factors[i, 4]
    if k == 0.0:
        return _guided(b, w, factors, i, mu, push), 0
    c, s, soft, ca, cb = (factors[i, 1], factors[i, 2], factors[i, 3], factors[i, 5], factors[i, 6])
    ga = (c * b[1] + s * b[2] - ca * b[0]) * soft
    gb = (c * b[2] - s * b[1] - cb * b[0]) * soft
    # A, N at x = 0, the sticking impulse times k
    a = k * ga
    n = push * k + ca * a + cb * gb
    limit = mu * n
    steps = 0
    if n >= 0.0 and a * a + gb * gb <= limit * limit:
        n, ra, rb = n / k, -ga, -gb / k
    elif mu == 0.0:
        return (push, 0.0, 0.0), 0
    else:
        n, ra, rb, x, steps = slide(push, ga, gb, ca, cb, k, mu, factors[i, 7])
        factors[i, 7] = x
    return (n, c * ra - s * rb, s * ra + c * rb), steps


@INLINE_KERNEL
def solve(b, w, factors, i, mu, r):
    """The impulse."""
    r, _ = solve_and_count(b, w, factors, i, mu, r)
    return r


EXACT = LocalSolver("exact", NUM_FACTORS, prepare, solve)
