# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures with Matplotlib: cracks, curves, energies, fragments, grains, laws, profiles."""

from typing import TYPE_CHECKING

from xper_fx.support.lazy import importer

if TYPE_CHECKING:
    from xper_fx.plotting.figures import COLOURS as COLOURS
    from xper_fx.plotting.figures import CrackPanel as CrackPanel
    from xper_fx.plotting.figures import new_figure as new_figure
    from xper_fx.plotting.figures import plot_cracks as plot_cracks
    from xper_fx.plotting.figures import plot_curves as plot_curves
    from xper_fx.plotting.figures import plot_energies as plot_energies
    from xper_fx.plotting.figures import plot_grains as plot_grains
    from xper_fx.plotting.figures import plot_law as plot_law
    from xper_fx.plotting.figures import plot_microstructure as plot_microstructure
    from xper_fx.plotting.figures import plot_profile as plot_profile
    from xper_fx.plotting.fragment_figure import plot_fragments as plot_fragments

_MODULE_OF = {
    "COLOURS": "figures",
    "CrackPanel": "figures",
    "new_figure": "figures",
    "plot_cracks": "figures",
    "plot_curves": "figures",
    "plot_energies": "figures",
    "plot_fragments": "fragment_figure",
    "plot_grains": "figures",
    "plot_law": "figures",
    "plot_microstructure": "figures",
    "plot_profile": "figures",
}

__all__ = list(_MODULE_OF)
__getattr__ = importer(__name__, _MODULE_OF)
