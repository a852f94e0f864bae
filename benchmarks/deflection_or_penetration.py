# SPDX-License-Identifier: LGPL-3.0-or-later
"""A crack meets an interface at a right angle: does it turn along it, or go through?

    ./fenicsx python3 benchmarks/deflection_or_penetration.py [--rates] [--choices] [--figure FILE]

The half x < 0 of a square plate is cracked along y = 0 up to an interface along x = 0, y > 0; the
same elastic material is on both sides. The edges y = +-H are moved apart. The run is static, in
plane strain, and lengths are in facets of the fine mesh around the tip, of size 1.

**Energies** (He and Hutchinson 1989). G_d is the energy that a crack deflected by a length a along
the interface releases, G_p that of one that has gone on by a. Without elastic mismatch their ratio
tends to 0.26 as a / H goes to zero: below a ratio of toughnesses of 0.26 the crack should turn.
Each G is the difference of the energies of two cracks, at fixed displacements. The stress along the
crack that comes with the load, T < 0 here, moves the ratio by a term of T (a / E' G)^(1/2), that
is of (a / H)^(1/2): the limit is that of a fit in (a / H)^(1/2).

**Choices.** With bonds on both ways and no kink to begin with, a crack also has to open a bond
where none is open yet, and the ratio of strengths counts (Parmigiani and Thouless 2006). A run
follows the crack (`GrowthControl`) until it has grown by some facets on either way; bisection gives
the ratio of toughnesses at which it changes its mind, for each ratio of strengths.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np
from dolfinx.mesh import CellType, create_rectangle
from mpi4py import MPI

import xper_fx as xf
from xper_fx.output.field_series import point_coordinates
from xper_fx.plotting.figures import COLOURS, new_figure
from xper_fx.support.compat import geometry_dofmap

MATERIAL = xf.materials.LinearElastic(young=1.0, poisson=0.3, density=1.0)
MODULUS = MATERIAL.young / (1.0 - MATERIAL.poisson**2)
CUT, ALONG, AHEAD, TOP, BOTTOM, HELD = range(1, 7)
PUBLISHED = 0.26
# Strength of the material ahead (Pa), and length of its elastic opening over that of its curve.
STRENGTH, ELASTIC = 1e-3, 0.02


@dataclass(frozen=True)
class Plate:
    """The plate; lengths in facets around the tip.

    Args:
        size: H, half its height and width.
        fine: half the width of the fine mesh.
        growth: ratio of neighbouring cells beyond it.
        kink: length of the crack beyond the tip.
        turned: whether the kink is along the interface.
    """

    size: float
    fine: int
    growth: float = 1.35
    kink: int = 0
    turned: bool = True

    def stations(self) -> np.ndarray:
        """Places of mesh lines along x and along y."""
        places, cell = list(range(self.fine + 1)), 1.0
        while places[-1] < self.size:
            cell *= self.growth
            places.append(places[-1] + cell)
        half = np.array(places, float)
        return np.concatenate([-half[:0:-1], half])

    def bodies(self):
        """Below the crack, to the left of the interface, to its right."""
        lines = self.stations()
        n, small, end = len(lines) - 1, 1e-6, lines[-1] - 1e-6
        corners = [np.zeros(2), np.full(2, float(n))]
        mesh = create_rectangle(MPI.COMM_SELF, corners, [n, n], CellType.quadrilateral)
        x = mesh.geometry.x
        x[:, :2] = np.interp(x[:, :2], np.arange(n + 1), lines)
        up, on = (self.kink, 0) if self.turned else (0, self.kink)

        def interface(x):
            return (np.abs(x[0]) < small) & (x[1] > -small)

        def plane(x):
            return np.abs(x[1]) < small

        where = {
            CUT: lambda x: (plane(x) & (x[0] < on + small)) | (interface(x) & (x[1] < up + small)),
            ALONG: lambda x: interface(x) & (x[1] > up - small),
            AHEAD: lambda x: plane(x) & (x[0] > on - small),
            TOP: lambda x: x[1] > end,
            BOTTOM: lambda x: x[1] < -end,
            HELD: lambda x: (x[0] > end) & (np.abs(x[1] - 0.5) < 0.5 + small),
        }
        middle = x[geometry_dofmap(mesh)].mean(axis=1)
        label = np.where(middle[:, 1] < 0.0, 0, np.where(middle[:, 0] < 0.0, 1, 2))
        return xf.explode(mesh, label, facet_tags=xf.tag_facets(mesh, where))

    def scene(self, along, ahead, order: int) -> xf.Scene:
        """The plate with laws on both ways; at the time t its edges have moved by t."""
        return xf.Scene(
            self.bodies(),
            {1: MATERIAL},
            default_interaction=ahead,
            facet_interactions={CUT: None, ALONG: along, AHEAD: ahead},
            loads=[
                xf.PrescribedDisplacement(TOP, 1, lambda t: t),
                xf.PrescribedDisplacement(BOTTOM, 1, lambda t: -t),
                xf.PrescribedDisplacement(HELD, 0, 0.0),
            ],
            order=order,
        )


def release_rate(size: float, kink: int, turned: bool, *, around=8, growth=1.35) -> float:
    """G of a kink (J/m^2), of the displacements of the time 1.

    Args:
        size, growth: of the plate.
        kink: length.
        turned: whether it is along the interface.
        around: facets of the fine mesh beyond the kink.
    """
    bonded, energies = xf.laws.PerfectBond(), []
    for length in (kink - 1, kink + 1):
        plate = Plate(size, kink + around, growth, length, turned)
        run = xf.Simulation(
            plate.scene(bonded, bonded, 2), 1.0, inertia=False, tolerance=1e-9, num_threads=1
        )
        energies.append(next(run.steps(1.0)).energies["elastic"])
    return 0.5 * (energies[0] - energies[1])


def ratio_of_rates(size: float, kink: int, **mesh) -> float:
    """G_d / G_p of kinks of one length; arguments as those of `release_rate`."""
    return release_rate(size, kink, True, **mesh) / release_rate(size, kink, False, **mesh)


def limit(share: np.ndarray, ratio: np.ndarray) -> float:
    """The ratio for a / H = 0, by a parabola in (a / H)^(1/2)."""
    return float(np.polyfit(np.sqrt(share), ratio, 2)[-1])


def bond(toughness: float, strength: float) -> xf.laws.CohesiveZone:
    """A bond whose elastic opening is short beside its curve."""
    return xf.laws.CohesiveZone(
        strength**2 / (ELASTIC * 1.5 * toughness), toughness, strength
    )  # fmt: skip


def turns(
    toughness: float, strength: float, *, size=10_000.0, fine=20, zone=6.0, far=6.0, step=0.4
) -> bool:
    """Whether the crack turns along the interface.

    Args:
        toughness, strength: of the interface, over those of the material ahead.
        size, fine: of the plate.
        zone: cohesive length E' w / Rmax^2 of the material ahead.
        far: growth of the crack at which it has chosen.
        step: growth of a bond in a step (`GrowthControl`).
    """
    energy = zone * STRENGTH**2 / MODULUS
    along, ahead = bond(toughness * energy, strength * STRENGTH), bond(energy, STRENGTH)
    run = xf.Simulation(
        Plate(size, fine).scene(along, ahead, 1), 1.0, inertia=False,
        path=xf.GrowthControl(step), num_threads=1,
    )  # fmt: skip
    x = point_coordinates(run)
    place = np.where(np.abs(x[:, 0]) < 1e-6, x[:, 1], 0.0), np.where(x[:, 1] == 0.0, x[:, 0], 0.0)
    for _ in run.steps(1e9):
        broken = run.interactions.gather("spent") > 0.99
        up, on = (way[broken].max(initial=0.0) for way in place)
        if max(up, on) >= far:
            return bool(up > on)
    raise RuntimeError("The crack has chosen neither way.")


def critical(strength: float, accuracy: float = 0.02) -> float:
    """The ratio of toughnesses below which the crack turns, for a ratio of strengths."""
    low, high = 0.0, 0.6
    while high - low > accuracy:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if turns(middle, strength) else (low, middle)
    return 0.5 * (low + high)


def draw(path: Path, rates: list[tuple], choices: list[tuple]) -> None:
    """Ratios of energies, and the choices of cracks with bonds."""

    def fill(figure, axes):
        left, right = axes
        for colour, kink in zip(COLOURS, sorted({row[1] for row in rates}), strict=False):
            own = np.array([(np.sqrt(a / size), ratio) for size, a, ratio in rates if a == kink])
            left.plot(*own.T, "o-", ms=3, c=colour, label=f"a = {kink} facets")
        left.plot(0.0, PUBLISHED, "k*", ms=9, label="He and Hutchinson")
        left.set(xlabel="(a/H)$^{1/2}$", ylabel="$G_d / G_p$", xlim=(-0.005, None))
        left.legend()
        right.plot(*np.array(choices).T, "o-", ms=3, c=COLOURS[0])
        right.axhline(PUBLISHED, c="k", lw=0.8, ls="--", label="energies alone")
        right.text(0.12, 0.06, "turns")
        right.text(0.28, 0.4, "goes on")
        right.set(
            xlabel="strength of the interface / ahead", ylabel="toughness of the interface / ahead",
            ylim=(0.0, None),
        )  # fmt: skip
        right.legend()

    new_figure(path, fill, (7.6, 3.3), ncols=2)


def main(options: list[str] | None = None) -> None:
    """Print both tables, or one of them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rates", action="store_true", help="the energies alone")
    parser.add_argument("--choices", action="store_true", help="the choices alone")
    parser.add_argument("--figure", type=Path, help="where to draw both")
    args = parser.parse_args(options)
    both = args.figure or args.rates == args.choices
    start, rates, choices = perf_counter(), [], []
    if both or args.rates:
        print("| H | a | (a/H)^(1/2) | G_d / G_p |\n|---|---|---|---|")
        for size, kink in [(300, 4), (300, 8), (1200, 4), (1200, 8), (4800, 4), (4800, 8),
                           (19200, 4), (19200, 8)]:  # fmt: skip
            rates.append((size, kink, ratio_of_rates(size, kink)))
            print(f"| {size} | {kink} | {np.sqrt(kink / size):.4f} | {rates[-1][2]:.4f} |")
        for kink in (4, 8):
            own = np.array([(a / size, ratio) for size, a, ratio in rates if a == kink])
            print(f"limit of a = {kink}: {limit(*own.T):.4f}; published {PUBLISHED}")
    if both or args.choices:
        print("| strengths | toughnesses below which it turns |\n|---|---|")
        for strength in (0.1, 0.15, 0.2, 0.25, 0.3, 0.35):
            choices.append((strength, critical(strength)))
            print(f"| {strength} | {choices[-1][1]:.3f} |", flush=True)
    if args.figure:
        draw(args.figure, rates, choices)
    print(f"{perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
