# SPDX-License-Identifier: LGPL-3.0-or-later
"""How the ranks of a run divide a scene: its meshed bodies, the contacts of rigid ones, or not."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from xper_fx.nscd.solvers.solver import Solver, UnsuitableSolverError
from xper_fx.scene.scene import Scene
from xper_fx.simulation.options import SOLVERS, Options
from xper_fx.support.profile import Stopwatch
from xper_fx.support.ranks import ALONE, Ranks

if TYPE_CHECKING:
    from xper_fx.parallel.local_bodies import LocalBodies
    from xper_fx.parallel.rebalancing import Rebalancing
    from xper_fx.parallel.rigid_partition import RigidDivision
    from xper_fx.parallel.rigid_share import RigidShare

logger = logging.getLogger(__name__)


class Decomposition(NamedTuple):
    """What of a scene is this rank's."""

    #: those that divide the bodies or their contacts; this one alone where none do
    ranks: Ranks = ALONE
    part: LocalBodies | None = None  #: what this rank has of the bodies, None if it has all
    #: division of the contacts of rigid bodies, None if this rank has all
    contacts: RigidDivision | None = None
    #: what of the rigid bodies beside meshed ones is this rank's, None if all or none are
    rigid: RigidShare | None = None
    balance: Rebalancing | None = None  #: tells when to divide anew, None where nothing moves


def decomposed(
    scene: Scene,
    options: Options,
    team: Ranks,
    stopwatch: Stopwatch,
    rank_of_body: np.ndarray | None,
) -> Decomposition:
    """Divide a scene among ranks where that can be done; all ranks call it together.

    Args:
        options: of the run.
        team: ranks that have the scene.
        stopwatch: of the run.
        rank_of_body: of meshed bodies, then of rigid ones, as they are to be divided, shape
            (num_bodies,); None where that is to be found.
    """
    if team.alone:
        return Decomposition()
    _refuse_solver_of_one_rank(options.solver, team)
    touching = _searches(scene)
    if scene.bodies is None:
        if not touching or _name(options.solver) not in ("auto", "nlgs"):
            return Decomposition(team)
        from xper_fx.parallel.rigid_partition import RigidDivision

        moves = ~scene.rigid_bodies.is_prescribed.all(axis=1)
        groups = _rigid_groups(scene, moves, False)
        division = RigidDivision(team, moves, scene.dim, groups, _cell_dofs(scene))
        return Decomposition(team, None, division)
    from xper_fx.parallel.local_bodies import divide

    bodies, solids = scene.bodies, scene.rigid_bodies
    rigid, groups = None, np.zeros(0, int)
    with stopwatch.phase("partition"):
        given = None if rank_of_body is None else rank_of_body[: bodies.num_bodies]
        part = divide(bodies, team, touching or len(scene.ties) > 0, given)
        if solids is not None:
            from xper_fx.parallel.rigid_share import RigidShare, share_rigid

            names, moves = set(solids.groups), ~solids.is_prescribed.all(axis=1)
            touch = any(c.law is not None and set(c.between) <= names for c in scene.contacts)
            groups = _rigid_groups(scene, moves, touch)
            if rank_of_body is None:
                rigid = share_rigid(solids, bodies, part.rank_of_body, team, groups)
            else:
                rigid = RigidShare(team, rank_of_body[bodies.num_bodies :], moves, scene.dim)
    if rank_of_body is None:
        _tell_bare(team, part)
    return Decomposition(team, part, None, rigid, _balance(scene, team, part, rigid, groups))


def _tell_bare(team: Ranks, part: LocalBodies) -> None:
    """Warn of ranks that have no body; all ranks call it together."""
    bare = int(team.sum(part.bodies.num_bodies == 0))
    if bare and team.rank == 0:
        logger.warning(
            "%d of %d ranks have no meshed body and only wait for the others; a run on %d would "
            "be as fast", bare, team.size, team.size - bare,
        )  # fmt: skip


def _balance(
    scene: Scene,
    team: Ranks,
    part: LocalBodies,
    rigid: RigidShare | None,
    groups: np.ndarray,
) -> Rebalancing | None:
    """What tells when to divide bodies anew, where surfaces may meet and bodies can move."""
    named = {name for c in scene.contacts if c.law is not None for name in c.between}
    if named.isdisjoint(scene.surfaces):
        return None
    rank_of_rigid, moves = np.zeros(0, np.int32), np.zeros(0, bool)
    if rigid is not None:
        rank_of_rigid, moves = rigid.rank_of_body, rigid.moves
    if scene.bodies.spread is not None:
        from xper_fx.parallel.spread_rebalancing import SpreadRebalancing

        return SpreadRebalancing(team, part, rank_of_rigid, moves, groups)
    from xper_fx.parallel.rebalancing import Rebalancing

    return Rebalancing(
        team, np.concatenate([part.rank_of_body, rank_of_rigid]),
        np.bincount(scene.bodies.body_of_cell), moves, groups,
    )  # fmt: skip


def _rigid_groups(scene: Scene, moves: np.ndarray, touch: bool) -> np.ndarray:
    """Rigid bodies that have to be on one rank have one number, shape (num_rigid,).

    Args:
        moves: which of them can move, shape (num_rigid,).
        touch: whether they may touch each other, and are all to be on one.
    """
    if touch or not scene.joints:
        return np.zeros(len(moves), int) if touch else np.arange(len(moves))
    from xper_fx.scene.joints import jointed_groups

    return jointed_groups(scene.joints, scene.rigid, moves)


def _cell_dofs(scene: Scene) -> np.ndarray:
    """Which components of dF/dt contacts move, column by column, in whole blocks; none without.

    A block has two columns, as many numbers as a body's.
    """
    if scene.macroscopic is None:
        return np.zeros(0, bool)
    moved = ~scene.macroscopic.kinematic(scene.dim)
    return np.pad(moved, (0, -len(moved) % (2 * scene.dim)))


def _searches(scene: Scene) -> bool:
    """Whether contacts have to be looked for."""
    return any(contact.law is not None for contact in scene.contacts)


def _refuse_solver_of_one_rank(solver: str | Solver, team: Ranks) -> None:
    """Raise an UnsuitableSolverError where a solver of one's own would see one rank's points."""
    if _name(solver) in SOLVERS:
        return
    raise UnsuitableSolverError(
        f"solver is a {type(solver).__name__}, which knows the points of one rank, and {team.size} "
        "ranks divide them: run it on one (comm=MPI.COMM_SELF), or take a solver by its name, or "
        "Simulation.contact_problem(), which all ranks have whole."
    )


def _name(solver: str | Solver) -> str:
    return solver.name if isinstance(solver, Solver) else solver
