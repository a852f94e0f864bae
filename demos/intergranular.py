# SPDX-License-Identifier: LGPL-3.0-or-later
# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # Intergranular fracture of a periodic polycrystal
#
# This demo illustrates how to:
#
# - tessellate a periodic cell into grains and mesh them periodically
# - take grains as bodies, those that cross the cell's boundary included
# - drive the cell, and follow cracks along grain boundaries
#
# The scene is the third example of Perales et al. 2010 (section 4.2.3, figures 13 and 14): a
# periodic square of 100 um of Zircaloy grains (soft) with two inclusions of several hydride grains
# (hard), weak bonds between soft and hard. Fbar_11 grows at a constant rate with Pibar_22 = 0,
# Fbar_12 = Fbar_21 = 0. Expected: cracks start at the boundaries of the hard grains, two main
# cracks run along those of the soft grains and join, the stress falls abruptly.
#
# **What the paper does not say and this demo chooses**: number of grains, their seeds, where the
# inclusions are, elastic grains (`--ductile` makes the soft ones plastic), the lateral stress, the
# rate, step and tolerances. Other seeds (`--seed`) crack elsewhere.

import argparse
import logging
from pathlib import Path

import numpy as np
from mpi4py import MPI
from tqdm.auto import tqdm

import xper_fx as xf

# ## Grains

SIZE = 100e-6
SOFT, HARD = 1, 2
INCLUSIONS = ((0.3 * SIZE, 0.35 * SIZE), (0.75 * SIZE, 0.7 * SIZE))
GRAINS_OF_AN_INCLUSION = 5
# Shortest edge of a grain beside the mean distance of seeds.
SHORTEST_EDGE = 0.2


def polycrystal(
    grains: int, facet: float, seed: int, homogeneous: bool
) -> xf.microstructure.Microstructure:
    """Grains cut by the square, the nearest to two points hard; `facet` is their edge (m)."""
    seeds = xf.microstructure.random_seeds(grains, (SIZE, SIZE), seed, relaxation=3)
    tessellation = xf.microstructure.lengthen_short_edges(
        xf.microstructure.tessellate(seeds, (SIZE, SIZE)), SHORTEST_EDGE * SIZE / np.sqrt(grains)
    )
    phase = np.full(grains, SOFT)
    if not homogeneous:
        for point in INCLUSIONS:
            phase[xf.microstructure.nearest_grains(tessellation, point, GRAINS_OF_AN_INCLUSION)] = (
                HARD
            )
    return xf.microstructure.mesh_tessellation(
        xf.microstructure.cut_by_box(tessellation), facet, phase, MPI.COMM_SELF
    )


# ## Scene


def intergranular(
    grains: int,
    facet: float,
    *,
    seed: int = 4,
    rate: float = 2e4,
    ductile: bool = False,
    homogeneous: bool = False,
) -> xf.Scene:
    """The scene."""
    structure = polycrystal(grains, facet, seed, homogeneous)
    materials = {
        SOFT: xf.library.ZIRCALOY_4_DUCTILE if ductile else xf.library.ZIRCALOY_4,
        HARD: xf.materials.LinearElastic(
            xf.library.HYDRIDE.young, xf.library.HYDRIDE.poisson, xf.library.DENSITY
        ),
    }
    bonds = {
        (SOFT, SOFT): xf.library.ZIRCALOY_BOND,
        (SOFT, HARD): xf.library.INTERFACE_BONDS["weak"],
        (HARD, HARD): xf.library.HYDRIDE_BOND,
    }
    if homogeneous:
        materials, bonds = {SOFT: materials[SOFT]}, {(SOFT, SOFT): xf.library.ZIRCALOY_BOND}
    return xf.Scene(
        xf.explode(structure.mesh, structure.grain, structure.cell_tags, lattice=structure.lattice),
        materials,
        interactions=bonds,
        macroscopic=xf.MacroscopicDrive(
            rate={"11": rate}, gradient={"12": 0.0, "21": 0.0}, stress={"22": 0.0}
        ),
    )


# ## One run
#
# The cell is drawn when the first bonds have broken, and at the end.


def run(scene: xf.Scene, options: argparse.Namespace) -> dict:
    """Run the scene into the folder; returns what report and figures need."""
    simulation = xf.Simulation(
        scene,
        options.step_size,
        accuracy=options.accuracy,
        theta=options.theta,
        tolerance=options.tolerance,
        solver=options.solver,
        num_threads=options.threads,
    )
    end = options.final_strain / options.rate
    recorder = xf.Recorder(
        simulation,
        options.out,
        end_time=end,
        gauge=xf.CellGauge("11"),
        fields=options.fields,
        parameters=vars(options),
        checkpoint_every=options.checkpoint_every,
        restart=options.restart,
    )
    panels, first, first_strain = (
        [],
        xf.output.Cracks(np.zeros((0, 2, 2)), np.zeros(0, int)),
        np.inf,
    )
    for _, strain in xf.recorded_steps(
        recorder, end, "polycrystal", options.quiet, options.profile
    ):
        if not len(first.kind):
            first = xf.output.find_cracks(simulation, HARD)
            if len(first.kind):
                first_strain = strain
                panels.append(
                    xf.output.crack_panel(recorder, first, f"first cracks, {100 * strain:.2f} %")
                )
    final = xf.output.find_cracks(simulation, HARD)
    panels.append(xf.output.crack_panel(recorder, final, f"{100 * recorder.strain:.2f} %"))
    return {
        "simulation": simulation,
        "history": xf.read_history(options.out / "history.csv"),
        "first": first,
        "first_strain": first_strain,
        "panels": panels,
        "gradient": simulation.macroscopic.gradient,
    }


def report(result: dict, options: argparse.Namespace) -> None:
    """Say where cracks began, the peak, what was dissipated and what it cost."""
    history, simulation = result["history"], result["simulation"]
    peak = int(np.argmax(history["stress"]))
    last = {name: column[-1] for name, column in history.items()}
    names = ("soft-soft", "soft-hard", "hard-hard")
    counts = [int(count) for count in np.bincount(result["first"].kind, minlength=3)]
    lengths = dict(zip(names, result["panels"][-1].crack_lengths().values(), strict=True))
    tqdm.write(
        f"\nfirst cracks at {100 * result['first_strain']:.3f} %: broken points "
        + ", ".join(f"{n} {name}" for n, name in zip(counts, names, strict=True))
        + f"\npeak {history['stress'][peak] / 1e6:.0f} MPa at {100 * history['strain'][peak]:.3f} %"
        f", at the end {history['stress'][-1] / 1e6:.0f} MPa; cracked boundaries: "
        + ", ".join(f"{1e6 * v:.0f} um {name}" for name, v in lengths.items())
        + f"\nenergy (mJ/m): external work {1e3 * last['external_work']:.3f}, cracks "
        f"{1e3 * last['dissipated_cohesion']:.4f}, plastic "
        f"{1e3 * last.get('dissipated_plastic', 0.0):.3f}; closure error "
        f"{last['closure'] / last['external_work']:.1e} of the work, largest error of Hill and "
        f"Mandel's lemma {history['hill_mandel'].max():.1e}"
    )
    tqdm.write(xf.cohesive_table(simulation))
    tqdm.write(xf.effects_table(simulation))
    found = {
        "peak_stress": history["stress"][peak],
        "first_cracks": dict(zip(names, counts, strict=True)),
        "crack_length": lengths,
    }
    xf.add_to_summary(simulation, found)


# ## Figures


def draw(result: dict, out: Path) -> None:
    """Figures 13 and 14 of the paper, the tiled cell, and the energies."""
    bodies, panels = result["simulation"].scene.bodies, result["panels"]
    names = {SOFT: "soft grains", HARD: "hard grains"}
    kinds = ("soft-soft", "soft-hard", "hard-hard")
    whole = panels[0]
    xf.plotting.plot_grains(
        whole.points, whole.triangles, bodies.body_of_cell, bodies.material_of_cell == HARD,
        out / "grains.png",
    )  # fmt: skip
    xf.plotting.plot_cracks(panels, path=out / "cracks.png", names=names, kinds=kinds)
    tiled = panels[-1].tiled(np.diag([SIZE, SIZE]), result["gradient"])
    xf.plotting.plot_cracks(tiled, path=out / "cracks_tiled.png", names=names, kinds=kinds)
    history = result["history"]
    xf.plotting.plot_curves([("", history["strain"], history["stress"])], out / "stress_strain.png")
    xf.plotting.plot_energies(history, out / "energies.png")


# ## Command line


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Options of the demo."""
    parser = argparse.ArgumentParser(description="Intergranular fracture of a polycrystal.")
    add = parser.add_argument
    add("--grains", type=int, default=60, help="number of grains (default 60)")
    add("--cells", type=int, default=40, help="facets along a side of the square (default 40)")
    add("--seed", type=int, default=4, help="of the grains")
    add("--homogeneous", action="store_true", help="soft grains only")
    add("--ductile", action="store_true", help="plastic soft grains")
    add("--rate", type=float, default=2e4, help="of Fbar_11, 1/s")
    add("--final-strain", type=float, default=0.01)
    add("--step-size", type=float, default=1e-9, help="h in s (default 1e-9)")
    xf.add_run_options(parser, Path("results/intergranular"))
    options = parser.parse_args(arguments)
    if options.grains < 2 * GRAINS_OF_AN_INCLUSION + 2:
        parser.error(f"--grains should be at least {2 * GRAINS_OF_AN_INCLUSION + 2}")
    if options.cells < 1:
        parser.error(f"--cells should be at least 1, got {options.cells}")
    if not 0.0 < options.final_strain < 1.0:
        parser.error(f"--final-strain should lie in (0, 1), got {options.final_strain}")
    if not options.rate > 0.0:
        parser.error(f"--rate should be above zero, got {options.rate}")
    return options


def main(arguments: list[str] | None = None) -> dict:
    """Run the polycrystal and draw it."""
    options = parse(arguments)
    logging.basicConfig(level=logging.WARNING)
    xf.prepare_folder(options.out)
    scene = intergranular(
        options.grains,
        SIZE / options.cells,
        seed=options.seed,
        rate=options.rate,
        ductile=options.ductile,
        homogeneous=options.homogeneous,
    )
    result = run(scene, options)
    report(result, options)
    if not options.no_plot:
        draw(result, options.out)
    return result


if __name__ == "__main__":
    xf.run_together(main)
