# SPDX-License-Identifier: LGPL-3.0-or-later
"""The state of a run, for another scene to go on from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from xper_fx.nscd.laws.law import Law
from xper_fx.nscd.rigid.bodies import RigidBodies
from xper_fx.nscd.rigid.body import RigidBody

if TYPE_CHECKING:
    from xper_fx.nscd.rigid.joint_rows import JointRows

# What meshed bodies and their permanent points are made of, and stays.
_MESHED = ("order", "points", "materials", "ties", "walls", "surfaces", "damping")


@dataclass(frozen=True, eq=False)
class Snapshot:
    """What `Simulation.snapshot()` gives, and `Scene(after=...)` takes."""

    scene: Any  #: of the run, a `Scene`
    time: float  #: s
    scheme: str  #: of the run
    inertia: bool  #: of the run
    laws: Sequence[Law]  #: of its interactions
    joint_rows: JointRows | None  #: of its joints, None without any
    saved: Mapping  #: the state, as `Simulation.saved` gives it, its rows in order

    def numbers_of(self, rigid: Sequence[RigidBody]) -> np.ndarray:
        """Number in the run's scene of each rigid body of another, -1 of a new one; shape (n,)."""
        known = {id(body): number for number, body in enumerate(self.scene.rigid)}
        return np.array([known.get(id(body), -1) for body in rigid], int)

    def place(self, rigid: Sequence[RigidBody], bodies: RigidBodies) -> None:
        """Put the bodies of the run where it left them, as they move.

        Args:
            rigid: bodies of a scene.
            bodies: the same as arrays, which are changed.
        """
        number = self.numbers_of(rigid)
        known, state = np.flatnonzero(number >= 0), self.saved["rigid"]
        spin = state["spin"] if bodies.dim == 3 else state["spin"][:, 0]
        for own, left in (
            (bodies.position, state["position"]),
            (bodies.velocity, state["velocity"]),
            (bodies.rotation, state["rotation"]),
            (bodies.spin, spin),
        ):
            own[known] = left[number[known]]

    def check(self, scene: Any) -> None:
        """See that a scene can go on from here.

        Args:
            scene: a `Scene`.

        Raises:
            ValueError: another mesh, or what its points are made of; rigid bodies in another order,
                or other ones beside a mesh.
        """
        if scene.bodies is not self.scene.bodies:
            raise ValueError(
                "A scene goes on with the meshed bodies of the run or, as that, without any: give "
                "the same Bodies object as `bodies`, that of the scene that the run was given "
                "(Simulation.scene has another one where ranks have divided a spread mesh anew)."
            )
        number = self.numbers_of(scene.rigid)
        known = number[number >= 0]
        if np.any(np.diff(known) < 0):
            raise ValueError(
                "Rigid bodies that go on from a run should stand in its order in `rigid`; new ones "
                "may stand between them."
            )
        if scene.bodies is None:
            return
        if len(known) < len(number) or len(known) < len(self.scene.rigid):
            raise ValueError(
                "Rigid bodies are added or removed in scenes of rigid bodies alone; this one has a "
                "mesh."
            )
        for name in _MESHED:
            if getattr(scene, name) != getattr(self.scene, name):
                raise ValueError(
                    f"A scene with a mesh goes on with the `{name}` of the run, got "
                    f"{getattr(scene, name)!r} after {getattr(self.scene, name)!r}."
                )
        (laws, index), (old_laws, old_index) = scene.law_of_facet(), self.scene.law_of_facet()
        kernels, old = ([law.kernels(scene.dim) for law in of] for of in (laws, old_laws))
        for own, before in np.unique(np.stack([index, old_index], axis=1), axis=0).tolist():
            if (own < 0) != (before < 0) or (own >= 0 and kernels[own] is not old[before]):
                raise ValueError(
                    "Laws between meshed bodies may take other parameters, and not become laws of "
                    f"another kind: {laws[own] if own >= 0 else None!r} after "
                    f"{old_laws[before] if before >= 0 else None!r}."
                )
