# SPDX-License-Identifier: LGPL-3.0-or-later
"""The scales of a cohesive run, beside those of its mesh and its step.

The *cohesive length* E' w / Rmax^2 is the size of the zone in which a crack's bonds weaken: a mesh
that does not resolve it by several facets gives a strength that depends on the mesh. The
*softening number* h^2 theta^2 A lmax(W) 2 Rmax / (dc - d0) is below one where a weakening bond has
one state at the end of the step; above it may snap within a step.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from xper_fx.bodies.explode import Bodies
from xper_fx.nscd.laws.softening import softening_numbers
from xper_fx.simulation.readings import Readings
from xper_fx.support.checks import require_kind


def cohesive_scales(simulation: Readings) -> list[dict[str, Any]]:
    """Scales of each cohesive law of a simulation, in the order of the laws.

    Where ranks have some of the points each, all of them call it together.

    Returns:
        For each law its strength (Pa), fracture energy (J/m^2), cohesive length (m) with the
        softest material of the scene, facets it spans (mean facet), and softening number; of fields
        those of the point whose cohesive length is the shortest. Nothing
        without facing facets or if no material has a Young's modulus.
    """
    model = simulation.model
    interactions, bodies = model.interactions, model.scene.bodies
    if interactions is None or bodies is None or not bodies.present.facing:
        return []
    facet = _mean_facet(bodies)
    if model.bulk.dim == 3:
        facet = facet**0.5
    isotropic = [m for m in model.scene.materials.values() if hasattr(m, "young")]
    if not isotropic:
        return []
    modulus = min(m.young / (1.0 - m.poisson**2) for m in isotropic)
    numbers = softening_numbers(interactions, model.step_size, model.scheme.theta)
    scales = []
    for law, number in zip(interactions.laws, numbers, strict=True):
        if not hasattr(law, "softening_slope"):
            continue
        lengths = np.atleast_1d(modulus * law.fracture_energy / law.strength**2)
        told = []
        if len(lengths):
            shortest = int(np.argmin(lengths))
            values = lengths, law.strength, law.fracture_energy
            told = [tuple(float(np.broadcast_to(v, lengths.shape)[shortest]) for v in values)]
        if interactions.halo is not None:
            told = [one for there in interactions.halo.ranks.comm.allgather(told) for one in there]
        if not told:
            continue
        length, strength, energy = min(told)
        scales.append(
            {
                "strength": strength,
                "fracture_energy": energy,
                "cohesive_length": length,
                "facets_in_cohesive_length": length / facet,
                "softening_number": float(number),
            }
        )
    return scales


def _mean_facet(bodies: Bodies) -> float:
    """Mean measure of facing facets, of a mesh that is spread those of all ranks."""
    measure = bodies.facets.measure
    if bodies.spread is None:
        return float(measure.mean())
    ranks, candidate = bodies.spread.ranks, bodies.facets.bodies[:, 0]
    own = measure[bodies.spread.rank_of_body[candidate] == ranks.rank]
    return ranks.sum(own.sum()) / ranks.sum(len(own))


def cohesive_table(simulation: Readings) -> str:
    """The scales as text, a line for each cohesive law.

    Raises:
        TypeError: no simulation.
    """
    require_kind("simulation", simulation, Readings)
    return "\n".join(
        f"bond of {scale['strength'] / 1e6:.3g} MPa, {scale['fracture_energy']:g} J/m^2: "
        f"cohesive length {scale['cohesive_length']:.3g} m = "
        f"{scale['facets_in_cohesive_length']:.2g} facets, softening number "
        f"{scale['softening_number']:.2g}"
        for scale in cohesive_scales(simulation)
    )
