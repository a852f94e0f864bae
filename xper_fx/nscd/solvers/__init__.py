# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solvers of all interaction points together; `solver.py` says what a solver is."""

from typing import TYPE_CHECKING

from xper_fx.support.lazy import importer

if TYPE_CHECKING:
    from xper_fx.nscd.solvers.accelerated import AcceleratedSweeps as AcceleratedSweeps
    from xper_fx.nscd.solvers.auto import Automatic as Automatic
    from xper_fx.nscd.solvers.distributed import DistributedSweeps as DistributedSweeps
    from xper_fx.nscd.solvers.feti import BondedGradients as BondedGradients
    from xper_fx.nscd.solvers.monolithic import Monolithic as Monolithic
    from xper_fx.nscd.solvers.newton import NewtonOnAllPoints as NewtonOnAllPoints
    from xper_fx.nscd.solvers.nlgs import NonlinearGaussSeidel as NonlinearGaussSeidel
    from xper_fx.nscd.solvers.solver import SolveOptions as SolveOptions
    from xper_fx.nscd.solvers.solver import Solver as Solver
    from xper_fx.nscd.solvers.solver import SolveReport as SolveReport
    from xper_fx.nscd.solvers.vertex_blocks import VertexBlocks as VertexBlocks

_MODULE_OF = {
    "AcceleratedSweeps": "accelerated",
    "Automatic": "auto",
    "BondedGradients": "feti",
    "DistributedSweeps": "distributed",
    "Monolithic": "monolithic",
    "NewtonOnAllPoints": "newton",
    "NonlinearGaussSeidel": "nlgs",
    "SolveOptions": "solver",
    "SolveReport": "solver",
    "Solver": "solver",
    "VertexBlocks": "vertex_blocks",
}

__all__ = list(_MODULE_OF)
__getattr__ = importer(__name__, _MODULE_OF)
