# SPDX-License-Identifier: LGPL-3.0-or-later
r"""A shear rupture that runs along a fault by itself, against boundary integrals and theory.

    ./fenicsx python3 benchmarks/fault_rupture.py [--s 0.5 0.7 2] [--facets 4 8] [--figure FILE]

The set-up is that of Andrews (1976). A plane fault between two elastic half-spaces, in plane
strain, is under the pressure sigma and the shear tau_0, and its friction falls linearly with slip,
from tau_p = mu_s sigma to tau_r = mu_d sigma over the distance D. How far it is from its strength
is told by

    S = (tau_p - tau_0) / (tau_0 - tau_r),   tau_0 - tau_r = (tau_p - tau_r) / (1 + S).

A patch around the origin has a strength of 0.98 tau_0: it slips, and slip spreads. Stresses and
speeds are those of TPV3 of the Southern California Earthquake Center. With
mu* = mu / (1 - nu) and the fracture energy G = (tau_p - tau_r) D / 2 theory says:

- a crack of half-length L_c = mu* (tau_p - tau_r) D / (pi (tau_0 - tau_r)^2) is critical: there
  the energy that it releases, (tau_0 - tau_r)^2 pi L / (2 mu*), is G (Andrews 1976);
- above S = 1.77 ruptures approach the Rayleigh speed from below; with less, slip begins ahead of
  the tip after 9.8 (1.77 - S)^-3 L_c, and runs between sqrt(2) c_s and c_p (Andrews 1976, 1985; the
  fit to his numbers by Xia, Rosakis and Kanamori 2004, for ruptures that grow from L_c);
- the cohesive zone of a tip that just begins to move is Lambda = 9 pi / 32 mu* D / (tau_p - tau_r)
  long (Palmer and Rice 1973). It is the unit of length here, Lambda / c_s that of time.

**Boundary integrals.** Of two like half-spaces in mode II the pressure stays, and the shear stress
follows from the displacement u, half the slip, by (Geubelle and Rice 1995)

    tau = tau_0 - mu / c_s du/dt + f,   f_k(t) = -mu |k| int H(|k| c_s t') u_k(t - t') |k| c_s dt',

for each wave number k. H is what the Rayleigh function leaves besides radiation: with
eta = c_p / c_s and the Laplace variable p,

    H(p) = [(2 + p^2)^2 - 4 sqrt(1 + p^2 / eta^2) sqrt(1 + p^2)] / (p^2 sqrt(1 + p^2)) - p,
    H(T) = J_1(T) / T + 4 T [w(eta T) - w(T)] - 4 J_0(eta T) / eta + 3 J_0(T),
    w(x) = int_x^inf J_1(y) / y dy.

Nothing of it is shared with the finite elements, which are two bodies of crossed triangles, an
explicit bulk, `InitialStress` and `SlipWeakening`. Their outer sides are held, so far away that no
wave comes back in time.

**Energy.** A point that has slipped by s > D has lost tau_r s + G a unit of area, and one that has
slipped less tau_r s + (tau_p - tau_r) (s - s^2 / (2 D)). Their sum is compared with the ledger.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import numpy as np
from mpi4py import MPI
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import brentq
from scipy.special import j0, j1

import xper_fx as xf
from xper_fx.plotting.figures import COLOURS, new_figure

DENSITY, C_S, C_P = 2670.0, 3464.0, 6000.0
PRESSURE, MU_S, MU_D, DISTANCE = 120e6, 0.677, 0.525, 0.4
MODULUS = DENSITY * C_S**2
POISSON = (C_P**2 - 2.0 * C_S**2) / (2.0 * (C_P**2 - C_S**2))
EFFECTIVE = MODULUS / (1.0 - POISSON)
WEAKENING = (MU_S - MU_D) * PRESSURE
RESIDUAL = MU_D * PRESSURE
LAMBDA = 9.0 * np.pi / 32.0 * EFFECTIVE * DISTANCE / WEAKENING
# Of the impulses: the rest creeps. With 1e-6 a fault that holds slips by D / 100.
TOLERANCE = 1e-10
SLOW = 1.77  # S above which no rupture is faster than the Rayleigh speed
PATCH_STRENGTH = 0.98  # over tau_0
SIDES = 1


class Case(NamedTuple):
    """A fault and how long it is watched.

    Attributes:
        s: S of the initial stress.
        patch: half-length of the patch over L_c.
        reach: distance from the origin up to which the rupture is followed, over Lambda.
        time: duration, over Lambda / c_s.
    """

    s: float
    patch: float
    reach: float
    time: float

    @property
    def shear(self) -> float:
        """tau_0 (Pa)."""
        return RESIDUAL + WEAKENING / (1.0 + self.s)

    @property
    def critical(self) -> float:
        """L_c (m)."""
        return EFFECTIVE * WEAKENING * DISTANCE / (np.pi * (self.shear - RESIDUAL) ** 2)

    @property
    def transition(self) -> float:
        """Distance after which theory has the rupture run faster than S waves (m)."""
        return 9.8 * (SLOW - self.s) ** -3 * self.critical if self.s < SLOW else np.inf

    def static_friction(self, x: np.ndarray) -> np.ndarray:
        """mu_s at positions along the fault (m)."""
        inside = np.abs(x) < self.patch * self.critical
        return np.where(inside, PATCH_STRENGTH * self.shear / PRESSURE, MU_S)


CASES = {
    0.5: Case(0.5, 1.5, 14.0, 9.5),
    0.7: Case(0.7, 1.2, 16.0, 17.0),
    2.0: Case(2.0, 1.2, 18.0, 24.0),
}


class Rupture(NamedTuple):
    """When slip passes along one half of the fault, x > 0.

    Attributes:
        x: of the points, ascending (m).
        begun: when they have slipped by D / 100, inf where they have not (s).
        passed: when they have slipped by D (s).
    """

    x: np.ndarray
    begun: np.ndarray
    passed: np.ndarray

    def time_at(self, x: float) -> float:
        """When slip has passed a place (s)."""
        return float(np.interp(x, self.x, self.passed))

    def speed(self, first: float, last: float) -> float:
        """Mean speed between two places (m/s)."""
        return (last - first) / (self.time_at(last) - self.time_at(first))

    def transition(self, patch: float) -> float:
        """Where the speed over half a Lambda first exceeds sqrt(2) c_s (m), inf if nowhere.

        Args:
            patch: half-length of the patch that slips first (m), which is left out.
        """
        last = self.x[np.isfinite(self.passed)][-1] - 0.5 * LAMBDA
        for x in self.x[(self.x > patch) & (self.x < last)]:
            if self.speed(x, x + 0.5 * LAMBDA) > np.sqrt(2.0) * C_S:
                return float(x)
        return np.inf


def rayleigh_speed() -> float:
    """c_R (m/s)."""

    def function(v: float) -> float:
        p, s = np.sqrt(1.0 - (v / C_P) ** 2), np.sqrt(1.0 - (v / C_S) ** 2)
        return 4.0 * p * s - (1.0 + s**2) ** 2

    return brentq(function, 0.5 * C_S, 0.9999 * C_S)


def kernel(t: np.ndarray) -> np.ndarray:
    """H(T) of the boundary integrals, T ascending from 0."""
    eta = C_P / C_S
    fine = np.arange(0.0, eta * t[-1] + 1.0, 5e-3)
    with np.errstate(invalid="ignore"):
        w = 1.0 - cumulative_trapezoid(np.where(fine > 0.0, j1(fine) / fine, 0.5), fine, initial=0)
        first = np.where(t > 0.0, j1(t) / t, 0.5)
    between = np.interp(eta * t, fine, w) - np.interp(t, fine, w)
    return first + 4.0 * t * between - 4.0 / eta * j0(eta * t) + 3.0 * j0(t)


def by_integrals(case: Case, facets: int, share: float = 0.1) -> Rupture:
    """The rupture by boundary integrals in Fourier series.

    Args:
        case: the fault.
        facets: points in Lambda.
        share: of a step, c_s h over the distance of points. At 0.3 integrals are not converged.
    """
    size, duration = LAMBDA / facets, case.time * LAMBDA / C_S
    half = round(2.0 * case.reach * facets)
    x = size * np.arange(-half, half)
    step = share * size / C_S
    count = int(duration / step) + 1
    k = 2.0 * np.pi * np.fft.rfftfreq(2 * half, size)
    table = np.linspace(0.0, k[-1] * C_S * step * count, int(20 * k[-1] * C_S * duration) + 2)
    values = kernel(table)
    weight = np.array([np.interp(k * C_S * step * i, table, values) for i in range(count + 1)])
    weight *= MODULUS * C_S * step * k**2
    weight[0] *= 0.5  # trapezoidal rule; nothing has moved at the other end
    static = case.static_friction(x) * PRESSURE
    u, past = np.zeros(2 * half), np.zeros((count, len(k)), complex)
    begun, passed = np.full((2, 2 * half), np.inf)
    for i in range(count):
        past[i] = np.fft.rfft(u)
        f = -np.fft.irfft(np.einsum("ik,ik->k", weight[i::-1], past[: i + 1]), 2 * half)
        strength = static - (static - RESIDUAL) * np.minimum(2.0 * u / DISTANCE, 1.0)
        u += step * C_S / MODULUS * np.maximum(case.shear + f - strength, 0.0)
        mark(2.0 * u, (i + 1) * step, begun, passed)
    return Rupture(x[half:], begun[half:], passed[half:])


def mark(slip: np.ndarray, time: float, begun: np.ndarray, passed: np.ndarray) -> None:
    """Note the time where slip has just begun, or passed D."""
    for level, when in ((0.01 * DISTANCE, begun), (DISTANCE, passed)):
        when[(slip > level) & np.isinf(when)] = time


def fault(case: Case, facets: int) -> xf.Scene:
    """Two bodies on either side of the fault, under their initial stress.

    Args:
        case: the fault.
        facets: in Lambda.
    """
    size = LAMBDA / facets
    # P waves run to the sides and back until the end, or pass the whole reach on the way back
    along, across = (
        round(0.5 * (C_P / C_S * case.time + reach) * facets) for reach in (case.reach, 0.0)
    )
    corner = size * np.array([along, across])
    mesh = xf.crossed_rectangle(-corner, corner, (2 * along, 2 * across), MPI.COMM_SELF)
    sides = xf.tag_facets(
        mesh, {SIDES: lambda x: np.any(np.abs(x[:2].T) > corner - 0.1 * size, axis=1)}
    )
    middle = mesh.geometry.x[xf.geometry_dofmap(mesh)].mean(axis=1)
    young = 2.0 * MODULUS * (1.0 + POISSON)
    return xf.Scene(
        xf.explode(mesh, (middle[:, 1] > 0.0).astype(int), facet_tags=sides),
        {1: xf.materials.LinearElastic(young, POISSON, DENSITY)},
        default_interaction=xf.laws.SlipWeakening(
            lambda x: case.static_friction(x[0]), MU_D, DISTANCE
        ),
        loads=[
            xf.InitialStress([[0.0, case.shear], [case.shear, -PRESSURE]]),
            *(xf.PrescribedVelocity(SIDES, i, 0.0) for i in range(2)),
        ],
    )


class Balance(NamedTuple):
    """Energies of a rupture by finite elements.

    Attributes:
        lost: what friction has dissipated over what slip says that it has.
        closure: of the ledger, over the work of the loads.
        fracture: the part of what was dissipated that is fracture energy.
    """

    lost: float
    closure: float
    fracture: float


def by_elements(case: Case, facets: int, share: float = 1.0) -> tuple[Rupture, Balance]:
    """The rupture by finite elements.

    Args:
        case, facets: see `fault`.
        share: of the step that is picked.
    """
    scene = fault(case, facets)
    step = share * xf.Simulation(scene, scheme="explicit").step_size
    simulation = xf.Simulation(scene, step, scheme="explicit", tolerance=TOLERANCE, num_threads=1)
    (points,) = simulation.interactions.groups
    nodes = simulation.model.slot_nodes[points.points.nodes[:, 0, 0]]
    x = simulation.forms.V.tabulate_dof_coordinates()[nodes, 0]
    begun, passed = np.full((2, len(x)), np.inf)
    slip = points.state[:, 0]
    for record in simulation.steps(case.time * LAMBDA / C_S):
        mark(slip, record.time, begun, passed)
    weakening = points.parameters[:, 0] * PRESSURE - RESIDUAL
    lost = np.minimum(slip, DISTANCE)
    fracture = points.points.area @ (weakening * (lost - 0.5 * lost**2 / DISTANCE))
    energies = record.energies
    balance = Balance(
        energies["dissipated_friction"] / (points.points.area @ (RESIDUAL * slip) + fracture),
        energies["closure"] / energies["external_work"],
        fracture / energies["dissipated_friction"],
    )
    # two points stand at each node, on the facets beside it
    half = np.flatnonzero(x > -0.1 * LAMBDA / facets)
    half = half[np.argsort(x[half], kind="stable")][::2]
    return Rupture(x[half], begun[half], passed[half]), balance


def compare(found: Rupture, reference: Rupture, case: Case) -> np.ndarray:
    """Errors of the times at which slip passes, from twice the patch on, over these times."""
    places = LAMBDA * np.arange(2.0 * case.patch * case.critical / LAMBDA, case.reach, 0.5)
    times = np.array([[rupture.time_at(x) for x in places] for rupture in (found, reference)])
    arrived = np.isfinite(times).all(axis=0)
    return times[0, arrived] / times[1, arrived] - 1.0


def describe(case: Case, rupture: Rupture) -> str:
    """Speeds and the transition of a rupture."""
    last = rupture.x[np.isfinite(rupture.passed)][-1]
    last = min(last, case.reach * LAMBDA)
    speed = rupture.speed(last - 2.0 * LAMBDA, last)
    zone = speed * (rupture.time_at(last) - np.interp(last, rupture.x, rupture.begun))
    text = (
        f"over the last 2 Lambda {speed / C_S:.3f} c_s = {speed / rayleigh_speed():.3f} c_R = "
        f"{speed / C_P:.3f} c_p, zone {zone / LAMBDA:.2f} Lambda"
    )
    if case.s < SLOW:
        found = rupture.transition(case.patch * case.critical) / case.critical
        fit = case.transition / case.critical
        text += f", beyond sqrt(2) c_s from {found:.2f} L_c (fit {fit:.2f})"
    return text


def draw(runs: dict[Case, tuple[Rupture, Rupture]], path: Path) -> None:
    """Where slip has passed against time, and its speed against the distance."""

    def drawn(figure, axes) -> None:
        left, right = axes
        for colour, (case, (found, reference)) in zip(COLOURS, runs.items(), strict=False):
            for rupture, style in ((found, "-"), (reference, ":")):
                name = f"S = {case.s:g}" if rupture is found else None
                far = np.isfinite(rupture.passed) & (rupture.x < case.reach * LAMBDA)
                x, passed = rupture.x[far], rupture.passed[far]
                left.plot(x / LAMBDA, passed * C_S / LAMBDA, style, color=colour, label=name)
                places = np.arange(case.patch * case.critical, x[-1] - LAMBDA, 0.1 * LAMBDA)
                speed = np.array([rupture.speed(p, p + LAMBDA) for p in places]) / C_S
                # slip that begins ahead passes some places before those behind them
                shown = np.where((speed > 0.0) & (speed < 2.5), speed, np.nan)
                right.plot(places / LAMBDA + 0.5, shown, style, color=colour, label=name)
        across = right.get_yaxis_transform()
        for level, name in (
            (rayleigh_speed(), "$c_R$"), (np.sqrt(2.0) * C_S, r"$\sqrt{2}\,c_s$"), (C_P, "$c_p$")
        ):  # fmt: skip
            right.axhline(level / C_S, color="gray", linewidth=0.8)
            right.text(0.01, level / C_S + 0.02, name, color="gray", transform=across)
        left.set(
            xlabel=r"distance from the origin / $\Lambda$", ylabel=r"time, $c_s t / \Lambda$",
            title="slip of D has passed; dotted: boundary integrals",
        )  # fmt: skip
        right.set(
            xlabel=r"distance from the origin / $\Lambda$", ylabel=r"speed / $c_s$",
            title=r"mean speed over one $\Lambda$", ylim=(0.0, 2.2),
        )  # fmt: skip
        left.legend()

    new_figure(path, drawn, (9.0, 3.8), ncols=2)


def main() -> None:
    """Run, report, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--s", type=float, nargs="+", default=list(CASES), choices=CASES)
    parser.add_argument("--facets", type=int, nargs="+", default=[4, 8], help="in Lambda")
    parser.add_argument("--share", type=float, default=1.0, help="of the step that is picked")
    parser.add_argument("--figure", type=Path)
    arguments = parser.parse_args()
    runs = {}
    for case in (CASES[s] for s in arguments.s):
        reference = by_integrals(case, 16)
        print(
            f"S = {case.s:g}, L_c = {case.critical / LAMBDA:.2f} Lambda; boundary integrals: "
            + describe(case, reference),
            flush=True,
        )
        for facets in arguments.facets:
            start = perf_counter()
            found, balance = by_elements(case, facets, arguments.share)
            errors = compare(found, reference, case)
            runs[case] = found, reference
            print(
                f"  {facets} facets: times off by {100 * errors.min():+.2f} to "
                f"{100 * errors.max():+.2f} %; {describe(case, found)}; friction over what slip "
                f"says: {balance.lost - 1.0:+.1e} ({100 * balance.fracture:.0f} % fracture "
                f"energy), ledger off by {abs(balance.closure):.0e}; "
                f"{perf_counter() - start:.0f} s",
                flush=True,
            )
    if arguments.figure:
        draw(runs, arguments.figure)


if __name__ == "__main__":
    main()
