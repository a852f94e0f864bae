# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Friction that depends on the speed of slip: Stribeck's curve, and the drag of a film.

A closed point that slips at the speed v = |dU_T| carries

    |r_T| = mu(v) r_N + eta h A v,    mu(v) = mu_d + (mu_s - mu_d) exp(-v / v_c),

against its slip, and at most mu_s r_N where it sticks (Stribeck 1902 measured the curve; the
exponential is that of Bo and Pavelescu 1982). eta is the drag of a lubricating film while the
point is closed, in Pa s/m; of discs and spheres, whose contacts have the area 1, in N s/m. Where
drag alone would open the point, r_N = 0 and the drag is the part of it that keeps dU_N where it
is.

**A step** looks at the end velocity, at position level at the mean slip (`signorini_coulomb.py`).
For a trial speed v the point's problem is Coulomb's with the friction mu(v) and the bound eta h A
v; let T(v) be the slip that it finds. Speeds of slip are the roots of G(v) = T(v) - v. G falls,
and there is one state, stick or slip, if

    (mu_s - mu_d) r_N W_TT < v_c,    that is    h < v_c / ((mu_s - mu_d) N W_TT)

for a pressing force N = r_N / h; W_TT of a mass m on a wall is 1/m if it does not turn, 3/m of a
disc, 7/(2 m) of a sphere. Beyond it a point may have three states: it sticks, slips at the largest
root, or slips at an unstable one in between. The state taken is that to which relaxation from the
speed at the start of the step would lead: a point at rest sticks as long as it can, one that slips
faster than the unstable root goes on slipping.

Without coupling of normal and tangent G is concave, so that secants from above its largest root
fall to it and pass over no other; a bracket keeps them where it is not.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.kernel_options import LEAN_INNER, MERGED_ENTRY
from xper_fx.nscd.laws.contact_solver import contact_solver
from xper_fx.nscd.laws.law import Columns, LawKernels
from xper_fx.nscd.laws.parameters import acts, refuse_where, take_parameters
from xper_fx.nscd.laws.signorini import OPEN, STICK
from xper_fx.nscd.laws.signorini_coulomb import check_contact

# Secants at most, and the error of a speed, relative to the largest possible.
_SECANTS, _ROUNDING = 60, 1e-14


@dataclass(frozen=True)
class StribeckFriction:
    """Contact whose friction falls from a static to a dynamic value as it slips faster.

    Parameters are numbers or fields (`xper_fx/nscd/laws/fields.py`).

    Args:
        static_friction: mu_s, at rest.
        dynamic_friction: mu_d <= mu_s, of fast slip.
        speed: v_c (m/s), over which friction falls.
        viscosity: eta (Pa s/m; of discs and spheres N s/m), drag of a film beside friction.
        restitution: Newton's e in [0, 1] (velocity level only).
        contact: "velocity" or "position", as of `SignoriniCoulomb`.

    Raises:
        ValueError: a number out of range, friction that grows.
    """

    static_friction: Any
    dynamic_friction: Any
    speed: Any
    viscosity: Any = 0.0
    restitution: Any = 0.0
    contact: str = "velocity"

    def __post_init__(self) -> None:
        names = ("static_friction", "dynamic_friction", "viscosity", "restitution")
        if not take_parameters(self, positive=("speed",), non_negative=names):
            return
        check_contact(self.contact, self.restitution)
        refuse_where(
            np.asarray(self.dynamic_friction > self.static_friction),
            lambda at: (
                f"Friction should fall with speed, got {at(self.static_friction):g} at rest and "
                f"{at(self.dynamic_friction):g} of fast slip; viscosity makes it grow."
            ),
        )

    def kernels(self, dim: int) -> LawKernels:
        """See `Law`."""
        return _kernels(dim, self.contact, acts(self.viscosity))

    def parameters(self) -> tuple:
        """mu_s, mu_d, v_c (m/s); eta with a film; at velocity level Newton's e."""
        numbers = [self.static_friction, self.dynamic_friction, self.speed]
        numbers += [self.viscosity] if acts(self.viscosity) else []
        return (*numbers, self.restitution) if self.contact == "velocity" else tuple(numbers)

    def initial_state(self) -> tuple:
        """At velocity level the normal impulse of the last step (N s)."""
        return (0.0,) if self.contact == "velocity" else ()


@cache
def _kernels(dim: int, contact: str, viscous: bool) -> LawKernels:
    """The kernels, with `viscous` those with a film."""
    algebra = for_dimension(dim)
    sym_row, sym_vector = algebra.sym_row, algebra.sym_vector
    add, subtract, tangent_part = algebra.add, algebra.subtract, algebra.tangent_part
    local, impact = contact_solver(dim, True), contact == "velocity"
    if impact:
        from xper_fx.nscd.laws.impact import least_speed

    parameters_of, state_of, terms_of = Columns(), Columns(), Columns()
    mu_s, mu_d, v_c = (parameters_of.take("friction") for _ in range(3))
    v_min = terms_of.take("unilateral contact")
    shift = terms_of.take("friction", dim - 1)
    start = terms_of.take("friction")  # speed of slip at the start
    reach = terms_of.take("friction")  # v_c of slips as they are counted over the step
    if viscous:
        eta, drag = parameters_of.take("friction"), terms_of.take("friction")
    if impact:
        e, pushed = parameters_of.take("impact"), state_of.take("impact")

    @njit(inline="always")
    def speed_of(u, lag):
        if dim == 2:
            return abs(u[1] + lag[0])
        return np.sqrt((u[1] + lag[0]) ** 2 + (u[2] + lag[1]) ** 2)

    @njit(inline="always")
    def friction_at(i, v, parameters, terms):
        fall = parameters[i, mu_s] - parameters[i, mu_d]
        return parameters[i, mu_d] + fall * np.exp(-v / terms[i, reach])

    @njit(inline="always")
    def drag_at(i, v, terms):
        if viscous:
            return terms[i, drag] * v
        return 0.0

    @njit(**LEAN_INNER)
    def prepare(i, jump, velocity, w, area, step, theta, parameters, state, terms, details):
        gap = jump[0] + step * (1.0 - theta) * velocity[0]
        # at position level slips count as (jump1 - jump0) / (h theta)
        scale = 1.0 if impact else 1.0 / theta
        if impact:
            last = w[i, 0] * state[i, pushed]
            terms[i, v_min] = least_speed(gap, velocity[0], step, last, parameters[i, e])
        else:
            terms[i, v_min] = -gap / (step * theta)
        square = 0.0
        for j in range(1, dim):
            terms[i, shift + j - 1] = (scale - 1.0) * velocity[j]
            square += velocity[j] ** 2
        terms[i, start] = scale * np.sqrt(square)
        terms[i, reach] = scale * parameters[i, v_c]
        if viscous:
            terms[i, drag] = step * area * parameters[i, eta] / scale

    @njit(**LEAN_INNER)
    def slide_at(i, v, b, wi, parameters, terms):
        """Impulse and slip of the point with the friction of a speed."""
        lag = tangent_part(terms, i, shift)
        mu, bound = friction_at(i, v, parameters, terms), drag_at(i, v, terms)
        r, _ = local(b, wi, terms[i, v_min], lag, mu, bound)
        return r, speed_of(add(b, sym_vector(wi, r)), lag)

    @njit(**LEAN_INNER)
    def largest_root(i, top, sticks, b, wi, parameters, terms):
        """Impulse and speed at the largest root of G below `top`, or zero if there is none."""
        low, high, bracketed = 0.0, top, not sticks
        x0, x = 1.5 * top, top
        _, slip = slide_at(i, x0, b, wi, parameters, terms)
        g0 = slip - x0
        r, slip = slide_at(i, x, b, wi, parameters, terms)
        for _ in range(_SECANTS):
            g = slip - x
            if abs(g) <= _ROUNDING * top:
                break
            if g > 0.0:
                low, bracketed = x, True
            else:
                high = x
            slope = (g - g0) / (x - x0)
            new = x - g / slope if slope < 0.0 else -1.0
            if not low < new < high:
                if not bracketed:
                    return r, 0.0
                new = 0.5 * (low + high)
            if abs(new - x) <= _ROUNDING * top:
                break
            x0, g0, x = x, g, new
            r, slip = slide_at(i, x, b, wi, parameters, terms)
        return r, x

    @njit(**MERGED_ENTRY)
    def solve(i, u, r, w, parameters, terms, details):
        wi, lag = sym_row(w, i), tangent_part(terms, i, shift)
        b = subtract(u, sym_vector(wi, r))
        stuck, status = local(b, wi, terms[i, v_min], lag, parameters[i, mu_s], 0.0)
        if status == OPEN or (status == STICK and terms[i, start] == 0.0):
            return stuck, False
        free, _ = local(b, wi, terms[i, v_min], lag, parameters[i, mu_d], 0.0)
        top = speed_of(add(b, sym_vector(wi, free)), lag)
        if status == STICK and top <= _ROUNDING * terms[i, start]:
            return stuck, False
        slid, speed = largest_root(i, top, status == STICK, b, wi, parameters, terms)
        if status == STICK:
            if speed == 0.0:
                return stuck, False
            if terms[i, start] < speed:
                _, slip = slide_at(i, terms[i, start], b, wi, parameters, terms)
                if slip < terms[i, start]:
                    return stuck, False
        return slid, False

    @njit(**LEAN_INNER)
    def commit(i, jump0, jump1, u, r, area, step, theta, parameters, state, terms, details, energy):
        work, size = 0.0, 0.0
        for j in range(1, dim):
            work -= r[j] * (jump1[j] - jump0[j]) / step
            size += r[j] * r[j]
        energy[i, 0] = -r[0] * (jump1[0] - jump0[0]) / step
        energy[i, 1] = work
        if impact:
            state[i, pushed] = r[0]
        if r[0] <= 0.0 and size == 0.0:
            return 0
        v = speed_of(u, tangent_part(terms, i, shift))
        limit = friction_at(i, v, parameters, terms) * r[0] + drag_at(i, v, terms)
        return 2 if size >= (1.0 - 1e-9) * limit * limit else 1

    return LawKernels(
        name="contact with Stribeck friction",
        effects=Columns.effects(parameters_of, state_of, terms_of),
        components=dim,
        prepare=prepare,
        solve=solve,
        commit=commit,
        num_terms=terms_of.count,
        state_names=("pushed",) if impact else (),
        energies=("impact", "friction"),
    )
