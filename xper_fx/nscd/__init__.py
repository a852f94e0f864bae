# SPDX-License-Identifier: LGPL-3.0-or-later
"""NonSmooth Contact Dynamics: points, laws and solvers, on NumPy, SciPy and Numba alone."""

from typing import TYPE_CHECKING

from xper_fx.support.lazy import importer

if TYPE_CHECKING:
    from xper_fx.nscd.friction import FrictionProblem as FrictionProblem
    from xper_fx.nscd.friction import FrictionResult as FrictionResult

_MODULE_OF = {"FrictionProblem": "friction", "FrictionResult": "friction"}

__all__ = list(_MODULE_OF)
__getattr__ = importer(__name__, _MODULE_OF)
