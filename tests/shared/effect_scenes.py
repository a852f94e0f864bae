# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes that call for some effects, run in a process of their own under observation.

    python tests/shared/effect_scenes.py SCENE [CODE ...]

runs a scene and prints as JSON what was imported, called and compiled, what each step cost and
what came out. CODE is taken away before: a "module" cannot be imported, what stands at
"module:object" raises when it is touched. Without arguments it does so for each line of its input,
a list of these arguments as JSON, in a fork of its own: what has been imported before is not of the
package.
"""

from __future__ import annotations

import gc
import hashlib
import importlib.abc
import importlib.machinery
import inspect
import json
import os
import sys
import tempfile
import traceback
from collections import Counter
from pathlib import Path

import numpy as np
from numba.core.registry import CPUDispatcher

sys.path.insert(0, str(Path(__file__).parent))

STEPS = 3


# Scenes: their imports are within, as a user's script imports what it uses.


def _pulled(
    material, speed=1e-3, lengths=(2.0, 1.0), cells=(2, 1), label=0, kind="crossed", **options
):
    """A bar whose ends are pulled apart, held without inertia too; one body, or by `label`."""
    from scenes import BOTTOM, LEFT, RIGHT, box_bodies

    from xper_fx.forms.loads import PrescribedVelocity
    from xper_fx.scene.scene import Scene

    bodies = box_bodies(lengths, cells, kind, label=label)
    loads = [
        PrescribedVelocity(LEFT, 0, 0.0),
        PrescribedVelocity(RIGHT, 0, speed),
        PrescribedVelocity(BOTTOM, 1, 0.0),
    ]
    return Scene(bodies, {1: material}, loads=loads + options.pop("loads", []), **options)


def _elastic():
    from xper_fx.materials import LinearElastic

    return LinearElastic(young=1.0, poisson=0.3, density=1.0)


def _static(scene):
    from xper_fx.simulation.simulation import Simulation

    return Simulation(scene, 1.0, theta=1.0, inertia=False)


def static():
    return _static(_pulled(_elastic()))


def dynamic():
    from xper_fx.forms.loads import Gravity, RayleighDamping
    from xper_fx.materials import SaintVenantKirchhoff
    from xper_fx.simulation.simulation import Simulation

    material = SaintVenantKirchhoff(young=1.0, poisson=0.3, density=1.0)
    damping = RayleighDamping(mass=0.1, stiffness=0.1)
    scene = _pulled(material, loads=[Gravity((0.0, -0.01))], damping=damping)
    return Simulation(scene, accuracy=1e-2)


def plastic():
    from xper_fx.materials import J2SmallStrain, Linear

    material = J2SmallStrain(
        young=1.0, poisson=0.3, yield_stress=1e-3, hardening=Linear(0.1), density=1.0
    )
    return _static(_pulled(material))


def recorded():
    from xper_fx.materials import LinearViscoelastic
    from xper_fx.output.recorder import Recorder

    material = LinearViscoelastic(young=1.0, poisson=0.3, prony=[(0.5, 1.0)], density=1.0)
    simulation = _static(_pulled(material))
    Recorder(simulation, tempfile.mkdtemp(), end_time=1.0, fields=1).close()
    return simulation


def cell(**drive):
    from xper_fx.bodies.explode import explode
    from xper_fx.bodies.meshes import crossed_rectangle
    from xper_fx.periodic.drive import MacroscopicDrive
    from xper_fx.scene.scene import Scene

    mesh = crossed_rectangle((0, 0), (1, 1), (2, 2))
    bodies = explode(mesh, np.zeros(16, int), lattice=(1.0, 1.0))
    return _static(Scene(bodies, {1: _elastic()}, macroscopic=MacroscopicDrive(**drive)))


def stretched_cell():
    return cell(rate={"11": 1e-3}, gradient={"12": 0.0, "21": 0.0, "22": 1.0})


def loaded_cell():
    return cell(rate={"11": 1e-3}, gradient={"12": 0.0, "21": 0.0}, stress={"22": 0.0})


def _halves(midpoints):
    return midpoints[0] > 1.0


def _interacting(law, solver, step=0.1, **bar):
    """The bar cut in two."""
    from xper_fx.simulation.simulation import Simulation

    scene = _pulled(_elastic(), label=_halves, default_interaction=law, **bar)
    return Simulation(scene, step, tolerance=1e-10, num_threads=1, solver=solver)


def _falling(law, step, **options):
    """A block that falls on a wall."""
    from scenes import BOTTOM, box_bodies

    from xper_fx.scene import Scene, Wall
    from xper_fx.simulation.simulation import Simulation

    scene = Scene(
        box_bodies((1.0, 1.0), (1, 1), label=0),
        {1: _elastic()},
        walls=[Wall(BOTTOM, (0.0, 0.0), (0.0, 1.0), law)],
        initial_velocity=lambda x: [1e-3 + 0.0 * x[0], -1e-2 + 0.0 * x[0]],
    )
    return Simulation(scene, step, num_threads=1, **options)


def impact():
    from xper_fx.nscd.laws import SignoriniCoulomb

    return _falling(SignoriniCoulomb(), 0.1, solver="nlgs")


def sliding():
    from xper_fx.nscd.laws import SignoriniCoulomb

    return _falling(SignoriniCoulomb(0.3), None, scheme="explicit")


def bonded():
    from xper_fx.nscd.laws import CohesiveZone

    return _interacting(CohesiveZone(10.0, 1e-4, 1e-3), "nlgs")


def lagging():
    from xper_fx.nscd.laws import Adhesion

    return _interacting(Adhesion(10.0, 1e-6, 1e-6), "nlgs", speed=1e-2)


def uneven():
    from xper_fx.nscd.laws import MixedMode
    from xper_fx.nscd.laws.fields import Weibull

    return _interacting(MixedMode(10.0, (Weibull(1e-3, 9.0, 1), 2e-3), (1e-4, 2e-4), 2.0), "nlgs")


def closed():
    from xper_fx.nscd.laws import SignoriniCoulomb

    return _interacting(SignoriniCoulomb(0.3, contact="position"), "accelerated", speed=-1e-3)


def divided():
    """Run by two ranks, of which the first tells: it has two of the four bodies."""
    from xper_fx.nscd.laws import CohesiveZone
    from xper_fx.simulation.simulation import Simulation

    law = CohesiveZone(10.0, 1e-4, 1e-3)
    quarters = {"label": lambda midpoints: (2.0 * midpoints[0]).astype(int)}
    scene = _pulled(_elastic(), **quarters, default_interaction=law)
    return Simulation(scene, 0.1, tolerance=1e-10, num_threads=1, solver="nlgs")


def solid():
    from xper_fx.nscd.laws import PerfectBond

    mesh = {"lengths": (2.0, 1.0, 1.0), "cells": (2, 1, 1), "kind": "tetrahedron"}
    return _interacting(PerfectBond(), "nlgs", **mesh)


def stiff():
    from xper_fx.nscd.laws import PerfectBond

    return _interacting(PerfectBond(), "newton", step=100.0)


def _meeting(step=0.1, rigid=(), contacts=(), joints=()):
    """Blocks that fly at each other, or at rigid bodies."""
    from scenes import box_bodies

    from xper_fx.nscd.laws import SignoriniCoulomb
    from xper_fx.scene.contact import Contact
    from xper_fx.scene.scene import Scene
    from xper_fx.simulation.simulation import Simulation

    bodies = box_bodies((2.0, 1.0), (4, 2), label=_halves, material={2: _halves})
    other = "disc" if rigid else "right"
    surfaces = {"left": (1,)} if rigid else {"left": (1,), "right": (2,)}
    scene = Scene(
        bodies,
        dict.fromkeys((1, 2), _elastic()),
        default_interaction=None,
        interactions={(1, 2): None},
        surfaces=surfaces,
        rigid=rigid,
        joints=joints,
        contacts=[Contact(("left", other), SignoriniCoulomb()), *contacts],
        initial_velocity={1: lambda x: [1e-2 + 0.0 * x[0], 0.0 * x[0]]},
    )
    return Simulation(scene, step, num_threads=1, solver="nlgs")


def meeting():
    return _meeting()


def struck():
    from xper_fx.nscd.rigid import Disc, RigidBody

    disc = RigidBody(Disc(0.5), (-0.5005, 0.4), "disc", density=1.0, velocity=(2e-2, 0.0))
    return _meeting(rigid=[disc])


def jointed():
    """The disc hangs on a wire."""
    from xper_fx.nscd.rigid import Disc, RigidBody
    from xper_fx.scene import Tendon

    disc = RigidBody(Disc(0.5), (-0.5005, 0.4), "disc", density=1.0, velocity=(2e-2, 0.0))
    return _meeting(rigid=[disc], joints=[Tendon((None, disc), ((-0.5, 2.0), (-0.5, 0.5)))])


def caught():
    """By two boxes, one on the other, that are one body."""
    from xper_fx.nscd.rigid import Cluster, Polygon, RigidBody

    lower = Polygon([[-1.0, 0.0], [-0.0005, 0.0], [-0.0005, 0.5], [-1.0, 0.5]])
    boxes = Cluster([lower, Polygon(lower.vertices + [0.0, 0.5])])
    body = RigidBody(boxes, None, "disc", density=1.0, velocity=(2e-2, 0.0))
    return _meeting(rigid=[body])


def rolled():
    """A disc that strikes blocks and rolls off on a floor."""
    from xper_fx.nscd.laws import SignoriniCoulomb
    from xper_fx.nscd.rigid import Disc, RigidBody, wall
    from xper_fx.scene.contact import Contact

    disc = RigidBody(
        Disc(0.5), (-0.5005, 0.4), "disc", density=1.0, velocity=(2e-2, -1e-2), spin=0.1
    )
    floor = wall((0.0, -0.1), (0.0, 1.0), "floor")
    law = SignoriniCoulomb(0.3, rolling=0.1)
    contacts = [Contact(("disc", "floor"), law), Contact(("left", "floor"), None)]
    return _meeting(rigid=[disc, floor], contacts=contacts)


def sunk():
    """A disc that is thrown into the ground, by a fifth of its radius in a step."""
    from xper_fx.nscd.laws import SignoriniCoulomb
    from xper_fx.nscd.rigid import Disc, RigidBody, wall
    from xper_fx.scene.contact import Contact
    from xper_fx.scene.scene import Scene
    from xper_fx.simulation.simulation import Simulation

    rigid = [
        wall((0.0, 0.0), (0.0, 1.0), "ground"),
        RigidBody(Disc(0.5), (0.0, 0.55), "disc", density=1.0, velocity=(0.0, -2.0)),
    ]
    scene = Scene(rigid=rigid, contacts=[Contact(("disc", "ground"), SignoriniCoulomb())])
    return Simulation(scene, 0.1, num_threads=1, solver="nlgs")


def _lattice(**options):
    """Two discs, one of which meets the image of the other."""
    from xper_fx.nscd.laws import SignoriniCoulomb
    from xper_fx.nscd.rigid import Disc, RigidBody
    from xper_fx.scene.contact import Contact
    from xper_fx.scene.scene import Scene
    from xper_fx.simulation.simulation import Simulation

    places = {0.6: -0.1, 2.59: 0.1}
    discs = [
        RigidBody(Disc(0.5), (x, 0.4), "disc", density=1.0, velocity=(v, 0.0))
        for x, v in places.items()
    ]
    scene = Scene(
        rigid=discs, lattice=(3.0, 2.0), contacts=[Contact(("disc", "disc"), SignoriniCoulomb())],
        **options,
    )  # fmt: skip
    return Simulation(scene, 0.1, num_threads=1, solver="nlgs")


def across():
    return _lattice()


def pressed():
    from xper_fx.periodic.drive import MacroscopicDrive

    drive = MacroscopicDrive(rate={"12": 0.1}, gradient={"11": 1.0, "21": 0.0}, stress={"22": -0.1})
    return _lattice(macroscopic=drive)


def split():
    """Two crossed squares whose cells are one mesh until bonds let go."""
    from xper_fx.nscd.laws import RigidCohesiveZone
    from xper_fx.simulation.simulation import Simulation

    scene = _pulled(_elastic(), 0.5, label=None, default_interaction=RigidCohesiveZone(1e-3, 1e-6))
    return Simulation(scene, scheme="explicit", num_threads=1)


def cut():
    """Two crossed squares, their cells in four subdomains of which two float."""
    from xper_fx.nscd.laws import PerfectBond
    from xper_fx.simulation.simulation import Simulation

    def quarters(midpoints):
        return np.digitize(midpoints[0], (0.5, 1.0, 1.5))

    scene = _pulled(_elastic(), cells=(4, 2), label=quarters, default_interaction=PerfectBond())
    solver = {"tolerance": 1e-10, "num_threads": 1, "solver": "subdomains"}
    return Simulation(scene, 1.0, theta=1.0, inertia=False, **solver)


def opened():
    """Two crossed squares, each cell a body, pulled along the path of their bonds."""
    from xper_fx.simulation.path import GrowthControl

    return _followed(GrowthControl(relative=0.5))


def spent():
    """The same squares, pulled so that their bonds dissipate the same in each step."""
    from xper_fx.simulation.path import DissipationControl

    return _followed(DissipationControl(1e-6))


def _followed(path):
    from xper_fx.nscd.laws import CohesiveZone
    from xper_fx.simulation.simulation import Simulation

    bond = CohesiveZone(10.0, 1e-3, 1e-4)
    scene = _pulled(_elastic(), label=None, default_interaction=bond)
    return Simulation(scene, 1.0, inertia=False, path=path)


def nonmatching():
    """Two squares of one and two cells an edge, tied; with inertia."""
    from scenes import LEFT, RIGHT, mesh_of

    from xper_fx.bodies.explode import explode
    from xper_fx.bodies.join import join_meshes
    from xper_fx.bodies.meshes import tag_facets
    from xper_fx.forms.loads import PrescribedVelocity
    from xper_fx.nscd.laws import PerfectBond
    from xper_fx.scene.scene import Scene
    from xper_fx.scene.tie import Tie
    from xper_fx.simulation.simulation import Simulation

    meshes = [mesh_of((1.0, 1.0), (n, n)) for n in (1, 2)]
    meshes[1].geometry.x[:, 0] += 1.0
    sides = [{LEFT: 0.0, 7: 1.0}, {8: 1.0, RIGHT: 2.0}]
    tags = [
        tag_facets(mesh, {t: lambda x, at=at: np.abs(x[0] - at) < 1e-9 for t, at in places.items()})
        for mesh, places in zip(meshes, sides, strict=True)
    ]
    joined = join_meshes(meshes, facet_tags=tags)
    scene = Scene(
        explode(joined.mesh, joined.part, facet_tags=joined.facet_tags),
        {1: _elastic()},
        loads=[PrescribedVelocity(LEFT, 0, 0.0), PrescribedVelocity(RIGHT, 0, 1e-3)],
        ties=[Tie(8, 7, PerfectBond())],
    )
    return Simulation(scene, 0.1, tolerance=1e-10, num_threads=1, solver="nlgs")


def spun():
    """Cells that spin, each on its bonds."""
    from scenes import box_bodies

    from xper_fx.materials import NeoHookean
    from xper_fx.nscd.laws import PerfectBond
    from xper_fx.scene.scene import Scene
    from xper_fx.simulation.simulation import Simulation

    scene = Scene(
        box_bodies((1.0, 1.0), (2, 2)),
        {1: NeoHookean(young=1.0, poisson=0.3, density=1.0)},
        default_interaction=PerfectBond(),
        initial_velocity=lambda x: 0.1 * np.stack([0.5 - x[1], x[0] - 0.5]),
    )
    return Simulation(scene, scheme="explicit", num_threads=1)


# Which effects each calls for.
_PERIODIC = {"periodicity", "macroscopic control"}
_POINTS = {"inertia", "interactions"}
_GRAINS = {
    "interactions", "unilateral contact", "impact", "contact search", "rigid bodies",
    "lattice of rigid bodies",
}  # fmt: skip
_FOLLOWED = {
    "interactions",
    "unilateral contact",
    "cohesion",
    "damage",
    "one system",
    "path following",
}

SCENES = {
    static: set(),
    dynamic: {
        "inertia", "viscous damping", "external forces", "finite strain", "Newton of the bulk",
        "error control",
    },
    plastic: {"Newton of the bulk", "internal variables", "plasticity"},
    recorded: {"Newton of the bulk", "internal variables", "viscosity", "output"},
    stretched_cell: _PERIODIC,
    loaded_cell: {*_PERIODIC, "mean stress given"},
    impact: {*_POINTS, "walls", "unilateral contact", "impact"},
    sliding: {
        *_POINTS, "walls", "unilateral contact", "impact", "friction", "explicit bulk",
        "vertex problems",
    },
    bonded: {*_POINTS, "unilateral contact", "cohesion", "damage"},
    lagging: {*_POINTS, "unilateral contact", "cohesion", "damage", "viscous bonds"},
    uneven: {*_POINTS, "unilateral contact", "cohesion", "damage", "mixed modes", "fields"},
    divided: {*_POINTS, "unilateral contact", "cohesion", "damage", "several ranks"},
    closed: {*_POINTS, "unilateral contact", "friction", "mixed sweeps"},
    solid: {*_POINTS, "perfect bond", "three dimensions"},
    stiff: {*_POINTS, "perfect bond", "Newton on all points"},
    meeting: {*_POINTS, "unilateral contact", "impact", "contact search"},
    struck: {*_POINTS, "unilateral contact", "impact", "contact search", "rigid bodies"},
    jointed: {
        *_POINTS, "unilateral contact", "impact", "contact search", "rigid bodies", "joints",
    },
    caught: {
        *_POINTS, "unilateral contact", "impact", "contact search", "rigid bodies", "clusters",
    },
    rolled: {
        *_POINTS, "unilateral contact", "impact", "contact search", "rigid bodies", "friction",
        "rolling resistance",
    },
    sunk: {
        "interactions", "unilateral contact", "impact", "contact search", "rigid bodies", "healing",
    },
    across: _GRAINS,
    pressed: {*_GRAINS, "lattice that deforms"},
    split: {
        *_POINTS, "unilateral contact", "cohesion", "damage", "impact", "explicit bulk",
        "vertices that split",
    },
    opened: _FOLLOWED,
    spent: {*_FOLLOWED, "dissipation control"},
    cut: {
        "interactions", "perfect bond", "subdomains", "floating bodies", "Newton of the bulk",
    },
    nonmatching: {*_POINTS, "perfect bond", "ties"},
    spun: {
        *_POINTS, "perfect bond", "finite strain", "Newton of the bulk", "turning frames",
        "explicit bulk", "vertex problems",
    },
}  # fmt: skip


# Taking code away


class _Absent:
    """Stands where an object was; does nothing but raise."""

    def __init__(self, code: str):
        object.__setattr__(self, "_code", code)

    def __getattribute__(self, name):
        if name == "__class__":  # dataclasses look at the types of their fields (Python 3.14)
            return _Absent
        raise AssertionError(f"{object.__getattribute__(self, '_code')} is asked for {name}")

    def __call__(self, *arguments, **options):
        raise AssertionError(f"{object.__getattribute__(self, '_code')} is called")


class _Remover(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Imports modules without the objects that are taken away."""

    def __init__(self, removed: list[str]):
        self._names: dict[str, list[str]] = {}
        for code in removed:
            module, _, name = code.partition(":")
            if name:
                self._names.setdefault(module, []).append(name)
            else:
                sys.modules[module] = None  # import raises
        self._loaders = {}

    def find_spec(self, fullname, path=None, target=None):
        if fullname not in self._names:
            return None
        spec = importlib.machinery.PathFinder.find_spec(fullname, path, target)
        self._loaders[fullname], spec.loader = spec.loader, self
        return spec

    def create_module(self, spec):
        return None

    def exec_module(self, module):
        self._loaders[module.__name__].exec_module(module)
        for name in self._names[module.__name__]:
            *outer, last = name.split(".")
            holder = module
            for part in outer:
                holder = getattr(holder, part)
            assert hasattr(holder, last), f"{module.__name__} has no {name}"
            setattr(holder, last, _Absent(f"{module.__name__}:{name}"))


# Looking on


class _Calls:
    """Counts calls of Python and of C functions, and remembers whose Python was called."""

    def __init__(self):
        self.codes, self.count = set(), Counter()

    def __call__(self, frame, event, argument):
        if event in ("call", "c_call"):
            self.count[event] += 1
        if event == "call" and frame.f_code.co_flags & inspect.CO_OPTIMIZED:  # no class's body
            self.codes.add((frame.f_globals.get("__name__", ""), frame.f_code.co_qualname))


class _Pause:
    """Leaves the compiler's own calls out, and remembers what the kernels that it gives reach.

    A kernel that is kept is loaded with all it calls: what that is, its content tells.
    """

    def __init__(self, calls: _Calls):
        from xper_fx.cache.content import functions_of

        self.names, depth, compile = set(), 0, CPUDispatcher.compile

        def pausing(dispatcher, signature):
            nonlocal depth
            sys.setprofile(None)
            depth += 1
            try:
                return compile(dispatcher, signature)
            finally:
                depth -= 1
                if depth == 0:
                    for function in functions_of(dispatcher):
                        self.names.add((function.__module__, function.__qualname__))
                    sys.setprofile(calls)

        CPUDispatcher.compile = pausing


def _watch_kernels(count: Counter) -> None:
    """Count calls of compiled kernels and the bytes of the arrays they are given."""

    def nbytes(argument):
        if isinstance(argument, np.ndarray):
            return argument.nbytes
        return sum(map(nbytes, argument)) if isinstance(argument, tuple) else 0

    called = CPUDispatcher.__call__

    def counting(self, *arguments):
        count[f"{self.py_func.__module__}:{self.py_func.__qualname__}"] += 1
        count["bytes"] += nbytes(arguments)
        return called(self, *arguments)

    CPUDispatcher.__call__ = counting


def _held(root) -> int:
    """Bytes of the arrays that can be reached from an object."""
    seen, todo, total = set(), [root], 0
    while todo:
        item = todo.pop()
        if id(item) in seen or isinstance(item, type | str | bytes):
            continue
        seen.add(id(item))
        if isinstance(item, np.ndarray):
            if isinstance(item.base, np.ndarray):
                todo.append(item.base)
            else:
                total += item.nbytes
        elif isinstance(item, dict):
            todo += item.values()
        elif isinstance(item, list | tuple | set | frozenset):
            todo += item
        elif type(item).__module__.startswith(("xper_fx", "scipy.sparse")):
            todo += vars(item).values() if hasattr(item, "__dict__") else []
    return total


def observe(name: str, removed: list[str]) -> dict:
    """Run a scene; see the module docstring."""
    sys.meta_path.insert(0, _Remover(removed))
    scene = {function.__name__: function for function in SCENES}[name]
    calls, kernels, costs = _Calls(), Counter(), []
    _watch_kernels(kernels)
    gc.disable()  # what it calls is no cost of the scene
    pause = _Pause(calls)
    sys.setprofile(calls)
    simulation = scene()
    steps = simulation.steps(STEPS * simulation.step_size)
    for _ in range(STEPS):
        kernels.clear()
        calls.count.clear()
        next(steps)
        costs.append(dict(calls.count) | dict(kernels))
    sys.setprofile(None)
    from xper_fx.output.effects import effects_of

    state, ledger = simulation.state, simulation.ledger.as_columns()
    moved, velocity = state.displacement, state.velocity
    if simulation.rigid is not None:
        place, start = simulation.rigid.state, simulation.rigid.start
        moved = np.append(moved, place.position - start.position)
        velocity = np.append(velocity, place.velocity)
    digest = hashlib.sha256(moved.tobytes() + velocity.tobytes())
    digest.update(json.dumps(ledger).encode())
    return {
        "effects": {row.name: row._asdict() for row in effects_of(simulation)},
        "modules": sorted(m for m, module in sys.modules.items() if module is not None),
        "called": sorted(f"{m}:{n}" for m, n in calls.codes),
        "compiled": sorted(f"{m}:{n}" for m, n in pause.names),
        "costs": costs[1:],
        "held": _held(simulation),
        "digest": digest.hexdigest(),
        "displacement": float(abs(moved).max()),
    }


def serve() -> None:
    """Observe what the lines of the input ask for, each in a process that starts from here."""
    import dolfinx.fem  # noqa: F401
    import dolfinx.mesh  # noqa: F401
    import scipy.sparse.linalg  # noqa: F401
    import scipy.spatial  # noqa: F401
    from numba import njit

    njit(lambda x: x)(0)  # Numba imports the most when it first compiles
    assert not any(name.startswith("xper_fx") for name in sys.modules)
    for line in sys.stdin:
        if child := os.fork():
            if os.waitpid(child, 0)[1]:
                print(json.dumps(None), flush=True)
            continue
        status = 1
        try:
            name, *removed = json.loads(line)
            print(json.dumps(observe(name, removed)), flush=True)
            status = 0
        except Exception:
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(status)


if __name__ == "__main__":
    if len(sys.argv) == 1:
        serve()
        sys.exit()
    from mpi4py import MPI

    observed = observe(sys.argv[1], sys.argv[2:])
    if MPI.COMM_WORLD.rank == 0:
        print(json.dumps(observed))
