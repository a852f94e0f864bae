# SPDX-License-Identifier: LGPL-3.0-or-later
"""A static problem at the level of the bulk: Newton with backtracking on the assembled tangent."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from xper_fx.bulk.bulk import Bulk
from xper_fx.forms.dynamics import BulkForms
from xper_fx.forms.loads import PrescribedDisplacement, SurfaceTraction


class Static:
    """Increments of equilibrium of one body or more, without contact.

    Args:
        bodies, order, materials: of the forms.
        held: (facet tag, component, value) of prescribed displacements, the value a number or a
            function of a load parameter.
        tractions: (facet tag, values), the values numbers or functions of the load parameter.
    """

    def __init__(self, bodies, order, materials, held, tractions=()):
        self.forms = BulkForms(
            bodies, order, materials, [SurfaceTraction(tag, value) for tag, value in tractions]
        )
        self.motions = [PrescribedDisplacement(*motion) for motion in held]
        self.bulk = Bulk(self.forms, self.motions)
        self.u = np.zeros(self.bulk.num_dofs)
        self.fixed = np.concatenate([dofs for dofs, _ in self.bulk._motions])
        self.free = np.setdiff1d(np.arange(self.bulk.num_dofs), self.fixed)
        self.dissipated = 0.0

    def advance(self, load, tolerance=1e-10, most=25, commit=True) -> list[float]:
        """Equilibrium at a load parameter from the committed state.

        Returns:
            Norm of the residual at each iterate.
        """
        bulk, free = self.bulk, self.free
        u = self.u.copy()
        change = np.zeros_like(u)
        for dofs, motion in bulk._motions:
            value = motion.value(load) if callable(motion.value) else motion.value
            change[dofs] = value - u[dofs]
        external = bulk.external(load)
        residual = lambda u: external - bulk.internal(u)  # noqa: E731
        norm = lambda r: float(np.linalg.norm(r[free]))  # noqa: E731
        r, history = residual(u), []
        for iteration in range(most):
            K = sp.csc_array(bulk.tangent(u))[free]
            rhs = r[free] - K @ change if iteration == 0 else r[free]
            du = sp.linalg.splu(K[:, free].tocsc()).solve(rhs)
            if iteration == 0:
                u = u + change
                u[free] += du
                r = residual(u)
            else:
                for cut in range(8):
                    trial = u.copy()
                    trial[free] += 0.5**cut * du
                    new = residual(trial)
                    if norm(new) < norm(r):
                        break
                u, r = trial, new
            history.append(norm(r))
            assert np.isfinite(history[-1]), history
            scale = np.linalg.norm(bulk.internal(u)) + np.linalg.norm(external)
            if history[-1] <= tolerance * scale:
                break
        else:
            raise AssertionError(f"no equilibrium at load {load}: {history}")
        self.u = u
        if commit:
            self.dissipated += sum(self.forms.assemble_dissipation(u).values())
            self.forms.commit(u)
        return history

    def reaction(self, tag: int, component: int) -> float:
        """Force that the facets of a tag are pulled with (N; 2D: N/m)."""
        motion = PrescribedDisplacement(tag, component, 0.0)
        return float(self.bulk.internal(self.u)[self.bulk._motion_dofs(motion)].sum())

    def at(self, point) -> np.ndarray:
        """Displacement of the node nearest to a point (m)."""
        x = self.forms.V.tabulate_dof_coordinates()[:, : self.bulk.dim]
        return self.u.reshape(-1, self.bulk.dim)[np.argmin(np.sum((x - point) ** 2, axis=1))]
