# SPDX-License-Identifier: LGPL-3.0-or-later
"""A simulation that goes on from the state of another one, whose scene may be another.

Time, energies, bodies, contacts and their history go on. What is not in the scene any more leaves
with its contacts; what is new begins with none. A contact goes on whose bodies do and whose law is
of the same kind, with whatever parameters; any other begins anew. The ledger takes what comes and
leaves as if it had been there, or not, from the start, so that its balance still closes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from xper_fx.nscd.laws.law import Law
from xper_fx.scene.snapshot import Snapshot
from xper_fx.simulation.course import Course

if TYPE_CHECKING:
    from xper_fx.simulation.restartable import Restartable


def go_on(simulation: Restartable, after: Snapshot) -> None:
    """Let a simulation, before its first step, go on from a snapshot.

    Raises:
        ValueError: another scheme of meshed bodies.
    """
    model = simulation.model
    now = (model.options.scheme, model.options.inertia)
    if model.scene.bodies is not None and now != (after.scheme, after.inertia):
        raise ValueError(
            "A scene with a mesh goes on with the scheme of the run, "
            f"scheme={after.scheme!r}, inertia={after.inertia}; got {now[0]!r}, {now[1]}."
        )
    wires = 0.0 if model.joints is None else model.joints.stored
    saved = _carried(simulation, after)
    simulation.restore(saved)
    simulation._resumes = False
    held = model.bulk.kinetic_energy(simulation.state.velocity)
    if model.rigid is not None:
        held += model.rigid.kinetic
    if model.interactions is not None:
        dim = model.scene.dim
        wires += _stored(saved, model.interactions.laws, dim) - _stored(after.saved, after.laws, dim)
    model.ledger.exchange(held, wires)


def _carried(simulation: Restartable, after: Snapshot) -> dict:
    """The state of the run, of what is in both scenes, as a simulation of the new one saves it."""
    model, saved = simulation.model, dict(after.saved)
    scene = model.scene
    saved["course"] = Course().saved()
    number = after.numbers_of(scene.rigid)
    same_bodies = np.array_equal(number, np.arange(len(after.scene.rigid)))
    same_points = (
        same_bodies and scene.contacts == after.scene.contacts and scene.joints == after.scene.joints
    )
    if not same_points:
        saved.pop("solvers", None)
    if model.rigid is not None:
        saved["rigid"] = _left_where_it_is(model.rigid.saved(), saved["rigid"], number)
    if "rigid_reactions" in saved:
        shape = (-1, 2, scene.dim)
        saved["rigid_reactions"] = _of_known(
            saved["rigid_reactions"].reshape(shape), number
        ).reshape(-1, scene.dim)
    if "detection" in saved and not same_bodies:
        saved["detection"] = {}
    if model.interactions is not None and "interactions" in saved:
        points = saved["interactions"] = dict(saved["interactions"])
        laws, before = model.interactions.laws, len(after.scene.rigid)
        if not same_bodies:  # beside a mesh they are the same, where keys are of another kind too
            points["contacts"] = _records(
                points.get("contacts", {}), after, laws,
                lambda keys: _contact_keys(keys, number, before),
            )  # fmt: skip
        else:
            points["contacts"] = _records(points.get("contacts", {}), after, laws, np.copy)
        if after.joint_rows is not None:
            none = np.zeros(0, int)
            row = none if model.joints is None else model.joints.row_before
            new = _inverse(row, len(after.joint_rows))
            points["joints"] = _records(
                points.get("joints", {}), after, laws,
                lambda keys: np.stack([new[keys[:, 0]], keys[:, 1]], axis=1),
            )  # fmt: skip
    return saved


def _of_known(rows: np.ndarray, number: np.ndarray) -> np.ndarray:
    """Rows of the bodies of the new scene, zero of new ones."""
    out = np.zeros((len(number), *rows.shape[1:]))
    out[number >= 0] = rows[number[number >= 0]]
    return out


def _left_where_it_is(
    fresh: Mapping[str, np.ndarray], left: Mapping[str, np.ndarray], number: np.ndarray
) -> dict[str, np.ndarray]:
    """State of the bodies: as the run has left it, but of new ones and those moved apart."""
    known = number >= 0
    for name in ("position", "rotation"):
        there = _of_known(left[name], number)
        known = known & (there == fresh[name]).reshape(len(number), -1).all(axis=1)
    return {
        name: np.where(known.reshape(-1, *(1,) * (own.ndim - 1)), _of_known(left[name], number), own)
        for name, own in fresh.items()
    }


def _contact_keys(keys: np.ndarray, number: np.ndarray, before: int) -> np.ndarray:
    """Keys of contacts between rigid bodies in the new scene, -1 in the first column of those gone.

    Args:
        keys: shape (n, 2), in the scene of the run (`nscd/search/rigid_search.py`).
        number: of each body there.
        before: how many bodies were there.
    """
    new = _inverse(number, before)
    first, second = (new[body] for body in np.divmod(keys[:, 0], before))
    pair = np.where((first >= 0) & (second >= 0), first * len(number) + second, -1)
    return np.stack([pair, keys[:, 1]], axis=1)


def _inverse(number: np.ndarray, before: int) -> np.ndarray:
    """New number of each old one, -1 of what is gone; shape (before,)."""
    new = np.full(before, -1)
    new[number[number >= 0]] = np.flatnonzero(number >= 0)
    return new


def _records(
    records: Mapping, after: Snapshot, laws: Sequence[Law], new_keys: Callable[[np.ndarray], np.ndarray]
) -> dict:
    """Histories of contacts or of joints' rows, by law, of those that go on."""
    dim, out = after.scene.dim, {}
    kernels = [law.kernels(dim) for law in laws]
    for name, record in records.items():
        law, sides = name.split(" ", 1)
        own = after.laws[int(law)].kernels(dim)
        if own not in kernels:
            continue
        keys = new_keys(record["keys"])
        rows = np.flatnonzero(keys[:, 0] >= 0)
        rows = rows[np.lexsort(keys[rows].T[::-1])]
        kept = {what: values[rows] for what, values in record.items()}
        out[f"{kernels.index(own)} {sides}"] = kept | {"keys": keys[rows]}
    return out


def _stored(saved: Mapping, laws: Sequence[Law], dim: int) -> float:
    """Energy of the elastic wires in a state (J)."""
    total = 0.0
    for name, record in saved.get("interactions", {}).get("joints", {}).items():
        if laws[int(name.split()[0])].kernels(dim).state_names == ("stored",):
            total += float(record["state"].sum())
    return total
