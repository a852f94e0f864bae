# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bulk and interactions in one system: against plain forms, against the other solvers, KKT."""

import numpy as np
import pytest
import scipy.sparse as sp
import ufl
from dolfinx import fem
from scenes import BOTTOM, LEFT, RIGHT, TOP, box_bodies, field, mesh_of, run, side_tags
from scipy.sparse.linalg import spsolve

import xper_fx as xf
from xper_fx.bulk import monolithic_scheme
from xper_fx.bulk.coupled_step import CoupledStep
from xper_fx.nscd.laws import CohesiveZone, PerfectBond, SignoriniCoulomb

E, LX, LY = 30e9, 0.4, 0.1


def strip(rows, factor, loads=(), poisson=0.2, **options):
    """Crossed triangles, each a body, bonds of `factor` E/h; held on the left."""
    bodies = box_bodies((LX, LY), (4 * rows, rows))
    friction = options.pop("friction", 0.0)
    bond = CohesiveZone(factor * E * rows / LY, 1e9, 3e6, friction=friction)
    held = options.pop("held", ((LEFT, 0), (LEFT, 1)))
    held = [xf.PrescribedDisplacement(side, axis, 0.0) for side, axis in held]
    material = xf.materials.LinearElastic(E, poisson, 2400.0, plane="stress")
    return xf.Scene(
        bodies, {1: material}, default_interaction=bond, loads=[*held, *loads], **options
    )


PULLED = [xf.PrescribedDisplacement(RIGHT, 0, lambda t: 1e-6 * t)]
BENT = [xf.SurfaceTraction(RIGHT, (0.0, lambda t: -1e3 * t))]


def static(scene, **options):
    return xf.Simulation(scene, 1.0, inertia=False, newton_tolerance=1e-10, **options)


@pytest.mark.parametrize("points", ["nodal", "gauss"])
@pytest.mark.parametrize("factor", [10.0, 1000.0])
def test_bonded_triangles_are_what_plain_forms_give(points, factor):
    """Pulled both ways and by a body force all bonds are open, and linear springs."""
    rows, k = 4, factor * E * 4 / LY
    loads = [
        xf.PrescribedDisplacement(RIGHT, 0, lambda t: 1e-6 * t),
        xf.PrescribedDisplacement(TOP, 1, lambda t: 1e-7 * t),
        xf.BodyForce((1e5, 0.0)),
    ]
    rollers = ((LEFT, 0), (BOTTOM, 1))
    simulation = static(strip(rows, factor, loads, held=rollers, points=points))
    (step,) = run(simulation, 1)
    assert step.newton_iterations <= 2
    mesh = xf.crossed_rectangle((0, 0), (LX, LY), (4 * rows, rows))
    V = fem.functionspace(mesh, ("DG", 1, (2,)))
    u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
    rule, degree = {"nodal": ("vertex", 1), "gauss": ("default", 2)}[points]
    dS = ufl.Measure("dS", metadata={"quadrature_rule": rule, "quadrature_degree": degree})
    strain = ufl.sym(ufl.grad(u))
    stress = E / 1.2 * strain + E * 0.2 / (1 - 0.04) * ufl.tr(strain) * ufl.Identity(2)
    form = ufl.inner(stress, ufl.grad(v)) * ufl.dx
    form += k * ufl.inner(ufl.jump(u), ufl.jump(v)) * dS
    matrix = fem.assemble_matrix(fem.form(form)).to_scipy().tocsr()
    pull = ufl.as_vector([1e5, 0.0])
    force = fem.assemble_vector(fem.form(ufl.inner(pull, v) * ufl.dx)).array
    x, q = V.tabulate_dof_coordinates(), np.zeros(len(force))
    known = []
    for side, axis, value in ((0.0, 0, 0.0), (0.0, 1, 0.0), (LX, 0, 1e-6), (LY, 1, 1e-7)):
        nodes = V.dofmap.list[np.isclose(x[V.dofmap.list, axis], side).sum(1) == 2]
        known.append(2 * nodes[np.isclose(x[nodes, axis], side)] + axis)
        q[known[-1]] = value
    free = np.setdiff1d(np.arange(len(q)), np.concatenate(known))
    q[free] = spsolve(sp.csc_array(matrix[free][:, free]), (force - matrix @ q)[free])
    reaction = float((matrix @ q - force)[known[2]].sum())
    assert simulation.reaction(RIGHT)[0] == pytest.approx(reaction, rel=1e-8)
    # nodes of a place are told apart by their displacements
    np.testing.assert_allclose(
        np.sort(field(simulation), axis=0), np.sort(q.reshape(-1, 2), axis=0), atol=1e-8 * 1e-6
    )


def check_lips(simulation, stiffness, friction):
    """Signorini's and Coulomb's laws at each point of bonds of a stiffness after a first step.

    The stiffness is one number, or one of each point. Returns the points that are closed, and
    those that have slid.
    """
    gather, size = simulation.interactions.gather, 1e-8
    jump, impulse = gather("jump"), gather("impulse")
    length, force = np.abs(jump).max(), np.abs(impulse).max()
    closed = impulse[:, 0] > 0.0
    assert jump[:, 0].min() > -size * length
    assert np.abs(jump[closed, 0]).max() < size * length
    # what is not the bond's own pull is friction
    area = simulation.interactions.points.area
    beyond = impulse[:, 1] + stiffness * area * jump[:, 1]
    bound = friction * impulse[:, 0]
    assert np.all(np.abs(beyond[closed]) <= bound[closed] + size * force)
    slid = closed & (np.abs(jump[:, 1]) > 1e-6 * length)
    against = -np.sign(jump[slid, 1]) * bound[slid]
    np.testing.assert_allclose(beyond[slid], against, rtol=0, atol=size * force)
    return closed, slid


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("loads", [PULLED, BENT], ids=["pulled", "bent"])
@pytest.mark.parametrize("factor", [10.0, 1000.0])
def test_closed_lips_hold_exactly(factor, loads, friction):
    """Unilateral lips: nothing interpenetrates, what presses is closed, Coulomb's cone holds."""
    simulation = static(strip(4, factor, loads, friction=friction))
    (step,) = run(simulation, 1)
    assert step.newton_iterations <= 9
    closed, slid = check_lips(simulation, factor * E * 4 / LY, friction)
    assert 40 < closed.sum() < 0.7 * len(closed)
    assert not friction or slid.sum() > 10
    assert abs(step.energies["closure"]) < 1e-8 * step.energies["external_work"]


def crooked(seed, bond):
    """Crossed triangles whose inner nodes are moved at random, held on the left, sheared."""
    mesh = xf.crossed_rectangle((0, 0), (2, 1), (8, 4))
    x = mesh.geometry.x
    inner = np.all((x[:, :2] > 1e-9) & (x[:, :2] < np.array([2, 1]) - 1e-9), axis=1)
    x[inner, :2] += np.random.default_rng(seed).uniform(-0.025, 0.025, (inner.sum(), 2))
    bent = [(LEFT, 0, 0.0), (LEFT, 1, 0.0), (RIGHT, 1, lambda t: 1e-3 * t)]
    return xf.Scene(
        xf.explode(mesh, facet_tags=side_tags(mesh, (2.0, 1.0))),
        {1: xf.materials.LinearElastic(1.0, 0.2, 1.0)},
        default_interaction=bond,
        loads=[xf.PrescribedDisplacement(*load) for load in bent],
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "seed, friction",
    [
        (24, 0.5),  # corrections for given impulses go round in circles between stick and slip
        (4, 0.8),  # contacts round a node creep before one of them lets go
        (0, 1.2),
        (21, 1.2),
    ],
)
def test_friction_on_a_crooked_mesh_converges_to_the_tolerance(seed, friction):
    """Newton's method goes round in circles; contacts are found by the method of multipliers."""
    scene = crooked(seed, CohesiveZone(40.0, 1e9, 1e-2, friction=friction))
    simulation = static(scene, max_halvings=0)
    (step,) = run(simulation, 1)
    _, slid = check_lips(simulation, 40.0, friction)
    assert slid.sum() > 10
    assert abs(step.energies["closure"]) < 1e-8 * step.energies["external_work"]


def test_a_first_step_along_a_path_with_friction(monkeypatch):
    """Its growth is cut three times; its contacts are found once, and are those of its load."""
    calls, find = [], monolithic_scheme.find_contacts

    def counted(step, good, most):
        calls.append(step.growth is not None)
        return find(step, good, most)

    monkeypatch.setattr(monolithic_scheme, "find_contacts", counted)
    scene = crooked(0, CohesiveZone(400.0, 1e-3, 1e-2, friction=0.6))
    simulation = static(scene, path=xf.GrowthControl())
    step = next(simulation.steps(1e4))
    assert simulation.path.share < 0.4**2
    # to two tolerances
    assert sum(calls) == 2
    damage = simulation.interactions.gather("damage")
    _, slid = check_lips(simulation, 400.0 * damage, 0.6)
    assert slid.sum() > 10 and damage.min() < 1.0
    given = xf.Simulation(scene, step.time, inertia=False, newton_tolerance=1e-10)
    run(given, 1)
    assert given.reaction(RIGHT)[1] == pytest.approx(simulation.reaction(RIGHT)[1], rel=1e-6)


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_lips_that_were_open_close_where_they_meet(friction):
    """Pulled, then pressed, then pulled again: the gap counts, not the motion of the step alone."""
    bodies = box_bodies((1.0, 1.0), (2, 1), "quadrilateral", label=lambda x: x[0] > 0.5)
    soft = CohesiveZone(E, 1e3, 3e6, friction=friction)  # gives as much as the bar
    path = ([0.0, 1.0, 2.0, 3.0, 4.0], [0.0, 1e-6, 1e-7, -1e-6, 1e-6])
    loads = [xf.PrescribedDisplacement(LEFT, 0, 0.0), xf.PrescribedDisplacement(BOTTOM, 1, 0.0)]
    loads.append(xf.PrescribedDisplacement(RIGHT, 0, lambda t: np.interp(t, *path)))
    material = xf.materials.LinearElastic(E, 0.0, 2400.0)
    simulation = static(xf.Scene(bodies, {1: material}, default_interaction=soft, loads=loads))
    for count in (1, 2, 3, 4):
        run(simulation, 1)
        moved = path[1][count]
        jump = simulation.interactions.gather("jump")[:, 0]
        np.testing.assert_allclose(jump, max(0.5 * moved, 0.0), atol=1e-15)
        force = E * (0.5 * moved if moved > 0.0 else moved)
        assert simulation.reaction(RIGHT)[0] == pytest.approx(force, rel=1e-8)


@pytest.mark.parametrize(
    "given, far, ends", [(1.0, 1.5, True), (1.0, 2.5, False), (5.0, -2.0, True)]
)
def test_a_static_step_throws_nothing_away(monkeypatch, given, far, ends):
    """Forces balance wherever a body goes that nothing holds: not beyond the scene's size."""
    throws, extent = [], 2.0

    def moved(step, change=0.0):
        if np.any(change):
            return ask(step, change)
        step.extent = extent
        step.loading.wanted = np.full_like(step.velocity, given)
        step.velocity = np.full_like(step.velocity, given + far)
        throws.append(ask(step))
        return throws[-1]

    ask = CoupledStep.moved_too_far
    monkeypatch.setattr(CoupledStep, "moved_too_far", moved)
    simulation = static(strip(2, 10.0, PULLED), max_halvings=0)
    if ends:
        run(simulation, 1)
        assert throws == [0.0]
        return
    with pytest.raises(xf.ConvergenceError, match="a body that nothing holds moves by 3.5 m"):
        run(simulation, 1)


def test_stiff_bonds_are_one_body():
    """Bonds of 1e8 E/h against the mesh that was never cut."""
    cut = static(strip(4, 1e8, BENT))
    scene = cut.scene
    bodies = box_bodies((LX, LY), (16, 4), label=0)
    one = static(xf.Scene(bodies, scene.materials, loads=scene.loads))
    run(cut, 1)
    run(one, 1)
    assert np.abs(field(cut)).max() == pytest.approx(np.abs(field(one)).max(), rel=1e-6)


def squares(count):
    """The unit square in quadrilaterals."""
    return mesh_of((1.0, 1.0), (count, count), "quadrilateral")


SHEAR = {"12": 0.0, "21": 0.0}
ELASTIC = xf.materials.LinearElastic(young=1.0, poisson=0.3, density=1.0)
# With the mean damage of a step bonds of a bar in tension may break in more than one way.
BOND = CohesiveZone(10.0, 5e-4, 1e-2, friction=0.3, damage="lagged")


def moving(material=ELASTIC, bond=BOND, kind="crossed", **options):
    lengths, cells = ((2.0, 1.0), (4, 2)) if kind == "crossed" else ((2.0, 1.0, 1.0), (2, 1, 1))
    bodies = box_bodies(lengths, cells, kind, label=options.pop("label", None))
    loads = [xf.PrescribedVelocity(LEFT, 0, 0.0), xf.PrescribedVelocity(RIGHT, 0, 0.02)]
    return xf.Scene(bodies, {1: material}, loads=loads, default_interaction=bond, **options)


def pressed():
    """Two blocks that slide on each other, on a wall."""
    bodies = box_bodies((2.0, 1.0), (4, 2), label=lambda x: x[1] > 0.5)
    slide = SignoriniCoulomb(0.2, contact="position")
    return xf.Scene(
        bodies, {1: ELASTIC}, default_interaction=slide,
        walls=[xf.Wall(BOTTOM, (0.0, 0.0), (0.0, 1.0), slide)],
        loads=[xf.SurfaceTraction(TOP, (2e-3, -1e-2)), xf.BodyForce((0.0, -1e-3))],
    )  # fmt: skip


SCENES = {
    "breaking plate": moving,
    "gauss points": lambda: moving(points="gauss", label=lambda x: x[0] > 1.0),
    "solid": lambda: moving(kind="tetrahedron"),
    "neo-Hookean": lambda: moving(xf.materials.NeoHookean(young=1.0, poisson=0.3, density=1.0)),
    "plastic": lambda: moving(
        xf.materials.J2SmallStrain(
            young=1.0,
            poisson=0.3,
            density=1.0,
            yield_stress=5e-3,
            hardening=xf.materials.Linear(0.1),
        )
    ),
    "perfect bonds": lambda: moving(bond=PerfectBond()),
    "frictional blocks": pressed,
}


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("theta", [0.5, 1.0])
def test_a_step_with_inertia_is_that_of_the_sweeps(name, theta):
    """Any law in any bulk: the same histories as by sweeps, to their tolerance."""
    ends = []
    for solver in ("monolithic", "nlgs"):
        simulation = xf.Simulation(
            SCENES[name](), 0.2, scheme="implicit", theta=theta, solver=solver, tolerance=1e-9,
            newton_tolerance=1e-10,
        )  # fmt: skip
        *_, last = run(simulation, 12)
        ends.append((field(simulation), last.energies))
    (ours, energies), (theirs, expected) = ends
    assert np.abs(ours - theirs).max() < 1e-6 * np.abs(theirs).max()
    size = max(abs(v) for v in expected.values())
    for name, value in expected.items():
        assert energies[name] == pytest.approx(value, abs=2e-6 * size), name


@pytest.mark.parametrize("driven", ["gradient", "stress"])
def test_a_cell_whose_bodies_bonds_alone_hold(driven):
    """Squares that bonds join across the boundary too: springs in series with the solid.

    Pulled along x by e (or by its stress), free of lateral strain: s = e / (1/E + 1/(K d)) for
    squares of side d, as nu = 0.
    """
    young, k, strain = 2.0, 8.0, 1e-3
    bodies = xf.explode(squares(4), lattice=(1.0, 1.0))
    stress = strain / (1.0 / young + 1.0 / (k * 0.25))
    gradient = {"11": lambda t: 1.0 + strain * t, "22": 1.0} | SHEAR
    drive = {"gradient": gradient}
    if driven == "stress":
        del gradient["11"]
        drive["stress"] = {"11": lambda t: stress * t}
    scene = xf.Scene(
        bodies, {1: xf.materials.LinearElastic(young, 0.0, 1.0)},
        default_interaction=CohesiveZone(k, 1.0, 1.0), macroscopic=xf.MacroscopicDrive(**drive),
    )  # fmt: skip
    simulation = static(scene)
    run(simulation, 1)
    assert simulation.macroscopic.stress[0, 0] == pytest.approx(stress, rel=1e-8)
    assert simulation.macroscopic.gradient[0, 0] - 1.0 == pytest.approx(strain, rel=1e-8)
    bonds = simulation.interactions.gather("jump")
    assert bonds[:, 0].max() == pytest.approx(stress / k, rel=1e-8)


def test_a_cell_that_nothing_joins_is_refused():
    bodies = xf.explode(squares(2), lattice=(1.0, 1.0))
    with pytest.raises(ValueError, match="4 bodies, which interactions do not join"):
        static(xf.Scene(
            bodies, {1: ELASTIC}, interactions={(1, 1): None},
            macroscopic=xf.MacroscopicDrive(gradient=dict.fromkeys(("11", "22"), 1.0) | SHEAR),
        ))  # fmt: skip


def test_what_it_cannot_take_is_refused():
    with pytest.raises(ValueError, match="monolithic solver takes meshed bodies"):
        xf.Simulation(moving(), 0.01, scheme="explicit", solver="monolithic")


def test_advice_without_bonds_names_no_path():
    """A block pushed off along a floor has no equilibrium, and no bonds to follow."""
    bodies = box_bodies((2.0, 1.0), (2, 2), "crossed", label=lambda x: x[1] > 0.5)
    loads = [xf.PrescribedDisplacement(BOTTOM, axis, 0.0) for axis in (0, 1)]
    push = xf.SurfaceTraction(TOP, (lambda t: 0.4 * t, -1.0))
    scene = xf.Scene(
        bodies, {1: xf.materials.LinearElastic(1e3, 0.3, 1.0)},
        default_interaction=xf.laws.SignoriniCoulomb(0.3), loads=[*loads, push],
    )  # fmt: skip
    simulation = xf.Simulation(scene, 0.1, inertia=False)
    with pytest.raises(xf.ConvergenceError, match="no bonds whose path could be followed"):
        list(simulation.steps(1.0))
    assert 0.7 < simulation.time < 0.75 + 1e-6  # 0.3 / 0.4
