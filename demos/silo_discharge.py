# SPDX-License-Identifier: LGPL-3.0-or-later
# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: light
# ---

# # A silo that empties
#
# This demo illustrates how to:
#
# - let grains settle, and take them into another scene in which their box has a hole
# - draw rigid bodies with the forces between them, and film them while the run goes on
# - measure a flow rate, and compare it with the law of Beverloo
#
# Discs of the mean diameter d stand in a silo whose bottom has an opening D. Sand does
# not flow out like water: the rate does not depend on how full the silo is (Hagen 1852), and in the
# plane it goes as
#
# $$Q = C \phi \sqrt{g}\, (D - k d)^{3/2}$$
#
# with Q the area of grains that leaves in a second, phi the share of the plane that grains fill,
# and k of about one, since no middle of a grain comes nearer to an edge than its radius (Beverloo,
# Leniger and van de Velde 1961, whose openings are round and whose exponent is 5/2).
#
# A constant C follows if grains fall freely from a semicircular arch over an opening b = D - k d,
# from the height $\sqrt{b^2/4 - x^2}$ above its point x:
#
# $$C \sqrt{g}\, b^{3/2} = \int_{-b/2}^{b/2} \sqrt{2 g \sqrt{b^2/4 - x^2}}\, dx
# \quad\Rightarrow\quad C = \frac{1}{2} \int_{-\pi/2}^{\pi/2} \cos^{3/2}\theta\, d\theta = 0.874$$

import argparse
import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.optimize import curve_fit
from scipy.stats import uniform
from tqdm.auto import tqdm

import xper_fx as xf

GRAVITY, DENSITY, FRICTION = 9.81, 2500.0, 0.5
DIAMETER, SPREAD = 0.01, 0.2
FREE_FALL_ARCH = 0.874

# ## The filled silo
#
# The grains fall into a closed box. Impacts leave overlaps of up to the way of one step behind,
# which `resolve_overlaps` takes away when the grains go into the next scene.


def settle(count: int, width: float, seed: int, step: float) -> xf.Scene:
    """Grains at rest in a box of a width (m)."""
    low = 0.5 * DIAMETER * (1.0 - SPREAD)
    radii = uniform(low, DIAMETER * SPREAD)
    grains = xf.assemblies.packing(radii, (width, np.inf), density=DENSITY, seed=seed, count=count)
    law = xf.laws.SignoriniCoulomb(friction=FRICTION)
    scene = xf.Scene(
        rigid=[*grains, *xf.assemblies.box((width, width), "silo")],
        contacts=[xf.Contact(("grains", group), law) for group in ("grains", "silo")],
        loads=[xf.Gravity((0.0, -GRAVITY))],
    )
    simulation = simulate(scene, step)
    top = scene.rigid_bodies.position[:, 1].max()
    for _ in simulation.steps(1.5 * np.sqrt(2.0 * top / GRAVITY)):
        pass
    return replace(scene, rigid=xf.output.rigid_bodies_now(simulation), resolve_overlaps=True)


def simulate(scene: xf.Scene, step: float) -> xf.Simulation:
    """A run of a scene: flowing grains need no more than a hundredth of their impulses."""
    return xf.Simulation(scene, step, solver="nlgs", tolerance=1e-2, num_threads=1)


# ## The opening
#
# Two plates take the place of the bottom, with the opening between them. They and the walls never
# move, so that they need no contact with each other.


def opened(filled: xf.Scene, opening: float) -> xf.Scene:
    """The filled silo with an opening (m) in the middle of its bottom."""
    *grains, _, left, right = filled.rigid
    width = width_of(filled)
    plate = xf.rigid.Polygon.box((0.5 * (width - opening), 2.0 * DIAMETER))
    held = dict.fromkeys(range(3), 0.0)
    plates = [
        xf.RigidBody(plate, (middle, -DIAMETER), "silo", prescribed=held)
        for middle in (0.25 * (width - opening), width - 0.25 * (width - opening))
    ]
    return replace(filled, rigid=[*grains, left, right, *plates])


def width_of(scene: xf.Scene) -> float:
    """Distance of the walls (m): that of the right one from the origin."""
    walls = scene.rigid_bodies.position[np.isinf(scene.rigid_bodies.bounding_radius)]
    return float(walls[:, 0].max())


# ## One discharge


@dataclass(frozen=True)
class Discharge:
    """What left a silo.

    Attributes:
        opening: D, m.
        times: s.
        left: area of grains below the edges of the opening at these times, m^2.
        rate: Q, slope of this area between a tenth and all of what was let out, m^2/s.
        drift: rate of the later half over that of the earlier one.
        frames: at the start, halfway and at the end.
    """

    opening: float
    times: np.ndarray
    left: np.ndarray
    rate: float
    drift: float
    frames: list[xf.output.Frame]


def discharge(
    scene: xf.Scene, opening: float, share: float, step: float, film: Path | None
) -> Discharge:
    """Open the silo until a share of its grains has left."""
    opened_scene = opened(scene, opening)
    bodies = opened_scene.rigid_bodies
    radius, height = bodies.shapes.radius, bodies.position[:, 1]
    area, top = np.pi * radius**2, height[radius > 0.0].max()  # walls and plates have no radius
    simulation = simulate(opened_scene, step)
    motion = simulation.rigid
    colour = np.where(radius > 0.0, np.floor(10.0 * height / top) % 2.0, np.nan)
    width = width_of(scene)
    window = (-0.02 * width, 1.02 * width, -0.3 * width, top + DIAMETER)
    frames = [xf.output.take_frame(simulation, colour)]
    times, left = [0.0], [0.0]
    camera = None
    if film is not None:
        camera = xf.output.Animation(
            film, simulation, colour, every=0.02, window=window, pixels=300
        )
    # an arch may jam a narrow opening
    patience = 5.0 * share * area.sum() / (np.sqrt(GRAVITY) * opening**1.5)
    for _ in simulation.steps(patience):
        times.append(simulation.time)
        left.append(float(area[motion.state.position[:, 1] < 0.0].sum()))
        if camera is not None:
            camera.record()
        if left[-1] > 0.5 * len(frames) * share * area.sum():
            frames.append(xf.output.take_frame(simulation, colour))
        if left[-1] > share * area.sum():
            break
    if camera is not None:
        camera.close()
    if left[-1] <= share * area.sum():
        raise RuntimeError(
            f"An arch jams the opening of {opening / DIAMETER:g} d, {left[-1] / area.sum():.0%} of "
            "the grains have left: take a wider opening, or another seed."
        )
    t, gone = np.array(times), np.array(left)
    steady = gone > 0.1 * gone[-1]
    t_steady, gone_steady = t[steady], gone[steady]
    half = gone_steady < 0.55 * gone[-1]
    early, late = (np.polyfit(t_steady[h], gone_steady[h], 1)[0] for h in (half, ~half))
    rate = np.polyfit(t_steady, gone_steady, 1)[0]
    return Discharge(opening, t, gone, float(rate), float(late / early), frames)


def filling(scene: xf.Scene) -> float:
    """phi, share of the plane that grains fill in the lower half of the silo."""
    grain = scene.rigid_bodies.shapes.radius > 0.0
    r, y = scene.rigid_bodies.shapes.radius[grain], scene.rigid_bodies.position[grain, 1]
    high = 0.5 * y.max()
    # a disc that the line at this height cuts counts with its segment below
    below = np.clip((high - y) / r, -1.0, 1.0)
    segment = np.arccos(-below) + below * np.sqrt(1.0 - below**2)
    return float((segment * r**2).sum() / (width_of(scene) * high))


# ## The law


def beverloo(opening: npt.ArrayLike, constant: float, shift: float) -> np.ndarray:
    """Q / (phi sqrt(g)), m^(3/2)."""
    return constant * np.maximum(np.asarray(opening) - shift * DIAMETER, 0.0) ** 1.5


def fit(found: list[Discharge], phi: float) -> dict:
    """C and k of least squares, how far rates are off, and the best exponent for k = 1."""
    opening = np.array([one.opening for one in found])
    rate = np.array([one.rate for one in found]) / (phi * np.sqrt(GRAVITY))
    answer: dict = {"phi": phi, "openings": opening.tolist(), "rates": rate.tolist()}
    answer["over_free_fall"] = (rate / beverloo(opening, FREE_FALL_ARCH, 1.0)).tolist()
    if len(found) > 2:
        (constant, shift), _ = curve_fit(
            beverloo, opening, rate, (FREE_FALL_ARCH, 1.0), sigma=rate, bounds=(0.0, (5.0, 3.0))
        )
        answer |= {"C": constant, "k": shift}
        answer["largest_error"] = np.abs(beverloo(opening, constant, shift) / rate - 1.0).max()
        answer["exponent"] = np.polyfit(np.log(opening - DIAMETER), np.log(rate), 1)[0]
    return answer


# ## Figures


def draw(found: list[Discharge], law: dict, width: float, out: Path) -> None:
    """The widest opening at three times, what left over time, and rates beside the law."""
    last = found[-1]
    height = max(face[:, 1].max() for face in last.frames[0].faces)
    xf.output.plot_frames(
        last.frames, out / "frames.png", chains=True,
        window=(-0.02 * width, 1.02 * width, -0.3 * width, height + DIAMETER),
    )  # fmt: skip

    def fill(_, axes) -> None:
        for number, one in enumerate(found):
            axes[0].plot(
                one.times, one.left, color=xf.plotting.COLOURS[number % 7],
                label=f"D = {one.opening / DIAMETER:.3g} d",
            )  # fmt: skip
        axes[0].set(xlabel="time (s)", ylabel="area of grains that left (m$^2$)")
        axes[0].legend()
        openings = np.linspace(DIAMETER, 1.05 * last.opening, 100)
        rates = np.array(law["rates"])
        axes[1].plot(np.array(law["openings"]) / DIAMETER, rates ** (2 / 3), "o", color="black")
        curves = [("free-fall arch, C = 0.874, k = 1", FREE_FALL_ARCH, 1.0, "--")]
        if "C" in law:
            curves.append((f"C = {law['C']:.3f}, k = {law['k']:.2f}", law["C"], law["k"], "-"))
        for number, (label, constant, shift, style) in enumerate(curves):
            axes[1].plot(
                openings / DIAMETER, beverloo(openings, constant, shift) ** (2 / 3), style,
                color=xf.plotting.COLOURS[number], label=label,
            )  # fmt: skip
        axes[1].set(xlabel="D / d", ylabel=r"$(Q / \phi \sqrt{g})^{2/3}$ (m)")
        axes[1].legend()

    xf.plotting.new_figure(out / "rates.png", fill, (8.4, 3.2), ncols=2)


# ## Command line


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Options of the demo."""
    parser = argparse.ArgumentParser(description="Discs flow out of a silo.")
    add = parser.add_argument
    add("--discs", type=int, default=400, help="in the silo (default 400)")
    add("--width", type=float, default=16.0, help="of the silo over d (default 16)")
    add(
        "--openings", type=float, nargs="+", default=[6.0, 7.0, 8.0],
        help="D / d; the last one is drawn (default 6 7 8)",
    )  # fmt: skip
    add("--share", type=float, default=0.4, help="of the grains that is let out (default 0.4)")
    add("--seed", type=int, default=1, help="of radii and places")
    add("--step", type=float, default=1e-3, help="s (default 1e-3)")
    add("--film", action="store_true", help="film the last opening: silo.gif in the folder")
    add("--out", type=Path, default=Path("results/silo_discharge"))
    add("--no-plot", action="store_true")
    add("--quiet", action="store_true", help="no progress bar")
    options = parser.parse_args(arguments)
    if not 2.0 <= min(options.openings) <= max(options.openings) <= 0.5 * options.width:
        parser.error(f"--openings should lie between 2 and half the width, got {options.openings}")
    if not 0.0 < options.share < 0.7:
        parser.error(f"--share should lie between 0 and 0.7, got {options.share}")
    return options


def main(arguments: list[str] | None = None) -> dict:
    """Empty the silo through each opening; returns the discharges and the fit."""
    options = parse(arguments)
    xf.prepare_folder(options.out)
    width = options.width * DIAMETER
    filled = settle(options.discs, width, options.seed, options.step)
    phi = filling(filled)
    found = []
    for opening in tqdm(options.openings, "openings", disable=options.quiet):
        filmed = options.film and opening == options.openings[-1]
        film = options.out / "silo.gif" if filmed else None
        one = discharge(filled, opening * DIAMETER, options.share, options.step, film)
        found.append(one)
        of_arch = one.rate / (phi * np.sqrt(GRAVITY) * beverloo(one.opening, FREE_FALL_ARCH, 1.0))
        tqdm.write(
            f"D = {opening:g} d: {one.rate / (0.25 * np.pi * DIAMETER**2):.0f} grains a second, "
            f"{of_arch:.3f} of the free-fall arch; later half {one.drift:.2f} of the earlier one"
        )
    law = fit(found, phi)
    if "C" in law:
        tqdm.write(
            f"phi = {phi:.3f}, C = {law['C']:.3f}, k = {law['k']:.2f}: rates within "
            f"{100.0 * law['largest_error']:.1f} %; exponent {law['exponent']:.2f} for k = 1"
        )
    (options.out / "summary.json").write_text(json.dumps(law, indent=1))
    if not options.no_plot:
        draw(found, law, width, options.out)
    return {"filled": filled, "found": found, "law": law}


if __name__ == "__main__":
    main()
