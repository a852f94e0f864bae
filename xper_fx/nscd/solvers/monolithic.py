# SPDX-License-Identifier: LGPL-3.0-or-later
"""The interactions solved with the bulk, in one system (`xper_fx/bulk/monolithic_scheme.py`)."""

from __future__ import annotations

import numpy as np

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.solvers.solver import SolveOptions, Solver, SolveReport


class Monolithic(Solver):
    """Stands for the implicit scheme that solves bulk and interactions together."""

    name = "monolithic"

    def solve(
        self, interactions: Interactions, velocity: np.ndarray, options: SolveOptions
    ) -> SolveReport:
        """Nothing: what is solved for is more than the interactions.

        Raises:
            TypeError: always.
        """
        raise TypeError(
            "The monolithic solver takes bulk and interactions together: give it to a Simulation "
            'of meshed bodies, as solver="monolithic".'
        )
