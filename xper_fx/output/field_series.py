# SPDX-License-Identifier: LGPL-3.0-or-later
"""The series of a meshed scene: fields of its bodies, and of the points on their facets.

The first rank writes those of all bodies. Where the mesh is spread over ranks each rank writes
those of its own bodies and points: `bulk_0.xdmf` and `interfaces_0.xdmf` are the first one's. A
run that goes on writes the same bodies into the same files, on whichever and however many ranks
they are now.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from xper_fx.nscd.facets import facet_shapes
from xper_fx.output.series import TimeSeries
from xper_fx.output.vertex_values import VertexValues
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.compat import geometry_dofmap

if TYPE_CHECKING:
    from xper_fx.bodies.explode import Bodies
    from xper_fx.forms.dynamics import BulkForms
    from xper_fx.output.filed_rows import FiledRows

# Fields of points, as `Interactions.gather` knows them.
_OF_POINTS = ("jump", "traction", "damage", "spent", "status")
_SERIES = re.compile(r"(bulk|interfaces|rigid)(_\d+)?(\.\d+)?\.(xdmf|h5)")


class FieldSeries:
    """Writes the fields of a simulation; all ranks call it together.

    Args:
        simulation: of a scene with a mesh.
        folder: where to write.

    Attributes:
        series: those that this rank writes.
    """

    def __init__(self, simulation: Simulation, folder: Path):
        self._simulation, self._folder = simulation, folder
        self._shares = simulation.scene.bodies.spread is not None
        points = simulation.model.points
        self._has_points = not simulation.team.all(len(points.facets_with_law) == 0)
        self._forms: BulkForms | None = None  # of which the stress is told
        self._stress: Callable[[], np.ndarray] = lambda: np.zeros(0)
        # by the name of the series: the files of this rank, and who has their rows
        self._files: dict[str, list[TimeSeries]] = {"bulk": [], "interfaces": []}
        self._filed: dict[str, list[FiledRows]] = {}
        self._filed_of: Bodies | None = None  # bodies whose rows these are

    def open(self, after: Mapping[str, Mapping[str, float]]) -> None:
        """Open the files.

        Args:
            after: what `TimeSeries.seal` gave of each file of a run that goes on, by name.
        """
        numbers = self._numbers() if self._shares else {}
        self._where_written(partial(self._open, after, numbers))
        if self._shares:
            self._find_rows(numbers)

    @property
    def _bodies(self) -> Bodies:
        """Those that are shown: which the rank has now, or all."""
        simulation = self._simulation
        return simulation.bodies if self._shares else simulation.scene.bodies

    @property
    def cells(self) -> np.ndarray:
        """Geometry nodes of the cells that are shown, shape (num_cells, k)."""
        return geometry_dofmap(self._bodies.mesh)

    def _find_rows(self, numbers: Mapping[str, Mapping[str, np.ndarray]]) -> None:
        """Find out who has the rows of each file, by what `_numbers` gives."""
        from xper_fx.output.filed_rows import FiledRows

        team, self._filed_of = self._simulation.team, self._bodies
        self._filed = {
            name: [
                FiledRows(team, own, [file.numbers[of] for file in self._files[name]])
                for of, own in numbers[name].items()
            ]
            for name in numbers
        }

    def write(self, fragment: np.ndarray | None) -> None:
        """Write the fields as they are now.

        Args:
            fragment: of each body that the rank knows, None without.
        """
        simulation, bodies = self._simulation, self._bodies
        if self._shares and bodies is not self._filed_of:  # others where they were divided anew
            self._find_rows(self._numbers())
        vertices = VertexValues(simulation)
        nodal = {"displacement": vertices.displacement(), "velocity": vertices.velocity()}
        body = bodies.labels[bodies.body_of_cell] if self._shares else bodies.body_of_cell
        cellwise = {"stress": self.stress(), "body": body, "material": bodies.material_of_cell}
        if fragment is not None:
            own = fragment[simulation.part.body_numbers] if self._shares else fragment
            cellwise["fragment"] = own[bodies.body_of_cell]
        self._write("bulk", nodal, cellwise)
        if self._has_points:
            values = {name: shown_values(simulation, name) for name in _OF_POINTS}
            self._write("interfaces", values)

    def close(self) -> None:
        """Close the files of this rank."""
        with ExitStack() as files:
            for file in self.series:
                files.callback(file.close)

    def stress(self) -> np.ndarray:
        """Cauchy stress of each cell, as `BulkForms.stress_evaluator` gives it (Pa)."""
        if self._forms is not self._simulation.forms:  # others where bodies were divided anew
            self._forms = self._simulation.forms
            self._stress = self._forms.stress_evaluator()
        self._simulation.displacement  # noqa: B018  brings the state into the forms
        stress, part = self._stress(), self._simulation.part
        if part is None or self._shares:
            return stress
        return self._simulation.ranks.gather(part.cells, stress)

    def displacement(self) -> np.ndarray:
        """Displacement of the geometry nodes that are shown, shape (num_nodes, dim), m."""
        return VertexValues(self._simulation).displacement()

    @property
    def series(self) -> list[TimeSeries]:
        """Those that this rank writes."""
        return [*self._files["bulk"], *self._files["interfaces"]]

    def _write(self, name: str, *fields: Mapping[str, np.ndarray]) -> None:
        """Write fields on points, and on cells, into the files of a series."""
        files, time = self._files[name], self._simulation.time
        of_file: list[tuple[Mapping[str, np.ndarray], ...]] = [fields] * len(files)
        if self._shares:
            parts = [
                {field: filed(array) for field, array in one.items()}
                for filed, one in zip(self._filed[name], fields, strict=True)
            ]
            of_file = [
                tuple({field: arrays[k] for field, arrays in part.items()} for part in parts)
                for k in range(len(files))
            ]

        def write() -> None:
            for file, given in zip(files, of_file, strict=True):
                file.write(time, *given)

        self._where_written(write)

    def _where_written(self, call: Callable[[], object]) -> None:
        """Call something on the ranks that write; what one raises is raised on all."""
        team = self._simulation.team
        (team.together if self._shares else team.at_root)(call)

    def _numbers(self) -> dict[str, dict[str, np.ndarray]]:
        """Numbers of points and cells of each series, which no partition decides."""
        bodies, points, team = self._bodies, self._simulation.model.points, self._simulation.team
        vertices = 1 + int(team.max(bodies.parent_vertex.max(initial=0)))
        node = bodies.labels.astype(np.int64)[self._body_of_node()] * vertices
        numbers = {
            "bulk": {"point": node + bodies.parent_vertex, "cell": bodies.parent_cell.astype(int)}
        }
        if self._has_points:
            places = shown_places(self._simulation)
            facet, on_facet = np.divmod(places, max(points.points_a_facet, 1))
            point = points.facet_numbers[facet] * points.points_a_facet + on_facet
            numbers["interfaces"] = {"point": point}
        return numbers

    def _body_of_node(self) -> np.ndarray:
        """Body of each geometry node, shape (num_nodes,)."""
        body = np.empty(len(self._bodies.parent_vertex), int)
        body[self.cells] = self._bodies.body_of_cell[:, None]
        return body

    def _open(
        self,
        after: Mapping[str, Mapping[str, float]],
        numbers: Mapping[str, Mapping[str, np.ndarray]],
    ) -> None:
        simulation, mesh = self._simulation, self._bodies.mesh
        names = [""]
        if self._shares:
            team = simulation.team
            num_files = ranks_that_wrote(after) or team.size
            names = [f"_{number}" for number in range(team.rank, num_files, team.size)]

        def open_files(name: str, x: np.ndarray, cells: tuple[str, np.ndarray]) -> None:
            for ending in names:
                path = self._folder / f"{name}{ending}.xdmf"
                file = TimeSeries(path, x, cells, after.get(path.stem), numbers.get(name))
                self._files[name].append(file)

        x = mesh.geometry.x[:, : mesh.geometry.dim]
        open_files("bulk", x, (mesh.topology.cell_name(), self.cells))
        if self._has_points:
            x, points = coordinates_of_known(simulation), simulation.model.points
            kind = {2: "line", 3: "triangle"}.get(points.points_a_facet, "vertex")
            if self._shares:  # the points of a facet may be on several ranks
                x, kind = x[shown_places(simulation)], "vertex"
            corners = {"line": 2, "triangle": 3, "vertex": 1}[kind]
            cells = np.arange(len(x)).reshape(-1, corners)
            open_files("interfaces", x, (kind, cells))


def coordinates_of_known(simulation: Simulation) -> np.ndarray:
    """Reference positions of the points on `facets_with_law`, facet after facet, (n, dim), m."""
    scene = simulation.scene
    x = scene.bodies.facet_nodes(scene.order)[simulation.facets_with_law]
    shapes = facet_shapes(scene.dim, x.shape[1], scene.points)
    return np.einsum("pk,fkd->fpd", shapes, x).reshape(-1, scene.dim)


def point_coordinates(simulation: Simulation) -> np.ndarray:
    """Reference positions of the points on facing facets, in the scene's order.

    Returns:
        Shape (num_points, dim), m; points of walls, which come last in the scene, are left out. Of
        a mesh that is spread over ranks those of the rank's own points.

    Raises:
        ValueError: a scene without a mesh.
    """
    if simulation.scene.bodies is None:
        raise ValueError("A scene without a mesh has no facets that points could be on.")
    return coordinates_of_known(simulation)[shown_places(simulation)]


def shown_places(simulation: Simulation) -> np.ndarray:
    """Places of points among those on `facets_with_law`: of all, or of this rank's.

    They are the rank's of a mesh that is spread, and points of walls are left out.
    """
    points = simulation.model.points
    if simulation.scene.bodies.spread is not None:
        return points.on_facets()[0]
    return np.arange(len(points.facets_with_law) * points.points_a_facet)


def shown_values(simulation: Simulation, name: str) -> np.ndarray:
    """What `Interactions.gather` has for the points of `shown_places`, whose order they have."""
    points = simulation.interactions
    read = points.gather if simulation.scene.bodies.spread is None else points.local
    return read(name)[: len(shown_places(simulation))]  # ties and walls come last


def remove_series(folder: Path) -> None:
    """Remove the series of an earlier run, which perhaps more ranks wrote, or one for all."""
    for path in folder.iterdir():
        if _SERIES.fullmatch(path.name):
            path.unlink()


def ranks_that_wrote(series: Mapping[str, object]) -> int:
    """How many ranks wrote fields of their own, by the names of their files; 0 if one wrote all."""
    return sum(name.startswith("bulk_") for name in series)
