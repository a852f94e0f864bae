# SPDX-License-Identifier: LGPL-3.0-or-later
"""Groups whose bodies can meet while no contact says what happens then."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import islice

import numpy as np

from xper_fx.nscd.rigid.bodies import RigidBodies
from xper_fx.scene.contact import Contact

# Pairs that a message names.
_NAMED = 5


def check_pairs_decided(
    contacts: Sequence[Contact],
    rigid_bodies: RigidBodies | None,
    pieces: Mapping[str, Collection[int]],
) -> None:
    """See that a contact is between any two groups whose bodies can meet.

    Bodies can meet that are not both driven in every degree of freedom, and are not of one piece.

    Args:
        contacts, rigid_bodies: of the scene; contacts name groups that there are.
        pieces: numbers of the pieces of meshed bodies in each surface, by its name.

    Raises:
        ValueError: pairs that no contact names, with the lines to add.
    """
    undecided = list(islice(_undecided_pairs(contacts, rigid_bodies, pieces), _NAMED + 1))
    if not undecided:
        return
    lines = "".join(f"\n    xf.Contact({pair!r}, None)," for pair in undecided[:_NAMED])
    more = "\nand so on for more pairs" if len(undecided) > _NAMED else ""
    raise ValueError(
        "No contact says what happens where bodies of these groups meet. Add to `contacts`, with a "
        f"law in the place of None unless they shall pass through each other:{lines}{more}"
    )


def _undecided_pairs(
    contacts: Sequence[Contact],
    rigid_bodies: RigidBodies | None,
    pieces: Mapping[str, Collection[int]],
) -> Iterator[tuple[str, str]]:
    """Looks at pairs that can meet alone, so that it takes as long as the contacts are many."""
    named = {frozenset(contact.between) for contact in contacts}
    single, moving, driven = set(), list(pieces), []
    if rigid_bodies is not None:
        count = np.bincount(rigid_bodies.group_of)
        moves = ~rigid_bodies.is_prescribed.all(axis=1)
        count_moving = np.bincount(rigid_bodies.group_of, moves)
        for number, name in enumerate(rigid_bodies.groups):
            (moving if count_moving[number] else driven).append(name)
            if count[number] == 1:
                single.add(name)
    moving.sort()
    for place, first in enumerate(moving):
        for second in (*moving[place:], *driven):
            if frozenset((first, second)) in named or (first == second and first in single):
                continue
            if first in pieces and second in pieces and len({*pieces[first], *pieces[second]}) == 1:
                continue
            yield first, second
