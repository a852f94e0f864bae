# SPDX-License-Identifier: LGPL-3.0-or-later
"""What an interaction law is: parameters, history, and three kernels.

A law is a frozen dataclass with the methods of `Law`. Its kernels work on one point `i`:

    prepare(i, jump, velocity, w, area, step, theta, parameters, state, terms, details)
        once a step: the constants of the step; what every visit reads goes into `terms[i]`, kept
        short because it is what a sweep moves through memory, the rest into `details[i]`
    solve(i, u, r, w, parameters, terms, details) -> r, smooth
        at each visit: the total impulse that satisfies the law, others frozen; `u = b + W r`;
        smooth says that the law is linear around it, so that over-relaxation is safe. Changes
        nothing
    evolve(i, u, w, parameters, terms, details) -> change
        after a solve: internal variables follow the velocity u found, one way only; returns their
        relative change, zero when they have arrived, or, with a minus sign, what they have gone
        too far for u. None for a law without internal variables
    commit(i, jump0, jump1, u, r, area, step, theta, parameters, state, terms, details, energy)
        -> status; once a step: history moves on, energies go to `energy[i]`

Vectors are local tuples of `components` numbers: `(n, t...)`, dim of them, or `(n,)` where nothing
acts along the tangent, and then no array of the points has a tangential column; `w` is the array of
W_aa as packed symmetric rows. `energies` names the columns of `energy`, of ALL_ENERGIES. Jumps are
in m, velocities in m/s, impulses `r` in N s (positive: pushes candidate and antagonist apart),
`area` in m^2 (2D: m, per metre of depth). Over a step, jump1 = jump_h + h theta u with
jump_h = jump0 + h (1 - theta) velocity0. Adding a law is adding one file with such a class.

`growth(parameters, state) -> (reached, length, whole)`, of all points of a group, tells how far a
load may go (`xper_fx/nscd/growth.py`): the largest opening so far (m), the length of the bond's
curve (m), and whether there is a bond left. None for a law whose damage is not that of the end of
the step.

`slips` says that what grows is the slip that the point has made, to and fro, whatever it is open:
`reached` is that slip, and `length` the one after which it is weakened for good.

`cost(i, jump0, jump1, area, parameters, details) -> J` (2D: J/m), a compiled function, tells what
the bond of a point dissipates in a step that ends with jump1: the column "cohesion" of `commit`.
Laws with a `growth` have it, but those that slip weakens: the pressure decides what a slip costs.

A law may have a method `later_state()`, the history of a contact that a search finds after the
first step; it is `initial_state()` otherwise.

`spent(parameters, state)`, of all points of a group, gives the share of the fracture energy that
each bond has spent, in [0, 1]. None for a law that has no bond; with a history variable "damage"
and no `spent`, that is what is lost of it.

A law whose bonds break may have a method `in_statics()`, which gives the law that a static run
takes for it. Such a run then solves bulk and interactions in one system.

`stored(i, jump, area, parameters, state)` gives the energy (J; 2D: J/m) that a point holds with a
jump, that of the column "stored" after `commit`: at finite strain, where frames turn, jumps are
read anew in each step (`nscd/turning_frames.py`). None for a law that stores nothing.

`holds(i, parameters, state)`, a compiled function of laws whose points have bonds and impacts, says
whether a bond holds point i. Where none does, a gap of rounding is closed (`law_loops.py`). None
for a law without bonds.

`no_jump` says that the law leaves no jump, so that frames that turn bring no couple.

`coulomb(terms, details, parameters)`, of all points of a group after `prepare` or `evolve`, gives
`CoulombPoints`, where the step's problem at a point is that of Signorini and Coulomb, beside a
spring, whatever its impulse was: an interior point solves it (`solvers/central_path.py`), and where
there are no springs it makes a `FrictionProblem`. None for a law of another kind.

`rolling` has the kernels of the rolling points that stand beside contacts of rigid bodies
(`rolling.py`); None for laws without rolling resistance.

`rigid` has what is asked of bonds that have no compliance while they are sound
(`rigid_kernels.RigidKernels`); None for all other laws.

`name` and `effects` are for the table of effects (`xper_fx/output/effects.py`): pairs of an
effect's name, of the table or new, and how many of a point's parameters, state, terms and details
it needs; `Columns` counts them.

A law that calls `take_parameters` (`nscd/laws/parameters.py`) in its `__post_init__` takes fields
for its parameters (`nscd/laws/fields.py`).

A law whose bonds weaken may have `strength` (Pa), `fracture_energy` (J/m^2) and `softening_slope`,
the steepest descent of its traction (Pa/m): what resolves it is told from them
(`simulation/cohesive_scales.py`), and which step leaves it one state (`nscd/laws/softening.py`).
"""

from __future__ import annotations

from collections import namedtuple
from typing import Any, NamedTuple, Protocol

import numpy as np

ENERGIES = ("stored", "cohesion", "friction", "impact", "numerical")
STORED, COHESION, FRICTION, IMPACT, NUMERICAL = range(len(ENERGIES))  # of a law that has them all
VISCOUS = len(ENERGIES)
ALL_ENERGIES = (*ENERGIES, "viscous")  # of a law that has viscous work besides

LawKernels = namedtuple(
    "LawKernels",
    "name effects components prepare solve commit num_terms energies evolve num_details "
    "state_names growth spent stored no_jump rigid coulomb rolling cost slips holds",
    defaults=(None, 0, (), None, None, None, False, None, None, None, None, False, None),
)


class CoulombPoints(NamedTuple):
    """Constants of a step at n points: with r' = (r_N + tip, r_T),

        u_N >= least,  r'_N >= 0, complementary;
        |r'_T| <= friction r'_N + bound,  against u_T + shift,

    beside r'' = -spring (push + u), if there are springs, which bears its share of the impulse.
    """

    least: np.ndarray  #: shape (n,), m/s; -inf where the point is open
    shift: np.ndarray  #: shape (n, dim - 1), m/s
    friction: np.ndarray  #: shape (n,)
    bound: np.ndarray  #: shape (n,), N s
    tip: np.ndarray  #: shape (n,), N s
    spring: np.ndarray | None = None  #: shape (n, dim), N s per m/s; None where there is none
    push: np.ndarray | None = None  #: shape (n, dim), m/s; None with `spring`


class Columns:
    """Columns of an array over points, taken one after the other, each for an effect.

    Attributes:
        count: how many are taken.
    """

    def __init__(self) -> None:
        self.count = 0
        self._of: dict[str, int] = {}

    def take(self, effect: str, number: int = 1) -> int:
        """The first of some columns for an effect."""
        first = self.count
        self.count += number
        self._of[effect] = self._of.get(effect, 0) + number
        return first

    @staticmethod
    def effects(*arrays: Columns) -> tuple[tuple[str, int], ...]:
        """What several arrays hold for each effect (`LawKernels.effects`)."""
        total: dict[str, int] = {}
        for array in arrays:
            for effect, number in array._of.items():
                total[effect] = total.get(effect, 0) + number
        return tuple(total.items())


class Law(Protocol):
    """An interaction law between the two sides of a point."""

    def kernels(self, dim: int) -> LawKernels:
        """The compiled law; equal results (by identity) mean points may share a sweep."""

    def parameters(self) -> tuple[Any, ...]:
        """What the kernels read, in SI units: numbers, or arrays over the points of the law."""

    def initial_state(self) -> tuple[Any, ...]:
        """History of a point at the start of a run, in the order of `state_names`."""
