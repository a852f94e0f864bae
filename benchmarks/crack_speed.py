# SPDX-License-Identifier: LGPL-3.0-or-later
"""How fast a crack runs along a weak plane: as Freund says, and below the Rayleigh speed.

    ./fenicsx python3 benchmarks/crack_speed.py [--loads 1 2 4] [--cells 120] [--figure FILE]

A strip, plane strain, 0 <= x <= `length` H, |y| <= H, of two bodies bonded along y = 0 but for a
crack, x < `START` H; both ends are lines of symmetry. Its edges part at the speed V from t = 0 to
2 H / c_d and then stop. The plane waves of tension that leave them, sigma / 2 = rho c_d V, meet at
the plane at H / c_d, double there, and are back at the edges when these stop: far from the crack
the strip is then at rest under sigma, with no wave left, and stores per length of the plane

    G0 = sigma^2 H / E1,   E1 = rho c_d^2 = lambda + 2 mu,

which is what a crack that goes steadily gets, whatever its speed (Marder 1991). Fronts last
`RISE` H / c_d; times t from here on are since their middle met at the plane.

**Until the edges answer**, t < 2 H / c_d, the tip does not know that the strip has an edge. A
crack at rest gets G(t) = (4 / pi) (c_d t / H) G0 (Freund 1990, chapter 2: K_I =
2 sigma sqrt(c_d t (1 - 2 nu) / pi) / (1 - nu)), and one at the speed v the share g(v) of it, with
Freund's universal function (1990, chapters 5 and 6). As it takes w,

    g(v) = (pi / 4) (w / G0) H / (c_d t).

**Ever after** g, which falls from 1 at rest to 0 at the Rayleigh speed c_R, the root below c_s of

    D(v) = 4 sqrt(1 - (v / c_d)^2) sqrt(1 - (v / c_s)^2) - (2 - (v / c_s)^2)^2 = 0,

keeps a crack of mode I below c_R, whatever the load. Bonds follow as long as sigma is well below
their strength and the cohesive length E' w / Rmax^2 spans some facets: along the plane these are
H / `cells` long; in height cells grow from that to ten times that at the edges.

Lines through the times at which points of the plane broke, over `WINDOW` H, give the speed.

Found (E' w / Rmax^2 = H / 20; speeds over c_R = 2038 m/s, largest until the crack is 5.5 H longer
or t = 14 H / c_d; beside Freund's speed at the last stretch before the edges answer):

| G0 / w | H / facet | then (Freund) | largest | over the last H | closure / work |
|---|---|---|---|---|---|
| 1 | 120 | 0.583 (0.608) | 0.763 | 0.668 | 4e-4 |
| 2 | 120 | 0.810 (0.847) | 0.911 | 0.905 | 2.4e-3 |
| 4 | 40 | 0.803 (0.938) | 0.926 | 0.904 | 5.2e-3 |
| 4 | 80 | 0.861 (0.932) | 0.946 | 0.936 | 2.8e-3 |
| 4 | 120 | 0.883 (0.930) | 0.950 | 0.946 | 1.9e-3 |
| 4 | 160 | 0.899 (0.929) | 0.957 | 0.952 | 1.4e-3 |

What is missing to Freund's speed is of first order in facets: 2 of them in the cohesive length are
far too few, 8 are within 0.03 c_R. At twice that cohesive length and 80 facets in H, 8 again, the
first 2 H / c_d under G0 = w and 2 w are within 0.011 c_R; under 4 w, with sigma = 0.72 Rmax, the
crack starts 0.034 c_R faster, as its weakening zone is not small beside what waves have reached.
With G0 = w the speed swings as waves come back from the edges. At 80 facets in H half the step, or
twice it, moved speeds before the edges answer by less than 0.02 c_R; the closure, an energy gained,
falls like the step squared. Each bond spends w, to rounding. Behind fronts the mesh makes bonds far
ahead swing, by up to 17 % of sigma.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import CellType, create_rectangle
from mpi4py import MPI
from scipy.integrate import quad
from scipy.optimize import brentq

from xper_fx.bodies.explode import explode
from xper_fx.bodies.meshes import tag_facets
from xper_fx.forms.loads import PrescribedVelocity
from xper_fx.materials import LinearElastic
from xper_fx.materials.library import ZIRCALOY_4
from xper_fx.nscd.laws import CohesiveZone
from xper_fx.nscd.laws.law import COHESION
from xper_fx.output.field_series import point_coordinates
from xper_fx.plotting.figures import COLOURS, new_figure
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.compat import geometry_dofmap

BOTTOM, TOP, SIDES, CRACK = 1, 2, 3, 4
HALF_HEIGHT = 1e-3
STRENGTH = 1e9
# The crack's first length and the stretch over which a speed is taken, over H.
START, WINDOW = 1.5, 0.125
# The step over facet / c_d.
COURANT = 0.35
# Duration of the wave's front, over H / c_d.
RISE = 0.3


class Waves:
    """Speeds of waves in plane strain, and what they let a crack of mode I have.

    Args:
        material: linear elastic.

    Attributes:
        fast, slow, rayleigh: c_d, c_s and c_R (m/s).
    """

    def __init__(self, material: LinearElastic):
        young, self.poisson, density = material.young, material.poisson, material.density
        shear = 0.5 * young / (1.0 + self.poisson)
        self.modulus = 2.0 * shear * (1.0 - self.poisson) / (1.0 - 2.0 * self.poisson)
        self.fast, self.slow = np.sqrt(self.modulus / density), np.sqrt(shear / density)
        self.rayleigh = brentq(
            self._denominator, 0.5 * self.slow, (1.0 - 1e-9) * self.slow, xtol=1e-9
        )

    def _denominator(self, v: float) -> float:
        """D(v)."""
        roots = np.sqrt((1.0 - (v / self.fast) ** 2) * (1.0 - (v / self.slow) ** 2))
        return 4.0 * roots - (2.0 - (v / self.slow) ** 2) ** 2

    def share(self, v: float) -> float:
        """g(v) = A(v) k(v)^2 for 0 < v < c_R (Freund 1990, chapters 5 and 6).

        k = (1 - v / c_R) S / sqrt(1 - v / c_d), where S, of the factors of Rayleigh's function, is
        near 1: pi log S is the integral over slownesses e from 1 / c_d to 1 / c_s of
        arctan(4 e^2 sqrt((e^2 - a^2) (b^2 - e^2)) / (b^2 - 2 e^2)^2) / (1 / v - e).
        """
        a, b = 1.0 / self.fast, 1.0 / self.slow

        def phase(e):
            roots = np.sqrt((e * e - a * a) * (b * b - e * e))
            return np.arctan2(4.0 * e * e * roots, (b * b - 2.0 * e * e) ** 2) / (1.0 / v - e)

        factor = np.exp(quad(phase, a, b)[0] / np.pi)
        k = (1.0 - v / self.rayleigh) * factor / np.sqrt(1.0 - v / self.fast)
        root = np.sqrt(1.0 - (v / self.fast) ** 2)
        drive = (v / self.slow) ** 2 * root / ((1.0 - self.poisson) * self._denominator(v))
        return drive * k * k

    def speed(self, share: float) -> float:
        """The speed at which g is `share`; 0 where that is above 1 (m/s)."""
        least = 1e-4 * self.rayleigh
        if share >= self.share(least):
            return 0.0
        return brentq(lambda v: self.share(v) - share, least, (1.0 - 1e-9) * self.rayleigh)


WAVES = Waves(ZIRCALOY_4)
TRANSIT = HALF_HEIGHT / WAVES.fast
"""H / c_d (s)."""


class Strip(NamedTuple):
    """A strip and its load.

    Attributes:
        load: G0 / w.
        cells: facets of the plane in H, a multiple of 4.
        length: over H.
        cohesive_length: E' w / Rmax^2 over H.
    """

    load: float
    cells: int = 120
    length: float = 8.0
    cohesive_length: float = 0.05

    @property
    def bond(self) -> CohesiveZone:
        """Bond along the plane; C_N = 50 E' / facet."""
        modulus = ZIRCALOY_4.young / (1.0 - ZIRCALOY_4.poisson**2)
        energy = self.cohesive_length * HALF_HEIGHT * STRENGTH**2 / modulus
        return CohesiveZone(50.0 * modulus * self.cells / HALF_HEIGHT, energy, STRENGTH)

    @property
    def stress(self) -> float:
        """sigma (Pa)."""
        energy = self.load * self.bond.fracture_energy
        return float(np.sqrt(energy * WAVES.modulus / HALF_HEIGHT))


def scene_of(strip: Strip) -> Scene:
    """Two halves bonded along y = 0 ahead of the crack, and the waves that load them."""
    height, end = HALF_HEIGHT, strip.length * HALF_HEIGHT
    mesh = create_rectangle(
        MPI.COMM_SELF,
        [np.array([0.0, -height]), np.array([end, height])],
        [round(strip.length * strip.cells), strip.cells // 2],
        CellType.quadrilateral,
    )
    y = mesh.geometry.x[:, 1]
    mesh.geometry.x[:, 1] = 0.25 * y + 0.75 * y**3 / height**2
    small = 1e-6 * height
    where = {
        BOTTOM: lambda x: x[1] < small - height,
        TOP: lambda x: x[1] > height - small,
        SIDES: lambda x: (x[0] < small) | (x[0] > end - small),
        CRACK: lambda x: (np.abs(x[1]) < small) & (x[0] < START * height + small),
    }
    upper = mesh.geometry.x[geometry_dofmap(mesh)].mean(axis=1)[:, 1] > 0.0
    # The plane doubles the wave's stress.
    speed = 0.5 * strip.stress / (ZIRCALOY_4.density * WAVES.fast)

    def edge(t):
        rise, stop = np.clip(t / (RISE * TRANSIT) - np.array([0.0, 2.0 / RISE]), 0.0, 1.0)
        return speed * (rise - stop)

    return Scene(
        explode(mesh, upper.astype(int), facet_tags=tag_facets(mesh, where)),
        {1: ZIRCALOY_4},
        default_interaction=strip.bond,
        facet_interactions={CRACK: None},
        loads=[
            PrescribedVelocity(BOTTOM, 1, lambda t: -edge(t)),
            PrescribedVelocity(TOP, 1, edge),
            PrescribedVelocity(SIDES, 0, 0.0),
        ],
    )


class Growth(NamedTuple):
    """What a run gave.

    Attributes:
        place: of the points of the plane that broke, from the crack on, shape (n,), m.
        arrival: when they did, since the waves met, shape (n,), s.
        spent: what each dissipated over w and its length, shape (n,).
        closure: of the energies over the external work.
        steps: their number.
    """

    place: npt.NDArray[np.float64]
    arrival: npt.NDArray[np.float64]
    spent: npt.NDArray[np.float64]
    closure: float
    steps: int

    def speeds(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Times (s) and speeds of the tip (m/s), by stretches of WINDOW.

        Raises:
            ValueError: the crack grew by less than a stretch.
        """
        grown = np.ptp(self.place) if len(self.place) else 0.0
        if not grown > WINDOW * HALF_HEIGHT:
            raise ValueError(
                f"The crack grew by {grown:g} m, which is no stretch of "
                f"{WINDOW * HALF_HEIGHT:g} m: give it more load or time."
            )
        marks = np.arange(self.place[0], self.place[-1], WINDOW * HALF_HEIGHT)[1:]
        stretches = np.split(np.arange(len(self.place)), np.searchsorted(self.place, marks))
        fits = [
            (self.arrival[i].mean(), np.polyfit(self.arrival[i], self.place[i], 1)[0])
            for i in stretches[:-1]
        ]
        return tuple(np.array(fits).T)


def freund(load: float, time: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Speed of the tip (m/s) at times since the waves met (s), before the edges answer."""
    share = 0.25 * np.pi * TRANSIT / (load * np.asarray(time))
    return np.array([WAVES.speed(g) for g in np.ravel(share)])


def crack(strip: Strip, duration: float = 14.0) -> Growth:
    """Load the strip and follow its crack until it is H from the far end.

    Args:
        strip: what is loaded.
        duration: after which the run ends at the latest, since the waves met, over H / c_d.
    """
    step_size = COURANT * HALF_HEIGHT / strip.cells / WAVES.fast
    simulation = Simulation(scene_of(strip), step_size, scheme="explicit", num_threads=1)
    interactions, x = simulation.interactions, point_coordinates(simulation)[:, 0]
    broken_at, lost = np.full(len(x), np.inf), np.zeros(len(x))
    met = (1.0 + 0.5 * RISE) * TRANSIT
    far = x > (strip.length - 1.0) * HALF_HEIGHT
    for step in simulation.steps(met + duration * TRANSIT):
        lost += interactions.gather("energy")[:, COHESION]
        broken = interactions.gather("damage") == 0.0
        broken_at[broken & np.isinf(broken_at)] = step.time
        if np.any(broken & far):
            break
    order = np.argsort(x, kind="stable")
    order = order[np.isfinite(broken_at[order])]
    return Growth(
        x[order],
        broken_at[order] - met,
        lost[order] / (strip.bond.fracture_energy * interactions.points.area[order]),
        step.energies["closure"] / step.energies["external_work"],
        step.step,
    )


def draw(runs: dict[Strip, Growth], path: Path) -> None:
    """Speeds over c_R against time."""

    def fill(figure, axes):
        for colour, (strip, growth) in zip(COLOURS, runs.items(), strict=False):
            time, speed = growth.speeds()
            name = f"G0 = {strip.load:g} w"
            axes.plot(time / TRANSIT, speed / WAVES.rayleigh, "o", ms=2.5, c=colour, label=name)
            exact = np.linspace(0.25 * np.pi / strip.load, 2.0, 100) * TRANSIT
            axes.plot(exact / TRANSIT, freund(strip.load, exact) / WAVES.rayleigh, c=colour)
        axes.axhline(1.0, color="0.3", lw=0.8)
        axes.axvline(2.0, color="0.3", lw=0.8, ls=":")
        axes.text(0.1, 1.02, "Rayleigh")
        axes.text(2.1, 0.05, "the edges answer")
        axes.set(xlabel="c_d t / H since the waves met", ylabel="speed / c_R", ylim=(0.0, 1.12))
        axes.set_xlim(0.0)
        axes.legend(loc="lower right", title="points: run, lines: Freund", ncols=2)

    new_figure(path, fill, (5.2, 3.6))


def row(strip: Strip, growth: Growth) -> str:
    """A line of the table."""
    time, speed = growth.speeds()
    exact = freund(strip.load, time)
    before = ", ".join(
        f"{speed[i] / WAVES.rayleigh:.3f} ({exact[i] / WAVES.rayleigh:.3f})"
        for i in np.flatnonzero((time < 2.0 * TRANSIT) & (exact > 0.0))
    )
    last = speed[-round(1.0 / WINDOW) :].mean() / WAVES.rayleigh
    length = (growth.place[-1] - growth.place[0]) / HALF_HEIGHT
    return (
        f"| {strip.load:g} | {strip.stress / STRENGTH:.2f} | {before} | "
        f"{speed.max() / WAVES.rayleigh:.3f} | {last:.3f} | {length:.1f} | "
        f"{growth.spent.min():.4f} to {growth.spent.max():.4f} | {growth.closure:.1e} | "
        f"{growth.steps} |"
    )


def main(options: list[str] | None = None) -> None:
    """Run some loads, print a table and draw the speeds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--loads", type=float, nargs="+", default=[1.0, 2.0, 4.0], help="G0 / w")
    add("--cells", type=int, default=120, help="facets in H, a multiple of 4 (default 120)")
    add("--length", type=float, default=8.0, help="over H (default 8)")
    add("--cohesive-length", type=float, default=0.05, help="over H (default 0.05)")
    add("--duration", type=float, default=14.0, help="over H / c_d (default 14)")
    add("--figure", type=Path, help="where to draw")
    args = parser.parse_args(options)
    print(f"c_d = {WAVES.fast:.1f}, c_s = {WAVES.slow:.1f}, c_R = {WAVES.rayleigh:.1f} m/s")
    print(
        "| G0 / w | sigma / Rmax | v / c_R before the edges answer (Freund) | largest | over the "
        "last H | grown by / H | spent / w, each bond | closure | steps |\n" + 9 * "|---" + "|"
    )
    runs = {}
    for load in args.loads:
        strip = Strip(load, args.cells, args.length, args.cohesive_length)
        runs[strip] = crack(strip, args.duration)
        print(row(strip, runs[strip]), flush=True)
    if args.figure:
        draw(runs, args.figure)


if __name__ == "__main__":
    main()
