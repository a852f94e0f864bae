# SPDX-License-Identifier: LGPL-3.0-or-later
# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A material of one's own: creep of a metal with voids
#
# This demo illustrates how to:
#
# - write a material with an internal variable in ten lines of UFL
# - mesh a periodic cell with a void, and run it without inertia
# - check the material against an integration that shares nothing with it
#
# The solid creeps by Norton's law: besides the elastic strain there is a viscous one, `flow`,
#
#     sigma = kappa tr(eps) I + s,    s = 2 mu (dev eps - flow),    q = sqrt(3/2 s : s),
#     flow' = 3/2 r0 (q / K)^n s / q.
#
# Backward Euler over a step h keeps the direction of the trial stress s* = 2 mu (dev eps - flow0)
# and shortens it, s = x s*, where x in (0, 1] is the root of
#
#     x + C x^n = 1,    C = 3 mu h r0 / K (q* / K)^(n - 1).
#
# That is convex in x, and (1 + C)^(-1/n) is above the root, so that Newton goes down to it without
# fail; written out, it needs no loop in the assembly, and UFL differentiates through it.
#
# Fbar_11 grows at a constant rate with Pibar_22 = 0, Fbar_12 = Fbar_21 = 0. Without a void the
# stress tends to 2 / sqrt(3) K (2 rate / (sqrt(3) r0))^(1/n); voids lower it by more than the
# section they take.

import argparse
import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import ufl
from mpi4py import MPI
from scipy.integrate import solve_ivp
from tqdm.auto import tqdm

import xper_fx as xf

# ## The material
#
# A class with these members is all that a scene asks for. The ten lines are those of `response`.

# What is left after them is below rounding, for any C, with exponents up to 20.
NEWTON_STEPS = 6


@dataclass(frozen=True)
class Norton:
    """Elastic solid that creeps by a power law, at small strain (plane strain in 2D).

    Args:
        shear, bulk: moduli mu and kappa (Pa).
        reference: stress K (Pa) at which it creeps at the rate r0 (1/s) in tension.
        rate: r0.
        exponent: n, from 3 to 20.
        density: rho (kg/m^3).
    """

    shear: float
    bulk: float
    reference: float
    rate: float
    exponent: float
    density: float = 8000.0
    linear = False
    variables = {"flow": ((0.0, 0.0, 0.0),) * 3}

    def response(self, u, old, step, constant) -> xf.materials.Response:
        """See `InelasticMaterial`."""
        mu, kappa, K, r0 = map(constant, (self.shear, self.bulk, self.reference, self.rate))
        n, strain = self.exponent, xf.kinematics.small_strain(u)
        trial = 2.0 * mu * (ufl.dev(strain) - old["flow"])
        C = 3.0 * mu * step * r0 / K * (1.5 * ufl.inner(trial, trial) / K**2) ** (0.5 * (n - 1.0))
        x = (1.0 + C) ** (-1.0 / n)
        for _ in range(NEWTON_STEPS):
            x -= (x + C * x**n - 1.0) / (1.0 + n * C * x ** (n - 1.0))
        s, flow = x * trial, old["flow"] + (1.0 - x) * trial / (2.0 * mu)
        stress = kappa * ufl.tr(strain) * ufl.Identity(3) + s
        stored = 0.5 * kappa * ufl.tr(strain) ** 2 + ufl.inner(s, s) / (4.0 * mu)
        lost = ufl.inner(s, flow - old["flow"])
        return xf.materials.Response(stress, stress, stored, {"flow": flow}, viscous=lost)


def hot_metal(exponent: float) -> Norton:
    """A metal of E = 100 GPa, nu = 0.3 that creeps at 1e-3 /s under 200 MPa."""
    young, poisson = 100e9, 0.3
    return Norton(
        shear=young / (2.0 * (1.0 + poisson)),
        bulk=young / (3.0 * (1.0 - 2.0 * poisson)),
        reference=200e6,
        rate=1e-3,
        exponent=exponent,
    )


# ## The same without UFL
#
# In the homogeneous solid sigma_22 = 0 gives eps_22, and two components of the flow are left to
# integrate. Runge-Kutta of order eight does it to ten digits.

RATE = 1e-3
FINAL_STRAIN = 0.02
STEPS = 200


def integrate(material: Norton, times: np.ndarray) -> np.ndarray:
    """sigma_11 (Pa) of the homogeneous solid at some times (s)."""
    mu, kappa = material.shear, material.bulk

    def stress(t, flow):
        """Principal stresses; flow holds the components 11 and 22."""
        along, a = RATE * t, kappa - 2.0 * mu / 3.0
        across = (2.0 * mu * flow[1] - a * along) / (a + 2.0 * mu)
        strain, whole = np.array([along, across, 0.0]), np.array([*flow, -flow[0] - flow[1]])
        return a * strain.sum() + 2.0 * mu * (strain - whole)

    def creep(t, flow):
        sigma = stress(t, flow)
        s = sigma - sigma.mean()
        q = np.sqrt(1.5 * s @ s)
        speed = 1.5 * material.rate * (q / material.reference) ** (material.exponent - 1.0)
        return speed * s[:2] / material.reference

    run = solve_ivp(
        creep, (0.0, times[-1]), np.zeros(2), "DOP853", t_eval=times, rtol=1e-10, atol=1e-14
    )
    return np.array([stress(t, flow)[0] for t, flow in zip(run.t, run.y.T, strict=True)])


def limit(material: Norton) -> float:
    """Stress (Pa) that sigma_11 of the homogeneous solid tends to."""
    ratio = 2.0 * RATE / (np.sqrt(3.0) * material.rate)
    return 2.0 / np.sqrt(3.0) * material.reference * ratio ** (1.0 / material.exponent)


# ## Cells
#
# Sides are cut into equal pieces, so that each node on one has its translate on the other. The
# void's edge bears a tag of its own, for a cell whose boundary has facets without a translate is
# refused unless they are said to be a void's.

SIZE = 1e-3
VOID = 7


def cell(pieces: int, fraction: float) -> xf.Bodies:
    """A square cell in `pieces` a side, with a round void of an area fraction; one body."""
    options = {"Mesh.MeshSizeMax": 1.0 / pieces}
    with xf.gmsh_model("cell with a void", options) as gmsh:
        occ, radius = gmsh.model.occ, np.sqrt(fraction / np.pi)
        square = (2, occ.addRectangle(-0.5, -0.5, 0.0, 1.0, 1.0))
        if fraction > 0.0:
            occ.cut([square], [(2, occ.addDisk(0.0, 0.0, 0.0, radius, radius))])
        occ.synchronize()
        edge = []
        for _, curve in gmsh.model.getEntities(1):
            x = gmsh.model.getBoundingBox(1, curve)
            if max(map(abs, (x[0], x[1], x[3], x[4]))) > 0.4999:
                gmsh.model.mesh.setTransfiniteCurve(curve, pieces + 1)
            else:
                edge.append(curve)
                gmsh.model.mesh.setTransfiniteCurve(
                    curve, max(13, round(3.0 * np.pi * radius * pieces))
                )
        gmsh.model.addPhysicalGroup(2, [tag for _, tag in gmsh.model.getEntities(2)], 1)
        if edge:
            gmsh.model.addPhysicalGroup(1, edge, VOID)
        gmsh.model.mesh.generate(2)
        mesh, _, facet_tags = xf.read_gmsh(gmsh.model, 2, MPI.COMM_SELF)
    mesh.geometry.x[:] *= SIZE
    one = np.zeros(mesh.topology.index_map(2).size_local, int)
    return xf.explode(
        mesh, one, facet_tags=facet_tags, lattice=(SIZE, SIZE), voids=[VOID] if edge else []
    )


def simulate(bodies: xf.Bodies, material: Norton, steps: int) -> xf.Simulation:
    """The cell, pulled without inertia; quadratic triangles, as the flow keeps the volume."""
    drive = xf.MacroscopicDrive(
        rate={"11": RATE}, gradient={"12": 0.0, "21": 0.0}, stress={"22": 0.0}
    )
    scene = xf.Scene(bodies, {1: material}, macroscopic=drive, order=2)
    return xf.Simulation(scene, FINAL_STRAIN / RATE / steps, theta=1.0, inertia=False)


def homogeneous_curve(material: Norton, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (s), strains and stresses (Pa) of the cell without a void."""
    simulation = simulate(cell(1, 0.0), material, steps)
    rows = [
        (step.time, *xf.CellGauge("11").read(simulation))
        for step in simulation.steps(FINAL_STRAIN / RATE)
    ]
    return tuple(np.array(rows).T)


def check(material: Norton) -> tuple[tuple, list[float]]:
    """The homogeneous curve, and its largest error beside the limit, with STEPS and twice that."""
    errors, curves = [], []
    for steps in (STEPS, 2 * STEPS):
        curves.append(homogeneous_curve(material, steps))
        time, _, stress = curves[-1]
        errors.append(float(np.abs(stress - integrate(material, time)).max() / limit(material)))
    return curves[0], errors


def run(material: Norton, options: argparse.Namespace) -> dict:
    """The cell with its void, into the folder."""
    simulation = simulate(cell(options.cells, options.void), material, STEPS)
    end = FINAL_STRAIN / RATE
    parameters = {key: str(v) if isinstance(v, Path) else v for key, v in vars(options).items()}
    recorder = xf.Recorder(
        simulation, options.out, end_time=end, gauge=xf.CellGauge("11"), fields=10,
        parameters=parameters,
    )  # fmt: skip
    curve = [(0.0, 0.0)]
    for _, strain in xf.recorded_steps(recorder, end, "cell with a void", options.quiet):
        curve.append((strain, simulation.macroscopic.stress[0, 0]))
    return {
        "simulation": simulation,
        "strain": np.array(curve)[:, 0],
        "stress": np.array(curve)[:, 1],
        "triangles": recorder.cells,
        "displacement": recorder.vertex_displacement(),
        "energies": simulation.ledger.as_columns(),
    }


def report(result: dict, material: Norton, options: argparse.Namespace) -> None:
    """Say how far the material is from the integration, and what the void costs."""
    errors, simulation, energies = result["errors"], result["simulation"], result["energies"]
    ratio = result["stress"][-1] / limit(material)
    closure = energies["closure"] / energies["external_work"]
    stress = simulation.macroscopic.stress
    tqdm.write(
        f"\nhomogeneous solid against the integration: largest error {errors[0]:.1e} of the limit "
        f"with {STEPS} steps, {errors[1]:.1e} with {2 * STEPS}; at the end "
        f"{result['homogeneous'][2][-1] / 1e6:.2f} MPa, limit {limit(material) / 1e6:.2f} MPa"
        f"\nwith a void of {100 * options.void:.1f} %: {result['stress'][-1] / 1e6:.2f} MPa, "
        f"{ratio:.4f} of the limit; |P22| {abs(stress[1, 1]):.1e} Pa"
        f"\nenergy (J/m): external work {energies['external_work']:.4f}, stored "
        f"{energies['elastic']:.4f}, viscous {energies['dissipated_viscous']:.4f}; closure error "
        f"{closure:.1e} of the work (of first order in the step)"
    )
    tqdm.write(xf.effects_table(simulation))
    found = {"errors_of_the_homogeneous_solid": errors, "stress_over_limit": ratio}
    xf.add_to_summary(simulation, found)


# ## Figures


def equivalent_flow(simulation: xf.Simulation) -> np.ndarray:
    """sqrt(2/3 flow : flow), mean of each cell."""
    flow = simulation.forms.history()["flow 1"]  # 11, 22, 33, 12
    return np.sqrt(2.0 / 3.0 * (flow**2 @ np.array([1.0, 1.0, 1.0, 2.0]))).mean(axis=1)


def draw(result: dict, material: Norton, out: Path) -> None:
    """Stress against strain; where the cell flows."""
    from matplotlib.figure import Figure
    from matplotlib.tri import Triangulation

    time, strain, stress = result["homogeneous"]
    few = np.arange(7, len(time), 8)
    xf.plotting.plot_curves(
        [
            ("with a void", result["strain"], result["stress"]),
            ("homogeneous", np.insert(strain, 0, 0.0), np.insert(stress, 0, 0.0)),
            ("integrated apart", strain[few], integrate(material, time)[few],
             {"linestyle": "none", "marker": "o", "markersize": 3.5, "markerfacecolor": "none"}),
        ],
        out / "stress_strain.png",
    )  # fmt: skip
    x = result["simulation"].scene.bodies.mesh.geometry.x[:, :2] + result["displacement"]
    figure = Figure(figsize=(4.8, 4.0), layout="constrained")
    axes = figure.subplots()
    mesh = Triangulation(1e3 * x[:, 0], 1e3 * x[:, 1], triangles=result["triangles"])
    flow = axes.tripcolor(mesh, 100.0 * equivalent_flow(result["simulation"]), cmap="viridis")
    axes.set_aspect("equal")
    axes.set_xlabel("x (mm)")
    axes.set_ylabel("y (mm)")
    figure.colorbar(flow, label="equivalent viscous strain (%)")
    figure.savefig(out / "flow.png", dpi=160)


# ## Command line


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Options of the demo."""
    parser = argparse.ArgumentParser(description="Creep of a metal with voids.")
    add = parser.add_argument
    add("--cells", type=int, default=24, help="triangles along a side (default 24)")
    add("--void", type=float, default=0.1, help="area fraction of the void (default 0.1)")
    add("--exponent", type=float, default=5.0, help="of Norton's law (default 5)")
    add("--out", type=Path, default=Path("results/own_material"))
    add("--no-plot", action="store_true")
    add("--quiet", action="store_true", help="no progress bar")
    options = parser.parse_args(arguments)
    if options.cells < 2:
        parser.error(f"--cells should be at least 2, got {options.cells}")
    if not 0.001 <= options.void <= 0.5:
        parser.error(f"--void should lie in [0.001, 0.5], got {options.void}")
    if not 3.0 <= options.exponent <= 20.0:
        parser.error(f"--exponent should lie in [3, 20], got {options.exponent}")
    return options


def main(arguments: list[str] | None = None) -> dict:
    """Check the material, run the cell with a void, draw both."""
    options = parse(arguments)
    logging.basicConfig(level=logging.WARNING)
    xf.prepare_folder(options.out)
    material = hot_metal(options.exponent)
    homogeneous, errors = check(material)
    result = run(material, options) | {"homogeneous": homogeneous, "errors": errors}
    report(result, material, options)
    if not options.no_plot:
        draw(result, material, options.out)
    return result


if __name__ == "__main__":
    xf.run_together(main)
