# SPDX-License-Identifier: LGPL-3.0-or-later
"""What laws ask of the run that they are in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from xper_fx.nscd.laws.law import Law, LawKernels


def check_laws_suit(
    laws: Sequence[Law],
    dim: int,
    law_of_point: np.ndarray,
    gap: np.ndarray,
    inertia: bool,
    monolithic: bool,
) -> None:
    """Raise a ValueError where laws would not be what they are.

    Args:
        laws: those of the run.
        law_of_point: of the permanent points, shape (num_points,).
        gap: of them at the start, shape (num_points,), m.
        inertia: whether bodies have mass.
        monolithic: whether bulk and interactions are one system.
    """
    is_rigid = np.array([hasattr(law, "least_strength") for law in laws], bool)
    at_end = is_rigid & np.array([getattr(law, "damage", "") == "end" for law in laws], bool)
    if is_rigid.any() and not (inertia or monolithic):
        raise ValueError(
            "A static run (inertia=False) solves initially rigid bonds with the bulk, in one "
            'system: leave solver at "auto", or take xf.laws.CohesiveZone, or inertia.'
        )
    if at_end.any() and inertia:
        raise ValueError(
            'Initially rigid bonds with the damage of the end of the step (damage="end") are for '
            'static runs (inertia=False): leave damage at "auto".'
        )
    if (is_rigid & ~at_end).any() and not inertia:
        raise ValueError(
            "Initially rigid bonds of a static run (inertia=False) have the damage of the end of "
            'the step: leave damage at "auto".'
        )
    apart = gap[is_rigid[law_of_point]]
    if np.any(apart):
        raise ValueError(
            f"Initially rigid bonds join what touches, and {np.count_nonzero(apart)} of them "
            f"span gaps of up to {np.abs(apart).max():g} m: move the wall or the bodies "
            "together, or take a contact law."
        )
    if not monolithic and any(law.kernels(dim).growth is not None for law in laws):
        raise ValueError(
            'A law with the damage of the end of the step (damage="end") takes '
            'solver="monolithic" and an implicit bulk; leave damage at "auto".'
        )


def check_path_has_bonds(kernels: Sequence[LawKernels], asks: str, viscous_bulk: bool) -> None:
    """Raise a ValueError if no bond tells where a path goes on, or a viscosity needs a time.

    Args:
        kernels: of the laws in use.
        asks: what the control of the path asks of a law that has a growth, "growth" or "cost".
        viscous_bulk: whether the bulk is damped, or of a material with viscosity.
    """
    if all(law.growth is None for law in kernels):
        raise ValueError(
            "A path follows the damage of bonds, and no point of the scene has a law that tells "
            'it how far a bond may go: take xf.laws.CohesiveZone(damage="auto"). Initially rigid '
            "bonds are followed in steps of time, with viscosity where the load snaps."
        )
    for law in kernels:
        if law.growth is not None and getattr(law, asks) is None:
            raise ValueError(
                f"The law {law.name!r} has a growth and no {asks}: give its kernels both "
                "(LawKernels in xper_fx/nscd/laws/law.py), or take xf.GrowthControl."
            )
    if viscous_bulk or any("viscous" in law.energies for law in kernels):
        of, cure = (
            ("bond", "viscosity=0")
            if not viscous_bulk
            else ("bulk", "no damping, and a material without viscosity")
        )
        raise ValueError(
            f"A {of} with viscosity needs a time, and a path has none: its loads go back where a "
            f"structure snaps. Take {cure}; or leave out the path and step the loads in time, "
            "Simulation(scene, step, inertia=False, max_halvings=16), where each small "
            "enough step has a state near the last one."
        )
