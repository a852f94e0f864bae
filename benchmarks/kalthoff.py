# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kalthoff and Winkler's plate: a projectile between two notches, cracks at about 70 degrees.

    ./fenicsx python3 benchmarks/kalthoff.py [--facet 1.5e-3] [--out results/kalthoff]

Kalthoff and Winkler (1987): a plate of maraging steel, 100 x 200 mm, with two edge notches 50 mm
long and 50 mm apart, is hit between them by a projectile as wide as the gap. At 33 m/s the steel
fails by brittle cracks that leave the notches at about 70 degrees. Half of the plate is simulated,
the line between the notches held by symmetry, with the interface's half of the projectile's speed,
16.5 m/s, prescribed on the edge that is hit.

Each triangle of an unstructured Delaunay mesh is a body; the bulk is explicit. The strength, which
is not what decides the path, is chosen so that the cohesive length E' w / Rmax^2 spans several
facets. C_N = 50 E' / facet: the bonds add a few percent to the compliance.

The angle is that of the principal axis, through the notch's tip, of the midpoints of facets
weighted by what they dissipated, within a distance of the tip and away from the line of symmetry.
On the other side of the notch's line the tension of the wave that the far edge reflects breaks the
plate too if the strength is low.

Found (strength 844 MPa), over the first 60 mm: 63.5, 61.7, 61.8 degrees at facets of 1.5 mm, 4.5 of
them in the cohesive length, with the seeds 1, 2, 3 (over 20 mm 69.6, 59.7, 55.5), and 64.3 at 1 mm
with the first. Damage starts at the tip at 10 us; a second crack, which seems to be of the
reflected wave, runs below the notch.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np

from xper_fx.bodies.explode import explode
from xper_fx.bodies.gmsh_session import gmsh_model
from xper_fx.bodies.meshes import read_gmsh, tag_facets
from xper_fx.forms.loads import PrescribedVelocity
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import CohesiveZone, SignoriniCoulomb
from xper_fx.nscd.laws.law import COHESION
from xper_fx.output.field_series import point_coordinates
from xper_fx.output.output_folder import prepare_folder
from xper_fx.plotting.figures import new_figure
from xper_fx.scene.scene import Scene
from xper_fx.simulation.cohesive_scales import cohesive_table
from xper_fx.simulation.simulation import Simulation

STEEL = LinearElastic(young=190e9, poisson=0.3, density=8000.0)
FRACTURE_ENERGY, STRENGTH = 2.213e4, 844e6
SIZE, NOTCH_LENGTH, NOTCH_HEIGHT = 0.1, 0.05, 0.025
TIP = np.array([NOTCH_LENGTH, NOTCH_HEIGHT])
HIT, SYMMETRY, NOTCH = 1, 2, 3
SPEED = 16.5
# Share of a facet by which nodes are moved, so that meshes of several seeds tell the scatter.
_SHAKEN = 0.15


def scene_of(facet: float, seed: int = 1, strength: float = STRENGTH) -> Scene:
    """Half of the plate, x away from the edge that is hit, y away from the line of symmetry.

    Args:
        facet: length of the facets (m).
        seed: of what inner nodes are moved by, up to `_SHAKEN` of a facet either way.
        strength: of the bonds (Pa).
    """
    options = {
        "Mesh.MeshSizeMax": facet, "Mesh.MeshSizeMin": facet, "Mesh.Algorithm": 5,
    }  # fmt: skip
    with gmsh_model("Kalthoff's plate", options) as gmsh:
        shapes = gmsh.model.occ
        plate = shapes.addRectangle(0.0, 0.0, 0.0, SIZE, SIZE)
        ends = [shapes.addPoint(x, NOTCH_HEIGHT, 0.0) for x in (0.0, NOTCH_LENGTH)]
        shapes.fragment([(2, plate)], [(1, shapes.addLine(*ends))])
        shapes.synchronize()
        gmsh.model.addPhysicalGroup(2, [tag for _, tag in gmsh.model.getEntities(2)], 1)
        gmsh.model.mesh.generate(2)
        mesh, cell_tags, _ = read_gmsh(gmsh.model, 2)
    small = 1e-6 * SIZE
    x, y = mesh.geometry.x[:, :2].T
    inner = np.minimum(np.minimum(x, SIZE - x), np.minimum(y, SIZE - y)) > small
    inner &= (np.abs(y - NOTCH_HEIGHT) > small) | (x > NOTCH_LENGTH + small)
    shift = np.random.default_rng(seed).uniform(-_SHAKEN, _SHAKEN, (len(x), 2)) * facet
    mesh.geometry.x[inner, :2] += shift[inner]
    where = {
        HIT: lambda x: (x[0] < small) & (x[1] < NOTCH_HEIGHT + small),
        SYMMETRY: lambda x: x[1] < small,
        NOTCH: lambda x: (np.abs(x[1] - NOTCH_HEIGHT) < small) & (x[0] < NOTCH_LENGTH + small),
    }
    modulus = STEEL.young / (1.0 - STEEL.poisson**2)
    return Scene(
        explode(mesh, cell_tags=cell_tags, facet_tags=tag_facets(mesh, where)),
        {1: STEEL},
        default_interaction=CohesiveZone(50.0 * modulus / facet, FRACTURE_ENERGY, strength),
        facet_interactions={NOTCH: SignoriniCoulomb(contact="position")},
        loads=[PrescribedVelocity(HIT, 0, SPEED), PrescribedVelocity(SYMMETRY, 1, 0.0)],
    )


class Damage(NamedTuple):
    """What a run left at each facet with a law, and at its end.

    Attributes:
        midpoint: shape (n, 2), m.
        ends: shape (n, 2, 2), m.
        dissipated: by cracking, shape (n,), J/m.
        broken: share of the facet's bonds that is gone, shape (n,).
        first: when each facet first dissipated 5 % of w, shape (n,), s; infinite if never.
        energies: of the ledger.
    """

    midpoint: np.ndarray
    ends: np.ndarray
    dissipated: np.ndarray
    broken: np.ndarray
    first: np.ndarray
    energies: dict[str, float]


def run(scene: Scene, end_time: float) -> tuple[Damage, Simulation]:
    """Simulate until `end_time` (s)."""
    simulation = Simulation(scene, scheme="explicit", num_threads=1)
    number = simulation.facets_with_law
    ends = point_coordinates(simulation).reshape(len(number), 2, 2)
    measure = scene.bodies.facets.measure[number]
    lost, first = np.zeros(len(number)), np.full(len(number), np.inf)
    for step in simulation.steps(end_time):
        energy = simulation.interactions.gather("energy")[:, COHESION]
        lost += energy.reshape(len(number), 2).sum(axis=1)
        begun = np.isinf(first) & (lost > 0.05 * FRACTURE_ENERGY * measure)
        first[begun] = step.time
    bonded = scene.bodies.facets.tag[number] != NOTCH
    left = simulation.interactions.gather("damage").reshape(len(number), 2).mean(axis=1)
    damage = Damage(
        ends.mean(axis=1), ends, lost, np.where(bonded, 1.0 - left, 0.0), first, step.energies
    )
    return damage, simulation


def crack_angle(damage: Damage, reach: float) -> float:
    """Angle of the crack to the notch's line (degrees), from damage within `reach` (m)."""
    away = damage.midpoint - TIP
    near = (np.hypot(*away.T) < reach) & (away[:, 1] > 0.0)
    moments = np.einsum("f,fi,fj->ij", damage.dissipated[near], away[near], away[near])
    axis = np.linalg.eigh(moments)[1][:, -1]
    return float(np.degrees(np.arctan2(*(axis * np.sign(axis[1]))[::-1])))


def draw(damage: Damage, simulation: Simulation, path: Path) -> None:
    """The plate, deformed, and what each facet dissipated."""
    from matplotlib.collections import LineCollection

    from xper_fx.support.compat import geometry_dofmap

    mesh = simulation.scene.bodies.mesh
    cells = geometry_dofmap(mesh)
    node = np.empty(len(mesh.geometry.x), np.int64)
    node[cells] = simulation.forms.V.dofmap.list
    moved = simulation.bulk.unknowns.expand(simulation.state.displacement).reshape(-1, 2)[node]
    x = 1e3 * (mesh.geometry.x[:, :2] + moved)
    share = damage.dissipated / damage.dissipated.max()

    def fill(figure, panels):
        whole, dissipation = panels
        whole.tripcolor(*x.T, cells, 1e3 * np.hypot(*moved.T)[cells].mean(axis=1), cmap="viridis")
        whole.set_title("deformed plate, displacement in colour")
        seen = share > 1e-3
        lines = LineCollection(
            1e3 * damage.ends[seen], array=share[seen], cmap="inferno_r", linewidths=1.6
        )
        dissipation.add_collection(lines)
        dissipation.plot([0.0, 1e3 * TIP[0]], [1e3 * TIP[1]] * 2, "k", lw=2.0)
        way = np.array([0.0, 70e-3])
        slope = np.radians(70.0)
        dissipation.plot(
            1e3 * (TIP[0] + way * np.cos(slope)), 1e3 * (TIP[1] + way * np.sin(slope)), "0.5",
            ls="--", lw=0.8, label="70 degrees",
        )  # fmt: skip
        dissipation.legend(loc="upper left")
        dissipation.set_title(f"dissipation of facets; {crack_angle(damage, 0.06):.0f} degrees")
        for axes in panels:
            axes.set(xlim=(-2, 104), ylim=(-2, 104), aspect="equal", xlabel="x (mm)")
        whole.set_ylabel("y (mm)")

    new_figure(path, fill, (8.6, 4.4), ncols=2)


def main(options: list[str] | None = None) -> None:
    """Run one mesh, print the angles and draw it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--facet", type=float, default=1.5e-3, help="length of facets, m (default 1.5e-3)")
    add("--seed", type=int, default=1, help="of the mesh")
    add("--strength", type=float, default=STRENGTH, help="of the bonds, Pa")
    add("--end-time", type=float, default=90e-6, help="s")
    add("--out", type=Path, default=Path("results/kalthoff"))
    args = parser.parse_args(options)
    prepare_folder(args.out)
    damage, simulation = run(scene_of(args.facet, args.seed, args.strength), args.end_time)
    print(cohesive_table(simulation))
    angles = " / ".join(f"{crack_angle(damage, reach):.1f}" for reach in (0.02, 0.04, 0.06))
    away = damage.midpoint - TIP
    longest = away[damage.broken > 0.99, 1].max(initial=0.0)
    energies, work = damage.energies, damage.energies["external_work"]
    above = (away[:, 1] > 0.0) & (away[:, 0] > -1e-3)
    print(
        f"{simulation.scene.bodies.num_bodies} triangles, {simulation.step_number} steps of "
        f"{simulation.step_size:.2e} s\n"
        f"angle within 20 / 40 / 60 mm: {angles} degrees; damage from "
        f"{1e6 * damage.first.min():.1f} us on; broken up to "
        f"{1e3 * longest:.0f} mm above the notch\n"
        f"work {work:.0f} J/m, spent on cracks {energies['dissipated_cohesion']:.0f} J/m, "
        f"{damage.dissipated[above].sum() / energies['dissipated_cohesion']:.2f} of it above the "
        f"notch; closure {energies['closure'] / work:.1e}"
    )
    draw(damage, simulation, args.out / "kalthoff.png")


if __name__ == "__main__":
    main()
