# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a periodic cell's effects cost: the macroscopic unknowns, and plasticity.

Cells of the periodic ductile demo step in turn, each timed beside the others:

- *two fields*: Fbar_11 driven, Pibar_22 = 0;
- *prescribed*: the same with the Fbar_22 that the first found, so that nothing macroscopic is left
  to solve;
- *elastic*: the first with a matrix that does not yield.

The cost of plasticity is set beside that of its assembly, timed alone: residuals and tangents of
both bulks at the state reached, as many of each as the steps took.

    ./fenicsx python3 benchmarks/cell_cost.py [--cells 20] [--from 0.004] [--steps 100]
"""

import argparse
import sys
from pathlib import Path
from time import perf_counter

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "demos"))
import periodic_ductile as demo

from xper_fx.materials import LinearElastic
from xper_fx.materials.library import DENSITY, ZIRCALOY_4_DUCTILE
from xper_fx.periodic.drive import MacroscopicDrive
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

ELASTIC = LinearElastic(ZIRCALOY_4_DUCTILE.young, ZIRCALOY_4_DUCTILE.poisson, DENSITY)


def with_changes(scene: Scene, **changes) -> Scene:
    """The scene with other materials or another drive."""
    given = {name: getattr(scene, name) for name in ("bodies", "materials", "interactions")}
    return Scene(**(given | {"macroscopic": scene.macroscopic} | changes))


class Counter:
    """Counts and times the steps of a simulation."""

    def __init__(self, scene: Scene, step: float):
        self.simulation = Simulation(scene, step, num_threads=1)
        self.calls = {"internal": 0, "tangent": 0}
        for name in self.calls:
            self._count(name)
        self.restart()

    def _count(self, name: str) -> None:
        method = getattr(self.simulation.bulk, name)

        def counted(*arguments):
            self.calls[name] += 1
            return method(*arguments)

        setattr(self.simulation.bulk, name, counted)

    def restart(self) -> None:
        self.seconds, self.newton, self.sweeps = [], 0, 0
        self.calls.update(internal=0, tangent=0)
        self.simulation.stopwatch.restart()

    def step(self) -> None:
        """One step of the given size, all its pieces if it is cut."""
        simulation = self.simulation
        start = perf_counter()
        for record in simulation.steps(simulation.time + simulation.step_size):
            self.newton += record.newton_iterations
            self.sweeps += record.sweeps
        self.seconds.append(perf_counter() - start)


def assembly_seconds(counter: Counter, name: str, repeats: int = 20) -> float:
    """Median time of an assembly at the state reached."""
    bulk, q = counter.simulation.bulk, counter.simulation.state.displacement
    times = []
    for _ in range(repeats):
        start = perf_counter()
        getattr(type(bulk), name)(bulk, q)
        times.append(perf_counter() - start)
    return float(np.median(times))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=20)
    parser.add_argument("--from", dest="start", type=float, default=0.004, help="strain")
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--rate", type=float, default=4e4)
    parser.add_argument("--step-size", type=float, default=5e-10)
    options = parser.parse_args()
    scene = demo.periodic_composite(options.cells, rate=options.rate)
    two = Counter(scene, options.step_size)
    elastic = Counter(
        with_changes(scene, materials=dict(scene.materials) | {demo.MATRIX: ELASTIC}),
        options.step_size,
    )

    def lateral(time: float) -> float:
        return float(two.simulation.macroscopic.gradient[1, 1]) if time > 0.0 else 1.0

    drive = MacroscopicDrive(
        rate={"11": options.rate}, gradient={"12": 0.0, "21": 0.0, "22": lateral}
    )
    prescribed = Counter(with_changes(scene, macroscopic=drive), options.step_size)
    cells = {"two fields": two, "prescribed": prescribed, "elastic": elastic}
    while two.simulation.macroscopic.gradient[0, 0] - 1.0 < options.start:
        for counter in cells.values():
            counter.step()
    for counter in cells.values():
        counter.restart()
    for _ in range(options.steps):
        for counter in cells.values():
            counter.step()

    print(f"{options.steps} steps from {100 * options.start:g} % strain, {options.cells} quads")
    print(
        f"{'cell':<12}{'ms a step':>11}{'Newton':>9}{'sweeps':>9}{'residuals':>11}{'tangents':>10}"
    )
    for name, c in cells.items():
        n = options.steps
        print(
            f"{name:<12}{1e3 * np.median(c.seconds):>11.2f}{c.newton / n:>9.2f}"
            f"{c.sweeps / n:>9.1f}{c.calls['internal'] / n:>11.2f}{c.calls['tangent'] / n:>10.2f}"
        )
    ratio = np.sum(two.seconds) / np.sum(prescribed.seconds)
    same = abs(
        two.simulation.macroscopic.stress[0, 0] / prescribed.simulation.macroscopic.stress[0, 0] - 1
    )
    print(f"two fields / prescribed: {ratio:.3f} in time (P11 differs by {same:.1e})")
    extra = (np.sum(two.seconds) - np.sum(elastic.seconds)) / options.steps
    assembly = sum(
        two.calls[name] / options.steps * assembly_seconds(two, name) for name in two.calls
    )
    print(
        f"plasticity: {1e3 * extra:.2f} ms a step beside the elastic cell, of which assembly "
        f"{1e3 * assembly:.2f} ms"
    )
    for name, c in cells.items():
        phases = sorted(c.simulation.stopwatch.seconds.items(), key=lambda item: -item[1])
        print(f"{name}: " + ", ".join(f"{k} {v:.2f} s" for k, v in phases))


if __name__ == "__main__":
    main()
