# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a study compares between runs: each quantity watches a run and measures its own error.

A quantity is a frozen dataclass with three methods, and is handed to another process, so that it
must be importable there. `observe` is called after each step with what it returned for the step
before, None at first; `value` is called at the end and gives a number, or arrays by name;
`error` compares two such values, dimensionless. To add one, write such a class.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree
from scipy.stats import qmc

from xper_fx.bodies.function_values import cells_at
from xper_fx.bodies.spread import send
from xper_fx.output.cracks import broken_points
from xper_fx.output.field_series import point_coordinates, shown_values
from xper_fx.output.gauges import CellGauge, TensileGauge, require_gauge
from xper_fx.simulation.simulation import Simulation, StepRecord
from xper_fx.support.checks import require_count, require_positive
from xper_fx.support.ranks import ALONE, Ranks

Value = float | dict[str, Any]


class Quantity(Protocol):
    """What a study asks of a quantity.

    Attributes:
        has_reference: False if the value is an error by itself (`error` then gets None as the
            reference).
    """

    has_reference: ClassVar[bool]

    def observe(self, simulation: Simulation, step: StepRecord, seen: Any) -> Any:
        """Look at a run after a step.

        Args:
            simulation: the run.
            step: the step just made.
            seen: what this returned after the step before, None after the first.
        """

    def value(self, simulation: Simulation, seen: Any) -> Value:
        """The quantity at the end of a run.

        Args:
            simulation: the run.
            seen: what `observe` returned last.
        """

    def error(self, value: Any, reference: Any) -> float:
        """Distance of a value from the reference's, dimensionless, zero or above."""


def relative(size: float, scale: float) -> float:
    """A size over the size of what it belongs to.

    Raises:
        ValueError: that is zero.
    """
    if scale == 0.0:
        raise ValueError(
            "The reference is zero: nothing is relative to it. Leave the quantity out of this "
            "study, or run until it is above zero."
        )
    return float(abs(size) / abs(scale))


@dataclass(frozen=True)
class PeakStress:
    """The largest stress of a gauge (Pa).

    Args:
        gauge: what is read.
    """

    gauge: TensileGauge | CellGauge
    has_reference: ClassVar[bool] = True

    def __post_init__(self) -> None:
        require_gauge(self.gauge)

    def observe(self, simulation: Simulation, step: StepRecord, seen: float | None) -> float:
        """The largest so far."""
        stress = self.gauge.read(simulation)[1]
        return stress if seen is None else max(seen, stress)

    def value(self, simulation: Simulation, seen: float) -> float:
        """The largest of the run."""
        return seen

    def error(self, value: float, reference: float) -> float:
        """Relative."""
        return relative(value - reference, reference)


@dataclass(frozen=True)
class DissipatedEnergy:
    """What cracks, friction, impacts, plasticity and viscosity dissipated (J; 2D: J/m).

    Args:
        until: time at which it is read, linearly between steps (s); the end of the run if None.
            Give one to stop before a stage that depends on the mesh.
        terms: of the ledger; all but what the scheme itself dissipates if empty.
    """

    until: float | None = None
    terms: tuple[str, ...] = ()
    has_reference: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.until is not None:
            require_positive("until", self.until)
        if isinstance(self.terms, str) or not all(
            isinstance(term, str) and term.startswith("dissipated") for term in self.terms
        ):
            raise ValueError(
                "terms should be columns of the ledger such as ('dissipated_cohesion',), got "
                f"{self.terms!r}."
            )

    def observe(
        self, simulation: Simulation, step: StepRecord, seen: tuple[float, float] | None
    ) -> tuple[float, float]:
        """Time of the last step that counts, and what was dissipated by then."""
        before, lost = seen or (0.0, 0.0)
        if self.until is not None and before >= self.until:
            return before, lost
        energies = step.energies
        terms = self.terms or [
            name
            for name in energies
            if name.startswith("dissipated") and name != "dissipated_numerical"
        ]
        now, total = step.time, sum(energies[name] for name in terms)
        if self.until is not None and now > self.until:
            total = lost + (total - lost) * (self.until - before) / (now - before)
            now = self.until
        return now, total

    def value(self, simulation: Simulation, seen: tuple[float, float]) -> float:
        """The total."""
        return seen[1]

    def error(self, value: float, reference: float) -> float:
        """Relative."""
        return relative(value - reference, reference)


@dataclass(frozen=True)
class CrackPattern:
    """Where bonds have broken at the end: the share of cracks without a counterpart.

    A crack's length (2D) or area (3D) counts as found again if the other run has a broken point
    within the radius. The error is the share of both runs' cracks that is not: 0 for the same
    pattern, 1 for patterns that have nothing in common. Meshes may differ.

    Args:
        radius: what still counts as the same place (m); at least a facet of the coarsest mesh.
        ignored_facets: tags of facets that do not count (precracks).
    """

    radius: float
    ignored_facets: tuple[int, ...] = ()
    has_reference: ClassVar[bool] = True

    def __post_init__(self) -> None:
        require_positive("radius", self.radius)

    def observe(self, simulation: Simulation, step: StepRecord, seen: bool | None) -> bool:
        """Nothing before the end, but for tags that occur nowhere.

        Raises:
            ValueError, TypeError: as `broken_points`.
        """
        if seen is None and simulation.interactions is not None:
            broken_points(simulation, self.ignored_facets)
        return True

    def value(self, simulation: Simulation, seen: bool | None) -> dict[str, Any]:
        """Broken points: `points`, shape (n, dim), m, and `area`, shape (n,), m^2 (2D: m).

        All ranks call it together. Of a mesh that is spread over them each has its own points, and
        `ranks` says with which others.
        """
        if simulation.interactions is None:
            return {"points": np.zeros((0, simulation.bulk.dim)), "area": np.zeros(0)}
        broken = broken_points(simulation, self.ignored_facets)
        found: dict[str, Any] = {
            "points": point_coordinates(simulation)[broken],
            "area": shown_values(simulation, "area")[broken],
        }
        if simulation.scene.bodies.spread is not None:
            found["ranks"] = simulation.ranks
        return found

    def error(self, value: Mapping[str, Any], reference: Mapping[str, Any]) -> float:
        """The share of cracks without a counterpart; ranks that have parts call it together."""
        ranks = value.get("ranks", reference.get("ranks", ALONE))
        parts = _part(value, ranks), _part(reference, ranks)
        total = ranks.sum(sum(part["area"].sum() for part in parts))
        if total == 0.0:
            return 0.0
        alone = self._alone(*parts, ranks) + self._alone(*parts[::-1], ranks)
        return float(ranks.sum(alone) / total)

    def _alone(self, one: Mapping[str, Any], other: Mapping[str, Any], ranks: Ranks) -> float:
        """Area of this rank's part of `one` without a point of any of `other` within the radius.

        Ranks tell each other boxes around their parts of `other`, and ask whose box is in reach.
        """
        there, points, beside = other["points"], one["points"], 1.001 * self.radius
        box = there.min(axis=0, initial=np.inf), there.max(axis=0, initial=-np.inf)
        asked = [
            np.flatnonzero(np.all((points >= low - beside) & (points <= high + beside), axis=1))
            for low, high in ranks.comm.allgather(box)
        ]
        to = np.repeat(np.arange(ranks.size), [len(which) for which in asked])
        heard, tree = send(ranks, to, points[np.concatenate(asked)]), cKDTree(there)
        near = ranks.comm.alltoall([tree.query(x)[0] <= self.radius for (x,) in heard])
        found = np.zeros(len(points), bool)
        for which, told in zip(asked, near, strict=True):
            found[which] |= told
        return float(one["area"][~found].sum())


def _part(value: Mapping[str, Any], ranks: Ranks) -> Mapping[str, Any]:
    """Of cracks that all ranks have each takes some."""
    if "ranks" in value:
        return value
    return {name: array[ranks.rank :: ranks.size] for name, array in value.items()}


@dataclass(frozen=True)
class DisplacementL2:
    """The displacement at the end, compared in the L2 norm relative to the reference's.

    It is read at points that depend on the box round the bodies only, spread evenly in it (a
    Halton sequence), so that meshes and orders may differ; points outside of all bodies do not
    count. Where bodies or cells meet it is their mean.

    Args:
        samples: number of points.
    """

    samples: int = 4096
    has_reference: ClassVar[bool] = True

    def __post_init__(self) -> None:
        require_count("samples", self.samples, 1)

    def observe(self, simulation: Simulation, step: StepRecord, seen: None) -> None:
        """Nothing before the end.

        Raises:
            ValueError: a scene of rigid bodies alone.
        """
        if simulation.scene.bodies is None:
            raise ValueError("DisplacementL2 samples meshed bodies, and the scene has none.")

    def points(self, low: npt.ArrayLike, high: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Where a box is sampled, shape (samples, dim), m: for values of a known solution.

        Args:
            low, high: corners of the box, shape (dim,), m.
        """
        low, high = np.asarray(low, float), np.asarray(high, float)
        # the sequence's first point is a corner
        spread = qmc.Halton(len(low), scramble=False).random(self.samples + 1)[1:]
        return low + spread * (high - low)

    def value(self, simulation: Simulation, seen: None) -> dict[str, npt.NDArray[np.float64]]:
        """`points`, shape (samples, dim), and `displacement` there, m; NaN outside of bodies.

        All ranks call it together, and have the same, also of a mesh that is spread over them.
        """
        mesh, dim, ranks = simulation.bodies.mesh, simulation.bulk.dim, simulation.ranks
        points = np.zeros((self.samples, 3))
        points[:, :dim] = self.points(*ranks.box(mesh.geometry.x[:, :dim]))
        which, cells = cells_at(mesh, points)
        found = simulation.displacement.eval(points[which], cells).reshape(-1, dim)
        # how many cells have each point, and the sum of what they say
        total = np.zeros((self.samples, 1 + dim))
        np.add.at(total, which, np.column_stack([np.ones(len(which)), found]))
        total = ranks.sum(total)
        displacement = np.full((self.samples, dim), np.nan)
        inside = total[:, 0] > 0.0
        displacement[inside] = total[inside, 1:] / total[inside, :1]
        return {"points": points[:, :dim], "displacement": displacement}

    def error(self, value: Mapping[str, Any], reference: Mapping[str, Any]) -> float:
        """Relative, in the L2 norm.

        Raises:
            ValueError: the two runs do not fill the same box.
        """
        points, size = reference["points"], np.ptp(reference["points"])
        same = value["points"].shape == points.shape
        if not (same and np.allclose(value["points"], points, rtol=0.0, atol=1e-9 * size)):
            raise ValueError(
                "The displacements were read at other points than the reference's: the bodies "
                "should fill the same box in both runs."
            )
        exact = reference["displacement"]
        both = np.isfinite(value["displacement"][:, 0]) & np.isfinite(exact[:, 0])
        difference = value["displacement"][both] - exact[both]
        return relative(np.linalg.norm(difference), np.linalg.norm(exact[both]))


@dataclass(frozen=True)
class Penetration:
    """The deepest interpenetration of the run over a length: an error by itself.

    Args:
        length: what counts as one (m).
    """

    length: float
    has_reference: ClassVar[bool] = False

    def __post_init__(self) -> None:
        require_positive("length", self.length)

    def observe(self, simulation: Simulation, step: StepRecord, seen: float | None) -> float:
        """The deepest so far (m)."""
        if simulation.interactions is None:
            return 0.0
        deepest = -simulation.interactions.gather("jump")[:, 0].min()
        return max(deepest, seen or 0.0)

    def value(self, simulation: Simulation, seen: float) -> float:
        """The deepest of the run (m)."""
        return float(seen)

    def error(self, value: float, reference: None) -> float:
        """In units of the length."""
        return value / self.length


@dataclass(frozen=True)
class EnergyClosure:
    """What the ledger cannot account for at the end, over the largest energy of the run.

    The largest energy is that of the external work or the kinetic energy, whichever is more. It
    is an error by itself: small is necessary and far from enough.
    """

    has_reference: ClassVar[bool] = False

    def observe(self, simulation: Simulation, step: StepRecord, seen: float | None) -> float:
        """The largest energy so far (J; 2D: J/m)."""
        energies = step.energies
        return max(seen or 0.0, abs(energies["external_work"]), energies["kinetic"])

    def value(self, simulation: Simulation, seen: float) -> float:
        """The closure error over the largest energy."""
        return relative(simulation.ledger.closure, seen)

    def error(self, value: float, reference: None) -> float:
        """The value itself."""
        return value
