# SPDX-License-Identifier: LGPL-3.0-or-later
"""Anisotropic linear elasticity with three planes of symmetry, in rotated axes.

With R the matrix whose columns are the material axes, e = R^T eps R and Voigt's order
11, 22, 33, 23, 13, 12 (shears doubled), W = e . C e / 2. C has nine constants, three if cubic.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import ufl

from xper_fx.materials.kinematics import small_strain
from xper_fx.materials.material import Expression, ToConstant
from xper_fx.support.checks import require_numbers, require_positive, take_numbers


class _Orthotropic:
    """Energy and stress of a 6 x 6 stiffness in rotated axes."""

    def _check(self) -> None:
        take_numbers(self, "density")
        require_positive("density", self.density)
        C = self.stiffness
        if not np.all(np.isfinite(C)):
            raise ValueError(f"The stiffness is too large for floats with {self}.")
        lowest = np.linalg.eigvalsh(C)[0]
        if not lowest > 0.0:
            raise ValueError(
                f"The stiffness should be positive definite; its lowest eigenvalue is {lowest:g} "
                f"Pa with {self}."
            )
        rotation_matrix(self.rotation)

    def _strain_and_stress(
        self, u: Expression, constant: ToConstant
    ) -> tuple[Expression, Expression]:
        """Strain and stress in the material axes, and R."""
        R = rotation_matrix(self.rotation)
        if len(u) == 2 and not np.allclose(np.abs(R[2]), [0.0, 0.0, 1.0], atol=1e-12):
            raise ValueError(
                "In 2D the third material axis should be normal to the plane, else shear couples "
                f"to it; got the rotation {R.tolist()}. Give an angle, or take a 3D mesh."
            )
        R, C = constant(R), self.stiffness
        strain = R.T * small_strain(u) * R
        normal = [
            sum(constant(C[i, j]) * strain[j, j] for j in range(3) if C[i, j]) for i in range(3)
        ]
        s23, s13, s12 = (
            2.0 * constant(C[3 + k, 3 + k]) * strain[i, j] for k, (i, j) in enumerate(_SHEARS)
        )
        stress = ufl.as_tensor(
            [[normal[0], s12, s13], [s12, normal[1], s23], [s13, s23, normal[2]]]
        )
        return strain, stress, R

    def energy(self, u: Expression, constant: ToConstant) -> Expression:
        """See `Material`."""
        strain, stress, _ = self._strain_and_stress(u, constant)
        return 0.5 * ufl.inner(strain, stress)

    def stress(self, u: Expression, constant: ToConstant) -> Expression:
        """See `Material`."""
        _, stress, R = self._strain_and_stress(u, constant)
        return R * stress * R.T


_SHEARS = ((1, 2), (0, 2), (0, 1))


@dataclass(frozen=True)
class Cubic(_Orthotropic):
    """Linear elastic crystal of cubic symmetry at small strain (plane strain in 2D).

    Args:
        c11: stiffness of an axis to its own strain (Pa).
        c12: stiffness of an axis to the strain of another (Pa).
        c44: shear stiffness (Pa); isotropic if 2 c44 = c11 - c12.
        density: rho (kg/m^3).
        rotation: angle (rad) of the material axes about the third, or the 3 x 3 matrix whose
            columns are the material axes.

    Raises:
        ValueError: a stiffness not positive definite, a matrix that is not a rotation.
    """

    c11: float
    c12: float
    c44: float
    density: float
    rotation: float | Sequence[Sequence[float]] = 0.0
    linear: bool = field(default=True, init=False)

    def __post_init__(self) -> None:
        take_numbers(self, "c11", "c12", "c44")
        for name in ("c11", "c12", "c44"):
            if not np.isfinite(getattr(self, name)):
                raise ValueError(f"{name} should be a finite number, got {getattr(self, name)}.")
        self._check()

    @property
    def stiffness(self) -> np.ndarray:
        """C in the material axes, shape (6, 6), Pa."""
        C = np.diag([self.c11 - self.c12] * 3 + [self.c44] * 3)
        C[:3, :3] += self.c12
        return C


@dataclass(frozen=True)
class Orthotropic(_Orthotropic):
    """Linear elastic solid with three axes at small strain (plane strain in 2D).

    Args:
        young: Young's moduli E1, E2, E3 along the axes (Pa).
        poisson: nu12, nu13, nu23; nu_ij is minus the strain along j over that along i in tension
            along i, and nu_ji = nu_ij E_j / E_i.
        shear: shear moduli G12, G13, G23 (Pa).
        density: rho (kg/m^3).
        rotation: angle (rad) of the material axes about the third, or the 3 x 3 matrix whose
            columns are the material axes.

    Raises:
        ValueError: a modulus not above zero, a stiffness not positive definite, a matrix that is
            not a rotation.
    """

    young: Sequence[float]
    poisson: Sequence[float]
    shear: Sequence[float]
    density: float
    rotation: float | Sequence[Sequence[float]] = 0.0
    linear: bool = field(default=True, init=False)

    def __post_init__(self) -> None:
        for name in ("young", "poisson", "shear"):
            values = require_numbers(name, getattr(self, name))
            if values.shape != (3,) or not np.all(np.isfinite(values)):
                raise ValueError(f"{name} should be three finite numbers, got {values.tolist()}.")
            if name != "poisson" and not np.all(values > 0.0):
                raise ValueError(f"{name} should be above zero, got {values.tolist()}.")
        self._check()

    @property
    def stiffness(self) -> np.ndarray:
        """C in the material axes, shape (6, 6), Pa."""
        E = np.asarray(self.young, dtype=float)
        compliance = np.diag(np.concatenate([1.0 / E, 1.0 / np.asarray(self.shear)[::-1]]))
        for nu, (i, j) in zip(self.poisson, _SHEARS[::-1], strict=True):
            compliance[i, j] = compliance[j, i] = -nu / E[i]
        try:
            return np.linalg.inv(compliance)
        except np.linalg.LinAlgError:
            raise ValueError(
                f"The compliance is singular with young {self.young} and poisson {self.poisson}: "
                "nu_12^2 should be below E1 / E2, and so on; take smaller poisson."
            ) from None


def rotation_matrix(rotation: float | Sequence[Sequence[float]]) -> np.ndarray:
    """The matrix of an angle (rad) about the third axis, or a given one, checked.

    Raises:
        ValueError: not a finite angle, nor a proper rotation.
    """
    R = require_numbers("rotation", rotation)
    if R.shape == () and math.isfinite(R):
        c, s = math.cos(R), math.sin(R)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    proper = R.shape == (3, 3) and np.allclose(R @ R.T, np.eye(3), atol=1e-10)
    if not (proper and np.linalg.det(R) > 0.0):
        raise ValueError(
            "rotation should be a finite angle (rad) or a 3 x 3 matrix whose columns are "
            f"orthonormal axes, right-handed, got {R.tolist()}."
        )
    return R
