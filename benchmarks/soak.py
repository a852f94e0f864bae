# SPDX-License-Identifier: LGPL-3.0-or-later
"""Random scenes for as long as one likes: no crash, no NaN, no leak, no open ledger.

    OPENBLAS_NUM_THREADS=1 ./fenicsx python3 benchmarks/soak.py --minutes 60

Scenes are drawn from seeds: bodies (triangles, quadrilaterals, tetrahedra, discs, polygons),
materials, laws, loads, schemes, solvers, steps. A process runs many of them, one after the other,
and says after each how much memory it holds; some run on two ranks, some are killed at a step
(their process ends at once, nothing is closed) and go on from their checkpoint in another process,
which has to reach the same bits as a run that was not killed. A scene may end in a
ConvergenceError, which is counted; anything else that is raised is a failure.

Of each step it is required that all energies are finite, that losses to cohesion, plastic flow and
viscosity do not fall, nor that to friction where no impact may turn it (restitution with friction
can gain energy, which is in the law), and that the ledger closes to 1e-9 of the largest energy
where it closes exactly: linear materials whose bodies do not turn.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from tqdm import tqdm

import xper_fx as xf

# Losses that never fall by more than the tolerance, or rounding, of the largest energy.
LOSSES, ROUNDING = ("cohesion", "plastic", "viscous"), 1e-7
CLOSED = 1e-9
# Energy (J/m) below which all is rounding: of strains of 1e-7 in a body of 1 Pa and 1 m.
NOTHING = 1e-14
# Scenes of a process. They are run twice: the first time loads what the second uses.
LIFE = 30
# Memory (MB a scene) by which a process may grow the second time.
LEAK = 0.2
# Of several ranks beside other work.
OF_RANKS = {
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_mpi_yield_when_idle": "true",
    "OMPI_MCA_hwloc_base_binding_policy": "none",
}
KILLED = 77  # exit status of a process that ends at a step
SIDES = {"left": 1, "right": 2, "bottom": 3, "top": 4}

# ------------------------------------------------------------------------------------- scenes


def draw(seed: int) -> dict[str, Any]:
    """What a scene is made of, by name; the same for a seed."""
    random = np.random.default_rng(seed)

    def pick(*choices):
        return choices[random.integers(len(choices))]

    kind = pick("plate", "plate", "plate", "solid", "cell", "heap", "drop", "static")
    return {
        "seed": seed,
        "kind": kind,
        "material": pick("elastic", "elastic", "svk", "neo-hookean", "j2", "viscoelastic"),
        "law": pick("cohesive", "cohesive", "frictional", "perfect", "contact"),
        "bodies": pick("cells", "cells", "halves", "blocks"),
        "shape": pick("crossed", "crossed", "quadrilateral"),
        "cells": [int(random.integers(1, 5)), int(random.integers(1, 4))],
        "scheme": pick("implicit", "implicit", "explicit"),
        "theta": pick(0.5, 0.5, 0.7, 1.0),
        "solver": pick("auto", "auto", "nlgs", "newton", "accelerated"),
        "tolerance": float(10.0 ** -random.integers(2, 8)),
        "accuracy": pick(None, None, 1e-1, 1e-2),
        "courant": float(random.uniform(0.3, 0.9)),
        "longer": float(pick(1.0, 1.0, 5.0, 30.0)),
        "speed": [float(v) for v in random.normal(0.0, 0.05, 2)],
        "gravity": [float(v) for v in random.normal(0.0, 0.02, 3)],
        "stiffness": float(10.0 ** random.uniform(0.0, 3.0)),
        "energy": float(10.0 ** random.uniform(-5.0, -3.0)),
        "strength": float(10.0 ** random.uniform(-2.5, -1.0)),
        "friction": float(random.uniform(0.0, 1.0)),
        "restitution": float(pick(0.0, 0.0, 0.5, 1.0)),
        "grains": int(random.integers(2, 12)),
        "steps": int(random.integers(5, 60)),
        "rotation": float(pick(0.0, 0.0, 0.5)),
    }


def material(spec: dict) -> Any:
    """The material of all bodies."""
    m = xf.materials
    return {
        "elastic": lambda: m.LinearElastic(1.0, 0.3, 1.0),
        "svk": lambda: m.SaintVenantKirchhoff(1.0, 0.3, 1.0),
        "neo-hookean": lambda: m.NeoHookean(1.0, 0.3, 1.0),
        "j2": lambda: m.J2SmallStrain(1.0, 0.3, 0.01, m.Linear(0.1), 1.0),
        "viscoelastic": lambda: m.LinearViscoelastic(1.0, 0.3, ((0.4, 1.0),), 1.0),
    }[spec["material"]]()


def law(spec: dict) -> Any:
    """The law of all facing facets."""
    # a bond that re-hardens is refused: its strength is reached before it is spent
    least = 1.05 * spec["strength"] ** 2 / (2.0 * spec["energy"])
    stiffness = max(spec["stiffness"], least)
    bond = (stiffness, spec["energy"], spec["strength"])
    return {
        "cohesive": lambda: xf.laws.CohesiveZone(*bond),
        "frictional": lambda: xf.laws.CohesiveZone(*bond, friction=spec["friction"]),
        "perfect": xf.laws.PerfectBond,
        "contact": lambda: xf.laws.SignoriniCoulomb(spec["friction"]),
    }[spec["law"]]()


def meshed(spec: dict, dim: int) -> xf.Bodies:
    """Bodies of a rectangle or a box, sides tagged."""
    from dolfinx.mesh import CellType, create_rectangle, create_unit_cube

    from xper_fx.support.compat import geometry_dofmap

    nx, ny = spec["cells"]
    comm, size = MPI.COMM_SELF, (0.5 * nx, 0.5 * ny)
    if dim == 3:
        mesh, size = create_unit_cube(comm, 1, 1, min(nx, 2)), (1.0, 1.0)
    elif spec["shape"] == "crossed":
        mesh = xf.crossed_rectangle((0.0, 0.0), size, (nx, ny), comm)
    else:
        kind = CellType.quadrilateral
        mesh = create_rectangle(comm, [(0.0, 0.0), size], (nx, ny), kind)
    tags = xf.tag_facets(
        mesh,
        {
            SIDES["left"]: lambda x: x[0] < 1e-9,
            SIDES["right"]: lambda x: x[0] > size[0] - 1e-9,
            SIDES["bottom"]: lambda x: x[1] < 1e-9,
            SIDES["top"]: lambda x: x[1] > size[1] - 1e-9,
        },
    )
    middle = mesh.geometry.x[geometry_dofmap(mesh)].mean(axis=1)
    labels = {
        "cells": np.arange(len(middle)),
        "halves": (middle[:, 0] > 0.5 * size[0]).astype(int),
        "blocks": np.floor(2.0 * middle[:, :2]).astype(int) @ np.array([1, 100]),
    }[spec["bodies"]]
    lattice = size if spec["kind"] == "cell" else None
    return xf.explode(mesh, labels, facet_tags=tags, lattice=lattice)


def rigid_heap(spec: dict) -> list:
    """Discs and squares above a floor between two walls."""
    random = np.random.default_rng(spec["seed"])
    floor = [
        xf.rigid.wall((0.0, 0.0), (0.0, 1.0), "box"),
        xf.rigid.wall((0.0, 0.0), (1.0, 0.0), "box"),
        xf.rigid.wall((1.0, 0.0), (-1.0, 0.0), "box"),
    ]
    bodies = []
    for k in range(spec["grains"]):
        place = (0.2 + 0.25 * (k % 3) + 0.03 * random.random(), 0.15 + 0.25 * (k // 3))
        shape = xf.rigid.Disc(0.1) if random.random() < 0.6 else xf.rigid.Polygon.box((0.15, 0.15))
        bodies.append(
            xf.RigidBody(shape, place, "grains", density=10.0, spin=float(random.normal()))
        )
    return floor + bodies


def build(spec: dict) -> xf.Simulation:
    """The simulation of what was drawn."""
    kind, contact = spec["kind"], xf.laws.SignoriniCoulomb(spec["friction"], spec["restitution"])
    options: dict[str, Any] = {"num_threads": 1, "tolerance": spec["tolerance"]}
    if kind == "heap":
        scene = xf.Scene(
            rigid=rigid_heap(spec),
            contacts=[
                xf.Contact(("grains", "grains"), contact), xf.Contact(("grains", "box"), contact),
            ],
            loads=[xf.Gravity((spec["gravity"][0], -9.81))],
        )  # fmt: skip
        return xf.Simulation(scene, 2e-3 * spec["courant"], max_sweeps=4000, **options)
    dim = 3 if kind == "solid" else 2
    bodies = meshed(spec, dim)
    given: dict[str, Any] = {"default_interaction": law(spec)}
    left, right = SIDES["left"], SIDES["right"]
    u, v = spec["speed"]
    if kind == "cell":
        given["macroscopic"] = xf.MacroscopicDrive(
            rate={"11": u, "12": v}, gradient={"21": 0.0}, stress={"22": 0.0}
        )
    elif kind == "static":
        given["loads"] = [
            *(xf.PrescribedDisplacement(left, i, 0.0) for i in range(dim)),
            xf.PrescribedDisplacement(right, 0, lambda t: u * t),
            xf.PrescribedDisplacement(right, 1, lambda t: v * t * t),
        ]
    elif kind == "drop":
        given["walls"] = [xf.Wall(SIDES["bottom"], (0.0, -0.01), (0.0, 1.0), contact)]
        given["loads"] = [xf.Gravity(tuple(spec["gravity"][:2]))]
        given["initial_velocity"] = lambda x: np.stack([u + 0 * x[0], -abs(v) - 0.02 + 0 * x[0]])
    else:
        given["loads"] = [
            xf.PrescribedVelocity(left, 0, 0.0), xf.PrescribedVelocity(right, 0, u),
            xf.Gravity(tuple(spec["gravity"][:dim])),
        ]  # fmt: skip
        spin = spec["rotation"]
        given["initial_velocity"] = lambda x: np.stack(
            [-0.1 * spin * x[1] * x[0], v * x[0], *([0 * x[0]] * (dim - 2))]
        )
    scene = xf.Scene(bodies, {1: material(spec)}, **given)
    if kind == "static":
        return xf.Simulation(scene, 0.1, theta=1.0, inertia=False, **options)
    explicit = spec["scheme"] == "explicit" and kind != "cell"
    options["scheme"] = "explicit" if explicit else "implicit"
    if not explicit:
        options |= {"theta": spec["theta"], "solver": spec["solver"]}
    if spec["accuracy"] is not None:
        return xf.Simulation(scene, accuracy=spec["accuracy"], **options)
    step = spec["courant"] * xf.Simulation(scene, num_threads=1).bulk.critical_step()
    return xf.Simulation(scene, step * (1.0 if explicit else spec["longer"]), **options)


def closes_exactly(spec: dict, simulation: xf.Simulation) -> bool:
    """Whether the ledger closes to rounding: whatever breaks, where the bulk is linear."""
    linear = spec["kind"] == "heap" or spec["material"] == "elastic"
    return linear and spec["kind"] != "static" and simulation.bulk.dim == 2


def may_turn_friction(spec: dict) -> bool:
    """Whether contacts at the velocity level rub: their friction opposes the slip at the end."""
    return spec["kind"] in ("heap", "drop") or spec["law"] == "contact"


# ------------------------------------------------------------------------------------- one run


def run(spec: dict, folder: Path | None = None, stop_at: int = 0, restart: bool = False) -> dict:
    """What came of a scene: "ended" or "gave up", and the energies at its end.

    Args:
        spec: what was drawn.
        folder: where it is recorded; nowhere if None.
        stop_at: step at which the process ends at once; 0 for never.
        restart: whether to go on from the folder's checkpoint.

    Raises:
        AssertionError: something is wrong with a step.
    """
    simulation = build(spec)
    end = spec["steps"] * simulation.step_size
    if spec["kind"] == "cell":  # a cell that is driven inside out is refused
        end = min(end, 0.3 / max(np.abs(spec["speed"])))
    recorder = None
    if folder is not None:
        recorder = xf.Recorder(
            simulation, folder, end_time=end, fields=0, checkpoint_every=1e-9, restart=restart
        )
    exact, largest, lost = closes_exactly(spec, simulation), NOTHING, None
    names = LOSSES if may_turn_friction(spec) else (*LOSSES, "friction")
    try:
        for step in simulation.steps(end):
            e = step.energies
            assert all(np.isfinite(v) for v in e.values()), f"not finite: {e}"
            losses = np.array([e.get(f"dissipated_{name}", 0.0) for name in names])
            held = e["kinetic"] + e["elastic"] + e["cohesive"]
            largest = max(largest, held, abs(e["external_work"]), losses.sum())
            opened = abs(e["closure"]) / largest
            assert not exact or opened <= CLOSED, f"open by {opened:.1e}"
            if lost is not None:
                fall = (lost - losses).max()
                bound = max(ROUNDING, simulation.tolerance) * largest
                assert fall <= bound, f"a loss falls by {fall / largest:.1e}"
            lost = losses
            if recorder is not None:
                recorder.record(step)
            if step.step == stop_at:
                os._exit(KILLED)
        outcome = "ended"
    except (xf.ConvergenceError, xf.NotFiniteError) as error:
        assert len(str(error)) > 60, str(error)
        outcome = "gave up"
    if recorder is not None:
        recorder.close()
    state = simulation.state
    return {
        "outcome": outcome, "steps": simulation.step_number,
        "energies": {k: float(v) for k, v in simulation.ledger.as_columns().items()},
        "sum": [float(state.displacement.sum()), float(np.abs(state.velocity).sum())],
    }  # fmt: skip


def resident() -> float:
    """Memory of this process (MB)."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024.0
    return 0.0


def live(first: int, count: int) -> None:
    """Run scenes one after the other, twice, a line of JSON for each."""
    rank = MPI.COMM_WORLD.rank
    for seed in 2 * list(range(first, first + count)):
        spec = draw(seed)
        try:
            found = run(spec)
        except Exception as error:  # noqa: BLE001 - whatever it is, it is reported
            found = {"outcome": "failed", "why": f"{type(error).__name__}: {error}"[:600]}
        gc.collect()
        if rank == 0:
            line = {"seed": seed, "kind": spec["kind"], "memory": resident(), **found}
            print(json.dumps(line), flush=True)


# ------------------------------------------------------------------------------------- many


def child(arguments: list[str], ranks: int = 1, limit: float = 1800.0) -> tuple[int, list[dict]]:
    """Run this script in a process, or in as many as there are ranks; its status and its lines."""
    command = [sys.executable, __file__, *arguments]
    if ranks > 1:
        command = ["mpirun", "--oversubscribe", "-n", str(ranks), *command]
    # ranks that share one core yield to each other at once, whatever else the machine does
    core = partial(os.sched_setaffinity, 0, sorted(os.sched_getaffinity(0))[:1])
    # a rank finds its number in its environment: a process started from a rank is none
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=limit, env=os.environ | OF_RANKS,
        preexec_fn=core if ranks > 1 else None,
    )  # fmt: skip
    lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    if done.returncode not in (0, KILLED):
        lines.append({"outcome": "failed", "why": done.stderr[-600:], "seed": arguments})
    return done.returncode, lines


def kill_and_restart(seed: int) -> dict:
    """Kill a scene at a step, let another process end it, compare with one that was not killed."""
    spec = draw(seed)
    with tempfile.TemporaryDirectory() as folder:
        stop = 1 + seed % max(spec["steps"] // 2, 1)
        status, lines = child(["--one", str(seed), "--folder", folder, "--stop-at", str(stop)])
        if status != KILLED:
            return lines[-1] | {"seed": seed}
        _, (again,) = child(["--one", str(seed), "--folder", folder, "--restart"])
    _, (whole,) = child(["--one", str(seed)])
    if again["outcome"] != "failed" and any(again[k] != whole[k] for k in ("sum", "steps")):
        return {"seed": seed, "outcome": "failed", "why": f"restarted {again}, whole {whole}"}
    return again | {"seed": seed, "outcome": f"restarted, {again['outcome']}"}


def growth(memory: list[float]) -> float:
    """Memory that a process gains a scene the second time (MB), by least squares."""
    old = np.array(memory[len(memory) // 2 :])
    return float(np.polyfit(np.arange(len(old)), old, 1)[0]) if len(old) > 2 else 0.0


def soak(minutes: float, first: int) -> bool:
    """Run scenes for some minutes; whether all was well."""
    end, seed = time.monotonic() + 60.0 * minutes, first
    counts: Counter[str] = Counter()
    failures, leaks, ranks = [], [], shutil.which("mpirun") is not None
    with tqdm(total=round(60 * minutes), unit="s", desc="soak") as bar:
        while time.monotonic() < end:
            _, lines = child(["--live", str(seed), "--count", str(LIFE)])
            leaks.append(growth([line["memory"] for line in lines if "memory" in line]))
            for line in lines:
                counts[line["outcome"]] += 1
                if line["outcome"] == "failed":
                    failures.append(line)
            seed += LIFE
            if ranks:
                _, lines = child(["--live", str(seed), "--count", "4"], ranks=2)
                for line in lines:
                    counts[f"two ranks, {line['outcome']}"] += 1
                    if line["outcome"] == "failed":
                        failures.append(line | {"ranks": 2})
            for number in range(seed + 4, seed + 7):
                line = kill_and_restart(number)
                counts[line["outcome"]] += 1
                if line["outcome"].endswith("failed"):
                    failures.append(line)
            seed += 7
            bar.n = min(round(60 * minutes - (end - time.monotonic())), bar.total)
            bar.refresh()
    for line in failures:
        print(json.dumps(line))
    print(", ".join(f"{count} {name}" for name, count in sorted(counts.items())))
    worst = max(leaks, default=0.0)
    print(f"memory of {len(leaks)} processes of {2 * LIFE} scenes: at most {worst:+.2f} MB a scene")
    return not failures and worst < LEAK


def main() -> int:
    """Soak, or one part of it."""
    parser = argparse.ArgumentParser(description="Random scenes for some time.")
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0, help="of the first scene")
    parser.add_argument("--live", type=int, help="run --count scenes from this seed on")
    parser.add_argument("--count", type=int, default=LIFE)
    parser.add_argument("--one", type=int, help="run one scene")
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--stop-at", type=int, default=0)
    parser.add_argument("--restart", action="store_true")
    options = parser.parse_args()
    if options.live is not None:
        live(options.live, options.count)
    elif options.one is not None:
        try:
            found = run(draw(options.one), options.folder, options.stop_at, options.restart)
        except Exception as error:  # noqa: BLE001 - whatever it is, it is reported
            found = {"outcome": "failed", "why": f"{type(error).__name__}: {error}"[:600]}
        print(json.dumps(found))
    else:
        return 0 if soak(options.minutes, options.seed) else 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
