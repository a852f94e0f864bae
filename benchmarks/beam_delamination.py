# SPDX-License-Identifier: LGPL-3.0-or-later
"""Delamination of beams against beam theory: double cantilever (mode I), end-notched flexure (II).

    ./fenicsx python3 benchmarks/beam_delamination.py [--beam dcb enf] [--quick]

Two elastic arms of height h, each one body of quadrilaterals of order 2, plane strain; the plane
between them is cracked over a length a and cohesive beyond. E' = E / (1 - nu^2), per unit depth.

- DCB: the ends at x = 0 are pulled apart by delta. With the root rotation of Williams (1989)
  folded into an effective length A = a + chi h (Hashemi, Kinloch and Williams 1990),

      delta = 8 P A^3 / (E' h^3),   G = 12 P^2 A^2 / (E' h^3),
      chi^2 = (E' / (11 mu)) (3 - 2 (g / (1 + g))^2),   g = 1.18 E' / mu.

- ENF: three-point bending, half span L, lips that touch without friction. With A = a + 0.42 chi h
  (Wang and Williams 1992) and the shear of the whole beam,

      delta = P [ (3 A^3 + 2 L^3) / (8 E' h^3) + 3 L / (10 mu h) ],   G = 9 P^2 A^2 / (16 E' h^3).

Elimination of A from the measured P and delta gives G by compliance, which has to be w while the
crack grows; G(a0) = w gives the load at which it starts. The foremost point whose bond has opened
to dc, by linear interpolation between points, is the tip; what the bonds dissipate over what it
advances has to be w too, whatever beam theory neglects. A cohesive zone of finite length rounds the
peak: it is resolved, and short beside a.

The arms are moved slowly rather than statically: the time of loading is many periods of the arms,
and theta = 0.55 damps them. At theta = 1 a bond that opens by dU in a step is beta C dU . dU / 2
tougher than its curve (`nscd/laws/cohesive_zone.py`), as the table shows. A static run of two long
bodies asks the solver of the interactions for the compliance of whole arms at each point, beside
which that of a bond is nothing, and does not converge.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from time import process_time
from typing import NamedTuple

import numpy as np
from dolfinx.mesh import CellType, create_rectangle
from mpi4py import MPI

from xper_fx.bodies.explode import Bodies, explode
from xper_fx.bodies.meshes import tag_facets
from xper_fx.forms.loads import PrescribedDisplacement
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import CohesiveZone, SignoriniCoulomb
from xper_fx.output.recorder import point_coordinates
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.compat import geometry_dofmap

MATERIAL = LinearElastic(young=70e9, poisson=0.3, density=2700.0)
MODULUS = MATERIAL.young / (1.0 - MATERIAL.poisson**2)
SHEAR = 0.5 * MATERIAL.young / (1.0 + MATERIAL.poisson)
LOWER_END, UPPER_END, FAR_END, LOAD, CRACK = 1, 2, 3, 4, 5
# Share of the time in which the speed of the load grows to its final value.
RAMP = 0.2


@dataclass(frozen=True)
class Beam:
    """A specimen, its bond and its discretisation.

    Args:
        kind: "dcb" or "enf".
        crack: a0 (m).
        height: h of an arm (m).
        half_span: L of the end-notched flexure (m).
        growth: length ahead of the crack that is meshed finely (m).
        fracture_energy, strength, stiffness: w (J/m^2), Rmax (Pa) and C_N = C_T (Pa/m).
        facet: length of a facet there (m).
        displacement: of the load at the end (m); for the DCB of both arms together.
        time: of loading (s).
        steps: number of them.
        theta: weight of the end of the step.
        tolerance: of the impulses.
    """

    kind: str
    crack: float
    displacement: float
    height: float = 1.5e-3
    half_span: float = 30e-3
    growth: float = 6e-3
    fracture_energy: float = 300.0
    strength: float = 60e6
    stiffness: float = 1e16
    facet: float = 1.5e-3 / 8
    time: float = 4e-3
    steps: int = 1000
    theta: float = 0.55
    tolerance: float = 1e-4

    @property
    def bond(self) -> CohesiveZone:
        return CohesiveZone(self.stiffness, self.fracture_energy, self.strength)

    @property
    def root(self) -> float:
        """What root rotation adds to the crack (m)."""
        g = 1.18 * MODULUS / SHEAR
        chi = np.sqrt(MODULUS / (11.0 * SHEAR) * (3.0 - 2.0 * (g / (1.0 + g)) ** 2))
        return (1.0 if self.kind == "dcb" else 0.42) * chi * self.height

    def compliance(self, crack):
        """delta / P at a crack length (m per N/m)."""
        effective, bending = crack + self.root, MODULUS * self.height**3
        if self.kind == "dcb":
            return 8.0 * effective**3 / bending
        shear = 0.3 * self.half_span / (SHEAR * self.height)
        return (3.0 * effective**3 + 2.0 * self.half_span**3) / (8.0 * bending) + shear

    def crack_of(self, compliance):
        """The crack length (m) that has a compliance."""
        bending = MODULUS * self.height**3
        if self.kind == "dcb":
            return np.cbrt(compliance * bending / 8.0) - self.root
        compliance = compliance - 0.3 * self.half_span / (SHEAR * self.height)
        return np.cbrt((8.0 * bending * compliance - 2.0 * self.half_span**3) / 3.0) - self.root

    def release_rate(self, load, crack):
        """G (J/m^2) at a load (N/m) and a crack length (m)."""
        factor = 12.0 if self.kind == "dcb" else 9.0 / 16.0
        return factor * (load * (crack + self.root)) ** 2 / (MODULUS * self.height**3)

    @property
    def starting_load(self) -> float:
        """The load (N/m) at which G(a0) = w."""
        return np.sqrt(self.fracture_energy / self.release_rate(1.0, self.crack))


def stations(beam: Beam) -> np.ndarray:
    """Places of mesh lines along the beam (m): fine round the crack's path."""
    fine = (beam.crack - 2.0 * beam.height, beam.crack + beam.growth)
    if beam.kind == "dcb":
        marks = [0.0, *fine, fine[1] + 8.0 * beam.height]
    else:
        marks = [0.0, *fine, beam.half_span, 2.0 * beam.half_span]
    coarse = 0.5 * beam.height
    pieces = []
    for start, end in zip(marks[:-1], marks[1:], strict=True):
        size = beam.facet if start == fine[0] else max(coarse, beam.facet)
        count = max(1, round((end - start) / size))
        pieces.append(np.linspace(start, end, count, endpoint=False))
    return np.append(np.concatenate(pieces), marks[-1])


def arms(beam: Beam) -> Bodies:
    """The two arms, y = 0 between them."""
    x = stations(beam)
    across = 4
    mesh = create_rectangle(
        MPI.COMM_SELF,
        [np.zeros(2), np.array([len(x) - 1.0, 2.0 * across])],
        [len(x) - 1, 2 * across],
        CellType.quadrilateral,
    )
    points = mesh.geometry.x
    points[:, 0] = np.interp(points[:, 0], np.arange(len(x)), x)
    points[:, 1] = (points[:, 1] / across - 1.0) * beam.height
    small, end = 1e-6 * beam.height, x[-1]
    where = {
        LOWER_END: lambda x: (x[0] < small) & (x[1] < small),
        UPPER_END: lambda x: (x[0] < small) & (x[1] > -small),
        FAR_END: lambda x: (x[0] > end - small) & (x[1] < small),
        CRACK: lambda x: (np.abs(x[1]) < small) & (x[0] < beam.crack + small),
    }
    if beam.kind == "dcb":
        where[FAR_END] = lambda x: x[0] > end - small
    else:
        where[LOAD] = lambda x: (np.abs(x[0] - beam.half_span) < small) & (x[1] > -small)
    upper = points[geometry_dofmap(mesh)].mean(axis=1)[:, 1] > 0.0
    return explode(mesh, upper.astype(int), facet_tags=tag_facets(mesh, where))


def scene_of(beam: Beam) -> Scene:
    """The specimen, its load a displacement across the arms' sections."""

    def moved(time: float) -> float:
        share = time / beam.time
        early = share**2 / (2.0 * RAMP) if share < RAMP else share - 0.5 * RAMP
        return beam.displacement * early / (1.0 - 0.5 * RAMP)

    if beam.kind == "dcb":
        motions = [(FAR_END, 0, 0.0), (FAR_END, 1, 0.0)]
        motions += [
            (LOWER_END, 1, lambda t: -0.5 * moved(t)),
            (UPPER_END, 1, lambda t: 0.5 * moved(t)),
        ]
        lips = None
    else:
        motions = [(LOWER_END, 1, 0.0), (FAR_END, 1, 0.0), (LOAD, 1, lambda t: -moved(t))]
        lips = SignoriniCoulomb(contact="position")
    return Scene(
        arms(beam),
        {1: MATERIAL},
        default_interaction=beam.bond,
        facet_interactions={CRACK: lips},
        loads=[PrescribedDisplacement(*motion) for motion in motions],
        order=2,
    )


class Curve(NamedTuple):
    """A run: at each step displacement (m), load (N/m), tip (m), dissipated energy (J/m), facets
    in the cohesive zone; and at the end the ledger's closure over the external work."""

    displacement: np.ndarray
    load: np.ndarray
    tip: np.ndarray
    dissipated: np.ndarray
    zone: np.ndarray
    closure: float


def delaminate(beam: Beam) -> Curve:
    """Load a specimen until its crack has grown by all but the last quarter of `beam.growth`."""
    simulation = Simulation(
        scene_of(beam),
        beam.time / beam.steps,
        theta=beam.theta,
        tolerance=beam.tolerance,
        num_threads=1,
    )
    x = point_coordinates(simulation)[:, 0]
    order = np.argsort(x)
    order = order[x[order] > beam.crack - 1e-9]
    x, bond = x[order], beam.bond
    tag = UPPER_END if beam.kind == "dcb" else LOAD
    rows = []
    for step in simulation.steps(beam.time):
        load, moved = simulation.reaction(tag)[1], simulation.mean_displacement(tag)[1]
        opening = simulation.interactions.gather("opening_max")[order]
        broken = np.flatnonzero(opening >= bond.critical_opening)
        tip = beam.crack
        if len(broken):
            i = broken[-1]
            share = (opening[i] - bond.critical_opening) / (opening[i] - opening[i + 1])
            tip = x[i] + share * (x[i + 1] - x[i])
        softening = (opening > bond.elastic_opening) & (opening < bond.critical_opening)
        zone = np.ptp(x[softening]) / beam.facet if np.any(softening) else 0.0
        factor = 2.0 if beam.kind == "dcb" else 1.0
        rows.append(
            (factor * abs(moved), abs(load), tip, step.energies["dissipated_cohesion"], zone)
        )
        if tip > beam.crack + 0.75 * beam.growth:
            break
    closure = step.energies["closure"] / step.energies["external_work"]
    return Curve(*np.array(rows).T, closure)


class Findings(NamedTuple):
    """What beam theory is compared with, all but the last two as ratios that should be 1.

    Attributes:
        compliance: of the first tenth of the load, over that of beam theory.
        peak: largest load over that at which G(a0) = w.
        release_rate: G by compliance over w, mean while the crack grew by its second half.
        spent: dissipated energy over w times the tip's way, in the same stretch.
        zone: facets in the cohesive zone there.
        closure: error of the energy ledger over the external work.
    """

    compliance: float
    peak: float
    release_rate: float
    spent: float
    zone: float
    closure: float


def compare(beam: Beam, curve: Curve) -> Findings:
    """Hold a run against beam theory."""
    early = (curve.load > 0.05 * curve.load.max()) & (curve.load < 0.25 * curve.load.max())
    early &= curve.displacement < curve.displacement[np.argmax(curve.load)]
    slope = np.polyfit(curve.load[early], curve.displacement[early], 1)[0]
    grown = curve.tip - beam.crack
    late = np.flatnonzero(grown >= 0.5 * grown[-1])
    crack = beam.crack_of(curve.displacement[late] / curve.load[late])
    rate = beam.release_rate(curve.load[late], crack)
    spent = np.ptp(curve.dissipated[late]) / np.ptp(curve.tip[late])
    return Findings(
        slope / beam.compliance(beam.crack),
        curve.load.max() / beam.starting_load,
        rate.mean() / beam.fracture_energy,
        spent / beam.fracture_energy,
        curve.zone[late].mean(),
        curve.closure,
    )


DCB = Beam("dcb", crack=20e-3, displacement=2.2e-3)
ENF = Beam("enf", crack=22e-3, displacement=3.0e-3, facet=0.25e-3)


def variants(beam: Beam) -> dict[str, Beam]:
    """The specimen as it is, finer, coarser, with longer steps, with other bonds."""
    return {
        "default: 1000 steps, theta 0.55": beam,
        "facets half as long": replace(beam, facet=0.5 * beam.facet),
        "twice as long": replace(beam, facet=2.0 * beam.facet),
        "four times as long": replace(beam, facet=4.0 * beam.facet),
        "300 steps": replace(beam, steps=300),
        "theta 1": replace(beam, theta=1.0),
        "half the strength": replace(beam, strength=0.5 * beam.strength),
        "C of 1e14 Pa/m": replace(beam, stiffness=1e14),
    }


def main(options: list[str] | None = None) -> None:
    """Run the variants and print a table a specimen."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--beam", nargs="+", choices=("dcb", "enf"), default=["dcb", "enf"])
    parser.add_argument("--quick", action="store_true", help="the first variant alone")
    args = parser.parse_args(options)
    for beam in (b for b in (DCB, ENF) if b.kind in args.beam):
        print(f"\n{beam.kind.upper()}, a0 = {1e3 * beam.crack:g} mm, h = {1e3 * beam.height:g} mm")
        print("| | facets in the zone | C / theory | peak / theory | G / w | spent / (w da) "
              "| closure | CPU s |")  # fmt: skip
        print("|---|---|---|---|---|---|---|---|")
        for name, variant in list(variants(beam).items())[: 1 if args.quick else None]:
            start = process_time()
            found = compare(variant, delaminate(variant))
            print(
                f"| {name} | {found.zone:.1f} | {found.compliance:.4f} | {found.peak:.4f} | "
                f"{found.release_rate:.4f} | {found.spent:.4f} | {found.closure:.0e} | "
                f"{process_time() - start:.0f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
