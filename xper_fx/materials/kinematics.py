# SPDX-License-Identifier: LGPL-3.0-or-later
"""Strain measures, always as 3 x 3 tensors: in 2D, plane strain fills the third direction."""

from __future__ import annotations

from typing import Any

import ufl


def displacement_gradient(u: Any) -> Any:
    """Grad u as a 3 x 3 tensor; in 2D the out-of-plane components are zero."""
    return in_space(ufl.grad(u))


def in_space(tensor: Any) -> Any:
    """A 2 x 2 tensor as one of 3 x 3 whose out-of-plane components are zero; others as they are."""
    t = tensor
    if t.ufl_shape == (3, 3):
        return t
    return ufl.as_tensor([[t[0, 0], t[0, 1], 0.0], [t[1, 0], t[1, 1], 0.0], [0.0, 0.0, 0.0]])


def small_strain(u: Any) -> Any:
    """Symmetric part of grad u, 3 x 3."""
    return ufl.sym(displacement_gradient(u))


def deformation_gradient(u: Any) -> Any:
    """F = I + grad u, 3 x 3; plane strain gives F_33 = 1."""
    return ufl.Identity(3) + displacement_gradient(u)
