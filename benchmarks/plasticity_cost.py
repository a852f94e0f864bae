# SPDX-License-Identifier: LGPL-3.0-or-later
"""What internal variables cost beside elasticity: assembly, commit and compilation.

    ./fenicsx python3 benchmarks/plasticity_cost.py [--cells 40] [--cells-3d 8] [--repeat 5]
    ./fenicsx python3 benchmarks/plasticity_cost.py --jit

Seconds to assemble forces and tangent and to commit a step, every material on the same mesh and
displacement, in plastic flow where there is any, and ratios to linear elasticity (whose forms a
simulation assembles once). Materials take turns; the least of the repeats counts. With --jit,
seconds to generate and compile all forms of each material in an empty cache.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from dolfinx import fem

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "shared"))
from scenes import box_bodies  # noqa: E402

from xper_fx.forms import compiled  # noqa: E402
from xper_fx.forms.dynamics import BulkForms  # noqa: E402
from xper_fx.materials import (  # noqa: E402
    J2FiniteStrain,
    J2SmallStrain,
    Linear,
    LinearElastic,
    LinearViscoelastic,
    NeoHookean,
    Voce,
)

STEEL = (206.9, 0.29, 0.45)
VOCE = Voce(0.715, 16.93, 0.129)
MATERIALS = {
    "linear elastic": LinearElastic(206.9, 0.29, 1.0),
    "neo-Hookean": NeoHookean(206.9, 0.29, 1.0),
    "viscoelastic, 2 terms": LinearViscoelastic(206.9, 0.29, ((0.3, 1.0), (0.3, 10.0)), 1.0),
    "J2 small, linear": J2SmallStrain(*STEEL, Linear(0.129), 1.0),
    "J2 small, Voce": J2SmallStrain(*STEEL, VOCE, 1.0),
    "J2 finite, linear": J2FiniteStrain(*STEEL, Linear(0.129), 1.0),
    "J2 finite, Voce": J2FiniteStrain(*STEEL, VOCE, 1.0),
}
CASES = {"2D, order 1": (2, 1), "2D, order 2": (2, 2), "3D, order 1": (3, 1), "3D, order 2": (3, 2)}


def bodies_of(dim, count):
    kind = "crossed" if dim == 2 else "tetrahedron"
    return box_bodies((1,) * dim, (count,) * dim, kind, 0)


class Case:
    """Forms of one material, sheared homogeneously past yield, with a little noise."""

    def __init__(self, bodies, order, material):
        self.forms = BulkForms(bodies, order, {1: material})
        x = self.forms.V.tabulate_dof_coordinates()
        dim = bodies.mesh.geometry.dim
        self.u = 1e-4 * np.random.default_rng(0).standard_normal((len(x), dim))
        self.u[:, 0] += 0.02 * x[:, 1]
        self.u = self.u.ravel()
        self.matrix = fem.create_matrix(self.forms.tangent)
        self.forms.set_step(0.1)
        self.forms.commit(0.5 * self.u)

    def force(self):
        self.forms.assemble_internal(self.u)

    def tangent(self):
        self.forms.u.x.array[:] = self.u
        self.matrix.set_value(0.0)
        fem.assemble_matrix(self.matrix, self.forms.tangent)

    def commit(self):
        self.forms.commit(self.u)


def seconds(action) -> float:
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def assembly(cells, cells_3d, repeat):
    for title, (dim, order) in CASES.items():
        bodies = bodies_of(dim, cells if dim == 2 else cells_3d)
        cases = {name: Case(bodies, order, m) for name, m in MATERIALS.items()}
        best = {}
        for _ in range(repeat):
            for name, case in cases.items():
                for what in ("force", "tangent"):
                    spent = seconds(getattr(case, what))
                    best[name, what] = min(spent, best.get((name, what), np.inf))
        count = len(bodies.material_of_cell)
        print(f"\n{title}, {count} cells (us a cell, and over linear elastic)")
        print(f"{'':<24}{'force':>8}{'':>7}{'tangent':>9}{'':>7}{'commit':>8}{'memory':>10}")
        for name, case in cases.items():
            row = f"{name:<24}"
            for what in ("force", "tangent"):
                ratio = best[name, what] / best["linear elastic", what]
                row += f"{1e6 * best[name, what] / count:>8.2f}{ratio:>7.1f}x"
            if case.forms.has_history:
                spent = min(seconds(case.commit) for _ in range(repeat))
                row += f"{1e6 * spent / count:>8.2f}"
                row += f"{case.forms.history_nbytes / count:>6.0f} B"
            print(row)


def compilation():
    print(f"{'s to compile':<24}" + "".join(f"{title:>13}" for title in CASES))
    bodies = {dim: bodies_of(dim, 1) for dim in (2, 3)}
    for name, material in MATERIALS.items():
        row = f"{name:<24}"
        for dim, order in CASES.values():
            with tempfile.TemporaryDirectory() as cache:
                compiled.OPTIONS["cache_dir"] = cache
                row += f"{seconds(lambda: BulkForms(bodies[dim], order, {1: material})):>13.2f}"  # noqa: B023
        print(row)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=40)
    parser.add_argument("--cells-3d", type=int, default=8)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--jit", action="store_true")
    arguments = parser.parse_args()
    if arguments.jit:
        compilation()
    else:
        assembly(arguments.cells, arguments.cells_3d, arguments.repeat)


if __name__ == "__main__":
    main()
