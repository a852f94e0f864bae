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

from functools import partial

import numpy as np

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.solvers.solver import SolveOptions, Solver, SolveReport
from xper_fx.nscd.splitting.fused_points import FusedPoints
from xper_fx.nscd.splitting.split_vertices import split_kernel
from xper_fx.nscd.splitting.vertex_kernels import VertexWork, vertex_work
from xper_fx.nscd.splitting.whole_vertices import whole_kernel

_NOT_ASKED, _NONE = np.zeros(0, np.int16), np.zeros(0, np.int32)


class SplittingVertices(Solver):
    """Whole vertices as nodes of finite elements, cracked ones solved each for itself."""

    name = "splitting_vertices"

    def __init__(self) -> None:
        self._work: VertexWork | None = None
        self._touching = False

    def solve(
        self, interactions: Interactions, velocity: np.ndarray, options: SolveOptions
    ) -> SolveReport:
        """Find the impulses of the step, as `Solver.solve` says."""
        graphs = interactions.fused.graphs
        if self._work is None:
            self._work = vertex_work(graphs, interactions.dim)
            self._all = np.arange(graphs.num_vertices, dtype=np.int32)
        self._touching = interactions.touches
        interactions.fused.impulses = np.zeros((interactions.inverse.num_slots, interactions.dim))
        move = partial(self._move, interactions, velocity, options)
        if not self._touching:
            report = move(self._all)
            interactions.evolve(velocity)  # vertices have; it tells whether some have gone too far
            return report
        from xper_fx.nscd.touching.in_turns import take_turns

        fused = interactions.fused
        return take_turns(interactions, fused, velocity, move, options, self._all)

    def _move(
        self,
        interactions: Interactions,
        velocity: np.ndarray,
        options: SolveOptions,
        vertices: np.ndarray,
    ) -> SolveReport:
        """Solve some vertices, in which velocities are those of their cells for themselves."""
        fused: FusedPoints = interactions.fused
        dim, step, ground = interactions.dim, interactions.step_size, interactions.inverse.num_nodes
        still, flipped = vertices, 0
        while not flipped:
            split = fused.split if vertices is self._all else vertices[~fused.whole[vertices]]
            laws = tuple(g.kernels for g in fused.groups)
            sweeps, error, missed = 0, 0.0, 0
            given = (
                velocity, fused.impulses, step, ground, fused.graphs, self._work, still,
                fused.whole, fused.table_rows, fused.group_of, fused.tables, fused.failed,
            )  # fmt: skip
            if len(split):
                arrays = tuple(
                    array
                    for g in fused.groups
                    for array in (g.couplings.frame, g.impulse, g.compliance, g.points.area,
                                  g.jump, g.velocity, g.parameters, g.state, g.terms, g.details)
                )  # fmt: skip
                failed, sweeps, error, missed = split_kernel(laws, dim)(
                    *given, split, fused.rows, tuple(g.parameters for g in fused.groups), arrays,
                    options.tolerance,
                    fused.clusters if self._touching or interactions.turns else _NOT_ASKED,
                )  # fmt: skip
            else:
                failed = whole_kernel(laws, dim)(*given)
            if not failed:
                break
            flipped = interactions.wake(fused.failed[:failed].copy())
            still = _NONE
        if interactions.turns:
            interactions.require_no_flips(flipped)
        return SolveReport(missed == 0, sweeps, error, 0.0)
