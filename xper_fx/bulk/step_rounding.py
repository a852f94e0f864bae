# SPDX-License-Identifier: LGPL-3.0-or-later
"""What rounding leaves of the balance of a monolithic step."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from xper_fx.bulk.coupled_step import CoupledStep

# Relative rounding of velocities at the ends of a spring.
_ROUNDING = 4.0 * np.finfo(float).eps
# The same of the sum of all that acts on a node, where nothing but that is left.
_NOISE = 16.0 * np.finfo(float).eps


def rounding(step: CoupledStep) -> float:
    """What rounding of displacements leaves in the bulk and at the stiffest spring (N s)."""
    return _ROUNDING * _product_of_largest(step, step.velocity, 0.0)


def noise(step: CoupledStep) -> float:
    """Nodal impulses (N s) that rounding gives: less of them is none.

    At finite strain that is rounding of positions, F = 1 + grad u, else of displacements. Lips that
    are held answer to a gap with p K, the stiffness of a whole bond, also where the bond is broken
    and the bulk a thousand times softer.
    """
    displacement = step.state.displacement
    if step.finite_strain:
        displacement = np.full(1, step.extent)
    proximal = 0.0 if step.tangents is None else step.tangents.proximal
    return _NOISE * _product_of_largest(step, displacement / step.step, proximal)


def _product_of_largest(step: CoupledStep, values: np.ndarray, of_held: float) -> float:
    """Of all ranks the largest stiffness, with a share of held points, times the largest value."""
    stiffest, tangents = step.stiffest, step.tangents
    if tangents is not None:
        for k, held in zip(tangents.stiffness, tangents.held, strict=True):
            own = np.where(held, of_held, 1.0)[:, None, None] * np.abs(k)
            stiffest = max(stiffest, float(own.max(initial=0.0)))
    largest = float(np.abs(values).max(initial=0.0))
    return float(np.prod(step.ranks.max(np.array([stiffest, largest]))))
