# SPDX-License-Identifier: LGPL-3.0-or-later
"""Structures: Cook's membrane, Prandtl's punch, the necking of a strip and of a bar, cycles.

Where the figures come from:

- Cook's membrane, plane stress, E = 1, nu = 1/3, unit load: the middle of the loaded edge goes up
  by 23.96 (Cook R.D., Journal of the Structural Division ASCE 100, 1974; FinEtools' examples give
  the limit 23.97).
- The plastic membrane (Simo J.C., Armero F., International Journal for Numerical Methods in
  Engineering 33, 1992; the same data stand in the tutorials of solids4foam and in code_aster's test
  v6.03.179) is published as curves alone: the corner goes up by about 7 mm. Asserted are that
  figure within its drawing's accuracy and the convergence of two families of elements to one value.
- The bar is Simo's (Simo J.C., Computer Methods in Applied Mechanics and Engineering 68, 1988):
  radius 6.413 mm, 1.8 % less in the middle, length 53.334 mm, ends that slide freely across. It is
  axisymmetric there, an eighth in 3D here. Published curves, which no source at hand gives as
  numbers, have the radius of the neck at 35 to 40 % of the first one after 14 mm. The maximal force
  is held against Considere's. The strip is the same section in plane strain.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from dolfinx.mesh import compute_midpoints
from scenes import BACK, BOTTOM, FRONT, LEFT, RIGHT, TOP, field, mesh_of, nodes, side_tags
from scipy.optimize import minimize_scalar

from xper_fx.bodies.explode import explode
from xper_fx.bodies.join import join_meshes
from xper_fx.bodies.meshes import tag_cells, tag_facets
from xper_fx.forms.loads import PrescribedDisplacement, SurfaceTraction
from xper_fx.materials import J2FiniteStrain, J2SmallStrain, Linear, LinearElastic, Voce
from xper_fx.nscd.laws import CohesiveZone, PerfectBond, SignoriniCoulomb
from xper_fx.scene.scene import Scene
from xper_fx.scene.tie import Tie
from xper_fx.scene.wall import Wall
from xper_fx.simulation.simulation import Simulation

STEEL = J2FiniteStrain(206.9, 0.29, 0.45, Voce(0.715, 16.93, 0.12924), 7.8e-6)
"""GPa and mm: kappa = 164.2 GPa, mu = 80.19 GPa."""


def mapped_square(cells, place):
    """One body: the unit square of crossed triangles, its points put where `place` says."""
    mesh = mesh_of((1, 1), cells)
    count = mesh.topology.index_map(2).size_local
    bodies = explode(mesh, np.zeros(count, int), tag_cells(mesh, {}), side_tags(mesh, (1, 1)))
    x = bodies.mesh.geometry.x
    x[:, 0], x[:, 1] = place(x[:, 0].copy(), x[:, 1].copy())
    return bodies


def static(bodies, order, material, loads, step):
    """A run of one body without inertia; time is the parameter of the loads."""
    scene = Scene(bodies, {1: material}, loads=loads, order=order)
    return Simulation(scene, step, theta=1.0, inertia=False)


def moved(simulation, point):
    """Displacement of the node nearest to a point (m)."""
    distance = np.sum((nodes(simulation) - point) ** 2, axis=1)
    return field(simulation)[np.argmin(distance)]


def pulled(simulation, end, tag, component):
    """Run to a time that is the elongation; elongations and forces on tagged facets."""
    pulls, forces = [0.0], [0.0]
    for step in simulation.steps(end):
        pulls.append(step.time)
        forces.append(simulation.reaction(tag)[component])
    return np.array(pulls), np.array(forces)


def membrane(cells, order, material, traction, steps):
    """Cook's membrane under an upward dead traction in equal steps, some of which may be cut."""
    bodies = mapped_square((cells, cells), lambda s, t: (48 * s, 44 * s + t * (44 - 28 * s)))
    loads = [PrescribedDisplacement(LEFT, component, 0.0) for component in (0, 1)]
    loads.append(SurfaceTraction(RIGHT, (0.0, lambda t: t)))
    simulation = static(bodies, order, material, loads, traction / steps)
    for _ in simulation.steps(traction):
        pass
    return simulation


def test_elastic_membrane():
    material = LinearElastic(1.0, 1.0 / 3.0, 1.0, plane="stress")
    rise = [moved(membrane(n, 2, material, 1 / 16, 1), [48.0, 52.0])[1] for n in (4, 16)]
    print("elastic membrane, middle of the edge:", rise, "published 23.96")
    assert abs(rise[1] / 23.96 - 1.0) < 2e-3
    assert abs(rise[0] / 23.96 - 1.0) < 2e-2


@pytest.mark.slow
def test_plastic_membrane():
    """E = 206.9, sigma_0 = 0.45 ... saturating at 0.715 GPa, 5 kN/mm in 20 steps."""
    rise = {
        (order, n): moved(membrane(n, order, STEEL, 0.3125, 20), [48.0, 60.0])[1]
        for order, n in ((2, 4), (2, 8), (1, 8), (1, 16))
    }
    print("plastic membrane, corner (mm), by order and cells a side:", rise)
    # converging from below to 7.0: order 2 within 4 and 2 %, order 1 22 and 8 %
    errors = {key: 1.0 - value / 7.0 for key, value in rise.items()}
    assert 0.0 < errors[2, 8] < 0.02 and errors[2, 4] < 0.04
    assert errors[2, 8] < 0.6 * errors[2, 4] and errors[1, 16] < 0.5 * errors[1, 8]
    assert errors[2, 4] < errors[1, 16]


# -- locking


@pytest.mark.slow
def test_crossed_triangles_do_not_lock():
    """Prandtl's punch: a limit load above (2 + pi) k on crossed triangles, none on plain ones."""
    sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
    from locking import FAMILIES, press, punch

    found = {}
    for name, family in FAMILIES.items():
        for cells in (8, 16):
            found[name, cells] = press(punch, family, cells, 0.06, 12)[:2]
            print(f"{name}, {cells}: force {found[name, cells][0]:.4f} of the exact one")
    plain, crossed, second, both, bodies = (
        [found[name, cells] for cells in (8, 16)] for name in FAMILIES
    )
    for coarse, fine in (plain, crossed, second, both, bodies):
        assert 1.0 < fine[0] < coarse[0]
    for level in (0, 1):
        assert both[level][0] < second[level][0] < crossed[level][0] < plain[level][0]
        # the last slope over the elastic one: of no limit load, of one
        assert plain[level][1] > 5e-3
        assert max(m[level][1] for m in (crossed, second, both, bodies)) < 1e-3
        # perfectly bonded cells are the connected ones
        assert bodies[level][0] == pytest.approx(crossed[level][0], rel=2e-4)
    assert plain[1][0] > 1.3 and crossed[1][0] < 1.12 and both[1][0] < 1.05


# -- necking

WIDTH, LENGTH, THINNED = 6.413, 26.667, 0.982


def strip(columns, rows, pull, step):
    """A quarter of a strip, 1.8 % thinner at its middle section, pulled at its end.

    Returns:
        Elongations, forces, the simulation.
    """

    def place(s, t):
        y = LENGTH * t**1.6  # rows crowd at the neck
        return WIDTH * s * (THINNED + (1.0 - THINNED) * y / LENGTH), y

    bodies = mapped_square((columns, rows), place)
    # the end moves along the strip and keeps its width free: symmetry planes left and bottom
    held = [(LEFT, 0, 0.0), (BOTTOM, 1, 0.0), (TOP, 1, lambda t: t)]
    loads = [PrescribedDisplacement(*motion) for motion in held]
    simulation = static(bodies, 2, STEEL, loads, step)
    return *pulled(simulation, pull, TOP, 1), simulation


def considere(ratio):
    """Largest nominal stress in tension, incompressible and rigid up to yield (GPa).

    Args:
        ratio: of the stress to K(alpha), and of alpha to the strain: 1 in uniaxial tension, 2 /
            sqrt(3) in plane strain.
    """

    def stress(strain):
        alpha = ratio * strain
        K = 0.45 + 0.12924 * alpha - 0.265 * np.expm1(-16.93 * alpha)
        return ratio * K * np.exp(-strain)

    return -minimize_scalar(lambda e: -stress(e), bounds=(0.0, 0.5), method="bounded").fun


@pytest.mark.slow
def test_a_strip_necks():
    """The force peaks between the loads of Considere of the thinnest and of the full section.

    Past it the neck takes all the strain: the end section shrinks no more and unloads, while the
    neck narrows alike on two meshes.
    """
    necks, peaks = [], []
    for columns, rows in ((3, 8), (5, 14)):
        pulls, forces, simulation = strip(columns, rows, 5.0, 0.1)
        work = np.sum(0.5 * (forces[1:] + forces[:-1]) * np.diff(pulls))
        energies = simulation.ledger.energies
        stored, lost = energies.elastic, energies.dissipated_plastic
        neck = 1.0 + moved(simulation, [WIDTH * THINNED, 0.0])[0] / (WIDTH * THINNED)
        end = 1.0 + moved(simulation, [WIDTH, LENGTH])[0] / WIDTH
        top = np.argmax(forces)
        print(
            f"strip {columns} x {rows}: peak {forces[top]:.4f} kN/mm at {pulls[top]:.1f} mm, "
            f"at 5 mm {forces[-1]:.4f} kN/mm, neck {neck:.4f}, end {end:.4f}, "
            f"work {work:.4f}, stored {stored:.4f}, dissipated {lost:.4f} J/mm"
        )
        necks.append(neck)
        peaks.append(forces[top])
        full = considere(2.0 / np.sqrt(3.0)) * WIDTH
        assert THINNED * full < forces[top] < full
        assert forces[-1] < 0.85 * forces[top]
        assert neck < 0.6 and end > 0.91
        assert stored + lost == pytest.approx(work, rel=5e-3)
    assert abs(peaks[1] / peaks[0] - 1.0) < 1e-3
    assert abs(necks[1] - necks[0]) < 0.02


def bar(columns, rows, pull, step):
    """An eighth of Simo's bar in hexahedra of order 2.

    Returns:
        Elongations, forces on the whole section, the simulation.
    """
    mesh = mesh_of((1, 1, 1), (columns, columns, rows), "hexahedron")
    count = mesh.topology.index_map(3).size_local
    tags = side_tags(mesh, (1, 1, 1))
    bodies = explode(mesh, np.zeros(count, int), tag_cells(mesh, {}), tags)
    x = bodies.mesh.geometry.x
    s, t, z = x.T.copy()
    # squares about the axis become circles towards the surface
    outer, inner = np.maximum(s, t), np.minimum(s, t)
    angle = 0.25 * np.pi * inner / np.maximum(outer, 1e-12)
    near, far = outer * np.cos(angle), outer * np.sin(angle)
    share = outer**2
    across = [
        (1.0 - share) * 0.8 * own + share * np.where(own == outer, near, far) for own in (s, t)
    ]
    z = LENGTH * z**1.6
    # the polygon has the area of the circle
    half = 0.25 * np.pi / columns
    radius = WIDTH * np.sqrt(half / np.sin(half)) * (THINNED + (1.0 - THINNED) * z / LENGTH)
    x[:, 0], x[:, 1], x[:, 2] = radius * across[0], radius * across[1], z
    held = [(LEFT, 0, 0.0), (BOTTOM, 1, 0.0), (BACK, 2, 0.0), (FRONT, 2, lambda t: t)]
    loads = [PrescribedDisplacement(*motion) for motion in held]
    simulation = static(bodies, 2, STEEL, loads, step)
    pulls, forces = pulled(simulation, pull, FRONT, 2)
    return pulls, 4.0 * forces, simulation


@pytest.mark.slow
def test_the_bar_of_simo_necks():
    """Force, neck and far radius at an elongation of 14 mm, on two meshes.

    Twelve rows carry the neck: two columns instead of one narrow it by no more than 0.02.
    """
    peaks, necks = [], []
    for columns, rows in ((1, 8), (1, 12)):
        pulls, forces, simulation = bar(columns, rows, 7.0, 0.25)
        x, u = nodes(simulation), field(simulation)
        middle, end = x[:, 2] < 1e-9, x[:, 2] > LENGTH - 1e-9
        radii = []
        for section in (middle, end):
            r = np.linalg.norm(x[section, :2], axis=1)
            rim = np.flatnonzero(section)[r > 0.97 * r.max()]
            moved = np.linalg.norm((x + u)[rim, :2], axis=1)
            radii.append(moved / np.linalg.norm(x[rim, :2], axis=1))
        top = np.argmax(forces)
        print(
            f"bar {columns} x {rows}: peak {forces[top]:.2f} kN at {pulls[top]:.2f} mm, at 7 mm "
            f"{forces[-1]:.2f} kN, neck {radii[0].mean():.4f} +- {np.ptp(radii[0]) / 2:.4f}, "
            f"end {radii[1].mean():.4f}"
        )
        peaks.append(forces[top])
        necks.append(radii[0].mean())
        full = considere(1.0) * np.pi * WIDTH**2
        assert THINNED**2 * full < forces[top] < full
        assert forces[-1] < 0.5 * forces[top]
        assert radii[1] == pytest.approx(np.full(len(radii[1]), radii[1].mean()), rel=1e-3)
        assert radii[1].mean() > 0.96
    assert abs(peaks[1] / peaks[0] - 1.0) < 1e-3
    # more rows let the neck localise further, towards the published 35 to 40 %
    assert 0.35 < necks[1] < 0.42 and necks[1] < necks[0] < 0.5


def unlike_halves(kind, material, label=None, bond=None):
    """The unit square, weak and strong across its diagonal, its right side driven by `kind`."""
    mesh = mesh_of((1, 1), (4, 4))
    count = mesh.topology.index_map(2).size_local
    tags = tag_cells(mesh, {2: lambda x: x[0] + x[1] > 1.0})
    label = np.zeros(count, int) if label is None else label(mesh)
    bodies = explode(mesh, label, tags, side_tags(mesh, (1, 1)))
    loads = [PrescribedDisplacement(LEFT, component, 0.0) for component in (0, 1)]
    loads.append(PrescribedDisplacement(RIGHT, 0, kind))
    materials = {1: material(1.0), 2: material(2.0)}
    return Scene(bodies, materials, default_interaction=bond, loads=loads)


@pytest.mark.parametrize("step", [0.8, 0.3])
def test_loads_that_turn_round(step):
    """Flow that turns round within a step: no step is cut, and one system finds the same."""

    def material(times):
        return J2SmallStrain(1.0, 0.3, 1e-3 * times, Linear(0.05), 1.0)

    def load(t):
        return 1.2e-3 * (1.0 + 0.1 * t) * np.sin(2.0 * np.pi * t)

    ends = {}
    for solver in ("auto", "monolithic"):
        scene = unlike_halves(load, material)
        simulation = Simulation(scene, step, theta=1.0, inertia=False, solver=solver)
        *steps, last = simulation.steps(step * round(11.0 / step))
        assert all(record.size == pytest.approx(step) for record in steps)
        ends[solver] = field(simulation), last.energies
        if solver == "auto":
            assert sum(record.newton_iterations for record in steps) < 8 * len(steps)
    np.testing.assert_allclose(ends["auto"][0], ends["monolithic"][0], atol=1e-8)
    for name, energy in ends["monolithic"][1].items():
        assert ends["auto"][1][name] == pytest.approx(energy, rel=1e-5, abs=1e-11)


def test_ductile_halves_that_bonds_hold():
    """Finite plastic flow has no symmetric tangent; the system of bulk and bonds is solved so."""

    def material(times):
        return J2FiniteStrain(1.0, 0.3, 1e-2 * times, Linear(0.01), 1.0)

    def halves(mesh):
        middle = compute_midpoints(mesh, 2, np.arange(len(mesh.geometry.dofmap), dtype=np.int32))
        return (middle[:, 0] > 0.5).astype(int)

    bond = CohesiveZone(1e4, fracture_energy=1.0, strength=1.0)
    forces = []
    for label, law in ((halves, bond), (None, None)):
        scene = unlike_halves(lambda t: 0.1 * t, material, label, law)
        simulation = Simulation(scene, 0.025, theta=1.0, inertia=False)
        steps = list(simulation.steps(0.5))
        assert len(steps) == 20
        iterations = sum(record.newton_iterations for record in steps)
        assert law is None or iterations <= 4 * len(steps)
        forces.append(simulation.reaction(RIGHT)[0])
    assert forces[0] == pytest.approx(forces[1], rel=1e-4)


def ductile_halves(law, left, right):
    """Two squares side by side; displacements of the outer sides by component."""
    mesh = mesh_of((1.0, 0.5), (4, 2))
    middle = compute_midpoints(mesh, 2, np.arange(32, dtype=np.int32))
    sides = side_tags(mesh, (1.0, 0.5))
    moved = ((LEFT, left), (RIGHT, right))
    return Scene(
        explode(mesh, (middle[:, 0] > 0.5).astype(int), tag_cells(mesh, {}), sides),
        {1: J2FiniteStrain(1.0, 0.3, 1e-2, Linear(0.05), 1.0)},
        default_interaction=law,
        loads=[PrescribedDisplacement(tag, i, to[i]) for tag, to in moved for i in (0, 1)],
    )


def test_ductile_halves_that_part():
    """The bond breaks at once, and what bears the load then is found after rounds in vain."""
    bond = CohesiveZone(1e2, fracture_energy=2e-5, strength=6e-3, friction=0.2)
    right = lambda t: 0.004 * np.sin(8.0 * t), lambda t: 0.04 * t
    scene = ductile_halves(bond, (lambda t: -0.04 * t, 0.0), right)
    *steps, last = Simulation(scene, 0.05, theta=1.0, inertia=False).steps(1.0)
    assert len(steps) == 19
    assert last.energies["dissipated_cohesion"] == pytest.approx(1e-5, rel=1e-6)


def test_ductile_halves_that_touch_now_and_then():
    """Where an increment is rounding its work is, too: no reason to shorten it, and to go on."""
    contact = SignoriniCoulomb(friction=0.3, contact="position")
    right = lambda t: 0.02 * np.sin(2.0 * np.pi * t), 0.0
    scene = ductile_halves(contact, (0.0, 0.0), right)
    *steps, last = Simulation(scene, accuracy=1e-2, theta=1.0, inertia=False).steps(1.0)
    assert len(steps) < 200
    assert last.energies["dissipated_plastic"] == pytest.approx(5.46e-5, rel=1e-2)


def test_tied_ductile_halves_whose_load_turns_round():
    """Ties whose impulses sweeps find: no step is cut, and the matter flows as it should."""
    coarse, fine = mesh_of((1.0, 0.5), (4, 2)), mesh_of((1.0, 0.5), (6, 3))
    fine.geometry.x[:, 1] += 0.5
    lower = tag_facets(coarse, {BOTTOM: lambda x: x[1] < 1e-9, 10: lambda x: x[1] > 0.5 - 1e-9})
    upper = tag_facets(fine, {11: lambda x: x[1] < 0.5 + 1e-9, TOP: lambda x: x[1] > 1.0 - 1e-9})
    joined = join_meshes([coarse, fine], facet_tags=[lower, upper])
    loads = [PrescribedDisplacement(BOTTOM, i, 0.0) for i in (0, 1)]
    loads += [
        PrescribedDisplacement(TOP, 0, 0.0),
        PrescribedDisplacement(TOP, 1, lambda t: 4e-3 * np.sin(2.0 * np.pi * t)),
    ]
    scene = Scene(
        explode(joined.mesh, joined.part, facet_tags=joined.facet_tags),
        {1: J2FiniteStrain(1.0, 0.3, 1e-3, Linear(0.02), 1.0)},
        loads=loads,
        ties=[Tie(11, 10, PerfectBond())],
    )
    *steps, last = Simulation(scene, 0.05, theta=1.0, inertia=False).steps(1.0)
    assert len(steps) == 19
    assert last.energies["dissipated_plastic"] == pytest.approx(1.33e-5, rel=1e-2)
    assert abs(last.energies["closure"]) < 0.05 * last.energies["external_work"]


def test_a_ductile_block_that_presses_on_a_wall():
    """Sweeps find the friction that one system finds, where the tangent is not symmetric."""
    frictions = []
    for solver in ("auto", "monolithic"):
        scene = Scene(
            mapped_square((6, 6), lambda s, t: (s, t)),
            {1: J2FiniteStrain(1.0, 0.3, 1e-2, Linear(0.05), 1.0)},
            walls=[Wall(BOTTOM, (0.0, 0.0), (0.0, 1.0), SignoriniCoulomb(friction=0.3))],
            loads=[
                PrescribedDisplacement(TOP, 0, 0.0),
                PrescribedDisplacement(TOP, 1, lambda t: -2e-2 * t),
            ],
        )
        simulation = Simulation(scene, 0.2, theta=1.0, inertia=False, solver=solver)
        *steps, last = simulation.steps(2.0)
        assert len(steps) == 9
        frictions.append(last.energies["dissipated_friction"])
    assert frictions[0] == pytest.approx(frictions[1], rel=1e-3)
