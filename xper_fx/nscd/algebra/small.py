# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vectors and symmetric matrices of dimension 2 and 3 as tuples, for use inside kernels.

A vector is `(n, t)` or `(n, t1, t2)`. A symmetric matrix holds its upper triangle by rows:
`(nn, nt, tt)` or `(nn, n1, n2, 11, 12, 22)`. Where nothing acts along the tangent, a local vector
is `(n,)` alone in either dimension, and a matrix `(nn,)`. Tuples live in registers: nothing is
allocated. `for_dimension` gives the set of functions for a dimension, of `plane.py` or `space.py`,
so that a kernel compiled for one dimension carries no trace of the other.
"""

from __future__ import annotations

from collections import namedtuple
from functools import cache
from importlib import import_module

import numpy as np

# Relative size below which a compliance counts as zero: the direction is fully prescribed.
SINGULAR = 1e-13

SmallAlgebra = namedtuple(
    "SmallAlgebra",
    "row set_row dot add subtract scale unit matrix_vector sym_row sym_vector to_local to_global "
    "multiply_diagonal compliance_with_springs sym_solve part tangent_part with_normal sym_part",
)


@cache
def for_dimension(dim: int, components: int | None = None) -> SmallAlgebra:
    """The small-vector functions for dimension 2 or 3.

    Args:
        components: of a local vector: `dim`, which is meant if not given, or 1, the normal's.

    Returns:
        The functions; `to_local` and `to_global` lead from vectors of space to local ones and back.
        `part`, `tangent_part` and `sym_part` are columns of a row, from a first one on. With one
        component the last seven are None.

    Raises:
        ValueError: any other dimension, or number of components.
    """
    if dim not in (2, 3):
        raise ValueError(f"Interactions live in dimension 2 or 3, got {dim}.")
    if components not in (None, 1, dim):
        raise ValueError(f"Local vectors have 1 or {dim} components, got {components}.")
    module = import_module(
        "xper_fx.nscd.algebra.plane" if dim == 2 else "xper_fx.nscd.algebra.space"
    )
    if components != 1:
        return SmallAlgebra(*(getattr(module, name) for name in SmallAlgebra._fields))
    line = import_module("xper_fx.nscd.algebra.line")
    own = {name: getattr(line, name, None) for name in SmallAlgebra._fields}
    return SmallAlgebra(**own | {"to_local": module.to_normal, "to_global": module.along_normal})


@cache
def sym_indices(components: int) -> tuple[np.ndarray, np.ndarray]:
    """Row and column of each stored entry of a symmetric matrix, in storage order."""
    return np.triu_indices(components)
