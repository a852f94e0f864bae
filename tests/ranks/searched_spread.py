# SPDX-License-Identifier: LGPL-3.0-or-later
"""A search on a mesh that is spread over ranks, against one on the whole mesh: the same contacts.

Blocks of one box tumble; bonds between them open and let go as they do. Which do, and how blocks
move, hangs on their places and labels, and on no number.
"""

import numpy as np
import scenes
from dolfinx import fem
from mpi4py import MPI
from scenes import box_bodies
from scipy.spatial.transform import Rotation

from xper_fx.bodies.surfaces import extract_surface
from xper_fx.nscd.search.surface_search import SurfaceSearch
from xper_fx.parallel.known_surface import own_surface
from xper_fx.parallel.launch import run_together
from xper_fx.parallel.spread_search import SpreadSearch
from xper_fx.support.ranks import Ranks

STEPS = 30
# Step at which blocks fly far apart; broken bonds still weld some.
FLIGHT = 26
REACH = 0.03
PAIRS = [("surface", "surface")]


def box(comm: MPI.Comm, counts: tuple[int, ...], kind: str):
    """Blocks of two cells a direction, and a space on them."""

    def label(x):
        place = (x[: len(counts)].T * counts * (1.0 - 1e-9)).astype(int)
        return np.ravel_multi_index(tuple(place.T), counts)

    scenes.COMM = comm
    bodies = box_bodies((1.0,) * len(counts), tuple(2 * n for n in counts), kind, label)
    return bodies, fem.functionspace(bodies.mesh, ("Lagrange", 1, (len(counts),)))


def drawn(place: np.ndarray, seed: int) -> np.ndarray:
    """A number between zero and one for each place, shape (n, dim)."""
    return (np.sin(place @ [12.9898, 78.233, 37.719][: place.shape[1]] + seed) * 43758.5453) % 1.0


def moved(x: np.ndarray, label: np.ndarray, counts: tuple[int, ...], step: int) -> np.ndarray:
    """Blocks turned about their middles and moved, the more the later."""
    dim, out = x.shape[1], x.copy()
    for one in np.unique(label):
        rng, own = np.random.default_rng(one), label == one
        spin, shift = 0.02 * step * rng.normal(size=3), 0.003 * step * rng.normal(size=dim)
        if step >= FLIGHT:
            shift += 3.0 * rng.normal(size=dim)
        turn = Rotation.from_rotvec(spin if dim == 3 else [0.0, 0.0, spin[2]]).as_matrix()
        middle = (np.array(np.unravel_index(one, counts)) + 0.5) / counts
        out[own] = (x[own] - middle) @ turn[:dim, :dim].T + middle + shift
    return out


def rows(contacts) -> np.ndarray:
    """Of contacts what hangs on no number of nodes or facets."""
    kind, other = contacts.key[:, 0] >> 60, contacts.key[:, 0] & ((1 << 30) - 1)
    fragment = np.where(kind == 1, other, 0)
    # numbers say which of two edges is the candidate
    normal = np.where((kind == 2) & (contacts.normal[:, 0] < 0.0), -1.0, 1.0)[:, None]
    normal = normal * contacts.normal
    return np.column_stack([
        contacts.point, normal, contacts.gap, contacts.area, kind, fragment,
        np.sort(contacts.weights.reshape(-1, 2 * contacts.dim), axis=1),
    ])  # fmt: skip


def joined(search, x: np.ndarray, label: np.ndarray, asked: np.ndarray) -> set:
    """Edges of exposed facets that bonds join with some facets', by their places at the start.

    Args:
        x: shape (num_nodes, 3), places of the surface's nodes.
        label: of its bodies.
        asked: facets.
    """
    facets, exposed = search.surface.facets, np.flatnonzero(search.bonds.exposed)
    corners = x[facets[exposed]]
    middle = np.broadcast_to(corners.mean(axis=1, keepdims=True), corners.shape)
    own = np.repeat(label[search.surface.body[exposed]], 3).reshape(-1, 3, 1)
    names = np.concatenate([corners + np.roll(corners, -1, axis=1), middle, own], axis=2)
    number, groups = search.bonds.joined_edges(exposed), {}
    for key, name in zip(number.ravel(), names.reshape(-1, 7).round(9), strict=True):
        groups.setdefault(key, set()).add(tuple(name))
    return {frozenset(groups[key]) for key in np.unique(number[np.isin(exposed, asked)])}


def check(counts: tuple[int, ...], kind: str, bonded: bool) -> tuple[int, int]:
    """Compare; how many contacts there were, and how often fragments changed."""
    ranks, dim = Ranks(MPI.COMM_WORLD), len(counts)
    bodies, V = box(MPI.COMM_SELF, counts, kind)
    surface, at = extract_surface(bodies, V).compact()
    x = V.tabulate_dof_coordinates()[at, :dim]
    label = np.zeros(surface.num_nodes, int)
    label[surface.facets] = bodies.labels[surface.body][:, None]
    mine, own_V = box(MPI.COMM_WORLD, counts, kind)
    own = own_surface(mine, own_V, None, ranks.rank)
    places = [b.facets.midpoint[:, :dim] for b in (bodies, mine)]
    released = [drawn(place, 0) < (0.2 if bonded else 2.0) for place in places]
    whole = SurfaceSearch(surface, x, REACH, released=released[0])
    part = SpreadSearch(ranks, mine, own, REACH, PAIRS, released[1], False)
    own_x, own_label = own.start[part.own], mine.labels[own.body_of_node[part.own]]
    opened = [r.copy() for r in released]
    found, fragments, keys, stars = 0, set(), set(), set()
    for step in range(1, STEPS + 1):
        expected = rows(whole.find(moved(x, label, counts, step)))
        here = part.find(moved(own_x, own_label, counts, step))
        keys |= set(map(tuple, here.key.tolist()))
        if dim == 3:
            known, lists = part._search, part._search.lists
            looked_at = np.flatnonzero(part.known.own_body[known.surface.body])
            looked_at = np.union1d(looked_at, lists.edges[lists.edge_pairs].ravel() // 3)
            tables = part.known.tables
            some = joined(known, tables.start, tables.which, looked_at)
            stars |= {len({name[-1] for name in star}) for star in some}
            assert some <= joined(whole, x, bodies.labels, np.arange(len(surface))), step
        got = np.concatenate(ranks.comm.allgather(rows(here)))
        assert got.shape == expected.shape, step
        in_order = [a[np.lexsort(a[:, : 2 * dim].round(8).T)] for a in (got, expected)]
        np.testing.assert_allclose(*in_order, rtol=0.0, atol=1e-11)
        # both lips of a bond that has not let go
        places_now = moved(own.start, mine.labels[own.body_of_node], counts, step)
        lips = ~part._bonds.released
        lips &= (mine.spread.rank_of_body[mine.facets.bodies] == ranks.rank).any(axis=1)
        lips = own.surface.bond_nodes[lips]
        at_lips = part.at_surface(moved(own_x, own_label, counts, step))[lips]
        np.testing.assert_allclose(at_lips, places_now[lips], rtol=0.0, atol=1e-12)
        found += len(expected)
        fragments.add(tuple(whole.bonds.fragment.tolist()))
        for search, place, there in zip((whole, part), places, opened, strict=True):
            if not bonded:
                continue
            exposed = drawn(place, step) < 0.08
            search.expose(np.flatnonzero(exposed))
            search.release(np.flatnonzero(there & (drawn(place, 2 * step) < 0.1)))
            there |= exposed
    # a node's number is that of one body's alone: no two ranks give a key
    assert len(set().union(*ranks.comm.allgather(keys))) == ranks.sum(len(keys))
    assert dim == 2 or {1, 2} <= stars  # within bodies, and across bonds
    return found, len(fragments)


def main() -> None:
    plane, fragments = check((5, 4), "crossed", True)
    space, _ = check((3, 2, 2), "tetrahedron", True)
    print("searched", min(plane, space), fragments, flush=True)


run_together(main)
