# SPDX-License-Identifier: LGPL-3.0-or-later
"""What laws ask of the run that they are in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from xper_fx.nscd.laws.law import LawKernels


def check_laws_suit(
    kernels: Sequence[LawKernels],
    law_of_point: np.ndarray,
    gap: np.ndarray,
    inertia: bool,
    monolithic: bool,
) -> None:
    """Raise a ValueError where laws would not be what they are.

    Args:
        kernels: of each law.
        law_of_point: of the permanent points, shape (num_points,).
        gap: of them at the start, shape (num_points,), m.
        inertia: whether bodies have mass.
        monolithic: whether bulk and interactions are one system.
    """
    is_rigid = np.array([law.rigid is not None for law in kernels], bool)
    if is_rigid.any() and not inertia:
        raise ValueError(
            "Initially rigid bonds have the mean traction of a step, and a static run "
            "(inertia=False) asks for that of its end: take xf.laws.CohesiveZone, or inertia."
        )
    apart = gap[is_rigid[law_of_point]]
    if np.any(apart):
        raise ValueError(
            f"Initially rigid bonds join what touches, and {np.count_nonzero(apart)} of them "
            f"span gaps of up to {np.abs(apart).max():g} m: move the wall or the bodies "
            "together, or take a contact law."
        )
    if not monolithic and any(law.growth is not None for law in kernels):
        raise ValueError(
            'A law with the damage of the end of the step (damage="end") takes '
            'solver="monolithic" and an implicit bulk; leave damage at "auto".'
        )


def check_path_has_bonds(kernels: Sequence[LawKernels], asks: str) -> None:
    """Raise a ValueError if no bond tells where a path goes on, or its viscosity needs a time.

    Args:
        kernels: of the laws in use.
        asks: what the control of the path asks of a law that has a growth, "growth" or "cost".
    """
    if all(law.growth is None for law in kernels):
        raise ValueError(
            "A path follows the damage of bonds, and no point of the scene has a law "
            'whose damage is that of the end of the step: xf.laws.CohesiveZone(damage="auto").'
        )
    for law in kernels:
        if law.growth is not None and getattr(law, asks) is None:
            raise ValueError(
                f"The law {law.name!r} has a growth and no {asks}: give its kernels both "
                "(LawKernels in xper_fx/nscd/laws/law.py), or take xf.GrowthControl."
            )
    if any("viscous" in law.energies for law in kernels):
        raise ValueError(
            "A bond with viscosity needs a time, and a path has none: its loads go back where a "
            "structure snaps. Take viscosity=0; or leave out the path and step the loads in time, "
            "Simulation(scene, step, inertia=False, max_halvings=16), where each small "
            "enough step has a state near the last one."
        )
