# SPDX-License-Identifier: LGPL-3.0-or-later
"""A vertex of initially rigid bonds opens where no admissible tractions hold it together."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.optimize import minimize

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.laws import RigidCohesiveZone, RigidMixedMode
from xper_fx.nscd.points import InteractionPoints, frame_from_normal
from xper_fx.nscd.solvers.solver import SolveOptions
from xper_fx.nscd.splitting.splitting_vertices import SplittingVertices

# Six corners of unit mass: a ring with a chord, and a web as of tetrahedra.
BONDS = {
    2: [(1, 0), (1, 2), (2, 3), (4, 3), (4, 5), (0, 5), (0, 3)],
    3: [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 5), (3, 5), (4, 5), (1, 3), (4, 2)],
}


def vertex(dim):
    """Its points, whose normals point anywhere."""
    rng, nodes = np.random.default_rng(4), np.array(BONDS[dim], np.int32)[:, :, None]
    normals = rng.normal(size=(len(nodes), dim))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    area = rng.uniform(0.6, 2.0, len(nodes))
    return InteractionPoints(
        nodes, np.ones(nodes.shape), frame_from_normal(normals), area, np.zeros(len(nodes))
    )


def load_factor(velocity, bears):
    """The largest factor of velocities that some admissible flow stops, by optimisation.

    Flows are those that stop the corners, and any along the rings of the graph.
    """
    dim = velocity.shape[1]
    points, give = vertex(dim), np.zeros((6, len(BONDS[dim])))
    for q, (candidate, antagonist) in enumerate(BONDS[dim]):
        give[candidate, q], give[antagonist, q] = 1.0, -1.0
    one = np.linalg.pinv(give) @ (velocity.mean(axis=0) - velocity)
    rings = null_space(give)

    def margins(x):
        flow = x[-1] * one + rings @ x[:-1].reshape(-1, dim)
        return bears(-np.einsum("qij,qj->qi", points.frame, flow) / points.area[:, None])

    start = np.append(np.zeros(dim * rings.shape[1]), 0.1)
    found = minimize(
        lambda x: -x[-1], start, method="SLSQP", constraints={"type": "ineq", "fun": margins},
        options={"maxiter": 500, "ftol": 1e-8},
    )  # fmt: skip
    assert found.success
    return found.x[-1]


def opened(law, velocity):
    """How many bonds a unit step opens."""
    dim = velocity.shape[1]
    points, inverse = vertex(dim), BodyInverse.from_uniform(np.tile(np.eye(dim), (6, 1, 1)), dim)
    interactions = Interactions(
        points, [law], np.zeros(len(points), int), inverse, 0.0 * velocity, "vertices", splits=True
    )
    interactions.begin_step(1.0, 0.5)
    v = np.append(velocity.ravel(), np.zeros(dim))
    report = SplittingVertices().solve(interactions, v, SolveOptions(tolerance=1e-9))
    assert report.converged
    interactions.commit(v)
    momentum = v[:-dim].reshape(6, dim).sum(axis=0)
    np.testing.assert_allclose(momentum, velocity.sum(axis=0), atol=1e-12)
    if interactions.fused.whole.all():
        return 0
    return np.count_nonzero(interactions.gather("opening_max"))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    ("law", "shear", "friction", "dim"),
    [
        (RigidCohesiveZone(1.0, 5.0), 1.0, 0.0, 2),
        (RigidCohesiveZone(1.0, 5.0), 1.0, 0.0, 3),
        (RigidMixedMode((1.0, 2.5), (5.0, 9.0), 1.2), 2.5, 0.0, 2),
        (RigidMixedMode((1.0, 2.5), (5.0, 9.0), 1.2, friction=0.1), 2.5, 0.1, 3),
    ],
)
def test_a_vertex_opens_at_its_limit(seed, law, shear, friction, dim):
    """Circle or ellipse of tractions, and friction under pressure."""

    def bears(pull):
        tension = np.maximum(pull[:, 0], 0.0)
        borne = shear + friction * np.maximum(-pull[:, 0], 0.0)
        return 1.0 - tension**2 - np.sum(pull[:, 1:] ** 2, axis=1) / borne**2

    velocity = np.random.default_rng(seed).normal(size=(6, dim))
    limit = load_factor(velocity, bears)
    assert opened(law, 1.02 * limit * velocity) > 0
    if friction == 0.0:  # friction is not associated: what it could hold may slip all the same
        assert opened(law, 0.98 * limit * velocity) == 0
