# SPDX-License-Identifier: LGPL-3.0-or-later
"""A strip peeled off a rigid base at several angles: bonds that turn, against the elastica.

    ./fenicsx python3 benchmarks/elastica_peel.py [--angles 60 90 120] [--quick] [--figure FILE]

A strip of height h and modulus E' = E / (1 - nu^2) lies on a base that is held, bonded but for a
length a0 at its end, which a dead load P (per unit depth) pulls at the angle theta_0 to the base.
The run is static, and `GrowthControl` finds the load. The strip bends until it points along the
load; facets at the crack's front turn by tens of degrees before they break.

An inextensible strip that bends is an elastica, E' I theta'' = -P sin(theta_0 - theta) with no
moment at its end. Its first integral between the front, where theta = 0, and the end, theta_e, is

    (E' I / 2) kappa^2 = P [cos(theta_e - theta_0) - cos(theta_0)],

and the left side is the energy that the front gets for a unit of its advance. With a toughness w,

    P = w / [cos(theta_e - theta_0) - cos theta_0],

whatever the strip's stiffness and the length of its free part. Long strips have theta_e = theta_0:
P = w / (1 - cos theta_0) (Rivlin 1944). What a strip stretches by adds P^2 / (2 E' h) to the energy
(Kendall 1975).

theta_e is read from the strip's end at each step, and what is compared is the energy release rate
of the formula, with Kendall's term, over w while the crack grows; the load at the end of the run is
compared with Rivlin's. The bonds' largest turn is that of the facets that still hold.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import numpy as np
from dolfinx.mesh import CellType, create_rectangle
from mpi4py import MPI

import xper_fx as xf
from xper_fx.bodies.meshes import tag_facets
from xper_fx.plotting.figures import COLOURS, new_figure
from xper_fx.support.compat import geometry_dofmap

YOUNG, POISSON = 1e9, 0.3
HEIGHT, LENGTH, CRACK = 0.25e-3, 30e-3, 6e-3
# The bond: its cohesive zone is some 2 mm long.
TOUGHNESS, STRENGTH, STIFFNESS = 100.0, 0.25e6, 2.5e11
BASE, END, FREE = 1, 2, 7


class Peel(NamedTuple):
    """A run, one value a step.

    Attributes:
        angle: theta_0 (rad).
        load: P (N/m).
        end: theta_e (rad).
        grown: what the bonds have spent over w, the growth of the crack (m).
        turned: largest angle (rad) of a frame whose bond is not broken.
        closure: of the energies at the end, relative to the work of the load.
        seconds: that the run took.
    """

    angle: float
    load: np.ndarray
    end: np.ndarray
    grown: np.ndarray
    turned: np.ndarray
    closure: float
    seconds: float

    @property
    def release_rate(self) -> np.ndarray:
        """G of the elastica with the stretch of the strip, over w."""
        modulus = YOUNG / (1.0 - POISSON**2)
        bending = self.load * (np.cos(self.end - self.angle) - np.cos(self.angle))
        return (bending + 0.5 * self.load**2 / (modulus * HEIGHT)) / TOUGHNESS

    @property
    def rivlin(self) -> float:
        """P of a long strip that does not stretch (N/m)."""
        return TOUGHNESS / (1.0 - np.cos(self.angle))


def scene_of(angle: float, facets: int) -> xf.Scene:
    """Strip and base.

    Args:
        angle: of the load (rad).
        facets: along the strip.
    """
    corners = [np.array([0.0, -HEIGHT]), np.array([LENGTH, HEIGHT])]
    mesh = create_rectangle(MPI.COMM_SELF, corners, (facets, 2), CellType.quadrilateral)
    tags = tag_facets(
        mesh,
        {
            BASE: lambda x: np.isclose(x[1], -HEIGHT),
            END: lambda x: np.isclose(x[0], LENGTH) & (x[1] > -1e-9),
            FREE: lambda x: np.isclose(x[1], 0.0) & (x[0] > LENGTH - CRACK - 1e-9),
        },
    )
    above = mesh.geometry.x[geometry_dofmap(mesh)].mean(axis=1)[:, 1] > 0.0
    stress = 1.0 / HEIGHT  # of P = 1 N/m
    pull = (lambda t: t * stress * np.cos(angle), lambda t: t * stress * np.sin(angle))
    return xf.Scene(
        xf.explode(mesh, above.astype(int), facet_tags=tags),
        {1: xf.materials.NeoHookean(YOUNG, POISSON, 1000.0)},
        default_interaction=xf.laws.CohesiveZone(STIFFNESS, TOUGHNESS, STRENGTH),
        facet_interactions={FREE: None},
        loads=[
            xf.SurfaceTraction(END, pull),
            *(xf.PrescribedDisplacement(BASE, c, 0.0) for c in (0, 1)),
        ],
        order=2,
        points="gauss",
    )


def peel(angle: float, facets: int, growth: float) -> Peel:
    """Peel until the crack has grown by a length.

    Args:
        angle: of the load (rad).
        facets: along the strip.
        growth: of the crack (m).
    """
    start = perf_counter()
    scene = scene_of(angle, facets)
    simulation = xf.Simulation(
        scene, 1e-4, inertia=False, path=xf.GrowthControl(), newton_tolerance=1e-6, num_threads=1
    )
    x = simulation.forms.V.tabulate_dof_coordinates()[:, :2]
    upper, lower = (
        np.flatnonzero(np.isclose(x[:, 0], LENGTH) & np.isclose(x[:, 1], y) & _strip(simulation))[0]
        for y in (HEIGHT, 0.0)
    )
    rows = []
    for record in simulation.steps(1e3 * TOUGHNESS):
        place = x + simulation.state.displacement.reshape(-1, 2)
        across = place[upper] - place[lower]
        points = simulation.interactions.points
        held = simulation.interactions.gather("damage") > 0.0
        turned = np.arctan2(points.frame[held, 0, 0], points.frame[held, 0, 1])
        grown = record.energies["dissipated_cohesion"] / TOUGHNESS
        rows.append((record.time, -np.arctan2(across[0], across[1]), grown, np.abs(turned).max()))
        if grown > growth:
            break
    load, end, grown, turned = np.array(rows).T
    energies = record.energies
    closure = abs(energies["closure"]) / energies["external_work"]
    return Peel(angle, load, end, grown, turned, closure, perf_counter() - start)


def _strip(simulation: xf.Simulation) -> np.ndarray:
    """Which nodes are the strip's."""
    V, bodies = simulation.forms.V, simulation.scene.bodies
    out = np.zeros(V.dofmap.index_map.size_local, bool)
    out[V.dofmap.list[bodies.body_of_cell == 1]] = True
    return out


def report(found: Peel) -> str:
    """One line."""
    late = found.grown > 0.5 * found.grown[-1]
    rate = found.release_rate[late]
    return (
        f"{np.degrees(found.angle):4.0f} degrees: G / w = {rate.mean():.4f} "
        f"({rate.min():.4f} to {rate.max():.4f}), load {found.load[late].mean():.2f} N/m, "
        f"Rivlin {found.rivlin:.2f}, end at {np.degrees(found.end[-1]):.1f}, bonds turned by "
        f"{np.degrees(found.turned.max()):.1f} degrees, energy off by {found.closure:.1e}; "
        f"{len(found.load)} steps, {found.seconds:.0f} s"
    )


def draw(runs: list[Peel], path: Path) -> None:
    """Load against growth, and the release rate."""

    def drawn(figure, axes) -> None:
        left, right = axes
        for colour, run in zip(COLOURS, runs, strict=False):
            name = f"{np.degrees(run.angle):.0f} degrees"
            left.plot(1e3 * run.grown, run.load, color=colour, label=name)
            left.axhline(run.rivlin, color=colour, linestyle=":")
            right.plot(1e3 * run.grown, run.release_rate, color=colour, label=name)
        right.axhline(1.0, color="black", linestyle=":")
        left.set(xlabel="growth of the crack (mm)", ylabel="load (N/m); dotted: long strip")
        right.set(xlabel="growth of the crack (mm)", ylabel="G of the elastica / w")
        left.set_ylim(0.0, None)
        right.set_ylim(0.8, 1.2)
        left.legend()

    new_figure(path, drawn, (9.0, 3.6), ncols=2)


def main() -> None:
    """Run, report, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--angles", type=float, nargs="+", default=[60.0, 90.0, 120.0])
    parser.add_argument("--quick", action="store_true", help="coarser, and a shorter crack")
    parser.add_argument("--figure", type=Path)
    arguments = parser.parse_args()
    facets, growth = (90, 8e-3) if arguments.quick else (180, 14e-3)
    runs = []
    for angle in arguments.angles:
        runs.append(peel(np.radians(angle), facets, growth))
        print(report(runs[-1]), flush=True)
    if arguments.figure:
        draw(runs, arguments.figure)


if __name__ == "__main__":
    main()
