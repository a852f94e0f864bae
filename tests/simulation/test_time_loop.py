# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the time loop asks of its parts: tolerances, cut steps, gaps in the middle of the step."""

from types import SimpleNamespace

import numpy as np
import pytest
from scenes import LEFT, RIGHT, box_bodies, field, nodes

import xper_fx as xf
from xper_fx.nscd.solvers import UnsuitableSolverError
from xper_fx.simulation.domain_decomposition import decomposed

BOND = xf.laws.CohesiveZone(100.0, 1.0, 1.0)
LOADS = [xf.PrescribedVelocity(LEFT, 0, 0.0), xf.PrescribedVelocity(RIGHT, 0, 1.0)]


def bonded(**options) -> xf.Simulation:
    """Bonded triangles that are pulled."""
    scene = xf.Scene(
        box_bodies((1, 1), (2, 2)), {1: xf.materials.LinearElastic(100.0, 0.3, 1.0)},
        default_interaction=BOND, loads=LOADS,
    )  # fmt: skip
    return xf.Simulation(scene, 1e-3, num_threads=1, scheme="implicit", **options)


class Watched(xf.solvers.NonlinearGaussSeidel):
    """Remembers the tolerances that it was asked for."""

    def __init__(self):
        self.asked = []

    def solve(self, interactions, velocity, options):
        self.asked.append(options.tolerance)
        return super().solve(interactions, velocity, options)


def test_the_solver_is_asked_for_the_present_tolerance():
    solver = Watched()
    simulation = bonded(tolerance=1e-4, solver=solver)
    steps = simulation.steps(3e-3)
    next(steps)
    simulation.tolerance = 1e-7
    next(steps)
    assert set(solver.asked) == {1e-4, 1e-7} and solver.asked[-1] == 1e-7
    assert sorted(solver.asked, reverse=True) == solver.asked


@pytest.mark.parametrize(("halvings", "count"), [(0, 1), (1, 2), (6, 4)])
def test_a_step_in_which_a_material_flows_too_far_is_cut(halvings, count):
    """A uniaxial strain of 0.2 is an equivalent one of 0.133: 0.067 in a half, 0.033 in a quarter.

    0.05 are allowed; where the step may be halved once, both halves are taken as they are.
    """
    material = xf.materials.J2SmallStrain(100.0, 0.3, 0.1, xf.materials.Linear(1.0), 1.0)
    loads = [xf.PrescribedDisplacement(LEFT, c, 0.0) for c in (0, 1)]
    loads += [xf.PrescribedDisplacement(RIGHT, 0, lambda t: 0.2 * t)]
    loads += [xf.PrescribedDisplacement(RIGHT, 1, 0.0)]
    scene = xf.Scene(box_bodies((1, 1), (1, 1), label=0), {1: material}, loads=loads)
    simulation = xf.Simulation(scene, 1.0, theta=1.0, inertia=False, max_halvings=halvings)
    sizes = [step.size for step in simulation.steps(1.0)]
    assert sizes == [1.0 / count] * count


@pytest.mark.parametrize("theta", [0.5, 1.0])
@pytest.mark.parametrize("gap", [2.4, 2.9])
def test_a_contact_acts_from_the_step_in_whose_middle_it_is_closed(gap, theta):
    """A disc flies at a wall, `gap` steps away; it stops where x0 + h (1 - theta) v0 puts it."""
    radius, speed, step = 1.0, 1.0, 1e-3
    ball = xf.RigidBody(
        xf.rigid.Disc(radius), (0.0, radius + gap * step * speed), "ball", density=1.0,
        velocity=(0.0, -speed),
    )  # fmt: skip
    scene = xf.Scene(
        rigid=[ball, xf.rigid.wall((0.0, 0.0), (0.0, 1.0), "wall")],
        contacts=[xf.Contact(("ball", "wall"), xf.laws.SignoriniCoulomb(0.0))],
    )
    simulation = xf.Simulation(scene, step, theta=theta, tolerance=1e-12, num_threads=1)
    for _ in simulation.steps(8 * step):
        pass
    # gaps at x0 + h (1 - theta) v0 of the steps, in units of h v: the first that is not positive
    middle = gap - (1.0 - theta) - np.arange(8)
    end = middle[middle <= 0.0][0]
    assert simulation.rigid.state.velocity[0, 1] == pytest.approx(0.0, abs=1e-12)
    assert (simulation.rigid.state.position[0, 1] - radius) / (step * speed) == pytest.approx(
        end, abs=1e-9
    )


@pytest.mark.parametrize("theta", [0.5, 0.7, 1.0])
@pytest.mark.parametrize("gap", [2.4, 2.9])
def test_a_meshed_body_touches_from_the_step_in_whose_middle_it_is_closed(gap, theta):
    """The same of a block of one cell, whose nodes are looked for at x0 + h (1 - theta) v0."""
    speed, step = 1.0, 1e-3
    scene = xf.Scene(
        box_bodies((1.0, 1.0), (1, 1), "quadrilateral", label=0),
        {1: xf.materials.LinearElastic(1e-9, 0.0, 1.0)},
        initial_velocity=lambda x: np.stack([0.0 * x[0], 0.0 * x[0] - speed]),
        surfaces={"block": (1,)},
        rigid=[xf.rigid.wall((0.0, -gap * step * speed), (0.0, 1.0), "wall")],
        contacts=[xf.Contact(("block", "wall"), xf.laws.SignoriniCoulomb(0.0))],
    )
    simulation = xf.Simulation(
        scene, step, scheme="implicit", theta=theta, tolerance=1e-12, num_threads=1
    )
    for _ in simulation.steps(8 * step):
        pass
    middle = gap - (1.0 - theta) - np.arange(8)
    end = middle[middle <= 0.0][0]
    lowest = nodes(simulation)[:, 1] < 0.5
    moved = field(simulation)[lowest, 1] / (step * speed)
    np.testing.assert_allclose(field(simulation, "velocity")[lowest, 1], 0.0, atol=1e-9)
    np.testing.assert_allclose(moved + gap, end, atol=1e-6)


class Silent(xf.solvers.Solver):
    """Says nothing."""

    def solve(self, interactions, velocity, options):
        return None


@pytest.mark.parametrize("solver", [xf.solvers.NewtonOnAllPoints, print, None, ["nlgs"]])
def test_what_is_no_solver_is_refused(solver):
    with pytest.raises(TypeError, match="object of a class derived from xf.solvers.Solver"):
        bonded(solver=solver)


def test_a_solver_that_gives_no_report_is_named():
    with pytest.raises(TypeError, match="Silent.solve should return a SolveReport, got None"):
        next(bonded(solver=Silent()).steps(1.0))
    with pytest.raises(NotImplementedError, match="Solver has no method `solve`"):
        next(bonded(solver=xf.solvers.Solver()).steps(1.0))


def test_a_solver_of_ones_own_is_refused_on_several_ranks():
    """Before any rank does anything; it knows the points of one."""
    simulation, several = bonded(solver=Silent()), SimpleNamespace(alone=False, size=2, rank=0)
    scene, options, watch = simulation.scene, simulation.options, simulation.stopwatch
    with pytest.raises(UnsuitableSolverError, match=r"is a Silent, .* \(comm=MPI.COMM_SELF\)"):
        decomposed(scene, options, several, watch, None)


def test_only_a_function_saves_on_failure():
    with pytest.raises(TypeError, match=r"returns a file's path, got 'checkpoint\.h5'"):
        bonded().save_on_failure("checkpoint.h5")


def test_steps_that_were_left_are_refused():
    """One that was left is forgotten; it cannot go on when another has begun."""
    simulation = bonded()
    first = simulation.steps(4e-3)
    next(first)
    second = simulation.steps(3e-3)
    next(second)
    with pytest.raises(RuntimeError, match="steps.. to 0.004 s were left: others have begun"):
        next(first)
    assert [record.step for record in second] == [3] and simulation.time == pytest.approx(3e-3)


@pytest.mark.parametrize("read", ["reaction", "mean_displacement"])
@pytest.mark.parametrize(("tag", "error"), [(77, ValueError), ("left", TypeError)])
def test_a_tag_that_occurs_nowhere_is_not_read(read, tag, error):
    with pytest.raises(error, match=f"{tag}"):
        getattr(bonded(), read)(tag)


@pytest.mark.parametrize("solver", ["nlgs", "accelerated", "newton"])
def test_where_one_way_of_solving_does_not_get_on_the_error_names_another(solver):
    simulation = bonded(solver=solver, tolerance=1e-12, max_sweeps=1, max_halvings=0)
    with pytest.raises(xf.ConvergenceError, match='solver="auto" takes another.*more sweeps'):
        list(simulation.steps(1e-3))
    simulation = bonded(solver="auto", tolerance=1e-12, max_sweeps=1, max_halvings=0)
    with pytest.raises(xf.ConvergenceError, match="more sweeps") as caught:
        list(simulation.steps(1e-3))
    assert "solver=" not in str(caught.value)
