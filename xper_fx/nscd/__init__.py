# SPDX-License-Identifier: LGPL-3.0-or-later
"""NonSmooth Contact Dynamics: points, laws and solvers, on NumPy, SciPy and Numba alone."""

from xper_fx.nscd.friction import FrictionProblem, FrictionResult

__all__ = ["FrictionProblem", "FrictionResult"]
