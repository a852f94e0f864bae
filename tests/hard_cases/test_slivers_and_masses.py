# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells 1e4 times longer than thick, facets of 1e-4 beside 1, bodies 1e6 times heavier."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import BOTTOM, field, mesh_of, midpoints, run, side_tags

from xper_fx.bodies.explode import explode
from xper_fx.bodies.meshes import tag_cells
from xper_fx.forms.loads import Gravity
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import SignoriniCoulomb
from xper_fx.scene import Scene, Wall
from xper_fx.simulation.simulation import Simulation

GRAVITY = 10.0
# Edges of the columns and rows of cells, m.
EVEN = np.linspace(0.0, 1.0, 3)
GRADED = np.array([0.0, 1e-4, 1e-3, 1e-2, 0.1, 1.0])
THICK = np.array([0.0, 1.0, 2.0, 3.0])
THIN = np.array([0.0, 1.0, 1.0 + 1e-4, 2.0 + 1e-4])
COLUMNS = {
    "sliver layer": (EVEN, THIN, (1e3, 1e3, 1e3)),
    "tiny facets": (GRADED, THICK, (1e3, 1e3, 1e3)),
    "tiny facets on a sliver layer": (GRADED, THIN, (1e3, 1e3, 1e3)),
    "light between heavy": (EVEN, THICK, (1e3, 1e-3, 1e3)),
    "heavy on light": (EVEN, THICK, (1e-3, 1e-3, 1e3)),
    "light sliver between heavy": (EVEN, THIN, (1e3, 1.0, 1e3)),
}
SLOW = ("heavy on light", "light sliver between heavy")


def column(edges, rows, densities, *, step, theta=1.0, scheme="implicit", solver="auto"):
    """Three blocks on each other on the ground, of crossed cells between the edges given."""
    counts = len(edges) - 1, len(rows) - 1
    mesh = mesh_of(counts, counts)
    row = np.floor(midpoints(mesh)[1]).astype(int)
    tags = tag_cells(mesh, {2: lambda x: (x[1] > 1.0) & (x[1] < 2.0), 3: lambda x: x[1] > 2.0})
    x = mesh.geometry.x
    x[:, 0] = np.interp(x[:, 0], np.arange(len(edges)), edges)
    x[:, 1] = np.interp(x[:, 1], np.arange(len(rows)), rows)
    law = SignoriniCoulomb(0.3)
    scene = Scene(
        explode(mesh, row, tags, side_tags(mesh, (edges[-1], rows[-1]))),
        {tag: LinearElastic(1e7, 0.0, density) for tag, density in enumerate(densities, 1)},
        default_interaction=law,
        walls=[Wall(BOTTOM, (0, 0), (0, 1), law)],
        loads=[Gravity((0.0, -GRAVITY))],
    )
    options = {"tolerance": 1e-11, "newton_tolerance": 5e-12, "max_halvings": 0}
    return Simulation(
        scene, step, scheme=scheme, theta=theta, solver=solver, num_threads=1, **options
    )


def momentum_missing(simulation, steps):
    """Largest error of a step's momentum of the whole column, beside its weight times h."""
    points = simulation.interactions
    wall = points.points.nodes[:, 1, 0] == points.inverse.num_nodes
    mass = simulation.bulk.mass.reshape(-1, 2)
    weight = simulation.step_size * GRAVITY * mass[:, 1].sum()
    worst = 0.0
    for _ in range(steps):
        before = (mass * field(simulation, "velocity")).sum(axis=0)
        run(simulation, 1)
        moved = (mass * field(simulation, "velocity")).sum(axis=0) - before
        impulse = np.einsum("pi,pij->j", points.gather("impulse")[wall], points.points.frame[wall])
        worst = max(worst, np.abs(moved - impulse + np.array([0.0, weight])).max() / weight)
    return worst


@pytest.mark.slow
@pytest.mark.parametrize(
    "name, solver",
    [(name, "monolithic") for name in COLUMNS]
    + [("tiny facets on a sliver layer", "auto")]
    + [(name, "newton") for name in ("sliver layer", "tiny facets", "light between heavy")],
)
def test_static_pressure(name, solver, figure):
    """Each interface comes to bear the weight above it; evenly where facets are alike (nu = 0).

    Sweeps do not converge here: what they hand on falls off by the ratio of masses or thicknesses.
    """
    edges, rows, densities = COLUMNS[name]
    # the light bodies' own limit bounds the step, the heavy ones' period the time to come to rest
    step, steps = (5e-3, 400) if name in SLOW else (2e-2, 60)
    simulation = column(edges, rows, densities, step=step, solver=solver)
    missing = momentum_missing(simulation, steps)
    up = simulation.last.impulses.reshape(-1, 2)[:, 1] / simulation.step_size
    body = simulation.bulk.layout.body_of_node()
    heights = np.diff(rows)
    above = GRAVITY * np.cumsum((heights * densities)[::-1])[::-1]
    carried = np.cumsum(np.bincount(body, up)[::-1])[::-1]
    error = np.abs(carried / above - 1.0).max()
    figure(f"{name}, {solver}", "momentum missing < 1e-11", missing)
    figure(f"{name}, {solver}", "weight carried, error < 1e-6", error)
    assert missing < 1e-11
    assert error < 1e-6
    if len(edges) == len(EVEN):
        points = simulation.interactions
        wall = points.points.nodes[:, 1, 0] == points.inverse.num_nodes
        pressure = points.gather("traction")[:, 0]
        assert pressure[wall] == pytest.approx(above[0], rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("name", COLUMNS)
def test_momentum_of_an_explicit_column(name, figure):
    edges, rows, densities = COLUMNS[name]
    simulation = column(edges, rows, densities, step=None, theta=0.5, scheme="explicit")
    missing = momentum_missing(simulation, 20)
    figure(f"{name}, explicit", "momentum missing < 1e-11", missing)
    assert simulation.interactions.gather("impulse")[:, 0].max() > 0.0
    assert missing < 1e-11
