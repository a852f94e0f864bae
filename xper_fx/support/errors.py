# SPDX-License-Identifier: LGPL-3.0-or-later
"""Errors of a run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

_ADVICE = "Try a smaller step, more sweeps or a looser tolerance; look at the last output first."


class ConvergenceError(RuntimeError):
    """A step did not converge, and cutting it did not help.

    Attributes:
        step: number of the step.
        time: time at its start (s).
        size: last step size tried (s).
        residual: residual reached by the interaction solver.
        newton_residual: residual reached by Newton.
        saved: file with the state at the start of the step, None if the run has no folder.
        failure: what failed, in words, where more is known than the residuals; else empty.

    The message ends with advice: what may help where such a step does not converge.
    """

    failure = ""

    def __init__(
        self,
        step: int,
        time: float,
        size: float,
        residual: float,
        newton_residual: float,
        saved: Path | None,
        advice: str = _ADVICE,
        failure: str = "",
    ):
        self.step, self.time, self.size = step, time, size
        self.residual, self.newton_residual = residual, newton_residual
        self.saved, self.failure = saved, failure
        where = f" The state before it is in {saved}." if saved else ""
        found = f"residual {residual:.3g} of the interactions, {newton_residual:.3g} of Newton"
        if failure:
            found = f"{failure} ({found})"
        super().__init__(
            f"Step {step} at t = {time:.6g} s did not converge down to h = {size:.3g} s: "
            f"{found}.{where} {advice}"
        )


class CheckpointError(ValueError):
    """A checkpoint cannot be restarted from: it is damaged, or of another scene or version."""


class SmallStrainError(ConvergenceError):
    """Bonds have turned beyond what materials at small strain bear.

    Attributes:
        angle: that the bond that has turned most has turned by (rad).

    Args:
        where: its facet was at the start (m).
        share: of the bonds that have turned too far.
    """

    def __init__(
        self, step: int, time: float, size: float, angle: float, where: Sequence, share: float,
        saved: Path | None,
    ):  # fmt: skip
        self.step, self.time, self.size, self.angle = step, time, size, angle
        self.residual = self.newton_residual = float("nan")
        self.saved = saved
        place = ", ".join(f"{x:.6g}" for x in where)
        state = f" The state before it is in {saved}." if saved else ""
        RuntimeError.__init__(
            self,
            f"In step {step} at t = {time:.6g} s the bond at ({place}) has turned by "
            f"{math.degrees(angle):.3g} degrees, {100.0 * share:.3g} % of the bonds too "
            "far for small strain: its materials are stressed by a rotation, and bonds keep the "
            "directions of the start. Take a material at finite strain (NeoHookean), or "
            f"forgiving=True to go on with that.{state}",
        )


class NotFiniteError(ConvergenceError):
    """A step gave NaN or infinity, and cutting it did not help.

    Attributes:
        source: what gave the first such number, in words.
    """

    def __init__(self, step: int, time: float, size: float, source: str, saved: Path | None):
        self.step, self.time, self.size, self.source = step, time, size, source
        self.residual = self.newton_residual = float("nan")
        self.saved = saved
        where = f" The state before it is in {saved}." if saved else ""
        RuntimeError.__init__(
            self,
            f"Step {step} at t = {time:.6g} s gives numbers that are not finite, down to h = "
            f"{size:.3g} s: {source}.{where} Look at what is named, at the units, and at the last "
            "output; or take a smaller step.",
        )
