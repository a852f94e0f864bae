# SPDX-License-Identifier: LGPL-3.0-or-later
"""Equations of unknowns that belong to no body, along the iterations of a step."""

from __future__ import annotations


class InBalance:
    """There are none, or none that must be solved.

    Attributes:
        error: relative error of the last iterate, zero before the first.
        missing: whether it leaves something to correct.
        settled: whether it is as small as it can be asked to be.
        worse: whether the last iteration has corrected it the wrong way.
    """

    error = 0.0
    missing = False
    settled = True
    worse = False

    def assess(self, inverse, velocity, previous, residual, internal, step, newton) -> None:
        """Take notice of an iterate.

        Args:
            inverse: of the iteration matrix.
            velocity, previous: of all unknowns, after and before the iteration, m/s.
            residual: of the step, N s.
            internal: internal forces, N.
            step: h (s).
            newton: relative Newton correction on the bodies before the iteration.
        """
