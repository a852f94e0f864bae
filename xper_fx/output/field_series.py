# SPDX-License-Identifier: LGPL-3.0-or-later
"""The series of a meshed scene: fields of its bodies, and of the points on their facets.

The first rank writes those of all bodies. Where the mesh is spread over ranks each rank writes
those of its own bodies and points: `bulk_0.xdmf` and `interfaces_0.xdmf` are the first one's.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from xper_fx.nscd.facets import facet_shapes
from xper_fx.output.series import TimeSeries
from xper_fx.output.vertex_values import VertexValues
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.compat import geometry_dofmap

# Fields of points, as `Interactions.gather` knows them.
_OF_POINTS = ("jump", "traction", "damage", "spent", "status")
_OF_A_RANK = re.compile(r"(bulk|interfaces)_\d+(\.\d+)?\.(xdmf|h5)")


class FieldSeries:
    """Writes the fields of a simulation; all ranks call it together.

    Args:
        simulation: of a scene with a mesh.
        folder: where to write.

    Attributes:
        cells: geometry nodes of the cells that are shown, shape (num_cells, k).
        series: those that this rank writes.
    """

    def __init__(self, simulation: Simulation, folder: Path):
        self._simulation, self._folder = simulation, folder
        self._shares = simulation.scene.bodies.spread is not None
        self._bodies = simulation.bodies if self._shares else simulation.scene.bodies
        self.cells = geometry_dofmap(self._bodies.mesh)
        self._vertices = VertexValues(simulation)
        self._stress: Callable[[], np.ndarray] | None = None
        self._bulk: TimeSeries | None = None
        self._interfaces: TimeSeries | None = None

    def open(self, after: Mapping[str, Mapping[str, float]]) -> None:
        """Open the files.

        Args:
            after: what `TimeSeries.seal` gave of each file of a run that goes on, by name.
        """
        self._where_written(partial(self._open, after))

    def write(self, fragment: np.ndarray | None) -> None:
        """Write the fields as they are now.

        Args:
            fragment: of each body, None without.
        """
        simulation, bodies = self._simulation, self._bodies
        nodal = {
            "displacement": self._vertices.displacement(),
            "velocity": self._vertices.velocity(),
        }
        body = bodies.labels[bodies.body_of_cell] if self._shares else bodies.body_of_cell
        cellwise = {"stress": self.stress(), "body": body, "material": bodies.material_of_cell}
        if fragment is not None:
            cellwise["fragment"] = fragment[bodies.body_of_cell]
        self._where_written(lambda: self._bulk.write(simulation.time, nodal, cellwise))
        if not len(simulation.facets_with_law):
            return
        points = simulation.interactions
        read = points.local if self._shares else points.gather
        values = {name: read(name) for name in _OF_POINTS}

        def write() -> None:
            # the points of walls come last
            fields = {name: array[: self._num_points] for name, array in values.items()}
            self._interfaces.write(simulation.time, fields, {})

        self._where_written(write)

    def stress(self) -> np.ndarray:
        """Cauchy stress of each cell, as `BulkForms.stress_evaluator` gives it (Pa)."""
        if self._stress is None:
            self._stress = self._simulation.forms.stress_evaluator()
        self._simulation.displacement  # noqa: B018  brings the state into the forms
        stress, part = self._stress(), self._simulation.part
        if part is None or self._shares:
            return stress
        return self._simulation.ranks.gather(part.cells, stress)

    def displacement(self) -> np.ndarray:
        """Displacement of the geometry nodes that are shown, shape (num_nodes, dim), m."""
        return self._vertices.displacement()

    @property
    def series(self) -> list[TimeSeries]:
        """Those that this rank writes."""
        return [series for series in (self._bulk, self._interfaces) if series is not None]

    def _where_written(self, call: Callable[[], object]) -> None:
        """Call something on the ranks that write; what one raises is raised on all."""
        team = self._simulation.team
        (team.together if self._shares else team.at_root)(call)

    def _open(self, after: Mapping[str, Mapping[str, float]]) -> None:
        simulation, mesh = self._simulation, self._bodies.mesh
        rank = f"_{simulation.team.rank}" if self._shares else ""

        def opened(name: str, x: np.ndarray, cells: tuple[str, np.ndarray]) -> TimeSeries:
            name += rank
            return TimeSeries(self._folder / f"{name}.xdmf", x, cells, after.get(name))

        x = mesh.geometry.x[:, : mesh.geometry.dim]
        self._bulk = opened("bulk", x, (mesh.topology.cell_name(), self.cells))
        if len(simulation.facets_with_law):
            x, points = coordinates_of_known(simulation), simulation.model.points
            kind = {2: "line", 3: "triangle"}.get(points.points_a_facet, "vertex")
            if self._shares:  # the points of a facet may be on several ranks
                x, kind = x[points.on_facets()[0]], "vertex"
            self._num_points = len(x)
            corners = {"line": 2, "triangle": 3, "vertex": 1}[kind]
            cells = np.arange(len(x)).reshape(-1, corners)
            self._interfaces = opened("interfaces", x, (kind, cells))


def coordinates_of_known(simulation: Simulation) -> np.ndarray:
    """Reference positions of the points on `facets_with_law`, facet after facet, (n, dim), m."""
    scene = simulation.scene
    x = scene.bodies.facet_nodes(scene.order)[simulation.facets_with_law]
    shapes = facet_shapes(scene.dim, x.shape[1], scene.points)
    return np.einsum("pk,fkd->fpd", shapes, x).reshape(-1, scene.dim)


def point_coordinates(simulation: Simulation) -> np.ndarray:
    """Reference positions of the points on facing facets, in the scene's order.

    Returns:
        Shape (num_points, dim), m; points of walls, which come last in the scene, are left out.

    Raises:
        ValueError: a scene without a mesh, or with one that is spread over ranks (SerialOnlyError).
    """
    if simulation.scene.bodies is None:
        raise ValueError("A scene without a mesh has no facets that points could be on.")
    simulation.scene.bodies.require_whole("The place of all points")
    return coordinates_of_known(simulation)


def remove_fields_of_ranks(folder: Path) -> None:
    """Remove the files of an earlier run of a mesh that was spread, on perhaps more ranks."""
    for path in folder.iterdir():
        if _OF_A_RANK.fullmatch(path.name):
            path.unlink()


def ranks_that_wrote(series: Mapping[str, object]) -> int:
    """How many ranks wrote fields of their own, by the names of their files; 0 if one wrote all."""
    return sum(name.startswith("bulk_") for name in series)
