# SPDX-License-Identifier: LGPL-3.0-or-later
"""Misuses of rigid bodies that are driven in runs without inertia."""

from __future__ import annotations

import numpy as np
from misuse import NAN, Misuse

import xper_fx as xf

STILL = {0: 0.0, 1: 0.0, 2: 0.0}
LAW = xf.laws.SignoriniCoulomb(0.3, contact="position")


def indented(motion, place=(0.0, 0.5), others=(), contacts=None, density=None):
    """A block on a fixed ground, and a disc above it; contacts of the two if not given."""
    mesh = xf.crossed_rectangle((-1, -1), (1, 0), (4, 2))
    tags = xf.tag_facets(mesh, {1: lambda x: x[1] < -1 + 1e-9})
    tool = xf.RigidBody(xf.rigid.Disc(0.5), place, "tool", prescribed=motion, density=density)
    return xf.Scene(
        xf.explode(mesh, np.zeros(len(xf.geometry_dofmap(mesh)), int), facet_tags=tags),
        {1: xf.materials.LinearElastic(1e9, 0.3, 1000.0)},
        surfaces={"block": (1,)},
        rigid=[tool, *others],
        contacts=[xf.Contact(("block", "tool"), LAW)] if contacts is None else contacts,
        loads=[xf.PrescribedDisplacement(1, i, 0.0) for i in (0, 1)],
    )


def static(motion, count=3, **scene):
    """Some static steps; the run."""
    run = xf.Simulation(indented(motion, **scene), 0.1, inertia=False, num_threads=1)
    for _ in run.steps(0.1 * count):
        pass
    return run


def static_tools() -> list[Misuse]:
    """Of tools in static runs."""
    ball = xf.RigidBody(xf.rigid.Disc(0.1), (2.0, 0.5), "ball", density=1.0)
    sink = {1: -1e-3}
    pair = [xf.Contact(("block", name), LAW) for name in ("tool", "ball")]
    pair.append(xf.Contact(("ball", "tool"), None))
    own = xf.Contact(("block", "toll"), LAW)
    return [
        Misuse("no spin", "free to move & density", lambda: static({0: 0.0} | sink)),
        Misuse(
            "free in x",
            "inertia & prescribed",
            lambda: static({1: -1e-3, 2: 0.0}, density=1000.0),
        ),
        Misuse(
            "a free body beside it",
            "inertia & prescribed",
            lambda: static(STILL | sink, others=[ball], contacts=pair),
        ),
        Misuse("NaN", "nan", lambda: static(STILL | {1: NAN})),
        Misuse("NaN later", "nan", lambda: static(STILL | {1: lambda t: NAN if t > 0.1 else 0.0})),
        Misuse("None later", "None", lambda: static(STILL | {1: lambda t: None})),
        Misuse("a word", "number|fast", lambda: static(STILL | {1: "fast"})),
        Misuse("inside the block", "lies in", lambda: static(STILL, place=(0.0, -0.2))),
        Misuse("ten metres a second", "small strain", lambda: static(STILL | {1: -10.0})),
        Misuse("a misspelt contact", "toll", lambda: static(STILL | sink, contacts=[own])),
        Misuse(
            "a reaction of another name",
            "punch",
            lambda: static(STILL | sink).reaction_of("punch"),
        ),
        Misuse(
            "explicit",
            "inertia|explicit|theta",
            lambda: xf.Simulation(indented(STILL), 0.1, inertia=False, scheme="explicit"),
        ),
    ]
