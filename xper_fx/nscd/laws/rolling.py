# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Rolling resistance: a couple at the contact of a round body, against the relative spin.

With the relative spin w = omega_c - omega_a (rad/s), in 3D its part along the tangent plane, and
the effective radius R, 1/R the sum of 1/radius over the round sides (a flat side or a corner adds
nothing), the couple m on the candidate obeys

    |m| <= mu_r R r_N,    m = -mu_r R r_N w / |w| where w is not zero

(Ai et al. 2011; Acary and Bourrier 2021, whose coefficient is the length mu_r R). A coefficient of
the sum of both radii, mu (r1 + r2) r_N, is four times as large here for equal balls. A disc with
mu_r = tan(pi / n) begins to roll on the slope on which a regular polygon of n sides turns over:
rolling resistance may stand for angular shape (Estrada et al. 2011). As friction, the couple
leaves the normal motion alone, acts on the end velocity, and is a multiplier while the bodies do
not roll. What spins about the normal is not resisted.

**A point beside the contact.** The couple is the impulse of a *rolling point*, whose sides are the
rotations of both bodies. With m = R r and the rolling velocity u = R w, in m/s and N s as all
others,

    u = R (omega_c - omega_a),    |r| <= mu_r r_N,    r_N of the contact, as it is now.

In 2D the point has one component, in 3D those of its contact's frame. Sweeps visit the contacts of
a law, then their rolling points. A fixed point of the sweeps solves both, since r_N is read where
it is kept, and the criterion of the sweeps adds up both, so that neither is left out.

**Convergence.** At a contact of two balls, or of a ball and a wall, the normal goes through the
centres: W couples r_N neither to friction nor to the couple, and r_N is what it is. Friction and
couple then minimise one convex quadratic over the product of two discs, where visits by turns
contract: by 2/3 a sweep for a disc on a plane that sticks and does not roll, 5/7 for a sphere, 0
for two equal balls, and at once where the couple is at its bound. Between contacts it is the
problem of friction.
"""

from __future__ import annotations

from functools import cache

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_INNER
from xper_fx.nscd.laws.contact_solver import contact_solver
from xper_fx.nscd.laws.law import LawKernels
from xper_fx.nscd.laws.signorini import SLIP, STICK


@cache
def rolling_kernels(dim: int, column: int) -> LawKernels:
    """The kernels of the rolling points of a contact law.

    Args:
        dim: 2 or 3.
        column: of the contact's parameters, which are those of its rolling point, with mu_r. The
            point's `details` are the impulses of its contact.
    """

    @njit(**LEAN_INNER)
    def prepare(i, jump, velocity, w, area, step, theta, parameters, state, terms, details):
        pass

    if dim == 2:

        @njit(inline="always")
        def solve(i, u, r, w, parameters, terms, details):
            bound = parameters[i, column] * details[i, 0]
            if w[i, 0] <= 0.0:
                return (0.0,), False
            return (max(-bound, min(bound, r[0] - u[0] / w[i, 0])),), False

    else:
        # Tresca's friction, pressed by a unit impulse that couples to nothing
        tresca = contact_solver(3, True)

        @njit(inline="always")
        def solve(i, u, r, w, parameters, terms, details):
            w11, w12, w22 = w[i, 3], w[i, 4], w[i, 5]
            own = w11 + w22
            b = (-own, u[1] - w11 * r[1] - w12 * r[2], u[2] - w12 * r[1] - w22 * r[2])
            bound = parameters[i, column] * details[i, 0]
            found, _ = tresca(b, (own, 0.0, 0.0, w11, w12, w22), 0.0, (0.0, 0.0), 0.0, bound)
            return (0.0, found[1], found[2]), False

    @njit(**LEAN_INNER)
    def commit(i, jump0, jump1, u, r, area, step, theta, parameters, state, terms, details, energy):
        work, size = 0.0, 0.0
        for j in range(len(r)):
            work += r[j] * (jump1[j] - jump0[j]) / step
            size += r[j] * r[j]
        energy[i, 0] = -work
        bound = parameters[i, column] * details[i, 0]
        if details[i, 0] <= 0.0:
            return 0
        return SLIP if size >= (1.0 - 1e-12) * bound * bound else STICK

    return LawKernels(
        name="rolling resistance",
        effects=(),
        components=1 if dim == 2 else 3,
        prepare=prepare,
        solve=solve,
        commit=commit,
        num_terms=0,
        energies=("friction",),
    )
