# SPDX-License-Identifier: LGPL-3.0-or-later
"""Strain measures, always as 3 x 3 tensors: in 2D, plane strain fills the third direction."""

from __future__ import annotations

from typing import Any

import ufl


def displacement_gradient(u: Any) -> Any:
    """Grad u as a 3 x 3 tensor; in 2D the out-of-plane components are zero."""
    g = ufl.grad(u)
    if g.ufl_shape == (3, 3):
        return g
    return ufl.as_tensor([[g[0, 0], g[0, 1], 0.0], [g[1, 0], g[1, 1], 0.0], [0.0, 0.0, 0.0]])


def small_strain(u: Any) -> Any:
    """Symmetric part of grad u, 3 x 3."""
    return ufl.sym(displacement_gradient(u))


def deformation_gradient(u: Any) -> Any:
    """F = I + grad u, 3 x 3; plane strain gives F_33 = 1."""
    return ufl.Identity(3) + displacement_gradient(u)
