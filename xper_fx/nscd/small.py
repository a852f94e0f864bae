# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vectors and symmetric matrices of dimension 2 and 3 as tuples, for use inside kernels.

A vector is `(n, t)` or `(n, t1, t2)`. A symmetric matrix holds its upper triangle by rows:
`(nn, nt, tt)` or `(nn, n1, n2, 11, 12, 22)`. Tuples live in registers: nothing is allocated.
`for_dimension` gives the set of functions for a dimension, of `plane.py` or `space.py`, so that a
kernel compiled for one dimension carries no trace of the other.
"""

from __future__ import annotations

from collections import namedtuple
from functools import cache
from importlib import import_module

import numpy as np

SmallAlgebra = namedtuple(
    "SmallAlgebra",
    "row set_row dot add subtract scale multiply_diagonal sym_row sym_vector "
    "compliance_with_springs to_local to_global",
)


@cache
def for_dimension(dim: int) -> SmallAlgebra:
    """The small-vector functions for dimension 2 or 3.

    Raises:
        ValueError: any other dimension.
    """
    if dim not in (2, 3):
        raise ValueError(f"Interactions live in dimension 2 or 3, got {dim}.")
    module = import_module("xper_fx.nscd.plane" if dim == 2 else "xper_fx.nscd.space")
    return SmallAlgebra(*(getattr(module, name) for name in SmallAlgebra._fields))


def sym_indices(dim: int) -> tuple[np.ndarray, np.ndarray]:
    """Row and column of each stored entry of a symmetric matrix, in storage order."""
    return np.triu_indices(dim)
