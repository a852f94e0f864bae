# SPDX-License-Identifier: LGPL-3.0-or-later
"""Convex polygons against each other, discs and walls.

The separation along the outward normal of an edge is the lowest height of the other polygon above
that edge. Its largest value s over the edges of both is minus the least translation that parts
them, if they overlap, and a lower bound of their distance if they do not (Ericson 2005, section
5.2): reached unless two corners are closest. As the edge turns counter-clockwise so does the lowest
vertex, and all edges together cost one turn around either polygon.

The edge that gives s is the reference; of the two edges at the lowest vertex of the other polygon
the one that faces it more is the incident edge. Where their projections on the reference overlap,
the two ends of the overlap are the contact's points, each with its own height as its gap and half
the overlap as its area: a block that rocks keeps both within the reach. An end is a vertex of one
polygon above an edge of the other, and is named after that vertex, of the first polygon where two
vertices meet.
"""

import math

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY, LEAN_INNER
from xper_fx.nscd.search.contact_buffer import (
    POINT_AREA,
    ROUNDING,
    SAME_CORNER,
    contact_key,
    put_contact,
)
from xper_fx.nscd.search.spheres import put_ball


@njit(**LEAN_INNER)
def _best_edge(corners, ref, other, dx, dy, reach, rounding):
    """Edge of `ref` with the largest separation, and the lowest vertex of `other` above it.

    `(dx, dy)` leads from the centre of `ref` to that of `other`. Stops at the first edge beyond the
    reach. A later edge must exceed an earlier one by more than `rounding`.
    """
    r0, r1 = corners.vertex_start[ref], corners.vertex_start[ref + 1]
    o0, o1 = corners.vertex_start[other], corners.vertex_start[other + 1]
    vertex, normal = corners.vertex, corners.normal
    f0 = corners.face_start[ref]
    best, edge, lowest = -math.inf, 0, 0
    low, nx, ny = o0, 0.0, 0.0
    for k in range(r1 - r0):
        # A turn by a right angle or more, and the first edge, look at every vertex.
        anew = nx * normal[f0 + k, 0] + ny * normal[f0 + k, 1] <= 0.0
        nx, ny = normal[f0 + k, 0], normal[f0 + k, 1]
        height = nx * vertex[low, 0] + ny * vertex[low, 1]
        v = low
        for _ in range(o1 - o0 - 1):
            v = v + 1 if v + 1 < o1 else o0
            further = nx * vertex[v, 0] + ny * vertex[v, 1]
            if further < height:
                low, height = v, further
            elif not anew:
                break
        separation = height + nx * (dx - vertex[r0 + k, 0]) + ny * (dy - vertex[r0 + k, 1])
        if separation > best + rounding:
            best, edge, lowest = separation, k, low - o0
            if separation > reach:
                break
    return best, edge, lowest


@njit(**LEAN_INNER)
def _closest_vertices(corners, a, b, dx, dy):
    """Numbers of the vertices of two polygons that are closest; `(dx, dy)` from b to a."""
    a0, b0 = corners.vertex_start[a], corners.vertex_start[b]
    least, va, vb = math.inf, 0, 0
    for i in range(a0, corners.vertex_start[a + 1]):
        for j in range(b0, corners.vertex_start[b + 1]):
            x = corners.vertex[i, 0] + dx - corners.vertex[j, 0]
            y = corners.vertex[i, 1] + dy - corners.vertex[j, 1]
            square = x * x + y * y
            if square < least:
                least, va, vb = square, i - a0, j - b0
    return math.sqrt(least), va, vb


@njit(**LEAN_ENTRY)
def polygon_polygon(found, pairs, position, corners, bounding_radius, reach):
    """Contacts of convex polygons, two at most of a pair.

    Args:
        found: `Found`.
        pairs: shape (num_pairs, 2), candidate and antagonist.
        position: shape (num_bodies, 2), centres (m).
        corners: `Corners`.
        bounding_radius: shape (num_bodies,), m.
        reach: largest gap of a contact (m).

    Returns:
        How many contacts there are.
    """
    num_bodies = len(position)
    vertex, normal = corners.vertex, corners.normal
    count = 0
    for p in range(len(pairs)):
        a = pairs[p, 0]
        b = pairs[p, 1]
        dx = position[a, 0] - position[b, 0]
        dy = position[a, 1] - position[b, 1]
        size = bounding_radius[a] + bounding_radius[b]
        smaller = min(bounding_radius[a], bounding_radius[b])
        if dx * dx + dy * dy > (size + reach) ** 2:
            continue
        rounding = ROUNDING * size
        on_b, edge_b, low_a = _best_edge(corners, b, a, dx, dy, reach, rounding)
        if on_b > reach:
            continue
        on_a, edge_a, low_b = _best_edge(corners, a, b, -dx, -dy, reach, rounding)
        if on_a > reach:
            continue

        # In what follows `ref` has the reference edge, at the origin, and `other` stands above.
        first_is_ref = on_a > on_b - rounding
        if first_is_ref:
            ref, other, separation, edge, low = a, b, on_a, edge_a, low_b
            dx, dy = -dx, -dy
        else:
            ref, other, separation, edge, low = b, a, on_b, edge_b, low_a
        outward = -1.0 if first_is_ref else 1.0
        r0, o0 = corners.vertex_start[ref], corners.vertex_start[other]
        num_ref = corners.vertex_start[ref + 1] - r0
        num_other = corners.vertex_start[other + 1] - o0
        nx = normal[corners.face_start[ref] + edge, 0]
        ny = normal[corners.face_start[ref] + edge, 1]
        tx, ty = -ny, nx
        end = (edge + 1) % num_ref
        px, py = vertex[r0 + edge, 0], vertex[r0 + edge, 1]
        length = tx * (vertex[r0 + end, 0] - px) + ty * (vertex[r0 + end, 1] - py)

        before = (low - 1) % num_other
        o_face = corners.face_start[other]
        along_before = normal[o_face + before, 0] * nx + normal[o_face + before, 1] * ny
        along_after = normal[o_face + low, 0] * nx + normal[o_face + low, 1] * ny
        # Of the incident edge, which runs against the reference: its end is on the left.
        right = low if along_after < along_before - SAME_CORNER else before
        left = (right + 1) % num_other
        x, y = vertex[o0 + left, 0] + dx - px, vertex[o0 + left, 1] + dy - py
        left_u, left_h = tx * x + ty * y, nx * x + ny * y
        x, y = vertex[o0 + right, 0] + dx - px, vertex[o0 + right, 1] + dy - py
        right_u, right_h = tx * x + ty * y, nx * x + ny * y
        low_u = max(left_u, 0.0)
        high_u = min(right_u, length)
        width = right_u - left_u
        slope = (right_h - left_h) / width if width > rounding else 0.0
        low_h = left_h if low_u == left_u else left_h + slope * (low_u - left_u)
        high_h = right_h if high_u == right_u else right_h + slope * (high_u - right_u)
        area = max(0.5 * (high_u - low_u), POINT_AREA * smaller)
        bodies = (a, b)

        overlap = high_u >= low_u - rounding and width > rounding
        if overlap and min(low_h, high_h) <= separation + 2.0 * rounding:
            # Names: twice the number of the vertex, plus one if it is the second body's.
            near = SAME_CORNER * smaller
            of_ref, of_other = (0, 1) if first_is_ref else (1, 0)
            ref_left = left_u < -near or (left_u <= near and first_is_ref)
            name_low = 2 * edge + of_ref if ref_left else 2 * left + of_other
            over = right_u - length
            ref_right = over > near or (over >= -near and first_is_ref)
            name_high = 2 * end + of_ref if ref_right else 2 * right + of_other
            for turn in range(2):
                # The smaller name first.
                if (turn == 0) == (name_low < name_high):
                    u, h, name = low_u, low_h, name_low
                else:
                    u, h, name = high_u, high_h, name_high
                if h <= reach:
                    x = position[ref, 0] + px + u * tx + 0.5 * h * nx
                    y = position[ref, 1] + py + u * ty + 0.5 * h * ny
                    key = contact_key(bodies, num_bodies, name)
                    towards = outward * nx, outward * ny
                    count = put_contact(found, count, bodies, key, (x, y), towards, h, area)
            continue

        # Two corners.
        dx, dy = position[a, 0] - position[b, 0], position[a, 1] - position[b, 1]
        distance, va, vb = _closest_vertices(corners, a, b, dx, dy)
        ax = vertex[corners.vertex_start[a] + va, 0] + dx
        ay = vertex[corners.vertex_start[a] + va, 1] + dy
        bx = vertex[corners.vertex_start[b] + vb, 0]
        by = vertex[corners.vertex_start[b] + vb, 1]
        gap = separation
        nx, ny = outward * nx, outward * ny
        if separation > 0.0 and distance > 10.0 * rounding:
            gap = distance
            nx, ny = (ax - bx) / distance, (ay - by) / distance
        if gap <= reach:
            x = position[b, 0] + 0.5 * (ax + bx)
            y = position[b, 1] + 0.5 * (ay + by)
            key, area = contact_key(bodies, num_bodies, 2 * va), POINT_AREA * smaller
            count = put_contact(found, count, bodies, key, (x, y), (nx, ny), gap, area)
    return count


@njit(**LEAN_ENTRY)
def polygon_wall(found, pairs, position, corners, bounding_radius, wall_normal, reach):
    """Contacts of convex polygons with half planes: two at most, the ends of the lowest edge.

    Args:
        found, position, corners, bounding_radius, reach: as `polygon_polygon`.
        pairs: shape (num_pairs, 2), polygon and wall.
        wall_normal: shape (num_bodies, 2), outward unit normals of the walls.

    Returns:
        How many contacts there are.
    """
    vertex, normal = corners.vertex, corners.normal
    count = 0
    for p in range(len(pairs)):
        a = pairs[p, 0]
        b = pairs[p, 1]
        nx, ny = wall_normal[b, 0], wall_normal[b, 1]
        centre = nx * (position[a, 0] - position[b, 0]) + ny * (position[a, 1] - position[b, 1])
        if centre > reach + bounding_radius[a]:
            continue
        start = corners.vertex_start[a]
        num = corners.vertex_start[a + 1] - start
        low, least = 0, math.inf
        for v in range(num):
            height = nx * vertex[start + v, 0] + ny * vertex[start + v, 1]
            if height < least:
                low, least = v, height
        face = corners.face_start[a]
        before = (low - 1) % num
        along_before = normal[face + before, 0] * nx + normal[face + before, 1] * ny
        along_after = normal[face + low, 0] * nx + normal[face + low, 1] * ny
        right = low if along_after < along_before - SAME_CORNER else before
        left = (right + 1) % num
        x = vertex[start + left, 0] - vertex[start + right, 0]
        y = vertex[start + left, 1] - vertex[start + right, 1]
        area = max(0.5 * abs(nx * y - ny * x), POINT_AREA * bounding_radius[a])
        for v in (min(left, right), max(left, right)):
            gap = centre + nx * vertex[start + v, 0] + ny * vertex[start + v, 1]
            if gap <= reach:
                x = position[a, 0] + vertex[start + v, 0] - 0.5 * gap * nx
                y = position[a, 1] + vertex[start + v, 1] - 0.5 * gap * ny
                key = contact_key((a, b), len(position), v)
                count = put_contact(found, count, (a, b), key, (x, y), (nx, ny), gap, area)
    return count


@njit(**LEAN_ENTRY)
def disc_polygon(found, pairs, position, radius, corners, reach):
    """Contacts of discs with convex polygons.

    Args:
        found, position, corners, reach: as `polygon_polygon`.
        pairs: shape (num_pairs, 2), disc and polygon.
        radius: shape (num_bodies,), of the discs (m).

    Returns:
        How many contacts there are.
    """
    vertex, normal = corners.vertex, corners.normal
    count = 0
    for p in range(len(pairs)):
        i = pairs[p, 0]
        j = pairs[p, 1]
        cx, cy = position[i, 0] - position[j, 0], position[i, 1] - position[j, 1]
        start, face = corners.vertex_start[j], corners.face_start[j]
        num = corners.vertex_start[j + 1] - start
        within = radius[i] + reach
        height, edge = -math.inf, 0
        for k in range(num):
            above = normal[face + k, 0] * (cx - vertex[start + k, 0])
            above += normal[face + k, 1] * (cy - vertex[start + k, 1])
            if above > height:
                height, edge = above, k
                if height > within:
                    break
        if height > within:
            continue
        nx, ny = normal[face + edge, 0], normal[face + edge, 1]
        distance = height
        a, b = start + edge, start + (edge + 1) % num
        before_start = nx * (cy - vertex[a, 1]) - ny * (cx - vertex[a, 0]) < 0.0
        beyond_end = nx * (cy - vertex[b, 1]) - ny * (cx - vertex[b, 0]) > 0.0
        if height > 0.0 and (before_start or beyond_end):
            least, corner = math.inf, start
            for v in range(start, start + num):
                square = (cx - vertex[v, 0]) ** 2 + (cy - vertex[v, 1]) ** 2
                if square < least:
                    least, corner = square, v
            distance = math.sqrt(least)
            if distance > ROUNDING * radius[i]:
                nx, ny = (cx - vertex[corner, 0]) / distance, (cy - vertex[corner, 1]) / distance
        gap = distance - radius[i]
        if gap <= reach:
            bodies, n = (i, j), (nx, ny)
            count = put_ball(found, count, bodies, len(position), position, radius[i], n, gap)
    return count
