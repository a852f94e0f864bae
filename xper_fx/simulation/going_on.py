# SPDX-License-Identifier: LGPL-3.0-or-later
"""A simulation that goes on from the state of another one, whose scene may be another.

Time, energies, bodies, contacts and their history go on. What is not in the scene any more leaves
with its contacts; what is new begins with none. A contact goes on whose bodies do and whose law is
of the same kind, with whatever parameters; any other begins anew. The ledger takes what comes and
leaves as if it had been there, or not, from the start, so that its balance still closes.

**Limitation.** The energy that adhesive contacts hold is not known by itself: where such contacts
leave with their bodies, `closure` shows it from then on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from xper_fx.nscd.contact_history import kernels_of_contacts
from xper_fx.nscd.laws.law import Law
from xper_fx.nscd.rigid.bodies import RigidBodies
from xper_fx.scene.snapshot import Snapshot
from xper_fx.simulation.course import Course
from xper_fx.simulation.explicit_start import leave_explicit

if TYPE_CHECKING:
    from xper_fx.simulation.restartable import Restartable


def go_on(simulation: Restartable, after: Snapshot) -> None:
    """Let a simulation, before its first step, go on from a snapshot.

    Raises:
        ValueError: another scheme of meshed bodies.
    """
    model = simulation.model
    if model.begins_explicit and after.scheme == "implicit":
        leave_explicit(model)
    now = (model.options.scheme, model.options.inertia)
    if not after.laws and after.scheme == "explicit":  # nothing but the bulk is of the scheme
        now = ("explicit", now[1])
    if model.scene.bodies is not None and now != (after.scheme, after.inertia):
        raise ValueError(
            "A scene with a mesh goes on with the scheme of the run, "
            f"scheme={after.scheme!r}, inertia={after.inertia}; got {now[0]!r}, {now[1]}."
        )
    stored = 0.0 if model.joints is None else model.joints.stored
    saved = _carried(simulation, after)
    simulation.restore(saved)
    model = simulation.model  # another one where the run had divided its bodies anew
    if model.options.scheme == "implicit":
        model.ledger.leave_shadow()
    if model.scene.bodies is not None and model.options.path is None:
        loads = model.bulk.external(simulation.time)
        simulation.state = replace(simulation.state, external=loads)
    kinetic = model.ledger.energies.kinetic  # beside a mesh all bodies stay
    if model.scene.bodies is None:
        kinetic = model.rigid.kinetic
    if model.interactions is not None:
        stored += _in_wires(saved, model.interactions.laws, model.scene.dim)
    stored -= _in_wires(after.saved, after.laws, model.scene.dim)
    model.ledger.exchange(kinetic, stored)


def _carried(simulation: Restartable, after: Snapshot) -> dict:
    """The state of the run, of what is in both scenes, as a simulation of the new one saves it."""
    model, scene, before = simulation.model, simulation.model.scene, after.scene
    saved = dict(after.saved) | {"course": Course().saved(), "equations": simulation.equations}
    number = after.numbers_of(scene.rigid)
    same_bodies = np.array_equal(number, np.arange(len(before.rigid)))
    if not same_bodies:
        saved.pop("detection", None)
    if not (same_bodies and (scene.contacts, scene.joints) == (before.contacts, before.joints)):
        saved.pop("solvers", None)
        saved.pop("balance", None)  # others may have to be on one rank
    if model.rigid is not None:
        saved["rigid"] = _left_where_it_is(model.rigid.saved(), saved["rigid"], number)
    if "rigid_reactions" in saved:
        impulses = saved["rigid_reactions"].reshape(-1, 2, scene.dim)
        saved["rigid_reactions"] = _of_known(impulses, number).reshape(-1, scene.dim)
    if model.interactions is None or "interactions" not in saved:
        return saved
    points, laws = dict(saved["interactions"]), model.interactions.laws

    def keys_of_contacts(keys: np.ndarray) -> np.ndarray:
        # beside a mesh, where keys are of other kinds too, bodies are the same
        if same_bodies:
            return keys
        return _contact_keys(keys, number, scene.rigid_bodies, before.rigid_bodies)

    points["contacts"] = _records(points.get("contacts", {}), after, laws, keys_of_contacts)
    if after.joint_rows is not None:
        rows_before = np.zeros(0, int) if model.joints is None else model.joints.row_before
        new_row = _inverse(rows_before, len(after.joint_rows))

        def keys_of_rows(keys: np.ndarray) -> np.ndarray:
            return np.stack([new_row[keys[:, 0]], keys[:, 1]], axis=1)

        points["joints"] = _records(points.get("joints", {}), after, laws, keys_of_rows)
    return saved | {"interactions": points}


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
        there = _of_known(left[name], number) == fresh[name]
        known = known & there.reshape(len(number), -1).all(axis=1)
    out = {name: own.copy() for name, own in fresh.items()}
    for name, own in out.items():
        own[known] = left[name][number[known]]
    return out


def _inverse(number: np.ndarray, before: int) -> np.ndarray:
    """New number of each old one, -1 of what has left; shape (before,)."""
    new = np.full(before, -1)
    new[number[number >= 0]] = np.flatnonzero(number >= 0)
    return new


def _contact_keys(
    keys: np.ndarray, number: np.ndarray, bodies: RigidBodies, before: RigidBodies
) -> np.ndarray:
    """Keys of contacts between rigid bodies in the new scene, negative where a body has left.

    Args:
        keys: shape (n, 2), in the scene of the run (`nscd/search/rigid_search.py`).
        number: of each body there.
        bodies: of the new scene.
        before: those of the run.
    """
    count = len(before.shapes.body)
    new = np.full(count, -1)
    left = np.isin(before.shapes.body, number)
    new[left] = np.flatnonzero(number[bodies.shapes.body] >= 0)
    first, second = (new[piece] for piece in np.divmod(keys[:, 0], count))
    known = (first >= 0) & (second >= 0)
    pair = np.where(known, first * len(bodies.shapes.body) + second, -1)
    return np.stack([pair, keys[:, 1]], axis=1)


def _records(
    records: Mapping,
    after: Snapshot,
    laws: Sequence[Law],
    new_keys: Callable[[np.ndarray], np.ndarray],
) -> dict:
    """Histories of contacts or of joints' rows, by law, of those that go on."""
    dim, out = after.scene.dim, {}
    kernels, before = kernels_of_contacts(laws, dim), kernels_of_contacts(after.laws, dim)
    for name, record in records.items():
        law, sides = name.split(" ", 1)
        own = before[int(law)]
        if own not in kernels:
            continue
        keys = new_keys(record["keys"])
        rows = np.flatnonzero(keys[:, 0] >= 0)
        rows = rows[np.lexsort(keys[rows].T[::-1])]
        kept = {what: values[rows] for what, values in record.items()}
        out[f"{kernels.index(own)} {sides}"] = kept | {"keys": keys[rows]}
    return out


def _in_wires(saved: Mapping, laws: Sequence[Law], dim: int) -> float:
    """Energy of the elastic wires of a state (J)."""
    total, kernels = 0.0, kernels_of_contacts(laws, dim)
    for name, record in saved.get("interactions", {}).get("joints", {}).items():
        if kernels[int(name.split()[0])].state_names == ("stored",):
            total += float(record["state"].sum())
    return total
