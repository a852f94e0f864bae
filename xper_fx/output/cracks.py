# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where a simulation has cracked, and through what."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from xper_fx.nscd.facets import nodal_shares
from xper_fx.nscd.point_values import BROKEN
from xper_fx.output.connectivity import require_share
from xper_fx.output.field_series import coordinates_of_known, shown_places, shown_values
from xper_fx.output.recorder import Recorder
from xper_fx.plotting.figures import CrackPanel
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.checks import require_integer, require_kind


class Cracks(NamedTuple):
    """Cracked parts of edges: those of points whose bond is broken.

    Attributes:
        segments: end points in the reference configuration, shape (m, 2, 2), m.
        kind: how many of the two sides are inclusion, 0, 1 or 2, shape (m,): cracks through the
            matrix, along an interface, through an inclusion.
    """

    segments: np.ndarray
    kind: np.ndarray

    @property
    def length(self) -> np.ndarray:
        """Length of each segment, shape (m,), m."""
        return np.linalg.norm(self.segments[:, 1] - self.segments[:, 0], axis=1)


def find_cracks(
    simulation: Simulation,
    inclusion: int | None = None,
    ignored_facets: tuple[int, ...] = (),
    share: float = BROKEN,
) -> Cracks:
    """Find the cracks of a simulation in the plane; contacts and perfect bonds are none.

    Of a mesh that is spread over ranks each rank finds those at its own points, by which all cracks
    are on one rank each; all ranks call it together.

    Args:
        simulation: a run with nodal points.
        inclusion: cell tag that counts as inclusion; None: all is matrix, and all kinds are 0.
        ignored_facets: tags of facets that do not count (precracks).
        share: of its fracture energy that a broken bond has spent.

    Raises:
        ValueError: a scene without interacting facets in the plane, a tag that occurs nowhere, a
            share out of (0, 1].
        TypeError: no simulation, something that is no number.
    """
    _check(simulation, ignored_facets, share)
    if inclusion is not None:
        require_integer("inclusion", inclusion)
    if simulation.scene.dim != 2:
        raise ValueError("Cracks are segments in the plane, and the scene is in space.")
    facets = simulation.scene.bodies.facets
    number = simulation.facets_with_law
    x = coordinates_of_known(simulation).reshape(len(number), -1, simulation.bulk.dim)
    broken = broken_points(simulation, ignored_facets, share)
    facet, point = np.divmod(shown_places(simulation)[broken], max(x.shape[1], 1))
    sides = facets.materials[number[facet]]
    return Cracks(_parts(x)[facet, point], np.count_nonzero(sides == inclusion, axis=1))


def crack_area(
    simulation: Simulation, ignored_facets: tuple[int, ...] = (), share: float = BROKEN
) -> float:
    """Area of the facets whose bonds are broken, in the plane their length; of all ranks.

    Args:
        simulation, ignored_facets, share: as of `broken_points`; all ranks call it together.

    Returns:
        In the reference configuration, m^2 (2D: m).

    Raises:
        ValueError, TypeError: as `broken_points`.
    """
    broken = broken_points(simulation, ignored_facets, share)
    area = float(shown_values(simulation, "area")[broken].sum())
    return area if simulation.scene.bodies.spread is None else simulation.ranks.sum(area)


def broken_points(
    simulation: Simulation, ignored_facets: tuple[int, ...] = (), share: float = BROKEN
) -> npt.NDArray[np.bool_]:
    """At which points on facing facets the bond has spent its fracture energy, or most of it.

    What is left of a bond's secant stiffness would say less: stiffer bonds have lost most of that
    before they have spent anything.

    Args:
        simulation: a run with interactions.
        ignored_facets: tags of facets that do not count (precracks).
        share: of its fracture energy that a broken bond has spent.

    Returns:
        Shape (num_points,), in the order of `point_coordinates`; contacts and perfect bonds are
        never broken. Of a mesh that is spread over ranks those of the rank's own points; all ranks
        call it together.

    Raises:
        ValueError, TypeError: as `find_cracks`.
    """
    _check(simulation, ignored_facets, share)
    laws = simulation.interactions.laws
    breaks = np.array(["damage" in law.kernels(simulation.bulk.dim).state_names for law in laws])
    spent = shown_values(simulation, "spent")
    broken = breaks[shown_values(simulation, "law")] & (spent >= share)
    tag = simulation.scene.bodies.facets.tag[simulation.facets_with_law]
    ignored = np.repeat(np.isin(tag, ignored_facets), simulation.model.points.points_a_facet)
    return broken & ~ignored[shown_places(simulation)]


def _check(simulation: Simulation, ignored_facets: tuple[int, ...], share: float) -> None:
    require_kind("simulation", simulation, Simulation)
    scene = simulation.scene
    none = scene.bodies is None or not len(simulation.facets_with_law)
    if scene.bodies is not None and scene.bodies.spread is not None:
        none = simulation.ranks.all(none)
    if none:
        raise ValueError("Cracks are of facets with interactions, and the scene has none.")
    require_share(share)
    if not np.iterable(ignored_facets):
        raise TypeError(f"ignored_facets should be a tuple of tags, got {ignored_facets!r}.")
    unknown = set(ignored_facets) - scene.bodies.present.facets
    if unknown:
        raise ValueError(f"ignored_facets names {sorted(unknown)}, which occur nowhere.")


def _parts(x: np.ndarray) -> np.ndarray:
    """The part of an edge that each of its points stands for, shape (num_facets, k, 2, dim)."""
    start, end = x[:, 0], x[:, 1]
    along = (end - start)[:, None]
    share = nodal_shares(2, x.shape[1])[0]
    cuts = np.array([[0.0, share], [1.0, 1.0 - share], [share, 1.0 - share]])[: x.shape[1]]
    return start[:, None, None] + cuts[None, :, :, None] * along[:, :, None]


def crack_panel(recorder: Recorder, cracks: Cracks, title: str) -> CrackPanel:
    """The cracked plate or cell as it is now, for `plotting.plot_cracks`.

    Of a mesh that is spread over ranks, which call it together with what `find_cracks` gave each,
    the first one gets the panel of the whole, and each other rank that of its own bodies, without
    cracks.
    """
    require_kind("recorder", recorder, Recorder)
    require_kind("cracks", cracks, Cracks)
    simulation = recorder.simulation
    spread = simulation.scene.bodies.spread
    bodies = simulation.scene.bodies if spread is None else simulation.bodies
    given = (
        bodies.mesh.geometry.x[:, :2], recorder.cells, bodies.material_of_cell,
        recorder.vertex_displacement(), cracks.segments, cracks.kind,
    )  # fmt: skip
    parts = [given]
    if spread is not None:
        parts = spread.ranks.comm.gather(given)
        parts = parts or [(*given[:4], cracks.segments[:0], cracks.kind[:0])]
    points, cells, *others = zip(*parts, strict=True)
    first = np.cumsum([0, *map(len, points[:-1])])
    cells = [part + start for part, start in zip(cells, first, strict=True)]
    return CrackPanel(*map(np.concatenate, (points, cells, *others)), title=title)
