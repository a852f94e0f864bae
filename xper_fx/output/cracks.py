# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where a simulation has cracked, and through what."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from xper_fx.nscd.facets import nodal_shares
from xper_fx.nscd.point_values import BROKEN
from xper_fx.output.connectivity import require_share
from xper_fx.output.field_series import point_coordinates
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


def find_cracks(
    simulation: Simulation,
    inclusion: int | None = None,
    ignored_facets: tuple[int, ...] = (),
    share: float = BROKEN,
) -> Cracks:
    """Find the cracks of a simulation in the plane; contacts and perfect bonds are none.

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
    x = point_coordinates(simulation).reshape(len(number), -1, simulation.bulk.dim)
    broken = broken_points(simulation, ignored_facets, share).reshape(x.shape[:2])
    facet, point = np.nonzero(broken)
    segments = _parts(x)[facet, point]
    sides = facets.materials[number[facet]]
    return Cracks(segments, np.count_nonzero(sides == inclusion, axis=1))


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
        never broken.

    Raises:
        ValueError, TypeError: as `find_cracks`.
    """
    _check(simulation, ignored_facets, share)
    interactions, number = simulation.interactions, simulation.facets_with_law
    dim = simulation.bulk.dim
    breaks = np.array(["damage" in law.kernels(dim).state_names for law in interactions.laws])
    broken = breaks[interactions.gather("law")] & (interactions.gather("spent") >= share)
    # the points of walls come last
    broken = broken[: len(point_coordinates(simulation))].reshape(len(number), -1)
    broken[np.isin(simulation.scene.bodies.facets.tag[number], ignored_facets)] = False
    return broken.ravel()


def _check(simulation: Simulation, ignored_facets: tuple[int, ...], share: float) -> None:
    require_kind("simulation", simulation, Simulation)
    scene = simulation.scene
    if scene.bodies is None or not len(simulation.facets_with_law):
        raise ValueError("Cracks are of facets with interactions, and the scene has none.")
    require_share(share)
    if not np.iterable(ignored_facets):
        raise TypeError(f"ignored_facets should be a tuple of tags, got {ignored_facets!r}.")
    unknown = set(ignored_facets) - set(scene.bodies.facet_tags.values.tolist())
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
    """The cracked plate or cell as it is now, for `plotting.plot_cracks`."""
    require_kind("recorder", recorder, Recorder)
    require_kind("cracks", cracks, Cracks)
    bodies = recorder.simulation.scene.bodies
    return CrackPanel(
        points=bodies.mesh.geometry.x[:, :2],
        triangles=recorder.cells,
        material=bodies.material_of_cell,
        displacement=recorder.vertex_displacement(),
        crack_segments=cracks.segments,
        crack_kind=cracks.kind,
        title=title,
    )
