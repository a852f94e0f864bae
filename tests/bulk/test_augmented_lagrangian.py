# SPDX-License-Identifier: LGPL-3.0-or-later
"""When corrections for given impulses are left."""

from types import SimpleNamespace

import numpy as np
import pytest

from xper_fx.bulk import augmented_lagrangian
from xper_fx.bulk.augmented_lagrangian import Balance, find_contacts
from xper_fx.support.ranks import ALONE


@pytest.mark.parametrize(("last", "rounds"), [(2.0, 62), (np.inf, None)], ids=["circle", "creep"])
def test_stretched_changes_that_lead_back_are_left(monkeypatch, last, rounds):
    """Impulses that rise by 1 up to a last one, beyond which an answer is 0, circle as 0, 1, 3.

    Forces balance, and the second change has the direction of the first, in each circle: it does
    not count as one that only creeps. Answers at most 100 end a creep by ones.
    """
    given, seen = [np.zeros((1, 1))], []

    def answers():
        now = given[0][0, 0]
        return [np.array([[min(now + 1.0, 100.0) if now < last else 0.0]])]

    def take(impulses):
        given[0] = impulses[0].copy()
        seen.append(given[0][0, 0])

    monkeypatch.setattr(
        augmented_lagrangian, "_balance", lambda *_: Balance(found=True, led_up=False)
    )
    monkeypatch.setattr(augmented_lagrangian, "noise", lambda _: 0.0)
    step = SimpleNamespace(
        growth=None, turns=False, may_jump=False, descends=False, softens=True, ranks=ALONE,
        answers=answers,
        impulses_of_points=lambda: [given[0].copy()], set_impulses=take, size=lambda: 1.0,
        corrections=0,
    )  # fmt: skip
    change = find_contacts(step, 1e-6)
    if rounds is None:
        assert change == 1e-6 and seen[-1] == 100.0 and len(seen) < 30
    else:
        assert change == np.inf and seen[:6] == [1.0, 3.0, 0.0, 1.0, 3.0, 0.0]
        assert len(seen) <= rounds


def test_no_more_corrections_than_may_be(monkeypatch):
    """Impulses that creep for ever, by twelve corrections each, which 30 end at the third."""
    given, step = [np.zeros((1, 1))], SimpleNamespace()

    def balance(*_):
        step.corrections += 12
        return Balance(found=True, led_up=False)

    monkeypatch.setattr(augmented_lagrangian, "_balance", balance)
    monkeypatch.setattr(augmented_lagrangian, "noise", lambda _: 0.0)
    step.__dict__.update(
        growth=None, turns=False, may_jump=False, descends=False, softens=True, ranks=ALONE,
        corrections=7,
        size=lambda: 1.0,
        answers=lambda: [given[0] + 1.0], impulses_of_points=lambda: [given[0].copy()],
        set_impulses=lambda impulses: given.__setitem__(0, impulses[0].copy()),
    )  # fmt: skip
    assert find_contacts(step, 1e-6, most=30) == np.inf
    assert step.corrections == 7 + 3 * 12


@pytest.mark.parametrize(("found", "rounds"), [((), 16), ((5, 14), 30)], ids=["never", "twice"])
def test_rounds_that_find_no_balance_are_left(monkeypatch, found, rounds):
    """Impulses that get nearer in each round, by a fifth; balance is found in some of them."""
    given, count = [np.zeros((1, 2))], [0]

    def balance(*_):
        count[0] += 1
        return Balance(found=count[0] in found, led_up=False)

    monkeypatch.setattr(augmented_lagrangian, "_balance", balance)
    monkeypatch.setattr(augmented_lagrangian, "noise", lambda _: 0.0)
    step = SimpleNamespace(
        growth=None, turns=False, may_jump=False, descends=False, softens=True, ranks=ALONE,
        corrections=0,
        size=lambda: 1.0,
        answers=lambda: [given[0] + 0.8 ** count[0] * np.eye(2)[count[0] % 2]],
        impulses_of_points=lambda: [given[0].copy()],
        set_impulses=lambda impulses: given.__setitem__(0, impulses[0].copy()),
    )  # fmt: skip
    assert find_contacts(step, 1e-30) == np.inf
    assert count[0] == rounds
