# SPDX-License-Identifier: LGPL-3.0-or-later
"""Accuracy asked for against accuracy had, on three scenes, and what settings by hand would cost.

    OPENBLAS_NUM_THREADS=1 ./fenicsx python3 benchmarks/accuracy_asked.py [--scenes NAME]

For each scene and each accuracy: the true error of each quantity against a fine run, the error that
the simulation estimated, its time and steps over those of the cheapest setting by hand whose errors
all stay within what was asked for, and within three times that (of the same scheme, where a run is
told its scheme).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "demos"))

import accuracy_cost as demo
import notched_plate as plate
import periodic_ductile as ductile

from xper_fx.bodies.explode import explode
from xper_fx.bodies.meshes import crossed_rectangle, in_rectangles, tag_cells
from xper_fx.materials import LinearElastic
from xper_fx.materials.library import DENSITY, HYDRIDE
from xper_fx.output.gauges import CellGauge, TensileGauge
from xper_fx.scene.scene import Scene
from xper_fx.study.definition import Study, product, vary
from xper_fx.study.quantities import DisplacementL2, DissipatedEnergy, PeakStress
from xper_fx.study.study import run_study

ASKED = (1e-2, 1e-3)
# Within these many times what was asked for, a setting by hand counts as good enough.
WITHIN = (1.0, 3.0)
BY_HAND, BY_HAND_2 = "by hand", "by hand, other scheme"


def ductile_cell() -> Scene:
    """The periodic composite as one connected body, elastic inclusions in a ductile matrix."""
    mesh = crossed_rectangle((0.0, 0.0), (ductile.SIZE, ductile.SIZE), (20, 20))
    inside = {ductile.INCLUSION: in_rectangles(ductile.UNIT * np.array(ductile.LAYOUTS["bands"]))}
    cells = tag_cells(mesh, inside, ductile.MATRIX)
    bodies = explode(
        mesh, np.zeros(1600, int), cell_tags=cells, lattice=(ductile.SIZE, ductile.SIZE)
    )
    hard = LinearElastic(HYDRIDE.young, HYDRIDE.poisson, DENSITY)
    materials = {ductile.MATRIX: ductile.matrix(False), ductile.INCLUSION: hard}
    return Scene(bodies, materials, macroscopic=ductile.drive(1.0, "free"))


def studies() -> list[Study]:
    """The resolved plate until its peak, a bar that swings, a cell that flows."""
    gauge = TensileGauge(plate.LEFT, plate.RIGHT, 0, plate.SIZE, plate.SIZE)
    explicit = {"cells": 20, "scheme": "explicit", "courant": 0.95} | demo.ONE_THREAD
    implicit = {"cells": 20, "scheme": "implicit", "courant": 0.7} | demo.ONE_THREAD
    tolerances = [1e-2, 1e-3, 1e-4]
    end = 0.0075 * plate.SIZE / (2.0 * plate.SPEED)
    pulled = Study(
        "plate",
        demo.resolved_plate,
        end,
        {"peak stress": PeakStress(gauge), "dissipated to 0.6 %": DissipatedEnergy(0.8 * end)},
        {
            "asked": vary({"cells": 20} | demo.ONE_THREAD, "accuracy", ASKED),
            "asked, implicit": vary(
                {"cells": 20, "scheme": "implicit"} | demo.ONE_THREAD, "accuracy", ASKED
            ),
            BY_HAND: vary(explicit, "tolerance", tolerances),
            BY_HAND_2: product(implicit, courant=[0.7, 2.8], tolerance=tolerances),
        },
        reference=explicit | {"courant": 0.2, "tolerance": 1e-7},
    )
    bar = {"cells": 50, "contact": "none"} | demo.ONE_THREAD
    courants = [16.0, 8.0, 4.0, 2.0, 1.0, 0.5]
    swinging = Study(
        "bar",
        demo.bar,
        7.5 * demo.LENGTH / demo.WAVE_SPEED,
        {"displacement": DisplacementL2()},
        {
            "asked": vary(bar, "accuracy", ASKED),
            BY_HAND: vary(bar, "courant", courants),
            BY_HAND_2: vary(bar | {"scheme": "explicit"}, "courant", [1.0, 0.5]),
        },
        reference=bar | {"courant": 0.02},
    )
    static = {"theta": 1.0, "inertia": False} | demo.ONE_THREAD
    end = 0.02
    flowing = Study(
        "ductile cell",
        ductile_cell,
        end,
        {"peak stress": PeakStress(CellGauge("11")), "dissipated": DissipatedEnergy()},
        {
            "asked": vary(static, "accuracy", ASKED),
            BY_HAND: vary(static, "step", [end / n for n in (5, 10, 20, 50, 70, 100, 140, 200)]),
        },
        reference=static | {"step": end / 1000},
    )
    return [pulled, swinging, flowing]


def rows(results) -> list[str]:
    """A line for each accuracy asked for."""
    families = results.study.families
    by_hand = [run for f in (BY_HAND, BY_HAND_2) if f in families for run in results.members(f)]
    lines = []
    for family in (name for name in families if name.startswith("asked")):
        for run in results.members(family):
            asked = run.setting["accuracy"]
            scheme = run.setting.get("scheme")
            had = ", ".join(f"{name} {error:.1e}" for name, error in run.errors.items())
            line = f"| {results.study.name}{family.removeprefix('asked')} | {asked:g} | {had} | "
            line += f"{run.record['estimated_error']:.1e} |"
            for within in WITHIN:
                good = [
                    r
                    for r in by_hand
                    if r.done
                    and max(r.errors.values()) <= within * asked
                    and scheme in (None, r.setting.get("scheme"))
                ]
                if not good:
                    raise SystemExit(f"no setting by hand errs by less than {within * asked:g}")
                best = min(good, key=lambda r: r.cost(results.time))
                time = run.cost(results.time) / best.cost(results.time)
                line += f" {time:.2f} | {run.record['steps'] / best.record['steps']:.2f} |"
            lines.append(line)
    return lines


def main() -> None:
    """Run the studies and print the table."""
    parser = argparse.ArgumentParser(description="Accuracy asked for and had.")
    parser.add_argument("--out", type=Path, default=Path("results/accuracy_asked"))
    names = [study.name for study in studies()]
    parser.add_argument("--scenes", nargs="+", choices=names, default=names)
    options = parser.parse_args()
    lines = [
        "| scene | asked | true error | estimated | time over the best by hand as asked | steps | "
        "within three times | steps |",
        "|---" * 8 + "|",
    ]
    for study in studies():
        if study.name in options.scenes:
            folder = options.out / study.name.replace(" ", "_")
            lines += rows(run_study(study, folder, time="cpu_seconds"))
    print("\n".join(lines))


if __name__ == "__main__":
    main()
