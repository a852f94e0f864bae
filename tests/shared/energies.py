# SPDX-License-Identifier: LGPL-3.0-or-later
"""Energy that a scheme keeps to rounding, for the balances of hard cases."""

from __future__ import annotations

import numpy as np

from xper_fx.simulation.simulation import Simulation


def bulk_energy(simulation: Simulation) -> float:
    """Kinetic + elastic - work of the loads (J; 2D: J/m); a linear bulk.

    The explicit bulk conserves it less h^2 v.K.v / 8 (`xper_fx/bulk/explicit.py`), which is what
    is then returned.
    """
    e, v = simulation.ledger.energies, simulation.state.velocity
    total = e.kinetic + e.elastic - e.external_work
    if simulation.options.scheme == "explicit":
        total -= simulation.step_size**2 / 8.0 * float(v @ simulation.bulk.internal(v))
    return total


def missing_energy(simulation: Simulation, start: float) -> float:
    """What the books miss since `bulk_energy` was `start` (J; 2D: J/m)."""
    e = simulation.ledger.energies
    lost = e.dissipated_cohesion + e.dissipated_friction + e.dissipated_impact
    lost += e.dissipated_plastic + e.dissipated_viscous + e.dissipated_numerical
    lost += e.dissipated_viscous_bonds
    return abs(bulk_energy(simulation) + e.cohesive + lost - start)


def dissipations(simulation: Simulation) -> np.ndarray:
    """Totals dissipated by cohesion, friction and impact (J; 2D: J/m)."""
    e = simulation.ledger.energies
    return np.array([e.dissipated_cohesion, e.dissipated_friction, e.dissipated_impact])
