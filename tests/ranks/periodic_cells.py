# SPDX-License-Identifier: LGPL-3.0-or-later
"""Periodic cells of several bodies, run by all ranks together; the first writes what came out."""

import sys

import numpy as np
import scenes
from cells import cell_of
from mpi4py import MPI

from xper_fx.materials import J2SmallStrain, LinearElastic, NeoHookean
from xper_fx.materials.hardening import Linear
from xper_fx.nscd.laws import CohesiveZone
from xper_fx.output.recorder import macroscopic_columns
from xper_fx.parallel.launch import run_together
from xper_fx.periodic.drive import MacroscopicDrive
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

# Steps that waves cross a cell in, for which sweeps alone converge fast.
DENSITY, STEP = 10.0, 0.02
BOND = CohesiveZone(6e2, 0.1, 3.0, friction=0.2)
HELD = MacroscopicDrive(rate={"11": 0.24}, gradient={"12": 0.0, "21": 0.0, "22": 1.0})


def mixed(rate):
    """Stresses are asked for: the macroscopic gradient hangs on the sums over all bodies."""
    stress = {"22": lambda t: -rate / 0.12 * t, "12": 0.0}
    return MacroscopicDrive(rate={"11": rate, "21": rate / 4}, stress=stress)


MIXED, FASTER = mixed(0.12), mixed(0.24)


def grain(x):
    """Six grains of two columns each, in rows like bricks, moved: three cross the boundary."""
    x, y = x[0] - 1 / 6, x[1] - 1 / 3
    row = np.floor(3.0 * (y % 1.0) + 1e-9)
    return 3 * row + np.floor(3.0 * ((x - row / 6.0) % 1.0) + 1e-9)


def grains(kind, drive, second=None, order=1):
    """Hard grains among soft ones; they are tied to themselves across the boundary."""
    bodies = cell_of(
        (1, 1), (6, 3), "quadrilateral", label=grain, material={2: lambda x: grain(x) % 4 == 1}
    )
    assert len(bodies.ties) > 0 or bodies.spread is not None
    materials = {1: kind, 2: second or type(kind)(300.0, 0.2, DENSITY)}
    return Scene(bodies, materials, default_interaction=BOND, macroscopic=drive, order=order)


def small_strain():
    return grains(LinearElastic(100.0, 0.3, DENSITY), FASTER), 11


def finite_strain():
    # of a faster one steps are cut, on two ranks others than on one
    return grains(NeoHookean(100.0, 0.3, DENSITY), MIXED), 22


def held():
    """No stress is asked for: there is no border."""
    return grains(LinearElastic(100.0, 0.3, DENSITY), HELD, order=2), 14


def plastic():
    """Soft grains flow before the bonds soften; a rank may have hard ones alone."""
    soft = J2SmallStrain(100.0, 0.3, 2.5, Linear(20.0), DENSITY)
    return grains(soft, FASTER, LinearElastic(300.0, 0.2, DENSITY)), 12


def each_cell():
    """Each triangle a body, many of which face bodies of other ranks across the boundary."""
    bodies = cell_of(
        (1, 1), (3, 2), label=None, material={2: lambda x: (x[0] > 0.5) & (x[1] < 0.5)}
    )
    materials = {1: LinearElastic(100.0, 0.3, DENSITY), 2: LinearElastic(300.0, 0.2, DENSITY)}
    drive = MacroscopicDrive(rate={"11": 0.25, "21": 0.06}, stress={"22": 0.0, "12": 0.0})
    return Scene(bodies, materials, default_interaction=BOND, macroscopic=drive), 26


SCENES = {f.__name__: f for f in (small_strain, finite_strain, held, plastic, each_cell)}


def run(name: str) -> dict[str, np.ndarray]:
    """History of a cell, one value a step and column, the same on every rank.

    Where the name begins with "spread_" the mesh is spread over the ranks, and a run that is
    restarted says its elastic energy at the end.
    """
    spread = name.startswith("spread_")
    scenes.COMM = MPI.COMM_WORLD if spread else MPI.COMM_SELF
    scene, steps = SCENES[name.removeprefix("spread_")]()
    scenes.COMM = MPI.COMM_SELF
    options = {"theta": 0.7, "tolerance": 1e-8, "newton_tolerance": 1e-9, "solver": "nlgs"}
    simulation = Simulation(scene, STEP, num_threads=1, **options)
    world = simulation.team.comm
    unknowns = simulation.bulk.unknowns
    history: dict[str, list] = {}
    for record in simulation.steps(steps * STEP):
        state = simulation.state
        replicated = [v[unknowns.macroscopic].tobytes() for v in vars(state).values() if np.ndim(v)]
        assert len(set(world.allgather(tuple(replicated)))) == 1  # to the bit
        momentum = simulation.ranks.sum(
            (simulation.bulk.mass * state.velocity)[: unknowns.macroscopic.start]
            .reshape(-1, 2)
            .sum(axis=0)
        )
        now = record.energies | macroscopic_columns(simulation)
        now |= {"time": record.time, "momentum_x": momentum[0], "momentum_y": momentum[1]}
        now |= {"norm": simulation.bulk.norm(state.velocity)}
        for key, value in now.items():
            history.setdefault(key, []).append(value)
        if spread and record.step == steps - 3:
            again = Simulation(scene, STEP, num_threads=1, **options)
            again.restore(simulation.saved_in_order())
    V, interactions = simulation.forms.V, simulation.interactions
    nodes, offsets = simulation.bodies.node_permutation(V)
    displacement = simulation.displacement.x.array.reshape(-1, 2)[nodes]
    of_bodies = np.add.reduceat(displacement, offsets[:-1]) / np.diff(offsets)[:, None]
    numbers = np.arange(len(of_bodies))
    if simulation.part is not None:
        numbers = scene.bodies.numbers_on_all(simulation.part.body_numbers)
    bodies = scene.bodies.facets.bodies
    shared = 0
    if simulation.part is not None:
        sides = simulation.part.rank_of_body[bodies]
        shared = np.count_nonzero(sides[:, 0] != sides[:, 1])
    found = {name: np.array(column) for name, column in history.items()}
    if spread:
        found["again"] = [record.energies["elastic"] for record in again.steps(steps * STEP)]
    return found | {
        "damage": interactions.gather("damage"),
        "jump": interactions.gather("jump"),
        "displacement": simulation.ranks.gather(numbers, of_bodies),
        "ranks": np.array(simulation.ranks.size),
        "shared": np.array(shared),
        "dofs": np.array(simulation.bulk.num_dofs_of_all),
    }


def main() -> None:
    """Run the cells named by the arguments, or all, into the folder that comes first."""
    for name in sys.argv[2:] or SCENES:
        found = run(name)
        if MPI.COMM_WORLD.rank == 0:
            np.savez(f"{sys.argv[1]}/{name}.npz", **found)


if __name__ == "__main__":
    run_together(main)
