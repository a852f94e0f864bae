# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Explicit bulk: vertices whose cells move as one, and those that have cracked.

**Whole vertices** move with the momentum of their cells over their mass, as a node of ordinary
finite elements does, as long as some admissible tractions hold them together (`holding.py`).

**The others** are solved cluster by cluster of cells that fused bonds join. Each cluster has the
mass of its corners; impulses r of the bonds between clusters obey r = S(b), S the law and b the
relative velocity without the bond's own impulse. Gauss-Seidel sweeps are followed, where they
stall, by steps of a semismooth Newton method for all bonds of the vertex,

    (I - T (W - diag W)) dr = S(b) - r,   T the slopes of S by differences.

Then the fused bonds are asked: where their flow is not borne, the vertex is solved with each cell
for itself and all sound bonds following their set-valued law, what has opened is cut, and the
clusters are solved again. What opens within a cluster that other bonds hold stays as it was.

Nodes keep their velocities when they part, so that a split conserves momentum and energy. Cells
of a cluster have the same velocity, to the bit, and with it the same displacement for as long as
they stay together.
"""

from __future__ import annotations

import numpy as np

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.solvers.solver import SolveOptions, Solver, SolveReport
from xper_fx.nscd.splitting.fused_points import FusedPoints
from xper_fx.nscd.splitting.split_vertices import split_kernel
from xper_fx.nscd.splitting.vertex_kernels import VertexWork, vertex_work
from xper_fx.nscd.splitting.whole_vertices import whole_kernel


class SplittingVertices(Solver):
    """Whole vertices as nodes of finite elements, cracked ones solved each for itself."""

    name = "splitting_vertices"

    def __init__(self) -> None:
        self._work: VertexWork | None = None

    def solve(
        self, interactions: Interactions, velocity: np.ndarray, options: SolveOptions
    ) -> SolveReport:
        """Find the impulses of the step, as `Solver.solve` says."""
        fused: FusedPoints = interactions.fused
        graphs, dim, step = fused.graphs, interactions.dim, interactions.step_size
        if self._work is None:
            self._work = vertex_work(graphs, dim)
        laws = tuple(g.kernels for g in fused.groups)
        ground = interactions.inverse.num_nodes
        move_whole = whole_kernel(laws, dim)
        failed = move_whole(
            velocity, fused.impulses, step, ground, graphs, self._work, fused.whole,
            fused.table_rows, fused.group_of, fused.tables, fused.failed,
        )  # fmt: skip
        if failed:
            interactions.wake(fused.failed[:failed].copy())
        if not len(fused.split):
            return SolveReport(True, 0, 0.0, 0.0)
        arrays = tuple(
            array
            for g in fused.groups
            for array in (g.couplings.frame, g.impulse, g.compliance, g.points.area, g.jump,
                          g.velocity, g.parameters, g.state, g.terms, g.details)
        )  # fmt: skip
        sweeps, error, missed = split_kernel(laws, dim)(
            velocity, fused.impulses, step, ground, graphs, self._work, fused.split, fused.rows,
            fused.group_of, tuple(g.parameters for g in fused.groups), arrays, options.tolerance,
        )  # fmt: skip
        return SolveReport(missed == 0, sweeps, error, 0.0)
