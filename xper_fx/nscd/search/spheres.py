# SPDX-License-Identifier: LGPL-3.0-or-later
"""Discs and spheres against each other and against walls, in either dimension.

With c = x_i - x_j between centres, n = c / |c| and g = |c| - r_i - r_j; against a wall with the
outward normal n through x_w, g = n . (x_i - x_w) - r_i. The common point is x_i - (r_i + g/2) n.
The feature of the key is always 0: a ball touches a convex body once, and keeps what it has
learnt while it rolls.
"""

import math

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY


@njit(inline="always")
def put_ball(found, count, bodies, num_bodies, position, radius, normal, gap):
    """Write the contact of a ball, the first of two bodies, with the other if there is room."""
    if count < len(found.gap):
        i, j = bodies
        found.body[count, 0] = i
        found.body[count, 1] = j
        reach = radius + 0.5 * gap
        for d in range(len(normal)):
            found.point[count, d] = position[i, d] - reach * normal[d]
            found.normal[count, d] = normal[d]
        found.gap[count] = gap
        found.area[count] = 1.0
        found.key[count, 0] = min(i, j) * num_bodies + max(i, j)
        found.key[count, 1] = 0
    return count + 1


@njit(**LEAN_ENTRY)
def ball_ball(found, pairs, position, radius, reach):
    """Contacts of discs or of spheres.

    Args:
        found: `Found`.
        pairs: shape (num_pairs, 2), candidate and antagonist.
        position: shape (num_bodies, dim), centres (m).
        radius: shape (num_bodies,), m.
        reach: largest gap of a contact (m).

    Returns:
        How many contacts there are.
    """
    dim = position.shape[1]
    num_bodies = len(position)
    count = 0
    for p in range(len(pairs)):
        i = pairs[p, 0]
        j = pairs[p, 1]
        square = 0.0
        for d in range(dim):
            square += (position[i, d] - position[j, d]) ** 2
        within = radius[i] + radius[j] + reach
        if square > within * within:
            continue
        distance = math.sqrt(square)
        gap = distance - radius[i] - radius[j]
        if count < len(found.gap):
            found.body[count, 0] = i
            found.body[count, 1] = j
            part = radius[i] + 0.5 * gap
            for d in range(dim):
                # Centres that coincide leave the direction open: the first axis then.
                n = (position[i, d] - position[j, d]) / distance if distance > 0.0 else d == 0
                found.normal[count, d] = n
                found.point[count, d] = position[i, d] - part * n
            found.gap[count] = gap
            found.area[count] = 1.0
            found.key[count, 0] = min(i, j) * num_bodies + max(i, j)
            found.key[count, 1] = 0
        count += 1
    return count


@njit(**LEAN_ENTRY)
def ball_wall(found, pairs, position, radius, normal, reach):
    """Contacts of discs or spheres with walls.

    Args:
        found, position, radius, reach: as `ball_ball`.
        pairs: shape (num_pairs, 2), ball and wall.
        normal: shape (num_bodies, dim), outward unit normals of the walls.

    Returns:
        How many contacts there are.
    """
    count = 0
    for p in range(len(pairs)):
        i = pairs[p, 0]
        j = pairs[p, 1]
        gap = -radius[i]
        for d in range(position.shape[1]):
            gap += normal[j, d] * (position[i, d] - position[j, d])
        if gap <= reach:
            bodies, n = (i, j), normal[j]
            count = put_ball(found, count, bodies, len(position), position, radius[i], n, gap)
    return count
