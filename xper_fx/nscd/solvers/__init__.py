# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solvers of all interaction points together; `solver.py` says what a solver is."""

from typing import TYPE_CHECKING

from xper_fx.support.lazy import importer

if TYPE_CHECKING:
    from xper_fx.nscd.solvers.accelerated import AcceleratedSweeps as AcceleratedSweeps
    from xper_fx.nscd.solvers.assembled import AndersonSweeps as AndersonSweeps
    from xper_fx.nscd.solvers.assembled import AssembledContacts as AssembledContacts
    from xper_fx.nscd.solvers.assembled import InteriorPoint as InteriorPoint
    from xper_fx.nscd.solvers.assembled import ProximalPoint as ProximalPoint
    from xper_fx.nscd.solvers.auto import Automatic as Automatic
    from xper_fx.nscd.solvers.distributed import DistributedSweeps as DistributedSweeps
    from xper_fx.nscd.solvers.feti import BondedGradients as BondedGradients
    from xper_fx.nscd.solvers.monolithic import Monolithic as Monolithic
    from xper_fx.nscd.solvers.newton import NewtonOnAllPoints as NewtonOnAllPoints
    from xper_fx.nscd.solvers.nlgs import NonlinearGaussSeidel as NonlinearGaussSeidel
    from xper_fx.nscd.solvers.solver import SolveOptions as SolveOptions
    from xper_fx.nscd.solvers.solver import Solver as Solver
    from xper_fx.nscd.solvers.solver import SolveReport as SolveReport
    from xper_fx.nscd.solvers.solver import UnsuitableSolverError as UnsuitableSolverError
    from xper_fx.nscd.solvers.vertex_blocks import VertexBlocks as VertexBlocks

_MODULE_OF = {
    "AcceleratedSweeps": "accelerated",
    "AndersonSweeps": "assembled",
    "AssembledContacts": "assembled",
    "Automatic": "auto",
    "BondedGradients": "feti",
    "DistributedSweeps": "distributed",
    "InteriorPoint": "assembled",
    "Monolithic": "monolithic",
    "NewtonOnAllPoints": "newton",
    "NonlinearGaussSeidel": "nlgs",
    "ProximalPoint": "assembled",
    "SolveOptions": "solver",
    "SolveReport": "solver",
    "Solver": "solver",
    "UnsuitableSolverError": "solver",
    "VertexBlocks": "vertex_blocks",
}

__all__ = list(_MODULE_OF)
__getattr__ = importer(__name__, _MODULE_OF)
