# SPDX-License-Identifier: LGPL-3.0-or-later
"""A bulk that is explicit for as long as its steps are about as long as asked for.

A step of a linear bulk of a few hundred unknowns costs twice as much with an implicit bulk as with
an explicit one, four times as much of two thousand and eight of eight thousand (with what it takes
to judge the step), as triangular solutions take. A run that picks scheme and step, of a linear
undamped bulk on which nothing acts but loads, begins with the explicit one. It goes on with the
implicit one, for good, once steps of 4, 8 or 16 times the shortest of that would have left no more
than is asked for in each step of the time of eight of them.
"""

from __future__ import annotations

from dataclasses import replace

from xper_fx.simulation.model import Model


def leave_explicit(model: Model) -> None:
    """Go on from the last step with an implicit bulk."""
    model.options, model.begins_explicit = replace(model.options, scheme="implicit"), False
    model.scheme = model.new_scheme()
    model.ledger.leave_shadow()
    if model.control is not None:
        from xper_fx.simulation.accuracy_of_run import SHORTEST

        model.control.leave_explicit(SHORTEST * model.bulk.critical_step())
