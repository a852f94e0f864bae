# SPDX-License-Identifier: LGPL-3.0-or-later
"""What may help where a step does not converge, if that is known."""

from __future__ import annotations

import numpy as np

ON_PATH = (
    "Bonds may flip between loading and unloading: try a smaller growth or energy of the path, "
    "softer bonds, or facets that resolve the cohesive zone; look at the last output first."
)
LOADS_TURN = (
    "The loads turn or stand still here, and none of them leads the structure on: let the path end "
    "before, or take steps in time from there on; look at the last output first."
)
UNDER_LOAD = (
    "There may be no equilibrium at this load, or it snaps: follow its path "
    "(path=xf.GrowthControl(); not of initially rigid bonds, which take viscosity), or give the "
    "bodies inertia; look at the last output first."
)
FOR_NOTHING = (
    "Iterates broke bonds that stay closed, for no energy: try a smaller step or tolerance, or "
    "forgiving=True to go on with that; look at the last output first."
)
OF_BULK = (
    "The interactions converge and the bulk does not: try a smaller step or tolerance, a larger "
    'max_newton, or solver="monolithic"; look at the last output first.'
)
AT_POINTS = (
    'The contacts were solved at their points: try solver="monolithic", which takes them together '
    "with the bodies, or a looser tolerance; look at the last output first."
)
OF_ONE_SOLVER = (
    'One way of solving was asked for: solver="auto" takes another where one does not get on. Or '
    "try a smaller step, more sweeps or a looser tolerance; look at the last output first."
)

CONTRADICTORY = (
    "Perfect bonds or contacts contradict each other, or what is prescribed on both their sides, "
    "and their impulses grow without bound: look at what is prescribed and at the initial "
    "velocities of driven nodes that face each other."
)


def comes_loose(bodies: np.ndarray, place: np.ndarray) -> str:
    """Of the bodies of a fragment about a place (m) that nothing holds once its bonds are spent."""
    few = ", ".join(map(str, bodies[:5])) + (", ..." if len(bodies) > 5 else "")
    return (
        f"A fragment comes loose: bodies {few} ({len(bodies)} in all) around {_place(place)}, "
        "whose bonds to all others have spent their energy, and without inertia nothing but "
        "contact holds it: prescribe some of its motion, or take inertia=True."
    )


def contested(place: np.ndarray) -> str:
    """Of the bond at a place (m) that neither loading nor unloading agrees with, along a path."""
    return (
        f"The bond at {_place(place)} opens beyond its limit where it is to unload, and closes "
        "where it is to open: there may be no equilibrium to go on to, whatever the load, so that "
        "the structure snaps here. Take steps in time with viscosity= of the bonds, or inertia; "
        "or try a smaller growth or energy of the path, softer bonds, or facets that resolve the "
        "cohesive zone; look at the last output first."
    )


def flipped(place: np.ndarray) -> str:
    """Of the facet at a place (m), whose lips have no normal any more."""
    return (
        f"The facet at {_place(place)} flips or degenerates in the step: the cells beside it are "
        "crushed or tear apart; look at the last output there, and take a smaller step or stiffer "
        "contact."
    )


def _place(place: np.ndarray) -> str:
    return "(" + ", ".join(f"{x:.6g}" for x in place) + ")"
