# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plane tessellations rid of their short edges, which give meshes cells of bad quality."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from xper_fx.periodic.tessellation import Face, GrainFace, Tessellation, fills_the_box

__all__ = ["merge_short_edges"]


def merge_short_edges(tessellation: Tessellation, length: float) -> Tessellation:
    """Contract the edges below a length to their midpoints, the shortest ones first.

    Random tessellations have edges of any shortness (relaxed ones too): where four seeds are
    nearly on a circle, two vertices nearly coincide. Here they become one, and the two grains
    that shared the edge meet in a corner. The grains still fill the box, and repeat.

    A corner moves by half its edge (more where short edges form chains), so that the grains are
    no longer quite the power cells of their seeds. In 3D the same would bend faces: refused.

    Args:
        tessellation: what to simplify, in 2D; it is left as it was.
        length: m; half the size of the mesh to come is a good choice.

    Returns:
        The tessellation without edges below `length`.

    Raises:
        ValueError: the tessellation is in 3D; the length is negative, not finite, or so large
            that a grain would not survive.
    """
    if tessellation.dim != 2:
        raise ValueError(
            "The tessellation is in 3D, where merging vertices would bend the grains' faces; take "
            "other seeds, or mesh it as it is."
        )
    if not np.isfinite(length) or length < 0:
        raise ValueError(f"length is {length!r}; expected a length in m, 0 or more.")
    merged = tessellation
    while (contracted := _contract(merged, length)) is not None and fills_the_box(contracted):
        merged = contracted
    if merged.shortest_edge < length:
        raise ValueError(
            f"Grains do not survive the contraction of all edges below {length:g} m; their mean "
            f"size is {tessellation.volumes.mean() ** 0.5:g} m: give a smaller length, or relax "
            "the seeds more."
        )
    return merged


def _contract(tessellation: Tessellation, length: float) -> Tessellation | None:
    """Contract edges below a length of which none shares an end with another; None if none is."""
    faces = tessellation.faces
    # an edge: vertex, vertex, shift of the second against the first
    short: dict[tuple[int, ...], float] = {}
    for face in faces:
        x = tessellation.vertices[face.corners] + face.corner_shifts * tessellation.periods
        if (measure := float(np.linalg.norm(x[1] - x[0]))) < length:
            apart = face.corner_shifts[1] - face.corner_shifts[0]
            short[*face.corners.tolist(), *apart.tolist()] = measure
    vertices = tessellation.vertices.copy()
    # the vertex that each one becomes, and the shift of that one then
    becomes = np.arange(len(vertices))
    moved = np.zeros(vertices.shape, dtype=np.int64)
    touched = np.zeros(len(vertices), dtype=bool)
    for a, b, *apart in sorted(short, key=lambda edge: (short[edge], edge)):
        if a == b or touched[a] or touched[b]:
            continue
        touched[[a, b]] = True
        # b moved by `apart` lies at a
        vertices[a] = (vertices[a] + vertices[b] + apart * tessellation.periods) / 2
        becomes[b] = a
        moved[b] = np.negative(apart)
    if not touched.any():
        return None
    kept, number = np.unique(becomes, return_inverse=True)
    number_of_face = np.full(len(faces), -1)
    new_faces = []
    for f, face in enumerate(faces):
        corners = number[face.corners]
        shifts = face.corner_shifts + moved[face.corners]
        if corners[0] != corners[1] or np.any(shifts[0] != shifts[1]):
            number_of_face[f] = len(new_faces)
            new_faces.append(Face(face.grains, face.shift, corners, shifts))
    return replace(
        tessellation,
        vertices=vertices[kept],
        faces=tuple(new_faces),
        boundaries=tuple(_renumbered(sides, number_of_face) for sides in tessellation.boundaries),
    )


def _renumbered(
    sides: tuple[GrainFace, ...], number: npt.NDArray[np.int64]
) -> tuple[GrainFace, ...]:
    """Return a grain's faces under their new numbers, without those that vanished (-1)."""
    return tuple(
        GrainFace(int(number[side.face]), side.shift, side.outward)
        for side in sides
        if number[side.face] >= 0
    )
