# SPDX-License-Identifier: LGPL-3.0-or-later
"""The ring of the demo, short: it breaks, momentum and mass are kept, the ledger closes."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "demos"))
import fragmentation as demo

pytestmark = pytest.mark.demos


def test_a_ring_breaks_into_pieces_of_the_published_size(tmp_path):
    options = demo.parse(
        f"--pieces 12 --cells 5 --threads 1 --quiet --fields 2 --out {tmp_path}".split()
    )
    demo.xf.prepare_folder(options.out)
    result = demo.run(options)
    found = demo.report(result, options)
    demo.draw(result, options.out)
    pieces = result["pieces"]
    radius, thickness, _ = demo.lengths(options)
    ring = 2.0 * np.pi * radius * thickness
    # chords of a polygon are shorter than arcs
    assert pieces.mass.sum() == pytest.approx(demo.DENSITY * ring, rel=2e-2)
    momentum = (pieces.mass[:, None] * pieces.velocity).sum(axis=0)
    largest = (pieces.mass * np.linalg.norm(pieces.velocity, axis=1)).sum()
    # the mesh is not symmetric, and its momentum not zero: it stays what it was
    start = demo.DENSITY * options.rate * first_moment(result["simulation"])
    assert momentum == pytest.approx(start, abs=1e-10 * largest)
    assert 0.5 < found["mean_size_um"] / (1e6 * demo.expected(options.rate)) < 2.5
    # a crack through the ring spends the fracture energy of its length, which is more than straight
    straight = len(pieces) * demo.TOUGHNESS * thickness
    assert straight < found["spent_on_borders"] < 1.2 * straight
    assert found["spent"] > found["spent_on_borders"]
    assert abs(found["closure_over_spent"]) < 1e-10
    for name in ("pieces.png", "sizes.png", "energies.png", "bulk.xdmf"):
        assert (tmp_path / name).stat().st_size > 0


def first_moment(simulation) -> np.ndarray:
    """Integral of x over the undeformed cells (m^3)."""
    mesh = simulation.bodies.mesh
    corners = mesh.geometry.x[demo.xf.geometry_dofmap(mesh)][:, :, :2]
    along, aside = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = 0.5 * np.abs(along[:, 0] * aside[:, 1] - along[:, 1] * aside[:, 0])
    return area @ corners.mean(axis=1)


@pytest.mark.parametrize("wrong", ["--rate=0", "--scatter=1", "--pieces=3", "--cells=1"])
def test_rings_that_make_no_sense_are_refused(wrong, capsys):
    with pytest.raises(SystemExit):
        demo.parse([wrong])
    assert wrong.split("=")[0] in capsys.readouterr().err
