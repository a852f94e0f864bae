# SPDX-License-Identifier: LGPL-3.0-or-later
"""A bulk that is explicit for as long as its steps are about as long as asked for.

A step of a linear bulk of a few hundred unknowns costs twice as much with an implicit bulk as with
an explicit one, and seven times as much from some thousand unknowns on, as triangular solutions
take. A run that picks scheme and step, of a linear undamped bulk on which nothing acts but loads,
begins with the explicit one. It goes on with the implicit one, for good, where steps of 4 or 8
times the shortest of that would leave no more than is asked for.
"""

from __future__ import annotations

from dataclasses import replace

from xper_fx.simulation.model import Model

# Implicit steps over the shortest from which they are cheaper, and the unknowns that are few.
_OF_FEW, _OF_MANY, _FEW = 4.0, 8.0, 1000
# The shortest implicit step, over the critical one.
_SHORTEST = 0.7


def outgrown(model: Model, last: float, end_time: float) -> bool:
    """Whether steps may be so much longer than the last (s) that an implicit bulk is cheaper."""
    return model.control.bears(_first_step(model), last, end_time)


def leave_explicit(model: Model) -> None:
    """Go on from the last step with an implicit bulk."""
    model.options, model.begins_explicit = replace(model.options, scheme="implicit"), False
    model.scheme = model.new_scheme()
    model.ledger.leave_shadow()
    if model.control is not None:
        model.control.leave_explicit(_SHORTEST * model.bulk.critical_step(), _first_step(model))


def _first_step(model: Model) -> float:
    """The first step of the implicit bulk (s)."""
    times = _OF_FEW if model.bulk.num_dofs_of_all < _FEW else _OF_MANY
    return times * _SHORTEST * model.bulk.critical_step()
