"""Contacts of rigid bodies with images, against all pairs of images and copies of the cell."""

from itertools import product

import numpy as np
import pytest

from xper_fx.nscd.ordering import order_points
from xper_fx.nscd.rigid import Cluster, Disc, Polygon, RigidBody, Sphere
from xper_fx.nscd.rigid.bodies import RigidBodies
from xper_fx.nscd.search.periodic_search import PeriodicSearch, short_basis
from xper_fx.nscd.search.rigid_search import RigidSearch

# Sheared along the first period.
PLANE = np.array([[4.0, 0.0], [-0.7, 3.0]])
SPACE = np.array([[4.0, 0.0, 0.0], [-0.7, 3.0, 0.0], [0.4, -0.3, 3.5]])


def balls(count: int, dim: int, seed: int) -> RigidBodies:
    rng = np.random.default_rng(seed)
    shape = Disc if dim == 2 else Sphere
    return RigidBodies(
        [
            RigidBody(shape(radius), place, "g", density=1.0)
            for radius, place in zip(
                rng.uniform(0.2, 0.5, count), rng.uniform(-9.0, 9.0, (count, dim)), strict=True
            )
        ]
    )


def all_images(bodies, position, vectors, reach) -> dict:
    """Gap of each pair (i, j, n) of a ball and an image within the reach."""
    i, j = np.triu_indices(len(bodies), 1)
    numbers = short_basis(vectors)
    apart, basis = position[j] - position[i], numbers @ vectors
    n = -np.rint(apart @ np.linalg.pinv(basis)).astype(int)[:, None]
    n = n + list(product((-2, -1, 0, 1, 2), repeat=len(vectors)))
    gap = np.linalg.norm(apart[:, None] + n @ basis, axis=2)
    gap -= bodies.shapes.radius[i, None] + bodies.shapes.radius[j, None]
    pair, image = np.nonzero(gap <= reach)
    names = np.column_stack([i[pair], j[pair], n[pair, image] @ numbers])
    return dict(zip(map(tuple, names.tolist()), gap[pair, image], strict=True))


@pytest.mark.fast
@pytest.mark.parametrize(("lattice", "count"), [(PLANE, 16), (PLANE[:1], 30), (SPACE, 20)])
def test_all_contacts_are_found_while_bodies_move_and_the_cell_is_sheared(lattice, count):
    """Up to five periods of shear, each contact once, under the name of its image."""
    dim = lattice.shape[1]
    bodies = balls(count, dim, seed=3)
    if len(lattice) < dim:  # free across the period
        bodies.position[:, 1] *= 0.2
    rng, reach, gradient = np.random.default_rng(1), 0.05, np.eye(dim)
    search = PeriodicSearch(bodies, [("g", "g")], reach, lattice)
    rotation = bodies.rotation
    label, velocity, seen = bodies.position.copy(), rng.normal(0.0, 0.002, (count, dim)), 0
    for step in range(45):
        if len(lattice) == dim:  # bodies go with the cell, and on their own
            gradient = gradient - 0.004 * np.eye(dim)
            gradient[0, 1] += 0.008 if step < 35 else 0.5
        position = label @ gradient.T
        contacts = search.find(position, rotation, gradient if len(lattice) == dim else None)
        vectors = lattice @ gradient.T
        expected = all_images(bodies, position, vectors, reach)
        pair = np.column_stack(np.divmod(contacts.key[:, 0], count))
        names = [tuple(row) for row in np.column_stack([pair, contacts.key[:, 1:-1]]).tolist()]
        assert sorted(names) == sorted(expected)
        assert np.allclose(contacts.gap, [expected[name] for name in names], atol=1e-11)
        # the candidate is the lower body; centres of what touches lie along the normal
        assert np.array_equal(contacts.body, pair)
        centre = position[contacts.body] + search.offset
        along = contacts.normal * (contacts.gap + bodies.shapes.radius[pair].sum(1))[:, None]
        assert np.allclose(centre[:, 0] - centre[:, 1], along, atol=1e-11)
        label += velocity
        seen += len(names)
    assert seen > 60
    assert search.renewals < 40  # lists serve for more than a step where little moves


BOX = Polygon([(-0.5, -0.4), (0.5, -0.4), (0.5, 0.4), (-0.5, 0.4)])
CORNER = Cluster(
    [
        Polygon([(-0.5, -0.4), (0.5, -0.4), (0.5, 0.0), (-0.5, 0.0)]),
        Polygon([(-0.5, 0.0), (0.1, 0.0), (0.1, 0.5), (-0.5, 0.5)]),
    ]
)


@pytest.mark.fast
@pytest.mark.parametrize("shape", [BOX, CORNER], ids=["polygons", "clusters"])
def test_bodies_with_corners_meet_images_as_they_meet_copies(shape):
    """Contacts of a cell are those that nine copies of it have, wherever its bodies are put."""
    rng, lattice, count = np.random.default_rng(5), np.array([[3.2, 0.0], [0.4, 3.0]]), 9
    places = np.stack(np.meshgrid(range(3), range(3)), -1).reshape(-1, 2) @ lattice / 3.0
    places = places + rng.uniform(-0.05, 0.05, places.shape)
    angles = rng.uniform(-0.3, 0.3, count)

    def bodies(places, angles):
        return RigidBodies(
            [
                RigidBody(shape, p, "g", density=1.0, angle=a)
                for p, a in zip(places, angles, strict=True)
            ]
        )

    shifts = np.array(list(product((0, -1, 1), repeat=2))) @ lattice
    copied = bodies((places + shifts[:, None]).reshape(-1, 2), np.tile(angles, 9))
    contacts = RigidSearch(copied, [("g", "g")], 0.1).find(copied.position, copied.rotation)
    copy = contacts.body // count
    sides = np.count_nonzero(copy == 0, axis=1)  # across the border a contact is there twice
    expected = np.sort(np.repeat(contacts.gap, sides))

    own = bodies(places, angles)
    first = None
    for offset in (0.0, rng.integers(-4, 5, (count, 2)) @ lattice + 0.37):
        search = PeriodicSearch(own, [("g", "g")], 0.1, lattice)
        found = search.find(places + offset, angles)
        assert len(found) > 12
        assert np.allclose(np.sort(np.repeat(found.gap, 2)), expected, atol=1e-12)
        arms = found.point[:, None] - (places + offset)[found.body] - search.offset
        told = np.column_stack([found.key[:, [0, -1]], arms.reshape(-1, 4), found.normal])
        told = told[np.lexsort(np.round(told, 9).T[::-1])]
        if first is not None:
            assert np.allclose(told, first, atol=1e-11)
        first = told


@pytest.mark.fast
def test_a_restarted_search_keeps_its_lists():
    bodies = balls(16, 2, seed=3)
    searches = [PeriodicSearch(bodies, [("g", "g")], 0.05, PLANE) for _ in range(2)]
    position, gradient = bodies.position.copy(), np.eye(2)
    for _ in range(3):
        searches[0].find(position, bodies.rotation, gradient)
        gradient = gradient + [[0.0, 0.003], [0.0, 0.001]]
    searches[1].restore(searches[0].saved())
    before = searches[0].renewals - searches[1].renewals
    for _ in range(20):
        a, b = (s.find(position, bodies.rotation, gradient) for s in searches)
        assert all(map(np.array_equal, a, b))
        assert searches[0].renewals - searches[1].renewals == before
        gradient = gradient + [[0.0, 0.003], [0.0, 0.001]]
    assert searches[0].renewals > 2


@pytest.mark.fast
def test_a_body_that_touches_its_image_is_told():
    bodies = RigidBodies([RigidBody(Disc(0.5), (0.2, 9.0), "g", density=1.0)])
    search = PeriodicSearch(bodies, [("g", "g")], 0.01, np.diag([1.005, 3.0]))
    with pytest.raises(ValueError, match="body 0 touches its own image"):
        search.find(bodies.position, bodies.rotation)


@pytest.mark.fast
def test_short_basis_of_a_sheared_lattice():
    numbers = short_basis(np.array([[1.0, 0.0, 0.0], [7.3, 1.0, 0.0], [-4.9, 2.2, 1.0]]))
    assert abs(round(np.linalg.det(numbers))) == 1
    basis = numbers @ [[1.0, 0.0, 0.0], [7.3, 1.0, 0.0], [-4.9, 2.2, 1.0]]
    assert np.linalg.norm(basis, axis=1).max() < 1.2


@pytest.mark.fast
def test_points_that_all_move_one_block_are_visited_by_one_thread():
    """Tiles share the cell, so that no two may have one colour."""
    bodies = np.arange(3000)
    blocks = np.column_stack([bodies, bodies + 1, np.full(3000, 3001)])
    ordering = order_points(blocks, 3003)
    assert len(ordering.tile_offsets) - 1 > 5
    assert np.array_equal(np.diff(ordering.color_offsets), np.ones(len(ordering.tile_offsets) - 1))
    assert len(order_points(blocks[:, :2], 3003).color_offsets) < 4
