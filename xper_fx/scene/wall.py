# SPDX-License-Identifier: LGPL-3.0-or-later
"""A plane that facets may touch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from xper_fx.nscd.laws.law import Law
from xper_fx.scene.facet_laws import require_law
from xper_fx.support.checks import require_numbers


@dataclass(frozen=True)
class Wall:
    """A fixed plane obstacle that tagged facets may touch.

    Args:
        facets: facet tag of the surface that may touch it.
        point: a point of the plane (m).
        normal: out of the obstacle, towards the bodies; any length.
        law: law of contact.
    """

    facets: int
    point: Sequence[float]
    normal: Sequence[float]
    law: Law

    def check(self, dim: int) -> None:
        """See that it fits a scene.

        Raises:
            ValueError: a point or a normal of another dimension, or not finite; a normal of zero.
            TypeError: a point or a normal that is no list of numbers, a law that is none.
        """
        require_law(self.law)
        for name in ("point", "normal"):
            if np.ndim(require_numbers(f"A wall's {name}", getattr(self, name))) != 1:
                raise ValueError(
                    f"A wall's {name} should have {dim} components, got {getattr(self, name)!r}."
                )
        if len(self.normal) != dim or len(self.point) != dim:
            raise ValueError(
                f"A wall's point and normal should have {dim} components, got "
                f"{tuple(self.point)} and {tuple(self.normal)}."
            )
        if not np.all(np.isfinite([*self.point, *self.normal])):
            raise ValueError(
                f"A wall's point and normal should be finite, got {tuple(self.point)} and "
                f"{tuple(self.normal)}."
            )
        if not np.linalg.norm(self.normal) > 0.0:
            raise ValueError(f"A wall's normal should not vanish, got {tuple(self.normal)}.")
