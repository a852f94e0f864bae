# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mixed-mode bending of a laminate: the load at which it delaminates, from pure opening to shear.

    ./fenicsx python3 benchmarks/mixed_mode_bending.py [--shares 0 0.2 0.5 0.8 1] [--length 0.25]

Two arms of a carbon laminate (AS4/PEEK: G_I 969, G_II 1719 J/m^2, strengths 80 and 100 MPa,
exponent 2.284 of Benzeggagh and Kenane; Reeder and Crews 1990, Camanho and Davila 2002) joined by a
`MixedMode` bond but for a crack of 33.7 mm. A lever of length c pulls the end of the upper arm up
by P c / L and pushes it down in the middle by P (1 + c / L); c tells the share of shear B. Without
lever the ends are pulled apart (B = 0), or the middle alone is pushed (B = 1). The load is followed
along the crack's path in static steps (`path=xf.GrowthControl()`).

The load of each step is compared, at the crack length a that gives its compliance C, with

    lefm    sqrt(2 G(B) / C'(a)), C(a) from elastic runs of several crack lengths;
    beam    the load at which the corrected beam theory (Reeder 1992; Williams 1989) has G(B):
            G_I = 3 P^2 (3c - L)^2 (a + chi h)^2 / (4 h^3 L^2 E),
            G_II = 9 P^2 (c + L)^2 (a + 0.42 chi h)^2 / (16 h^3 L^2 E),
            chi^2 = E / (11 G13) (3 - 2 (g / (1 + g))^2), g = 1.18 sqrt(E E2) / G13.

All loads are per metre of width.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from dolfinx.mesh import CellType, create_rectangle
from mpi4py import MPI

import xper_fx as xf

HALF_SPAN, ARM, CRACK = 51e-3, 1.56e-3, 33.7e-3  # L, h, a0 (m)
E1, E2, G12, NU12, NU23, G23 = 122.7e9, 10.1e9, 5.5e9, 0.25, 0.45, 3.7e9  # Pa
ENERGIES, STRENGTHS, EXPONENT = (969.0, 1719.0), (80e6, 100e6), 2.284
STIFFNESS = 1e14  # of the bond (Pa/m)
UPPER_END, LOWER_END, FAR_END, MIDDLE, FOOT, CRACKED = range(1, 7)


@dataclass(frozen=True)
class Bending:
    """Loads of a share of shear, per unit of P.

    Attributes:
        lever: c (m); 0 where the middle alone is pushed, None where the ends are pulled apart.
    """

    lever: float | None

    @classmethod
    def of(cls, share: float) -> Bending:
        """The lever that gives a share of shear at the start of the crack."""
        if share in (0.0, 1.0):
            return cls(None if share == 0.0 else 0.0)
        ratio = (CRACK + 0.42 * CHI * ARM) / (CRACK + CHI * ARM)
        q = np.sqrt(share / (1.0 - share) * 4.0 / 3.0) / ratio
        return cls(HALF_SPAN * (1.0 + q) / (3.0 * q - 1.0))

    @property
    def forces(self) -> tuple[float, float]:
        """On the end of the upper arm, up, and in the middle, down."""
        if self.lever is None:
            return 1.0, 0.0
        return self.lever / HALF_SPAN, 1.0 + self.lever / HALF_SPAN

    def rates(self, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """G_I and G_II (J/m^2) of corrected beam theory for P = 1 N/m and crack lengths a (m)."""
        opened, sheared = (a + CHI * ARM) ** 2, (a + 0.42 * CHI * ARM) ** 2
        if self.lever is None:
            return 12.0 * opened / (ARM**3 * E1), np.zeros_like(a)
        c, span = self.lever, HALF_SPAN
        second = 9.0 * (c + span) ** 2 / (16.0 * ARM**3 * span**2 * E1) * sheared
        if c == 0.0:
            return np.zeros_like(a), second
        return 3.0 * (3.0 * c - span) ** 2 / (4.0 * ARM**3 * span**2 * E1) * opened, second

    def share(self, a: np.ndarray) -> np.ndarray:
        """B at crack lengths a (m)."""
        first, second = self.rates(a)
        return second / (first + second)


def _chi() -> float:
    g = 1.18 * np.sqrt(E1 * E2) / G12
    return float(np.sqrt(E1 / (11.0 * G12) * (3.0 - 2.0 * (g / (1.0 + g)) ** 2)))


CHI = _chi()


def toughness(share: np.ndarray) -> np.ndarray:
    """G(B) of Benzeggagh and Kenane, J/m^2."""
    return ENERGIES[0] + (ENERGIES[1] - ENERGIES[0]) * share**EXPONENT


def specimen(
    crack: float, length: float, bending: Bending, bond: xf.laws.Law, load: Callable
) -> xf.Scene:
    """Two arms of quadratic quadrilaterals, of two rows each; lips of the crack do not touch.

    Args:
        crack: its length (m).
        length: of the facets along the arms (m).
        bending: the loads.
        bond: beyond the crack.
        load: P (N/m) of the time.
    """
    columns = 2 * round(HALF_SPAN / length)
    corners = [[0.0, -ARM], [2.0 * HALF_SPAN, ARM]]
    mesh = create_rectangle(MPI.COMM_SELF, corners, [columns, 4], CellType.quadrilateral)
    size, rounding = HALF_SPAN * 2.0 / columns, 1e-9

    def at(value, wanted):
        return np.abs(value - wanted) < rounding

    tags = xf.tag_facets(
        mesh,
        {
            UPPER_END: lambda x: at(x[0], 0.0) & (x[1] > -rounding),
            LOWER_END: lambda x: at(x[0], 0.0) & (x[1] < rounding),
            FAR_END: lambda x: at(x[0], 2.0 * HALF_SPAN) & (x[1] < rounding),
            MIDDLE: lambda x: at(x[1], ARM) & (np.abs(x[0] - HALF_SPAN) < size + rounding),
            FOOT: lambda x: at(x[1], -ARM) & (x[0] < size + rounding),
            CRACKED: lambda x: at(x[1], 0.0) & (x[0] < crack + rounding),
        },
    )
    arm = mesh.geometry.x[xf.geometry_dofmap(mesh)].mean(axis=1)[:, 1] > 0.0
    end, middle = bending.forces
    loads = [
        xf.PrescribedDisplacement(LOWER_END, 1, 0.0),
        xf.PrescribedDisplacement(FAR_END, 1, 0.0),
        xf.PrescribedDisplacement(FOOT, 0, 0.0),
    ]
    if end:
        loads.append(xf.SurfaceTraction(UPPER_END, (0.0, lambda t: end * load(t) / ARM)))
    else:  # each arm bears half, as if their ends touched
        loads.append(xf.PrescribedDisplacement(UPPER_END, 1, 0.0))
    if middle:
        loads.append(xf.SurfaceTraction(MIDDLE, (0.0, lambda t: -middle * load(t) / (2.0 * size))))
    laminate = xf.materials.Orthotropic((E1, E2, E2), (NU12, NU12, NU23), (G12, G12, G23), 1600.0)
    return xf.Scene(
        xf.explode(mesh, arm.astype(int), None, tags), {1: laminate}, default_interaction=bond,
        facet_interactions={CRACKED: None}, loads=loads, order=2,
    )  # fmt: skip


def opening(simulation: xf.Simulation, bending: Bending) -> float:
    """Displacement (m) that works with P: of the end up, less that of the middle."""
    end, middle = bending.forces
    return end * simulation.mean_displacement(UPPER_END)[1] - (
        middle * simulation.mean_displacement(MIDDLE)[1]
    )


def compliances(bending: Bending, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Crack lengths (m) and compliances (m^2/N) of elastic runs."""
    cracks, found = np.arange(28e-3, 47e-3, 3e-3), []
    strong = xf.laws.MixedMode(STIFFNESS, (1e12, 1e12), (1e12, 1e12), EXPONENT)
    for crack in cracks:
        scene = specimen(crack, length, bending, strong, lambda t: 1e3 * t)
        simulation = xf.Simulation(scene, 1.0, inertia=False)
        for _ in simulation.steps(1.0):
            found.append(1e-3 * opening(simulation, bending))
    return cracks, np.array(found)


def delaminate(bending: Bending, length: float, most: float) -> np.ndarray:
    """Rows of P (N/m) and the displacement that works with it (m) along the path.

    Args:
        bending: the loads.
        length: of the facets (m).
        most: compliance (m^2/N) at which the crack is long enough.
    """
    bond = xf.laws.MixedMode(STIFFNESS, STRENGTHS, ENERGIES, EXPONENT)
    scene = specimen(CRACK, length, bending, bond, lambda t: 1e4 * t)
    simulation = xf.Simulation(scene, 1.0, inertia=False, path=xf.GrowthControl())
    rows = [(0.0, 0.0)]
    for record in simulation.steps(1e6):
        rows.append((1e4 * record.time, opening(simulation, bending)))
        if rows[-1][1] > most * rows[-1][0]:
            return np.array(rows)
    return np.array(rows)


def compare(share: float, length: float) -> dict[str, np.ndarray]:
    """The run of a share of shear beside theory, where the crack has grown by 2 to 8 mm."""
    bending = Bending.of(share)
    cracks, found = compliances(bending, length)
    # beams: a cubic of the crack length
    fit = np.polynomial.Polynomial.fit(cracks, found, 3)
    rows = delaminate(bending, length, fit(CRACK + 9e-3))
    lengths = np.linspace(cracks[0], cracks[-1], 2001)
    load, displacement = rows[1:].T
    a = np.interp(displacement / load, fit(lengths), lengths)
    wanted = toughness(bending.share(a))
    beam = np.sqrt(wanted / sum(bending.rates(a)))
    lefm = np.sqrt(2.0 * wanted / fit.deriv()(a))
    grown = (a > CRACK + 2e-3) & (a < CRACK + 8e-3)
    peak = load.max(initial=0.0, where=a < CRACK + 8e-3)
    at_start = np.sqrt(toughness(bending.share(np.array(CRACK))) / sum(bending.rates(CRACK)))
    line = np.stack([beam * displacement / load, beam])
    return {
        "rows": rows, "lefm": load[grown] / lefm[grown], "beam": load[grown] / beam[grown],
        "peak": np.array(peak), "start": at_start, "line": line[:, a > CRACK],
    }  # fmt: skip


def draw(found: dict[float, dict], out: Path) -> None:
    """Loads against displacements, beside what beam theory says of a growing crack."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6.5, 4.2), layout="constrained")
    for share, curves in found.items():
        load, displacement = curves["rows"].T
        (line,) = axes.plot(1e3 * displacement, 1e-3 * load, label=f"{100 * share:.0f} % of shear")
        displacement, load = curves["line"]
        axes.plot(1e3 * displacement, 1e-3 * load, "--", color=line.get_color())
    axes.plot([], [], "k--", label="corrected beam theory")
    axes.set(xlabel="displacement that works with P (mm)", ylabel="P (kN/m)", xlim=(0, None),
             ylim=(0, None))  # fmt: skip
    axes.legend(frameon=False)
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "mixed_mode_bending.png", dpi=150)


def main(arguments: list[str] | None = None) -> dict[float, dict]:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--shares", type=float, nargs="+", default=[0.0, 0.2, 0.5, 0.8, 1.0])
    parser.add_argument("--length", type=float, default=0.25, help="of the facets (mm)")
    parser.add_argument("--out", type=Path, default=Path("results/mixed_mode_bending"))
    parser.add_argument("--no-plot", action="store_true")
    options = parser.parse_args(arguments)
    print("| shear | steps | P / that of its compliance | P / beam theory | peak / beam theory |")
    print("|---:|---:|---:|---:|---:|")
    found = {}
    for share in options.shares:
        curves = found[share] = compare(share, 1e-3 * options.length)
        lefm, beam = (
            f"{curves[name].min():.3f} to {curves[name].max():.3f}" for name in ("lefm", "beam")
        )
        peak = float(curves["peak"] / curves["start"])
        steps = len(curves["rows"]) - 1
        print(f"| {100 * share:.0f} % | {steps} | {lefm} | {beam} | {peak:.3f} |", flush=True)
    if not options.no_plot:
        draw(found, options.out)
    return found


if __name__ == "__main__":
    main()
