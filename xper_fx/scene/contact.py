# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a scene says of contacts: between which groups of bodies, and by which law.

A group is the rigid bodies that bear its name, or the meshed bodies of some cell tags. Contacts are
looked for between the groups that a `Contact` names, and nowhere else.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from xper_fx.nscd.laws.law import Law
from xper_fx.scene.facet_laws import require_law
from xper_fx.support.checks import take_numbers

if TYPE_CHECKING:
    from xper_fx.nscd.rigid.bodies import RigidBodies


@dataclass(frozen=True)
class Contact:
    """Contacts that may come about between two groups.

    Args:
        between: names of the two groups; twice the same for contacts within a group.
        law: what acts there; adhesion forms where this law has it, and nowhere else. A contact that
            was there in the step before keeps its history, any other is new. None: nothing, the
            bodies pass through each other.
        reach: gap up to which contacts are kept (m), inactive while it is open. None: a hundredth
            of the smallest body or facet, a quarter in runs without inertia. That is enough for
            laws at the velocity level; a law at the position level needs the way that bodies come
            nearer in a step.

    Raises:
        ValueError: not two names, a reach that is not positive and finite.
        TypeError: a law that is none, a reach that is no number.
    """

    between: tuple[str, str]
    law: Law | None
    reach: float | None = None

    def __post_init__(self) -> None:
        if (
            not isinstance(self.between, tuple | list)
            or len(self.between) != 2
            or not all(isinstance(name, str) for name in self.between)
        ):
            raise ValueError(f"A contact is between two groups, got {self.between!r}.")
        if self.law is not None:
            require_law(self.law)
        if self.reach is not None:
            take_numbers(self, "reach")
            if not (math.isfinite(self.reach) and self.reach > 0.0):
                raise ValueError(f"reach should be a positive length, got {self.reach!r}.")


def check_contacts(
    contacts: Sequence[Contact],
    surfaces: Mapping[str, Sequence[int]],
    cell_tags: Collection[int],
    rigid_bodies: RigidBodies | None,
) -> None:
    """See that contacts name groups that there are, and each group is named.

    Args:
        contacts, surfaces, rigid_bodies: of the scene.
        cell_tags: those that occur.

    Raises:
        ValueError: a group that does not exist, that two contacts join, or that none names; rolling
            resistance between bodies of which none is round.
        TypeError: something that is no contact.
    """
    rigid = () if rigid_bodies is None else rigid_bodies.groups
    for name, tags in surfaces.items():
        if name in rigid:
            raise ValueError(f"{name!r} names a surface and a group of rigid bodies.")
        unknown = set(tags) - set(cell_tags)
        if unknown or not tags:
            raise ValueError(
                f"The surface {name!r} needs cell tags that occur, got {list(tags)}; those "
                f"that do: {sorted(cell_tags)}."
            )
    groups, named = {*rigid, *surfaces}, set()
    for contact in contacts:
        if not isinstance(contact, Contact):
            raise TypeError(f"{contact!r} is no Contact.")
        pair = tuple(sorted(contact.between))
        if set(pair) - groups:
            raise ValueError(
                f"{contact.between} names groups {sorted(set(pair) - groups)}, which do not "
                f"exist; those that do: {sorted(groups)}."
            )
        if pair in named:
            raise ValueError(f"Two contacts are between {pair}; name the pair once.")
        named.add(pair)
        _check_rolling(contact, surfaces, rigid_bodies)
    alone = groups - {name for pair in named for name in pair}
    for name in sorted(alone & set(rigid)):
        first = int(np.argmax(rigid_bodies.group_of == rigid.index(name)))
        raise ValueError(
            f"No contact names the group {name!r}, to which rigid body {first} belongs: it "
            "would pass through everything. Name it in `contacts`, with None as a law if "
            "nothing shall happen."
        )
    if alone:
        raise ValueError(f"No contact names the surfaces {sorted(alone)}; leave them out.")


def _check_rolling(
    contact: Contact, surfaces: Collection[str], rigid_bodies: RigidBodies | None
) -> None:
    """Raise a ValueError where a law resists the rolling of what is not a disc or a sphere."""
    dim = None if rigid_bodies is None else rigid_bodies.dim
    if contact.law is None or getattr(contact.law.kernels(dim or 2), "rolling", None) is None:
        return
    balls = []
    for name in contact.between:
        if name in surfaces:
            raise ValueError(
                f"Rolling resistance is of rigid discs and spheres, and {name!r} of the contact "
                f"{contact.between} is a surface of meshed bodies, whose facets have no spin: give "
                "a law with rolling=0."
            )
        own = rigid_bodies.group_of == rigid_bodies.groups.index(name)
        balls.append(bool(np.all(rigid_bodies.shapes.ball_radius[own] > 0.0)))
    if not any(balls):
        raise ValueError(
            "Rolling resistance needs discs or spheres on one side, and both groups of the contact "
            f"{contact.between} have other bodies, which resist by their shape: give a law with "
            "rolling=0, or put the round bodies into a group of their own."
        )
