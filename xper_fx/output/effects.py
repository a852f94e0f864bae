# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which effects a scene calls for, what they hold and what they cost.

An effect that a scene does not call for is not imported, not compiled, not allocated and not
called. The table in `docs/guide/effects.md` says what calls for each and which code is its own;
`tests/output/test_effects.py` runs scenes with the code of all that is off taken away, and finds
the same answer to the bit by the same calls. What is left of it in a step is a test of None.

`EFFECTS` is the table of the package. An effect added later is a row more in both, and the tests
ask for a scene that calls for it. Laws and materials name their effects themselves
(`LawKernels.effects`, `material.effects`), those of a user too; a name that the table does not have
gets a row.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.laws.parameters import fields_of
from xper_fx.nscd.point_group import PointGroup
from xper_fx.nscd.rigid.shapes import CLUSTER
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.checks import require_kind


class Effect(NamedTuple):
    """A row of the table."""

    name: str  #: the effect
    on: Callable[[Simulation], bool]  #: whether a simulation calls for it
    #: how many bytes it holds where it is on
    nbytes: Callable[[Simulation], int] = lambda simulation: 0
    #: phases of the run (`xper_fx/support/profile.py`) that are its alone
    phases: tuple[str, ...] = ()


def _of_laws(name: str) -> Effect:
    """The effect of the laws that name it, which tell what they hold for it."""
    return Effect(name, lambda s: name in _law_effects(s), lambda s: _law_effects(s).get(name, 0))


def _solves(*names: str) -> Callable[[Simulation], bool]:
    """Whether one of the solvers named may be called for."""
    return lambda s: (
        s.interactions is not None and not s.model.monolithic
        and s.solver.name in ("auto", *names)
    )  # fmt: skip


def _all_bonded(simulation: Simulation) -> bool:
    return all(g.kernels.no_jump for g in simulation.interactions.groups)


def _springs_of_bodies(simulation: Simulation) -> bool:
    """Whether bodies that interactions alone hold stand on springs between iterations."""
    return simulation.bulk.floating and not simulation.model.monolithic


def _kept(*modules: str) -> Callable[[Simulation], int]:
    """Bytes of what the solver keeps of classes of some modules of `nscd/solvers`."""
    names = {f"xper_fx.nscd.solvers.{module}" for module in modules}

    def nbytes(simulation: Simulation) -> int:
        kept = [held for held in simulation.solver.kept() if type(held).__module__ in names]
        return _bytes_within(kept)

    return nbytes


def _bytes_within(item: object) -> int:
    """Bytes of the arrays in an object, its attributes, lists and tuples."""
    if isinstance(item, np.ndarray):
        return item.nbytes
    if isinstance(item, Interactions):  # what a solver keeps names its scene
        return 0
    if isinstance(item, list | tuple):
        return sum(map(_bytes_within, item))
    return sum(map(_bytes_within, vars(item).values())) if hasattr(item, "__dict__") else 0


def _has_clusters(simulation: Simulation) -> bool:
    return any(body.shape.kind == CLUSTER for body in simulation.scene.rigid)


def _turning_bytes(simulation: Simulation) -> int:
    """Bytes of what points have to turn with their lips."""
    held = [g.turning for g in simulation.interactions.groups if g.turning is not None]
    return _bytes_within([list(turning) for turning in held])


def _initial_stiffness(simulation: Simulation) -> int:
    """Bytes of K0, which a bulk that is not linear keeps for its damping."""
    bulk = simulation.bulk
    return 0 if bulk.linear or bulk.stiffness is None else bulk.stiffness.data.nbytes


def _is_meshed_cell(simulation: Simulation) -> bool:
    return simulation.scene.macroscopic is not None and simulation.scene.bodies is not None


EFFECTS = (
    Effect("inertia", lambda s: s.bulk.inertia is not None),
    Effect("viscous damping", lambda s: s.bulk.damping is not None, _initial_stiffness),
    Effect(
        "external forces",
        lambda s: s.forms.external is not None,
        lambda s: np.asarray(s.state.external).nbytes,
    ),
    Effect("finite strain", lambda s: "finite strain" in _material_effects(s)),
    Effect("Newton of the bulk", lambda s: not s.bulk.linear or _springs_of_bodies(s)),
    Effect(
        "internal variables",
        lambda s: s.forms.has_history,
        lambda s: s.forms.history_nbytes,
        ("commit",),
    ),
    Effect("plasticity", lambda s: s.forms.plastic, phases=("flow check",)),
    Effect("viscosity", lambda s: s.forms.viscous),
    Effect(
        "interactions",
        lambda s: s.interactions is not None,
        lambda s: (
            s.interactions.nbytes
            - sum(_law_effects(s).values())
            - _turning_bytes(s)
            - (0 if s.interactions.fused is None else s.interactions.fused.nbytes)
        ),
        ("interaction points", "interaction terms", "interaction solve"),
    ),
    Effect(
        "turning frames",
        lambda s: s.interactions is not None and s.interactions.turns,
        _turning_bytes,
        ("turning frames",),
    ),
    Effect(
        "rigid bodies", lambda s: s.rigid is not None, lambda s: s.rigid.nbytes, ("rigid bodies",)
    ),
    Effect("clusters", _has_clusters, lambda s: s.scene.rigid_bodies.shapes.offset.nbytes),
    Effect(
        "contact search",
        lambda s: s.detection is not None,
        lambda s: s.detection.nbytes,
        ("contact search",),
    ),
    Effect(
        "healing",
        lambda s: s.model.healing is not None,
        lambda s: s.model.healing.nbytes,
        ("healing",),
    ),
    Effect(
        "joints",
        lambda s: s.model.joints is not None,
        lambda s: s.model.joints.nbytes + _law_effects(s).get("joints", 0),
        ("joints",),
    ),
    Effect("walls", lambda s: len(s.scene.walls) > 0),
    _of_laws("cohesion"),
    _of_laws("damage"),
    _of_laws("mixed modes"),
    _of_laws("viscous bonds"),
    _of_laws("unilateral contact"),
    _of_laws("impact"),
    _of_laws("friction"),
    _of_laws("rolling resistance"),
    _of_laws("perfect bond"),
    Effect("fields", lambda s: any(map(fields_of, s.model.points.laws))),
    Effect("periodicity", _is_meshed_cell, lambda s: s.bulk.unknowns.nbytes),
    Effect(
        "macroscopic control",
        _is_meshed_cell,
        lambda s: s.state.external.nbytes,
        ("macroscopic averages",),
    ),
    Effect(
        "mean stress given", lambda s: _is_meshed_cell(s) and len(s.scene.macroscopic.stress) > 0
    ),
    Effect("lattice of rigid bodies", lambda s: s.scene.lattice is not None),
    Effect(
        "lattice that deforms",
        lambda s: s.scene.lattice is not None and s.scene.macroscopic is not None,
    ),
    Effect("three dimensions", lambda s: s.bulk.dim == 3),
    Effect("explicit bulk", lambda s: s.options.scheme == "explicit", lambda s: s.scheme.nbytes),
    Effect(
        "several ranks",
        lambda s: not s.ranks.alone,
        # bodies of rigid scenes are divided from the first contact on
        lambda s: getattr(getattr(s.interactions, "halo", None), "nbytes", 0),
    ),
    Effect(
        "vertex problems",
        lambda s: (
            s.interactions is not None
            and s.interactions.ordering == "vertices"
            and s.interactions.fused is None
        ),
        _kept("vertex_blocks"),
    ),
    Effect(
        "vertices that split",
        lambda s: s.interactions is not None and s.interactions.fused is not None,
        lambda s: s.interactions.fused.nbytes,
    ),
    Effect("Newton on all points", _solves("newton"), _kept("tangent", "shared_tangent")),
    Effect("mixed sweeps", _solves("accelerated")),
    Effect("subdomains", lambda s: _solves("subdomains")(s) and _all_bonded(s), _kept("feti")),
    Effect(
        "one system",
        lambda s: s.model.monolithic,
        lambda s: s.scheme.nbytes,
        ("bulk matrix", "point tangents", "factorisation", "solution"),
    ),
    Effect("path following", lambda s: s.options.path is not None),
    Effect("dissipation control", lambda s: getattr(s.options.path, "asks", "") == "cost"),
    Effect("floating bodies", _springs_of_bodies, lambda s: s.scheme.nbytes),
    Effect("ties", lambda s: len(s.scene.ties) > 0),
    Effect("error control", lambda s: s.estimated_error is not None),
    Effect("output", lambda s: s.folder is not None, phases=("output",)),
)
"""The effects that the package has."""


class EffectRow(NamedTuple):
    """What an effect is to a simulation."""

    name: str  #: the effect
    on: bool  #: whether the scene calls for it
    memory: int  #: bytes held for it
    seconds: float  #: time spent in phases that are its alone
    calls: int  #: how often these were entered


def _law_effects(simulation: Simulation) -> dict[str, int]:
    """Bytes of the columns that the laws in use hold for their effects."""
    interactions = simulation.interactions
    if interactions is None:
        return {}
    # another rank may have all points of a law
    laws = [] if simulation.ranks.alone else interactions.laws
    kernels = [law.kernels(interactions.dim) for law in laws]
    total = {name: 0 for kernel in kernels for name, _ in kernel.effects}
    for group in interactions.groups:
        for name, columns in group.kernels.effects:
            total[name] = total.get(name, 0) + 8 * columns * len(group)
    return total


def _material_effects(simulation: Simulation) -> set[str]:
    return {
        name
        for material in simulation.scene.materials.values()
        for name in getattr(material, "effects", ())
    }


def effects_of(simulation: Simulation) -> list[EffectRow]:
    """The effects of a simulation, on or off; those that a user's law or material adds come last.

    What is off reads zero because there is nothing to count.
    """
    seconds, calls = simulation.stopwatch.seconds, simulation.stopwatch.calls
    rows = []
    for effect in EFFECTS:
        if not effect.on(simulation):
            rows.append(EffectRow(effect.name, False, 0, 0.0, 0))
            continue
        spent, entered = (
            sum(of.get(phase, 0) for phase in effect.phases) for of in (seconds, calls)
        )
        rows.append(EffectRow(effect.name, True, effect.nbytes(simulation), spent, entered))
    known = {effect.name for effect in EFFECTS}
    added = dict.fromkeys(sorted(_material_effects(simulation)), 0) | _law_effects(simulation)
    return rows + [
        EffectRow(name, True, memory, 0.0, 0) for name, memory in added.items() if name not in known
    ]


def _how_many(simulation: Simulation, group: PointGroup) -> str:
    """The points of a group, and how many there may be at most."""
    fused = simulation.interactions.fused
    if fused is None or group.kernels.rigid is None:
        return f"{len(group)} points"
    return f"{len(group)} points, of {fused.most(group)} that there may be"


def effects_table(simulation: Simulation) -> str:
    """The table as text, what is on first; then the laws in use, and what is off.

    Raises:
        TypeError: no simulation.
    """
    require_kind("simulation", simulation, Simulation)
    lines = [f"{'effect':<26}{'memory':>12}{'time':>12}{'calls':>10}"]
    rows = effects_of(simulation)
    for row in rows:
        if row.on:
            memory = f"{row.memory / 1e6:.2f} MB" if row.memory else "-"
            time = f"{row.seconds:.2f} s" if row.calls else "-"
            lines.append(f"{row.name:<26}{memory:>12}{time:>12}{row.calls or '-':>10}")
    groups = simulation.interactions.groups if simulation.interactions is not None else []
    lines += [f"law: {group.kernels.name}, {_how_many(simulation, group)}" for group in groups]
    lines.append("off: " + ", ".join(row.name for row in rows if not row.on))
    return "\n".join(lines)
