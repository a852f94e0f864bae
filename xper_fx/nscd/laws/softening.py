# SPDX-License-Identifier: LGPL-3.0-or-later
"""The softening number: below one a weakening bond has one state at the end of a step.

It is h^2 theta^2 A lmax(W) 2 Rmax / (dc - d0). Above one a bond may snap within a step.

The *snap number* is that of initially rigid bonds which weaken, with the cells that move with them.
They pull with the mean traction of a step, which falls by half of what the curve does: below one,
h^2 theta A lmax(W) / 2 times its steepest descent, they have one state.
"""

from __future__ import annotations

import numpy as np

from xper_fx.nscd.algebra.small import sym_indices
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.laws.law import COHESION


def softening_numbers(interactions: Interactions, step: float, theta: float) -> np.ndarray:
    """The softening number of each law with W as it is, shape (num_laws,); 0 if it never weakens.

    Args:
        step: h (s).
        theta: weight of the end of the step.
    """
    slopes = [np.asarray(getattr(law, "softening_slope", 0.0)) for law in interactions.laws]
    most = np.zeros(len(slopes))
    if any(map(np.any, slopes)):
        largest = _largest(interactions.local("compliance"), interactions.dim)
        largest *= interactions.points.area
        for number, slope in enumerate(slopes):
            here = largest[interactions.law_of_point == number]
            most[number] = (here * slope).max(initial=0.0)
    if interactions.halo is not None:
        most = interactions.halo.ranks.max(most)
    return (step * theta) ** 2 * most


def snap_number(interactions: Interactions, theta: float) -> float:
    """The largest snap number of the last step, of bonds that have weakened in it; 0 without.

    All ranks call it together.

    Args:
        interactions: the points, after a step was committed.
        theta: weight of the end of the step.
    """
    most, law_of_point = 0.0, interactions.law_of_point
    for group in interactions.groups:
        if group.kernels.rigid is None:
            continue
        worn = np.flatnonzero(group.energy[:, COHESION] > 0.0)
        points = group.indices[worn]
        largest = _largest(group.compliance[worn], interactions.dim) * group.points.area[worn]
        for number in np.unique(law_of_point[points]):
            here = law_of_point[points] == number
            slope = np.asarray(interactions.laws[number].softening_slope)
            if slope.ndim:  # a number for each point of the law
                slope = slope[np.searchsorted(np.flatnonzero(law_of_point == number), points[here])]
            most = max(most, float((largest[here] * slope).max()))
    return 0.5 * theta * interactions.committed_step**2 * interactions.largest(most)


def snap_of_cells(interactions: Interactions, step: float) -> tuple[float, int]:
    """The largest snap number that sound bonds can come to, between cells for themselves.

    Args:
        interactions: points whose vertices split (`fused`), beside an explicit bulk (theta = 1/2).
        step: h (s).

    Returns:
        The number, and which of this rank's points has it; zeros where a rank has no points.
    """
    if not len(interactions):
        return 0.0, 0
    points, apart = interactions.fused.compliance_of_cells()
    law_of_point, numbers = interactions.law_of_point, np.zeros(len(interactions))
    numbers[points] = 0.25 * step**2 * apart * interactions.points.area[points]
    for which in np.unique(law_of_point[points]):
        numbers[law_of_point == which] *= interactions.laws[which].softening_slope
    worst = int(np.argmax(numbers))
    return float(numbers[worst]), worst


def _largest(packed: np.ndarray, dim: int) -> np.ndarray:
    """Largest eigenvalues of compliances as packed symmetric rows."""
    compliance = np.zeros((len(packed), dim, dim))
    rows, cols = sym_indices(dim)
    compliance[:, rows, cols] = packed
    compliance[:, cols, rows] = packed
    return np.linalg.eigvalsh(compliance)[:, -1]
