# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vertices that have split: what leaves them is one solution, velocities and impulses alike."""

from __future__ import annotations

import numpy as np
import pytest

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.laws import PerfectBond, RigidCohesiveZone, SignoriniCoulomb
from xper_fx.nscd.points import InteractionPoints, frame_from_normal
from xper_fx.nscd.solvers import VertexBlocks
from xper_fx.nscd.solvers.solver import SolveOptions
from xper_fx.nscd.splitting.splitting_vertices import SplittingVertices

STEP, MASS = 1e-3, 1.0 / 12.0


@pytest.mark.parametrize("tilt", [0.0, 0.01])
@pytest.mark.parametrize("bonds", [2, 8, 16])
def test_velocities_are_those_of_the_impulses(bonds, tilt):
    """Bonds that share both corners are redundant: Newton's corrections are far larger than the
    answer, come and go, and leave their rounding in the velocities that vertices iterate with."""
    rng, nodes = np.random.default_rng(2), np.zeros((bonds, 2, 1), np.int32)
    nodes[:, 1] = 1
    angle = tilt * rng.normal(size=bonds)
    normals = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    frame = frame_from_normal(normals)
    points = InteractionPoints(
        nodes, np.ones(nodes.shape), frame, np.full(bonds, 0.5), np.zeros(bonds)
    )
    inverse = BodyInverse.from_uniform(np.tile(np.eye(2) / MASS, (2, 1, 1)), 2)
    law, solver = RigidCohesiveZone(1.0, 0.05, friction=0.9), SplittingVertices()
    scene = Interactions(
        points, [law], np.zeros(bonds, int), inverse, ordering="vertices", splits=True
    )
    off = swept = pressed = 0
    for n in range(200):
        opens, noise = (3.0, 0.0) if n == 0 else (-0.5, 1.0)
        free = opens * np.array([[0.0, 1.0], [0.0, -1.0]]) + noise * rng.normal(size=(2, 2))
        v = np.append(free, np.zeros((1, 2)))
        scene.begin_step(STEP, 0.5)
        report = solver.solve(scene, v, SolveOptions(tolerance=1e-10))
        assert report.converged
        impulse = scene.gather("impulse")
        given = np.einsum("pi,pij->j", impulse, points.frame)
        off = max(off, np.abs(v[:4].reshape(2, 2) - free - np.stack([given, -given]) / MASS).max())
        swept, pressed = max(swept, report.sweeps), pressed + (impulse[:, 0].sum() > 0.0)
        scene.commit(v)
    assert pressed > 50 and (swept > 12 if tilt else True)
    assert off < 2e-14


@pytest.mark.parametrize("splits", [False, True])
def test_a_gap_of_rounding_is_closed(splits):
    """Beside other bonds, too: what touches takes an impact at once, whatever rounding leaves."""
    nodes = np.array([[[0], [1]], [[2], [3]]], np.int32)
    inverse = BodyInverse.from_uniform(np.tile(np.eye(2) / MASS, (4, 1, 1)), 2)
    laws = [SignoriniCoulomb(0.3), RigidCohesiveZone(1.0, 0.05) if splits else PerfectBond()]
    for gap, left in ((1e-12, 0.0), (1e-5, -2e-3)):
        points = InteractionPoints(
            nodes, np.ones(nodes.shape), frame_from_normal(np.tile([0.0, 1.0], (2, 1))),
            np.full(2, 0.5), np.array([gap, 0.0]),
        )  # fmt: skip
        scene = Interactions(
            points, laws, np.arange(2), inverse, ordering="vertices", splits=splits
        )
        v = np.zeros((inverse.num_slots, 2))
        v[:2, 1] = -1e-3, 1e-3
        v = v.ravel()
        scene.begin_step(STEP, 0.5)
        solver = SplittingVertices() if splits else VertexBlocks()
        assert solver.solve(scene, v, SolveOptions(tolerance=1e-10)).converged
        assert v[1] - v[3] == pytest.approx(left, abs=1e-15)
