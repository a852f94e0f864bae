# SPDX-License-Identifier: LGPL-3.0-or-later
"""2D: the affine map u = b + W r meets the graphs of Signorini and Coulomb (Jean 1999).

Closed, u_N = 0 gives r_N = p - c r_T with p = -b_N / W_NN > 0 and c = W_NT / W_NN, hence

    u_T = g + S r_T,   g = b_T - c b_N,   S = W_TT - W_NT^2 / W_NN > 0.

Coulomb's graph is u_T = -lambda r_T, lambda >= 0: r_T = -g / (S + lambda) has the sign of -g in
every status, so only one way to slip is a candidate. With e = sign(r_T), |r_T| - mu r_N is
|r_T| (1 + mu e c) - mu p:

- where the sticking impulse -g / S makes it <= 0, stick. If 1 + mu e c > 0 a slipping impulse,
  shorter, would lie strictly inside the cone; if not, the cone's side is never reached: no slip;
- else 1 + mu e c > 0 and r_N = p / (1 + mu e c), r_T = e mu r_N: one root, for any mu and W_NT.

So for b_N < 0 there is exactly one solution even when mu |W_NT| > W_NN, and for b_N >= 0 the open
one is taken. No division is left to `solve`, nor is `w` read unless S = 0.

Where S = 0 (a node guided obliquely) a slip that closing does not stop slides, if it can.
"""

from xper_fx.nscd.algebra.small import SINGULAR
from xper_fx.nscd.laws.signorini import NO_SLIP
from xper_fx.nscd.local_solvers.interface import INLINE_KERNEL, KERNEL, LocalSolver

# Factors: 1 / W_NN (0: carries nothing), c, 1 / S (0: singular), 1 / (1 + mu c), 1 / (1 - mu c)
# (0 where that way is no candidate).
NUM_FACTORS = 5


@KERNEL
def prepare(w, mu, factors, i):
    """Constants of w and mu."""
    for k in range(NUM_FACTORS):
        factors[i, k] = 0.0
    if w[0] <= SINGULAR * w[2]:
        return
    inverse = 1.0 / w[0]
    coupling = w[1] * inverse
    schur = w[2] - w[1] * coupling
    factors[i, 0], factors[i, 1] = inverse, coupling
    if schur > SINGULAR * w[2]:
        factors[i, 2] = 1.0 / schur
    forth, back = 1.0 + mu * coupling, 1.0 - mu * coupling
    if forth > 0.0:
        factors[i, 3] = 1.0 / forth
    if back > 0.0:
        factors[i, 4] = 1.0 / back


@INLINE_KERNEL
def solve(b, w, factors, i, mu, r):
    """The impulse, by cases."""
    inverse = factors[i, 0]
    if b[0] >= 0.0 or inverse == 0.0:
        return 0.0, 0.0
    coupling, soft = factors[i, 1], factors[i, 2]
    push = -b[0] * inverse
    slip = b[1] - coupling * b[0]
    tangent = -slip * soft
    normal = push - coupling * tangent
    gain = factors[i, 4] if slip > 0.0 else factors[i, 3]
    if soft == 0.0:
        stopped = abs(slip) <= NO_SLIP * (abs(b[1]) + abs(coupling * b[0]))
        if stopped or gain == 0.0 or w[2] <= SINGULAR * w[0]:
            return push, 0.0
    elif abs(tangent) <= mu * normal or gain == 0.0:  # no gain: by rounding only, see above
        return normal, tangent
    normal = push * gain
    return normal, -mu * normal if slip > 0.0 else mu * normal


GRAPH = LocalSolver("graph", NUM_FACTORS, prepare, solve)
