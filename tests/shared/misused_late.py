# SPDX-License-Identifier: LGPL-3.0-or-later
"""Misuses that show late or seldom: during a run, in results of studies, at the ends of numbers."""

from __future__ import annotations

from functools import cache

import numpy as np
from dolfinx import fem
from misuse import INF, NAN, RIGHT, Misuse
from misused_runs import held, run_of
from misused_scenes import (
    TOUCH,
    disc,
    of_block,
    of_cell,
    of_discs,
    of_plate,
    plate,
    steps_of,
)
from misused_tools import build
from scenes import LEFT, TOP, mesh_of

import xper_fx as xf


def shapes() -> list[Misuse]:
    """Of shapes that are made from a few numbers."""
    r = xf.rigid
    out = []
    for bad in (None, 2, -1, 3.5, "6", NAN, True, 10**9):
        out.append(
            Misuse(
                f"Polygon.regular(sides={bad!r})",
                "sides|corners",
                lambda b=bad: r.Polygon.regular(b, 1.0),
            )
        )
    for bad in (None, 0.0, -1.0, NAN, INF, "1", True):
        out.append(
            Misuse(
                f"Polygon.regular(radius={bad!r})", "radius", lambda b=bad: r.Polygon.regular(6, b)
            )
        )
    for cls, good in ((r.Polygon, 2), (r.Polyhedron, 3)):
        for bad in (
            None,
            1.0,
            (1.0,),
            (1.0, 0.0, 1.0)[:good],
            (NAN,) * good,
            ("a",) * good,
            (1.0,) * 5,
            (-1.0,) * good,
            (INF,) * good,
        ):
            out.append(
                Misuse(
                    f"{cls.__name__}.box({bad!r})",
                    "length|side|edge|box",
                    lambda c=cls, b=bad: c.box(b),
                )
            )
    for bad in (
        None,
        [],
        [(0, 0, 0)],
        [(0, 0, 0)] * 5,
        [(0, 0)] * 5,
        [(NAN, 0, 0)] * 5,
        "abc",
        [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)],
        [("a",) * 3] * 5,
    ):
        out.append(
            Misuse(
                f"Polyhedron.hull({bad!r})",
                "point|hull|vert|plane",
                lambda b=bad: r.Polyhedron.hull(b),
            )
        )
    for shape in (
        r.Disc(1.0),
        r.Sphere(1.0),
        r.Polygon.regular(6, 1.0),
        r.Polyhedron.box((1, 1, 1)),
    ):
        for bad in (None, 0.0, NAN, "1"):
            out.append(
                Misuse(
                    f"{type(shape).__name__}.mass_properties({bad!r})",
                    "density",
                    lambda s=shape, b=bad: s.mass_properties(b),
                )
            )
    return out


@cache
def results():
    """Of a study of one run."""
    from xper_fx.study.results import Run

    q = xf.quantities
    study = xf.Study(
        "bar", build, 1e-5, {"closure": q.EnergyClosure()}, {"f": [{"cells": 2}, {"cells": 3}]}
    )
    record = {
        "status": "done",
        "seconds": 1.0,
        "cpu_seconds": 1.0,
        "peak_memory": 1e6,
        "array_bytes": 1e6,
        "steps": 1,
        "sweeps": 1,
        "newton_iterations": 1,
        "closure": 0.0,
        "estimated_error": None,
    }
    runs = [Run(s, ("f",), record, {"closure": 1e-3 * s["cells"]}) for s in study.settings()]
    return xf.study.StudyResults(study, runs)


def studied() -> list[Misuse]:
    """Of results of studies."""
    from xper_fx.study.plots import plot_error_against_cost

    cases = {
        "members of an unknown family": ("family & g", lambda: results().members("g")),
        "candidates of an unknown quantity": (
            "quantity & stress",
            lambda: results().candidates("stress"),
        ),
        "the front of an unknown quantity": (
            "quantity & stress",
            lambda: results().front("stress"),
        ),
        "the front of an unknown cost": (
            "cost & money",
            lambda: results().front("closure", "money"),
        ),
        "the rate of an unknown quantity": (
            "quantity & stress",
            lambda: results().rate("stress", "f", "cells"),
        ),
        "the rate of an unknown family": (
            "family & g",
            lambda: results().rate("closure", "g", "cells"),
        ),
        "the rate in an unknown parameter": (
            "parameter & size",
            lambda: results().rate("closure", "f", "size"),
        ),
        "the cheapest of an unknown quantity": (
            "quantity & stress",
            lambda: results().cheapest("stress", 0.1),
        ),
        "the cheapest to an error of NaN": (
            "error & nan",
            lambda: results().cheapest("closure", NAN),
        ),
        "the cheapest to an error of a word": (
            "error & low",
            lambda: results().cheapest("closure", "low"),
        ),
        "the saturation of an unknown quantity": (
            "quantity & stress",
            lambda: results().saturation("stress", "cells"),
        ),
        "the saturation of an unknown parameter": (
            "parameter & size",
            lambda: results().saturation("closure", "size"),
        ),
        "the trust in an unknown quantity": (
            "quantity & stress",
            lambda: results().trust("stress"),
        ),
        "advice on an unknown quantity": ("quantity & stress", lambda: results().advice("stress")),
        "advice for a target of a word": (
            "target & number",
            lambda: results().advice("closure", "low"),
        ),
        "a table into None": ("path & None", lambda: results().to_csv(None)),
        "a record into a number": ("path & 3", lambda: results().to_json(3)),
        "a figure of an unknown quantity": (
            "quantities & stress",
            lambda: plot_error_against_cost(results(), quantities=["stress"]),
        ),
    }
    return [Misuse(name, *case) for name, case in cases.items()]


def late() -> list[Misuse]:
    """Of what goes wrong in a run, and of numbers at the ends of their range."""

    def falling(**options):
        floor = xf.rigid.wall((0.0, -1.0), (0.0, 1.0), "floor")
        return of_discs(disc(**options), floor, pairs=[("discs", "floor")])

    def later(value, after=2e-5):
        return lambda t: 0.0 if t < after else value

    def V():
        return fem.functionspace(mesh_of((1, 1), (1, 1)), ("Lagrange", 1, (2,)))

    cases = {
        "a rigid force that loses a component": (
            "force & shape",
            lambda: steps_of(falling(force=lambda t: (0.0, 0.0) if t < 2e-5 else (0.0,)), 5),
        ),
        "a rigid force that becomes NaN": (
            "force & nan",
            lambda: steps_of(falling(force=lambda t: (0.0, 0.0 if t < 2e-5 else NAN)), 5),
        ),
        "a rigid torque that becomes None": (
            "torque|None",
            lambda: steps_of(falling(torque=lambda t: 0.0 if t < 2e-5 else "a"), 5),
        ),
        "a rigid motion that becomes NaN": (
            "prescribed & nan",
            lambda: steps_of(falling(prescribed={0: later(NAN)}), 5),
        ),
        "a rigid motion that becomes None": (
            "prescribed & None",
            lambda: steps_of(falling(prescribed={0: later(None)}), 5),
        ),
        "a rigid motion of no time": (
            "takes 0|function",
            lambda: steps_of(falling(prescribed={0: lambda: 0.0})),
        ),
        "a motion that becomes infinite": (
            "inf & t =",
            lambda: steps_of(of_plate(loads=[xf.PrescribedVelocity(LEFT, 0, later(INF))]), 5),
        ),
        "a displacement that becomes None": (
            "None & t =",
            lambda: steps_of(of_plate(loads=[xf.PrescribedDisplacement(LEFT, 0, later(None))]), 5),
        ),
        "gravity that becomes a vector": (
            "load & number",
            lambda: steps_of(of_plate(loads=[xf.Gravity((0.0, later(np.zeros(2))))]), 5),
        ),
        "gravity of rigid bodies that becomes NaN": (
            "load & nan & t =",
            lambda: steps_of(
                of_discs(disc(), loads=[xf.Gravity(lambda t: (0.0, later(NAN)(t)))]), 5
            ),
        ),
        "gravity of rigid bodies that loses a component": (
            "load & 2 components & t =",
            lambda: steps_of(
                of_discs(disc(), loads=[xf.Gravity(lambda t: (0.0,) * (2 if t < 2e-5 else 1))]), 5
            ),
        ),
        "a drive that becomes NaN": (
            "nan & t =",
            lambda: steps_of(
                of_cell(
                    xf.MacroscopicDrive(
                        gradient={"12": 0.0, "21": 0.0, "22": 1.0}, rate={"11": later(NAN)}
                    )
                ),
                5,
            ),
        ),
        "a stress that becomes a word": (
            "load|number",
            lambda: steps_of(
                of_cell(
                    xf.MacroscopicDrive(
                        gradient={"11": 1.0, "12": 0.0, "21": 0.0}, stress={"22": later("a")}
                    )
                ),
                5,
            ),
        ),
        "gravity of 1e300": (
            "finite|converge",
            lambda: steps_of(of_plate(loads=[xf.Gravity((0.0, -1e300))]), 3),
        ),
        "a velocity of 1e200": (
            "finite|range",
            lambda: steps_of(
                of_plate(initial_velocity=lambda x: np.full((2, x.shape[1]), 1e200)), 3
            ),
        ),
        "a rigid velocity of 1e200": (
            "finite|range",
            lambda: steps_of(falling(velocity=(0.0, 1e200)), 3),
        ),
        "a rigid spin of 1e200": ("finite|range|spin", lambda: steps_of(falling(spin=1e200), 3)),
        "a traction of 1e300": (
            "finite|converge",
            lambda: steps_of(of_plate(loads=[xf.SurfaceTraction(TOP, (0.0, 1e300))]), 3),
        ),
        "a modulus of 1e300": (
            "units|range|finite",
            lambda: steps_of(of_block(materials={1: xf.materials.LinearElastic(1e300, 0.3, 1e3)})),
        ),
        "a density of 1e-300": (
            "units|range|finite",
            lambda: steps_of(of_block(materials={1: xf.materials.LinearElastic(1e9, 0.3, 1e-300)})),
        ),
        "1e12 steps of rigid bodies": (
            "steps",
            lambda: next(xf.Simulation(falling(), 1e-12, num_threads=1).steps(1.0)),
        ),
        "1e300 steps": ("steps", lambda: next(run_of().steps(1e295))),
        "a reach of 1e9 m": ("", lambda: _right_if(steps_of(_reaching(1e9)))),
        "a disc of 1e-6 m and one of 1e6 m": ("", lambda: _right_if(steps_of(_sizes()))),
        "a facet node of order 5": ("degree|order & 5", lambda: plate().facet_nodes(5)),
        "nodes of a space on another mesh": ("another mesh", lambda: plate().facing_nodes(V())),
        "nodes of None": ("V & None", lambda: plate().facing_nodes(None)),
        "a gmsh option that is none": ("Mesh.Nonsense", lambda: _gmsh({"Mesh.Nonsense": 1.0})),
        "a gmsh option of a word": (
            "Mesh.Algorithm & number",
            lambda: _gmsh({"Mesh.Algorithm": "fast"}),
        ),
        "gmsh options of None": ("options & None", lambda: _gmsh(None)),
        "a gmsh model of no name": ("name & None", lambda: _gmsh({}, None)),
        "a simulation restored from nothing": ("saved|checkpoint", lambda: run_of().restore({})),
        "a static run under gravity of plates that are held": ("", lambda: _static()),
    }
    return [Misuse(name, *case) for name, case in cases.items()]


def _right_if(made):
    return RIGHT if made else None


def _static():
    loads = [*held().loads, xf.Gravity((0.0, -9.81))]
    return RIGHT if steps_of(of_plate(loads=loads), inertia=False) else None


def _reaching(reach):
    contacts = [xf.Contact(("discs", "discs"), TOUCH, reach)]
    return xf.Scene(rigid=[disc((3.0 * i, 0.0)) for i in range(40)], contacts=contacts)


def _sizes():
    large = xf.RigidBody(xf.rigid.Disc(1e6), (0.0, 1e6 + 1.0), "discs", density=1e3)
    return of_discs(xf.RigidBody(xf.rigid.Disc(1e-6), (0.0, 0.0), "discs", density=1e3), large)


def _gmsh(options, name="model"):
    with xf.gmsh_model(name, options):
        pass
