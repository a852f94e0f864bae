# SPDX-License-Identifier: LGPL-3.0-or-later
"""The softening number: below one a weakening bond has one state at the end of a step.

It is h^2 theta^2 A lmax(W) 2 Rmax / (dc - d0). Above one a bond may snap within a step.
"""

from __future__ import annotations

import numpy as np

from xper_fx.nscd.algebra.small import sym_indices
from xper_fx.nscd.interactions import Interactions


def softening_numbers(interactions: Interactions, step: float, theta: float) -> np.ndarray:
    """The softening number of each law with W as it is, shape (num_laws,); 0 if it never weakens.

    Args:
        interactions: the points.
        step: h (s).
        theta: weight of the end of the step.
    """
    slopes = [np.asarray(getattr(law, "softening_slope", 0.0)) for law in interactions.laws]
    most = np.zeros(len(slopes))
    if not any(map(np.any, slopes)):
        return most
    dim = interactions.dim
    compliance = np.zeros((len(interactions), dim, dim))
    rows, cols = sym_indices(dim)
    packed = interactions.local("compliance")
    compliance[:, rows, cols] = packed
    compliance[:, cols, rows] = packed
    largest = np.linalg.eigvalsh(compliance)[:, -1] * interactions.points.area
    for number, slope in enumerate(slopes):
        here = largest[interactions.law_of_point == number]
        most[number] = (here * slope).max(initial=0.0)
    if interactions.halo is not None:
        most = interactions.halo.ranks.max(most)
    return (step * theta) ** 2 * most
