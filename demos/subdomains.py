# SPDX-License-Identifier: LGPL-3.0-or-later
# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # Perfect bonds as domain decomposition
#
# This demo illustrates how to:
#
# - cut a mesh into subdomains by a graph partitioner and bond them
# - get the field of the uncut mesh, without inertia and with inertia, in 2D and 3D
# - see the effect of a coarse space
#
# With the law "perfect bond" NonSmooth Contact Dynamics is a dual Schur domain decomposition
# (Perales et al. 2010, section 3.3): the impulses between subdomains are the multipliers, and any
# other law may stand at some of the interfaces. A plate and a block, clamped at one side and pulled
# at the other, are cut into 1, 4, 16 and 64 subdomains. Without inertia ("static") most subdomains
# float: only the bonds hold them. With inertia, waves cross the body many times in a step, or cross
# about a fifth of the body in a short step ("short").
#
# **Expected**: errors against the uncut mesh are rounding. From 4 to 16 subdomains the number of
# iterations grows, because four subdomains meet at a single point and have hardly an inside; from
# 16 subdomains on the number stays. Without the coarse space the number of iterations trebles each
# time, except for short steps, in which waves do not travel far.

import argparse
import csv
from pathlib import Path

import numpy as np
from dolfinx.mesh import CellType, create_box, create_rectangle
from mpi4py import MPI
from tqdm.auto import tqdm

import xper_fx as xf

# ## Scene
#
# Waves run at about 12 m/s; plate and block have edges of 1 m.

CLAMPED, PULLED = 1, 2
MATERIAL = xf.materials.LinearElastic(young=100.0, poisson=0.3, density=1.0)
RUNS = {
    "static": {"step": 1.0, "inertia": False, "theta": 1.0},
    "dynamic": {"step": 0.5},
    "short": {"step": 0.02},
}
STEPS = 2


def cut(dim: int, cells: int, count: int) -> xf.Bodies:
    """A plate of triangles or a block of tetrahedra in `count` subdomains."""
    lower, upper = np.zeros(dim), np.ones(dim)
    create, kind = (
        (create_rectangle, CellType.triangle) if dim == 2 else (create_box, CellType.tetrahedron)
    )
    mesh = create(MPI.COMM_SELF, [lower, upper], [cells] * dim, kind)
    sides = {CLAMPED: lambda x: x[0] < 1e-9, PULLED: lambda x: x[0] > 1.0 - 1e-9}
    return xf.explode(mesh, xf.partition(mesh, count), facet_tags=xf.tag_facets(mesh, sides))


def scene(bodies: xf.Bodies) -> xf.Scene:
    """Clamped at the left, pulled and sheared at the right."""
    dim = bodies.mesh.geometry.dim
    held = [xf.PrescribedDisplacement(CLAMPED, axis, 0.0) for axis in range(dim)]
    pull = xf.SurfaceTraction(PULLED, (1.0, -2.0, 0.5)[:dim])
    return xf.Scene(
        bodies, {1: MATERIAL}, default_interaction=xf.laws.PerfectBond(), loads=[*held, pull]
    )


# ## Runs
#
# The field is compared after two steps at a tolerance of rounding. Iterations are those of the
# first solve to 1e-8. A solver is any function with the arguments of those in `nscd`: here that of
# the bonds without its coarse space, where bodies that float stand on weak springs.


def displacement(bodies: xf.Bodies, run: dict) -> np.ndarray:
    """Displacement at the geometry nodes, shape (num_nodes, dim), m."""
    simulation = xf.Simulation(scene(bodies), tolerance=1e-12, solver="subdomains", **run)
    for _ in simulation.steps(STEPS * run["step"]):
        pass
    space = simulation.forms.V
    values = simulation.displacement.x.array.reshape(-1, simulation.bulk.dim)
    out = np.empty((len(bodies.mesh.geometry.x), simulation.bulk.dim))
    out[xf.geometry_dofmap(space.mesh)] = values[space.dofmap.list]
    return out


def iterations(bodies: xf.Bodies, run: dict, coarse_space: bool) -> int:
    """Iterations of the first solve."""
    counts = []

    class Counted(xf.solvers.BondedGradients):
        def solve(self, interactions, velocity, options):
            report = super().solve(interactions, velocity, options)
            counts.append(report.sweeps)
            return report

    simulation = xf.Simulation(
        scene(bodies),
        tolerance=1e-8,
        newton_tolerance=0.1,
        solver=Counted(coarse_space=coarse_space),
        **run,
    )
    next(iter(simulation.steps(run["step"])))
    return counts[0]


def study(name: str, dim: int, cells: int, counts: list[int], quiet: bool) -> list[dict]:
    """A row for each run and number of subdomains."""
    rows = []
    uncut = cut(dim, cells, 1)
    parts = {count: cut(dim, cells, count) for count in counts if count > 1}
    for run_name, run in tqdm(RUNS.items(), desc=name, disable=quiet):
        reference = np.empty((len(uncut.mesh.geometry.x), dim))
        reference[uncut.parent_vertex] = displacement(uncut, run)
        for count, bodies in parts.items():
            error = np.abs(displacement(bodies, run) - reference[bodies.parent_vertex]).max()
            rows.append(
                {
                    "body": name,
                    "run": run_name,
                    "subdomains": count,
                    "error": error / np.abs(reference).max(),
                    "with": iterations(bodies, run, True),
                    "without": iterations(bodies, run, False),
                }
            )
    return rows


# ## Results


def table(rows: list[dict]) -> str:
    """All rows as text."""
    lines = [f"{'':>18}{'subdomains':>12}{'error':>10}{'iterations':>12}{'without':>10}"]
    for row in rows:
        name = f"{row['body']}, {row['run']}"
        lines.append(
            f"{name:>18}{row['subdomains']:>12}{row['error']:>10.0e}{row['with']:>12}"
            f"{row['without']:>10}"
        )
    return "\n".join(lines)


def draw(bodies: xf.Bodies, rows: list[dict], path: Path) -> None:
    """The cut plate, and iterations against the number of subdomains for each body."""
    names = list(dict.fromkeys(row["body"] for row in rows))

    def fill(figure, axes):
        x = bodies.mesh.geometry.x
        shade = np.random.default_rng(1).permutation(bodies.num_bodies)[bodies.body_of_cell]
        axes[0].tripcolor(
            x[:, 0],
            x[:, 1],
            xf.geometry_dofmap(bodies.mesh),
            facecolors=shade,
            cmap="tab20",
        )
        axes[0].set_aspect("equal")
        axes[0].set_axis_off()
        axes[0].set_title(f"plate in {bodies.num_bodies} subdomains")
        for ax, name in zip(axes[1:], names, strict=True):
            for colour, mark, run in zip(xf.plotting.COLOURS, "so^", RUNS, strict=False):
                some = [row for row in rows if (row["body"], row["run"]) == (name, run)]
                count = [row["subdomains"] for row in some]
                ax.loglog(count, [row["with"] for row in some], f"{mark}-", color=colour, label=run)
                ax.loglog(
                    count, [row["without"] for row in some], f"{mark}--", color=colour, mfc="w"
                )
            ax.set_xlabel("subdomains")
            ax.set_xticks(count, [str(c) for c in count])
            ax.set_xticks([], minor=True)
            ax.set_ylim(3, 600)
            ax.set_title(f"{name} (dashed: no coarse space)")
        axes[1].set_ylabel("iterations to 1e-8")
        axes[1].legend()

    xf.plotting.new_figure(path, fill, (3.1 * (1 + len(names)), 3.0), ncols=1 + len(names))


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Options of the demo."""
    parser = argparse.ArgumentParser(description="Perfect bonds as domain decomposition.")
    add = parser.add_argument
    add("--plate-cells", type=int, default=64, help="squares along an edge (default 64)")
    add("--block-cells", type=int, default=10, help="cubes along an edge (default 10)")
    add("--subdomains", type=int, nargs="+", default=[4, 16, 64])
    add("--out", type=Path, default=Path("results/subdomains"))
    add("--no-plot", action="store_true")
    add("--quiet", action="store_true", help="no progress bar")
    options = parser.parse_args(arguments)
    if min(options.subdomains) < 2:
        parser.error(f"--subdomains should be at least 2 each, got {options.subdomains}")
    return options


def main(arguments: list[str] | None = None) -> list[dict]:
    """Run both bodies and write the table and the figure."""
    options = parse(arguments)
    xf.prepare_folder(options.out)
    rows = study("plate", 2, options.plate_cells, options.subdomains, options.quiet)
    rows += study("block", 3, options.block_cells, options.subdomains, options.quiet)
    print(table(rows))
    with open(options.out / "iterations.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    if not options.no_plot:
        most = max(options.subdomains)
        draw(cut(2, options.plate_cells, most), rows, options.out / "iterations.png")
    return rows


if __name__ == "__main__":
    xf.run_together(main)
