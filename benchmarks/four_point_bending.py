# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Delamination of a notched bilayer in four-point bending (Charalambides, Lund, Evans and
McMeeking 1989), against the steady energy release rate of beam theory.

    ./fenicsx python3 benchmarks/four_point_bending.py [--facets MM ...]

The lower layer, of thickness h1 and modulus E1' = E1 / (1 - nu^2), is cut through in the middle,
and cracks run along the interface to both sides. Between the inner rollers the moment is M = P l, P
being the force of a roller and l the distance of an inner roller from the outer one. Behind a crack
the upper layer bears M alone, ahead of it the whole section, so that the crack takes, whatever its
length,

    G = M^2 / 2 (1 / (E2' I2) - 1 / D),   I2 = h2^3 / 12,

D being the bending stiffness of both layers about their neutral axis. Cracks that take w run at the
constant load P = (2 w / (1 / (E2' I2) - 1 / D))^(1/2) / l until they come to the inner rollers.

The rollers hold single nodes (`where=` of a motion) and push by tractions. The load is the unknown
of the path.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from time import process_time
from typing import NamedTuple

import numpy as np
from dolfinx.mesh import CellType, create_rectangle
from mpi4py import MPI

import xper_fx as xf
from xper_fx.output.field_series import point_coordinates

LOWER, UPPER = 1, 2
NOTCH, CRACK, BELOW, PUSHED = 1, 2, 3, 4
# Distances of the rollers from the middle, and half the length (m).
INNER, OUTER, HALF = 15e-3, 25e-3, 30e-3
POISSON = 0.3


@dataclass(frozen=True)
class Bilayer:
    """A specimen.

    Args:
        thicknesses: h1 and h2 (m), whole numbers of 0.25 mm.
        moduli: E1 and E2 (Pa), of the cut layer and of the whole one.
        fracture_energy, strength: of the interface, w (J/m^2) and Rmax (Pa).
        facet: length of a facet of the interface (m), a part of 1 mm.
    """

    thicknesses: tuple[float, float] = (1e-3, 1e-3)
    moduli: tuple[float, float] = (200e9, 200e9)
    fracture_energy: float = 50.0
    strength: float = 40e6
    facet: float = 0.25e-3

    @property
    def steady_load(self) -> float:
        """P of one roller (N/m) at which cracks run."""
        (h1, h2), (e1, e2) = self.thicknesses, np.divide(self.moduli, 1.0 - POISSON**2)
        axis = 0.5 * (e2 * h2**2 - e1 * h1**2) / (e1 * h1 + e2 * h2)
        both = e1 * ((axis + h1) ** 3 - axis**3) / 3.0 + e2 * ((h2 - axis) ** 3 + axis**3) / 3.0
        compliance = 12.0 / (e2 * h2**3) - 1.0 / both
        return np.sqrt(2.0 * self.fracture_energy / compliance) / (OUTER - INNER)


def scene_of(specimen: Bilayer) -> xf.Scene:
    """The specimen. At the time 1 its load is the steady one."""
    (h1, h2), facet = specimen.thicknesses, specimen.facet
    cells = round(2.0 * HALF / facet), round((h1 + h2) / 0.25e-3)
    corners = [(-HALF, -h1), (HALF, h2)]
    mesh = create_rectangle(MPI.COMM_SELF, corners, cells, CellType.quadrilateral)
    small = 1e-6 * facet

    def near(x, distance):
        return np.abs(np.abs(x[0]) - distance) < facet + small

    cell_tags = xf.tag_cells(mesh, {LOWER: lambda x: x[1] < small}, UPPER)
    facet_tags = xf.tag_facets(
        mesh,
        {
            NOTCH: lambda x: (np.abs(x[0]) < small) & (x[1] < small),
            CRACK: lambda x: (np.abs(x[1]) < small) & (np.abs(x[0]) < 1e-3 + small),
            BELOW: lambda x: (x[1] < small - h1) & near(x, OUTER),
            PUSHED: lambda x: (x[1] > h2 - small) & near(x, INNER),
        },
    )
    x, y, _ = mesh.geometry.x[xf.geometry_dofmap(mesh)].mean(axis=1).T
    bodies = xf.explode(mesh, np.where(y > 0.0, 0, 1 + (x > 0.0)), cell_tags, facet_tags)
    left = lambda x: np.isclose(x[0], -OUTER)  # noqa: E731
    ends = lambda x: np.isclose(np.abs(x[0]), OUTER)  # noqa: E731
    push = specimen.steady_load / (2.0 * facet)
    stiffness = 10.0 * min(specimen.moduli) / 1e-3
    bond = xf.laws.CohesiveZone(stiffness, specimen.fracture_energy, specimen.strength)
    return xf.Scene(
        bodies,
        {
            tag: xf.materials.LinearElastic(young, POISSON, 3000.0)
            for tag, young in zip((LOWER, UPPER), specimen.moduli, strict=True)
        },
        default_interaction=bond,
        facet_interactions={NOTCH: None, CRACK: xf.laws.SignoriniCoulomb(contact="position")},
        loads=[
            xf.PrescribedDisplacement(BELOW, 0, 0.0, where=left),
            xf.PrescribedDisplacement(BELOW, 1, 0.0, where=ends),
            xf.SurfaceTraction(PUSHED, (0.0, lambda t: -push * t)),
        ],
        order=2,
    )


class Findings(NamedTuple):
    """What beam theory is compared with.

    Attributes:
        plateau: mean load over the steady one, while the cracks grew from 4 mm to the end.
        spread: largest less least load there, over the steady one.
        spent: what bonds dissipate there over w times the way of the tips.
        closure: error of the energy ledger over the external work.
        steps: made.
    """

    plateau: float
    spread: float
    spent: float
    closure: float
    steps: int


def tips(simulation: xf.Simulation, bond: xf.laws.CohesiveZone) -> float:
    """Broken length of the interface (m), interpolated between points."""
    points = simulation.interactions
    opening = points.gather("opening_max")
    x = point_coordinates(simulation)[:, 0]
    order = np.argsort(x)
    x, beyond = x[order], opening[order] - bond.critical_opening
    total = 0.0
    for a, b, left, right in zip(beyond[:-1], beyond[1:], x[:-1], x[1:], strict=True):
        share = np.clip(max(a, b) / abs(b - a), 0.0, 1.0) if max(a, b) > 0.0 and a != b else 0.0
        total += share * (right - left)
    return total


def delaminate(specimen: Bilayer, grown: float = 16e-3) -> Findings:
    """Bend a specimen until its cracks have grown so far in all (m)."""
    scene = scene_of(specimen)
    path = xf.GrowthControl()
    simulation = xf.Simulation(scene, 1.0, inertia=False, path=path, num_threads=1)
    rows = []
    for step in simulation.steps(10.0):
        spent = step.energies["dissipated_cohesion"] / specimen.fracture_energy
        rows.append((step.time, spent, tips(simulation, scene.default_interaction)))
        if spent > grown:
            break
    load, spent, broken = np.array(rows).T
    late = spent > 4e-3
    closure = step.energies["closure"] / step.energies["external_work"]
    return Findings(
        load[late].mean(),
        np.ptp(load[late]),
        np.ptp(spent[late]) / np.ptp(broken[late]),
        closure,
        simulation.step_number,
    )


SPECIMENS = {
    "equal layers": Bilayer(),
    "cut layer half as thick": Bilayer((0.5e-3, 1e-3)),
    "cut layer three times as stiff": Bilayer(moduli=(210e9, 70e9)),
    "cut layer a third as stiff": Bilayer(moduli=(70e9, 210e9)),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--facets", type=float, nargs="+", default=[0.25, 0.125], help="(mm)")
    options = parser.parse_args()
    for name, specimen in SPECIMENS.items():
        for facet in options.facets:
            start = process_time()
            finer = Bilayer(specimen.thicknesses, specimen.moduli, facet=1e-3 * facet)
            found = delaminate(finer)
            print(
                f"{name}, facets of {facet:g} mm: load {found.plateau:.4f} of the steady one "
                f"({finer.steady_load:.0f} N/m) within {found.spread:.1e}, spent "
                f"{found.spent:.4f} w a length, closure {found.closure:.1e}, "
                f"{found.steps} steps, {process_time() - start:.0f} s"
            )


if __name__ == "__main__":
    main()
