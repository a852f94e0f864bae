# SPDX-License-Identifier: LGPL-3.0-or-later
"""Delamination of beams against beam theory: mode I (DCB), mode II (ENF), mixed mode (MMB).

    ./fenicsx python3 benchmarks/beam_delamination.py [--beam dcb enf mmb] [--quick] [--figure FILE]

Two elastic arms of height h, each one body of quadrilaterals of order 2, plane strain; the plane
between them is cracked over a length a and cohesive beyond. E' = E / (1 - nu^2), per unit depth.
The runs are static, and `GrowthControl` finds the load. With the root rotation of Williams (1989)
folded into effective lengths A = a + chi h (Hashemi, Kinloch and Williams 1990) and
B = a + 0.42 chi h (Wang and Williams 1992), chi^2 = (E' / (11 mu)) (3 - 2 (g / (1 + g))^2),
g = 1.18 E' / mu:

- DCB: the ends at x = 0 are pulled apart by delta,

      delta = P C_I,   C_I = 8 A^3 / (E' h^3),   G_I = 12 P^2 A^2 / (E' h^3).

- ENF: three-point bending, half span L, lips that touch without friction. The support at x = 0
  holds both arms, as the one on the other would,

      delta = P C_II,   C_II = (3 B^3 + 2 L^3) / (8 E' h^3) + 3 L / (10 mu h),
      G_II = 9 P^2 B^2 / (16 E' h^3).

- MMB (Reeder and Crews 1990): a lever of length c that bears P pulls the upper arm's end by P c / L
  and pushes at mid span by P (c + L) / L. The arms' ends bear P c / L and P (L - c) / (2 L), half
  their difference opens and their sum bends:

      P_I = P (3 c - L) / (4 L),   P_II = P (c + L) / L,
      G = G_I(P_I) + G_II(P_II),   delta / P = (P_I / P)^2 C_I + (P_II / P)^2 C_II,

  delta = c / L times the lift of the end plus (c + L) / L times the sag at mid span. The lips open,
  as c > L / 3, and have no contact.

The bonds have one toughness w for all modes. What is compared:

- G by compliance, the crack length a being eliminated with delta / P, has to be w from the step on
  in which the crack starts to grow.
- J = - sum of F v' over all forces F and the slopes v' of the sections that bear them (Paris and
  Paris 1988) has to be w then, whatever the cohesive zone and the root are.
- What the bonds dissipate over what the tip advances has to be w. The tip is the foremost point
  whose bond has opened to dc, by linear interpolation between points.
- The largest load is compared with the one at which G(a0) = w. It is lower, because beam theory
  knows no cohesive zone: the zone bends as a piece of crack would, before a bond breaks. The
  difference goes with the zone's length over a, and so with the strength.

A path of steps crosses facets of finite length, whose breaking makes the load wave. Where the zone
has less than about four facets, G at the steps taken is off by percents, and what it is off is
booked as numerical energy.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time
from typing import NamedTuple

import numpy as np
from dolfinx.mesh import CellType, create_rectangle
from mpi4py import MPI

from xper_fx.bodies.explode import Bodies, explode
from xper_fx.bodies.meshes import tag_facets
from xper_fx.forms.loads import PrescribedDisplacement, SurfaceTraction
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import CohesiveZone, SignoriniCoulomb
from xper_fx.output.field_series import point_coordinates
from xper_fx.plotting.figures import COLOURS, new_figure
from xper_fx.scene.scene import Scene
from xper_fx.simulation.path import GrowthControl
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.compat import geometry_dofmap

MATERIAL = LinearElastic(young=126e9, poisson=0.3, density=1600.0)
MODULUS = MATERIAL.young / (1.0 - MATERIAL.poisson**2)
SHEAR = 0.5 * MATERIAL.young / (1.0 + MATERIAL.poisson)
LOWER_END, UPPER_END, FAR_END, MIDDLE, PUSHED, CRACK, HELD = range(1, 8)
KINDS = ("dcb", "enf", "mmb")


@dataclass(frozen=True)
class Beam:
    """A specimen, its bond and its discretisation.

    Args:
        kind: one of KINDS.
        crack: a0 (m).
        height: h of an arm (m).
        half_span: L, half the length of the specimen (m).
        lever: c of the mixed-mode bending (m).
        growth: of the crack at the end of the run (m).
        fracture_energy, strength, stiffness: w (J/m^2), Rmax (Pa) and C_N = C_T (Pa/m).
        facet: length of a facet along the crack's path (m).
        across: elements across an arm.
        step: growth of the bonds in a step (`GrowthControl`).
    """

    kind: str
    crack: float = 30e-3
    height: float = 1.5e-3
    half_span: float = 50e-3
    lever: float = 43.7e-3
    growth: float = 10e-3
    fracture_energy: float = 281.0
    strength: float = 57e6
    stiffness: float = 5e15
    facet: float = 0.25e-3
    across: int = 4
    step: float = 0.3

    @property
    def bond(self) -> CohesiveZone:
        return CohesiveZone(self.stiffness, self.fracture_energy, self.strength)

    @property
    def zone(self) -> float:
        """Estimate of the length of the cohesive zone (m), that of slender arms."""
        length = MODULUS * self.fracture_energy / self.strength**2
        if self.kind == "dcb":
            return (length * self.height**3) ** 0.25
        return (length * self.height) ** 0.5

    @property
    def opening_share(self) -> float:
        """P_I / P."""
        if self.kind == "mmb":
            return (3.0 * self.lever - self.half_span) / (4.0 * self.half_span)
        return 1.0 if self.kind == "dcb" else 0.0

    @property
    def bending_share(self) -> float:
        """P_II / P."""
        if self.kind == "mmb":
            return (self.lever + self.half_span) / self.half_span
        return 0.0 if self.kind == "dcb" else 1.0

    def effective(self, crack):
        """A and B at a crack length (m)."""
        g = 1.18 * MODULUS / SHEAR
        chi = np.sqrt(MODULUS / (11.0 * SHEAR) * (3.0 - 2.0 * (g / (1.0 + g)) ** 2))
        return crack + chi * self.height, crack + 0.42 * chi * self.height

    def compliance(self, crack):
        """delta / P at a crack length (m per N/m)."""
        opening, bending = self.effective(crack)
        rigidity, span = MODULUS * self.height**3, self.half_span
        first = 8.0 * opening**3 / rigidity
        second = (3.0 * bending**3 + 2.0 * span**3) / (8.0 * rigidity)
        second = second + 0.3 * span / (SHEAR * self.height)
        return self.opening_share**2 * first + self.bending_share**2 * second

    def modes(self, load, crack):
        """G_I and G_II (J/m^2) at a load (N/m) and a crack length (m)."""
        opening, bending = self.effective(crack)
        rigidity = MODULUS * self.height**3
        first = 12.0 * (self.opening_share * load * opening) ** 2 / rigidity
        return first, 9.0 / 16.0 * (self.bending_share * load * bending) ** 2 / rigidity

    def release_rate(self, load, crack):
        """G (J/m^2) at a load (N/m) and a crack length (m)."""
        return sum(self.modes(load, crack))

    def crack_of(self, compliance):
        """The crack length (m) that has a compliance, by Newton's method."""
        crack = np.full(np.shape(compliance), self.crack)
        for _ in range(50):
            slope = 2.0 * self.release_rate(1.0, crack)  # G = P^2 / 2 dC/da
            crack = crack - (self.compliance(crack) - compliance) / slope
        return crack

    @property
    def starting_load(self) -> float:
        """The load (N/m) at which G(a0) = w."""
        return np.sqrt(self.fracture_energy / self.release_rate(1.0, self.crack))


def stations(beam: Beam) -> np.ndarray:
    """Places of mesh lines along the beam (m): fine round the crack's path."""
    coarse = max(0.5 * beam.height, beam.facet)
    end, middle = 2.0 * beam.half_span, beam.half_span
    last = end if beam.kind == "dcb" else middle - coarse
    fine = (
        beam.crack - 2.0 * beam.height,
        min(beam.crack + beam.growth + 2.0 * beam.zone, last),
    )
    marks = [0.0, fine[0], beam.crack, fine[1], end]
    if beam.kind != "dcb":
        marks[-1:] = [middle - coarse, middle, middle + coarse, end]
    pieces = []
    for start, stop in zip(marks[:-1], marks[1:], strict=True):
        if stop - start < 1e-9:
            continue
        size = beam.facet if start in (fine[0], beam.crack) else coarse
        count = max(1, round((stop - start) / size))
        pieces.append(np.linspace(start, stop, count, endpoint=False))
    return np.append(np.concatenate(pieces), end)


def arms(beam: Beam) -> Bodies:
    """The two arms, y = 0 between them."""
    stops = stations(beam)
    mesh = create_rectangle(
        MPI.COMM_SELF,
        [np.zeros(2), np.array([len(stops) - 1.0, 2.0 * beam.across])],
        [len(stops) - 1, 2 * beam.across],
        CellType.quadrilateral,
    )
    points = mesh.geometry.x
    points[:, 0] = np.interp(points[:, 0], np.arange(len(stops)), stops)
    points[:, 1] = (points[:, 1] / beam.across - 1.0) * beam.height
    small, end, top = 1e-6 * beam.height, stops[-1], beam.height
    where = {
        LOWER_END: lambda x: (x[0] < small) & (x[1] < small),
        UPPER_END: lambda x: (x[0] < small) & (x[1] > -small),
        FAR_END: lambda x: x[0] > end - small,
        CRACK: lambda x: (np.abs(x[1]) < small) & (x[0] < beam.crack + small),
    }
    if beam.kind != "dcb":
        pushed = max(0.5 * beam.height, beam.facet) + small
        where |= {
            FAR_END: lambda x: (x[0] > end - small) & (x[1] < small),
            MIDDLE: lambda x: (np.abs(x[0] - beam.half_span) < small) & (x[1] > -small),
            PUSHED: lambda x: (np.abs(x[0] - beam.half_span) < pushed) & (x[1] > top - small),
            HELD: lambda x: (x[0] > stops[-2] - small) & (x[1] < small - top),
        }
    upper = points[geometry_dofmap(mesh)].mean(axis=1)[:, 1] > 0.0
    return explode(mesh, upper.astype(int), facet_tags=tag_facets(mesh, where))


def scene_of(beam: Beam) -> Scene:
    """The specimen. At the time 1 its load is the one at which beam theory lets the crack grow.

    The ends of the bent beams are held in y alone, over whole sections, which are free to turn. One
    facet at the far end, where nothing is bent, is held in x.
    """
    load, span = beam.starting_load, beam.half_span
    lips = SignoriniCoulomb(contact="position") if beam.kind == "enf" else None
    if beam.kind == "dcb":
        moved = load * beam.compliance(beam.crack)
        loads = [
            PrescribedDisplacement(FAR_END, 0, 0.0),
            PrescribedDisplacement(FAR_END, 1, 0.0),
            PrescribedDisplacement(LOWER_END, 1, lambda t: -0.5 * moved * t),
            PrescribedDisplacement(UPPER_END, 1, lambda t: 0.5 * moved * t),
        ]
    else:
        loads = [
            PrescribedDisplacement(LOWER_END, 1, 0.0),
            PrescribedDisplacement(FAR_END, 1, 0.0),
            PrescribedDisplacement(HELD, 0, 0.0),
        ]
        push = load * beam.bending_share / (2.0 * max(0.5 * beam.height, beam.facet))
        loads += [SurfaceTraction(PUSHED, (0.0, lambda t: -push * t))]
    if beam.kind == "enf":
        loads += [PrescribedDisplacement(UPPER_END, 1, 0.0)]
    elif beam.kind == "mmb":
        pull = load * beam.lever / span / beam.height
        loads += [SurfaceTraction(UPPER_END, (0.0, lambda t: pull * t))]
    return Scene(
        arms(beam),
        {1: MATERIAL},
        default_interaction=beam.bond,
        facet_interactions={CRACK: lips},
        loads=loads,
        order=2,
    )


class Gauges:
    """What is read from a specimen.

    Args:
        beam: the specimen.
        simulation: its run.
    """

    def __init__(self, beam: Beam, simulation: Simulation):
        self._beam, self._simulation = beam, simulation
        bulk = simulation.bulk
        self._x = simulation.forms.V.tabulate_dof_coordinates()[bulk.layout.nodes]
        x = point_coordinates(simulation)[:, 0]
        order = np.argsort(x)
        self._order = order[x[order] > beam.crack - 1e-9]
        self._along = x[self._order]

    def _slope(self, tag: int) -> float:
        """v' of a section, by the line through its u_x."""
        nodes = self._simulation.model.facets.nodes(tag)
        moved = self._simulation.state.displacement.reshape(-1, 2)[nodes, 0]
        return -np.polyfit(self._x[nodes, 1], moved, 1)[0]

    def load_displacement(self) -> tuple[float, float, float]:
        """P (N/m), delta (m), J (J/m^2)."""
        beam, simulation = self._beam, self._simulation
        at, span = simulation.mean_displacement, beam.half_span
        forces = {tag: simulation.reaction(tag)[1] for tag in (LOWER_END, UPPER_END, FAR_END)}
        if beam.kind == "dcb":
            load, moved = forces[UPPER_END], at(UPPER_END)[1] - at(LOWER_END)[1]
        else:
            lever = beam.lever / span if beam.kind == "mmb" else 0.0
            load = beam.starting_load * simulation.state.time
            forces[UPPER_END] += load * lever
            forces[MIDDLE] = -load * beam.bending_share
            moved = lever * at(UPPER_END)[1] - beam.bending_share * at(MIDDLE)[1]
        rate = -sum(force * self._slope(tag) for tag, force in forces.items())
        return load, moved, rate

    def crack(self) -> tuple[float, float]:
        """Place of the tip and length of the zone ahead of it (m)."""
        bond, x = self._beam.bond, self._along
        opening = self._simulation.interactions.gather("opening_max")[self._order]
        broken = np.flatnonzero(opening >= bond.critical_opening)
        tip = self._beam.crack
        if len(broken):
            i = broken[-1]
            share = (opening[i] - bond.critical_opening) / (opening[i] - opening[i + 1])
            tip = x[i] + share * (x[i + 1] - x[i])
        front = x[opening > bond.elastic_opening].max(initial=tip)
        return tip, front - tip


class Curve(NamedTuple):
    """A run: at each step load (N/m), displacement (m), J (J/m^2), tip (m), length of the cohesive
    zone (m), dissipated and numerical energy (J/m), iterations; and at the end the ledger's
    closure over the external work."""

    load: np.ndarray
    displacement: np.ndarray
    rate: np.ndarray
    tip: np.ndarray
    zone: np.ndarray
    dissipated: np.ndarray
    numerical: np.ndarray
    iterations: np.ndarray
    closure: float


def delaminate(beam: Beam, scene: Scene | None = None) -> Curve:
    """Load a specimen, held as `scene_of` says or otherwise, until its crack has grown."""
    simulation = Simulation(
        scene or scene_of(beam), 1.0, inertia=False, path=GrowthControl(beam.step), num_threads=1
    )
    gauges, rows = Gauges(beam, simulation), []
    for step in simulation.steps(1e3):
        energies = step.energies
        rows.append(
            (
                *gauges.load_displacement(), *gauges.crack(), energies["dissipated_cohesion"],
                energies["dissipated_numerical"], step.newton_iterations,
            )
        )  # fmt: skip
        if rows[-1][3] > beam.crack + beam.growth:
            break
    return Curve(*np.array(rows).T, energies["closure"] / energies["external_work"])


class Findings(NamedTuple):
    """What beam theory is compared with, up to `spent` as ratios that should be 1.

    Attributes:
        compliance: of the first step, over that of beam theory.
        peak: largest load over that at which G(a0) = w.
        started: G by compliance over w where the tip leaves a0.
        grown: the same, mean while the crack grew by its second half.
        rate: J over w, mean there.
        spent: dissipated energy over w times the tip's way, there.
        share: of mode I in G by beam theory, there.
        zone: facets in the cohesive zone, mean there.
        numerical: numerical over dissipated energy at the end.
        closure: error of the energy ledger over the external work.
    """

    compliance: float
    peak: float
    started: float
    grown: float
    rate: float
    spent: float
    share: float
    zone: float
    numerical: float
    closure: float


def compare(beam: Beam, curve: Curve) -> Findings:
    """Hold a run against beam theory."""
    crack = beam.crack_of(curve.displacement / curve.load)
    by_compliance = beam.release_rate(curve.load, crack) / beam.fracture_energy
    grown = curve.tip - beam.crack
    late = np.flatnonzero(grown >= 0.5 * grown[-1])
    tip = curve.tip[late]

    def mean(values: np.ndarray) -> float:
        """Over the way of the tip: steps are denser where the load falls."""
        return np.trapezoid(values[late], tip) / np.ptp(tip)

    first, second = (mean(g) for g in beam.modes(curve.load, crack))
    return Findings(
        curve.displacement[0] / curve.load[0] / beam.compliance(beam.crack),
        curve.load.max() / beam.starting_load,
        by_compliance[np.argmax(grown > 0.0)],
        mean(by_compliance),
        mean(curve.rate) / beam.fracture_energy,
        np.ptp(curve.dissipated[late]) / np.ptp(tip) / beam.fracture_energy,
        first / (first + second),
        mean(curve.zone) / beam.facet,
        curve.numerical[-1] / curve.dissipated[-1],
        curve.closure,
    )


DCB, ENF, MMB = (Beam(kind) for kind in KINDS)


def variants(beam: Beam) -> dict[str, Beam]:
    """The specimen as it is, finer, coarser, with other steps, with other bonds."""
    out = {
        "57 MPa, facets of 0.25 mm": beam,
        "0.125 mm": replace(beam, facet=0.125e-3),
        "0.5 mm": replace(beam, facet=0.5e-3),
        "1 mm": replace(beam, facet=1e-3),
        "steps a third as long": replace(beam, step=beam.step / 3.0),
        "steps three times as long": replace(beam, step=3.0 * beam.step),
        "114 MPa, 0.125 mm": replace(beam, strength=114e6, facet=0.125e-3),
    }
    if beam.kind == "dcb":
        out["10 MPa"] = replace(beam, strength=10e6, growth=15e-3, facet=0.5e-3)
        out["1.7 MPa"] = replace(beam, strength=1.7e6, growth=20e-3, facet=0.5e-3)
    else:
        out["28.5 MPa"] = replace(beam, strength=28.5e6, growth=6e-3)
    return out


def draw(runs: dict[str, tuple[Beam, Curve]], path: Path) -> None:
    """Loads against displacements, with those of beam theory."""

    def fill(figure, axes):
        for colour, (name, (beam, curve)) in zip(COLOURS, runs.items(), strict=False):
            crack = np.linspace(beam.crack, curve.tip[-1] + 2e-3, 50)
            load = np.sqrt(beam.fracture_energy / beam.release_rate(1.0, crack))
            moved = load * beam.compliance(crack)
            axes.plot(1e3 * np.append(0.0, moved), 1e-3 * np.append(0.0, load), c=colour, lw=1.0)
            axes.plot(
                1e3 * curve.displacement, 1e-3 * curve.load, "o", ms=2.5, c=colour, label=name
            )
        axes.set(xlabel="displacement of the load (mm)", ylabel="load (kN/m)")
        axes.set_xlim(0.0)
        axes.set_ylim(0.0)
        axes.legend(title="points: run, lines: beam theory")

    new_figure(path, fill, (5.2, 3.6))


def main(options: list[str] | None = None) -> None:
    """Run the variants and print a table a specimen."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--beam", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--quick", action="store_true", help="the first variant alone")
    parser.add_argument("--figure", type=Path, help="where to draw the first variants")
    args = parser.parse_args(options)
    runs: dict[str, tuple[Beam, Curve]] = {}
    for beam in (b for b in (DCB, ENF, MMB) if b.kind in args.beam):
        print(f"\n{beam.kind.upper()}, a0 = {1e3 * beam.crack:g} mm, h = {1e3 * beam.height:g} mm")
        print(
            "| | facets in the zone | C / theory | peak / theory | G / w at first | later | J / w "
            "| spent / (w da) | G_I / G | numerical | closure | steps | iterations | CPU s |\n"
            + "|---" * 14
            + "|"
        )
        for name, variant in list(variants(beam).items())[: 1 if args.quick else None]:
            start = process_time()
            curve = delaminate(variant)
            runs.setdefault(beam.kind.upper(), (variant, curve))
            spent, f = process_time() - start, compare(variant, curve)
            print(
                f"| {name} | {f.zone:.1f} | {f.compliance:.4f} | {f.peak:.4f} | {f.started:.4f} | "
                f"{f.grown:.4f} | {f.rate:.4f} | {f.spent:.5f} | {f.share:.3f} | "
                f"{f.numerical:.0e} | {f.closure:.0e} | {len(curve.load)} | "
                f"{curve.iterations.sum():.0f} | {spent:.1f} |",
                flush=True,
            )
    if args.figure:
        draw(runs, args.figure)


if __name__ == "__main__":
    main()
