# SPDX-License-Identifier: LGPL-3.0-or-later
"""Periodic media: cells that repeat in space, and their microstructures."""
