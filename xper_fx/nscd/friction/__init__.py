# SPDX-License-Identifier: LGPL-3.0-or-later
"""Frictional contact problems on their own: from W, q and mu to impulses, without a mesh."""

from xper_fx.nscd.friction.problem import SOLVERS, FrictionProblem, FrictionResult

__all__ = ["SOLVERS", "FrictionProblem", "FrictionResult"]
