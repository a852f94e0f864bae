# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motions of some nodes of tagged facets: rollers and knife edges hold no rotation."""

import numpy as np
import pytest
from scenes import BOTTOM, TOP, box_bodies

import xper_fx as xf

SPAN, HEIGHT, YOUNG, SAG = 1.0, 0.05, 1e9, 1e-3


def along(*places):
    """Nodes at given x."""
    return lambda x: np.isclose(x[0][:, None], places, atol=1e-9).any(axis=1)


def beam(dim, where, motion=xf.PrescribedDisplacement, value=lambda t: -SAG * t):
    """A beam on two supports, pushed down in the middle by 1 mm in a second."""
    lengths, cells = (SPAN, HEIGHT, HEIGHT)[:dim], (40, 2, 1)[:dim]
    kind = "quadrilateral" if dim == 2 else "hexahedron"
    ends, left, middle = where
    fixed = [xf.PrescribedDisplacement(BOTTOM, k, 0.0, where=left) for k in (0, 2)[: dim - 1]]
    return xf.Scene(
        box_bodies(lengths, cells, kind, label=0),
        {1: xf.materials.LinearElastic(YOUNG, 0.0, 1000.0)},
        loads=[
            xf.PrescribedDisplacement(BOTTOM, 1, 0.0, where=ends),
            *fixed,
            motion(TOP, 1, value, where=middle),
        ],
        order=2,
    )


NODES = along(0.0, SPAN), along(0.0), along(0.5 * SPAN)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(
    "motion, value",
    [(xf.PrescribedDisplacement, lambda t: -SAG * t), (xf.PrescribedVelocity, -SAG)],
)
def test_a_beam_on_rollers(dim, motion, value):
    """Timoshenko: SAG = P (L^3 / (48 E I) + L / (4 kappa mu A)); clamped ends would bear 4 P."""
    simulation = xf.Simulation(beam(dim, NODES, motion, value), 1.0, inertia=False)
    for _ in simulation.steps(1.0):
        pass
    width = 1.0 if dim == 2 else HEIGHT
    bending = SPAN**3 / (4.0 * YOUNG * width * HEIGHT**3)
    shear = SPAN / (4.0 * 5.0 / 6.0 * 0.5 * YOUNG * width * HEIGHT)
    load = simulation.reaction(TOP)
    assert -load[1] == pytest.approx(SAG / (bending + shear), rel=0.01)
    # what is not prescribed bears nothing, and the supports bear the load
    assert abs(load[0]) < 1e-9 * abs(load[1])
    assert simulation.reaction(BOTTOM) == pytest.approx(-load, abs=1e-6 * abs(load[1]))


def test_two_motions_may_share_facets_but_no_node():
    ends, left, middle = NODES
    beam(2, (ends, along(0.5 * SPAN), middle))
    loads = [
        xf.PrescribedDisplacement(BOTTOM, 1, 0.0, where=ends),
        xf.PrescribedDisplacement(BOTTOM, 1, lambda t: t, where=along(0.5 * SPAN)),
    ]
    bodies, material = box_bodies((SPAN, HEIGHT), (4, 1)), xf.materials.LinearElastic(1e9, 0.0, 1.0)
    xf.Scene(bodies, {1: material}, default_interaction=xf.laws.PerfectBond(), loads=loads)
    loads[1] = xf.PrescribedDisplacement(BOTTOM, 1, lambda t: t, where=left)
    with pytest.raises(ValueError, match="prescribe the same component of the same nodes"):
        xf.Scene(bodies, {1: material}, default_interaction=xf.laws.PerfectBond(), loads=loads)


def in_the_middle(x):
    """Nodes in the middle of a face of the unit cube that y runs through."""
    return np.isclose(x[[0, 2]], 0.5).all(axis=0)


@pytest.mark.parametrize("kind", ["triangle", "quadrilateral", "tetrahedron", "hexahedron"])
def test_nodes_in_the_middle_of_edges_and_faces_have_one_motion(kind):
    """Two motions that share no vertex may share the middle of an edge or of a face."""
    dim = 2 if kind in ("triangle", "quadrilateral") else 3
    bodies = box_bodies((1.0,) * dim, (1,) * dim, kind, label=0)
    material = {1: xf.materials.LinearElastic(1e9, 0.0, 1.0)}

    def scene(first, second, order):
        loads = [
            xf.PrescribedVelocity(BOTTOM, 1, 0.0, where=first),
            xf.PrescribedVelocity(BOTTOM, 1, 1.0, where=second),
        ]
        xf.Scene(bodies, material, loads=loads, order=order)

    scene(lambda x: x[0] < 0.4, lambda x: x[0] > 0.4, 2)
    overlapping = lambda x: x[0] < 0.6, lambda x: x[0] > 0.4
    scene(*overlapping, 1)
    with pytest.raises(ValueError, match="prescribe the same component of the same nodes"):
        scene(*overlapping, 2)
    if kind == "hexahedron":
        scene(in_the_middle, lambda x: ~in_the_middle(x), 2)


@pytest.mark.parametrize(
    "where, error, words",
    [
        (along(0.1234), ValueError, "holds at no node"),
        (lambda x: x[0], TypeError, "returned float64; expected bool"),
        (lambda x: x > 0.0, ValueError, "returned shape"),
        (0.5, TypeError, "is 0.5; expected a function of positions"),
    ],
)
def test_places_that_are_none_are_refused(where, error, words):
    with pytest.raises(error, match=words):
        beam(2, (where, NODES[1], NODES[2]))
