# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of a cylinder and of a sphere with a rigid plane, and its partial slip, beside theory.

    OPENBLAS_NUM_THREADS=1 ./fenicsx python3 benchmarks/hertz.py [--figure docs/hertz.png]

An elastic body with a round underside of radius R, held at its top, is pressed on a rigid plane:
static, one body of many cells, contact and friction on the nodes of its underside. With
E* = E / (1 - nu^2) (Hertz 1882; Johnson 1985, chapter 4), the force P and the approach d:

- line contact (plane strain, P per metre): p = p0 sqrt(1 - x^2 / a^2), a = sqrt(4 P R / (pi E*)),
  p0 = 2 P / (pi a);
- point contact: p = p0 sqrt(1 - r^2 / a^2), a = (3 P R / (4 E*))^(1/3), p0 = 3 P / (2 pi a^2),
  P = 4/3 E* sqrt(R) d^(3/2). In 2D the approach hangs on the whole body: P is read, not given.

A force Q < mu P is then put on along the plane (Cattaneo 1938; Mindlin 1949; Johnson 1985,
section 7.2). A line contact sticks where |x| < c, and slips round it:

    c / a = sqrt(1 - Q / (mu P)),   q = mu p - mu p0 (c / a) sqrt(1 - x^2 / c^2) if |x| < c.

That holds if pressure makes nothing slide. A rigid plane gives this up by Dundurs' constant
beta = (1 - 2 nu) / (2 (1 - nu)): pressing shears the contact by about beta p, an odd function of x
(Spence 1975). So nu = 0.495 here, beta = 0.0099, and of q the part even in x is compared, from
which what is of first order in beta drops out. Crossed triangles hardly lock.

a, p0 and c are measured without counting nodes, by straight lines through p^2 over x^2 where
|x| < 0.9 a, and through (mu p - q)^2 over x^2 where |x| < 0.9 c, and compared with theory for the P
and Q found. The edges of contact and of stick fall anywhere within an element: errors are root mean
squares over loads for which a goes through one element in equal parts, or over the steps of Q.

The mesh is even from the middle to 1.5 a (3D: 1.25 a) and half of a deep; from there the cells grow
to the sides and the top, 200 a away.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from dolfinx import fem
from dolfinx.mesh import CellType, create_box
from mpi4py import MPI

from xper_fx.bodies.explode import Bodies, explode
from xper_fx.bodies.meshes import crossed_rectangle, tag_facets
from xper_fx.forms.loads import PrescribedDisplacement
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import SignoriniCoulomb
from xper_fx.scene import Scene, Wall
from xper_fx.simulation.simulation import Simulation

YOUNG, DENSITY = 210e9, 7800.0
HALF_WIDTH = 1e-3  # a that is aimed at (m)
RADIUS, SIZE = 400 * HALF_WIDTH, 200 * HALF_WIDTH
POISSON, SLIP_POISSON, FRICTION = 0.3, 0.495, 0.5
CONTACT, TOP, MIDDLE_X, MIDDLE_Y = 1, 2, 3, 4
PARTS = {2: 2, 3: 4}  # of a body that is cut at its middle planes
NUM_LOADS, SLIP_LOADS = 8, 10
# Of the contact or of the stick zone, what the straight lines are put through.
_INSIDE = 0.9


# -- the body


def graded(elements: int, even: float, growth: float) -> np.ndarray:
    """Coordinates from 0 to SIZE (m): `elements` in a up to `even` a, then growing cells."""
    fine, left = HALF_WIDTH / elements, SIZE - even * HALF_WIDTH
    count = np.log1p(left / fine * (growth - 1.0) / growth) / np.log(growth)
    sizes = growth ** np.arange(1, np.ceil(count) + 1)
    inner = np.linspace(0.0, even * HALF_WIDTH, round(even * elements) + 1)
    return np.concatenate([inner, inner[-1] + left / sizes.sum() * np.cumsum(sizes)])


def round_block(
    dim: int, elements: int, *, even: float = 1.5, growth: float = 1.1, whole: bool = False
) -> Bodies:
    """A block with a round underside that touches the plane through the origin.

    Args:
        dim: 2, crossed triangles; 3, hexahedra.
        elements: cells in a.
        even: to how many a from the middle the cells are of one size, and may touch the plane.
        growth: of the cells from there on.
        whole: whether both sides of the middle are there; else the half, or in 3D the quarter.
    """
    side, up = graded(elements, even, growth), graded(elements, 0.5, growth)
    across = np.concatenate([-side[:0:-1], side]) if whole else side
    axes = [across] * (dim - 1) + [up]
    cells = [len(axis) - 1 for axis in axes]
    corner = np.zeros(dim)
    if dim == 2:
        mesh = crossed_rectangle(corner, np.array(cells, float), cells, MPI.COMM_SELF)
    else:
        box = [corner, np.array(cells, float)]
        mesh = create_box(MPI.COMM_SELF, box, cells, CellType.hexahedron)
    g = mesh.geometry.x
    g[:, :dim] = np.stack(
        [np.interp(g[:, i], np.arange(len(axes[i])), axes[i]) for i in range(dim)], axis=1
    )
    near, edge = 1e-6 * HALF_WIDTH, (even + 1e-6) * HALF_WIDTH
    places = {
        CONTACT: lambda x: (x[dim - 1] < near) & np.all(np.abs(x[: dim - 1]) < edge, axis=0),
        TOP: lambda x: x[dim - 1] > SIZE - near,
    }
    if not whole:
        middles = (MIDDLE_X, MIDDLE_Y)[: dim - 1]
        places |= {tag: lambda x, i=i: x[i] < near for i, tag in enumerate(middles)}
    tags = tag_facets(mesh, places)
    sag = RADIUS - np.sqrt(RADIUS**2 - np.sum(g[:, : dim - 1] ** 2, axis=1))
    g[:, dim - 1] += (1.0 - g[:, dim - 1] / SIZE) * sag
    num_cells = mesh.topology.index_map(dim).size_local
    return explode(mesh, np.zeros(num_cells, int), facet_tags=tags)


def pressed(
    bodies: Bodies, poisson: float, friction: float, down: Sequence[float], across: Sequence[float]
) -> Simulation:
    """A static run of steps of 1 s in which the top goes to `down` and `across` (m), step by step.

    Bodies that are a half or a quarter are held in their middle planes instead of across.
    """
    dim = bodies.mesh.geometry.dim

    def through(path: Sequence[float]) -> Callable[[float], float]:
        return lambda t: float(np.interp(t, np.arange(len(path) + 1), [0.0, *path]))

    loads = [PrescribedDisplacement(TOP, dim - 1, through([-d for d in down]))]
    if MIDDLE_X in bodies.facet_tags.values:
        middles = (MIDDLE_X, MIDDLE_Y)[: dim - 1]
        loads += [PrescribedDisplacement(tag, i, 0.0) for i, tag in enumerate(middles)]
    else:
        loads.append(PrescribedDisplacement(TOP, 0, through(across)))
    up = np.eye(dim)[-1]
    law = SignoriniCoulomb(friction, contact="position")
    scene = Scene(
        bodies,
        {1: LinearElastic(YOUNG, poisson, DENSITY)},
        walls=[Wall(CONTACT, 0.0 * up, up, law)],
        loads=loads,
    )
    return Simulation(scene, 1.0, inertia=False, theta=1.0, tolerance=1e-8, num_threads=1)


@dataclass
class Reading:
    """What the points of contact bear at a step.

    Attributes:
        x: shape (num_points, dim - 1), places on the plane (m).
        p, q: pressure, and traction along -x (Pa).
        force, drag: their sums over the points P and Q (N; 2D: N/m), not yet over other quarters.
        area: of each point (m^2; 2D: m).
        sticks: whether a point in contact sticks.
    """

    x: np.ndarray
    p: np.ndarray
    q: np.ndarray
    force: float
    drag: float
    area: np.ndarray
    sticks: np.ndarray

    @property
    def square(self) -> np.ndarray:
        """x^2 or r^2, shape (num_points,)."""
        return np.sum(self.x**2, axis=1)


def reading(simulation: Simulation) -> Reading:
    """Read the points, in the order of x in 2D."""
    V, bodies = simulation.forms.V, simulation.scene.bodies
    dim, points = bodies.mesh.geometry.dim, simulation.interactions
    facets = bodies.facet_tags.find(CONTACT)
    nodes = np.unique(fem.locate_dofs_topological(V, dim - 1, facets))
    x = V.tabulate_dof_coordinates()[nodes, : dim - 1]
    order = np.argsort(x[:, 0])
    impulse, area = points.gather("impulse")[order], points.points.area[order]
    p, q = (impulse / simulation.step_size / area[:, None]).T[:2]
    sticks = points.gather("status")[order] == 1
    return Reading(x[order], p, q, p @ area, q @ area, area, sticks)


# -- theory


def plane_modulus(poisson: float) -> float:
    """E* of an elastic body on a rigid one (Pa)."""
    return YOUNG / (1.0 - poisson**2)


def hertz(dim: int, force: float, poisson: float) -> tuple[float, float]:
    """a (m) and p0 (Pa) under the force P (N; 2D: N/m)."""
    modulus = plane_modulus(poisson)
    if dim == 2:
        a = np.sqrt(4.0 * force * RADIUS / (np.pi * modulus))
        return a, 2.0 * force / (np.pi * a)
    a = (0.75 * force * RADIUS / modulus) ** (1.0 / 3.0)
    return a, 1.5 * force / (np.pi * a**2)


def dome(square: np.ndarray, radius: float) -> np.ndarray:
    """sqrt(1 - x^2 / a^2), zero outside."""
    return np.sqrt(np.maximum(1.0 - square / radius**2, 0.0))


def fitted_dome(square: np.ndarray, traction: np.ndarray, radius: float) -> tuple[float, float]:
    """Radius (m) and height (Pa) of the dome through tractions near that of a given radius."""
    inside = square < (_INSIDE * radius) ** 2
    slope, height2 = np.polyfit(square[inside], traction[inside] ** 2, 1)
    return np.sqrt(-height2 / slope), np.sqrt(height2)


# -- what is compared


def rms(values: Sequence[float]) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def approach(dim: int, half_widths: np.ndarray) -> np.ndarray:
    """How far to lower the top for a (m); in 2D about, of a half space that is cut at SIZE."""
    if dim == 3:
        return half_widths**2 / RADIUS
    deep = 2.0 * np.log(2.0 * SIZE / half_widths) - POISSON / (1.0 - POISSON)
    return half_widths**2 / (4.0 * RADIUS) * 1.1 * deep


def normal_errors(dim: int, elements: int, **mesh) -> tuple[dict[str, float], Reading]:
    """Errors of the frictionless contact, and what it bears at the last load.

    Args:
        dim: 2, cylinder; 3, sphere.
        elements: cells in a.
        mesh: options of `round_block`.

    Returns:
        nodes; relative errors, root mean squares over the loads: a and p0 (fitted), a2 (from the
        second moment of the pressure), profile (in L2), in 3D also law (P of d); in 3D exponent,
        of P over d from 0.5 a on.
    """
    steps = np.linspace(-0.5, 0.5, NUM_LOADS, endpoint=False)
    half_widths = HALF_WIDTH * (1.0 + steps / elements)
    if dim == 3:
        half_widths = np.concatenate([[0.5 * HALF_WIDTH], half_widths])
    down = approach(dim, half_widths)
    simulation = pressed(round_block(dim, elements, **mesh), POISSON, 0.0, down, [])
    moment = {2: 4.0, 3: 2.5}[dim]
    found: dict[str, list[float]] = {name: [] for name in ("a", "p0", "a2", "profile", "law")}
    forces = []
    for _ in simulation.steps(len(down)):
        now = reading(simulation)
        forces.append(PARTS[dim] * now.force)
        a, p0 = hertz(dim, forces[-1], POISSON)
        a_fit, p0_fit = fitted_dome(now.square, now.p, a)
        exact = p0 * dome(now.square, a)
        mean_square = (now.p * now.square) @ now.area / now.force
        found["a"].append(a_fit / a - 1.0)
        found["p0"].append(p0_fit / p0 - 1.0)
        found["a2"].append(np.sqrt(moment * mean_square) / a - 1.0)
        found["profile"].append(np.sqrt((now.p - exact) ** 2 @ now.area / (exact**2 @ now.area)))
        law = 4.0 / 3.0 * plane_modulus(POISSON) * np.sqrt(RADIUS) * down[len(forces) - 1] ** 1.5
        found["law"].append(forces[-1] / law - 1.0)
    errors = {"nodes": len(simulation.forms.V.tabulate_dof_coordinates())}
    errors |= {name: rms(values[-NUM_LOADS:]) for name, values in found.items()}
    errors["exponent"] = float(np.log(forces[-1] / forces[0]) / np.log(down[-1] / down[0]))
    if dim == 2:
        del errors["law"], errors["exponent"]
    return errors, now


@dataclass
class Slip:
    """Partial slip at a step.

    Attributes:
        share: Q / (mu P).
        c, c_exact: half-width of the stick zone, fitted and Mindlin's (m).
        c_status: half the width of the nodes that stick, half an element added on each side (m).
        a, p0: Hertz's (m, Pa).
        height: of the fitted dome over mu p0 c / a.
        x, q, q_exact: places (m) and shear traction, its even part (Pa).
        profile: rms difference of q over that of mu p.
    """

    share: float
    c: float
    c_exact: float
    c_status: float
    a: float
    p0: float
    height: float
    x: np.ndarray
    q: np.ndarray
    q_exact: np.ndarray
    profile: float


def partial_slip(
    elements: int, poisson: float = SLIP_POISSON, friction: float = FRICTION, pressing: int = 6
) -> tuple[list[Slip], Simulation]:
    """Press a cylinder in `pressing` steps, then push it along the plane in SLIP_LOADS steps."""
    deep = approach(2, np.array([HALF_WIDTH]))[0]
    down = np.concatenate([deep * np.arange(1, pressing + 1) / pressing, np.full(SLIP_LOADS, deep)])
    pushed = 1.25 * friction * deep * np.arange(1, SLIP_LOADS + 1) / SLIP_LOADS
    across = np.concatenate([np.zeros(pressing), pushed])
    bodies = round_block(2, elements, whole=True)
    simulation = pressed(bodies, poisson, friction, down, across)
    slips = []
    for record in simulation.steps(len(down)):
        if record.step <= pressing:
            continue
        now = reading(simulation)
        share = now.drag / (friction * now.force)
        a, p0 = hertz(2, now.force, poisson)
        c = a * np.sqrt(1.0 - share)
        # points lie mirrored about the middle
        left = 0.5 * (friction * now.p - now.q)
        left = left + left[::-1]
        c_fit, height = fitted_dome(now.square, left, c)
        bound = friction * p0 * dome(now.square, a)
        exact = bound - friction * p0 * c / a * dome(now.square, c)
        q = 0.5 * (now.q + now.q[::-1])
        slips.append(
            Slip(
                share,
                c_fit,
                c,
                0.5 * np.ptp(now.x[now.sticks, 0]) + 0.5 * HALF_WIDTH / elements,
                a,
                p0,
                height / (friction * p0 * c / a),
                now.x[:, 0],
                q,
                exact,
                np.sqrt((q - exact) ** 2 @ now.area / (bound**2 @ now.area)),
            )  # fmt: skip
        )
    return slips, simulation


def slip_errors(slips: list[Slip]) -> dict[str, float]:
    """Relative errors, root mean squares over the steps from Q / (mu P) = 0.2 on."""
    far = [s for s in slips if s.share > 0.2]
    return {
        "c": rms([s.c / s.c_exact - 1.0 for s in far]),
        "height": rms([s.height - 1.0 for s in far]),
        "profile": rms([s.profile for s in far]),
    }


def rate(coarse: int, fine: int, before: float, now: float) -> float:
    """Order of an error in the size of the elements, from a mesh to a finer one."""
    return float(np.log(before / now) / np.log(fine / coarse))


def table(title: str, rows: dict[int, dict[str, float]], rated: Sequence[str]) -> str:
    """Markdown: a row a mesh, in brackets the rate from the mesh before."""
    names = list(next(iter(rows.values())))
    lines = [f"{title}\n", "| elements in a | " + " | ".join(names) + " |"]
    lines.append("|---" * (len(names) + 1) + "|")
    before: tuple[int, dict[str, float]] | None = None
    for n, row in rows.items():
        shown = []
        for name in names:
            text = f"{row[name]:.2e}" if name in rated else f"{row[name]:.5g}"
            if before is not None and name in rated:
                text += f" ({rate(before[0], n, before[1][name], row[name]):.1f})"
            shown.append(text)
        lines.append(f"| {n} | " + " | ".join(shown) + " |")
        before = n, row
    return "\n".join([*lines, ""])


def coupling_table(elements: int, ratios: Sequence[float]) -> str:
    """Markdown: what the coupling of pressure and shear on a rigid plane does to partial slip."""
    lines = [
        f"Partial slip at other Poisson's ratios, {elements} elements in a\n",
        "| nu | beta | beta / mu | c | profile |\n|---|---|---|---|---|",
    ]
    for nu in ratios:
        beta = (1.0 - 2.0 * nu) / (2.0 * (1.0 - nu))
        errors = slip_errors(partial_slip(elements, nu)[0])
        lines.append(
            f"| {nu} | {beta:.4f} | {beta / FRICTION:.3f} | {errors['c']:.2e} | "
            f"{errors['profile']:.2e} |"
        )
    return "\n".join([*lines, ""])


# -- figure


def plot(
    pressures: dict[str, tuple[int, Reading]],
    slips: list[Slip],
    studies: dict[str, dict[int, float]],
    file: Path,
) -> None:
    """Pressures, shear tractions and stick zones beside theory, and convergence.

    Args:
        pressures: by name the dimension and what its contact bears.
        slips: steps of partial slip.
        studies: by name errors over elements in a.
        file: of the figure.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.5, 8.0), layout="constrained")
    (pressure, shear), (zone, converging) = figure.subplots(2, 2)
    fine = np.linspace(0.0, 1.0, 400)
    pressure.plot(fine, np.sqrt(1 - fine**2), "k-", lw=1, label="Hertz")
    for (name, (dim, now)), look in zip(pressures.items(), ("C0o", "C1s"), strict=True):
        a, p0 = hertz(dim, PARTS[dim] * now.force, POISSON)
        pressure.plot(np.sqrt(now.square) / a, now.p / p0, look, ms=4, mfc="none", label=name)
    pressure.set(xlabel="x / a, r / a", ylabel="p / p0", xlim=(0, 1.25))
    for number, s in enumerate(slips[i] for i in (2, 5, 9)):
        scale = FRICTION * s.p0
        label = f"Q / ($\\mu$P) = {s.share:.2f}"
        shear.plot(s.x / s.a, s.q / scale, f"C{number}o", ms=3, mfc="none", label=label)
        x = np.linspace(-s.a, s.a, 2000)
        exact = dome(x**2, s.a) - s.c_exact / s.a * dome(x**2, s.c_exact)
        shear.plot(x / s.a, exact, "k-", lw=0.8, label="Cattaneo, Mindlin" if not number else None)
    shear.set(xlabel="x / a", ylabel="q / ($\\mu$p0), even part", xlim=(-1.2, 1.2))
    zone.plot(fine, np.sqrt(1 - fine), "k-", lw=1, label="Cattaneo, Mindlin")
    shares, a = np.array([s.share for s in slips]), np.array([s.a for s in slips])
    zone.plot(shares, [s.c for s in slips] / a, "C0o", mfc="none", label="fitted")
    zone.plot(shares, [s.c_status for s in slips] / a, "C3x", label="nodes that stick")
    zone.set(xlabel="Q / ($\\mu$P)", ylabel="c / a", xlim=(0, 1), ylim=(0, 1.02))
    for (name, errors), marker in zip(studies.items(), "osd^v", strict=True):
        sizes, values = list(errors), list(errors.values())
        converging.loglog(sizes, values, marker + "-", ms=4, label=name)
    sizes = np.array([4.0, 64.0])
    for order, look in ((1, "k--"), (2, "k-.")):
        label = f"order {order}"
        converging.loglog(sizes, 0.06 * (sizes / 4) ** -order, look, lw=0.8, label=label)
    converging.axhline(0.02, color="k", ls=":", lw=1)
    converging.text(3, 0.021, "2 %", fontsize=8)
    converging.set(xlabel="elements in a", ylabel="relative error")
    for panel in (pressure, shear, zone, converging):
        panel.grid(alpha=0.3)
        panel.legend(fontsize=7.5)
    figure.savefig(file, dpi=130)


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--line", type=int, nargs="+", default=[4, 8, 16, 32, 64])
    parser.add_argument("--point", type=int, nargs="+", default=[3, 4, 6, 8])
    parser.add_argument("--slip", type=int, nargs="+", default=[8, 16, 32, 64])
    parser.add_argument("--poisson", type=float, nargs="*", default=[0.45, 0.47, 0.49, 0.495])
    parser.add_argument("--figure", type=Path, default=None, help="e.g. docs/hertz.png")
    options = parser.parse_args()
    start = time.process_time()

    def done(text: str) -> None:
        print(f"{text}\n(processor time so far {time.process_time() - start:.0f} s)\n", flush=True)

    line = {n: normal_errors(2, n) for n in options.line}
    lines = {n: errors for n, (errors, _) in line.items()}
    done(table("Line contact", lines, ("a", "p0", "a2", "profile")))
    slip = {n: partial_slip(n)[0] for n in options.slip}
    slips = {n: slip_errors(found) for n, found in slip.items()}
    done(table("Partial slip", slips, ("c", "height", "profile")))
    if options.poisson:
        done(coupling_table(32, options.poisson))
    point = {n: normal_errors(3, n, even=1.25, growth=1.5) for n in options.point}
    points = {n: errors for n, (errors, _) in point.items()}
    done(table("Point contact", points, ("a", "p0", "a2", "profile", "law")))
    if options.figure is not None:
        studies = {
            "line, a": {n: e["a"] for n, e in lines.items()},
            "line, pressure in L2": {n: e["profile"] for n, e in lines.items()},
            "point, a": {n: e["a"] for n, e in points.items()},
            "point, pressure in L2": {n: e["profile"] for n, e in points.items()},
            "stick half-width c": {n: e["c"] for n, e in slips.items()},
        }
        middle = min(options.line, key=lambda n: abs(n - 16))
        pressures = {
            f"line, {middle} triangles' sides in a": (2, line[middle][1]),
            f"point, {max(options.point)} hexahedra in a": (3, point[max(options.point)][1]),
        }
        plot(pressures, slip[max(options.slip)], studies, options.figure)


if __name__ == "__main__":
    main()
