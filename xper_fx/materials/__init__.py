# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bulk materials, one file each; `library.py` holds sourced constants."""

from xper_fx.materials.linear_elastic import LinearElastic
from xper_fx.materials.material import Material
from xper_fx.materials.neo_hookean import NeoHookean

__all__ = ["LinearElastic", "Material", "NeoHookean"]
