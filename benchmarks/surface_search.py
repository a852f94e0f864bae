# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the search of contacts of meshed surfaces costs.

    ./fenicsx python3 benchmarks/surface_search.py [--cells N]

Scenes: a plate of triangles, each its own body, with all bonds standing, one in ten released and
all released; a block of tetrahedra on another one. Nodes tremble by a thousandth of the cells.
Prints, in processor time: ns a pair of a search with the lists there are; over that search, one
that makes the lists anew, and the release of one bond in a hundred with a search after it; memory.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from dolfinx import fem
from dolfinx.mesh import create_box, meshtags
from mpi4py import MPI

from xper_fx.bodies.explode import explode
from xper_fx.bodies.meshes import crossed_rectangle
from xper_fx.bodies.surfaces import extract_surface
from xper_fx.nscd.search.surface_search import SurfaceSearch


def processor_time(function, repeat: int = 1) -> float:
    """Least processor time of some calls, s."""
    best = np.inf
    for _ in range(repeat):
        start = time.process_time()
        function()
        best = min(best, time.process_time() - start)
    return best


def plate(cells: int, share: float):
    """A plate of `cells` triangles, with a share of its bonds released."""
    n = max(2, int(np.sqrt(cells / 4)))
    bodies = explode(crossed_rectangle((0, 0), (1, 1), (n, n)))
    released = np.random.default_rng(0).random(len(bodies.facets)) < share
    return bodies, released, 1.0 / n


def blocks(cells: int):
    """Two blocks with meshes that do not match, one on the other."""
    n = max(2, round((cells / 12) ** (1 / 3)))
    mesh = create_box(MPI.COMM_SELF, [(0, 0, 0), (1, 1, 2)], (n, n, 2 * n))
    upper = mesh.geometry.x[mesh.geometry.dofmap].mean(axis=1)[:, 2] > 1.0
    everywhere = np.arange(len(upper), dtype=np.int32)
    tags = meshtags(mesh, 3, everywhere, upper.astype(np.int32) + 1)
    bodies = explode(mesh, upper.astype(int), tags)
    return bodies, np.ones(len(bodies.facets), bool), 1.0 / n


def run(name: str, bodies, released: np.ndarray, size: float) -> None:
    """Measure one scene and print its line."""
    dim = bodies.mesh.geometry.dim
    V = fem.functionspace(bodies.mesh, ("Lagrange", 1, (dim,)))
    x = V.tabulate_dof_coordinates()[:, :dim].copy()
    surface = extract_surface(bodies, V)
    search = SurfaceSearch(surface, x, 0.05 * size, released=released)
    search.find(x)
    rng = np.random.default_rng(1)
    trembling = x + 1e-3 * size * rng.normal(size=x.shape)
    contacts = search.find(trembling)
    old = processor_time(lambda: search.find(trembling), 20)

    def renew():
        search.lists._old_x = None
        search.find(trembling)

    new = processor_time(renew, 3)
    change = "-"
    standing = np.flatnonzero(~search.bonds.released)
    if len(standing):
        fresh = rng.permutation(standing)[: max(1, len(released) // 100)]

        def part():
            search.release(fresh)
            search.find(trembling)

        change = f"{processor_time(part) / old:.1f}"
    pairs = search.lists.num_pairs
    print(
        f"{name:28s} {search.bonds.exposed.sum():7d} {pairs:9d} {len(contacts):9d} "
        f"{1e9 * old / pairs:10.0f} {new / old:9.1f} {change:>9s} {search.nbytes / pairs:10.0f}"
    )


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=20_000, help="cells of each scene, about")
    cells = parser.parse_args().cells
    run("(compilation)", *plate(100, 1.0))
    run("(compilation)", *blocks(100))
    scenes = [
        ("plate, bonded", *plate(cells, 0.0)),
        ("plate, 1 in 10 released", *plate(cells, 0.1)),
        ("plate, all released", *plate(cells, 1.0)),
        ("block on block, 3D", *blocks(cells)),
    ]
    print(
        f"{'scene':28s} {'facets':>7s} {'pairs':>9s} {'contacts':>9s} {'ns a pair':>10s} "
        f"{'new lists':>9s} {'1 % bonds':>9s} {'bytes/pair':>10s}"
    )
    for scene in scenes:
        run(*scene)


if __name__ == "__main__":
    main()
