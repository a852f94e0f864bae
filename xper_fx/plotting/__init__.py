# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures of runs with Matplotlib: cracks, curves, energies, grains, packings, studies."""

from typing import TYPE_CHECKING

from xper_fx.lazy import importer

if TYPE_CHECKING:
    from xper_fx.cracks import crack_panel as crack_panel
    from xper_fx.frames import Frame as Frame
    from xper_fx.frames import plot_frames as plot_frames
    from xper_fx.frames import take_frame as take_frame
    from xper_fx.nscd.rigid.outline import outline as outline
    from xper_fx.plots import COLOURS as COLOURS
    from xper_fx.plots import CrackPanel as CrackPanel
    from xper_fx.plots import new_figure as new_figure
    from xper_fx.plots import plot_cracks as plot_cracks
    from xper_fx.plots import plot_curves as plot_curves
    from xper_fx.plots import plot_energies as plot_energies
    from xper_fx.plots import plot_grains as plot_grains
    from xper_fx.plots import plot_law as plot_law
    from xper_fx.plots import plot_microstructure as plot_microstructure
    from xper_fx.plots import plot_profile as plot_profile
    from xper_fx.study_plots import plot_error_against_cost as plot_error_against_cost
    from xper_fx.study_plots import plot_price as plot_price

_MODULE_OF = {
    "COLOURS": "plots",
    "CrackPanel": "plots",
    "Frame": "frames",
    "crack_panel": "cracks",
    "new_figure": "plots",
    "outline": "nscd.rigid.outline",
    "plot_cracks": "plots",
    "plot_curves": "plots",
    "plot_energies": "plots",
    "plot_error_against_cost": "study_plots",
    "plot_frames": "frames",
    "plot_grains": "plots",
    "plot_law": "plots",
    "plot_microstructure": "plots",
    "plot_price": "study_plots",
    "plot_profile": "plots",
    "take_frame": "frames",
}

__all__ = list(_MODULE_OF)
__getattr__ = importer("xper_fx", _MODULE_OF)
