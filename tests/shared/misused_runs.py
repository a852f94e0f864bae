# SPDX-License-Identifier: LGPL-3.0-or-later
"""Misuses of runs: options, steps, records, checkpoints, what is read off a run."""

from __future__ import annotations

import os
from itertools import count
from pathlib import Path

import h5py
import numpy as np
from misuse import INF, NAN, RIGHT, Misuse, bad_numbers
from misused_scenes import (
    BOND,
    SOLID,
    TOUCH,
    block,
    disc,
    of_block,
    of_cell,
    of_discs,
    of_plate,
    steps_of,
)
from scenes import LEFT
from scenes import RIGHT as RIGHT_SIDE

import xper_fx as xf

_numbers = count()


def folder() -> Path:
    """A new folder, in the one where the process works."""
    return Path(f"misuse-{os.getpid()}-{next(_numbers)}").resolve()


def run_of(scene=None, **options):
    """A simulation that is right but for the options."""
    scene = of_plate() if scene is None else scene
    return xf.Simulation(scene, **({"step": 1e-5, "num_threads": 1} | options))


def pulled(**changes):
    """A plate whose sides have motions, so that a gauge has something to read."""
    loads = [xf.PrescribedVelocity(LEFT, 0, 0.0), xf.PrescribedVelocity(RIGHT_SIDE, 0, 0.01)]
    return of_plate(loads=loads, **changes)


def held():
    """A plate that motions hold."""
    loads = [xf.PrescribedVelocity(tag, i, 0.0) for tag in (LEFT, RIGHT_SIDE) for i in (0, 1)]
    return of_plate(loads=loads)


GAUGE = {"low": LEFT, "high": RIGHT_SIDE, "component": 0, "length": 2.0, "section": 2.0}


def recorder(simulation=None, **options):
    """A recorder that is right but for the options."""
    simulation = run_of() if simulation is None else simulation
    given = {"folder": folder(), "end_time": 1e-4, "fields": 0} | options
    return xf.Recorder(simulation, **given)


def recorded(count=2, **options):
    """A closed recorder of some steps."""
    writing = recorder(**options)
    with writing:
        for step in writing.simulation.steps(count * 1e-5):
            writing.record(step)
        writing.checkpoint()
    return writing


class SolverOfNothing(xf.solvers.Solver):
    """Gives no report."""

    def solve(self, interactions, velocity, options):
        return None


class SolverWithoutSolve(xf.solvers.Solver):
    """Has no method."""


def options() -> list[Misuse]:
    """Of `Simulation`."""

    def simulation(**changes):
        return run_of(**changes)

    out = bad_numbers(
        "Simulation",
        simulation,
        {
            "step": 1e-5,
            "theta": 0.5,
            "tolerance": 1e-4,
            "accuracy": 0.1,
            "newton_tolerance": 1e-8,
            "relaxation": 1.3,
            "max_sweeps": 100,
            "max_newton": 10,
            "max_halvings": 3,
            "num_threads": 1,
        },
        allowed={
            "step": (None,),
            "theta": (None,),
            "tolerance": (None,),
            "accuracy": (None,),
            "newton_tolerance": (None,),
            "num_threads": (None,),
        },
    )
    for name in ("inertia", "forgiving"):
        out += [
            Misuse(
                f"Simulation({name}={bad!r})",
                f"{name} & {bad}",
                lambda n=name, b=bad: run_of(**{n: b}),
            )
            for bad in ("no", None, 0.5, "False")
        ]
    cases = {
        "no scene": ("Scene & None", lambda: xf.Simulation(None, 1e-5)),
        "bodies for a scene": ("Scene & Bodies", lambda: xf.Simulation(block(), 1e-5)),
        "a scene class": ("Scene", lambda: xf.Simulation(xf.Scene, 1e-5)),
        "a step of a word": ("step & auto & small", lambda: run_of(step="small")),
        "a tolerance of a word": ("tolerance & auto & low", lambda: run_of(tolerance="low")),
        "an accuracy of a word": ("accuracy & high", lambda: run_of(accuracy="high")),
        "an accuracy of 2": ("accuracy & 2", lambda: run_of(accuracy=2.0)),
        "a scheme that does not exist": (
            "scheme & implicit & explicit & leapfrog",
            lambda: run_of(scheme="leapfrog"),
        ),
        "a scheme of a list": ("scheme & implicit", lambda: run_of(scheme=["implicit"])),
        "theta 1 of an explicit bulk": ("theta", lambda: run_of(scheme="explicit", theta=1.0)),
        "theta 0.3": ("theta & 0.3", lambda: run_of(theta=0.3)),
        "a solver that does not exist": (
            "solver & nlgs & newton & nlgz",
            lambda: run_of(solver="nlgz"),
        ),
        "a solver class": (
            "solver & class|object",
            lambda: run_of(solver=xf.solvers.NonlinearGaussSeidel),
        ),
        "a solver of a number": ("solver & 3", lambda: run_of(solver=3)),
        "a solver of None": ("solver & None", lambda: run_of(solver=None)),
        "a solver that gives None": (
            "SolverOfNothing & SolveReport & None",
            lambda: steps_of(of_plate(), solver=SolverOfNothing()),
        ),
        "a solver without solve": (
            "SolverWithoutSolve & solve",
            lambda: steps_of(of_plate(), solver=SolverWithoutSolve()),
        ),
        "a solver for perfect bonds of contacts": (
            "subdomains|bonds",
            lambda: steps_of(of_plate(default_interaction=TOUCH), solver="subdomains"),
        ),
        "newton with an explicit bulk": (
            "auto & newton",
            lambda: run_of(scheme="explicit", solver="newton"),
        ),
        "monolithic with an explicit bulk": (
            "monolithic & implicit",
            lambda: run_of(scheme="explicit", solver="monolithic"),
        ),
        "monolithic of rigid bodies": (
            "monolithic",
            lambda: run_of(of_discs(disc()), solver="monolithic"),
        ),
        "an unstable explicit step": (
            "unstable & critical",
            lambda: run_of(step=1.0, scheme="explicit"),
        ),
        "an explicit periodic cell": (
            "explicit|implicit",
            lambda: run_of(of_cell(), scheme="explicit"),
        ),
        "a step of None of rigid bodies": (
            "step & None",
            lambda: run_of(of_discs(disc()), step=None),
        ),
        "a step of auto of rigid bodies": ("step", lambda: run_of(of_discs(disc()), step="auto")),
        "an accuracy of rigid bodies": (
            "accuracy|step",
            lambda: run_of(of_discs(disc()), step=None, accuracy=1e-2),
        ),
        "rigid bodies without inertia": (
            "inertia",
            lambda: run_of(of_discs(disc()), inertia=False, theta=1.0),
        ),
        "an explicit scheme of rigid bodies": (
            "scheme|bulk",
            lambda: run_of(of_discs(disc()), scheme="explicit"),
        ),
        "a static run without a step": ("step", lambda: run_of(inertia=False, step=None)),
        "a static run with theta 1/2": ("theta", lambda: run_of(inertia=False, theta=0.5)),
        "a static run that nothing holds": (
            "held|hold|float|singular",
            lambda: steps_of(of_block(loads=[xf.Gravity((0.0, -9.81))]), inertia=False),
        ),
        "a path of a number": ("path & GrowthControl", lambda: run_of(inertia=False, path=0.3)),
        "a path of a class": (
            "path & GrowthControl",
            lambda: run_of(inertia=False, path=xf.GrowthControl),
        ),
        "a path with inertia": ("path|inertia", lambda: run_of(path=xf.GrowthControl())),
        "a path without bonds": (
            "bonds",
            lambda: run_of(held(), inertia=False, path=xf.GrowthControl()),
        ),
        "a communicator of None": ("comm & None", lambda: run_of(comm=None)),
        "a communicator of a number": ("comm & 2", lambda: run_of(comm=2)),
        "an unknown option": ("toleranse", lambda: run_of(toleranse=1e-3)),
        "options by place": ("positional", lambda: xf.Simulation(of_plate(), 1e-5, 1e-3)),
        "a step at which rounding hides the mass": (
            "inertia",
            lambda: steps_of(of_block(), step=1e8),
        ),
        "moduli in Pa, a density in t/mm^3": (
            "units",
            lambda: run_of(
                of_block(materials={1: xf.materials.LinearElastic(1e11, 0.3, 7.8e-9)}), step=1e-12
            ),
        ),
        "a step of 1e-12 s": ("step & units", lambda: _tiny_steps()),
        "a scene whose materials were changed": ("materials", lambda: _changed(materials={})),
        "a scene whose loads were changed": ("load", lambda: _changed(loads=[3.0])),
        "a scene whose bodies were taken": ("bodies", lambda: _changed(bodies=None)),
        "a scene whose order was changed": ("order", lambda: _changed(order=7)),
        "a scene whose walls were changed": ("wall", lambda: _changed(walls=[3.0])),
        "a scene whose law was changed": (
            "law|interaction",
            lambda: _changed(default_interaction=None),
        ),
    }
    return out + [Misuse(name, *case) for name, case in cases.items()]


def _changed(**changes):
    """A scene that was changed after its checks."""
    scene = of_plate()
    for name, value in changes.items():
        setattr(scene, name, value)
    return steps_of(scene)


def _tiny_steps():
    """Steps so short that nothing moves beyond rounding."""
    return steps_of(
        of_plate(
            default_interaction=xf.laws.CohesiveZone(1e15, 10.0, 1e6),
            loads=[xf.PrescribedVelocity(LEFT, 0, 1.0)],
        ),
        200,
        step=1e-12,
    )


def steps() -> list[Misuse]:
    """Of steps and of what is read between them."""

    def advanced(then, scene=None, **options):
        simulation = run_of(scene, **options)
        list(simulation.steps(2e-5))
        return then(simulation)

    def two_at_once(simulation):
        first = simulation.steps(1e-4)
        next(first)
        next(simulation.steps(1e-4))
        next(first)

    def dropped(simulation):
        next(simulation.steps(1e-4))
        next(simulation.steps(1e-4))
        return RIGHT if simulation.step_number == 4 else None

    def after_error(simulation):
        try:
            list(simulation.steps(NAN))
        except ValueError:
            pass
        next(simulation.steps(1e-4))
        return RIGHT if simulation.step_number == 3 else None

    out = bad_numbers(
        "steps",
        lambda end_time: list(run_of().steps(end_time)),
        {"end_time": 1e-5},
        allowed={"end_time": (0.0,)},
    )
    o = xf.output
    cases = {
        "an end that lies in the past": (
            "end_time & before",
            lambda: advanced(lambda s: list(s.steps(1e-5))),
        ),
        "two steps() at once": ("steps & once|other", lambda: advanced(two_at_once)),
        "steps() that were left": ("", lambda: advanced(dropped)),
        "steps after an error": ("", lambda: advanced(after_error)),
        "the reaction of an unknown tag": ("tag & 77", lambda: advanced(lambda s: s.reaction(77))),
        "the reaction of a word": ("tag & left", lambda: advanced(lambda s: s.reaction("left"))),
        "the displacement of an unknown tag": (
            "tag & 77",
            lambda: advanced(lambda s: s.mean_displacement(77)),
        ),
        "the displacement of None": (
            "tag & None",
            lambda: advanced(lambda s: s.mean_displacement(None)),
        ),
        "the reaction of rigid bodies by tag": (
            "mesh|rigid",
            lambda: advanced(lambda s: s.reaction(1), of_discs(disc())),
        ),
        "the displacement of rigid bodies": (
            "mesh|rigid",
            lambda: advanced(lambda s: s.displacement, of_discs(disc())),
        ),
        "the velocity of rigid bodies": (
            "mesh|rigid",
            lambda: advanced(lambda s: s.velocity, of_discs(disc())),
        ),
        "the reaction of a group that does not exist": (
            "group & balls",
            lambda: advanced(lambda s: s.reaction_of("balls"), of_discs(disc())),
        ),
        "the reaction of a cell": (
            "macroscopic",
            lambda: advanced(lambda s: s.reaction(1), of_cell()),
        ),
        "saving by a number": ("function & 3", lambda: run_of().save_on_failure(3)),
        "cracks of a scene without inclusion": (
            "",
            lambda: advanced(
                lambda s: RIGHT if len(o.find_cracks(s, 7).kind) == 0 else None,
            ),
        ),
        "cracks of a word": (
            "inclusion & hydride",
            lambda: advanced(lambda s: o.find_cracks(s, "hydride")),
        ),
        "cracks with a share of 2": (
            "share & 2",
            lambda: advanced(lambda s: o.find_cracks(s, 2, (), 2.0)),
        ),
        "cracks with a share of NaN": (
            "share & nan",
            lambda: advanced(lambda s: o.find_cracks(s, 2, (), NAN)),
        ),
        "cracks with a share of None": (
            "share & None",
            lambda: advanced(lambda s: o.find_cracks(s, 2, (), None)),
        ),
        "cracks without an unknown tag": (
            "ignored_facets & 77",
            lambda: advanced(lambda s: o.find_cracks(s, 2, (77,))),
        ),
        "cracks without a number": (
            "ignored_facets & 9",
            lambda: advanced(lambda s: o.find_cracks(s, 2, 9)),
        ),
        "cracks of rigid bodies": (
            "facets",
            lambda: advanced(lambda s: o.find_cracks(s, 1), of_discs(disc())),
        ),
        "cracks in space": (
            "plane|2D|dimension",
            lambda: advanced(lambda s: o.find_cracks(s, 1), _cells_in_space()),
        ),
        "cracks where there are no interactions": (
            "interaction",
            lambda: advanced(lambda s: o.find_cracks(s, 1), of_block()),
        ),
        "broken points of a scene": ("Simulation & Scene", lambda: o.broken_points(of_plate())),
        "fragments of a scene": ("Simulation & Scene", lambda: o.find_fragments(of_plate())),
        "measured fragments of None": ("Simulation & None", lambda: o.measure_fragments(None)),
        "measured fragments of a cell": (
            "cell & find_fragments",
            lambda: advanced(lambda s: o.measure_fragments(s), of_cell()),
        ),
        "measured fragments with a share of 2": (
            "share & 2",
            lambda: advanced(lambda s: o.measure_fragments(s, 2)),
        ),
        "fragments into a number": (
            "path & 3",
            lambda: advanced(lambda s: o.measure_fragments(s).to_csv(3)),
        ),
        "fragments with a share of -1": (
            "share & -1",
            lambda: advanced(lambda s: o.find_fragments(s, -1.0)),
        ),
        "contact forces before a step": ("", lambda: _no_forces(run_of(of_discs(disc())))),
        "contact forces of a scene": (
            "Simulation & Scene",
            lambda: o.find_contact_forces(of_plate()),
        ),
        "points of rigid bodies": (
            "mesh|facets|bodies",
            lambda: o.point_coordinates(run_of(of_discs(disc()))),
        ),
        "effects of a scene": ("Simulation & Scene", lambda: xf.effects_table(of_plate())),
        "cohesive scales of a scene": ("Simulation & Scene", lambda: xf.cohesive_table(of_plate())),
        "memory of a scene": ("Simulation & Scene", lambda: o.memory_by_part(of_plate())),
        "a summary of what was not recorded": (
            "record",
            lambda: xf.add_to_summary(run_of(), {"a": 1}),
        ),
    }
    return out + [Misuse(name, *case) for name, case in cases.items()]


def _no_forces(simulation):
    found = xf.output.find_contact_forces(simulation)
    return RIGHT if len(found.force) == 0 else None


def _cells_in_space():
    from scenes import box_bodies

    return xf.Scene(
        box_bodies((1, 1, 1), (1, 1, 1), "tetrahedron"), {1: SOLID}, default_interaction=BOND
    )


def records() -> list[Misuse]:
    """Of recorders, gauges and run options."""
    free = {"fields": (0.0,), "checkpoint_every": (0.0, INF)}
    out = bad_numbers(
        "Recorder",
        recorder,
        {"end_time": 1e-4, "fields": 2, "checkpoint_every": 600.0},
        allowed=free,
    )

    def twice(then):
        writing = recorded()
        return then(writing)

    def restart(change):
        writing = recorded()
        change(writing)

    def gauge(scene=None, **changes):
        scene = pulled() if scene is None else scene
        return recorder(run_of(scene), gauge=xf.TensileGauge(**(GAUGE | changes)))

    def record_again(writing):
        (step,) = writing.simulation.steps(3e-5)
        writing.record(step)

    def restarted(scene=None, **options):
        where = recorded().folder
        return recorder(run_of(scene), folder=where, restart=True, **options)

    def closed_twice(writing):
        writing.close()
        return RIGHT if (writing.folder / "history.csv").exists() else None

    steps = xf.recorded_steps
    cases = {
        "a recorder of a scene": (
            "Simulation & Scene",
            lambda: xf.Recorder(of_plate(), folder(), end_time=1.0),
        ),
        "a recorder without end": ("end_time", lambda: xf.Recorder(run_of(), folder())),
        "a recorder into None": ("folder & None", lambda: recorder(folder=None)),
        "a recorder into a number": ("folder & 3", lambda: recorder(folder=3)),
        "a recorder into a file": ("folder", lambda: recorder(folder=_a_file())),
        "a recorder into an empty name": ("folder", lambda: recorder(folder="")),
        "fields of a word": ("fields & x", lambda: recorder(fields="x")),
        "fields of half": ("fields & 2.5", lambda: recorder(fields=2.5)),
        "a gauge of a word": ("gauge & 11", lambda: recorder(gauge="11")),
        "a gauge class": ("gauge & TensileGauge", lambda: recorder(gauge=xf.TensileGauge)),
        "a cell's gauge on a plate": ("CellGauge & cell", lambda: recorder(gauge=xf.CellGauge())),
        "a tensile gauge on a cell": (
            "TensileGauge & cell",
            lambda: recorder(run_of(of_cell()), gauge=xf.TensileGauge(**GAUGE)),
        ),
        "a gauge of rigid bodies": (
            "TensileGauge & mesh|rigid",
            lambda: recorder(run_of(of_discs(disc())), gauge=xf.TensileGauge(**GAUGE)),
        ),
        "a gauge of an unknown tag": ("tag & 88", lambda: gauge(high=88)),
        "a gauge of component 2 in the plane": ("component 2 & 0 to 1", lambda: gauge(component=2)),
        "a gauge without length": ("length & 0", lambda: gauge(length=0.0)),
        "a gauge of component -1": ("component & -1", lambda: gauge(component=-1)),
        "a gauge of component 33 in the plane": (
            "component & 33",
            lambda: recorder(run_of(of_cell()), gauge=xf.CellGauge("33")),
        ),
        "parameters of a list": ("parameters & mapping", lambda: recorder(parameters=[1, 2])),
        "parameters that are no JSON": (
            "parameters|summary",
            lambda: recorder(parameters={"a": object()}),
        ),
        "parameters that are NaN": (
            "parameters|summary & nan",
            lambda: recorder(parameters={"a": NAN}),
        ),
        "fragments of a word": ("fragments & yes", lambda: recorder(fragments="yes")),
        "restart of a word": ("restart & no", lambda: recorder(restart="no")),
        "an end before the present": ("end_time & before", lambda: _late()),
        "an unknown keyword of a recorder": ("gauges", lambda: recorder(gauges=None)),
        "two recorders of a folder": ("folder & written by", lambda: _two_recorders()),
        "a record after close": ("close", lambda: twice(record_again)),
        "closing twice": ("", lambda: twice(closed_twice)),
        "a record of None": ("StepRecord & None", lambda: recorder().record(None)),
        "a record of a number": ("StepRecord & 3", lambda: recorder().record(3)),
        "a record of a time": ("StepRecord", lambda: recorder().record((1.0, 2.0))),
        "a checkpoint after close": ("close", lambda: twice(lambda w: w.checkpoint())),
        "restart with another scene": ("another scene", lambda: restarted(of_block())),
        "restart with other materials": (
            "another scene & young|density|material",
            lambda: restarted(
                of_plate(materials={1: SOLID, 2: xf.materials.LinearElastic(2e9, 0.3, 1e3)})
            ),
        ),
        "restart with rigid bodies": ("another scene", lambda: restarted(of_discs(disc()))),
        "restart with fields that were not": ("fields", lambda: restarted(fields=5)),
        "restart where there is nothing": ("no checkpoint", lambda: recorder(restart=True)),
        "restart from a damaged file": (
            "damaged",
            lambda: _from(lambda p: p.write_bytes(b"no HDF5")),
        ),
        "restart from half a file": (
            "cut short",
            lambda: _from(lambda p: p.write_bytes(p.read_bytes()[: p.stat().st_size // 2])),
        ),
        "restart from a file of zeros": (
            "damaged|cut",
            lambda: _from(lambda p: p.write_bytes(bytes(p.stat().st_size))),
        ),
        "restart from another HDF5 file": ("no checkpoint", lambda: _from(_another)),
        "restart from a file of another version": ("version & 9.9", lambda: _from(_of_version)),
        "restart from a file with a changed number": ("digest", lambda: _from(_edited)),
        "restart from a file that claims a terabyte": (
            "size|larger|declares",
            lambda: _from(_huge),
        ),
        "restart from a file of compressed zeros": ("size|larger|declares", lambda: _from(_packed)),
        "restart from a file with external storage": ("external", lambda: _from(_external)),
        "restart from a file with an external link": ("external|link", lambda: _from(_linked)),
        "restart from a file with a soft link": ("damaged", lambda: _from(_soft)),
        "restart with fields that were cut": ("bulk.h5 & cut short", lambda: _of_fields(b"x")),
        "restart with fields of no HDF5": ("bulk.h5 & damaged", lambda: _of_fields(bytes(9999))),
        "a summary of None": ("found & None", lambda: xf.add_to_summary(_recorded_run(), None)),
        "a summary with NaN": ("nan", lambda: xf.add_to_summary(_recorded_run(), {"a": NAN})),
        "a summary of a damaged file": (
            "summary.json & no summary",
            lambda: xf.add_to_summary(_recorded_run("{"), {"a": 1}),
        ),
        "restart from a folder": ("checkpoint", lambda: _from(_a_folder)),
        "recorded steps of a simulation": (
            "Recorder & Simulation",
            lambda: list(steps(run_of(), 1e-4, "run", True)),
        ),
        "recorded steps to NaN": (
            "end_time & nan",
            lambda: list(steps(recorder(), NAN, "run", True)),
        ),
        "recorded steps to None": (
            "end_time & None",
            lambda: list(steps(recorder(), None, "run", True)),
        ),
        "recorded steps to a word": (
            "end_time & soon",
            lambda: list(steps(recorder(), "soon", "run", True)),
        ),
        "recorded steps without title": ("", lambda: _untitled()),
        "recorded steps after close": (
            "close",
            lambda: twice(lambda w: list(steps(w, 1e-4, "run", True))),
        ),
        "run options of None": ("parser & None", lambda: xf.add_run_options(None, folder())),
        "a history that is not there": (
            "history.csv",
            lambda: xf.read_history(folder() / "history.csv"),
        ),
        "a history that is a folder": ("", lambda: xf.read_history(_made(folder()))),
        "a history of None": ("path|PathLike & None", lambda: xf.read_history(None)),
        "a history that is empty": ("empty", lambda: xf.read_history(_text(""))),
        "a history of words": ("line 2 & number", lambda: xf.read_history(_text("a,b\n1,two\n"))),
        "a history of bytes": (
            "text|table|history",
            lambda: xf.read_history(_bytes(b"\xff\xfe\x00\x01\n\x80\n")),
        ),
        "a history with a short line": ("line 2", lambda: xf.read_history(_text("a,b\n1\n"))),
        "a folder of None": ("folder|path & None", lambda: xf.prepare_folder(None)),
        "a folder that is a file": ("folder", lambda: xf.prepare_folder(_a_file())),
    }
    return out + [Misuse(name, *case) for name, case in cases.items()]


def _late():
    """A recorder whose run is over before it begins."""
    simulation = run_of()
    list(simulation.steps(5e-5))
    return recorder(simulation, end_time=1e-5)


def _untitled():
    made = list(xf.recorded_steps(recorder(), 2e-5, None, True))
    return RIGHT if len(made) == 2 else None


def _two_recorders():
    where = folder()
    first = recorder(folder=where)
    try:
        recorder(folder=where)
    finally:
        first.close()


def _made(path):
    path.mkdir(parents=True)
    return path


def _a_file():
    return _text("a file")


def _text(text):
    return _bytes(text.encode())


def _bytes(content):
    path = _made(folder()) / "file.csv"
    path.write_bytes(content)
    return path


def _from(change):
    """A restart from a checkpoint that something was done to."""
    where = recorded().folder
    path = where / "checkpoint.h5"
    change(path)
    return recorder(folder=where, restart=True)


def _of_fields(content):
    """A restart with fields that something was done to."""
    where = recorded(fields=3).folder
    (where / "bulk.h5").write_bytes(content)
    return recorder(folder=where, fields=3, restart=True)


def _recorded_run(summary=None):
    writing = recorded()
    if summary is not None:
        (writing.folder / "summary.json").write_text(summary)
    return writing.simulation


def _another(path):
    with h5py.File(path, "w") as file:
        file["a"] = np.arange(3)


def _of_version(path):
    with h5py.File(path, "a") as file:
        file.attrs["xper_fx"] = "9.9"


def _edited(path):
    with h5py.File(path, "a") as file:
        file["simulation/time"][()] = 7.0


def _replaced(path, **how):
    """Another data set in the place of one."""
    with h5py.File(path, "a") as file:
        del file["simulation/time"]
        file.create_dataset("simulation/time", **how)


def _huge(path):
    _replaced(path, shape=(1 << 37,), dtype="f8", chunks=(1 << 16,))


def _packed(path):
    _replaced(path, shape=(1 << 37,), dtype="f8", chunks=(1 << 20,), compression="gzip")


def _external(path):
    where = path.with_name("outside.bin")
    where.write_bytes(bytes(8))
    _replaced(path, shape=(1,), dtype="f8", external=[(str(where), 0, 8)])


def _linked(path):
    other = path.with_name("other.h5")
    with h5py.File(other, "w") as file:
        file["time"] = 1.0
    with h5py.File(path, "a") as file:
        del file["simulation/time"]
        file["simulation/time"] = h5py.ExternalLink(str(other), "time")


def _soft(path):
    with h5py.File(path, "a") as file:
        del file["simulation/time"]
        file["simulation/time"] = h5py.SoftLink("/nowhere")


def _a_folder(path):
    path.unlink()
    path.mkdir()
