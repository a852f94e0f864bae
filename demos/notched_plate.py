# SPDX-License-Identifier: LGPL-3.0-or-later
# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # Fracture of a notched composite plate: weak against strong interfaces
#
# This demo illustrates how to:
#
# - cut a mesh into bodies, each cell its own, and give each kind of facet a cohesive law
# - run an explicit or implicit bulk with interactions solved without penalty
# - follow cracks, stress and energy, and tell deflection from penetration
#
# The scene is the first example of Perales et al. 2010 (section 4.2.1, figures 8 to 10): a square
# of 50 um, an elastic Zircaloy-4 matrix with aligned rectangular hydride inclusions, plane strain,
# vertical faces pulled apart at -1 and +1 m/s, a precrack at the bottom. Between a matrix crack and
# an inclusion the interface decides: He and Hutchinson (1989) expect deflection below a ratio of
# toughness w_interface / w_inclusion of 0.013 and penetration above 0.25; here 0.00125 and 1250.
#
# **What the paper does not say and this demo chooses**: the layout of the inclusions, the length of
# the precrack (`PRECRACK`), its lips (contact with the bonds' friction), the initial velocity
# (linear across the plate, so that no shock starts from the faces), top and bottom free, step and
# tolerances. All can be changed from the command line or below.
#
# **Limitation.** With the printed parameters the cohesive length E' w / Rmax^2 is 55 nm, far below
# any facet here, so that peak and crack pattern depend on the mesh. `--resolved` scales the
# fracture energies up until the cohesive length spans several facets; results then converge. Each
# run prints its cohesive lengths beside its facets.

import argparse
import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
from tqdm.auto import tqdm

import xper_fx as xf

# ## Geometry
#
# Lengths in units of 2.5 um, the facet of a 20 x 20 plate, so that 20, 40, 80... quads a side mesh
# every rectangle exactly.

SIZE = 50e-6
UNIT = 2.5e-6
MATRIX, INCLUSION = 1, 2
LEFT, RIGHT, NOTCH = 1, 2, 3
SPEED = 1.0
PRECRACK = 5
LAYOUTS = {
    "bands": [(0, y, 20, y + 2) for y in (6, 11, 16)],
    "bricks": [
        (x, y, x + 6, y + 2)
        for y, first in ((1, -3), (5, 2), (9, -3), (13, 2), (17, -3))
        for x in (first, first + 10, first + 20)
    ],
}


def composite(cells: int, inclusions: list[tuple]) -> xf.Bodies:
    """The plate, each cell a body, with tags for inclusions, pulled faces and precrack."""
    mesh = xf.crossed_rectangle((0.0, 0.0), (SIZE, SIZE), (cells, cells))
    small = 1e-6 * SIZE

    inside = {INCLUSION: xf.in_rectangles(UNIT * np.array(inclusions))} if inclusions else {}
    cell_tags = xf.tag_cells(mesh, inside, MATRIX)
    facet_tags = xf.tag_facets(
        mesh,
        {
            LEFT: lambda x: x[0] < small,
            RIGHT: lambda x: x[0] > SIZE - small,
            NOTCH: lambda x: (abs(x[0] - SIZE / 2) < small) & (x[1] < PRECRACK * UNIT + small),
        },
    )
    return xf.explode(mesh, cell_tags=cell_tags, facet_tags=facet_tags)


# ## Materials and bonds
#
# The bonds of the paper are springs that weaken. `--bonds rigid` takes bonds of the same strengths
# and energies that hold the cells together as one mesh until no admissible traction can: the
# intact plate has its full stiffness, and what does not crack costs no more than finite elements.
#
# At small strain the hydride is linear with the same constants; `--finite-strain` makes both phases
# neo-Hookean. The resolved variant multiplies every fracture energy by one factor, which scales
# the cohesive lengths by the same and leaves ratios, and so He and Hutchinson's criterion, alone.


def materials(finite_strain: bool, homogeneous: bool) -> dict:
    """Material of each cell tag."""
    kind = xf.materials.NeoHookean if finite_strain else xf.materials.LinearElastic
    both = {
        tag: kind(m.young, m.poisson, m.density)
        for tag, m in ((MATRIX, xf.library.ZIRCALOY_4), (INCLUSION, xf.library.HYDRIDE))
    }
    return {MATRIX: both[MATRIX]} if homogeneous else both


def bonds(interface: str, toughening: float, homogeneous: bool, rigid: bool = False) -> dict:
    """Cohesive law of each pair of cell tags; `rigid` bonds have no stiffness but the same w."""
    laws: dict = {
        (MATRIX, MATRIX): xf.library.ZIRCALOY_BOND,
        (MATRIX, INCLUSION): xf.library.INTERFACE_BONDS[interface],
        (INCLUSION, INCLUSION): xf.library.HYDRIDE_BOND,
    }
    laws = {
        pair: replace(law, fracture_energy=toughening * law.fracture_energy)
        for pair, law in laws.items()
    }
    if rigid:
        laws = {
            pair: xf.laws.RigidCohesiveZone(law.strength, law.fracture_energy, law.friction)
            for pair, law in laws.items()
        }
    return {(MATRIX, MATRIX): laws[MATRIX, MATRIX]} if homogeneous else laws


def notched_plate(
    cells: int,
    interface: str,
    *,
    finite_strain: bool = False,
    homogeneous: bool = False,
    toughening: float = 1.0,
    layout: str = "bands",
    rigid: bool = False,
) -> xf.Scene:
    """The scene; `interface` is "weak" or "strong"."""
    return xf.Scene(
        composite(cells, [] if homogeneous else LAYOUTS[layout]),
        materials(finite_strain, homogeneous),
        interactions=bonds(interface, toughening, homogeneous, rigid),
        facet_interactions={
            NOTCH: xf.laws.SignoriniCoulomb(xf.library.FRICTION, contact="position")
        },
        loads=[xf.PrescribedVelocity(LEFT, 0, -SPEED), xf.PrescribedVelocity(RIGHT, 0, SPEED)],
        initial_velocity=lambda x: np.array([SPEED * (2.0 * x[0] / SIZE - 1.0), 0.0 * x[0]]),
    )


# ## One run
#
# Crack patterns are drawn twice: after the first crack (`--early-strain`), when deflection or
# penetration is decided, and at the end.


def run(scene: xf.Scene, folder: Path, options: argparse.Namespace, title: str) -> dict:
    """Run a scene into a folder; returns what the figures need."""
    simulation = xf.Simulation(
        scene,
        options.step_size,
        accuracy=options.accuracy,
        scheme=options.scheme,
        theta=options.theta,
        tolerance=options.tolerance,
        solver=options.solver,
        num_threads=options.threads,
    )
    end = options.final_strain * SIZE / (2.0 * SPEED)
    gauge = xf.TensileGauge(LEFT, RIGHT, 0, SIZE, SIZE)
    recorder = xf.Recorder(
        simulation,
        folder,
        end_time=end,
        gauge=gauge,
        fields=options.fields,
        parameters=vars(options) | {"title": title},
        checkpoint_every=options.checkpoint_every,
        restart=options.restart,
    )
    early = None
    for _, strain in xf.recorded_steps(recorder, end, title, options.quiet, options.profile):
        if early is None and strain >= options.early_strain:
            early = panel(recorder, f"{title}, {100 * strain:.2f} %")
    final = panel(recorder, f"{title}, {100 * recorder.strain:.2f} %")
    early = early or final
    report(simulation, early, final, folder, title)
    return {
        "title": title,
        "history": xf.read_history(folder / "history.csv"),
        "lengths": final.crack_lengths(),
        "early": early,
        "final": final,
        "verdict": simulation.verdict(),
    }


def panel(recorder: xf.Recorder, title: str) -> xf.plotting.CrackPanel:
    """The cracked plate as it is now."""
    return xf.output.crack_panel(
        recorder, xf.output.find_cracks(recorder.simulation, INCLUSION, (NOTCH,)), title
    )


def report(
    simulation: xf.Simulation,
    early: xf.plotting.CrackPanel,
    final: xf.plotting.CrackPanel,
    folder: Path,
    title: str,
) -> None:
    """Say what decides between deflection and penetration, and what the run cost."""

    def lengths_of(panel: xf.plotting.CrackPanel) -> str:
        return ", ".join(f"{1e6 * v:.0f} um in {k}" for k, v in panel.crack_lengths().items())

    history = xf.read_history(folder / "history.csv")
    peak = int(np.argmax(history["stress"]))
    last = {name: column[-1] for name, column in history.items()}
    lost = sum(last[name] for name in history if name.startswith("dissipated"))
    tqdm.write(
        f"\n{title}: peak {history['stress'][peak] / 1e6:.0f} MPa at "
        f"{100 * history['strain'][peak]:.2f} %"
        f"\ncracks at first: {lengths_of(early)}; at the end: {lengths_of(final)}"
        f"\nenergy (mJ/m): external work {1e3 * last['external_work']:.3f}, dissipated "
        f"{1e3 * lost:.3f}, of which cracks {1e3 * last['dissipated_cohesion']:.4f}, friction "
        f"{1e3 * last['dissipated_friction']:.3f}, closing lips "
        f"{1e3 * last['dissipated_impact']:.3f}; closure error "
        f"{last['closure'] / last['external_work']:.1e} of the work"
    )
    tqdm.write(xf.cohesive_table(simulation))
    tqdm.write(xf.effects_table(simulation))
    found = {
        "crack_length": final.crack_lengths(),
        "early_crack_length": early.crack_lengths(),
        "peak_stress": history["stress"][peak],
    }
    xf.add_to_summary(simulation, found)


# ## Figures


def draw(results: list[dict], folder: Path) -> None:
    """Figures 8 to 10 of the paper, and the energies."""
    whole = results[0]["early"]
    notch = np.array([[[SIZE / 2, 0.0], [SIZE / 2, PRECRACK * UNIT]]])
    xf.plotting.plot_microstructure(
        whole.points, whole.triangles, whole.material, notch, folder / "microstructure.png"
    )
    xf.plotting.plot_cracks([r["early"] for r in results], path=folder / "cracks.png")
    xf.plotting.plot_cracks([r["final"] for r in results], path=folder / "cracks_final.png")
    xf.plotting.plot_curves(
        [(r["title"], r["history"]["strain"], r["history"]["stress"]) for r in results],
        folder / "stress_strain.png",
    )
    for r in results:
        name = r["title"].split()[0]
        note = r["verdict"].text if r["verdict"] else ""
        xf.plotting.plot_energies(
            r["history"], folder / f"energies_{name}.png", title=r["title"], note=note
        )


# ## Command line


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Options of the demo."""
    parser = argparse.ArgumentParser(description="Fracture of a notched composite plate.")
    add = parser.add_argument
    add("--cells", type=int, default=40, help="quads a side, a multiple of 20 (default 40)")
    add("--interface", choices=("weak", "strong", "both"), default="both")
    add("--layout", choices=tuple(LAYOUTS), default="bands", help="of the inclusions")
    add("--homogeneous", action="store_true", help="no inclusions")
    add("--resolved", action="store_true", help="cohesive length of at least 4 facets")
    add("--bonds", choices=("elastic", "rigid"), default="elastic", help="before they weaken")
    add("--finite-strain", action="store_true", help="neo-Hookean phases")
    add("--scheme", choices=("implicit", "explicit"), help="of the bulk")
    add("--step-size", type=float, help="h in s (default: picked)")
    add("--final-strain", type=float, default=0.012)
    add("--early-strain", type=float, default=0.005, help="when the first cracks are drawn")
    xf.add_run_options(parser, Path("results/notched_plate"), accuracy=1e-2)
    options = parser.parse_args(arguments)
    if options.cells < 20 or options.cells % 20:
        parser.error(f"--cells should be a multiple of 20, to fit inclusions, got {options.cells}")
    if not 0.0 < options.final_strain < 1.0:
        parser.error(f"--final-strain should lie in (0, 1), got {options.final_strain}")
    return options


# The resolved variant scales the matrix's cohesive length to seven facets of a 20 x 20 plate, and
# so the inclusions' and the weak interface's, half as long, to four at least; finer plates resolve
# them by more, with the same parameters, so that they can be compared.

RESOLVED_LENGTH = 7 * UNIT


def toughening() -> float:
    """Factor on fracture energies that makes the matrix's cohesive length RESOLVED_LENGTH."""
    modulus = xf.library.ZIRCALOY_4.young / (1.0 - xf.library.ZIRCALOY_4.poisson**2)
    length = (
        modulus * xf.library.ZIRCALOY_BOND.fracture_energy / xf.library.ZIRCALOY_BOND.strength**2
    )
    return RESOLVED_LENGTH / length


def main(arguments: list[str] | None = None) -> list[dict]:
    """Run the variants asked for, each into its own folder, and draw them."""
    options = parse(arguments)
    logging.basicConfig(level=logging.WARNING)
    xf.prepare_folder(options.out)
    names = ["weak", "strong"] if options.interface == "both" else [options.interface]
    if options.homogeneous:
        names = ["homogeneous"]
    results = []
    for name in names:
        scene = notched_plate(
            options.cells,
            "strong" if options.homogeneous else name,
            finite_strain=options.finite_strain,
            homogeneous=options.homogeneous,
            toughening=toughening() if options.resolved else 1.0,
            layout=options.layout,
            rigid=options.bonds == "rigid",
        )
        title = name if options.homogeneous else f"{name} interface"
        results.append(run(scene, options.out / name, options, title))
    if not options.no_plot:
        draw(results, options.out)
    return results


if __name__ == "__main__":
    xf.run_together(main)
