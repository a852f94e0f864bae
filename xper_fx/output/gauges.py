# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gauges: what the strain and the stress in the history of a run are."""

from __future__ import annotations

from dataclasses import dataclass

from xper_fx.simulation.simulation import Simulation
from xper_fx.support.checks import require_integer, require_positive


@dataclass(frozen=True)
class TensileGauge:
    """Mean strain and stress between two opposite faces that are pulled apart.

    Args:
        low, high: facet tags of the faces.
        component: direction of the pull.
        length: distance of the faces (m).
        section: area of a face (m^2; 2D: m).

    Raises:
        ValueError: a number out of range, one face for both.
        TypeError: something that is no number.
    """

    low: int
    high: int
    component: int
    length: float
    section: float

    def __post_init__(self) -> None:
        for name in ("low", "high"):
            require_integer(name, getattr(self, name))
        if self.low == self.high:
            raise ValueError(f"low and high should be two faces, got facet tag {self.low} twice.")
        require_integer("component", self.component)
        if not 0 <= self.component <= 2:
            raise ValueError(f"component should be 0, 1 or 2, got {self.component}.")
        for name in ("length", "section"):
            object.__setattr__(self, name, require_positive(name, getattr(self, name)))

    def check(self, simulation: Simulation) -> None:
        """Raise a ValueError unless there is something to read in a simulation."""
        scene = simulation.scene
        if scene.bodies is None or scene.macroscopic is not None:
            kind = "rigid bodies without a mesh" if scene.bodies is None else "a periodic cell"
            raise ValueError(
                f"A TensileGauge reads two faces of a meshed plate, and the scene is {kind}; "
                "take " + ("no gauge." if scene.bodies is None else "a CellGauge.")
            )
        if self.component >= scene.dim:
            raise ValueError(
                f"The gauge has component {self.component}; it should be 0 to {scene.dim - 1}."
            )
        there = sorted(scene.bodies.present.facets)
        for name in ("low", "high"):
            if getattr(self, name) not in there:
                raise ValueError(
                    f"The gauge's `{name}` is facet tag {getattr(self, name)}, which occurs "
                    f"nowhere; tags that do: {there}."
                )

    def read(self, simulation: Simulation) -> tuple[float, float]:
        """Strain, and stress (Pa): half the difference of the two faces' reactions.

        Both at t0 + theta h of the last step, so that their curve is of second order in h.
        """
        faces = (self.low, self.high)
        u = [simulation.mean_displacement_of_reaction(tag)[self.component] for tag in faces]
        f = [simulation.reaction(tag)[self.component] for tag in faces]
        return (u[1] - u[0]) / self.length, 0.5 * (f[1] - f[0]) / self.section


@dataclass(frozen=True)
class CellGauge:
    """Macroscopic strain and stress of a periodic cell.

    Args:
        component: "11", "22", ...: strain is Fbar_ij less the identity, stress is Pibar_ij.

    Raises:
        ValueError: another component.
    """

    component: str = "11"

    def __post_init__(self) -> None:
        given = self.component
        if not (isinstance(given, str) and len(given) == 2 and set(given) <= set("123")):
            raise ValueError(f'component should be one of "11", "12", ..., "33", got {given!r}.')

    def check(self, simulation: Simulation) -> None:
        """Raise a ValueError unless there is something to read in a simulation."""
        scene = simulation.scene
        if scene.macroscopic is None:
            raise ValueError(
                "A CellGauge reads a periodic cell, and nothing drives the scene by `macroscopic`; "
                "take a TensileGauge for a plate."
            )
        if int(max(self.component)) > scene.dim:
            raise ValueError(
                f"The gauge has component {self.component!r}, which a cell of dimension "
                f"{scene.dim} has not."
            )

    def read(self, simulation: Simulation) -> tuple[float, float]:
        """Strain, and stress (Pa)."""
        i, j = int(self.component[0]) - 1, int(self.component[1]) - 1
        cell = simulation.macroscopic
        return float(cell.gradient[i, j]) - float(i == j), float(cell.stress[i, j])


def require_gauge(gauge: TensileGauge | CellGauge) -> None:
    """Raise TypeError unless something is a gauge, of this module or of one's own."""
    if isinstance(gauge, type) or not callable(getattr(gauge, "read", None)):
        raise TypeError(
            f"gauge should be an xf.TensileGauge(...) or an xf.CellGauge(...), got {gauge!r}."
        )
