# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a periodic scene of rigid bodies may have, checked."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from xper_fx.bodies.lattice import checked_lattice
from xper_fx.periodic.drive import MacroscopicDrive
from xper_fx.support.checks import require_numbers

if TYPE_CHECKING:
    from xper_fx.nscd.rigid.bodies import RigidBodies

# Sine of the angle between a wall and a period vector up to which the vector lies in the wall.
_ALONG = 1e-9


def lattice_of_grains(lattice: npt.ArrayLike, dim: int) -> np.ndarray:
    """The period vectors as rows, shape (p, dim), m.

    Args:
        lattice: edges of a box, None for a direction without a period, or as many vectors as there
            are periods, as rows, m.

    Raises:
        ValueError, TypeError: something else, or no period at all.
    """
    edges = list(lattice) if np.iterable(lattice) and not isinstance(lattice, str) else []
    if 0 < len(edges) < dim and np.shape(lattice) == (len(edges), dim):
        # completed by directions across them, which have no periods
        rows = require_numbers("lattice", lattice)
        if np.all(np.isfinite(rows)):
            across = np.linalg.svd(rows)[2][len(edges) :]
            return checked_lattice([*rows, *across], dim)[: len(edges)]
    if len(edges) == dim and any(edge is None for edge in edges):
        periodic = [edge is not None for edge in edges]
        if not any(periodic):
            raise ValueError("lattice has no period in any direction; leave it out.")
        box = checked_lattice([1.0 if edge is None else edge for edge in edges], dim)
        return _whole(box)[periodic]
    return _whole(checked_lattice(lattice, dim))


def _whole(rows: np.ndarray) -> np.ndarray:
    if np.any((np.diag(rows) < 0.0) & (np.count_nonzero(rows, axis=1) == 1)):
        raise ValueError(f"Edges of a periodic box should be positive lengths (m), got {rows}.")
    return rows


def check_grains_in_cell(
    bodies: RigidBodies, lattice: np.ndarray, drive: MacroscopicDrive | None, has_loads: bool
) -> None:
    """See that bodies, loads and drive go with a lattice.

    Args:
        lattice: of `lattice_of_grains`.
        drive: of the cell, None if it keeps its shape.
        has_loads: whether gravity acts.

    Raises:
        ValueError: a wall across a period, or in a cell that deforms; there: forces, prescribed
            translations, free directions, a gradient that is not that of rest.
        TypeError: a drive that is none.
    """
    _check_walls(bodies, lattice)
    if drive is None:
        return
    if not isinstance(drive, MacroscopicDrive):
        raise TypeError(f"macroscopic is {drive!r}; expected a MacroscopicDrive.")
    dim = bodies.dim
    if len(lattice) < dim:
        raise ValueError(
            f"A cell that deforms has {dim} periods and the lattice has {len(lattice)}: give all "
            "of them, or leave `macroscopic` out, and the cell keeps its shape."
        )
    drive.check(dim)
    for name, value in drive.gradient.items():
        rest = float(name[0] == name[1])
        if callable(value) or value != rest:
            raise ValueError(
                f"F{name} of a cell of rigid bodies is held at {rest:g} by `gradient` or moved by "
                f"`rate`, got {value!r}: give its rate (1/s), a number or a function of time."
            )
    walls = np.flatnonzero(np.isinf(bodies.bounding_radius))
    if len(walls):
        raise ValueError(
            f"Rigid body {walls[0]} is a wall, and the cell deforms: a wall has no gradient. Leave "
            "one of the two out."
        )
    moved = np.flatnonzero(bodies.is_prescribed[:, :dim].any(axis=1))
    if len(moved):
        raise ValueError(
            f"The translation of rigid body {moved[0]} is prescribed, and the cell deforms, which "
            "moves its images apart: drive the cell by `macroscopic`, or leave `macroscopic` out."
        )
    pushed = [i for i, force in enumerate(bodies.force) if force is not None]
    if has_loads or pushed:
        what = "gravity" if has_loads else f"a force on rigid body {pushed[0]}"
        raise ValueError(
            f"A cell that deforms is driven by `macroscopic` alone, and the scene has {what}; "
            "leave it out."
        )


def _check_walls(bodies: RigidBodies, lattice: np.ndarray) -> None:
    for wall in np.flatnonzero(np.isinf(bodies.bounding_radius)):
        turn = bodies.rotation[wall]
        # the last axis of a wall points out of it
        normal = turn[:, -1] if bodies.dim == 3 else np.array([-np.sin(turn), np.cos(turn)])
        across = np.abs(lattice @ normal) > _ALONG * np.linalg.norm(lattice, axis=1)
        if across.any():
            raise ValueError(
                f"Rigid body {wall} is a wall across the period {lattice[across][0].tolist()} m: "
                "its images would fill space. Give None for that direction of the `lattice`, or "
                "turn the wall along the period."
            )
