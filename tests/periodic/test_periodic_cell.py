# SPDX-License-Identifier: LGPL-3.0-or-later
"""Homogenisation of connected cells: laminates, invariances, both ways of driving, bounds."""

from __future__ import annotations

import numpy as np
import pytest
from cells import ONE, averaged_gradient, cell_of, cell_run, phase, ramp
from scipy.optimize import root

from xper_fx.materials import LinearElastic, NeoHookean
from xper_fx.materials.material import lame
from xper_fx.periodic.drive import MacroscopicDrive

SOFT, HARD = (100.0, 0.3), (700.0, 0.2)
SHARE = 0.25
"""Of the hard phase in a laminate."""
CURVED = [[1.3, 0.4], [-0.2, 0.8]]


def materials(kind=LinearElastic):
    return {1: kind(*SOFT, 1.0), 2: kind(*HARD, 1.0)}


def held(simulation, record):
    """After each step: Hill-Mandel, and Fbar by its definition."""
    state = simulation.macroscopic
    assert state.hill_mandel < 1e-10
    found = averaged_gradient(simulation.bulk, simulation.state.displacement)
    assert np.abs(found - state.gradient).max() < 1e-12


def stress(bodies, gradient, kind=LinearElastic, **options):
    """Pibar at Fbar, driven there by all components of Fbar."""
    simulation = cell_run(bodies, materials(kind), ramp(gradient), check=held, **options)
    assert np.abs(simulation.macroscopic.gradient - gradient).max() < 1e-13
    return simulation.macroscopic.stress


def unit(i, j, dim, size=1e-3):
    out = np.eye(dim)
    out[i, j] += size
    return out


def laminate_moduli(dim, n):
    """Backus's moduli d P_ij / d F_kl of the laminate with layers normal to axis n.

    With M = lambda + 2 mu and <> the mean: C_nn = 1 / <1/M>, C_nt = <lambda/M> C_nn,
    C_tt = <M - lambda^2/M> + <lambda/M>^2 C_nn, C_ts likewise with lambda, shears with n
    1 / <1/mu>, the others <mu>.
    """
    share = np.array([1.0 - SHARE, SHARE])
    lam, mu = (np.array(m) for m in zip(lame(*SOFT), lame(*HARD), strict=True))
    stiff = lam + 2.0 * mu

    def mean(values):
        return float(share @ values)

    c_nn, ratio = 1.0 / mean(1.0 / stiff), mean(lam / stiff)
    out = np.zeros((dim,) * 4)
    for i in range(dim):
        for j in range(dim):
            if i == j:
                shift = 0.0 if i == n else mean(stiff - lam**2 / stiff)
                out[i, i, i, i] = c_nn if i == n else shift + ratio**2 * c_nn
            else:
                mixed = mean(lam - lam**2 / stiff) + ratio**2 * c_nn
                out[i, i, j, j] = ratio * c_nn if n in (i, j) else mixed
                shear = 1.0 / mean(1.0 / mu) if n in (i, j) else mean(mu)
                out[i, j, i, j] = out[i, j, j, i] = shear
    return out


PLANE = [("crossed", 1), ("crossed", 2), ("triangle", 1), ("quadrilateral", 1)]
PLANE += [("quadrilateral", 2)]


@pytest.mark.parametrize("kind, order", PLANE)
@pytest.mark.parametrize("n", (0, 1))
def test_laminate_has_its_closed_moduli(kind, order, n):
    """Strain along the layers and traction across them are continuous: Backus (1962)."""
    lengths = (2.0, 1.0) if n == 0 else (1.0, 2.0)
    cells = (4, 2) if n == 0 else (2, 4)
    bodies = cell_of(lengths, cells, kind, material=phase(SHARE, 2.0, n))
    moduli = laminate_moduli(2, n)
    for i in range(2):
        for j in range(2):
            found = stress(bodies, unit(i, j, 2), order=order) / 1e-3
            assert np.abs(found - moduli[:, :, i, j]).max() < 1e-10 * moduli.max()


@pytest.mark.parametrize(
    "kind, order, n",
    [("tetrahedron", 1, 0), ("hexahedron", 1, 2), ("tetrahedron", 2, 1), ("hexahedron", 2, 0)],
)
def test_laminate_in_space_has_its_closed_moduli(kind, order, n):
    """The same in 3D, shears in and across the layers included."""
    lengths, cells = np.ones(3), np.full(3, 2 if order == 1 else 1)
    lengths[n], cells[n] = 2.0, 4
    bodies = cell_of(lengths, cells, kind, material=phase(SHARE, 2.0, n))
    moduli = laminate_moduli(3, n)
    for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0)):
        found = stress(bodies, unit(i, j, 3), order=order) / 1e-3
        assert np.abs(found - moduli[:, :, i, j]).max() < 1e-10 * moduli.max()


def neo_hookean(gradient, young, poisson):
    """P = mu (F - F^-T) + lambda ln J F^-T, plane strain or 3D."""
    lam, mu = lame(young, poisson)
    inverse = np.linalg.inv(gradient).T
    return mu * (gradient - inverse) + lam * np.log(np.linalg.det(gradient)) * inverse


def laminate_at_finite_strain(gradient, n):
    """Pibar of the neo-Hookean laminate: F_k = Fbar + a_k (x) n, <a> = 0, [[P n]] = 0."""
    gradient = np.asarray(gradient, float)
    normal = np.eye(len(gradient))[n]

    def phases(a):
        soft = neo_hookean(gradient + SHARE * np.outer(a, normal), *SOFT)
        hard = neo_hookean(gradient - (1.0 - SHARE) * np.outer(a, normal), *HARD)
        return soft, hard

    def gap(a):
        soft, hard = phases(a)
        return (soft - hard) @ normal

    solved = root(gap, np.zeros(len(gradient)), tol=1e-14)
    assert np.abs(gap(solved.x)).max() < 1e-9
    soft, hard = phases(solved.x)
    return (1.0 - SHARE) * soft + SHARE * hard


@pytest.mark.parametrize("kind, order", PLANE)
@pytest.mark.parametrize("n", (0, 1))
def test_laminate_at_finite_strain(kind, order, n):
    """Against the root of the jump condition: stretched by 30 %, sheared, turned."""
    lengths = (2.0, 1.0) if n == 0 else (1.0, 2.0)
    cells = (4, 2) if n == 0 else (2, 4)
    bodies = cell_of(lengths, cells, kind, material=phase(SHARE, 2.0, n))
    found = stress(bodies, CURVED, NeoHookean, order=order, step=0.25, steps=4)
    expected = laminate_at_finite_strain(CURVED, n)
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()


def test_laminate_in_space_at_finite_strain():
    """The same in 3D with all nine components."""
    gradient = [[1.2, 0.3, -0.1], [0.1, 0.9, 0.2], [-0.2, 0.1, 1.1]]
    bodies = cell_of((1, 1, 2), (1, 1, 4), "hexahedron", material=phase(SHARE, 2.0, 2))
    found = stress(bodies, gradient, NeoHookean, step=0.25, steps=4)
    expected = laminate_at_finite_strain(gradient, 2)
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()


# Both ways of driving


def composite(x):
    """A square inclusion of a third of the period, off the symmetry axes."""
    return (np.abs(x[0] - 0.5) < 1 / 6) & (np.abs(x[1] - 0.5) < 1 / 6)


def inclusion(shift=(0.0, 0.0), period=(1.0, 1.0)):
    """The inclusion, moved; a point of each cell, periodic."""
    return {
        2: lambda x: composite(
            np.stack([((x[i] - shift[i]) / period[i] + 1e-9) % 1.0 for i in range(2)])
        )
    }


def composite_cell(kind="crossed", cells=(6, 6), lengths=(1.0, 1.0), **options):
    return cell_of(lengths, cells, kind, material=options.pop("material", inclusion()), **options)


@pytest.mark.parametrize("kind", (LinearElastic, NeoHookean))
@pytest.mark.parametrize("order", (1, 2))
@pytest.mark.parametrize("spin", ("21", "12"))
def test_driven_by_the_stress_it_answers(kind, order, spin):
    """Fbar -> Pibar; driven by that Pibar, all but the spin, Fbar comes back."""
    bodies = composite_cell(cells=(3, 3))
    gradient = np.array([[1.1, 0.05], [-0.02, 0.97]])
    asked = stress(bodies, gradient, kind, order=order, step=0.5, steps=2)
    i, j = int(spin[0]) - 1, int(spin[1]) - 1
    drive = MacroscopicDrive(
        gradient={spin: lambda t: t * gradient[i, j]},
        stress={
            f"{k + 1}{m + 1}": lambda t, k=k, m=m: t * asked[k, m]
            for k in range(2)
            for m in range(2)
            if (k, m) != (i, j)
        },
    )
    simulation = cell_run(
        bodies, materials(kind), drive, order=order, step=0.5, steps=2, check=held
    )
    state = simulation.macroscopic
    assert np.abs(state.gradient - gradient).max() < 1e-10
    assert np.abs(state.stress - asked).max() < 1e-10 * np.abs(asked).max()


def test_driven_by_stress_in_space():
    """The same on a tetrahedral cell in 3D: six stresses, three components of Fbar."""
    bodies = cell_of((1, 1, 1), (2, 2, 2), "tetrahedron", material=phase(0.5, 1.0, 1))
    gradient = np.array([[1.05, 0.02, -0.01], [0.01, 0.98, 0.03], [0.0, -0.02, 1.01]])
    asked = stress(bodies, gradient, NeoHookean)
    drive = MacroscopicDrive(
        gradient={"21": gradient[1, 0], "31": gradient[2, 0], "32": gradient[2, 1]},
        stress={
            n: asked[int(n[0]) - 1, int(n[1]) - 1] for n in ("11", "22", "33", "12", "13", "23")
        },
    )
    state = cell_run(bodies, materials(NeoHookean), drive, check=held).macroscopic
    assert np.abs(state.gradient - gradient).max() < 1e-10


@pytest.mark.parametrize("kind", (LinearElastic, NeoHookean))
def test_mixed_drives_are_the_pure_ones(kind):
    """Any component by the stress it has: neither Fbar nor Pibar moves."""
    bodies = composite_cell(cells=(3, 3))
    gradient = np.array([[1.05, 0.03], [0.01, 0.98]])
    asked = stress(bodies, gradient, kind)
    names = {"11": (0, 0), "22": (1, 1), "12": (0, 1), "21": (1, 0)}
    for by_stress in (["11"], ["22"], ["12"], ["21"], ["11", "22"], ["11", "12"], ["22", "21"]):
        drive = MacroscopicDrive(
            gradient={n: lambda t, g=gradient[p], r=float(p[0] == p[1]): r + t * (g - r)
                      for n, p in names.items() if n not in by_stress},
            stress={n: asked[names[n]] for n in by_stress},
        )  # fmt: skip
        state = cell_run(bodies, materials(kind), drive, check=held).macroscopic
        assert np.abs(state.gradient - gradient).max() < 1e-10, by_stress
        assert np.abs(state.stress - asked).max() < 1e-10 * np.abs(asked).max(), by_stress


def test_rates_are_gradients():
    """F = 1 + rate t; a rate linear in time is integrated exactly."""
    bodies = composite_cell(cells=(3, 3))
    gradient = np.array([[1.1, 0.05], [-0.02, 0.97]])
    rate = {"11": 0.1, "12": 0.05, "21": -0.02, "22": -0.03}
    expected = stress(bodies, gradient, NeoHookean)
    for drive in (
        MacroscopicDrive(rate=rate),
        MacroscopicDrive(rate={n: lambda t, v=v: 2.0 * v * t for n, v in rate.items()}),
    ):
        state = cell_run(
            bodies, materials(NeoHookean), drive, step=0.25, steps=4, check=held
        ).macroscopic
        assert np.abs(state.gradient - gradient).max() < 1e-12
        assert np.abs(state.stress - expected).max() < 1e-10 * np.abs(expected).max()


# What must not matter

AS_DRIVEN = {
    "gradient": {"11": lambda t: 1.0 + 0.1 * t, "21": lambda t: 0.04 * t},
    "stress": {"22": 3.0, "12": -2.0},
}


def answer(bodies, kind=NeoHookean, **options):
    """Fbar and Pibar under a mixed drive."""
    state = cell_run(
        bodies, materials(kind), MacroscopicDrive(**AS_DRIVEN), check=held, **options
    ).macroscopic
    return np.concatenate([state.gradient, state.stress / 100.0])


@pytest.mark.parametrize("kind", (LinearElastic, NeoHookean))
@pytest.mark.parametrize("order", (1, 2))
def test_where_the_origin_lies_does_not_matter(kind, order):
    """X -> X + c changes neither Fbar nor Pibar."""
    cells = (3, 3)
    reference = answer(composite_cell(cells=cells), kind, order=order)
    moved = answer(composite_cell(cells=cells, shift=(-7.3, 11.9)), kind, order=order)
    assert np.abs(moved - reference).max() < 1e-10


@pytest.mark.parametrize("mesh", ("crossed", "quadrilateral"))
@pytest.mark.parametrize("shift", ((1 / 3, 0.0), (0.5, 1 / 6), (1 / 6, 2 / 3)))
def test_where_the_cell_is_cut_does_not_matter(mesh, shift):
    """The same composite cut elsewhere: the inclusion inside, or over one side, or a corner."""
    reference = answer(composite_cell(mesh))
    found = answer(composite_cell(mesh, material=inclusion(shift)))
    assert np.abs(found - reference).max() < 1e-10


@pytest.mark.parametrize("times", ((2, 1), (1, 2), (2, 2)))
def test_how_many_periods_the_cell_holds_does_not_matter(times):
    """Cells doubled along x, y or both; no instability here that breaks the period."""
    reference = answer(composite_cell(cells=(3, 3)))
    found = answer(
        composite_cell(cells=(3 * times[0], 3 * times[1]), lengths=np.array(times, float))
    )
    assert np.abs(found - reference).max() < 1e-10


def test_where_a_void_lies_does_not_matter():
    """A square void in the middle, over a side, over the corners; |Omega| holds its volume."""
    found = []
    for shift in (0.0, 1 / 3, 0.5):
        hole = lambda x, s=shift: composite((np.asarray(x) + s + 1e-9) % 1.0)  # noqa: E731
        bodies = cell_of((1, 1), (6, 6), hole=hole)
        simulation = cell_run(bodies, {1: NeoHookean(*SOFT, 1.0)}, MacroscopicDrive(**AS_DRIVEN))
        assert simulation.bulk.volume == 1.0
        assert simulation.macroscopic.hill_mandel < 1e-10
        found.append(
            np.concatenate([simulation.macroscopic.gradient, simulation.macroscopic.stress / 100])
        )
    assert np.abs(found[1] - found[0]).max() < 1e-10
    assert np.abs(found[2] - found[0]).max() < 1e-10


def test_a_slot_carries_nothing_across():
    """A void over the whole height leaves a strip: P11 = P12 = 0, P22 = share of the strip's.

    Strip of share f in plane strain stress, free across: P22 = f E / (1 - nu^2) (F22 - 1).
    """
    bodies = cell_of((1, 1), (4, 2), hole=lambda x: x[0] > 0.5)
    state = cell_run(bodies, {1: LinearElastic(*SOFT, 1.0)}, ramp(unit(1, 1, 2))).macroscopic
    young, poisson = SOFT
    expected = 0.5 * young / (1.0 - poisson**2) * 1e-3
    assert state.stress == pytest.approx(np.diag([0.0, expected]), abs=1e-13)


@pytest.mark.parametrize("angle", (0.4, -1.2))
def test_objectivity(angle):
    """P(R F) = R P(F)."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    stretch = np.array([[1.2, 0.1], [0.1, 0.9]])
    bodies = composite_cell(cells=(3, 3))

    def path(turning):
        def at(t):
            a = angle * t if turning else 0.0
            now = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
            return now @ (np.eye(2) + t * (stretch - np.eye(2)))

        return MacroscopicDrive(
            gradient={f"{i + 1}{j + 1}": lambda t, i=i, j=j: at(t)[i, j]
                      for i in range(2) for j in range(2)}
        )  # fmt: skip

    plain, turned = (
        cell_run(bodies, materials(NeoHookean), path(p), step=0.25, steps=4, check=held)
        for p in (False, True)
    )
    expected = turn @ plain.macroscopic.stress
    assert turned.macroscopic.stress == pytest.approx(expected, abs=1e-10 * np.abs(expected).max())
    # moments: P F^T is symmetric
    tau = turned.macroscopic.stress @ turned.macroscopic.gradient.T
    assert tau[0, 1] == pytest.approx(tau[1, 0], rel=1e-9)


@pytest.mark.parametrize("seed", (0, 1))
def test_voigt_and_reuss_bound_a_random_composite(seed):
    """<C^-1>^-1 <= C <= <C> as quadratic forms, strictly in a random composite; C symmetric."""
    rng = np.random.default_rng(seed)
    hard = rng.random((6, 6)) < 0.4
    material = {2: lambda x: hard[(6 * x[0]).astype(int), (6 * x[1]).astype(int)]}
    bodies = cell_of((1, 1), (6, 6), material=material)
    columns = []
    for strain in (np.diag([1.0, 0.0]), np.diag([0.0, 1.0]), np.array([[0, 0.5], [0.5, 0]])):
        p = stress(bodies, np.eye(2) + 1e-3 * strain) / 1e-3
        columns.append([p[0, 0], p[1, 1], p[0, 1]])
        assert p[0, 1] == pytest.approx(p[1, 0], rel=1e-9, abs=1e-9)
    found = np.array(columns)
    assert np.abs(found - found.T).max() < 1e-10 * found.max()

    def moduli(young, poisson):
        lam, mu = lame(young, poisson)
        return np.array([[lam + 2 * mu, lam, 0], [lam, lam + 2 * mu, 0], [0, 0, mu]])

    share = hard.mean()
    soft, stiff = moduli(*SOFT), moduli(*HARD)
    voigt = (1 - share) * soft + share * stiff
    reuss = np.linalg.inv((1 - share) * np.linalg.inv(soft) + share * np.linalg.inv(stiff))
    assert np.linalg.eigvalsh(voigt - found).min() > 1.0
    assert np.linalg.eigvalsh(found - reuss).min() > 1.0


def test_refinement_softens():
    """Energy at given Fbar falls from order 1 to order 2 and towards finer meshes."""
    values = [
        stress(composite_cell(cells=(n, n)), unit(0, 0, 2), order=order)[0, 0]
        for n, order in ((3, 1), (6, 1), (3, 2), (6, 2))
    ]
    assert values[0] > values[1] > values[2] > values[3]
    assert values[2] / values[3] < 1.005


def test_inertia_does_not_change_a_slow_run():
    """At rest after steps of many transits, theta = 1: the static answer."""
    bodies = composite_cell(cells=(3, 3))
    still = answer(bodies, LinearElastic)
    drive = MacroscopicDrive(**{
        "gradient": {"11": lambda t: 1.0 + 0.1 * min(t, 1.0), "21": lambda t: 0.04 * min(t, 1.0)},
        "stress": {"22": 3.0, "12": -2.0},
    })  # fmt: skip
    simulation = cell_run(bodies, materials(), drive, steps=40, inertia=True)
    state = simulation.macroscopic
    found = np.concatenate([state.gradient, state.stress / 100.0])
    assert np.abs(found - still).max() < 1e-9
    momentum = simulation.bulk.mass * simulation.state.velocity
    assert np.abs(momentum[:-4].reshape(-1, 2).sum(axis=0)).max() < 1e-12


@pytest.mark.parametrize("theta", (0.5, 1.0))
@pytest.mark.parametrize("step", (0.02, 0.5))
def test_energy_of_a_linear_cell_closes(theta, step):
    """external = kinetic + elastic (+ what theta > 1/2 damps), to rounding; waves inside."""
    bodies = composite_cell(cells=(3, 3))
    largest = []

    def check(simulation, record):
        largest.append(abs(record.energies["closure"]))
        assert simulation.macroscopic.hill_mandel < 1e-10

    drive = MacroscopicDrive(
        rate={"11": lambda t: 0.05 * np.sin(3 * t) ** 2, "21": 0.01},
        stress={"22": lambda t: np.sin(t), "12": 0.0},
    )
    simulation = cell_run(
        bodies, materials(), drive, step=step, steps=20, theta=theta, inertia=True, check=check
    )
    energies = simulation.ledger.energies
    assert energies.kinetic > 0.0
    assert max(largest) < 1e-13 * max(energies.elastic, 1.0)
    if theta == 0.5:
        assert energies.dissipated_numerical == 0.0
    else:
        assert energies.dissipated_numerical > 0.0
    # what Pibar works is the work stored: nothing else drives the cell
    assert energies.external_work == pytest.approx(energies.held_and_lost, rel=1e-12)


def test_one_label_is_one_body():
    """The label plays no part (a cell of label 5)."""
    assert np.abs(
        answer(composite_cell(cells=(3, 3), label=5))
        - answer(composite_cell(cells=(3, 3), label=ONE))
    ).max() == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("theta", (0.5, 0.7, 1.0))
def test_a_linear_cell_under_stresses_takes_one_iteration(theta):
    """The border of the iteration matrix is the derivative, whatever the stresses are."""
    drive = MacroscopicDrive(
        gradient={"11": lambda t: 1.0 + 0.01 * t, "21": 0.0},
        stress={"22": lambda t: 3.0 * t, "12": lambda t: 1.0 * t},
    )
    iterations = []
    simulation = cell_run(
        cell_of((2.0, 1.0), (4, 2), label=0, material=phase(SHARE, 2.0, 0)), materials(), drive,
        step=0.25, steps=4, theta=theta, inertia=True,
        check=lambda _, record: iterations.append(record.newton_iterations),
    )  # fmt: skip
    assert iterations == [1, 1, 1, 1]
    assert simulation.macroscopic.stress[1, 1] == pytest.approx(3.0, abs=1e-10)
    assert simulation.macroscopic.stress[0, 1] == pytest.approx(1.0, abs=1e-10)


@pytest.mark.parametrize("lengths, cells, kind", [
    ((2.0, 1.0), (2, 1), "crossed"), ((1.0, 2.0, 0.5), (1, 1, 1), "tetrahedron"),
])  # fmt: skip
def test_fields_are_the_motions_of_macroscopic_gradients(lengths, cells, kind):
    """Column by column G_ij moves nodes by X_j along i, which is what unknowns expand to."""
    drive = ramp(np.eye(len(lengths)))
    bodies = cell_of(lengths, cells, kind, label=0)
    bulk = cell_run(bodies, {1: LinearElastic(*SOFT, 1.0)}, drive, steps=0).bulk
    unknowns, dim = bulk.unknowns, len(lengths)
    fields = unknowns.fields(np.arange(dim * dim))
    for component in range(dim * dim):
        one = np.zeros(bulk.num_dofs)
        one[unknowns.macroscopic.start + component] = 1.0
        np.testing.assert_array_equal(unknowns.expand(one), fields[:, component])
        gradient = np.zeros((dim, dim))
        gradient[component % dim, component // dim] = 1.0
        moved = fields[:, component].reshape(-1, dim)
        np.testing.assert_allclose(moved, unknowns.position @ gradient.T, atol=1e-15)
        found = bulk.macroscopic_gradient(one) - np.eye(dim)
        np.testing.assert_array_equal(found, gradient)
