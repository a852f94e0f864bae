# SPDX-License-Identifier: LGPL-3.0-or-later
"""Periodic cells: lattice, macroscopic drive, the two-field problem, microstructures."""
