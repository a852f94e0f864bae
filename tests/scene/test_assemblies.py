# SPDX-License-Identifier: LGPL-3.0-or-later
"""Walls, columns, arches, packings and boxes: they touch, do not overlap, and stand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import lognorm, uniform

import xper_fx as xf

LAW = xf.laws.SignoriniCoulomb(friction=0.7)


def volume(body):
    return body.shape.mass_properties(1.0).mass


def on_ground(bodies, push=0.0):
    """Bodies of one group on a ground, under weight and a push along x."""
    dim, group = bodies[0].shape.dim, bodies[0].group
    up = (0.0,) * (dim - 1) + (1.0,)
    ground = xf.rigid.wall((0.0,) * dim, up, "ground")
    return xf.Scene(
        rigid=[*bodies, ground],
        contacts=[xf.Contact((group, other), LAW) for other in (group, "ground")],
        loads=[xf.Gravity((9.81 * push, *(0.0,) * (dim - 2), -9.81))],
    )


@pytest.mark.parametrize("thickness", [None, 0.3])
def test_a_wall(thickness):
    wall = xf.assemblies.masonry_wall(
        5, 10, block=(0.4, 0.175), density=1000.0, thickness=thickness
    )
    assert len(wall) == 55
    assert sum(map(volume, wall)) == pytest.approx(5 * 0.4 * 10 * 0.175 * (thickness or 1.0))
    assert xf.study.equilibrium(on_ground(wall, 0.3)).stands
    stacked = xf.assemblies.masonry_wall(3, 4, block=(0.4, 0.2), density=1.0, bond="stack")
    assert len(stacked) == 12


@pytest.mark.parametrize("sides", [None, 4])
def test_a_column_overturns_at_its_slenderness(sides):
    """About the corner at the diameter's end: 0.25 m beside a centre 1 m high."""
    drums = xf.assemblies.column(4, 0.5, 0.5, density=2000.0, sides=sides)
    found = xf.study.collapse_load(lambda a: on_ground(drums, a), (0.0, 0.6), 1e-3)
    assert found.stands - 1e-6 <= 0.25 <= found.falls + 1e-6


@pytest.mark.parametrize("depth", [None, 0.5])
def test_an_arch_stands_above_milankovitchs_thickness_and_falls_below(depth):
    for ratio, stands in ((0.112, True), (0.102, False)):
        bodies = xf.assemblies.arch(21, 1.0, ratio, density=2000.0, depth=depth)
        down = (0.0, -9.81) if depth is None else (0.0, 0.0, -9.81)
        scene = xf.Scene(
            rigid=bodies,
            contacts=[xf.Contact(("voussoirs", g), LAW) for g in ("voussoirs", "springings")],
            loads=[xf.Gravity(down)],
        )
        assert xf.study.equilibrium(scene).stands == stands, ratio


@pytest.mark.parametrize("lengths", [(2.0, 3.0), (1.0, 0.8, 1.2)])
@pytest.mark.parametrize("radii", [uniform(0.03, 0.03), lognorm(0.3, scale=0.04)])
def test_a_packing_fills_its_box_without_overlap(lengths, radii):
    """The scene refuses bodies that overlap; grains lie inside, and take their share."""
    grains = xf.assemblies.packing(radii, lengths, density=1000.0, seed=3)
    walls = xf.assemblies.box(lengths, opened=())
    assert len(walls) == 2 * len(lengths)
    contacts = [xf.Contact(("grains", group), LAW) for group in ("grains", "box")]
    xf.Scene(rigid=[*grains, *walls], contacts=contacts)
    share = sum(map(volume, grains)) / np.prod(lengths)
    assert share > (0.35 if len(lengths) == 2 else 0.12)
    again = xf.assemblies.packing(radii, lengths, density=1000.0, seed=3)
    np.testing.assert_array_equal([b.position for b in grains], [b.position for b in again])


def test_given_radii_keep_their_order():
    radii = np.linspace(0.02, 0.05, 40)
    grains = xf.assemblies.packing(radii, (1.0, np.inf), density=1.0, seed=0)
    assert [g.shape.radius for g in grains] == radii.tolist()


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (lambda a: a.masonry_wall(0, 1, block=(1, 1), density=1.0), "width"),
        (lambda a: a.masonry_wall(2, 1, block=(1, -1), density=1.0), "height of a block"),
        (lambda a: a.masonry_wall(2, 1, block=(1, 1), density=1.0, bond="flemish"), "running"),
        (lambda a: a.arch(1, 1.0, 0.1, density=1.0, angle=3.5), "take more of them"),
        (lambda a: a.arch(9, 1.0, 2.5, density=1.0), "thickness"),
        (lambda a: a.box((1.0, 1.0), opened=["lid"]), "bottom"),
        (lambda a: a.packing([0.1, -0.1], (1, 1), density=1.0, seed=0), "above zero"),
        (lambda a: a.packing([0.6], (1, 1), density=1.0, seed=0), "largest grain"),
        (lambda a: a.packing([0.1] * 99, (1, 1), density=1.0, seed=0), "need a height"),
        (lambda a: a.packing(uniform(0.1, 0.1), (1, np.inf), density=1.0, seed=0), "count"),
    ],
)
def test_what_is_asked_wrongly(call, match):
    with pytest.raises(ValueError, match=match):
        call(xf.assemblies)


def test_assemblies_are_placed_elsewhere():
    """Turned blocks too, and bodies whose place their vertices tell; the originals stay."""
    drawn = xf.RigidBody(xf.rigid.Polygon([(1, 1), (3, 1), (3, 2), (1, 2)]), None, "a", density=1.0)
    turned = xf.RigidBody(xf.rigid.Disc(1.0), (5.0, 0.0), "a", density=1.0, angle=0.3)
    first, second = xf.assemblies.moved([drawn, turned], (10.0, -1.0))
    np.testing.assert_allclose(first.position, (12.0, 0.5))
    np.testing.assert_allclose(second.position, (15.0, -1.0))
    assert (second.angle, first.shape, drawn.position) == (0.3, drawn.shape, None)
    wall = xf.assemblies.moved(
        xf.assemblies.masonry_wall(2, 1, block=(1.0, 0.5), thickness=0.2, density=1.0),
        (0.0, 1.0, 2.0),
    )
    np.testing.assert_allclose([b.position for b in wall], [(0.5, 1.1, 2.25), (1.5, 1.1, 2.25)])
    with pytest.raises(ValueError, match="by should be finite"):
        xf.assemblies.moved([drawn], (1.0, 2.0, 3.0))
