# SPDX-License-Identifier: LGPL-3.0-or-later
"""How the notched plate depends on its mesh and its step, as printed and resolved.

Runs `demos/notched_plate.py` with weak and strong interfaces at several mesh sizes, with 0.7 and
0.35 of the bulk's critical step, and tabulates peak stress, dissipated energy and crack lengths.
As printed the cohesive length is a few hundredths of a facet: nothing after the first crack can
converge. Resolved it spans at least four facets of the coarsest mesh: there peak, dissipated
energy and crack path converge; differences between successive meshes are printed below each.

Run: ./fenicsx python3 benchmarks/plate_study.py [--cells 20 40 80] [--variant both]
"""

import argparse
import csv
import sys
from pathlib import Path
from time import perf_counter

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "demos"))
import notched_plate as demo  # noqa: E402

from xper_fx.output.gauges import TensileGauge  # noqa: E402
from xper_fx.output.output_folder import prepare_folder  # noqa: E402
from xper_fx.simulation.simulation import Simulation  # noqa: E402

COLUMNS = (
    "variant", "interface", "cells", "step_factor", "peak", "peak_strain", "rise", "work",
    "dissipated", "cracking", "matrix", "interface_crack", "inclusion", "closure", "seconds",
)  # fmt: skip
FINAL_STRAIN = {"printed": 0.012, "resolved": 0.018}


def re_rise(stress: np.ndarray, strain: np.ndarray) -> float:
    """Largest rise of the stress (Pa) after its first drop by a tenth, smoothed over 0.02 %."""
    width = max(1, int(2e-4 / (strain[-1] / len(strain))))
    smooth = np.convolve(stress, np.ones(width) / width, "valid")
    top = np.maximum.accumulate(smooth)
    dropped = np.flatnonzero(smooth < 0.95 * top)
    if not len(dropped):
        return 0.0
    after = smooth[dropped[0] :]
    return float(np.max(after - np.minimum.accumulate(after)))


def one(variant: str, interface: str, cells: int, factor: float, tolerance: float) -> dict:
    """One run, as a row of the table."""
    scene = demo.notched_plate(
        cells, interface, toughening=demo.toughening() if variant == "resolved" else 1.0
    )
    coarse = Simulation(scene, scheme="explicit", tolerance=tolerance)
    simulation = Simulation(
        scene, factor * coarse.step_size, scheme="explicit", tolerance=tolerance
    )
    gauge = TensileGauge(demo.LEFT, demo.RIGHT, 0, demo.SIZE, demo.SIZE)
    curve = []
    start = perf_counter()
    for step in simulation.steps(FINAL_STRAIN[variant] * demo.SIZE / (2.0 * demo.SPEED)):
        curve.append(gauge.read(simulation))
        e = step.energies
    seconds = perf_counter() - start
    strain, stress = np.array(curve).T
    peak = int(np.argmax(stress))
    segments, kind = demo.cracks(simulation)
    lengths = np.bincount(kind, np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1), 3)
    return dict(
        zip(
            COLUMNS,
            (
                variant, interface, cells, factor, stress[peak], strain[peak],
                re_rise(stress, strain), e["external_work"],
                sum(e[name] for name in e if name.startswith("dissipated")),
                e["dissipated_cohesion"], *lengths, e["closure"] / e["external_work"], seconds,
            ),
            strict=True,
        )
    )  # fmt: skip


def line(row: dict) -> str:
    """A row as text."""
    return (
        f"{row['variant']:<9}{row['interface']:<7}{row['cells']:>4} x {row['step_factor']:<4g}"
        f" peak {row['peak'] / 1e6:6.1f} MPa at {100 * row['peak_strain']:.3f} %, re-rise "
        f"{row['rise'] / 1e6:5.0f} MPa; work {1e3 * row['work']:.3f}, dissipated "
        f"{1e3 * row['dissipated']:.3f}, cracking {1e3 * row['cracking']:.4f} mJ/m; cracks (um) "
        f"matrix {1e6 * row['matrix']:.1f}, interface {1e6 * row['interface_crack']:.1f}, "
        f"inclusion {1e6 * row['inclusion']:.1f}; closure {row['closure']:.0e}; "
        f"{row['seconds']:.0f} s"
    )


def main() -> None:
    """Run, print, keep as CSV."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="+", default=[20, 40, 80])
    parser.add_argument("--steps", type=float, nargs="+", default=[1.0, 0.5])
    parser.add_argument("--variant", choices=("printed", "resolved", "both"), default="both")
    parser.add_argument("--tolerance", type=float, default=1e-4)
    parser.add_argument("--out", type=Path, default=Path("results/plate_study"))
    options = parser.parse_args()
    variants = ["printed", "resolved"] if options.variant == "both" else [options.variant]
    folder = prepare_folder(options.out)
    with open(folder / f"study_{options.variant}.csv", "w", newline="") as file:
        table = csv.DictWriter(file, COLUMNS)
        table.writeheader()
        for variant in variants:
            for interface in ("weak", "strong"):
                before = None
                for cells in options.cells:
                    for factor in options.steps:
                        row = one(variant, interface, cells, factor, options.tolerance)
                        table.writerow(row)
                        file.flush()
                        print(line(row), flush=True)
                        if factor == options.steps[-1] and before is not None:
                            differences = ", ".join(
                                f"{name} {100 * (row[name] / before[name] - 1.0):+.1f} %"
                                for name in ("peak", "dissipated", "cracking")
                            )
                            print(f"    against {before['cells']}: {differences}", flush=True)
                        if factor == options.steps[-1]:
                            before = row


if __name__ == "__main__":
    main()
