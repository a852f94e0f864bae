# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which effects a scene calls for, where their code is, what they hold and what they cost.

An effect that a scene does not call for is not imported, not compiled, not allocated and not
called: `tests/output/test_effects.py` runs scenes with the code of all that is off taken away, and
finds the same answer to the bit by the same calls. What is left of it in a step is a test of None.

`EFFECTS` is the table. An effect added later is a row more, and the tests ask for a scene that
calls for it. Laws and materials name their effects themselves (`LawKernels.effects`,
`material.effects`), those of a user too; a name that the table does not have gets a row.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from xper_fx.nscd.interactions import Interactions

if TYPE_CHECKING:
    from xper_fx.simulation.simulation import Simulation


def _of_laws(name: str) -> Callable[[Simulation], bool]:
    return lambda simulation: name in _law_effects(simulation)


def _of_materials(name: str) -> Callable[[Simulation], bool]:
    return lambda simulation: name in _material_effects(simulation)


def _columns(name: str) -> Callable[[Simulation], int]:
    return lambda simulation: _law_effects(simulation).get(name, 0)


def _kept(*modules: str) -> Callable[[Simulation], int]:
    """Bytes of what the solver keeps of classes of some modules."""

    def nbytes(simulation: Simulation) -> int:
        kept = [held for held in simulation.solver.kept() if type(held).__module__ in modules]
        return _bytes_within(kept)

    return nbytes


def _solves_subdomains(simulation: Simulation) -> bool:
    if simulation.interactions is None or simulation.solver.name not in ("auto", "subdomains"):
        return False
    return all(g.kernels.name == "perfect bond" for g in simulation.interactions.groups)


def _bytes_within(item: object) -> int:
    """Bytes of the arrays in an object, its attributes, lists and tuples."""
    if isinstance(item, np.ndarray):
        return item.nbytes
    if isinstance(item, Interactions):  # what a solver keeps names its scene
        return 0
    if isinstance(item, list | tuple):
        return sum(map(_bytes_within, item))
    return sum(map(_bytes_within, vars(item).values())) if hasattr(item, "__dict__") else 0


def _nothing(simulation: Simulation) -> int:
    return 0


@dataclass(frozen=True)
class Effect:
    """A row of the table.

    Attributes:
        name: the effect.
        switch: what in the scene or the simulation calls for it.
        code: the modules, and the "module:object" in modules that others share, that are its own;
            a user's laws and materials have theirs elsewhere.
        on: whether a simulation calls for it.
        holds: what it allocates; empty if nothing.
        nbytes: how many bytes that is.
        phases: phases of the run (`xper_fx/support/profile.py`) that are its alone.
    """

    name: str
    switch: str
    code: tuple[str, ...]
    on: Callable[[Simulation], bool]
    holds: str = ""
    nbytes: Callable[[Simulation], int] = _nothing
    phases: tuple[str, ...] = ()


EFFECTS = (
    Effect(
        "inertia",
        "Simulation(inertia=True), the default",
        ("xper_fx.bulk.inertia",),
        lambda s: s.bulk.inertia is not None,
    ),
    Effect(
        "viscous damping",
        "Scene(damping=...)",
        ("xper_fx.bulk.damping",),
        lambda s: s.bulk.damping is not None,
        "K0, if it damps and the bulk is not linear",
        lambda s: 0 if s.bulk.linear or s.bulk.stiffness is None else s.bulk.stiffness.data.nbytes,
    ),
    Effect(
        "external forces",
        "BodyForce, Gravity, SurfaceTraction among Scene(loads=...)",
        ("xper_fx.forms.dynamics:BulkForms.assemble_external",),
        lambda s: s.forms.external is not None,
        "a force a dof",
        lambda s: s.state.external.nbytes,
    ),
    Effect(
        "finite strain",
        "a material whose `effects` have it: NeoHookean, SaintVenantKirchhoff, J2FiniteStrain",
        (
            "xper_fx.materials.neo_hookean",
            "xper_fx.materials.saint_venant_kirchhoff",
            "xper_fx.materials.j2_finite_strain",
            "xper_fx.materials.kinematics:deformation_gradient",
        ),
        _of_materials("finite strain"),
    ),
    Effect(
        "Newton of the bulk",
        "a material that is not linear, or floating bodies",
        (
            "xper_fx.forms.dynamics:BulkForms.assemble_internal",
            "xper_fx.forms.dynamics:BulkForms.assemble_energy",
            "xper_fx.bulk.implicit:ImplicitScheme._correction",
        ),
        lambda s: not s.bulk.linear or s.bulk.floating,
    ),
    Effect(
        "internal variables",
        "a material with `variables`",
        ("xper_fx.forms.internal_variables",),
        lambda s: s.forms.has_history,
        "the variables at each quadrature point",
        lambda s: s.forms.history_nbytes,
        ("commit",),
    ),
    Effect(
        "plasticity",
        "a material whose response has `plastic`: J2SmallStrain, J2FiniteStrain",
        (
            "xper_fx.materials.j2_small_strain",
            "xper_fx.materials.j2_finite_strain",
            "xper_fx.materials.radial_return",
            "xper_fx.materials.hardening",
            "xper_fx.forms.dynamics:BulkForms.largest_increment",
        ),
        lambda s: s.forms.plastic,
        phases=("flow check",),
    ),
    Effect(
        "viscosity",
        "a material whose response has `viscous`: LinearViscoelastic",
        ("xper_fx.materials.viscoelastic",),
        lambda s: s.forms.viscous,
    ),
    Effect(
        "interactions",
        "laws of facing facets or walls",
        (
            "xper_fx.nscd.interactions:Interactions",
            "xper_fx.nscd.couplings:couple",
            "xper_fx.nscd.points:InteractionPoints",
            "xper_fx.bulk.state:interact",
        ),
        lambda s: s.interactions is not None,
        "geometry, impulses, jumps, w of each point, blocks of w",
        lambda s: s.interactions.nbytes - sum(_law_effects(s).values()),
        ("interaction points", "interaction terms", "interaction solve"),
    ),
    Effect(
        "rigid bodies",
        "Scene(rigid=...)",
        (
            "xper_fx.nscd.rigid.motion",
            "xper_fx.nscd.inverse_blocks:BodyInverse.joined",
            "xper_fx.nscd.couplings:lever_arm_kernels",
        ),
        lambda s: s.rigid is not None,
        "position, rotation, velocities, mass and w of each body",
        lambda s: s.rigid.nbytes,
        ("rigid bodies",),
    ),
    Effect(
        "contact search",
        "Scene(contacts=...)",
        (
            "xper_fx.simulation.contact_detection",
            "xper_fx.scene.initial_overlaps",
            "xper_fx.bodies.surfaces",
            "xper_fx.nscd.search.grid",
            "xper_fx.nscd.search.rigid_search",
            "xper_fx.nscd.search.surface_search",
            "xper_fx.nscd.contact_history:ContactHistory",
        ),
        lambda s: s.detection is not None,
        "lists of pairs that may soon touch",
        lambda s: s.detection.nbytes,
        ("contact search",),
    ),
    Effect(
        "walls",
        "Scene(walls=...)",
        (
            "xper_fx.simulation.permanent_points:ScenePoints._on_wall",
            "xper_fx.nscd.facets:wall_points",
        ),
        lambda s: len(s.scene.walls) > 0,
    ),
    Effect(
        "cohesion",
        "a law that has it: CohesiveZone",
        ("xper_fx.nscd.laws.cohesive_zone",),
        _of_laws("cohesion"),
        "stiffness, load and compliance of each bond",
        _columns("cohesion"),
    ),
    Effect(
        "damage",
        "a law that has it: CohesiveZone",
        ("xper_fx.nscd.laws.cohesive_zone", "xper_fx.nscd.law_loops:evolve_loop"),
        _of_laws("damage"),
        "damage and opening of each bond, constants of its curve",
        _columns("damage"),
    ),
    Effect(
        "unilateral contact",
        "a law that has it: CohesiveZone, SignoriniCoulomb, Tresca",
        ("xper_fx.nscd.laws.signorini",),
        _of_laws("unilateral contact"),
        "the gap or the least speed of each point",
        _columns("unilateral contact"),
    ),
    Effect(
        "impact",
        'contact="velocity" of SignoriniCoulomb and Tresca, the default',
        ("xper_fx.nscd.laws.impact",),
        _of_laws("impact"),
        "restitution and push of each point",
        _columns("impact"),
    ),
    Effect(
        "friction",
        "friction > 0 or bound > 0 of a law",
        ("xper_fx.nscd.laws.coulomb", "xper_fx.nscd.laws.coulomb_space"),
        _of_laws("friction"),
        "bound and slip of each point",
        _columns("friction"),
    ),
    Effect(
        "perfect bond",
        "the law PerfectBond",
        ("xper_fx.nscd.laws.perfect_bond",),
        _of_laws("perfect bond"),
        "the inverse of w of each point",
        _columns("perfect bond"),
    ),
    Effect(
        "periodicity",
        "explode(lattice=...)",
        ("xper_fx.bodies.lattice", "xper_fx.periodic.periodic_unknowns"),
        lambda s: s.scene.macroscopic is not None,
        "X of each node, ties",
        lambda s: s.bulk.unknowns.nbytes,
    ),
    Effect(
        "macroscopic control",
        "Scene(macroscopic=MacroscopicDrive(...))",
        ("xper_fx.periodic.drive", "xper_fx.periodic.two_field", "xper_fx.periodic.averages"),
        lambda s: s.scene.macroscopic is not None,
        "the volume times Pibar, among the forces",
        lambda s: s.state.external.nbytes,
        ("macroscopic averages",),
    ),
    Effect(
        "mean stress given",
        "MacroscopicDrive(stress=...)",
        ("xper_fx.periodic.bordered", "xper_fx.periodic.stress_balance"),
        lambda s: s.scene.macroscopic is not None and len(s.scene.macroscopic.stress) > 0,
    ),
    Effect(
        "three dimensions",
        "a mesh of tetrahedra or hexahedra",
        (
            "xper_fx.nscd.algebra.space",
            "xper_fx.nscd.rigid.space_turning",
            "xper_fx.nscd.laws.coulomb_space",
            "xper_fx.nscd.laws.signorini:frictionless_space",
            "xper_fx.nscd.laws.perfect_bond:_pseudo_inverse_space",
        ),
        lambda s: s.bulk.dim == 3,
    ),
    Effect(
        "explicit bulk",
        'Simulation(scheme="explicit")',
        ("xper_fx.bulk.explicit", "xper_fx.bulk.body_inverse:LumpedInverse"),
        lambda s: s.options.scheme == "explicit",
        "the inverse of the mass",
        lambda s: s.scheme.nbytes,
    ),
    Effect(
        "several ranks",
        "mpirun -n N, where the scene's bodies can be divided",
        (
            "xper_fx.parallel.division",
            "xper_fx.parallel.local_bodies",
            "xper_fx.parallel.ownership",
            "xper_fx.parallel.shared_points",
            "xper_fx.parallel.halo",
            "xper_fx.parallel.row_numbering",
            "xper_fx.parallel.petsc_newton",
            "xper_fx.parallel.rigid_partition",
            "xper_fx.parallel.rigid_halo",
            "xper_fx.nscd.solvers.distributed",
            "xper_fx.nscd.solvers.shared_tangent",
        ),
        lambda s: not s.ranks.alone,
        "ghosts of other ranks' bodies",
        lambda s: 0 if s.ranks.alone else s.interactions.halo.nbytes,
    ),  # fmt: skip
    Effect(
        "vertex problems",
        "the explicit bulk with nodal points",
        ("xper_fx.nscd.solvers.vertex_blocks",),
        lambda s: s.interactions is not None and s.interactions.ordering == "vertices",
        "slopes of the points, an inverse a vertex",
        _kept("xper_fx.nscd.solvers.vertex_blocks"),
    ),
    Effect(
        "Newton on all points",
        'Simulation(solver="newton"), or "auto", which calls for it where sweeps are too many',
        (
            "xper_fx.nscd.solvers.newton",
            "xper_fx.nscd.solvers.tangent",
            "xper_fx.nscd.solvers.clusters",
        ),
        lambda s: s.interactions is not None and s.solver.name in ("auto", "newton"),
        "tangents of the points, blocks of bodies and clusters, Krylov's basis",
        _kept("xper_fx.nscd.solvers.tangent", "xper_fx.nscd.solvers.shared_tangent"),
    ),
    Effect(
        "mixed sweeps",
        'Simulation(solver="accelerated"), or "auto", which calls for them after Newton',
        ("xper_fx.nscd.solvers.accelerated",),
        lambda s: s.interactions is not None and s.solver.name in ("auto", "accelerated"),
    ),
    Effect(
        "subdomains",
        'Simulation(solver="subdomains"), or "auto", which calls for it where all is bonded',
        ("xper_fx.nscd.solvers.feti",),
        _solves_subdomains,
        "blocks of w and their inverses, the sharing of jumps, the coarse space",
        _kept("xper_fx.nscd.solvers.feti"),
    ),
    Effect(
        "floating bodies",
        "Simulation(inertia=False) with bodies that interactions alone hold",
        ("xper_fx.bulk.floating_bodies", "xper_fx.nscd.anchors"),
        lambda s: s.bulk.floating,
        "w with the anchors held, rigid motions",
        lambda s: s.scheme.nbytes,
    ),
    Effect(
        "ties",
        "Scene(ties=...)",
        ("xper_fx.scene.tie", "xper_fx.nscd.mortar"),
        lambda s: len(s.scene.ties) > 0,
    ),
    Effect(
        "error control",
        'Simulation(accuracy=...), or "auto" as a step or a tolerance',
        ("xper_fx.simulation.accuracy_control",),
        lambda s: s.estimated_error is not None,
    ),
    Effect(
        "output",
        "a Recorder",
        (
            "xper_fx.output.series",
            "xper_fx.output.recorder",
            "h5py",
            "xper_fx.forms.dynamics:BulkForms.stress_evaluator",
        ),
        lambda s: s.folder is not None,
        phases=("output",),
    ),
)
"""The effects that the package has."""


class EffectRow(NamedTuple):
    """What an effect is to a simulation.

    Attributes:
        name: the effect.
        on: whether the scene calls for it.
        memory: bytes held for it.
        seconds: time spent in phases that are its alone.
        calls: how often these were entered.
    """

    name: str
    on: bool
    memory: int
    seconds: float
    calls: int


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


def effects_table(simulation: Simulation) -> str:
    """The table as text, what is on first; then the laws in use, and what is off."""
    lines = [f"{'effect':<26}{'memory':>12}{'time':>12}{'calls':>10}"]
    rows = effects_of(simulation)
    for row in rows:
        if row.on:
            memory = f"{row.memory / 1e6:.2f} MB" if row.memory else "-"
            time = f"{row.seconds:.2f} s" if row.calls else "-"
            lines.append(f"{row.name:<26}{memory:>12}{time:>12}{row.calls or '-':>10}")
    groups = simulation.interactions.groups if simulation.interactions is not None else []
    lines += [f"law: {group.kernels.name}, {len(group)} points" for group in groups]
    lines.append("off: " + ", ".join(row.name for row in rows if not row.on))
    return "\n".join(lines)
