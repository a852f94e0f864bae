# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gauges: what the strain and the stress in the history of a run are."""

from __future__ import annotations

from dataclasses import dataclass

from xper_fx.simulation.simulation import Simulation


@dataclass(frozen=True)
class TensileGauge:
    """Mean strain and stress between two opposite faces that are pulled apart.

    Args:
        low, high: facet tags of the faces.
        component: direction of the pull.
        length: distance of the faces (m).
        section: area of a face (m^2; 2D: m).
    """

    low: int
    high: int
    component: int
    length: float
    section: float

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
    """

    component: str = "11"

    def read(self, simulation: Simulation) -> tuple[float, float]:
        """Strain, and stress (Pa)."""
        i, j = int(self.component[0]) - 1, int(self.component[1]) - 1
        cell = simulation.macroscopic
        return float(cell.gradient[i, j]) - float(i == j), float(cell.stress[i, j])
