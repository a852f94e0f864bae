# SPDX-License-Identifier: LGPL-3.0-or-later
"""Studies: error against time, errors of chosen quantities, collapse loads of rigid blocks."""

from typing import TYPE_CHECKING

from xper_fx.support.lazy import importer

if TYPE_CHECKING:
    from xper_fx.study.collapse import CollapseLoad as CollapseLoad
    from xper_fx.study.collapse import Equilibrium as Equilibrium
    from xper_fx.study.collapse import collapse_load as collapse_load
    from xper_fx.study.collapse import equilibrium as equilibrium
    from xper_fx.study.definition import Setting as Setting
    from xper_fx.study.definition import Study as Study
    from xper_fx.study.definition import product as product
    from xper_fx.study.definition import varied as varied
    from xper_fx.study.definition import vary as vary
    from xper_fx.study.error_estimates import Estimated as Estimated
    from xper_fx.study.error_estimates import estimate_errors as estimate_errors
    from xper_fx.study.plots import plot_error_against_cost as plot_error_against_cost
    from xper_fx.study.plots import plot_price as plot_price
    from xper_fx.study.results import StudyResults as StudyResults
    from xper_fx.study.study import run_study as run_study

_MODULE_OF = {
    "CollapseLoad": "collapse",
    "Equilibrium": "collapse",
    "Estimated": "error_estimates",
    "Setting": "definition",
    "Study": "definition",
    "StudyResults": "results",
    "collapse_load": "collapse",
    "equilibrium": "collapse",
    "estimate_errors": "error_estimates",
    "plot_error_against_cost": "plots",
    "plot_price": "plots",
    "product": "definition",
    "run_study": "study",
    "varied": "definition",
    "vary": "definition",
}

__all__ = list(_MODULE_OF)
__getattr__ = importer(__name__, _MODULE_OF)
