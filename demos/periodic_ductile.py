# SPDX-License-Identifier: LGPL-3.0-or-later
# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # Fracture of a periodic ductile composite
#
# This demo illustrates how to:
#
# - make a periodic cell, drive some components of its macroscopic gradient and leave others to
#   stresses
# - put an elastoplastic matrix and elastic inclusions into one multibody scene
# - find where cracks initiate, and set the composite's curve beside the homogeneous matrix's
#
# The scene is the second example of Perales et al. 2010 (section 4.2.2, figures 11 and 12): the
# inclusions of the notched plate, now in a periodic medium without precrack, the matrix plastic
# (von Mises, 450 MPa, linear hardening 850 MPa), the interfaces strong. Fbar_11 grows at a constant
# rate with Pibar_22 = 0, Fbar_12 = Fbar_21 = 0.
#
# **The homogeneous matrix is known**: in plane strain with Pibar_22 = 0 the matrix gives 520.1,
# 524.7, 531.0 and 536.6 MPa at 0.75, 1, 1.5 and 2 % (small strain); with Fbar_22 = 1
# (`--lateral held`) the matrix gives 1244 MPa at 1 %. The figure has the curves of matrix and
# composite. The composite's curve must lie above the matrix's curve until cracks open.
#
# **What the paper does not say and this demo chooses**: the layout (`LAYOUTS`), Pibar_22 = 0, the
# rate (that of the notched plate), step and tolerances.
#
# **Limitation.** The strain at which cracks begin depends on the mesh: the cohesive lengths, which
# are printed at the end, span a few hundredths of a facet.

import argparse
import logging
from pathlib import Path

import numpy as np
from mpi4py import MPI
from tqdm.auto import tqdm

import xper_fx as xf

# ## Geometry
#
# Lengths in units of 2.5 um, so that 20, 40, 80... quads a side mesh every rectangle exactly. Both
# layouts go on across the boundary: "bricks" are short staggered inclusions, "bands" long ones that
# leave a gap of two units in every period.

SIZE = 50e-6
UNIT = 2.5e-6
MATRIX, INCLUSION = 1, 2
LAYOUTS = {
    "bricks": [
        (first + shift, y, first + shift + 6, y + 2)
        for y, first in ((1, -3), (5, 2), (9, -3), (13, 2), (17, -3))
        for shift in (0, 10, 20)
    ],
    "bands": [
        (first + shift, y, first + shift + 18, y + 2)
        for y, first in ((3, 1), (8, -9), (13, 1), (18, -9))
        for shift in (0, 20)
    ],
}


def cell(quads: int, inclusions: list[tuple]) -> xf.Bodies:
    """The periodic cell, each triangle a body."""
    mesh = xf.crossed_rectangle((0.0, 0.0), (SIZE, SIZE), (quads, quads))
    inside = {INCLUSION: xf.in_rectangles(UNIT * np.array(inclusions))} if inclusions else {}
    return xf.explode(mesh, cell_tags=xf.tag_cells(mesh, inside, MATRIX), lattice=(SIZE, SIZE))


# ## Materials, bonds and drive


def drive(rate: float, lateral: str) -> xf.MacroscopicDrive:
    """Fbar_11 at a rate; sideways no stress ("free") or no strain ("held")."""
    if lateral == "free":
        return xf.MacroscopicDrive(
            rate={"11": rate}, gradient={"12": 0.0, "21": 0.0}, stress={"22": 0.0}
        )
    return xf.MacroscopicDrive(rate={"11": rate}, gradient={"12": 0.0, "21": 0.0, "22": 1.0})


def matrix(finite_strain: bool):
    """The matrix's material."""
    return xf.library.ZIRCALOY_4_DUCTILE_FINITE if finite_strain else xf.library.ZIRCALOY_4_DUCTILE


def periodic_composite(
    quads: int,
    *,
    rate: float = 4e4,
    lateral: str = "free",
    layout: str = "bands",
    finite_strain: bool = False,
    homogeneous: bool = False,
) -> xf.Scene:
    """The scene; at small strain the hydride is linear with the same constants."""
    inclusion = (
        xf.library.HYDRIDE
        if finite_strain
        else xf.materials.LinearElastic(
            xf.library.HYDRIDE.young, xf.library.HYDRIDE.poisson, xf.library.DENSITY
        )
    )
    materials = {MATRIX: matrix(finite_strain), INCLUSION: inclusion}
    bonds = {
        (MATRIX, MATRIX): xf.library.ZIRCALOY_BOND,
        (MATRIX, INCLUSION): xf.library.INTERFACE_BONDS["strong"],
        (INCLUSION, INCLUSION): xf.library.HYDRIDE_BOND,
    }
    if homogeneous:
        materials, bonds = {MATRIX: materials[MATRIX]}, {(MATRIX, MATRIX): xf.library.ZIRCALOY_BOND}
    return xf.Scene(
        cell(quads, [] if homogeneous else LAYOUTS[layout]),
        materials,
        interactions=bonds,
        macroscopic=drive(rate, lateral),
    )


def homogeneous_curve(final_strain: float, lateral: str, finite_strain: bool) -> dict:
    """Strain and stress of the matrix alone: one connected body, static, no interactions."""
    mesh = xf.crossed_rectangle((0.0, 0.0), (SIZE, SIZE), (1, 1))
    bodies = xf.explode(mesh, np.zeros(4, int), lattice=(SIZE, SIZE))
    scene = xf.Scene(bodies, {1: matrix(finite_strain)}, macroscopic=drive(1.0, lateral))
    simulation = xf.Simulation(
        scene, final_strain / 400, theta=1.0, inertia=False, comm=MPI.COMM_SELF
    )
    curve = [(0.0, 0.0)]
    curve += [xf.CellGauge("11").read(simulation) for _ in simulation.steps(final_strain)]
    strain, stress = np.array(curve).T
    return {"strain": strain, "stress": stress}


# ## One run
#
# The cell is drawn when the first bonds have broken, and at the end.


def run(scene: xf.Scene, options: argparse.Namespace) -> dict:
    """Run the scene into the folder; returns what report and figures need."""
    title = "homogeneous" if options.homogeneous else "composite"
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
        parameters=vars(options) | {"title": title},
        checkpoint_every=options.checkpoint_every,
        restart=options.restart,
    )
    first, first_strain = None, np.inf
    for _, strain in xf.recorded_steps(recorder, end, title, options.quiet, options.profile):
        if first is None:
            cracks = xf.output.find_cracks(simulation, INCLUSION)
            if len(cracks.kind):
                first = xf.output.crack_panel(
                    recorder, cracks, f"first cracks, {100 * strain:.2f} %"
                )
                first_strain = strain
    cracks = xf.output.find_cracks(simulation, INCLUSION)
    final = xf.output.crack_panel(recorder, cracks, f"{title}, {100 * recorder.strain:.2f} %")
    return {
        "simulation": simulation,
        "history": xf.read_history(options.out / "history.csv"),
        "first": first,
        "first_strain": first_strain,
        "final": final,
        "gradient": simulation.macroscopic.gradient,
    }


# The plateau is the mean stress from 0.5 % on, until the first crack.

PLATEAU = 0.005


def plateau(curve: dict, until: float) -> float:
    """Mean stress (Pa) from PLATEAU to a strain beyond it."""
    return float(curve["stress"][(curve["strain"] >= PLATEAU) & (curve["strain"] < until)].mean())


def report(result: dict, reference: dict, options: argparse.Namespace) -> None:
    """Say where cracks began, how high the plateau is, what was dissipated and what it cost."""
    history, simulation = result["history"], result["simulation"]
    until = min(result["first_strain"], history["strain"][-1])
    levels = {}
    if until > 1.1 * PLATEAU:
        levels["plateau"] = plateau(history, until)
        levels["plateau_homogeneous"] = plateau(reference, until)
        tqdm.write(
            f"\nmean stress from {100 * PLATEAU:.1f} % to {100 * until:.2f} %: "
            f"{levels['plateau'] / 1e6:.1f} MPa, homogeneous matrix "
            f"{levels['plateau_homogeneous'] / 1e6:.1f} MPa"
        )
    peak = int(np.argmax(history["stress"]))
    last = {name: column[-1] for name, column in history.items()}
    counts = {}
    if result["first"] is not None:
        kinds = np.bincount(result["first"].crack_kind, minlength=3)
        counts = dict(zip(("matrix", "interface", "inclusion"), map(int, kinds), strict=True))
        tqdm.write(
            f"\nfirst cracks at {100 * result['first_strain']:.3f} %: broken points "
            + ", ".join(f"{n} in {kind}" for kind, n in counts.items())
        )
    tqdm.write(
        f"peak {history['stress'][peak] / 1e6:.1f} MPa at {100 * history['strain'][peak]:.3f} %"
        f"\nenergy (mJ/m): external work {1e3 * last['external_work']:.3f}, plastic "
        f"{1e3 * last['dissipated_plastic']:.3f}, cracks {1e3 * last['dissipated_cohesion']:.4f}; "
        f"closure error {last['closure'] / last['external_work']:.1e} of the work, largest error "
        f"of Hill and Mandel's lemma {history['hill_mandel'].max():.1e}"
    )
    tqdm.write(xf.cohesive_table(simulation))
    tqdm.write(xf.effects_table(simulation))
    found = levels | {"peak_stress": history["stress"][peak]}
    if counts:
        found |= {"first_cracks": counts, "first_crack_strain": result["first_strain"]}
    xf.add_to_summary(simulation, found)


# ## Figures


def draw(result: dict, reference: dict, out: Path) -> None:
    """Figures 11 and 12 of the paper, the tiled cell, and the energies."""
    final = result["final"]
    xf.plotting.plot_microstructure(
        final.points, final.triangles, final.material, [], out / "cell.png"
    )
    xf.plotting.plot_cracks(
        [p for p in (result["first"], final) if p is not None], path=out / "cracks.png"
    )
    tiled = final.tiled(np.diag([SIZE, SIZE]), result["gradient"])
    xf.plotting.plot_cracks(tiled, path=out / "cracks_tiled.png")
    history = result["history"]
    xf.plotting.plot_curves(
        [
            (final.title.split(",")[0], history["strain"], history["stress"]),
            ("matrix alone", reference["strain"], reference["stress"]),
        ],
        out / "stress_strain.png",
    )
    xf.plotting.plot_energies(history, out / "energies.png")


# ## Command line


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Options of the demo."""
    parser = argparse.ArgumentParser(description="Fracture of a periodic ductile composite.")
    add = parser.add_argument
    add("--cells", type=int, default=20, help="quads a side, a multiple of 20 (default 20)")
    add("--layout", choices=tuple(LAYOUTS), default="bands", help="of the inclusions")
    add("--homogeneous", action="store_true", help="no inclusions")
    add("--lateral", choices=("free", "held"), default="free", help="P22 = 0 or F22 = 1")
    add("--finite-strain", action="store_true", help="multiplicative plasticity, neo-Hookean")
    add("--rate", type=float, default=4e4, help="of Fbar_11, 1/s")
    add("--final-strain", type=float, default=0.02)
    add("--step-size", type=float, default=5e-10, help="h in s (default 5e-10)")
    xf.add_run_options(parser, Path("results/periodic_ductile"))
    options = parser.parse_args(arguments)
    if options.cells < 20 or options.cells % 20:
        parser.error(f"--cells should be a multiple of 20, to fit inclusions, got {options.cells}")
    if not 0.0 < options.final_strain < 1.0:
        parser.error(f"--final-strain should lie in (0, 1), got {options.final_strain}")
    if not options.rate > 0.0:
        parser.error(f"--rate should be above zero, got {options.rate}")
    return options


def main(arguments: list[str] | None = None) -> dict:
    """Run the cell, compare it with its matrix, and draw both."""
    options = parse(arguments)
    logging.basicConfig(level=logging.WARNING)
    xf.prepare_folder(options.out)
    reference = homogeneous_curve(options.final_strain, options.lateral, options.finite_strain)
    scene = periodic_composite(
        options.cells,
        rate=options.rate,
        lateral=options.lateral,
        layout=options.layout,
        finite_strain=options.finite_strain,
        homogeneous=options.homogeneous,
    )
    result = run(scene, options)
    report(result, reference, options)
    if not options.no_plot:
        draw(result, reference, options.out)
    return result | {"reference": reference}


if __name__ == "__main__":
    xf.run_together(main)
