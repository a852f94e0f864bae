# SPDX-License-Identifier: LGPL-3.0-or-later
"""No cell passes a bound of its strain unseen, and cells far from it are not looked at."""

import numpy as np
import pytest
import ufl
from dolfinx import fem
from scenes import box_bodies

from xper_fx.bulk.strain_watch import StrainWatch
from xper_fx.forms.dynamics import BulkForms
from xper_fx.forms.shape_gradients import ShapeGradients
from xper_fx.materials import NeoHookean

BOUND = 0.1


def watched(kind, order):
    size = (1.0, 1.0, 1.0)[: 3 if kind in ("tetrahedron", "hexahedron") else 2]
    bodies = box_bodies(size, (2,) * len(size), kind, label=0)
    # corners that are none: Jacobians of squares and hexahedra differ from point to point
    x = bodies.mesh.geometry.x
    x[:, 0] += 0.15 * x[:, 1] * x[:, 0]
    forms = BulkForms(bodies, order, {1: NeoHookean(1.0, 0.3, 1.0)})
    points, _ = forms.quadrature
    gradient = fem.Expression(ufl.grad(forms.u), points)
    cells = np.arange(len(forms.V.dofmap.list), dtype=np.int32)

    def strains(place, inverses):
        """Of all cells, by another way."""
        forms.u.x.array[:] = place.ravel()
        dim = len(size)
        F = np.eye(dim) + gradient.eval(bodies.mesh, cells).reshape(len(cells), -1, dim, dim)
        f = F @ inverses
        e = 0.5 * (np.swapaxes(f, -1, -2) @ f - np.eye(dim))
        return np.abs(e).sum(axis=-1).max(axis=(1, 2)), np.linalg.inv(F)

    return StrainWatch(forms.V, points), strains, forms.V.tabulate_dof_coordinates()[:, : len(size)]


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("kind", ["triangle", "quadrilateral", "tetrahedron", "hexahedron"])
def test_what_is_beyond_the_bound_is_seen_at_once(kind, order):
    """Nodes wander at random, here and there by more, in matter that was strained before."""
    watch, strains, x = watched(kind, order)
    rng = np.random.default_rng(3)
    place = 0.3 * x**2
    watch.count_from(place)
    _, inverses = strains(place, np.eye(x.shape[1]))
    np.testing.assert_allclose(watch.inverses, inverses, rtol=1e-11, atol=1e-12)
    seen = 0
    for number in range(300):
        kick = 0.05 if number % 50 == 49 else 2e-4
        place = place + kick * rng.normal(size=x.shape) * (rng.random(x.shape) < 0.2)
        exact = strains(place, watch.inverses)[0].max()
        found = watch.largest(place, BOUND)
        assert found <= exact * (1.0 + 1e-9)
        if exact > BOUND:
            assert found == pytest.approx(exact, rel=1e-9)
            watch.count_from(place)
            seen += 1
    assert 3 <= seen < 60


def test_cells_that_are_hardly_strained_are_looked_at_seldom():
    """A body that is carried along is not looked at, one that turns each hundredth of a radian."""
    watch, _, x = watched("tetrahedron", 1)
    looks = 0
    for number in range(1, 1001):
        place = number * np.array([1.0, -2.0, 3.0]) + 0.003 * np.sin(0.01 * number) * x
        looks += watch.largest(place, BOUND) > 0.0
    assert looks <= 2
    looks = 0
    for angle in np.linspace(0.0, 1.0, 1001):
        c, s = np.cos(angle), np.sin(angle)
        turned = x @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]).T
        before = watch._kept.copy()
        assert watch.largest(turned - x, BOUND) < 1e-2
        looks += np.any(watch._kept != before, axis=(1, 2)).mean()
    assert 5 < looks < 200


def test_displacement_gradients_are_bounded_by_what_nodes_move():
    """Of triangles: grad N_n are the rows of the inverse of the edges."""
    bodies = box_bodies((1.0, 1.0), (2, 2), "triangle", label=0)
    V = fem.functionspace(bodies.mesh, ("Lagrange", 1, (2,)))
    shapes = ShapeGradients.of(V, np.array([[1 / 3, 1 / 3]]))
    x = V.tabulate_dof_coordinates()[:, :2][shapes.dofmap]
    gradients = np.linalg.inv(x[:, 1:] - x[:, :1])
    expected = np.linalg.norm(gradients, axis=1).sum(axis=1)
    np.testing.assert_allclose(shapes.spread(), expected, rtol=1e-13)


def test_a_bound_that_gets_smaller_holds_at_once():
    watch, strains, x = watched("triangle", 1)
    place = 0.05 * x
    assert watch.largest(place, 0.5) == pytest.approx(strains(place, np.eye(2))[0].max())
    assert watch.largest(place, 0.4) > 0.05
    assert watch.largest(place, 0.4) == 0.0
