# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fracture, contact and friction of multibody media by NonSmooth Contact Dynamics in FEniCSx."""

__version__ = "0.1.0"
