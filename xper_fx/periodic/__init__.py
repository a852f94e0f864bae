# SPDX-License-Identifier: LGPL-3.0-or-later
"""Periodic cells: macroscopic gradient or stress, the two-field problem, microstructures."""

from typing import TYPE_CHECKING

from xper_fx.support.lazy import importer

if TYPE_CHECKING:
    from xper_fx.periodic.drive import MacroscopicDrive as MacroscopicDrive

_MODULE_OF = {
    "MacroscopicDrive": "drive",
}

__all__ = list(_MODULE_OF)
__getattr__ = importer(__name__, _MODULE_OF)
