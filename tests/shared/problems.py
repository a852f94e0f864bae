# SPDX-License-Identifier: LGPL-3.0-or-later
"""Frictional contact problems of rigid bodies, made from geometry: u = W r + q.

Each generator returns `(W, q, mu, dim)` with W = H^T M^-1 H as CSR, q = H^T (v + h g), mu one a
contact; normal first, opening positive, impulses in N s on the candidate along the normal. Ground
and walls are at rest, so that v = 0 is admissible, H^T v being in the dual of the friction cone. In
2D, where cones are polyhedral, the fixed point on |u_T| of Acary et al. 2011 then has a solution;
in 3D they ask for a velocity that opens every contact at once, which a pile on open ground has: it
expands upwards. Said otherwise where it is not so. The same arguments and seed give the same
numbers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

GRAVITY = 9.81
STEP = 1e-2
FIXED = -1  # the antagonist of a contact with ground or wall


class Problem(NamedTuple):
    W: sp.csr_matrix
    q: np.ndarray
    mu: np.ndarray
    dim: int


class Contacts(NamedTuple):
    """Points, shape (n, dim); normals from antagonist to candidate; bodies, FIXED for none."""

    points: np.ndarray
    normals: np.ndarray
    candidates: np.ndarray
    antagonists: np.ndarray


def frames(normals):
    """Orthonormal (n, t) or (n, t1, t2) in rows, shape (num_contacts, dim, dim); in 2D t = +90."""
    if normals.shape[1] == 2:
        tangents = np.stack([-normals[:, 1], normals[:, 0]], axis=1)
        return np.stack([normals, tangents], axis=1)
    away = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = np.cross(normals, away)
    first /= np.linalg.norm(first, axis=1)[:, None]
    return np.stack([normals, first, np.cross(normals, first)], axis=1)


def motion_at(lever):
    """Velocity of a point = this @ (velocity, spin); shape (n, dim, 3 or 6), lever from centre."""
    n, dim = lever.shape
    if dim == 2:
        turned = np.stack([-lever[:, 1], lever[:, 0]], axis=1)[:, :, None]
    else:
        x, y, z = lever.T
        o = np.zeros(n)
        turned = np.stack([o, z, -y, -z, o, x, y, -x, o], axis=1).reshape(n, 3, 3)
    return np.concatenate([np.broadcast_to(np.eye(dim), (n, dim, dim)), turned], axis=2)


def transfer(centres, contacts):
    """H^T, shape (dim * num_contacts, dofs): from body velocities to relative local velocities."""
    dim = centres.shape[1]
    dofs = 3 if dim == 2 else 6
    n = len(contacts.points)
    frame = frames(contacts.normals)
    total = sp.csr_matrix((dim * n, dofs * len(centres)))
    for sign, bodies in ((1.0, contacts.candidates), (-1.0, contacts.antagonists)):
        here = np.flatnonzero(bodies >= 0)
        body = bodies[here]
        blocks = sign * frame[here] @ motion_at(contacts.points[here] - centres[body])
        rows = (dim * here[:, None, None] + np.arange(dim)[:, None]) + 0 * np.arange(dofs)
        columns = dofs * body[:, None, None] + np.arange(dofs) + 0 * np.arange(dim)[:, None]
        total += sp.csr_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=total.shape)
    return total


def reduced(centres, masses, inertias, contacts, mu, velocity=None):
    """The problem of bodies under gravity along the last axis, over one step.

    Args:
        centres: shape (num_bodies, dim), m.
        masses: shape (num_bodies,), kg.
        inertias: shape (num_bodies,) in 2D, (num_bodies, 3, 3) in 3D, about the centre, kg m^2.
        contacts: `Contacts`.
        mu: a number, or one a contact.
        velocity: shape (num_bodies, 3 or 6), velocity then spin; at rest if None.
    """
    num_bodies, dim = centres.shape
    dofs = 3 if dim == 2 else 6
    inverse = np.zeros((num_bodies, dofs, dofs))
    inverse[:, :dim, :dim] = np.eye(dim) / masses[:, None, None]
    inverse[:, dim:, dim:] = np.linalg.inv(np.reshape(inertias, (num_bodies, dofs - dim, -1)))
    free = np.zeros((num_bodies, dofs)) if velocity is None else np.array(velocity, dtype=float)
    free[:, dim - 1] -= STEP * GRAVITY
    H_T = transfer(centres, contacts)
    index = np.arange(num_bodies + 1)
    M_inverse = sp.bsr_matrix((inverse, index[:-1], index)).tocsr()
    W = (H_T @ M_inverse @ H_T.T).tocsr()
    W.sum_duplicates()
    n = len(contacts.points)
    return Problem(W, H_T @ free.ravel(), np.array(np.broadcast_to(mu, n), dtype=float), dim)


def join(*several):
    """One `Contacts` from several."""
    return Contacts(*(np.concatenate(part) for part in zip(*several, strict=True)))


# Axis-aligned boxes: they touch where their faces do.


def boxes_in_contact(lower, upper):
    """Contacts at the corners of the faces shared by boxes, and with the ground at height 0.

    Args:
        lower, upper: shape (num_boxes, dim).
    """
    n, dim = lower.shape
    tolerance = 1e-9 * (upper - lower).min()
    corner = np.stack(np.meshgrid(*[[0, 1]] * (dim - 1), indexing="ij"), axis=-1)
    corner = corner.reshape(-1, dim - 1)
    found = []
    low = np.concatenate([lower, [[*lower[:, :-1].min(axis=0), -1.0]]])  # the ground, last
    up = np.concatenate([upper, [[*upper[:, :-1].max(axis=0), 0.0]]])
    for axis in range(dim):
        others = [k for k in range(dim) if k != axis]
        below, above = np.nonzero(np.abs(up[:, None, axis] - low[None, :, axis]) <= tolerance)
        begin = np.maximum(low[below], low[above])[:, others]
        end = np.minimum(up[below], up[above])[:, others]
        keep = (above < n) & (end - begin > tolerance).all(axis=1)
        below, above, begin, end = below[keep], above[keep], begin[keep], end[keep]
        points = np.empty((len(below), len(corner), dim))
        points[:, :, axis] = up[below, axis][:, None]
        points[:, :, others] = begin[:, None] + corner * (end - begin)[:, None]
        each = len(corner)
        found.append(
            Contacts(
                points.reshape(-1, dim),
                np.tile(np.eye(dim)[axis], (len(below) * each, 1)),
                np.repeat(above, each),
                np.repeat(np.where(below < n, below, FIXED), each),
            )
        )
    return join(*found)


def box_inertias(masses, sizes):
    """About the centre: shape (n,) in 2D, (n, 3, 3) in 3D."""
    squares = sizes**2
    total = squares.sum(axis=1)
    if sizes.shape[1] == 2:
        return masses * total / 12.0
    inertias = np.zeros((len(sizes), 3, 3))
    inertias[:, range(3), range(3)] = masses[:, None] * (total[:, None] - squares) / 12.0
    return inertias


def box_problem(lower, upper, mu, density=1000.0, velocity=None):
    """The problem of axis-aligned boxes standing on the ground at height 0."""
    lower, upper = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    sizes = upper - lower
    masses = density * sizes.prod(axis=1)
    contacts = boxes_in_contact(lower, upper)
    centres = 0.5 * (lower + upper)
    return reduced(centres, masses, box_inertias(masses, sizes), contacts, mu, velocity)


def square_pile(rows, mu=0.5):
    """Unit squares in `rows` rows and columns, two points a face, sides touching: u = 0."""
    lower = np.array([(i, k) for k in range(rows) for i in range(rows)], dtype=float)
    return box_problem(lower, lower + 1.0, mu)


def pyramid(rows, mu=0.5):
    """A 2D pyramid of bricks 2 x 1, each on two others, two points a shared face.

    Neighbours in a row touch too. u = 0.
    """
    lower = [(2.0 * i + k, k) for k in range(rows) for i in range(rows - k)]
    lower = np.array(lower, dtype=float)
    return box_problem(lower, lower + [2.0, 1.0], mu)


def box_stack(n, mu=0.7):
    """`n` unit cubes piled in 3D, 4 points a face: u = 0."""
    lower = np.zeros((n, 3))
    lower[:, 2] = np.arange(n)
    return box_problem(lower, lower + 1.0, mu)


def box_wall(rows, columns, mu=0.6):
    """A brick wall in 3D, bricks 2 x 1 x 1 laid half over half, 4 points a shared face: u = 0.

    Every other row ends with half bricks.
    """
    lower, upper = [], []
    for row in range(rows):
        whole = 2.0 * np.arange(columns + 1)
        joints = whole if row % 2 == 0 else np.concatenate([[0.0], whole[:-1] + 1.0, [whole[-1]]])
        lower += [(x, 0.0, row) for x in joints[:-1]]
        upper += [(x, 1.0, row + 1.0) for x in joints[1:]]
    return box_problem(lower, upper, mu)


def column_with_mass_ratio(n, ratio, dim=3, mu=0.5):
    """`n` light cubes (squares in 2D) under one `ratio` times heavier: u = 0."""
    lower = np.zeros((n + 1, dim))
    lower[:, -1] = np.arange(n + 1)
    density = np.full(n + 1, 1000.0)
    density[-1] *= ratio
    return box_problem(lower, lower + 1.0, mu, density)


def impact(n, speed=3.0, mu=0.4):
    """A stack of `n` cubes on the ground, hit from the side on the topmost by another cube."""
    lower = np.zeros((n + 1, 3))
    lower[:, 2] = np.arange(n + 1)
    lower[n] = (-1.0, 0.25, n - 0.75)
    velocity = np.zeros((n + 1, 6))
    velocity[n, 0] = speed
    return box_problem(lower, lower + 1.0, mu, velocity=velocity)


def redundant_points(n, mu=0.5):
    """A unit cube pushed along the ground, on its 4 corners, one of them written `n` times."""
    lower, upper = np.zeros((1, 3)), np.ones((1, 3))
    contacts = boxes_in_contact(lower, upper)
    contacts = join(contacts, *[Contacts(*(part[:1] for part in contacts))] * (n - 1))
    masses = np.array([1000.0])
    inertias = box_inertias(masses, upper)
    velocity = [[0.1, 0.05, 0.0, 0.0, 0.0, 0.2]]
    return reduced(np.array([[0.5, 0.5, 0.5]]), masses, inertias, contacts, mu, velocity)


def sliver(aspect=1e4, mu=0.5):
    """A needle of length 1 and thickness 1 / `aspect` on the ground, another laid across it.

    The upper one is pushed along itself: sliding, at four points 1 / `aspect` apart.
    """
    d = 1.0 / aspect
    lower = np.array([[0.0, 0.0, 0.0], [0.5 - d / 2, -0.5 + d / 2, d]])
    upper = np.array([[1.0, d, d], [0.5 + d / 2, 0.5 + d / 2, 2 * d]])
    velocity = np.zeros((2, 6))
    velocity[1, 1] = 0.5
    return box_problem(lower, upper, mu, velocity=velocity)


def arch_bodies(blocks, thickness_ratio):
    """Centres, masses, inertias and contacts of a semicircular arch of mean radius 1.

    Voussoirs are annular sectors, two points a joint, intrados first, on fixed springings.
    """
    inner, outer = 1.0 - 0.5 * thickness_ratio, 1.0 + 0.5 * thickness_ratio
    half = 0.5 * np.pi / blocks
    middle = half * (2 * np.arange(blocks) + 1)
    radius = 2 / 3 * np.sin(half) / half * (outer**3 - inner**3) / (outer**2 - inner**2)
    centres = radius * np.stack([np.cos(middle), np.sin(middle)], axis=1)
    mass = 2500.0 * half * (outer**2 - inner**2)
    inertia = 2500.0 * half * (outer**4 - inner**4) / 2 - mass * radius**2
    joint = np.repeat(2 * half * np.arange(blocks + 1), 2)
    along = np.stack([np.cos(joint), np.sin(joint)], axis=1)
    points = along * np.tile([inner, outer], blocks + 1)[:, None]
    normals = np.stack([-along[:, 1], along[:, 0]], axis=1)
    after = np.repeat(np.arange(blocks + 1), 2)  # the voussoir that begins at the joint
    last = after == blocks  # whose candidate is the last voussoir, pushed back by the springing
    candidates = np.where(last, blocks - 1, after)
    antagonists = np.where(last | (after == 0), FIXED, after - 1)
    normals[last] *= -1.0
    contacts = Contacts(points, normals, candidates, antagonists)
    return centres, np.full(blocks, mass), np.full(blocks, inertia), contacts


def arch(blocks, thickness_ratio, mu=10.0):
    """A semicircular arch under its weight; it stands, u = 0, for thickness / radius >= 0.1075.

    That limit (Milankovitch 1907) is for many blocks and enough friction; with few it is lower.
    """
    centres, masses, inertias, contacts = arch_bodies(blocks, thickness_ratio)
    return reduced(centres, masses, inertias, contacts, mu)


# Heaps: bodies at random in a box open above, in contact where they come closest.


def closest_on_segments(c1, a1, c2, a2):
    """Parameters of the closest points of segments c + s a, |s| <= 1, one pair a row.

    Clamps one after the other, which ends at the closest pair (Ericson 2005, section 5.1.9).
    """
    d = c2 - c1
    aa, bb, ab = (a1 * a1).sum(1), (a2 * a2).sum(1), (a1 * a2).sum(1)
    ad, bd = (a1 * d).sum(1), (a2 * d).sum(1)
    det = np.maximum(aa * bb - ab * ab, 1e-12 * aa * bb + 1e-300)
    s = np.clip((ad * bb - bd * ab) / det, -1.0, 1.0)
    t_free = (ab * s - bd) / np.maximum(bb, 1e-300)
    t = np.clip(t_free, -1.0, 1.0)
    again = np.clip((ab * t + ad) / np.maximum(aa, 1e-300), -1.0, 1.0)
    return np.where(t == t_free, s, again), t


def heap(num_bodies, num_contacts, layers, half_length, seed, mu, agitation, parallel=0.0):
    """Capsules of radius 1 (spheres if `half_length` is 0) about a jittered lattice in a box.

    The closest `num_contacts` contacts are taken as closed, whatever their small gap.

    Args:
        layers: bodies above one another.
        half_length: half the length of a capsule's axis, in radii.
        agitation: standard deviation of the velocities, in units of h g (and of spins, a radius).
        parallel: share of the capsules that lie along their neighbours in their row.
    """
    rng = np.random.default_rng(seed)
    side = int(np.ceil(np.sqrt(num_bodies / layers)))
    spacing = np.array([2.0 + 1.2 * half_length, 2.0 + 0.3 * half_length, 2.0 + 0.3 * half_length])
    cell = np.arange(num_bodies)
    cell = np.stack([cell % side, cell // side % side, cell // side**2], axis=1)
    centres = spacing * (cell + 0.5) + rng.uniform(-0.15, 0.15, cell.shape)
    axes = np.array([1.0, 0.0, 0.0]) + 0.35 * rng.normal(size=cell.shape)
    axes[rng.random(num_bodies) < parallel] = (1.0, 0.0, 0.0)
    axes *= half_length / np.linalg.norm(axes, axis=1)[:, None]

    i, j = cKDTree(centres).query_pairs(2.2 * half_length + 3.0, output_type="ndarray").T
    s, t = closest_on_segments(centres[i], axes[i], centres[j], axes[j])
    if half_length:  # two points along capsules that are parallel and overlap
        cross = np.linalg.norm(np.cross(axes[i], axes[j]), axis=1) / half_length**2
        middle = ((centres[j] - centres[i]) * axes[i]).sum(1) / half_length**2
        double = np.flatnonzero((cross < 1e-6) & (np.abs(middle) < 1.9))
        low, high = np.maximum(-1.0, middle - 1.0)[double], np.minimum(1.0, middle + 1.0)[double]
        same = np.sign((axes[i] * axes[j]).sum(1))[double]
        s[double], t[double] = low, same * (low - middle[double])
        i, j = np.append(i, i[double]), np.append(j, j[double])
        s, t = np.append(s, high), np.append(t, same * (high - middle[double]))
    on_i, on_j = centres[i] + s[:, None] * axes[i], centres[j] + t[:, None] * axes[j]
    between = on_i - on_j
    distance = np.linalg.norm(between, axis=1)
    found = [Contacts(0.5 * (on_i + on_j), between / distance[:, None], i, j)]
    gaps = [distance - 2.0]

    size = spacing * side
    planes = [(0, 1.0, 0.0), (0, -1.0, size[0]), (1, 1.0, 0.0), (1, -1.0, size[1]), (2, 1.0, 0.0)]
    body = np.arange(num_bodies)
    for axis, sign, place in planes:  # both ends of each capsule against ground and walls
        for end in (-1.0, 1.0) if half_length else (0.0,):
            tip = centres + end * axes
            normal = np.tile(sign * np.eye(3)[axis], (num_bodies, 1))
            found.append(Contacts(tip - normal, normal, body, np.full(num_bodies, FIXED)))
            gaps.append(sign * (tip[:, axis] - place) - 1.0)
    contacts = join(*found)
    closest = np.argsort(np.concatenate(gaps), kind="stable")[:num_contacts]
    contacts = Contacts(*(part[np.sort(closest)] for part in contacts))

    masses = 1000.0 * np.pi * (4 / 3 + 2 * half_length) * np.ones(num_bodies)
    caps, tube = 4000.0 / 3 * np.pi, 2000.0 * np.pi * half_length
    about_axis = 0.4 * caps + 0.5 * tube
    across = caps * (0.4 + 0.75 * half_length + half_length**2)
    across += tube * (0.25 + half_length**2 / 3)
    unit = axes / half_length if half_length else np.zeros_like(axes)
    inertias = across * np.eye(3) + (about_axis - across) * unit[:, :, None] * unit[:, None, :]
    velocity = agitation * STEP * GRAVITY * rng.normal(size=(num_bodies, 6))
    return reduced(centres, masses, inertias, contacts, mu, velocity)


def capsule_heap(n, seed=0, mu=0.7):
    """`n` capsules in a box, 3 contacts a body, many with two points: rank of W about 2/3.

    With n = 90, the statistics of Siconos's Capsules files. Side walls may leave no velocity that
    opens every contact at once: existence is not proved, though v = 0 is admissible.
    """
    return heap(n, 3 * n, 2, 2.0, seed, mu, agitation=0.3, parallel=0.5)


def sphere_heap(n, seed=0, mu=0.5):
    """`n` spheres in a box, 2 contacts a body: W of nearly full rank. Existence: capsule_heap."""
    return heap(n, 2 * n, 5, 0.0, seed, mu, agitation=0.3)


def driven_heap(n, seed=0):
    """Capsules thrown about, far from rest; mu is 0, 0.3 or 2 by contact. As capsule_heap."""
    mu = np.random.default_rng(seed + 1).choice([0.0, 0.3, 2.0], 3 * n)
    return heap(n, 3 * n, 2, 2.0, seed, mu, agitation=20.0, parallel=0.5)


def disks_on_wall(n, seed=0, mu=0.5):
    """About `n` disks of a dense flow down a rough plane, in 2D: layers sheared over a fixed one.

    A triangular packing of which one disk in five is missing; gravity is normal to the plane.
    """
    rng = np.random.default_rng(seed)
    columns = int(np.ceil(np.sqrt(1.25 * n)))
    row, column = np.divmod(np.arange(columns**2), columns)
    kept = rng.random(columns**2) > 0.2
    row, column = row[kept], column[kept]
    centres = np.stack([2.0 * column + row % 2, 1.0 + np.sqrt(3.0) * row], axis=1)
    i, j = cKDTree(centres).query_pairs(2.0 + 1e-9, output_type="ndarray").T
    ground = np.flatnonzero(row == 0)
    contacts = join(
        Contacts(0.5 * (centres[i] + centres[j]), 0.5 * (centres[i] - centres[j]), i, j),
        Contacts(
            centres[ground] - [0.0, 1.0],
            np.tile([0.0, 1.0], (len(ground), 1)),
            ground,
            np.full(len(ground), FIXED),
        ),
    )
    masses = np.full(len(centres), 1000.0 * np.pi)
    velocity = 0.1 * rng.normal(size=(len(centres), 3))
    velocity[:, 0] += 0.2 * centres[:, 1]
    return reduced(centres, masses, 0.5 * masses, contacts, mu, velocity)


def one_object(num_points, seed=0, mu=0.3):
    """One box in a corner, at `num_points` random points of ground and two walls: rank <= 6.

    It is thrown into the corner; it can leave it, so that a solution exists.
    """
    rng = np.random.default_rng(seed)
    size = np.array([1.0, 0.8, 0.5])
    axis = rng.choice(3, num_points, p=[0.2, 0.2, 0.6])
    points = size * rng.random((num_points, 3))
    points[np.arange(num_points), axis] = 0.0
    fixed = np.full(num_points, FIXED)
    contacts = Contacts(points, np.eye(3)[axis], np.zeros(num_points, dtype=int), fixed)
    masses = np.array([400.0])
    velocity = [[-0.3, -0.2, -0.1, *(0.2 * rng.normal(size=3))]]
    inertias = box_inertias(masses, size[None])
    return reduced(0.5 * size[None], masses, inertias, contacts, mu, velocity)


def with_zero_rows(problem, contacts):
    """The same with both sides of `contacts` prescribed: no row, no column, and u = q separating.

    Solvable as the problem itself: r = 0 there.
    """
    keep = np.ones(len(problem.q))
    q = problem.q.reshape(-1, problem.dim).copy()
    for contact in contacts:
        keep[problem.dim * contact : problem.dim * (contact + 1)] = 0.0
        q[contact, 0] = abs(q[contact, 0])
    kept = sp.diags(keep)
    W = (kept @ problem.W @ kept).tocsr()
    W.eliminate_zeros()
    return problem._replace(W=W, q=q.ravel())
