# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The step below which an explicit bulk is stable, which falls as cells are flattened.

Central differences are stable for h < 2 / omega_max, omega_max^2 being the largest eigenvalue of
M^-1 K. Viscous forces C v are those of the velocity at the start of the step. Of a mode with
C = c M, v1 = (1 - h c - s) v0 - h omega^2 q0 and q1 = q0 + h (v0 + v1) / 2 with s = (h omega)^2 / 2
have the determinant 1 - h c and the trace 2 - h c - 2 s, and no eigenvalue beyond one for

    (h omega)^2 + 2 h c <= 4,   h <= 4 / (c + sqrt(c^2 + 4 omega^2)).

At finite strain K is that of the present configuration: a cell squeezed to a third of its
height vibrates some three times as fast. Beyond the limit the fastest vibration grows by a factor
in each step, and takes its energy from nowhere.

K costs some ten times as much as forces, so it is assembled again only where it may have changed
enough. With F_0 of a cell when K was last looked at, f = F F_0^-1 and the strain since then,

    e = max |f^T f - I| / 2   (row sums),

a cell squeezed by e vibrates up to 1 / (1 - e) times as fast, and a material that stiffens does so
too. K is assembled again once e exceeds half of the margin, one less h over the stable step.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping

import basix
import numpy as np
import ufl

from xper_fx.bulk.bulk import Bulk
from xper_fx.cache import njit
from xper_fx.forms.compiled import compiled_expression
from xper_fx.support.saved_rows import Rows

logger = logging.getLogger(__name__)

# Steps between two looks at the strains: a wave passes a cell in one or two.
_LOOKS_EVERY = 4
# Share of the present stable step that a step may be once that one has fallen.
_SAFE = 0.9


@njit
def _largest_strain(gradients, inverses):
    """Largest strain of all cells since F was the inverse of `inverses`; a NaN is left out.

    Args:
        gradients: of the displacement, shape (num_cells, dim, dim).
        inverses: of the deformation gradients before, of the same shape.
    """
    dim = gradients.shape[1]
    largest = 0.0
    f = np.empty((dim, dim))
    for cell in range(len(gradients)):
        for i in range(dim):
            for j in range(dim):
                f[i, j] = inverses[cell, i, j]
                for k in range(dim):
                    f[i, j] += gradients[cell, i, k] * inverses[cell, k, j]
        for i in range(dim):
            row = 0.0
            for j in range(dim):
                c = -1.0 if i == j else 0.0
                for k in range(dim):
                    c += f[k, i] * f[k, j]
                row += abs(c)
            largest = max(largest, 0.5 * row)
    return largest


def stable_step(bulk: Bulk, displacement: np.ndarray | None = None) -> float:
    """Largest step (s) at which an explicit bulk is stable, with its damping; at rest or not."""
    critical = bulk.critical_step(displacement)
    if bulk.damping is None:
        return critical
    omega = 2.0 / critical
    rate = bulk.damping.rate(omega)
    return 4.0 / (rate + np.hypot(rate, 2.0 * omega))


class StableStep:
    """Follows the stable step of a bulk along a run.

    Args:
        bulk: at finite strain, as it is at rest.

    Attributes:
        step: the shortest stable step so far (s). It does not rise again: an explicit step that
            goes up and down near it feeds the fastest vibrations.
    """

    def __init__(self, bulk: Bulk):
        self._bulk = bulk
        self.step = self._at_rest = stable_step(bulk)
        mesh, dim = bulk.forms.bodies.mesh, bulk.dim
        kind = getattr(basix.CellType, mesh.topology.cell_name())
        middle = basix.geometry(kind).mean(axis=0, keepdims=True)
        self._gradient = compiled_expression(ufl.grad(bulk.forms.u), middle)
        self._cells = np.arange(len(bulk.forms.bodies.parent_cell), dtype=np.int32)
        self._inverses = np.tile(np.eye(dim), (len(self._cells), 1, 1))
        self._since = 0

    def bears(self, size: float, displacement: np.ndarray) -> bool:
        """Whether a step of size h (s) from a displacement is stable."""
        self._since += 1
        if self._since >= _LOOKS_EVERY:
            self._since = 0
            self._look(size, displacement)
        return size <= (self._at_rest if self.step == self._at_rest else _SAFE * self.step)

    def _look(self, size: float, displacement: np.ndarray) -> None:
        bulk = self._bulk
        bulk.forms.u.x.array[:] = bulk.unknowns.expand(displacement)
        gradients = self._gradient.eval(bulk.forms.bodies.mesh, self._cells)
        gradients = gradients.reshape(self._inverses.shape)
        strain = bulk.ranks.max(_largest_strain(gradients, self._inverses))
        if strain <= 0.5 * (1.0 - size / self.step):
            return
        self._inverses = np.linalg.inv(np.eye(bulk.dim) + gradients)
        now = stable_step(bulk, displacement)
        if now < self.step:
            self.step = now
            logger.info(
                "the stable step of the bulk has fallen from %.3g to %.3g s, as cells are "
                "flattened or stiffen", self._at_rest, now,
            )  # fmt: skip

    def failure(self) -> str:
        """Why a step is not tried."""
        return (
            "cells are flattened, or have stiffened, so far that the explicit bulk is stable below "
            f"{self.step:.3g} s alone, {self._at_rest:.3g} s at rest: look at the last output, and "
            'take a smaller step, scheme="implicit", or coarser cells there'
        )

    def saved(self) -> dict:
        """What steps to come depend on."""
        number = self._bulk.forms.bodies.parent_cell
        return {
            "step": self.step, "since": self._since, "inverses": Rows(number, self._inverses),
        }  # fmt: skip

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave, its rows in order."""
        self.step, self._since = saved["step"], int(saved["since"])
        self._inverses = saved["inverses"][self._bulk.forms.bodies.parent_cell]
