# SPDX-License-Identifier: LGPL-3.0-or-later
"""A bond of one's own: concrete that softens along the curve of Cornelissen, Hordijk and Reinhardt.

    sigma / ft = (1 + (3 y)^3) exp(-6.93 y) - 28 y exp(-6.93),    y = opening / last,

with last = 5.14 w / ft (Cornelissen, Hordijk and Reinhardt 1986).
"""

import numpy as np
from dolfinx.mesh import CellType, create_rectangle
from mpi4py import MPI

import xper_fx as xf


@xf.njit
def hordijk(opening, strength, last):
    """Traction (Pa) of an opening (m)."""
    y = opening / last
    return strength * ((1.0 + 27.0 * y**3) * np.exp(-6.93 * y) - 28.0 * y * np.exp(-6.93))


CONCRETE = xf.laws.CohesiveCurve(
    hordijk,
    {"strength": 3e6, "last": 5.14 * 100.0 / 3e6},
    end=lambda strength, last: last,
    normal_stiffness=1e13,
    friction=0.6,
)


def pull_apart(law, end: float, steps: int, **options) -> tuple[np.ndarray, np.ndarray, dict]:
    """Two stiff cells of 1 m bonded by a law, pulled apart in one second.

    Args:
        law: the bond.
        end: last opening (m).
        steps: of the run.
        options: of the simulation.

    Returns:
        Opening (m) and traction (Pa) after each step, and the energies at the end (J/m).
    """
    mesh = create_rectangle(MPI.COMM_SELF, [[0.0, 0.0], [1.0, 2.0]], [1, 2], CellType.quadrilateral)
    bottom, top = 1, 2
    sides = xf.tag_facets(mesh, {bottom: lambda x: x[1] < 1e-9, top: lambda x: x[1] > 2.0 - 1e-9})
    motions = [xf.PrescribedDisplacement(tag, 0, 0.0) for tag in (bottom, top)] + [
        xf.PrescribedDisplacement(bottom, 1, 0.0),
        xf.PrescribedDisplacement(top, 1, lambda t: end * t),
    ]
    scene = xf.Scene(
        xf.explode(mesh, facet_tags=sides),
        {1: xf.materials.LinearElastic(young=1e13, poisson=0.0, density=1e-3)},
        default_interaction=law,
        loads=motions,
    )
    simulation = xf.Simulation(scene, 1.0 / steps, tolerance=1e-10, **options)
    rows = []
    for _ in simulation.steps(1.0):
        points = simulation.interactions
        rows.append((points.gather("jump")[0, 0], -points.gather("traction")[0, 0]))
    opening, traction = np.array(rows).T
    return opening, traction, simulation.ledger.as_columns()


if __name__ == "__main__":
    _, traction, energies = pull_apart(CONCRETE, 1.1 * CONCRETE.critical_opening, 200)
    print(f"largest traction {traction.max() / 1e6:.4f} MPa, of {CONCRETE.strength / 1e6:.4f}")
    print(f"spent {energies['dissipated_cohesion']:.9f} J/m^2, of {CONCRETE.fracture_energy:.9f}")
