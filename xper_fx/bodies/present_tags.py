# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which tags occur in a mesh that is cut into bodies."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple


class PresentTags(NamedTuple):
    """The tags that occur."""

    cells: frozenset[int]
    facets: frozenset[int]
    #: of facing facets: the cell tags of both sides, the lower one first, and the facet's tag, 0 if
    #: it has none
    facing: frozenset[tuple[int, int, int]]

    @classmethod
    def union(cls, parts: Iterable[PresentTags]) -> PresentTags:
        """Those that occur in any of some parts."""
        return cls(*(frozenset().union(*sets) for sets in zip(*parts, strict=True)))
