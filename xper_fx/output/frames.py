# SPDX-License-Identifier: LGPL-3.0-or-later
"""The bodies of a run as they are, what colours them and how they push, for pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import basix
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from xper_fx.nscd.rigid.outline import body_outlines, piece_faces
from xper_fx.nscd.rigid.shapes import DISC, SPHERE
from xper_fx.output.body_shapes import equal_diameters
from xper_fx.output.contact_forces import ContactForces, find_contact_forces
from xper_fx.output.vertex_values import VertexValues
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.checks import require_kind, require_numbers
from xper_fx.support.compat import geometry_dofmap

# What the title of a colour bar says of a quantity; groups are kinds, which have a legend.
_LABELS = {
    "group": None,
    "speed": "speed (m/s)",
    "spin": "spin (rad/s)",
    "rotation": "rotation (rad)",
    "coordination": "bodies that push it",
    "size": "diameter (m)",
}
# How many times farther than the bodies at the start a wall reaches in a picture in the plane.
_BEYOND = 20.0
# Sides of a circle, by dimension.
_SEGMENTS = {2: 24, 3: 12}

Colour = str | npt.ArrayLike | Callable[[Simulation], npt.ArrayLike]
"""What colours bodies, as `take_frame` says."""


@dataclass(frozen=True)
class Frame:
    """The bodies at one time.

    Attributes:
        title: of the picture.
        faces: corners of each face, shape (num_corners, dim), m. In 2D cells and rigid bodies, in
            3D their surfaces, counter-clockwise seen from outside.
        values: what colours the faces, shape (num_faces,); NaN has none.
        edged: which faces bear a border, those of rigid bodies, shape (num_faces,), bool.
        walls: faces of walls.
        marks: radii that show how discs have turned, shape (n, 2, 2), m; none in 3D.
        chains: segments from the middles of bodies to their contacts, shape (m, 2, dim), m.
        forces: force that each segment stands for, shape (m,), N (2D: N/m).
        label: of a colour bar; None where values number kinds.
        names: of kinds that a legend tells.
    """

    title: str
    faces: list[np.ndarray]
    values: np.ndarray
    edged: np.ndarray
    walls: list[np.ndarray]
    marks: np.ndarray
    chains: np.ndarray
    forces: np.ndarray
    label: str | None = None
    names: Mapping[int, str] = field(default_factory=dict)


def take_frame(simulation: Simulation, colour: Colour = "group", title: str | None = None) -> Frame:
    """The bodies of a simulation as they are now; all ranks call it together.

    Args:
        simulation: the run.
        colour: what colours the bodies. "group" (of meshed bodies, the surface they belong to or
            their material), "speed" of the centre, or "coordination", the number of other bodies
            that push; of rigid bodies alone "spin" (in 3D its size), "rotation" since the start (in
            3D its angle, at most pi) and "size", the diameter of the disc or ball of equal volume.
            Or values of one's own: one a cell of the mesh, then one a rigid body; those of all
            rigid bodies, or of walls, may be left out or NaN. Or a function that gives them.
        title: of the picture; None tells the time.

    Raises:
        TypeError: no simulation, values that are no numbers.
        ValueError: an unknown quantity, another number of values than cells and rigid bodies.
    """
    require_kind("simulation", simulation, Simulation)
    scene, rigid, dim = simulation.scene, simulation.rigid, simulation.bulk.dim
    contacts = find_contact_forces(simulation)
    faces: list[np.ndarray] = []
    owner, middles = np.empty(0, int), np.empty((0, dim))
    num_cells = 0
    if scene.bodies is not None:
        scene.bodies.require_whole("A picture of all bodies")
        cells = geometry_dofmap(scene.bodies.mesh)
        num_cells = len(cells)
        x = scene.bodies.mesh.geometry.x[:, :dim] + VertexValues(simulation).displacement()
        shown, owner = _cell_faces(scene.bodies.mesh.topology.cell_name(), cells, x)
        faces = list(x[shown])
        body = scene.bodies.body_of_cell
        middle = x[cells].mean(axis=1)
        total = [np.bincount(body, column) for column in middle.T]
        middles = np.column_stack(total) / np.bincount(body)[:, None]
    edged, walls, marks = np.zeros(len(faces), bool), [], np.empty((0, 2, 2))
    if rigid is not None:
        bounded, pieces = np.isfinite(rigid.bodies.bounding_radius), rigid.bodies.shapes
        state = rigid.state
        outline = body_outlines(rigid.bodies, _SEGMENTS[dim])
        x = outline.positions(state.position, state.turn.rotation)
        loops, piece = piece_faces(rigid.bodies, outline)
        body = pieces.body[piece]
        is_wall = ~bounded[body]
        if dim == 2:
            # a half plane has no end; the window cuts it
            beyond = ~bounded[outline.body_of_point]
            middle = state.position[outline.body_of_point[beyond]]
            x[beyond] = middle + _BEYOND * (x[beyond] - middle)
        walls = [x[loop] for loop, wall in zip(loops, is_wall, strict=True) if wall]
        faces += [x[loop] for loop, wall in zip(loops, is_wall, strict=True) if not wall]
        owner = np.concatenate([owner, num_cells + body[~is_wall]])
        edged = np.concatenate([edged, pieces.kind[piece[~is_wall]] != SPHERE])
        middles = np.concatenate([middles, np.where(bounded[:, None], state.position, np.nan)])
        if dim == 2:
            rim = np.array([loop[0] for loop in loops])[pieces.kind == DISC]
            marks = np.stack([x[rim - 1], x[rim]], axis=1)
    values, label, names = _values(simulation, colour, num_cells, contacts)
    if title is None:
        title = f"{simulation.time:.4g} s"
    return Frame(
        title, faces, values[owner], edged, walls, marks, *_chains(contacts, middles), label, names
    )


def _cell_faces(name: str, cells: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What is seen of cells: themselves (2D), or sides that no other cell of their body has (3D).

    Returns:
        Nodes of each face in order, shape (num_faces, corners), and its cell, shape (num_faces,).
    """
    if x.shape[1] == 2:
        return _in_order(cells), np.arange(len(cells))
    sides = np.array(basix.topology(basix.CellType[name])[2])
    face = _in_order(cells[:, sides].reshape(-1, sides.shape[1]))
    cell = np.repeat(np.arange(len(cells)), len(sides))
    _, which, count = np.unique(
        np.sort(face, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    outer = count[which.ravel()] == 1
    face, cell = face[outer], cell[outer]
    corner = x[face]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    outward = corner.mean(axis=1) - x[cells[cell]].mean(axis=1)
    inside_out = np.einsum("ni,ni->n", normal, outward) < 0.0
    face[inside_out] = face[inside_out, ::-1]
    return face, cell


def _in_order(corners: np.ndarray) -> np.ndarray:
    """Corners of triangles or of quadrilaterals, which DOLFINx numbers as a grid, going round."""
    return corners if corners.shape[1] == 3 else corners[:, [0, 1, 3, 2]]


def _chains(contacts: ContactForces, middles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Segments from the middles of the bodies of contacts, and their forces."""
    dim = contacts.position.shape[1]
    points = np.broadcast_to(contacts.position[:, None], (len(contacts.position), 2, dim))
    chains = np.stack([points, middles[contacts.bodies]], axis=2).reshape(-1, 2, dim)
    forces = np.repeat(np.linalg.norm(contacts.force, axis=1), 2)
    ended = np.isfinite(chains).all(axis=(1, 2))  # a wall has no middle
    return chains[ended], forces[ended]


def _values(
    simulation: Simulation, colour: Colour, num_cells: int, contacts: ContactForces
) -> tuple[np.ndarray, str | None, dict[int, str]]:
    """Values of the cells and then of the rigid bodies, what they are, names of kinds."""
    num_rigid = len(simulation.scene.rigid)
    names: dict[int, str] = {}
    if isinstance(colour, str):
        if colour not in _LABELS:
            raise ValueError(
                f"colour should be one of {', '.join(_LABELS)}, or values; got {colour!r}."
            )
        cells = np.full(num_cells, np.nan)
        if num_cells:
            cells, names = _of_cells(simulation, colour, contacts)
        rigid = np.full(num_rigid, np.nan)
        if num_rigid:
            rigid = _of_rigid(simulation, colour, contacts)
            if colour == "group":
                names = dict(enumerate(simulation.rigid.bodies.groups)) | names
        return np.concatenate([cells, rigid]), _LABELS[colour], names
    given = require_numbers("values", colour(simulation) if callable(colour) else colour)
    if given.shape not in ((num_cells + num_rigid,), (num_cells,)):
        some = f" (or ({num_cells},))" if num_cells and num_rigid else ""
        raise ValueError(
            f"values should be one a cell and then one a rigid body, shape "
            f"({num_cells + num_rigid},){some}, got {given.shape}."
        )
    missing = np.full(num_cells + num_rigid - len(given), np.nan)
    return np.concatenate([given, missing]), None, names


def _of_cells(
    simulation: Simulation, colour: str, contacts: ContactForces
) -> tuple[np.ndarray, dict[int, str]]:
    """A quantity of each cell, NaN where cells have it not; names of kinds."""
    scene = simulation.scene
    cells = geometry_dofmap(scene.bodies.mesh)
    if colour == "speed":
        velocity = VertexValues(simulation).velocity()[cells].mean(axis=1)
        return np.linalg.norm(velocity, axis=1), {}
    if colour == "coordination":
        return _coordination(contacts, scene.bodies.num_bodies)[scene.bodies.body_of_cell], {}
    if colour != "group":
        return np.full(len(cells), np.nan), {}
    surface = {tag: name for name, tags in scene.surfaces.items() for tag in tags}
    tags, which = np.unique(scene.bodies.material_of_cell, return_inverse=True)
    known = list(dict.fromkeys(surface.get(tag, f"material {tag}") for tag in tags.tolist()))
    first = 0 if simulation.rigid is None else len(simulation.rigid.bodies.groups)
    kinds = [first + known.index(surface.get(t, f"material {t}")) for t in tags.tolist()]
    return np.array(kinds, float)[which], dict(enumerate(known, first))


def _of_rigid(simulation: Simulation, colour: str, contacts: ContactForces) -> np.ndarray:
    """A quantity of each rigid body, walls included."""
    motion, dim = simulation.rigid, simulation.bulk.dim
    state, start = motion.state, motion.start
    if colour == "group":
        return motion.bodies.group_of.astype(float)
    if colour == "speed":
        return np.linalg.norm(state.velocity, axis=1)
    if colour == "spin":
        return state.turn.spin[:, 0] if dim == 2 else np.linalg.norm(state.turn.spin, axis=1)
    if colour == "rotation":
        now, then = state.turn.rotation, start.turn.rotation
        if dim == 2:
            return now - then
        return Rotation.from_matrix(now @ then.transpose(0, 2, 1)).magnitude()
    if colour == "coordination":
        meshed = 0 if simulation.scene.bodies is None else simulation.scene.bodies.num_bodies
        return _coordination(contacts, meshed + len(motion.bodies))[meshed:]
    return equal_diameters([body.shape for body in simulation.scene.rigid])


def _coordination(contacts: ContactForces, count: int) -> np.ndarray:
    """How many others push each of the first `count` bodies."""
    pairs = np.unique(np.sort(contacts.bodies, axis=1), axis=0)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]  # a body may fold upon itself
    return np.bincount(pairs.ravel(), minlength=count)[:count].astype(float)
