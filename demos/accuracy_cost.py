# SPDX-License-Identifier: LGPL-3.0-or-later
# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # What accuracy costs
#
# This demo illustrates how to:
#
# - set up a study: a scene, the settings to vary, the quantities to compare, and a reference
# - run the study, each run in a process of its own, stop the study, and continue later
# - read error against time and memory, the setting to take for an error, and the settings that
#   gain nothing
# - find the price of each effect, and the change of the answer without the effect
#
# `--list` names the studies. Each study writes into its folder one file a run, `runs.csv`,
# `results.json`, `table.md` and figures. A study that was stopped continues where it stopped; empty
# its folder to start afresh.
#
# **Times** are those of the steps alone, on one thread, after everything has been compiled. On a
# machine that does other work too, compare processor times (`--time cpu_seconds`).

import argparse
import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import notched_plate as plate
import numpy as np
import periodic_ductile as ductile
from dolfinx.mesh import CellType, create_rectangle, create_submesh, locate_entities
from mpi4py import MPI
from tqdm.auto import tqdm

import xper_fx as xf

ONE_THREAD: xf.study.Setting = {"num_threads": 1}
SOLVERS = ("nlgs", "accelerated", "newton")


def accuracies(setting: xf.study.Setting, of: str = "") -> dict[str, list[xf.study.Setting]]:
    """A family of runs that pick step and tolerance for the accuracy asked for."""
    return {f"accuracy asked for{of}": xf.study.vary(setting, "accuracy", [1e-2, 1e-3])}


# ## The notched plate
#
# Strong interfaces, fracture energies that a mesh of 20 x 20 resolves, until the plate has broken
# (peak at 0.73 %, broken at 0.85 %). Mesh and physics are the same in all runs: what differs is how
# the equations are solved. The reference is explicit, at a tenth of the critical step and a
# tolerance of 1e-8;
# a fine implicit run tells how far it is to be trusted.


def resolved_plate(cells: int) -> xf.Scene:
    """The notched plate with strong interfaces and fracture energies that its mesh resolves."""
    return plate.notched_plate(cells, "strong", toughening=plate.toughening())


def notched_plate(quick: bool) -> list[xf.Study]:
    """Bulk schemes, solvers, steps and tolerances on a plate that breaks."""
    default: xf.study.Setting = {"cells": 20, "accuracy": 1e-2, **ONE_THREAD}
    implicit: xf.study.Setting = {
        "cells": 20,
        "scheme": "implicit",
        "solver": "auto",
        "courant": 0.7,
        "tolerance": 1e-3,
        **ONE_THREAD,
    }
    explicit = implicit | {"scheme": "explicit"}
    families = {
        "explicit bulk: step": xf.study.vary(explicit, "courant", [1.0, 0.7, 0.35, 0.175]),
        "implicit bulk: step": xf.study.vary(implicit, "courant", [11.2, 5.6, 2.8, 1.4, 0.7, 0.35]),
        "implicit bulk: tolerance": xf.study.vary(implicit, "tolerance", [1e-2, 1e-3, 1e-4, 1e-5]),
        "explicit bulk: tolerance": xf.study.vary(explicit, "tolerance", [1e-2, 1e-3, 1e-4, 1e-5]),
    }
    for solver in SOLVERS:
        steps = xf.study.vary(implicit | {"solver": solver}, "courant", [11.2, 2.8])
        families[f"implicit bulk, {solver}: step"] = steps
    families |= accuracies(default) | accuracies(default | {"scheme": "implicit"}, ", implicit")
    if quick:
        families = {"explicit bulk: step": families["explicit bulk: step"][:2]}
    gauge = xf.TensileGauge(plate.LEFT, plate.RIGHT, 0, plate.SIZE, plate.SIZE)
    end_strain = 1e-5 if quick else 0.009
    return [
        xf.Study(
            "notched_plate",
            resolved_plate,
            end_strain * plate.SIZE / (2.0 * plate.SPEED),
            {
                "peak stress": xf.quantities.PeakStress(gauge),
                "displacement": xf.quantities.DisplacementL2(),
            }
            if quick
            else {
                "peak stress": xf.quantities.PeakStress(gauge),
                "dissipated energy": xf.quantities.DissipatedEnergy(),
                "crack pattern": xf.quantities.CrackPattern(plate.UNIT, (plate.NOTCH,)),
                "displacement": xf.quantities.DisplacementL2(),
                "penetration": xf.quantities.Penetration(plate.UNIT),
                "energy closure": xf.quantities.EnergyClosure(),
            },
            families,
            reference=explicit | {"courant": 0.1, "tolerance": 1e-8},
            check=None if quick else implicit | {"courant": 0.35, "tolerance": 1e-6},
            default=explicit if quick else default,
        )
    ]


# ## The periodic ductile cell
#
# The second example of Perales et al. 2010 up to its first cracks (0.9 %): after them, what the
# printed parameters give depends on the mesh, and errors of a scheme mean little.


def ductile_cell(cells: int, finite_strain: bool) -> xf.Scene:
    """The periodic composite with Pibar_22 = 0."""
    return ductile.periodic_composite(cells, finite_strain=finite_strain)


def periodic_ductile(quick: bool) -> list[xf.Study]:
    """Step, theta, tolerances and strain measure of a plastic cell."""
    default: xf.study.Setting = {
        "cells": 20,
        "finite_strain": False,
        "step": 5e-10,
        "theta": 0.5,
        "tolerance": 1e-4,
        "newton_tolerance": 1e-8,
        **ONE_THREAD,
    }
    families = {
        "step": xf.study.vary(default, "step", [2e-9, 1e-9, 5e-10, 2.5e-10]),
        "step, theta = 1": xf.study.vary(default | {"theta": 1.0}, "step", [2e-9, 1e-9, 5e-10]),
        "tolerance": xf.study.vary(default, "tolerance", [1e-2, 1e-3, 1e-4, 1e-5]),
        "Newton's tolerance": xf.study.vary(default, "newton_tolerance", [1e-3, 1e-5, 1e-8]),
        "finite strain": [default | {"finite_strain": True}],
    }
    if quick:
        families = {"step": families["step"][:2]}
    else:
        families |= accuracies({"cells": 20, "finite_strain": False, **ONE_THREAD})
    compared: dict[str, xf.quantities.Quantity] = {
        "peak stress": xf.quantities.PeakStress(xf.CellGauge("11")),
        "displacement": xf.quantities.DisplacementL2(),
    }
    if not quick:
        compared["plastic dissipation"] = xf.quantities.DissipatedEnergy()
    return [
        xf.Study(
            "periodic_ductile",
            ductile_cell,
            (4e-4 if quick else 0.0085) / 4e4,
            compared,
            families,
            reference=default | {"step": 1e-9 if quick else 1.25e-10, "tolerance": 1e-5},
            default=default,
        )
    ]


# ## Impact and vibration of a bar, both with exact solutions
#
# A bar of length L, Young's modulus E, density rho, wave speed c, is thrown at a rigid wall with v:
#
# $$u(x, t) = -v \min(t, x / c) + v \max(0, t - (2 L - x) / c)$$
#
# and the wall gives the impulse rho c v t until t = 2 L / c. The same bar, held at one end, swings
# in its first mode without impact. Mesh and step are refined together.

LENGTH, YOUNG, DENSITY, SPEED = 10.0, 100.0, 1.0, 0.01
WAVE_SPEED = 10.0
WALL_SIDE, FAR_SIDE = 1, 2


def bar(cells: int, contact: str) -> xf.Scene:
    """A bar thrown at a wall, or held by it (contact "none") in its first mode."""
    mesh = create_rectangle(
        MPI.COMM_SELF, [(0.0, 0.0), (LENGTH, 1.0)], (cells, 1), CellType.quadrilateral
    )
    tags = xf.tag_facets(mesh, {WALL_SIDE: lambda x: x[0] < 1e-9 * LENGTH})
    bodies = xf.explode(mesh, np.zeros(cells, int), facet_tags=tags)
    materials = {1: xf.materials.LinearElastic(YOUNG, 0.0, DENSITY)}
    if contact == "none":
        return xf.Scene(
            bodies,
            materials,
            loads=[xf.PrescribedVelocity(WALL_SIDE, 0, 0.0)],
            initial_velocity=lambda x: np.stack(
                [SPEED * np.sin(0.5 * np.pi * x[0] / LENGTH), 0.0 * x[0]]
            ),
        )
    return xf.Scene(
        bodies,
        materials,
        walls=[
            xf.Wall(WALL_SIDE, (0.0, 0.0), (1.0, 0.0), xf.laws.SignoriniCoulomb(contact=contact))
        ],
        initial_velocity=lambda x: np.stack([0.0 * x[0] - SPEED, 0.0 * x[0]]),
    )


# A quantity of one's own: what the wall gave.


@dataclass(frozen=True)
class WallImpulse:
    """Total normal impulse of all interactions (N s; 2D: N s/m)."""

    has_reference: ClassVar[bool] = True

    def observe(self, simulation: xf.Simulation, step: xf.StepRecord, seen: float | None) -> float:
        """Total so far."""
        return (seen or 0.0) + float(simulation.interactions.gather("impulse")[:, 0].sum())

    def value(self, simulation: xf.Simulation, seen: float) -> float:
        """Total."""
        return seen

    def error(self, value: float, reference: float) -> float:
        """Relative."""
        return xf.quantities.relative(value - reference, reference)


def after_impact(x: np.ndarray, time: float) -> np.ndarray:
    """Exact displacement of the thrown bar, shape (n,), m."""
    reflected = np.maximum(0.0, time - (2.0 * LENGTH - x) / WAVE_SPEED)
    return SPEED * (reflected - np.minimum(time, x / WAVE_SPEED))


def in_first_mode(x: np.ndarray, time: float) -> np.ndarray:
    """Exact displacement of the held bar, shape (n,), m."""
    wave_number = 0.5 * np.pi / LENGTH
    frequency = wave_number * WAVE_SPEED
    return SPEED / frequency * np.sin(frequency * time) * np.sin(wave_number * x)


def known_displacement(exact: Callable, time: float) -> dict[str, np.ndarray]:
    """The value that `DisplacementL2` would have for an exact solution."""
    points = xf.quantities.DisplacementL2().points((0.0, 0.0), (LENGTH, 1.0))
    along = exact(points[:, 0], time)
    return {"points": points, "displacement": np.stack([along, 0.0 * along], axis=1)}


def impact(quick: bool) -> list[xf.Study]:
    """Rates in h with an impact and without, against exact solutions."""
    counts = [10, 20, 40] if quick else [25, 50, 100, 200, 400]
    end = 1.5 * LENGTH / WAVE_SPEED
    default: xf.study.Setting = {
        "cells": counts[1],
        "contact": "velocity",
        "courant": 0.5,
        **ONE_THREAD,
    }
    implicit = default | {"scheme": "implicit", "tolerance": 1e-8}
    explicit = default | {"scheme": "explicit", "tolerance": 1e-8}
    impacts = xf.Study(
        "impact",
        bar,
        end,
        {"displacement": xf.quantities.DisplacementL2(), "wall's impulse": WallImpulse()},
        {
            "explicit": xf.study.vary(explicit, "cells", counts),
            "implicit": xf.study.vary(implicit, "cells", counts),
            "implicit, theta = 1": xf.study.vary(implicit | {"theta": 1.0}, "cells", counts),
            "implicit, position level": xf.study.vary(
                implicit | {"contact": "position"}, "cells", counts
            ),
        },
        known={
            "displacement": known_displacement(after_impact, end),
            "wall's impulse": DENSITY * WAVE_SPEED * SPEED * end,
        },
        default=explicit,
    )
    swinging = {"contact": "none"}
    vibration = xf.Study(
        "vibration",
        bar,
        end,
        {"displacement": xf.quantities.DisplacementL2()},
        {
            "explicit": xf.study.vary(explicit | swinging, "cells", counts),
            "implicit": xf.study.vary(implicit | swinging, "cells", counts),
            "implicit, theta = 1": xf.study.vary(
                implicit | swinging | {"theta": 1.0}, "cells", counts
            ),
        },
        known={"displacement": known_displacement(in_first_mode, end)},
        default=explicit | swinging,
    )
    return [vibration] if quick else [impacts, vibration]


# ## A smooth frictional problem
#
# A block that is pressed on a wall and then sheared, without inertia: sliding begins at the edges
# and spreads. Its load is smooth in time, and nothing breaks.

PRESS, SHEAR, FRICTION_COEFFICIENT = 1e-3, 2e-3, 0.5
BOTTOM, TOP = 1, 2


def sheared_block(cells: int, order: int) -> xf.Scene:
    """A square block of side 1 m on a wall, held at its top; time 0 to 1 presses, 1 to 2 shears."""
    mesh = xf.crossed_rectangle((0.0, 0.0), (1.0, 1.0), (cells, cells))
    sides = {BOTTOM: lambda x: x[1] < 1e-9, TOP: lambda x: x[1] > 1.0 - 1e-9}
    one_body = np.zeros(4 * cells * cells, int)
    return xf.Scene(
        xf.explode(mesh, one_body, facet_tags=xf.tag_facets(mesh, sides)),
        {1: xf.materials.LinearElastic(1e9, 0.3, 1000.0)},
        walls=[xf.Wall(BOTTOM, (0, 0), (0, 1), xf.laws.SignoriniCoulomb(FRICTION_COEFFICIENT))],
        loads=[
            xf.PrescribedDisplacement(TOP, 0, lambda t: SHEAR * max(t - 1.0, 0.0) ** 2),
            xf.PrescribedDisplacement(TOP, 1, lambda t: -PRESS * min(t, 1.0)),
        ],
        order=order,
    )


@dataclass(frozen=True)
class ShearForce:
    """Mean tangential force on the block's top over the last step (N/m)."""

    has_reference: ClassVar[bool] = True

    def observe(self, simulation: xf.Simulation, step: xf.StepRecord, seen: None) -> None:
        """Nothing before the end."""

    def value(self, simulation: xf.Simulation, seen: None) -> float:
        """At the end."""
        return float(simulation.reaction(TOP)[0])

    def error(self, value: float, reference: float) -> float:
        """Relative."""
        return xf.quantities.relative(value - reference, reference)


def friction(quick: bool) -> list[xf.Study]:
    """Mesh, order, steps, tolerance and solver of a block in partial slip."""
    default: xf.study.Setting = {
        "cells": 4 if quick else 16,
        "order": 1,
        "step": 0.05,
        "tolerance": 1e-4,
        "solver": "auto",
        "theta": 1.0,
        "inertia": False,
        **ONE_THREAD,
    }
    counts = [2, 4] if quick else [4, 8, 16, 32]
    families = {"mesh": xf.study.vary(default, "cells", counts)}
    if not quick:
        families |= {
            "mesh, order 2": xf.study.vary(default | {"order": 2}, "cells", counts[:3]),
            "step": xf.study.vary(default, "step", [0.2, 0.1, 0.05, 0.025]),
            "tolerance": xf.study.vary(default, "tolerance", [1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8]),
            "solver": xf.study.vary(default, "solver", SOLVERS),
        }
    finest = {"cells": 8, "tolerance": 1e-6} if quick else {"cells": 64, "tolerance": 1e-8}
    return [
        xf.Study(
            "friction",
            sheared_block,
            2.0,
            {
                "shear force": ShearForce(),
                "friction's dissipation": xf.quantities.DissipatedEnergy(
                    terms=("dissipated_friction",)
                ),
                "displacement": xf.quantities.DisplacementL2(),
            },
            families,
            reference=default | finest | {"step": 0.05 if quick else 0.0125},
            default=default,
        )
    ]


# ## The stiff quasi-static limit
#
# The plate without inclusions, each triangle a body, pulled slowly: 2000 of the bulk's critical
# steps in all, so that steps of ten to a thousand of them are what its loading calls for. theta = 1
# damps what such steps cannot follow.

SLOW_STRAIN = 0.004


def slow_plate(cells: int, duration: float) -> xf.Scene:
    """The homogeneous plate, bonds resolved, pulled to SLOW_STRAIN in a duration (s)."""
    speed = 0.5 * SLOW_STRAIN * plate.SIZE / duration
    return xf.Scene(
        plate.composite(cells, []),
        plate.materials(finite_strain=False, homogeneous=True),
        interactions=plate.bonds("strong", plate.toughening(), homogeneous=True),
        facet_interactions={
            plate.NOTCH: xf.laws.SignoriniCoulomb(xf.library.FRICTION, contact="position")
        },
        loads=[
            xf.PrescribedVelocity(plate.LEFT, 0, -speed),
            xf.PrescribedVelocity(plate.RIGHT, 0, speed),
        ],
        initial_velocity=lambda x: np.array([speed * (2.0 * x[0] / plate.SIZE - 1.0), 0.0 * x[0]]),
    )


def quasi_static(quick: bool) -> list[xf.Study]:
    """Sweeps against Newton where steps are ten to a thousand times the explicit limit."""
    duration = 4.5e-7 if not quick else 4.5e-9
    default: xf.study.Setting = {
        "cells": 20,
        "duration": duration,
        "solver": "auto",
        "courant": 100.0,
        "theta": 1.0,
        "tolerance": 1e-4,
        **ONE_THREAD,
    }
    steps = [10.0] if quick else [1000.0, 300.0, 100.0, 30.0, 10.0]
    families = {
        solver: xf.study.vary(default | {"solver": solver}, "courant", steps)
        for solver in (("auto",) if quick else ("auto", *SOLVERS))
    }
    if not quick:
        families["newton, tolerance"] = xf.study.vary(
            default | {"solver": "newton"}, "tolerance", [1e-2, 1e-3, 1e-4, 1e-6]
        )
    gauge = xf.TensileGauge(plate.LEFT, plate.RIGHT, 0, plate.SIZE, plate.SIZE)
    compared: dict[str, xf.quantities.Quantity] = {
        "peak stress": xf.quantities.PeakStress(gauge),
        "displacement": xf.quantities.DisplacementL2(),
    }
    if not quick:
        compared["dissipated energy"] = xf.quantities.DissipatedEnergy()
    return [
        xf.Study(
            "quasi_static",
            slow_plate,
            duration,
            compared,
            families,
            reference=default | {"solver": "newton", "courant": 3.0, "tolerance": 1e-6},
            default=default,
        )
    ]


# ## The price of each effect
#
# One plate with a slot instead of a precrack, so that it can be one connected body as well. From an
# elastic static body, effects are switched on one by one; then each is left out of the whole.

SLOT, DAMPING = 2.5e-6, 2e-10
# weak enough to break before all of the matrix flows; its cohesive length is 2.3 facets
SLOT_BOND = xf.laws.CohesiveZone(2e18, fracture_energy=20.0, strength=6e8, friction=0.3)
EFFECTS: dict[str, xf.study.Setting] = {
    "inertia": {"inertia": True, "theta": 0.5},
    "cracks": {"cracks": True},
    "friction of lips": {"friction": True},
    "plasticity": {"plastic": True},
    "finite strain": {"finite_strain": True},
    "damping": {"damping": True},
    "fields written": {"fields": 20},
}
PLAINEST: xf.study.Setting = {
    "cells": 20,
    "inertia": False,
    "theta": 1.0,
    "plastic": False,
    "finite_strain": False,
    "cracks": False,
    "friction": False,
    "damping": False,
    "fields": 0,
    "step": 4e-10,
    **ONE_THREAD,
}


def slotted_plate(
    cells: int, plastic: bool, finite_strain: bool, cracks: bool, friction: bool, damping: bool
) -> xf.Scene:
    """The homogeneous plate with a slot: one body, or each triangle its own."""
    mesh = xf.crossed_rectangle((0.0, 0.0), (plate.SIZE, plate.SIZE), (cells, cells))
    small = 1e-6 * plate.SIZE
    mesh = create_submesh(mesh, 2, locate_entities(mesh, 2, lambda x: ~in_slot(x, small)))[0]
    sides = xf.tag_facets(
        mesh,
        {plate.LEFT: lambda x: x[0] < small, plate.RIGHT: lambda x: x[0] > plate.SIZE - small},
    )
    count = mesh.topology.index_map(2).size_local
    (elastic,) = plate.materials(finite_strain, homogeneous=True).values()
    ductile_matrix = (
        xf.library.ZIRCALOY_4_DUCTILE_FINITE if finite_strain else xf.library.ZIRCALOY_4_DUCTILE
    )
    bond = replace(SLOT_BOND, friction=SLOT_BOND.friction if friction else 0.0)
    return xf.Scene(
        xf.explode(mesh, "each cell" if cracks else np.zeros(count, int), facet_tags=sides),
        {1: ductile_matrix if plastic else elastic},
        default_interaction=bond,
        loads=[
            xf.PrescribedVelocity(plate.LEFT, 0, -plate.SPEED),
            xf.PrescribedVelocity(plate.LEFT, 1, 0.0),  # holds a static body
            xf.PrescribedVelocity(plate.RIGHT, 0, plate.SPEED),
        ],
        damping=xf.RayleighDamping(stiffness=DAMPING) if damping else None,
        initial_velocity=lambda x: np.array(
            [plate.SPEED * (2.0 * x[0] / plate.SIZE - 1.0), 0.0 * x[0]]
        ),
    )


def in_slot(x: np.ndarray, small: float) -> np.ndarray:
    """Whether points lie strictly inside the slot, or on its sides (`small` negative)."""
    middle, height = plate.SIZE / 2.0, plate.PRECRACK * plate.UNIT
    return (np.abs(x[0] - middle) < SLOT - small) & (x[1] < height - small)


def chosen_effects(quick: bool) -> dict[str, xf.study.Setting]:
    """Those of `EFFECTS` that a study switches on."""
    return {name: EFFECTS[name] for name in (("inertia", "fields written") if quick else EFFECTS)}


def effects(quick: bool) -> list[xf.Study]:
    """The price of each effect."""
    gauge = xf.TensileGauge(plate.LEFT, plate.RIGHT, 0, plate.SIZE, plate.SIZE)
    return [
        xf.effect_prices.effects_study(
            "effects",
            slotted_plate,
            (8e-5 if quick else 0.006) * plate.SIZE / (2.0 * plate.SPEED),
            {
                "peak stress": xf.quantities.PeakStress(gauge),
                "dissipated energy": xf.quantities.DissipatedEnergy(),
            }
            if not quick
            else {"peak stress": xf.quantities.PeakStress(gauge)},
            PLAINEST,
            chosen_effects(quick),
        )
    ]


# ## Command line

STUDIES: dict[str, Callable[[bool], list[xf.Study]]] = {
    "notched_plate": notched_plate,
    "periodic_ductile": periodic_ductile,
    "impact": impact,
    "friction": friction,
    "quasi_static": quasi_static,
    "effects": effects,
}
FIRST_FIGURE = ("peak stress", "displacement")


def report(results: xf.study.StudyResults, out: Path, figures: bool, quick: bool) -> None:
    """Say and write what a study found."""
    study = results.study
    lines = [results.table(), ""]
    lines += [results.advice(quantity) for quantity in study.quantities]
    for family in study.families:
        parameters = xf.study.varied([run.setting for run in results.members(family)])
        if len(parameters) != 1:
            continue
        parameter = parameters[0]
        kinds = {type(run.setting.get(parameter)) for run in results.members(family)}
        if not kinds <= {int, float}:
            continue
        rates = {q: results.rate(q, family, parameter) for q in study.quantities}
        text = ", ".join(f"{q} {rate:.2f}" for q, rate in rates.items() if np.isfinite(rate))
        if text:
            lines.append(f"{family}: errors go with the power of {parameter}: {text}.")
    if study.name == "effects":
        found = xf.effect_prices.prices(results, list(chosen_effects(quick)))
        lines += ["", xf.effect_prices.price_table(found)]
        if figures:
            xf.study.plot_price(found, out / "effects.png", "The price of each effect")
    text = "\n".join(lines) + "\n"
    tqdm.write(f"\n{study.name}\n{text}")
    (out / "table.md").write_text(text)
    results.to_csv(out / "runs.csv")
    results.to_json(out / "results.json")
    if figures:
        xf.study.plot_error_against_cost(results, out / "accuracy_cost.png")
        first = [q for q in FIRST_FIGURE if q in study.quantities]
        if study.name == "notched_plate":
            xf.study.plot_error_against_cost(
                results, out / "first.png", first, [results.time], across=True
            )


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Options of the demo."""
    parser = argparse.ArgumentParser(description="What accuracy costs.")
    add = parser.add_argument
    add("--study", choices=tuple(STUDIES), default="notched_plate")
    add("--list", action="store_true", help="say what studies there are, and stop")
    add("--quick", action="store_true", help="a small version, to see that it runs")
    add("--time", choices=("seconds", "cpu_seconds"), default="seconds", help="what is compared")
    add("--patience", type=float, default=600.0, help="seconds after which a run is given up")
    add("--out", type=Path, default=Path("results/accuracy_cost"))
    add("--no-plot", action="store_true")
    add("--quiet", action="store_true", help="no progress bar")
    options = parser.parse_args(arguments)
    if not options.patience > 0.0:
        parser.error(f"--patience should be above zero, got {options.patience}")
    return options


def main(arguments: list[str] | None = None) -> list[xf.study.StudyResults]:
    """Run a study, or say which there are."""
    options = parse(arguments)
    logging.basicConfig(level=logging.WARNING)
    if options.list:
        for name, make in STUDIES.items():
            runs = sum(len(study.settings()) for study in make(options.quick))
            tqdm.write(f"{name:<18}{make.__doc__} {runs} runs.")
        return []
    found = []
    for study in STUDIES[options.study](options.quick):
        out = xf.prepare_folder(options.out / study.name)
        results = xf.study.run_study(
            study, out, time=options.time, patience=options.patience, quiet=options.quiet
        )
        report(results, out, not options.no_plot, options.quick)
        found.append(results)
    return found


if __name__ == "__main__":
    xf.run_together(main)
