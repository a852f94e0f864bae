# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a scene says of contacts: between which groups of bodies, and by which law.

A group is the rigid bodies that bear its name, or the meshed bodies of some cell tags. Contacts are
looked for between the groups that a `Contact` names, and nowhere else.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from xper_fx.nscd.laws.law import Law
from xper_fx.support.checks import take_numbers


@dataclass(frozen=True)
class Contact:
    """Contacts that may come about between two groups.

    Args:
        between: names of the two groups; twice the same for contacts within a group.
        law: what acts there; adhesion forms where this law has it, and nowhere else. A contact that
            was there in the step before keeps its history, any other is new. None: nothing, the
            bodies pass through each other.
        reach: gap up to which contacts are kept (m), inactive while it is open. None: a hundredth
            of the smallest body or facet, enough for laws at the velocity level; a law at the
            position level needs the way that bodies come nearer in a step.

    Raises:
        ValueError: not two names, a reach that is not positive and finite.
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
        if self.reach is not None:
            take_numbers(self, "reach")
            if not (math.isfinite(self.reach) and self.reach > 0.0):
                raise ValueError(f"reach should be a positive length, got {self.reach!r}.")
