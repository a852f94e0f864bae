# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which effects a scene calls for, what each holds in memory, what each cost.

An effect that is off has no kernel, no array and no form: its row reads zero because there is
nothing to count.
"""

from __future__ import annotations

from typing import NamedTuple

from xper_fx.nscd.laws.law import EFFECTS
from xper_fx.simulation import Simulation


class Effect(NamedTuple):
    """One row of the table.

    Attributes:
        name: the effect.
        on: whether the scene calls for it.
        memory: bytes held for it.
        seconds: time spent on it so far.
    """

    name: str
    on: bool
    memory: int
    seconds: float


def effects_of(simulation: Simulation) -> list[Effect]:
    """The effects of a simulation, on or off.

    Times come from the run's stopwatch; the interaction solver's is shared among laws by their
    number of points, as a sweep visits each point once.
    """
    scene, bulk, spent = simulation.scene, simulation.bulk, simulation.stopwatch.seconds
    groups = simulation.interactions.groups if simulation.interactions else []
    total = max(sum(len(g) for g in groups), 1)
    interacting = spent.get("interaction solve", 0.0) + spent.get("interaction terms", 0.0)
    forces = simulation.forms.external is not None
    rows = [
        Effect("bulk", True, simulation.scheme.nbytes,
               spent.get("free velocity", 0.0)),
        Effect("matrix renewed in Newton", not bulk.linear, 0,
               0.0 if bulk.linear else spent.get("inverse", 0.0)),
        Effect("internal variables", simulation.forms.has_history, simulation.forms.history_nbytes,
               spent.get("internal variables", 0.0)),
        Effect("periodic cell", scene.macroscopic is not None,
               0 if scene.macroscopic is None else bulk.unknowns.nbytes, 0.0),
        Effect("inertia", bulk.inertia, bulk.mass.nbytes if bulk.inertia else 0, 0.0),
        Effect("external forces", forces, 8 * bulk.num_dofs if forces else 0, 0.0),
        Effect("viscous damping", scene.damping is not None, 0, 0.0),
    ]  # fmt: skip
    for group in groups:
        seconds = interacting * len(group) / total
        rows.append(Effect(group.kernels.name, True, group.nbytes, seconds))
    present = {effect for group in groups for effect in group.kernels.effects}
    rows += [Effect(effect, False, 0, 0.0) for effect in EFFECTS if effect not in present]
    return rows


def effects_table(simulation: Simulation) -> str:
    """The table as text."""
    lines = [f"{'effect':<32}{'':<5}{'memory':>12}{'time':>12}"]
    for effect in effects_of(simulation):
        memory = f"{effect.memory / 1e6:.2f} MB" if effect.memory else "-"
        seconds = f"{effect.seconds:.2f} s" if effect.on else "-"
        lines.append(f"{effect.name:<32}{'on' if effect.on else 'off':<5}{memory:>12}{seconds:>12}")
    return "\n".join(lines)
