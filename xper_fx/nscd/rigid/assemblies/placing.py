# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies in another place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy.typing as npt

from xper_fx.nscd.rigid.bodies import RigidBodies
from xper_fx.nscd.rigid.body import RigidBody
from xper_fx.support.checks import require_vector


def moved(bodies: Sequence[RigidBody], by: npt.ArrayLike) -> list[RigidBody]:
    """Copies of bodies, each further by the same distance: assemblies begin at the origin.

    Args:
        bodies: one or more, all 2D or all 3D.
        by: how far, shape (dim,), m.

    Returns:
        New bodies in the same order, which share the shapes of the old ones.

    Raises:
        TypeError, ValueError: something that is no body, or a distance of another dimension.
    """
    checked = RigidBodies(bodies)
    places = checked.position + require_vector("by", by, (checked.dim,))
    return [replace(body, position=x) for body, x in zip(bodies, places, strict=True)]
