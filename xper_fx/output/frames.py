# SPDX-License-Identifier: LGPL-3.0-or-later
"""The bodies of a run as they are, what colours them and how they push, for pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import basix
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from xper_fx.bodies.explode import Bodies
from xper_fx.nscd.rigid.outline import body_outlines, piece_faces
from xper_fx.nscd.rigid.shapes import DISC, SPHERE
from xper_fx.output.body_shapes import equal_diameters
from xper_fx.output.contact_forces import ContactForces, find_contact_forces
from xper_fx.output.vertex_values import VertexValues
from xper_fx.simulation.simulation import Simulation
from xper_fx.simulation.slot_bodies import first_rigid
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

    Of a mesh that is spread over ranks the first one gets the frame of all bodies, which it holds
    whole, and each other rank that of its own.

    Args:
        simulation: the run.
        colour: what colours the bodies. "group" (of meshed bodies, the surface they belong to or
            their material), "speed" of the centre, or "coordination", the number of other bodies
            that push; of rigid bodies alone "spin" (in 3D its size), "rotation" since the start (in
            3D its angle, at most pi) and "size", the diameter of the disc or ball of equal volume.
            Or values of one's own: one a cell of `Scene.bodies`, then one a rigid body; those of
            all rigid bodies, or of walls, may be left out or NaN. Or a function that gives them.
        title: of the picture; None tells the time.

    Raises:
        TypeError: no simulation, values that are no numbers.
        ValueError: an unknown quantity, another number of values than cells and rigid bodies.
    """
    require_kind("simulation", simulation, Simulation)
    scene, rigid, dim = simulation.scene, simulation.rigid, simulation.bulk.dim
    contacts = find_contact_forces(simulation)
    values, label, names = _values(simulation, colour, contacts)
    num_cells = len(values) - len(scene.rigid)
    faces: list[np.ndarray] = []
    shown, middles = np.empty(0), np.empty((0, dim))
    if scene.bodies is not None:
        cell_faces, shown, middles = _meshed(simulation, values[:num_cells])
        faces = list(cell_faces)
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
        shown = np.concatenate([shown, values[num_cells + body[~is_wall]]])
        edged = np.concatenate([edged, pieces.kind[piece[~is_wall]] != SPHERE])
        middles = np.concatenate([middles, np.where(bounded[:, None], state.position, np.nan)])
        if dim == 2:
            rim = np.array([loop[0] for loop in loops])[pieces.kind == DISC]
            marks = np.stack([x[rim - 1], x[rim]], axis=1)
    if title is None:
        title = f"{simulation.time:.4g} s"
    return Frame(
        title, faces, shown, edged, walls, marks, *_chains(contacts, middles), label, names
    )


def _meshed(
    simulation: Simulation, values: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What is seen of meshed bodies, of a mesh that is spread over ranks as `take_frame` says.

    Args:
        values: what colours the cells that are drawn, shape (num_cells,).

    Returns:
        Corners of the faces, shape (num_faces, corners, dim), m; their values; the middles of the
        bodies by their numbers in `ContactForces.bodies`, m, NaN of those that are not drawn here.
    """
    bodies, dim = _drawn(simulation), simulation.bulk.dim
    cells = geometry_dofmap(bodies.mesh)
    x = bodies.mesh.geometry.x[:, :dim] + VertexValues(simulation).displacement()
    shown, owner = _cell_faces(bodies.mesh.topology.cell_name(), cells, x)
    body = bodies.body_of_cell
    total = [np.bincount(body, column) for column in x[cells].mean(axis=1).T]
    middle = np.column_stack(total) / np.bincount(body)[:, None]
    spread = simulation.scene.bodies.spread
    if spread is None:
        return x[shown], values[owner], middle
    seen = x[shown], values[owner], bodies.parent_cell[owner], middle, bodies.labels
    heard = spread.ranks.comm.gather(seen) or [seen]
    faces, values, cell, middle, label = map(np.concatenate, zip(*heard, strict=True))
    order = np.argsort(cell, kind="stable")
    middles = np.full((first_rigid(simulation), dim), np.nan)
    middles[label] = middle
    return faces[order], values[order], middles


def _drawn(simulation: Simulation) -> Bodies:
    """The meshed bodies that are drawn, of a mesh that is spread over ranks this rank's."""
    bodies = simulation.scene.bodies
    return bodies if bodies.spread is None else simulation.bodies


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
    simulation: Simulation, colour: Colour, contacts: ContactForces
) -> tuple[np.ndarray, str | None, dict[int, str]]:
    """Values of the cells that are drawn, then of rigid bodies; what they are, names of kinds."""
    bodies, num_rigid = simulation.scene.bodies, len(simulation.scene.rigid)
    names: dict[int, str] = {}
    if isinstance(colour, str):
        if colour not in _LABELS:
            raise ValueError(
                f"colour should be one of {', '.join(_LABELS)}, or values; got {colour!r}."
            )
        cells = np.empty(0)
        if bodies is not None:
            cells, names = _of_cells(simulation, colour, contacts)
        rigid = np.full(num_rigid, np.nan)
        if num_rigid:
            rigid = _of_rigid(simulation, colour, contacts)
            if colour == "group":
                names = dict(enumerate(simulation.rigid.bodies.groups)) | names
        return np.concatenate([cells, rigid]), _LABELS[colour], names
    given = colour(simulation) if callable(colour) else colour
    num_cells = 0 if bodies is None else len(bodies.body_of_cell)
    values = simulation.ranks.together(lambda: _checked_values(given, num_cells, num_rigid))
    if bodies is not None and bodies.spread is not None:
        values = np.concatenate([values[simulation.part.cells], values[num_cells:]])
    return values, None, names


def _checked_values(given: npt.ArrayLike, num_cells: int, num_rigid: int) -> np.ndarray:
    """Values of one's own, of all cells and rigid bodies."""
    values = require_numbers("values", given)
    if values.shape not in ((num_cells + num_rigid,), (num_cells,)):
        some = f" (or ({num_cells},))" if num_cells and num_rigid else ""
        raise ValueError(
            f"values should be one a cell and then one a rigid body, shape "
            f"({num_cells + num_rigid},),{some}, got {values.shape}."
        )
    missing = np.full(num_cells + num_rigid - len(values), np.nan)
    return np.concatenate([values, missing])


def _of_cells(
    simulation: Simulation, colour: str, contacts: ContactForces
) -> tuple[np.ndarray, dict[int, str]]:
    """A quantity of each cell that is drawn, NaN where cells have it not; names of kinds."""
    scene, bodies = simulation.scene, _drawn(simulation)
    cells = geometry_dofmap(bodies.mesh)
    if colour == "speed":
        velocity = VertexValues(simulation).velocity()[cells].mean(axis=1)
        return np.linalg.norm(velocity, axis=1), {}
    if colour == "coordination":
        number = bodies.body_of_cell
        if scene.bodies.spread is not None:
            number = bodies.labels[number]
        return _coordination(contacts, first_rigid(simulation))[number], {}
    if colour != "group":
        return np.full(len(cells), np.nan), {}
    surface = {tag: name for name, tags in scene.surfaces.items() for tag in tags}
    tags = sorted(scene.bodies.present.cells)
    known = list(dict.fromkeys(surface.get(tag, f"material {tag}") for tag in tags))
    first = 0 if simulation.rigid is None else len(simulation.rigid.bodies.groups)
    kinds = [first + known.index(surface.get(t, f"material {t}")) for t in tags]
    which = np.searchsorted(tags, bodies.material_of_cell)
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
        meshed = first_rigid(simulation)
        return _coordination(contacts, meshed + len(motion.bodies))[meshed:]
    return equal_diameters([body.shape for body in simulation.scene.rigid])


def _coordination(contacts: ContactForces, count: int) -> np.ndarray:
    """How many others push each of the first `count` bodies."""
    pairs = np.unique(np.sort(contacts.bodies, axis=1), axis=0)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]  # a body may fold upon itself
    return np.bincount(pairs.ravel(), minlength=count)[:count].astype(float)
