# SPDX-License-Identifier: LGPL-3.0-or-later
"""How Sphinx builds the documentation.

    XPER_FX_DOCS=1 ./fenicsx python3 -m sphinx -W -b html docs docs/_build

Pages are Markdown (MyST). Those of the demos and the gallery are written at each build from the
demos themselves and from the table in `gallery.py`; the API reference from the docstrings.
"""

import os
import sys
from pathlib import Path

from sphinx.pycode import ModuleAnalyzer

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE)]
# Compiled kernels are then plain functions, whose signatures and docstrings autodoc reads.
os.environ["NUMBA_DISABLE_JIT"] = "1"

from docstrings import as_restructured_text  # noqa: E402
from gallery import write_gallery  # noqa: E402
from render_demos import write_demos  # noqa: E402
from test_index import write_test_index  # noqa: E402

import xper_fx  # noqa: E402

project = "xper_fx"
author = "The xper_fx developers"
copyright = author
version = release = xper_fx.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
]
templates_path = ["_templates"]
exclude_patterns = ["_build"]
highlight_language = "none"  # of literal blocks in docstrings, which are formulas

myst_enable_extensions = ["amsmath", "attrs_block", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

autosummary_generate = True
autodoc_default_options = {
    "members": True,
    "ignore-module-all": True,
    "no-value": True,
    "show-inheritance": True,
}
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True

html_theme = "furo"
html_title = f"xper_fx {release}"
html_static_path = ["_static"]
html_css_files = ["gallery.css"]
html_copy_source = False
# Publishers refuse robots; images are copied by the HTML builder only.
linkcheck_ignore = [r"https://doi\.org/.*", r"_images/.*"]


def write_pages(app):
    """The pages that are made at each build."""
    write_demos(HERE.parent / "demos", HERE / "demos")
    write_gallery(HERE)
    write_test_index(HERE.parent / "tests", HERE / "tests.md")


def is_alias(app, what, name, thing, skip, options):
    """Leave out the fields of named tuples of which nothing is told but their number."""
    if not str(getattr(thing, "__doc__", "")).startswith("Alias for field number"):
        return None
    here = app.env.temp_data
    told = ModuleAnalyzer.for_module(here["autodoc:module"]).find_attr_docs()
    return None if (here["autodoc:class"], name) in told else True


def setup(app):
    """Connect what is made at each build, and the docstrings' markup."""
    app.connect("builder-inited", write_pages, priority=100)
    app.connect("autodoc-process-docstring", as_restructured_text, priority=100)
    app.connect("autodoc-skip-member", is_alias)
