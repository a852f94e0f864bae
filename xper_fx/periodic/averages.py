# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Averages over a periodic cell, and the lemma of Hill and Mandel.

    Fbar = <F>_bulk + (1/|Omega|) int [[u#]] (x) N dS,      Pibar = <Pi>_bulk - K / (h |Omega|),

N pointing from the antagonist to the candidate and [[u#]] = u#_c - u#_a. Over a step, with du the
increments, r the impulses of the interactions and f the bulk's internal forces,

    int <Pi> : dF dx = |Omega| Pibar : dFbar + (r / h) . du# + (K / h) : dFbar - (M dv# / h) . du#:

what the stresses do inside is what the macroscopic stress does, but for the work of cracks and of
the fluctuation's inertia. Stresses are those of the time scheme, theta Pi1 + (1 - theta) Pi0.

Frames of bonds spin with Fbar as they do with u# (`nscd/turning_frames.py`). Their couples, which
are among r, do the work K : dFbar / h besides, K = sum h_alpha (x) t_alpha. With it Pibar Fbar^T is
symmetric in a cell at rest: with sk for the skew part, sk(Pi F^T) = 0 at each point and
F = Fbar + grad u# give

    int sk(Pi Fbar^T) = -int sk(Pi (grad u#)^T) = -sum_j sk((r_j / h) (x) u#_j)

over the nodes. Forces and couples have no moment about the positions Fbar X + u#, and forces have
none about Fbar X, where their lips are one. Couples have sum h_alpha (x) (Fbar t_alpha) = K Fbar^T
about Fbar X, so that the right side is sk(K Fbar^T) / h. K is zero at small strain. It is zero but
for the step's error where all bonds are open with C_N = C_T.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from xper_fx.bulk.state import State, StepOutcome
from xper_fx.periodic.two_field import CellBulk

# Increment of the macroscopic gradient beside the gradient that counts as rest.
_REST = 1e-10


class Macroscopic(NamedTuple):
    """The macroscopic side of a periodic cell at a committed time."""

    gradient: np.ndarray  #: Fbar, shape (dim, dim)
    stress: np.ndarray  #: Pibar, first Piola-Kirchhoff, shape (dim, dim), Pa
    #: error of the lemma over the last step (module docstring), relative to the work of the
    #: stresses inside, or to what the largest stress of the run would have done if that is more;
    #: for components driven by Pibar it holds the stress that was asked for, so that it shows what
    #: any of the solvers left undone
    hill_mandel: float


def macroscopic_state(
    bulk: CellBulk,
    before: State | None,
    outcome: StepOutcome | None,
    state: State,
    step: float,
    theta: float,
) -> Macroscopic:
    """The macroscopic state, and how well the step that led to it satisfies the lemma.

    Args:
        before, outcome: start of the step and the step; None at the start of the run.
        state: the state to describe.
        step: h (s).
        theta: weight of the end of the step on the fluctuation.
    """
    error = 0.0
    if outcome is not None:
        error = _hill_mandel_error(bulk, before, outcome, step, theta)
    return Macroscopic(
        bulk.macroscopic_gradient(state.displacement),
        bulk.macroscopic_stress(state.internal),
        error,
    )


def _hill_mandel_error(
    bulk: CellBulk, before: State, outcome: StepOutcome, step: float, theta: float
) -> float:
    after = outcome.state
    cell, nodal = bulk.unknowns.macroscopic, slice(0, bulk.unknowns.macroscopic.start)
    moved = after.displacement - before.displacement
    internal = theta * after.internal + (1.0 - theta) * before.internal
    inside = bulk.dot(moved, internal)
    inertia = bulk.momentum(after.velocity - before.velocity)
    pushed = float(moved[nodal] @ (outcome.impulses - inertia)[nodal])
    couples = outcome.impulses[cell] / step
    fluctuation = bulk.ranks.sum(pushed) / step + float(moved[cell] @ couples)
    # what was asked for where stresses are given, what was found where strains are
    asked = theta * after.internal[cell] + (1.0 - theta) * before.internal[cell]
    asked = asked - couples
    missing = after.external[cell] + couples - after.internal[cell]
    asked[bulk.free] += missing[bulk.free]
    largest = bulk.largest_stress * bulk.volume
    # at rest there is nothing but rounding to compare
    strain = max(
        np.abs(moved[cell]).max(), _REST * np.abs(after.displacement[cell]).max(initial=0.0)
    )
    work = max(abs(inside) + abs(fluctuation), largest * strain)
    error = abs(inside - float(moved[cell] @ asked) - fluctuation)
    return error / work if work > 0.0 else 0.0
