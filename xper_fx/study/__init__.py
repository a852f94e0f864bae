# SPDX-License-Identifier: LGPL-3.0-or-later
"""Studies of error against time: settings, runs in processes of their own, results, figures."""

from typing import TYPE_CHECKING

from xper_fx.support.lazy import importer

if TYPE_CHECKING:
    from xper_fx.study.definition import Setting as Setting
    from xper_fx.study.definition import Study as Study
    from xper_fx.study.definition import product as product
    from xper_fx.study.definition import varied as varied
    from xper_fx.study.definition import vary as vary
    from xper_fx.study.plots import plot_error_against_cost as plot_error_against_cost
    from xper_fx.study.plots import plot_price as plot_price
    from xper_fx.study.results import StudyResults as StudyResults
    from xper_fx.study.study import run_study as run_study

_MODULE_OF = {
    "Setting": "definition",
    "Study": "definition",
    "StudyResults": "results",
    "plot_error_against_cost": "plots",
    "plot_price": "plots",
    "product": "definition",
    "run_study": "study",
    "varied": "definition",
    "vary": "definition",
}

__all__ = list(_MODULE_OF)
__getattr__ = importer(__name__, _MODULE_OF)
