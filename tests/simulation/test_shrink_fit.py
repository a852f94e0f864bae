# SPDX-License-Identifier: LGPL-3.0-or-later
"""A ring shrunk onto another one, found by a search: the pressure is Lame's, and stays."""

import numpy as np
import pytest

import xper_fx as xf

INNER, FACE, OUTER, OVERLAP = 1.0, 1.5, 2.0, 5e-4
YOUNG, POISSON = 1e9, 0.3


def quarter(inner, outer, first):
    """A quarter of a ring, with tags of its sides at x = 0 and y = 0."""
    mesh = xf.crossed_rectangle((0, 0), (1, 1), (4, 16))
    x = mesh.geometry.x
    radius, angle = inner + (outer - inner) * x[:, 0], 0.5 * np.pi * x[:, 1]
    x[:, 0], x[:, 1] = radius * np.cos(angle), radius * np.sin(angle)
    sides = {first: lambda x: x[0] < 1e-9, first + 1: lambda x: x[1] < 1e-9}
    return mesh, xf.tag_facets(mesh, sides)


def shrunk():
    """Two quarters that overlap, without friction."""
    (a, a_tags), (b, b_tags) = quarter(INNER, FACE, 1), quarter(FACE - OVERLAP, OUTER, 3)
    cells = [xf.tag_cells(a, {}, 1), xf.tag_cells(b, {}, 2)]
    joined = xf.join_meshes([a, b], cells, [a_tags, b_tags])
    elastic = xf.materials.LinearElastic(YOUNG, POISSON, 1000.0)
    slides = xf.laws.SignoriniCoulomb(0.0, contact="position")
    sides = (1, 0), (2, 1), (3, 0), (4, 1)
    return xf.Scene(
        xf.explode(joined.mesh, joined.part, joined.cell_tags, joined.facet_tags),
        {1: elastic, 2: elastic},
        default_interaction=xf.laws.PerfectBond(),
        surfaces={"inner": (1,), "outer": (2,)},
        contacts=[xf.Contact(("inner", "outer"), slides)],
        loads=[xf.PrescribedDisplacement(tag, i, 0.0) for tag, i in sides],
    )


def pressure():
    """Of two thick rings in plane strain (Lame 1852; Timoshenko and Goodier 1970, section 28)."""
    stretch = sum((r * r + FACE**2) / abs(r * r - FACE**2) for r in (INNER, OUTER))
    return OVERLAP * YOUNG / (1.0 - POISSON**2) / (FACE * stretch)


@pytest.mark.parametrize("solver", ["auto", "monolithic", "newton"])
def test_a_shrunk_ring_presses_and_stays(solver):
    simulation = xf.Simulation(shrunk(), 1.0, inertia=False, solver=solver)
    loads = []
    for _ in simulation.steps(3.0):
        loads.append([simulation.reaction(tag)[1] for tag in (2, 4)])
    loads = np.array(loads) / (pressure() * FACE)
    assert loads.sum(axis=1) == pytest.approx(0.0, abs=1e-6)
    assert np.abs(loads[0]) == pytest.approx(1.0, rel=4e-3)
    # nodes lie in the corners of the other ring, and do not slide off one side of them
    assert loads == pytest.approx(np.tile(loads[0], (len(loads), 1)), rel=1e-6)
