# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dynamics of the bulk: mass, free velocities and the inverse of the iteration matrix."""
