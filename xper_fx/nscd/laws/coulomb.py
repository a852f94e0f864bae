# SPDX-License-Identifier: LGPL-3.0-or-later
"""The local Signorini problem with Coulomb friction at one point, solved exactly.

With dU = b + W r (m/s; b is the relative velocity without this point's impulse r, N s), find

    dU_N >= v_min,  r_N >= 0,  (dU_N - v_min) r_N = 0,
    |r_T| <= mu r_N + bound,  r_T opposing the slip  s = dU_T + shift  on that limit, s = 0 inside.

Coulomb friction is bound = 0 (N s), Tresca friction mu = 0. `v_min` carries the kind of contact
(velocity or position level, restitution) and `shift` what slip means over the step; all are
constants of the step, so one solver serves every law.

Sticking violates the cone: then s = -lambda r_T with lambda > 0. Eliminating r_N by the active
normal condition leaves (S + lambda I) r_T = -g with S = W_TT - W_TN W_NT / W_NN positive definite,
and f(lambda) = |r_T(lambda)| - mu r_N(r_T(lambda)) - bound falls from f(0) > 0 to
-mu (v_min - b_N) / W_NN - bound < 0: a root always exists, whatever mu. In 2D it is explicit;
`coulomb_space.py` has 3D.

With a bound, sticking or sliding may ask for r_N < 0: the tangential impulse alone would open the
point. The solution is then on the edge of contact, dU_N = v_min and r_N = 0, with |r_T| < bound.

A direction in which W vanishes (both sides prescribed) can carry no impulse: it gets none. When W
is singular along an oblique direction (a node guided along a line or in a plane), a slip that the
normal condition does not stop is never stuck: it slides.
"""

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import SINGULAR
from xper_fx.nscd.laws.signorini import NO_SLIP, OPEN, SLIP, STICK


@njit(inline="always")
def coulomb_plane(b, w, v_min, shift, mu, bound):
    if b[0] >= v_min or w[0] <= SINGULAR * w[2]:
        return (0.0, 0.0), OPEN
    push = (v_min - b[0]) / w[0]
    schur = w[2] - w[1] * w[1] / w[0]
    slip = b[1] + shift[0] + w[1] * push
    sign = -1.0 if slip > 0.0 else 1.0
    coupling = sign * w[1] / w[0]
    if schur <= SINGULAR * w[2]:
        stopped = abs(slip) <= NO_SLIP * (abs(b[1]) + abs(shift[0]) + abs(w[1] * push))
        if stopped or w[2] <= SINGULAR * w[0] or 1.0 + mu * coupling <= 0.0:
            return (push, 0.0), STICK
    else:
        stick_t = -slip / schur
        stick_n = push - w[1] * stick_t / w[0]
        if abs(stick_t) <= mu * stick_n + bound and stick_n >= 0.0:
            return (stick_n, stick_t), STICK
    # Sticking violates the cone, hence 1 + mu coupling > 0 (module docstring).
    normal = (push - coupling * bound) / (1.0 + mu * coupling)
    if normal < 0.0:  # only with a bound: the tangential impulse alone opens the point
        return (0.0, sign * push / abs(coupling)), SLIP
    return (normal, sign * (mu * normal + bound)), SLIP
