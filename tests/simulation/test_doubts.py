# SPDX-License-Identifier: LGPL-3.0-or-later
"""Warnings of steps: once, with a count at the end."""

from xper_fx.simulation.doubts import BROKEN_FOR_NOTHING, UNSEEN, Doubts


def test_a_doubt_is_told_once_and_counted(caplog):
    doubts = Doubts()
    with caplog.at_level("WARNING", logger="xper_fx"):
        for number in (3, 4, 8):
            doubts.tell(BROKEN_FOR_NOTHING, number, 0.1)
        doubts.tell(UNSEEN, 5, 0.1)
        told = [r.getMessage() for r in caplog.records]
        assert told == [
            f"step 3 at h = 0.1 s: {BROKEN_FOR_NOTHING}",
            f"step 5 at h = 0.1 s: {UNSEEN}",
        ]
        caplog.clear()
        doubts.sum_up()
        doubts.sum_up()
    (told,) = (r.getMessage() for r in caplog.records)
    assert told == f"3 steps: {BROKEN_FOR_NOTHING}"
