# SPDX-License-Identifier: LGPL-3.0-or-later
"""A search that ranks divide, against one that each makes whole: the same contacts, bit by bit.

Blocks of one box tumble; bonds between them open and let go as they do.
"""

import numpy as np
from dolfinx import fem
from mpi4py import MPI
from scenes import box_bodies
from scipy.spatial.transform import Rotation

from xper_fx.bodies.surfaces import extract_surface
from xper_fx.nscd.search.contact_pairs import join
from xper_fx.nscd.search.surface_search import SurfaceSearch
from xper_fx.parallel.launch import run_together
from xper_fx.parallel.search_division import SearchDivision
from xper_fx.support.ranks import Ranks

STEPS = 24
# Step at which bodies fly apart, two by two.
FLIGHT = 14


def box(counts: tuple[int, ...], kind: str):
    """Blocks of two cells a direction; the surface, where its nodes are, and their bodies."""

    def label(x):
        place = (x[: len(counts)].T * counts * (1.0 - 1e-9)).astype(int)
        return np.ravel_multi_index(tuple(place.T), counts)

    bodies = box_bodies((1.0,) * len(counts), tuple(2 * n for n in counts), kind, label)
    V = fem.functionspace(bodies.mesh, ("Lagrange", 1, (len(counts),)))
    surface, at = extract_surface(bodies, V).compact()
    body = np.zeros(len(V.tabulate_dof_coordinates()), int)
    body[V.dofmap.list] = bodies.body_of_cell[:, None]
    return surface, V.tabulate_dof_coordinates()[at, : len(counts)], body[at]


def tumble(x: np.ndarray, body: np.ndarray, rng) -> np.ndarray:
    """Each body moved and turned a little."""
    dim, out = x.shape[1], x.copy()
    for one in range(body.max() + 1):
        own, spin = body == one, 0.02 * rng.normal(size=3)
        turn = Rotation.from_rotvec(spin if dim == 3 else [0.0, 0.0, spin[2]]).as_matrix()
        centre = out[own].mean(axis=0)
        turned = (out[own] - centre) @ turn[:dim, :dim].T
        out[own] = centre + turned + 0.004 * rng.normal(size=dim)
    return out


def check(counts: tuple[int, ...], kind: str) -> tuple[int, int]:
    """Compare; how many contacts there were, of them of edges."""
    ranks, rng = Ranks(MPI.COMM_WORLD), np.random.default_rng(5)
    surface, x, body = box(counts, kind)
    count = int(body.max()) + 1
    rank_of_body = np.arange(count) * ranks.size // count
    share = SearchDivision(ranks, rank_of_body, body, len(counts), np.zeros(0, int))
    bonds = len(surface.bond_nodes)
    released = rng.random(bonds) < 0.2
    whole = SurfaceSearch(surface, x, 0.03, released=released)
    part = SurfaceSearch(surface, x, 0.03, released=released, share=share)
    open_ = released.copy()
    found = edges = 0
    for step in range(STEPS):
        x = tumble(x, body, rng)
        if step == FLIGHT:  # broken bonds still weld lips that are far apart
            for one, place in enumerate(rng.permutation(count)):
                x[body == one] += [3.0 * (place // 2), 0.3 * (place % 2), 0.0][: len(counts)]
        expected = whole.find(x)
        # what a rank is not told it must not read
        own = np.where(share.own_node[:, None], x, 50.0 + rng.normal(size=x.shape))
        contacts = join(MPI.COMM_WORLD.allgather(part.find(own)))
        for name, values in expected._asdict().items():
            np.testing.assert_array_equal(getattr(contacts, name), values, err_msg=name)
        assert part.lists.renewals == whole.lists.renewals
        assert ranks.sum(part.lists.num_pairs) == whole.lists.num_pairs
        found += len(expected)
        edges += np.count_nonzero(expected.key[:, 0] >> 60 == 2)
        more = rng.random((2, bonds)) < 0.1
        for search in (whole, part):
            search.expose(np.flatnonzero(more[0]))
            search.release(np.flatnonzero(more[1] & open_))
        open_ |= more[0]
    assert whole.lists.renewals >= 3
    return found, edges


def main() -> None:
    found, edges = check((4, 3), "crossed")
    found_3d, edges_3d = check((3, 2, 2), "tetrahedron")
    assert edges == 0
    print("searched", min(found, found_3d), edges_3d, flush=True)


run_together(main)
