# SPDX-License-Identifier: LGPL-3.0-or-later
"""NonSmooth Contact Dynamics: points, laws and solvers, on NumPy, SciPy and Numba alone."""

from xper_fx.lazy import importer

_MODULE_OF = {"FrictionProblem": "friction", "FrictionResult": "friction"}

__all__ = list(_MODULE_OF)
__getattr__ = importer(__name__, _MODULE_OF)
