# SPDX-License-Identifier: LGPL-3.0-or-later
"""Groups that can meet are named by a contact, or the scene is refused."""

from __future__ import annotations

import re

import pytest
from misused_scenes import BOND, TOUCH, disc, of_discs, of_plate

import xper_fx as xf

FLOOR = xf.rigid.wall((0.0, -1.0), (0.0, 1.0), "floor")
ROOF = xf.rigid.wall((0.0, 9.0), (0.0, -1.0), "roof")


def lines_of(make) -> list[tuple[str, str]]:
    """The pairs of the lines that the error gives, as a user would paste them."""
    with pytest.raises(ValueError, match="where bodies of these groups meet") as raised:
        make()
    text = str(raised.value)
    return [eval(each, {"xf": xf}).between for each in re.findall(r"xf\.Contact\(.*None\)", text)]


def test_lines_of_the_error_are_what_is_missing():
    bodies = [disc(), disc((3, 0)), disc((6, 0), "b"), FLOOR, ROOF]
    pairs = [("discs", "floor"), ("floor", "b"), ("roof", "b")]

    missing = lines_of(lambda: of_discs(*bodies, pairs=pairs))

    # one body cannot meet itself; walls that are held do not meet
    assert set(missing) == {("b", "discs"), ("discs", "discs"), ("discs", "roof")}
    contacts = [xf.Contact(pair, TOUCH) for pair in pairs]
    contacts += [xf.Contact(pair, None) for pair in missing]
    assert len(xf.Scene(rigid=bodies, contacts=contacts).contacts) == 6


def test_a_handful_of_lines_of_many():
    bodies = [disc((3.0 * n, 0.0), f"group {n}") for n in range(200)]
    pairs = [("group 0", f"group {n}") for n in range(1, 200)]
    assert len(lines_of(lambda: of_discs(*bodies, pairs=pairs))) == 5


def test_pieces_of_surfaces():
    """Bodies that a law joins are one piece and do not meet, in one surface or in two."""
    ball = disc((1.0, 4.0), "ball")
    free = {"interactions": {(1, 2): None}}
    one = {
        "surfaces": {"plate": (1, 2)}, "rigid": [ball],
        "contacts": [xf.Contact(("plate", "ball"), TOUCH)],
    }  # fmt: skip
    two = {
        "surfaces": {"left": (1,), "right": (2,)}, "rigid": [ball],
        "contacts": [xf.Contact((name, "ball"), TOUCH) for name in ("left", "right")],
    }  # fmt: skip

    for joined in (one, two):
        of_plate(**joined)
    of_plate(default_interaction=None, interactions={
        (1, 1): BOND, (2, 2): BOND, (1, 2): TOUCH}, **one)  # fmt: skip

    assert lines_of(lambda: of_plate(**free, **one)) == [("plate", "plate")]
    assert lines_of(lambda: of_plate(**free, **two)) == [("left", "right")]
