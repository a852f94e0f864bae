# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time series of fields, XDMF with HDF5 beside it.

They can be read while the run goes on and after it was killed: a time that was written stays
readable.
"""

import io
import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Self
from xml.etree import ElementTree

import h5py
import numpy as np
import numpy.typing as npt

from xper_fx.support.files import explained, reserve, write_all, write_file

# meshio's name (and DOLFINx's, where it differs) -> XDMF topology, nodes per cell.
_TOPOLOGY = {
    "vertex": ("Polyvertex", 1),
    "point": ("Polyvertex", 1),
    "line": ("Polyline", 2),
    "interval": ("Polyline", 2),
    "triangle": ("Triangle", 3),
    "triangle6": ("Triangle_6", 6),
    "quad": ("Quadrilateral", 4),
    "quadrilateral": ("Quadrilateral", 4),
    "tetra": ("Tetrahedron", 4),
    "tetrahedron": ("Tetrahedron", 4),
    "tetra10": ("Tetrahedron_10", 10),
    "hexahedron": ("Hexahedron", 8),
}

_XML_HEAD = b"""<?xml version="1.0" encoding="utf-8"?>
<Xdmf Version="3.0"><Domain>
<Grid Name="series" GridType="Collection" CollectionType="Temporal">
"""
_XML_TAIL = b"</Grid></Domain></Xdmf>"
_ROOM_OPEN = b"<?room "
_ROOM_CLOSE = b"?>\n"
# An overwrite inside one page of the page cache is all or nothing when the process is killed.
_PAGE = 4096
# libxml2 (ParaView's parser) refuses a processing instruction longer than 10 MB.
_ROOM_SIZES = (1 << 16, 1 << 22)


def _h5_with(mesh: Mapping[str, np.ndarray]) -> bytes:
    """An HDF5 file that holds a mesh, or nothing."""
    content = io.BytesIO()
    with h5py.File(content, "w") as h5:
        for name, array in mesh.items():
            h5[f"mesh/{name}"] = array
    return content.getvalue()


def _mesh_in(path: Path, numbers: Iterable[str]) -> tuple[np.ndarray, np.ndarray, dict]:
    """Points and cells of a file, and their numbers."""
    with h5py.File(path, "r", locking=False) as h5:
        mesh = h5["mesh"]
        found = {of: mesh[f"{of}_number"][()] for of in numbers}
        return mesh["geometry"][()], mesh["topology"][()], found


class TimeSeries:
    """One XDMF file and one HDF5 file beside it, with all fields at each time.

    The XDMF file holds one temporal collection, as ParaView and
    ``meshio.xdmf.TimeSeriesReader`` expect it, and names the HDF5 file relative to itself: move
    the two together. Both are closed and complete after every :meth:`write`, so that a run
    which is killed leaves a readable series. A kill in the middle of a write may damage the HDF5
    file, which that library changes in place; the XDMF file never names data that were not yet
    written. :meth:`seal` protects what was written before: its files are not opened again, and
    the times after it stand in a new HDF5 file (``bulk.1.h5``, ``bulk.2.h5``, ...).

    A write costs the same however many came before; to write the XDMF file anew each time would
    come to 70 GB after 10 000 times. The file ends with a processing instruction that only holds
    room: a new time is written into the room, where readers skip it, and shown by blanking the old
    end of the document, which lies in one page. A used-up room is replaced by one as large as the
    document.

    Args:
        path: The XDMF file, with suffix ``.xdmf``; the HDF5 file takes the suffix ``.h5``. A
            series that is already there is replaced.
        points: Reference coordinates, shape (num_points, dim), dim 2 or 3, float64, m.
        cells: Cell type (meshio's or DOLFINx's name: ``triangle``, ``tetra``, ``line``,
            ``vertex``, ...) and connectivity, shape (num_cells, nodes per cell), VTK's order.
        after: What :meth:`seal` gave: the series goes on after it, and what was written later is
            dropped. None for a new series.
        numbers: Numbers of the points ("point") and of the cells ("cell"), int64, for a series
            whose points and cells may come in another order, or from elsewhere, when it goes on:
            it then keeps those that are in its file, and fields are written in their order.

    Attributes:
        numbers: Those of the points and cells in the file.

    Raises:
        ValueError: If the path, the points or the cells are not as said, or a file of the series
            that shall go on is missing or cut short.
        OSError: If the files cannot be written.

    Example:
        >>> with TimeSeries("out/bulk.xdmf", points, ("triangle", triangles)) as series:
        ...     series.write(0.0, {"displacement": u}, {"material": tags})
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        points: npt.ArrayLike,
        cells: tuple[str, npt.ArrayLike],
        after: Mapping[str, float] | None = None,
        numbers: Mapping[str, npt.NDArray[np.int64]] | None = None,
    ) -> None:
        # A later change of the current folder must not redirect the output.
        self.path = Path(path).resolve()
        if self.path.suffix != ".xdmf" or ":" in self.path.name:
            raise ValueError(
                f"A time series needs a file name that ends in '.xdmf' and has no ':', "
                f"got '{path}'."
            )
        points = np.asarray(points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] not in (2, 3):
            raise ValueError(
                f"Points should have shape (num_points, 2) or (num_points, 3), got {points.shape}."
            )
        if not np.isfinite(points).all():
            raise ValueError(
                f"Points should be finite, got {points[~np.isfinite(points).all(axis=1)][0]}."
            )
        cell_type, connectivity = cells[0], np.asarray(cells[1])
        if cell_type not in _TOPOLOGY:
            raise ValueError(
                f"Unknown cell type '{cell_type}', expected one of {', '.join(_TOPOLOGY)}."
            )
        topology, nodes = _TOPOLOGY[cell_type]
        if connectivity.ndim != 2 or connectivity.shape[1] != nodes:
            raise ValueError(
                f"Cells of type '{cell_type}' should have shape (num_cells, {nodes}), "
                f"got {connectivity.shape}."
            )
        if not np.issubdtype(connectivity.dtype, np.integer):
            raise ValueError(f"Cells should be integers, got {connectivity.dtype}.")
        if connectivity.size and not (0 <= connectivity.min() and connectivity.max() < len(points)):
            raise ValueError(
                f"Cells should refer to points 0 to {len(points) - 1}, "
                f"got {connectivity.min()} to {connectivity.max()}."
            )
        self.numbers = dict(numbers or {})
        self._shapes: dict[tuple[str, str], tuple[int, ...]] | None = None
        self._num_times = 0
        self._last_time = -math.inf
        self._closed = False
        self._tail = 0
        self._xml_size = 0

        self._segment, self._sealed = 0, False
        if after is None:
            # An XDMF file of an earlier run would describe data that the new HDF5 file lacks.
            with explained(self.path):
                self.path.unlink(missing_ok=True)
            mesh = {"geometry": np.pad(points, ((0, 0), (0, 3 - points.shape[1])))}
            mesh["topology"] = connectivity.astype(np.int64)
            mesh |= {f"{of}_number": array for of, array in self.numbers.items()}
            write_file(self.h5_path, _h5_with(mesh))
        else:
            self._go_on(after)
            if numbers is not None:
                points, connectivity, self.numbers = _mesh_in(self._h5_path(0), self.numbers)
        self._sizes = {"point": len(points), "cell": len(connectivity)}
        self._drop_later_segments()
        self._grid = ElementTree.Element("Grid", Name="grid", GridType="Uniform")
        self._item(
            ElementTree.SubElement(
                self._grid,
                "Topology",
                TopologyType=topology,
                NumberOfElements=str(len(connectivity)),
                NodesPerElement=str(nodes),
            ),
            self._h5_path(0),
            "/mesh/topology",
            connectivity.shape,
            "Int",
        )
        self._item(
            ElementTree.SubElement(self._grid, "Geometry", GeometryType="XYZ"),
            self._h5_path(0),
            "/mesh/geometry",
            (len(points), 3),
        )

    @property
    def h5_path(self) -> Path:
        """The HDF5 file that is written."""
        return self._h5_path(self._segment)

    @property
    def h5_paths(self) -> list[Path]:
        """The HDF5 files of the series, the one that is written last."""
        return [self._h5_path(segment) for segment in range(self._segment + 1)]

    def _h5_path(self, segment: int) -> Path:
        return self.path.with_suffix(f".{segment}.h5" if segment else ".h5")

    def _drop_later_segments(self) -> None:
        """Remove what an earlier run has left beyond the present HDF5 file."""
        segment = self._segment + 1
        while self._h5_path(segment).exists():
            self._h5_path(segment).unlink()
            segment += 1

    def seal(self) -> dict[str, float]:
        """Let nothing that follows touch what was written so far, and see it on the disk.

        Returns:
            What a new series needs to go on from here, as its `after`.
        """
        if not self._sealed:
            for path in (self.h5_paths[-1], self.path):
                if path.exists():
                    with open(path, "rb") as file:
                        os.fsync(file.fileno())
            self._sealed = True
        return {
            "times": self._num_times,
            "last_time": self._last_time,
            "tail": self._tail,
            "segment": self._segment,
        }

    def _go_on(self, after: Mapping[str, float]) -> None:
        """Take the files back to what `seal` told of."""
        self._segment, self._sealed = after["segment"], True
        self._num_times, self._last_time = after["times"], after["last_time"]
        self._tail = after["tail"]
        for path in self.h5_paths:
            if not path.exists():
                raise ValueError(
                    f"'{path}' is missing, in which the series '{self.path.name}' stands until "
                    f"{self._last_time:g} s: put it back, or start the run from its beginning."
                )
            try:
                h5py.File(path, "r", locking=False).close()
            except OSError as error:
                raise ValueError(
                    f"'{path}', in which the series '{self.path.name}' stands until "
                    f"{self._last_time:g} s, was cut short or damaged ({error}): put it back, or "
                    "start the run from its beginning."
                ) from None
        if not self._num_times:
            self.path.unlink(missing_ok=True)
            return
        done = b""
        if self.path.exists():
            with open(self.path, "rb") as xml:
                done = xml.read(self._tail)
        if len(done) != self._tail or not done.startswith(_XML_HEAD):
            raise ValueError(
                f"'{self.path}' does not hold the {self._num_times} times until "
                f"{self._last_time:g} s that were written to it: put it back, or start the run "
                "from its beginning."
            )
        self._show(done)

    def _item(
        self,
        parent: ElementTree.Element,
        path: Path,
        dataset: str,
        shape: tuple[int, ...],
        data_type: str = "Float",
    ) -> None:
        """Let an XDMF element refer to a dataset of the HDF5 file."""
        item = ElementTree.SubElement(
            parent,
            "DataItem",
            DataType=data_type,
            Precision="8",
            Dimensions=" ".join(map(str, shape)),
            Format="HDF",
        )
        item.text = f"{path.name}:{dataset}"

    def write(
        self,
        time: float,
        point_data: Mapping[str, npt.ArrayLike] | None = None,
        cell_data: Mapping[str, npt.ArrayLike] | None = None,
    ) -> None:
        """Add a time with all its fields; the first call fixes their names and shapes.

        Fields are stored as float64: scalars of shape (n,), vectors (n, 2) or (n, 3), tensors
        (n, 2, 2) or (n, 3, 3), n being the number of points or of cells. Vectors are padded with
        zeros to 3 components, tensors to 9, stored row by row.

        Args:
            time: Time, s; greater than that of the call before.
            point_data: Fields on the points, by name.
            cell_data: Fields on the cells, by name.

        Raises:
            ValueError: If the time does not grow, a field has a shape that cannot be stored, or
                names or shapes differ from those of the first call; nothing is written then.
            OSError: If the files cannot be written. The times before stay readable, and a later
                call writes again where it can.
        """
        if self._closed:
            raise ValueError(f"The time series '{self.path}' is closed, open a new one.")
        time = float(time)
        if not self._last_time < time < math.inf:
            raise ValueError(
                f"Times should be finite and grow, got {time!r} s after {self._last_time!r} s."
            )
        fields = {
            (centre, name): np.asarray(values, dtype=np.float64)
            for centre, data in (("point", point_data), ("cell", cell_data))
            for name, values in (data or {}).items()
        }
        for (centre, name), values in fields.items():
            if not name or "/" in name or ":" in name or name == ".":
                raise ValueError(
                    f"A field needs a name without '/' and ':', got '{name}' in {centre} data."
                )
            num = self._sizes[centre]
            if values.shape not in ((num,), (num, 2), (num, 3), (num, 2, 2), (num, 3, 3)):
                raise ValueError(
                    f"The {centre} field '{name}' should have shape ({num},), ({num}, 2 or 3) or "
                    f"({num}, 2, 2) or ({num}, 3, 3), got {values.shape}."
                )
        shapes = {key: values.shape for key, values in fields.items()}
        first = shapes if self._shapes is None else self._shapes
        for centre, name in first.keys() | shapes.keys():
            before, now = first.get((centre, name)), shapes.get((centre, name))
            if before != now:
                raise ValueError(
                    f"The {centre} field '{name}' has shape {now or '(absent)'}, but "
                    f"{before or '(absent)'} in the first write, which fixes the names and "
                    "shapes: give the same fields at every time."
                )

        # HDF5 rewrites a group's list of names when one is added: short lists keep this cheap.
        group = f"/times/{self._num_times // 100:06d}/{self._num_times % 100:02d}"
        grid = ElementTree.Element("Grid", self._grid.attrib)
        ElementTree.SubElement(grid, "Time", Value=repr(time))
        grid.extend(self._grid)
        if self._sealed:
            write_file(self._h5_path(self._segment + 1), _h5_with({}))
            self._segment, self._sealed = self._segment + 1, False
        widths = (1, 3, 9)  # of scalars, vectors and tensors
        needed = sum(8 * widths[values.ndim - 1] * len(values) for values in fields.values())
        # No lock: a viewer that has the file open must not make the run fail.
        with explained(self.h5_path):
            reserve(self.h5_path, needed, len(fields))
            self._store(group, fields, grid)
        with explained(self.path):
            self._append(
                ElementTree.tostring(grid, encoding="utf-8", xml_declaration=False) + b"\n"
            )
        self._shapes = shapes
        self._last_time = time
        self._num_times += 1

    def _store(
        self,
        group: str,
        fields: Mapping[tuple[str, str], npt.NDArray[np.float64]],
        grid: ElementTree.Element,
    ) -> None:
        """Write the fields of a time to the HDF5 file, and let its grid refer to them."""
        with h5py.File(self.h5_path, "r+", locking=False) as h5:
            if group in h5:
                # of a write that failed in the XDMF file
                del h5[group]
            for (centre, name), values in fields.items():
                kind = ("Scalar", "Vector", "Tensor")[values.ndim - 1]
                values = np.pad(values, [(0, 0)] + [(0, 3 - size) for size in values.shape[1:]])
                if values.ndim == 3:
                    values = values.reshape(len(values), 9)
                dataset = f"{group}/{centre}/{name}"
                h5[dataset] = values
                attribute = ElementTree.SubElement(
                    grid,
                    "Attribute",
                    Name=name,
                    AttributeType=kind,
                    Center="Node" if centre == "point" else "Cell",
                )
                self._item(attribute, self.h5_path, dataset, values.shape)

    def _append(self, grid: bytes) -> None:
        """Add one grid to the collection of the XDMF file, which stays well-formed throughout."""
        end = _XML_TAIL + _ROOM_OPEN
        start = self._tail + len(end) if self._num_times else len(_XML_HEAD)
        tail = start + len(grid)
        if tail // _PAGE != (tail + len(end) - 1) // _PAGE:
            grid += b" " * (_PAGE - tail % _PAGE)
            tail = start + len(grid)
        if self._num_times and tail + len(end) + len(_ROOM_CLOSE) <= self._xml_size:
            with open(self.path, "r+b", buffering=0) as xml:
                xml.seek(start)
                write_all(xml, grid + end)
                xml.seek(self._tail)
                write_all(xml, b" " * len(end))
        else:
            done = _XML_HEAD
            if self._num_times:
                with open(self.path, "rb") as xml:
                    done = xml.read(self._tail) + b" " * len(end)
            self._show(done + grid)
        self._tail = tail

    def _show(self, done: bytes) -> None:
        """Put a document with these grids in place, with room behind them."""
        room = min(max(len(done), _ROOM_SIZES[0]), _ROOM_SIZES[1])
        content = done + _XML_TAIL + _ROOM_OPEN + b" " * room + _ROOM_CLOSE
        write_file(self.path, content)
        self._xml_size = len(content)

    def close(self) -> None:
        """Give the spare room of the XDMF file back; no more can be written."""
        if self._num_times and not self._closed:
            self._closed = True
            with explained(self.path):
                os.truncate(self.path, self._tail + len(_XML_TAIL))
        self._closed = True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
