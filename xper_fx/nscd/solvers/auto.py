# SPDX-License-Identifier: LGPL-3.0-or-later
"""The solver that the problem at hand calls for.

Sweeps (`nlgs.py`) are cheapest where few are needed: steps of a few times the explicit limit, or a
good first guess. They start. After each batch their contraction says how many are left; where that
is more than what a Newton solve costs, `newton.py` goes on from there, and falls back to sweeps by
itself where a step does not help. Where Newton has nothing to work with (w singular along a
direction that is not prescribed) or gives up, `accelerated.py` finishes. Newton gives up after two
attempts, between which it tries an interior point where the laws allow it. Without one it goes in
circles where half of the bonds of a plate are broken, and takes the sweeps between its attempts, in
number like that of the points, while mixed ones are 1000 to 2000 with 40, 80 and 160 squares a side
(`benchmarks/half_broken.py`). Where half of the sweeps allowed do not do either, as between bodies
of very different masses, it goes on.

Where every point is a perfect bond, `feti.py` takes Newton's place for bodies of many cells:
3072 tetrahedra in 16 bodies took 2.6 times less at a tolerance of 1e-8 and a step thirty times what
waves need to cross a body; where they just cross it, sweeps were enough. It is all there is to do
for bodies that interactions alone hold.

Packings of rigid bodies need no Newton: a packing has more of them than it needs, each with three
branches, and with or without a direct factorisation Newton took 5 to 20 times as long as sweeps on
discs that settle. Mixing sweeps saves two thirds of them there; its vectors cost some as well, so
that it serves from about ten thousand points on; where it gains no more plain sweeps finish. Below,
sweeps get half of those allowed, as whatever else takes longer: 2640 discs at rest in a box, 4600
contacts, took 1300 sweeps and 0.1 s a step, and 1.3 s where the rest was left to Newton after a
tenth. Contacts on which sweeps do not arrive then are assembled and solved as a `FrictionProblem`
(`assembled.py`); where they are none, or that fails, tried by Newton with its direct factorisation,
and mixed at last.

What sweeps leave says little about the error of a tower or a wall, whose slow motions they hardly
touch: a tower of 100 blocks that met the tolerance of 1e-3 at every step leaned by 0.6 m in 10 s.
Few contacts are therefore swept to a ten thousandth of the tolerance, which takes a sweep or two
where they rest as they did, and are assembled where that is long. The tower then drifts by 0.2 mm,
in a third of the time; bodies in motion take up to twice, a wall that falls eight times as long.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from xper_fx.nscd.algebra.krylov import norm
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.solvers.nlgs import NonlinearGaussSeidel
from xper_fx.nscd.solvers.solver import (
    SolveOptions,
    Solver,
    SolveReport,
    UnsuitableSolverError,
)
from xper_fx.nscd.solvers.sweeps import RUNAWAY

# Sweeps of the first batch, each next one twice as long.
_FIRST = 12
# Sweeps left from which Newton is cheaper: factoring and a few linear problems cost as much.
_MANY = 75
# Share of the sweeps allowed that Newton may spend when its steps do not help.
_SHARE = 0.1
# Sweeps that Newton may make on points of meshed bodies, so that it makes two attempts: with one
# mixed sweeps have a poor start, with three plates of half broken facets take longer.
_BRIEF = 70
# Contacts of rigid bodies below which sweeps are cheaper than mixing them.
_MANY_RIGID = 10_000
# Contacts of rigid bodies that are few, the tolerance of their sweeps relative to the one asked
# for, and visits of points that take about as long as assembling them.
_FEW_RIGID, _STRICT, _VISITS = 500, 1e-4, 100_000
# Sweeps that each solver of the assembled contacts may make.
_ASSEMBLED_SWEEPS = 2000


def _newton() -> Solver:
    from xper_fx.nscd.solvers.newton import NewtonOnAllPoints

    return NewtonOnAllPoints()


def _accelerated() -> Solver:
    from xper_fx.nscd.solvers.accelerated import AcceleratedSweeps

    return AcceleratedSweeps()


def _friction_problem() -> Solver:
    from xper_fx.nscd.solvers.assembled import AssembledContacts

    return AssembledContacts()


def _subdomains() -> Solver:
    from xper_fx.nscd.solvers.feti import BondedGradients

    return BondedGradients()


# Solvers are imported when they are called for.
_SOLVERS: dict[str, Callable[[], Solver]] = {
    "nlgs": NonlinearGaussSeidel,
    "newton": _newton,
    "accelerated": _accelerated,
    "friction_problem": _friction_problem,
    "subdomains": _subdomains,
}


def sweeps_left(report: SolveReport, tolerance: float) -> float:
    """Sweeps still needed from the error left and its contraction; infinite if there is none."""
    if not 0.0 < report.contraction < 1.0 or not math.isfinite(report.residual):
        return math.inf
    return math.log(report.residual / tolerance) / -math.log(report.contraction)


def _size(interactions: Interactions) -> float:
    """|r| over all points of all ranks (N s)."""
    squares = sum(norm(g.impulse.reshape(-1)) ** 2 for g in interactions.groups)
    return math.sqrt(interactions.total(squares))


class Automatic(Solver):
    """Sweeps first; what they do not solve goes to the solver that is likely to."""

    name = "auto"

    def __init__(self) -> None:
        self._solvers: dict[str, Solver] = {}

    def _solver(self, name: str) -> Solver:
        if name not in self._solvers:
            self._solvers[name] = _SOLVERS[name]()
        return self._solvers[name]

    def solve(
        self, interactions: Interactions, velocity: np.ndarray, options: SolveOptions
    ) -> SolveReport:
        """Find the impulses of the step, as `Solver.solve` says."""
        free = velocity.copy()
        tolerance, max_sweeps = options.tolerance, options.max_sweeps
        # conjugate gradients on perfect bonds are for one rank
        bonded = [g.kernels.no_jump for g in interactions.groups] == [True]
        bonded = bonded and interactions.halo is None
        if bonded and interactions.anchors is not None:
            return self._solver("subdomains").solve(interactions, velocity, options)
        count = int(interactions.total(sum(len(g) for g in interactions.groups)))
        rigid = interactions.uses_velocity_criterion
        few = rigid and count < _FEW_RIGID
        if few:
            first = replace(options, tolerance=_STRICT * tolerance)
            patience = most = min(max_sweeps, _VISITS // max(count, 1))
        else:
            first, patience, most = options, _MANY, max_sweeps
        sweeps, batch = 0, _FIRST
        while True:
            velocity[:] = free
            spent = replace(first, max_sweeps=min(batch, most - sweeps))
            report = self._solver("nlgs").solve(interactions, velocity, spent)
            sweeps += report.sweeps
            finite = interactions.everywhere(np.all(np.isfinite(velocity)))
            if report.converged or sweeps >= max_sweeps or not finite:
                return report._replace(sweeps=sweeps, reason=f"{sweeps} sweeps were enough")
            left = sweeps_left(report, first.tolerance)
            if left > patience or sweeps >= most:
                break
            batch *= 2
        reason = f"{left:.0f} sweeps left after {sweeps}"
        allowed = min(max_sweeps - sweeps, max(1, int(_SHARE * max_sweeps)))
        best = "subdomains" if bonded and not interactions.inverse.uniform_size else "newton"
        attempts = _BRIEF if best == "newton" and not rigid else allowed
        next_ones = [(best, min(attempts, allowed)), ("accelerated", max_sweeps)]
        if attempts < allowed:  # what mixing does not solve is left to Newton's patience
            next_ones[1:1] = [("accelerated", max_sweeps // 2), (best, allowed)]
        if rigid and count >= _MANY_RIGID:
            next_ones = [("accelerated", allowed), ("nlgs", max_sweeps)]
        elif rigid:
            assembled = ("friction_problem", _ASSEMBLED_SWEEPS)
            sweeping = ("nlgs", allowed if few else max_sweeps // 2)
            next_ones = [*((assembled, sweeping) if few else (sweeping, assembled)), *next_ones]
        most_impulse = RUNAWAY * max(_size(interactions), interactions.rounding(free) / tolerance)
        for name, most in next_ones:
            if sweeps >= max_sweeps:
                break
            velocity[:] = free
            spent = replace(options, max_sweeps=min(most, max_sweeps - sweeps))
            try:
                report = self._solver(name).solve(interactions, velocity, spent)
            except UnsuitableSolverError as error:
                reason += f"; {error}"
                continue
            sweeps += report.sweeps
            reason += f"; {report.solver}: {report.reason}"
            if report.converged:
                # each solver bounds what impulses grow by since its own start alone
                runs_away = not rigid and _size(interactions) > most_impulse
                report = report._replace(converged=not runs_away)
                break
        return report._replace(sweeps=sweeps, reason=reason)

    def kept(self) -> list[object]:
        """What the solvers keep that were called."""
        return [kept for solver in self._solvers.values() for kept in solver.kept()]

    def saved(self, interactions: Interactions) -> dict[str, dict[str, np.ndarray]]:
        """What the solvers keep that were called."""
        memories = [solver.saved(interactions) for solver in self._solvers.values()]
        return {owner: held for memory in memories for owner, held in memory.items()}

    def restore(self, interactions: Interactions, saved: Mapping[str, Mapping]) -> None:
        """Take what `saved` gave; Newton alone keeps anything."""
        if saved:
            self._solver("newton").restore(interactions, saved)
