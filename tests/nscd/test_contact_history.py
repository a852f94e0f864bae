# SPDX-License-Identifier: LGPL-3.0-or-later
"""What contacts keep while they come and go, against a dictionary."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from xper_fx.nscd.contact_history import ContactHistory
from xper_fx.nscd.couplings import Sides
from xper_fx.nscd.laws import SignoriniCoulomb
from xper_fx.nscd.points import frame_from_normal

LAWS = {"slides": SignoriniCoulomb(0.3), "smooth": SignoriniCoulomb()}


class Group(SimpleNamespace):
    """What a history reads and writes of a group of points."""

    def __len__(self):
        return len(self.indices)


def groups_of(law_of_key, dim, rng):
    """Contacts of sorted keys by law, in an order of their own, with random values at each."""
    keys = np.array(sorted(law_of_key), np.int64).reshape(-1, 2)
    out = []
    for name, law in LAWS.items():
        kernels = law.kernels(dim)
        number = np.array(
            [n for n, key in enumerate(keys.tolist()) if law_of_key[tuple(key)] == name], int
        )
        indices = rng.permutation(number)
        normal = rng.normal(size=(len(indices), dim))
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        shape = len(indices), kernels.components
        group = Group(
            kernels=kernels, sides=Sides(dim, kernels.components, 1), indices=indices,
            points=SimpleNamespace(
                dim=dim, frame=np.ascontiguousarray(frame_from_normal(normal)[:, : shape[1]])
            ),
            committed_impulse=rng.normal(size=shape), jump=rng.normal(size=shape),
            state=rng.normal(size=(shape[0], len(kernels.state_names))),
        )  # fmt: skip
        out.append(group)
    return keys, out


def remembered(keys, groups):
    """By law and key: impulse and slip in global axes, and state."""
    out = {}
    for g in groups:
        slip = g.jump.copy()
        slip[:, 0] = 0.0
        for i, number in enumerate(g.indices):
            frame = g.points.frame[i]
            vectors = g.committed_impulse[i] @ frame, slip[i] @ frame
            out[g.kernels, tuple(keys[number].tolist())] = (*vectors, g.state[i].copy())
    return out


KEYS = st.dictionaries(
    st.tuples(st.integers(0, 3), st.integers(0, 3)), st.sampled_from(sorted(LAWS)), max_size=12
)


@pytest.mark.parametrize("dim", [2, 3])
@settings(max_examples=60, deadline=None, derandomize=True)
@given(before=KEYS, after=KEYS, seed=st.integers(0, 10**6))
def test_contacts_go_on_where_those_with_their_keys_ended(dim, before, after, seed):
    """In frames that have turned; a new contact, or one of another law, keeps its start."""
    rng = np.random.default_rng(seed)
    keys, groups = groups_of(before, dim, rng)
    known = remembered(keys, groups)
    history = ContactHistory([(g, keys) for g in groups])
    keys, groups = groups_of(after, dim, rng)
    for g in groups:
        start = g.committed_impulse.copy(), g.jump.copy(), g.state.copy()
        history.transfer(g, keys)
        for i, number in enumerate(g.indices):
            kept = known.get((g.kernels, tuple(keys[number].tolist())))
            assert g.jump[i, 0] == start[1][i, 0]  # the gap is the one just found
            if kept is None:
                for now, then in zip((g.committed_impulse, g.jump, g.state), start, strict=True):
                    np.testing.assert_array_equal(now[i], then[i])
                continue
            frame = g.points.frame[i]
            impulse, slip, state = kept
            np.testing.assert_allclose(g.committed_impulse[i], frame @ impulse, atol=1e-14)
            np.testing.assert_allclose(g.jump[i, 1:], (frame @ slip)[1:], atol=1e-14)
            np.testing.assert_array_equal(g.state[i], state)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_history_is_saved_and_restored(dim):
    rng = np.random.default_rng(5)
    known = {(1, 0): "slides", (1, 2): "smooth", (3, 1): "slides"}
    keys, groups = groups_of(known, dim, rng)
    kernels = [law.kernels(dim) for law in LAWS.values()]
    saved = ContactHistory([(g, keys) for g in groups]).saved(kernels)
    again = ContactHistory.restored(saved, kernels, dim)
    expected = remembered(keys, groups)
    for g in groups:
        g.committed_impulse[:], g.state[:] = 0.0, 0.0
        again.transfer(g, keys)
        for i, number in enumerate(g.indices):
            impulse, _, state = expected[g.kernels, tuple(keys[number].tolist())]
            np.testing.assert_allclose(
                g.committed_impulse[i], g.points.frame[i] @ impulse, atol=1e-14
            )
            np.testing.assert_array_equal(g.state[i], state)
