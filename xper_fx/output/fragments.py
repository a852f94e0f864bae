# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Pieces that bonds still hold together: mass, size, motion, energies, what their creation took.

Masses are those of the scheme, lumped at the nodes of meshed bodies. With x and v of the nodes, and
J and L of rigid bodies about their own centres, a fragment has

    m = sum m_a,   m c = sum m_a x_a,   m V = sum m_a v_a,
    J = sum [J_a + m_a (|r|^2 I - r r^T)],   J omega = L = sum [L_a + m_a r x (v - V)],   r = x - c,

so that masses, momenta m V, angular momenta c x m V + L and kinetic energies of all fragments add
up to those of the scheme, to rounding. The kinetic energy is m V.V / 2 (translation),
omega.J.omega / 2 (rotation) and the rest, sum m_a |v - V - omega x r|^2 / 2 (vibration).

Sizes are of the solid as it is now. Lengths are the sides of the box that has its volume's second
moments, so that a rectangle gets its sides, and the diameter that of a ball of its volume.
"""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from xper_fx.nscd.point_values import BROKEN
from xper_fx.output.body_shapes import Moments, cell_moments, rigid_moments
from xper_fx.output.connectivity import Connected, find_connected, of_bodies, spread_of
from xper_fx.output.fragment_rows import WholeRows
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.checks import require_path
from xper_fx.support.files import write_file
from xper_fx.support.ranks import ALONE

if TYPE_CHECKING:
    from xper_fx.output.divided_fragments import DividedRows

_AXES = "xyz"
_SCALARS = (
    "bodies", "mass", "volume", "diameter", "elongation", "translation", "rotation", "vibration",
    "elastic", "border", "inside",
)  # fmt: skip
_VECTORS = ("centre", "velocity", "spin", "angular_momentum", "lengths")


@dataclass(frozen=True, eq=False)
class Fragments:
    """Connected pieces at a time, a row each, the heaviest first; n pieces.

    Of a mesh that is spread over ranks each rank has n of the rows, which follow each other from
    rank to rank: sums, extremes and histograms are those of the ranks put together.

    Energies are in J (2D: J/m). Bonds between two fragments count half to each side.

    Attributes:
        time: s.
        fragment: the row of each body, shape (num_bodies,), as `find_fragments` gives it.
        first: the first row that this rank has; 0 but of a mesh that is spread over ranks.
        count: how many rows there are on all ranks.
        bodies: how many bodies a fragment has, shape (n,), int.
        mass: kg (2D: kg/m), shape (n,).
        volume: m^3 (2D: m^2), shape (n,).
        centre: of mass, shape (n, dim), m.
        velocity: of the centre, shape (n, dim), m/s.
        spin: angular velocity, shape (n, 1) in 2D, counter-clockwise, (n, 3) in 3D, rad/s.
        angular_momentum: about the centre, shape (n, 1) or (n, 3), kg m^2/s (2D: kg m/s).
        lengths: sides of the box with the same second moments, longest first, shape (n, dim), m.
        translation, rotation, vibration: parts of the kinetic energy, shape (n,).
        elastic: energy stored in its bodies, shape (n,); that stored in bonds is none of it.
        border: what the bonds on its border have dissipated, half of it, shape (n,): its part in
            what made it. NaN where a law with damage has no `fracture_energy`.
        inside: what bonds between its own bodies have dissipated, shape (n,): cracks that cut
            nothing off yet.
    """

    time: float
    fragment: npt.NDArray[np.int32]
    first: int
    count: int
    bodies: npt.NDArray[np.int64]
    mass: npt.NDArray[np.float64]
    volume: npt.NDArray[np.float64]
    centre: npt.NDArray[np.float64]
    velocity: npt.NDArray[np.float64]
    spin: npt.NDArray[np.float64]
    angular_momentum: npt.NDArray[np.float64]
    lengths: npt.NDArray[np.float64]
    translation: npt.NDArray[np.float64]
    rotation: npt.NDArray[np.float64]
    vibration: npt.NDArray[np.float64]
    elastic: npt.NDArray[np.float64]
    border: npt.NDArray[np.float64]
    inside: npt.NDArray[np.float64]

    def __len__(self) -> int:
        """Number of fragments, of a mesh that is spread those of this rank."""
        return len(self.mass)

    @property
    def diameter(self) -> npt.NDArray[np.float64]:
        """Diameter of a ball (2D: a disc) of the same volume, shape (n,), m."""
        if self.centre.shape[1] == 2:
            return np.sqrt(4.0 / np.pi * self.volume)
        return np.cbrt(6.0 / np.pi * self.volume)

    @property
    def elongation(self) -> npt.NDArray[np.float64]:
        """Longest length over shortest, shape (n,)."""
        return self.lengths[:, 0] / self.lengths[:, -1]

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write a line a fragment, in full double precision, SI units.

        Columns are the attributes, of vectors one a component: `centre_x`, `length_1`, ... Where
        several ranks simulate, one of them writes; of a mesh that is spread, each its rows into a
        file of its own.

        Args:
            path: the file; one that is there is replaced.

        Raises:
            OSError: the file cannot be written.
            TypeError: no path.
        """
        columns: dict[str, np.ndarray] = {"fragment": self.first + np.arange(len(self))}
        columns |= {name: getattr(self, name) for name in _SCALARS[:3]}
        for name in _VECTORS:
            values = getattr(self, name)
            columns |= {_column(name, k, values.shape[1]): v for k, v in enumerate(values.T)}
        columns |= {name: getattr(self, name) for name in _SCALARS[3:]}
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))
        write_file(require_path("path", path), text.getvalue().encode())


def _column(name: str, k: int, count: int) -> str:
    if count == 1:
        return name
    return f"length_{k + 1}" if name == "lengths" else f"{name}_{_AXES[k]}"


class _Masses(NamedTuple):
    """Nodes of this rank's meshed bodies and centres of rigid bodies; vectors have 3 components.

    In 2D the third is zero but for spins, and a disc is taken for a ball, which changes nothing.
    """

    fragment: np.ndarray
    mass: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    inertia: np.ndarray  # about the own centre, shape (n, 3, 3)
    spin: np.ndarray


def measure_fragments(simulation: Simulation, share: float = BROKEN) -> Fragments:
    """Measure the connected pieces of a run as they are now; all ranks call it together.

    Which bonds are broken, and in which order fragments come, says `find_fragments`. Rigid bodies
    are a fragment each unless contacts whose law is a bond join them. What bonds have dissipated is
    the share that they have spent of their law's `fracture_energy`, exact for bonds whose energy
    does not hang on the direction of their jump; contacts that were found are left out of it.

    Args:
        simulation: a run.
        share: of its fracture energy that a broken bond has spent.

    Returns:
        The same table on all ranks; of a mesh that is spread over them, some rows on each.

    Raises:
        ValueError: a share out of (0, 1], a periodic cell, whose pieces go on over its border and
            have no centre.
        TypeError: no simulation, something that is no number.
    """
    connected = find_connected(simulation, share)
    bodies, dim = simulation.scene.bodies, simulation.bulk.dim
    cells = simulation.scene.lattice, getattr(bodies, "lattice", None)
    if any(lattice is not None for lattice in cells):
        raise ValueError(
            "The pieces of a periodic cell go on over its border and have no centre, spin or "
            "length; find_fragments(simulation) says which bodies they are."
        )
    fragment, (sides, lost) = of_bodies(simulation, connected), _lost(simulation, connected)
    of_body = np.concatenate(
        [fragment[_own_bodies(simulation)], _rigid_fragments(simulation, fragment)]
    )
    rows: WholeRows | DividedRows
    if spread_of(simulation) is None:
        ranks = ALONE if simulation.part is None else simulation.ranks
        rows = WholeRows(ranks, int(fragment.max(initial=-1)) + 1)
    else:
        from xper_fx.output.divided_fragments import DividedRows

        rows = DividedRows(simulation.ranks, np.concatenate([of_body, sides.ravel()]))
    total, at = rows.total, rows.at

    a = _masses(simulation, fragment)
    mass = total(a.fragment, a.mass)
    centre = total(a.fragment, a.mass[:, None] * a.position) / mass[:, None]
    velocity = total(a.fragment, a.mass[:, None] * a.velocity) / mass[:, None]
    arm, relative = a.position - at(centre, a.fragment), a.velocity - at(velocity, a.fragment)
    squared = np.einsum("ni,ni->n", arm, arm)[:, None, None] * np.eye(3)
    outer = arm[:, :, None] * arm[:, None]
    inertia = total(a.fragment, a.inertia + a.mass[:, None, None] * (squared - outer))
    own = np.einsum("nij,nj->ni", a.inertia, a.spin)
    momentum = total(a.fragment, own + a.mass[:, None] * np.cross(arm, relative))
    spin = np.linalg.solve(inertia, momentum[:, :, None])[:, :, 0]
    turn = at(spin, a.fragment)
    rest, turning = relative - np.cross(turn, arm), a.spin - turn
    rest_energy = a.mass * np.einsum("ni,ni->n", rest, rest)
    rest_energy += np.einsum("ni,nij,nj->n", turning, a.inertia, turning)
    moves = 0.5 if simulation.options.inertia else 0.0
    volume, lengths = _sizes(simulation, fragment, centre[:, :dim], rows)
    within = sides[:, 0] == sides[:, 1]
    axes = slice(2, 3) if dim == 2 else slice(3)
    return Fragments(
        simulation.time, fragment, rows.first, rows.count,
        total(of_body, np.ones(len(of_body))).astype(np.int64), mass, volume,
        centre[:, :dim], velocity[:, :dim], spin[:, axes], momentum[:, axes], lengths,
        moves * mass * np.einsum("ni,ni->n", velocity, velocity),
        moves * np.einsum("ni,ni->n", spin, momentum), moves * total(a.fragment, rest_energy),
        _elastic(simulation, fragment, total),
        total(sides[~within].ravel(), np.repeat(0.5 * lost[~within], 2)),
        total(sides[within, 0], lost[within]),
    )  # fmt: skip


def _own_bodies(simulation: Simulation) -> slice | np.ndarray:
    """Which of all meshed bodies are this rank's."""
    if simulation.part is not None:
        return simulation.part.body_numbers
    bodies = simulation.scene.bodies
    return slice(0 if bodies is None else bodies.num_bodies)


def _node_fragments(simulation: Simulation, fragment: np.ndarray) -> np.ndarray:
    return fragment[_own_bodies(simulation)][simulation.bulk.layout.body_of_node()]


def _rigid_fragments(simulation: Simulation, fragment: np.ndarray) -> np.ndarray:
    """Of the rigid bodies, which all ranks have and one counts; -1 for walls and on other ranks."""
    label = fragment[len(fragment) - len(simulation.scene.rigid) :]
    elsewhere = simulation.part is not None and simulation.ranks.rank > 0
    return np.full(len(label), -1) if elsewhere else label


def _in_space(values: np.ndarray) -> np.ndarray:
    return np.pad(values, ((0, 0), (0, 3 - values.shape[1])))


def _masses(simulation: Simulation, fragment: np.ndarray) -> _Masses:
    bulk, state, rigid = simulation.bulk, simulation.state, simulation.rigid
    parts = []
    if simulation.scene.bodies is not None:
        x = simulation.forms.V.tabulate_dof_coordinates()[:, : bulk.dim]
        nodes = len(x)
        parts.append(
            _Masses(
                _node_fragments(simulation, fragment),
                bulk.weights[:: bulk.dim],
                _in_space(x + state.displacement.reshape(x.shape)),
                _in_space(state.velocity.reshape(x.shape)),
                np.zeros((nodes, 3, 3)),
                np.zeros((nodes, 3)),
            )
        )
    if rigid is not None:
        has = rigid.bodies.mass > 0.0
        turn, mass = rigid.state.turn, rigid.bodies.mass[has]
        inertia, spin = turn.inertia[has], turn.spin[has]
        if bulk.dim == 2:
            inertia, spin = inertia * np.eye(3), np.pad(spin, ((0, 0), (2, 0)))
        parts.append(
            _Masses(
                _rigid_fragments(simulation, fragment)[has],
                mass,
                _in_space(rigid.state.position[has]),
                _in_space(rigid.state.velocity[has]),
                inertia,
                spin,
            )
        )
    return _Masses(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _sizes(
    simulation: Simulation, fragment: np.ndarray, centre: np.ndarray, rows: WholeRows | DividedRows
) -> tuple[np.ndarray, np.ndarray]:
    """Volume and lengths of each fragment."""
    parts: list[tuple[np.ndarray, Moments]] = []
    if simulation.scene.bodies is not None:
        V = simulation.forms.V
        label = fragment[_own_bodies(simulation)][simulation.bodies.body_of_cell]
        x = V.tabulate_dof_coordinates()[:, : simulation.bulk.dim]
        now = x + simulation.state.displacement.reshape(x.shape)
        parts.append((label, cell_moments(V, now[V.dofmap.list] - rows.at(centre, label)[:, None])))
    if simulation.rigid is not None:
        rigid = simulation.rigid
        label = _rigid_fragments(simulation, fragment)
        shapes = [
            body.shape if number >= 0 else None
            for body, number in zip(simulation.scene.rigid, label, strict=True)
        ]
        about = rigid.state.position - np.where(label[:, None] >= 0, rows.at(centre, label), 0.0)
        state = rigid.state._replace(position=about)
        parts.append((label, rigid_moments(rigid.bodies, shapes, state)))
    labels = np.concatenate([label for label, _ in parts])
    moments = zip(*(moments for _, moments in parts), strict=True)
    volume, first, second = (rows.total(labels, np.concatenate(column)) for column in moments)
    second = second - first[:, :, None] * first[:, None] / volume[:, None, None]
    squares = np.linalg.eigvalsh(second / volume[:, None, None])[:, ::-1]
    return volume, np.sqrt(12.0 * np.maximum(squares, 0.0))


def _elastic(simulation: Simulation, fragment: np.ndarray, total: Callable) -> np.ndarray:
    """Energy stored in the bodies of each fragment."""
    if simulation.scene.bodies is None:
        return total(fragment, np.zeros(len(fragment)))
    state = simulation.state
    if simulation.bulk.linear:
        work = 0.5 * (state.displacement * state.internal).reshape(-1, simulation.bulk.dim)
        return total(_node_fragments(simulation, fragment), work.sum(axis=1))
    label = fragment[_own_bodies(simulation)][simulation.bodies.body_of_cell]
    return total(label, simulation.forms.cell_energies(state.displacement))


def _lost(simulation: Simulation, connected: Connected) -> tuple[np.ndarray, np.ndarray]:
    """Fragments on both sides of this rank's points, shape (n, 2), and what their bonds have lost.

    Points of walls are left out.
    """
    pairs = simulation.model.points.bodies_of_own_points()
    if simulation.interactions is None:
        return connected.of(pairs), np.zeros(len(pairs))
    points = simulation.interactions
    law, energy = points.local("law"), np.zeros(len(points))
    for number, one in enumerate(points.laws):
        names, own = one.kernels(points.dim).state_names, law == number
        if "damage" in names and own.any():
            # a number, or an array over this rank's points of the law
            sound = one.initial_state()[names.index("damage")]
            energy[own] = np.multiply(sound, getattr(one, "fracture_energy", np.nan))
    energy *= points.local("area") * points.local("spent")
    return connected.of(pairs), energy[: len(pairs)]
