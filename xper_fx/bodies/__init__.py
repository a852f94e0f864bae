# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies from meshes: meshes and their tags, facets duplicated between bodies, surfaces."""
