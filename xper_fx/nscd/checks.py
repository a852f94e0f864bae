# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of the numbers a user gives: what was given, what was expected."""

from __future__ import annotations

import math


def require_positive(name: str, value: float) -> None:
    """Raise ValueError unless `value` is a finite number above zero."""
    if not (math.isfinite(value) and value > 0.0):
        raise ValueError(f"{name} should be a finite number above zero, got {value}.")


def require_non_negative(name: str, value: float) -> None:
    """Raise ValueError unless `value` is a finite number, zero or above."""
    if not (math.isfinite(value) and value >= 0.0):
        raise ValueError(f"{name} should be a finite number, zero or above, got {value}.")
