# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes on several ranks against the same on one; the parts that divide them."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from on_ranks import on_new_ranks, on_ranks
from scenes import COMM, EXACT, LEFT, RIGHT, box_bodies

from xper_fx.forms.loads import PrescribedVelocity
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import CohesiveZone
from xper_fx.parallel.division import none_empty, partition_bodies
from xper_fx.parallel.local_bodies import divide
from xper_fx.parallel.ownership import owners_by_facet, owners_by_vertex
from xper_fx.parallel.turns import phases_of_rows
from xper_fx.support.ranks import Ranks

sys.path.insert(0, str(Path(__file__).parents[1] / "ranks"))
import meshed_scenes

# On three ranks those whose code meets more with more ranks: ranks without points or walls,
# motions, bodies that are tied or rigid, vertices that several ranks share.
ON_RANKS = {
    2: ("scattered", "quadratic", "fall", "plastic", "turning_dropped", "sound_dropped", "own",
        "own_curve"),
    3: ("explicit", "blocks", "free", "tied", "space", "uneven", "rigid", "splitting", "pulled",
        "spun", "crushed", "dropped"),
}  # fmt: skip
SCENES = (*ON_RANKS[2], *ON_RANKS[3])
RUNS = [(name, count) for count in (1, *ON_RANKS) for name in ON_RANKS.get(count, SCENES)]
# Scenes whose points do not push each other at the end in more ways than one.
UNIQUE = ("blocks", "plastic", "free", "space", "own_curve")


def grid(n):
    number = np.arange(n * n).reshape(n, n)
    pairs = [(number[:, :-1], number[:, 1:]), (number[:-1], number[1:])]
    return np.concatenate([np.stack([a.ravel(), b.ravel()], axis=1) for a, b in pairs])


@pytest.mark.parametrize("num_ranks", [2, 3, 4, 7])
def test_parts_weigh_the_same_and_cut_little(num_ranks):
    n, pairs = 40, grid(40)
    weights = np.ones(n * n, int)
    weights[: 10 * n] = 4
    rank = partition_bodies(weights, pairs, np.ones(len(pairs), int), num_ranks)
    load = np.bincount(rank, weights, minlength=num_ranks)
    assert load.max() <= 1.06 * load.mean()
    cut = np.count_nonzero(rank[pairs[:, 0]] != rank[pairs[:, 1]])
    # straight cuts of a square into strips would be (num_ranks - 1) n
    assert cut <= 1.2 * (num_ranks - 1) * n
    again = partition_bodies(weights, pairs, np.ones(len(pairs), int), num_ranks)
    np.testing.assert_array_equal(rank, again)


def test_heavy_pairs_stay_together():
    pairs = grid(12)
    rows = np.abs(np.diff(pairs, axis=1)).ravel() == 1
    rank = partition_bodies(np.ones(144, int), pairs, np.where(rows, 1000, 1), 2)
    assert not np.any(rank[pairs[rows, 0]] != rank[pairs[rows, 1]])


def test_every_rank_has_a_body_while_there_are_any():
    pairs = np.array([[0, 1], [1, 2], [2, 3]])
    for count in (4, 6):
        rank = partition_bodies(np.array([100, 1, 1, 1]), pairs, np.ones(3, int), count)
        assert sorted(rank) == [0, 1, 2, 3]
    assert none_empty(np.array([2, 2, 2]), 4).tolist() == [2, 1, 0]
    assert none_empty(np.array([0, 4]), 5).tolist() == [0, 4]


def test_a_body_has_one_holder_in_a_phase():
    """Rows at bodies at which several ranks sweep take turns; all others are of the first phase."""
    rng = np.random.default_rng(3)
    units, owner = rng.integers(-1, 400, (120, 3)), rng.integers(0, 9, 120)
    phase = phases_of_rows(units, owner)
    holders = [{*owner[(units == unit).any(axis=1)].tolist()} for unit in range(400)]
    for unit in range(400):
        there = (units == unit).any(axis=1)
        for number in range(1, phase.max() + 1):
            assert len(set(owner[there & (phase == number)].tolist())) <= 1
    quiet = [all(len(holders[u]) < 2 for u in row if u >= 0) for row in units.tolist()]
    assert sum(quiet) > 3 and np.all(phase[quiet] == 1) and phase.max() > 2


@pytest.mark.parametrize("kind", ["crossed", "quadrilateral", "tetrahedron", "hexahedron"])
@pytest.mark.parametrize("degree", [1, 2])
def test_points_at_a_vertex_are_on_one_rank(kind, degree):
    from xper_fx.bodies.meshes import reference_cell
    from xper_fx.support.compat import geometry_dofmap

    dim = 3 if kind in ("tetrahedron", "hexahedron") else 2
    bodies = box_bodies((1,) * dim, (3,) * dim, kind=kind)
    rank_of_body = np.random.default_rng(0).integers(0, 4, bodies.num_bodies)
    x = bodies.facet_nodes(degree)
    corners = geometry_dofmap(bodies.mesh)[
        bodies.facets.cells[:, :1], bodies.facets.local_vertices[:, 0]
    ]
    owner = owners_by_vertex(
        bodies.facets, bodies.parent_vertex[corners], reference_cell(bodies.mesh), x.shape[1],
        rank_of_body,
    )  # fmt: skip
    places = np.round(x.reshape(-1, dim), 6)
    _, vertex = np.unique(places, axis=0, return_inverse=True)
    for number in range(vertex.max() + 1):
        here = vertex.ravel() == number
        assert len(set(owner.ravel()[here].tolist())) == 1
        meeting = bodies.facets.bodies[np.nonzero(here.reshape(owner.shape))[0]]
        assert owner.ravel()[here][0] == rank_of_body[meeting.min()]
    by_facet = owners_by_facet(bodies.facets, rank_of_body)
    assert np.all(np.any(rank_of_body[bodies.facets.bodies] == by_facet[:, None], axis=1))


def test_facet_nodes_are_where_the_space_has_them():
    from dolfinx import fem

    for kind, dim in (("crossed", 2), ("quadrilateral", 2), ("tetrahedron", 3), ("hexahedron", 3)):
        bodies = box_bodies((1,) * dim, (2,) * dim, kind=kind)
        for degree in (1, 2):
            V = fem.functionspace(bodies.mesh, ("Lagrange", degree, (dim,)))
            x = V.tabulate_dof_coordinates()[bodies.facing_nodes(V)[:, 0], :dim]
            np.testing.assert_allclose(bodies.facet_nodes(degree), x, atol=1e-14)


def test_a_part_is_a_copy_of_its_cells():
    bodies = box_bodies((1, 1), (4, 4), label=lambda x: (x[0] * 3.99).astype(int))
    part = divide(bodies, Ranks(COMM))
    np.testing.assert_array_equal(part.cells, np.arange(len(bodies.body_of_cell)))
    from xper_fx.support.compat import geometry_dofmap

    np.testing.assert_array_equal(
        part.bodies.mesh.geometry.x[geometry_dofmap(part.bodies.mesh)],
        bodies.mesh.geometry.x[geometry_dofmap(bodies.mesh)],
    )
    np.testing.assert_array_equal(part.bodies.mesh.geometry.x, bodies.mesh.geometry.x[part.nodes])
    for tag in (LEFT, RIGHT):
        assert len(part.bodies.facet_tags.find(tag)) == len(bodies.facet_tags.find(tag)) > 0


def test_one_rank_loads_nothing_of_the_others():
    """A run on one rank has no halo and no part."""
    from xper_fx.scene.scene import Scene
    from xper_fx.simulation.simulation import Simulation

    scene = Scene(
        box_bodies((1, 1), (2, 2)), {1: LinearElastic(1.0, 0.3, 1.0)},
        default_interaction=CohesiveZone(20.0, 1.0, 0.1), loads=[PrescribedVelocity(LEFT, 0, 0.0)],
    )  # fmt: skip
    simulation = Simulation(scene, 0.01, **EXACT)
    assert simulation.part is None and simulation.interactions.halo is None
    assert simulation.ranks.alone


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """What the scenes give on 1, 2 and 3 ranks."""
    results = {1: {name: meshed_scenes.run(name) for name in SCENES}}
    for count, names in ON_RANKS.items():
        folder = tmp_path_factory.mktemp(f"on_{count}")
        done = on_ranks(count, "ranks/meshed_scenes.py", folder, *names)
        assert done.returncode == 0, done.stdout + done.stderr
        results[count] = {name: dict(np.load(folder / f"{name}.npz")) for name in names}
    return results


@pytest.mark.ranks
@pytest.mark.parametrize(("name", "count"), [run for run in RUNS if run[1] > 1])
def test_ranks_agree(found, name, count):
    one, several = found[1][name], found[count][name]
    assert several["points"][0] == one["points"][0] == one["points"][1] > several["points"][1]
    assert set(one) == set(several)
    np.testing.assert_array_equal(several["law"], one["law"])
    np.testing.assert_array_equal(several["fragment"], one["fragment"])
    before = one["dissipated_cohesion"] == 0.0
    for key in ("reaction", "mean", "kinetic", "elastic", "external_work", "cohesive", "momenta"):
        a, b = one[key], several[key]
        scale = max(np.abs(a).max(), 1e-2)
        assert np.abs(a - b)[before].max(initial=0.0) <= 1e-8 * scale, key
        assert np.abs(a - b).max() <= 1e-6 * scale, key
    for key in meshed_scenes.PIECES:
        a, b = one[f"piece_{key}"], several[f"piece_{key}"]
        scale = max(np.abs(a).max(), 1e-2)
        assert a.shape == b.shape and np.abs(a - b).max() <= 1e-6 * scale, key
    for key in ("jump", "damage"):
        assert np.abs(one[key] - several[key]).max() <= 1e-6 * np.abs(one[key]).max(), key
    if name in UNIQUE:
        for key in ("impulse", "traction"):
            assert np.abs(one[key] - several[key]).max() <= 1e-7 * np.abs(one[key]).max(), key


@pytest.mark.ranks
@pytest.mark.parametrize("count", [1, 3])
def test_momentum_and_energy_are_exact(found, count):
    """Nothing from outside acts: what one half gives the other takes, across ranks too."""
    free = found[count]["free"]
    change = (free["momenta"] - free["start"])[:, :2]
    assert np.abs(change).max() <= 1e-13 * np.abs(free["start"]).max()
    lost = free["dissipated_friction"][-1] + free["dissipated_impact"][-1]
    assert lost > 0.01 * free["kinetic"][0]
    assert np.abs(free["closure"]).max() <= 1e-12 * free["kinetic"][0]


@pytest.mark.ranks
@pytest.mark.parametrize("count", [1, 3])
def test_couples_across_ranks_leave_both_momenta(found, count):
    """A plate spins and breaks: lips have nodes at vertices of other ranks, which get couples."""
    spun, one = found[count]["spun"], found[1]["spun"]
    assert spun["fragment"].max() >= 4
    assert np.abs(spun["momenta"] / spun["start"] - 1.0).max() <= 1e-12
    # at finite strain the ledger closes to second order, on all ranks alike
    assert np.abs(spun["closure"] - one["closure"]).max() <= 1e-12 * one["kinetic"][0]
    assert np.abs(one["closure"]).max() <= 1e-4 * one["kinetic"][0]


@pytest.mark.ranks
def test_couples_on_driven_cells_of_other_ranks_are_in_the_ledger(found):
    """Supports bear what cells of their vertices hand on."""
    one, several = found[1]["pulled"], found[3]["pulled"]
    assert one["dissipated_cohesion"][0] == 0.0 < one["dissipated_cohesion"][-1]
    for key in ("closure", "external_work"):
        assert np.abs(several[key] - one[key]).max() <= 1e-11 * one["external_work"].max()


@pytest.mark.ranks
@pytest.mark.parametrize("count", [1, 3])
def test_a_facet_that_flips_on_one_rank_cuts_the_step_of_all(found, count):
    assert len(found[count]["crushed"]["time"]) > 5


@pytest.mark.ranks
@pytest.mark.parametrize(("name", "count"), RUNS)
def test_fragments_of_all_ranks_add_up(found, name, count):
    """Masses lumped and stored and lost energies, whoever has the bodies."""
    run = found[count][name]
    kinetic = sum(run[f"piece_{part}"] for part in ("translation", "rotation", "vibration"))
    assert kinetic.sum() == pytest.approx(run["kinetic"][-1], rel=1e-11)
    assert run["piece_elastic"].sum() == pytest.approx(run["elastic"][-1], rel=1e-9)
    lost = run["piece_border"].sum() + run["piece_inside"].sum()
    assert lost == pytest.approx(run["dissipated_cohesion"][-1], rel=2e-3, abs=1e-12)
    moved = run["piece_mass"][:, None] * run["piece_velocity"]
    size = np.abs(moved).max()
    assert moved.sum(axis=0) == pytest.approx(run["momenta"][-1, :-1], abs=1e-12 * size)


@pytest.mark.ranks
def test_bonds_broke_in_what_was_compared(found):
    for name in ("explicit", "quadratic"):
        assert found[1][name]["damage"].min() == 0.0
        assert found[1][name]["dissipated_cohesion"][-1] > 0.0
    work = [found[count]["space"]["dissipated_viscous_bonds"][-1] for count in (1, 3)]
    assert work[0] > 0.01 * found[1]["space"]["dissipated_cohesion"][-1] > 0.0
    np.testing.assert_allclose(work, work[0], rtol=1e-7)


@pytest.mark.ranks
@pytest.mark.parametrize(("kind", "said"), [("all", "wrong on all"), ("last", "on the last")])
def test_an_error_stops_all_with_one_message(kind, said):
    done = on_new_ranks(2, "ranks/errors.py", kind)
    assert done.returncode != 0
    assert (done.stdout + done.stderr).count(
        f"ValueError: {'wrong ' * (kind == 'last')}{said}"
    ) == 1
    assert done.stdout.count("said by") == 1


@pytest.mark.ranks
def test_what_fails_at_the_root_fails_on_all():
    done = on_ranks(2, "ranks/errors.py", "root")
    assert done.returncode == 0, done.stdout
    assert done.stdout.count("no space") == 2


@pytest.mark.ranks
def test_many_ranks_agree_as_few_do():
    """By all to all and as MPI reduces: the same bits on all, and what is no number is seen."""
    done = on_ranks(3, "ranks/reductions.py")
    assert done.returncode == 0, done.stdout
    told = json.loads(done.stdout)
    values = [np.random.default_rng(rank).normal(size=(3, 2)) for rank in range(3)]
    assert told["alike"]
    for total, largest, holed, *plain in told["found"]:
        np.testing.assert_allclose(total, np.sum(values, axis=0), rtol=1e-14)
        np.testing.assert_array_equal(largest, np.max(values, axis=0))
        assert np.isnan(holed).all() and plain == [3.0, 2.0, True, False, 6.0, 3.0]


@pytest.mark.ranks
def test_what_is_exchanged_arrives():
    done = on_ranks(3, "ranks/exchanges.py")
    assert done.returncode == 0, done.stdout
    assert "exchanged" in done.stdout
