# SPDX-License-Identifier: LGPL-3.0-or-later
"""How fast a crack runs along a weak plane: below the Rayleigh speed.

    ./fenicsx python3 benchmarks/crack_speed.py [--speeds 2 5 10] [--figure docs/crack_speed.png]

A strip, plane strain, of height 2 H, bonded along its middle and cracked from one end, is pulled by
its edges at a constant speed from a uniform strain rate on, so that no shock starts from them. Far
ahead it stores G0 = E1 eps^2 H per crack length, E1 = lambda + 2 mu, and far behind nothing (Marder
1991): the crack starts when G0 exceeds w and is fed the better the faster the edges move. By
symmetry it opens alone, and its speed is bounded by that of Rayleigh's waves c_R, the root below
c_s of (Rayleigh 1885)

    (2 - (c / c_s)^2)^2 = 4 sqrt(1 - (c / c_d)^2) sqrt(1 - (c / c_s)^2),

as a faster crack would have to be fed from nothing (Freund 1990). Each half is a body; its bulk is
explicit. The tip is the foremost point up to which all bonds are gone; its speed is taken over
stretches of `WINDOW` half heights.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
from dolfinx.mesh import CellType, create_rectangle
from mpi4py import MPI
from scipy.optimize import brentq

from xper_fx.bodies import explode
from xper_fx.compat import geometry_dofmap
from xper_fx.forms.loads import PrescribedVelocity
from xper_fx.materials import LinearElastic
from xper_fx.materials.library import ZIRCALOY_4
from xper_fx.meshes import tag_facets
from xper_fx.nscd.laws import CohesiveZone
from xper_fx.plots import new_figure
from xper_fx.recorder import point_coordinates
from xper_fx.scene import Scene
from xper_fx.simulation import Simulation

BOTTOM, TOP, CRACK = 1, 2, 3
HALF_HEIGHT = 1e-3
STRENGTH = 1e9
# Cohesive length E' w / Rmax^2 over facets.
FACETS = 5.0
# Stretch over which a speed is taken, in half heights.
WINDOW = 0.25


def wave_speeds(material: LinearElastic) -> tuple[float, float, float]:
    """c_d, c_s and c_R of plane strain (m/s)."""
    young, poisson, density = material.young, material.poisson, material.density
    shear = 0.5 * young / (1.0 + poisson)
    fast = np.sqrt(2.0 * shear * (1.0 - poisson) / (1.0 - 2.0 * poisson) / density)
    slow = np.sqrt(shear / density)

    def rayleigh(c):
        return (2.0 - (c / slow) ** 2) ** 2 - 4.0 * np.sqrt(
            (1.0 - (c / fast) ** 2) * (1.0 - (c / slow) ** 2)
        )

    return fast, slow, brentq(rayleigh, 0.5 * slow, (1.0 - 1e-9) * slow, xtol=1e-9)


class Strip(NamedTuple):
    """A strip and how it is pulled.

    Attributes:
        speed: of each edge (m/s).
        cells: quadrilaterals across half the height.
        length: over half the height.
    """

    speed: float
    cells: int = 40
    length: float = 6.0

    @property
    def facet(self) -> float:
        return HALF_HEIGHT / self.cells

    @property
    def bond(self) -> CohesiveZone:
        """Bond along the plane; C_N = 50 E' / facet."""
        modulus = ZIRCALOY_4.young / (1.0 - ZIRCALOY_4.poisson**2)
        energy = FACETS * self.facet * STRENGTH**2 / modulus
        return CohesiveZone(50.0 * modulus / self.facet, energy, STRENGTH)


def scene_of(strip: Strip) -> Scene:
    """Two halves, bonded along y = 0 for x > HALF_HEIGHT, that start at a uniform strain rate."""
    size = (strip.length * HALF_HEIGHT, HALF_HEIGHT)
    mesh = create_rectangle(
        MPI.COMM_SELF,
        [np.array([0.0, -size[1]]), np.array(size)],
        [round(strip.length * strip.cells), 2 * strip.cells],
        CellType.quadrilateral,
    )
    small = 1e-6 * HALF_HEIGHT
    where = {
        BOTTOM: lambda x: x[1] < small - HALF_HEIGHT,
        TOP: lambda x: x[1] > HALF_HEIGHT - small,
        CRACK: lambda x: (np.abs(x[1]) < small) & (x[0] < HALF_HEIGHT + small),
    }
    upper = mesh.geometry.x[geometry_dofmap(mesh)].mean(axis=1)[:, 1] > 0.0
    speed = strip.speed
    return Scene(
        explode(mesh, upper.astype(int), facet_tags=tag_facets(mesh, where)),
        {1: ZIRCALOY_4},
        default_interaction=strip.bond,
        facet_interactions={CRACK: None},
        loads=[
            PrescribedVelocity(tag, axis, value)
            for tag, values in ((BOTTOM, (0.0, -speed)), (TOP, (0.0, speed)))
            for axis, value in enumerate(values)
        ],
        initial_velocity=lambda x: np.array([0.0 * x[0], speed * x[1] / HALF_HEIGHT]),
    )


class Growth(NamedTuple):
    """Of each step time (s), tip (m) and dissipated energy (J/m); at the end closure over work."""

    time: np.ndarray
    tip: np.ndarray
    dissipated: np.ndarray
    closure: float

    def speeds(self) -> tuple[np.ndarray, np.ndarray]:
        """Places of the tip (m) and its speed there (m/s), by stretches of WINDOW."""
        window = WINDOW * HALF_HEIGHT
        start, end = self.tip[0] + window, self.tip[-1]
        marks = np.arange(start, end, window)
        # when the tip, which goes facet by facet, first was there
        arrival = self.time[np.searchsorted(self.tip, marks)]
        return 0.5 * (marks[1:] + marks[:-1]), window / np.diff(arrival)


def crack(strip: Strip) -> Growth:
    """Pull until the crack is a half height from the strip's end."""
    simulation = Simulation(scene_of(strip), scheme="explicit", num_threads=1)
    x, broken_at = point_coordinates(simulation)[:, 0], strip.bond.critical_opening
    order = np.argsort(x, kind="stable")
    end = (strip.length - 1.0) * HALF_HEIGHT
    rows = []
    for step in simulation.steps(1.0):
        opening = simulation.interactions.gather("opening_max")[order]
        # the crack is what is broken all the way from its start
        count = int(np.argmin(opening >= broken_at))
        tip = x[order][count - 1] if count else HALF_HEIGHT
        rows.append((step.time, tip, step.energies["dissipated_cohesion"]))
        if tip > end or opening[-1] >= broken_at:
            break
    closure = step.energies["closure"] / step.energies["external_work"]
    return Growth(*np.array(rows).T, closure)


def draw(runs: dict[float, Growth], path: Path) -> None:
    """Speed of the tip over c_R against its place."""
    limit = wave_speeds(ZIRCALOY_4)[2]

    def fill(figure, axes):
        for speed, growth in runs.items():
            place, found = growth.speeds()
            axes.plot(place / HALF_HEIGHT, found / limit, "o-", ms=3.0, label=f"{speed:g} m/s")
        axes.axhline(1.0, color="0.3", lw=0.8)
        axes.text(1.1, 1.02, "Rayleigh")
        axes.set(xlabel="tip / half height", ylabel="speed / c_R", ylim=(0.0, 1.15))
        axes.legend(title="edges pulled at", loc="lower right")

    new_figure(path, fill, (4.6, 3.4))


def main(options: list[str] | None = None) -> None:
    """Run some loads, print a table and draw the speeds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--speeds", type=float, nargs="+", default=[2.0, 5.0, 10.0], help="of the edges, m/s")
    add("--cells", type=int, default=40, help="across half the height")
    add("--figure", type=Path, help="where to draw")
    args = parser.parse_args(options)
    fast, slow, limit = wave_speeds(ZIRCALOY_4)
    print(f"c_d = {fast:.1f}, c_s = {slow:.1f}, c_R = {limit:.1f} m/s")
    print("| edges (m/s) | first, middle, last speed / c_R | largest | spent / (w da) | closure |")
    print("|---|---|---|---|---|")
    runs = {}
    for speed in args.speeds:
        strip = Strip(speed, args.cells)
        growth = runs[speed] = crack(strip)
        found = growth.speeds()[1] / limit
        some = ", ".join(f"{found[i]:.3f}" for i in (0, len(found) // 2, -1))
        spent = growth.dissipated[-1] / strip.bond.fracture_energy / np.ptp(growth.tip)
        print(
            f"| {speed:g} | {some} | {found.max():.3f} | {spent:.3f} | {growth.closure:.1e} |",
            flush=True,
        )
    if args.figure:
        draw(runs, args.figure)


if __name__ == "__main__":
    main()
