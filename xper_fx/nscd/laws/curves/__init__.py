# SPDX-License-Identifier: LGPL-3.0-or-later
"""Curves along which bonds weaken, one file each; `curve.py` says what a curve is."""

from typing import TYPE_CHECKING

from xper_fx.support.lazy import importer

if TYPE_CHECKING:
    from xper_fx.nscd.laws.curves.bilinear import Petersson as Petersson
    from xper_fx.nscd.laws.curves.bilinear import Trapezoidal as Trapezoidal
    from xper_fx.nscd.laws.curves.exponential import Exponential as Exponential
    from xper_fx.nscd.laws.curves.exponential import XuNeedleman as XuNeedleman
    from xper_fx.nscd.laws.curves.linear import Linear as Linear
    from xper_fx.nscd.laws.curves.parabolic import Parabolic as Parabolic
    from xper_fx.nscd.laws.curves.tvergaard import Tvergaard as Tvergaard

_MODULE_OF = {
    "Exponential": "exponential",
    "Linear": "linear",
    "Parabolic": "parabolic",
    "Petersson": "bilinear",
    "Trapezoidal": "bilinear",
    "Tvergaard": "tvergaard",
    "XuNeedleman": "exponential",
}

__all__ = list(_MODULE_OF)
__getattr__ = importer(__name__, _MODULE_OF)
