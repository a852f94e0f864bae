# SPDX-License-Identifier: LGPL-3.0-or-later
"""Whether each cell tag has a material, and each material what it needs."""

from __future__ import annotations

from collections.abc import Mapping

from xper_fx.materials.material import InelasticMaterial, Material
from xper_fx.support.checks import require_positive


def check_materials(
    materials: Mapping[int, Material | InelasticMaterial], present: frozenset[int]
) -> None:
    """See that cell tags and materials belong together.

    Args:
        materials: by cell tag.
        present: the cell tags that occur.

    Raises:
        ValueError: a tag without material, a tag that occurs nowhere, a density that is not
            positive.
        TypeError: something that is no material.
    """
    missing, unknown = present - set(materials), set(materials) - present
    if missing:
        raise ValueError(
            f"Cell tags {sorted(missing)} occur in the mesh and have no material; "
            f"materials are given for {sorted(materials)}."
        )
    if unknown:
        raise ValueError(
            f"Materials are given for cell tags {sorted(unknown)}, which occur nowhere; "
            f"tags that do: {sorted(present)}."
        )
    for tag, material in materials.items():
        answers = any(callable(getattr(material, name, None)) for name in ("energy", "response"))
        if isinstance(material, type):
            raise TypeError(
                f"The material of cell tag {tag} is the class {material.__name__}: give an object "
                f"of it, {material.__name__}(...)."
            )
        if not (hasattr(material, "density") and hasattr(material, "linear") and answers):
            raise TypeError(
                f"The material of cell tag {tag} is {material!r}; it needs `density`, `linear` "
                "and an `energy` or a `response` (see materials/material.py)."
            )
        inelastic = hasattr(material, "response")
        variables = getattr(material, "variables", None)
        if inelastic and (material.linear or not isinstance(variables, Mapping)):
            raise TypeError(
                f"The material of cell tag {tag} is {material!r}; with a `response` it needs "
                "`linear = False` and a mapping `variables`, empty if it has none."
            )
        if not inelastic and variables:
            raise TypeError(
                f"The material of cell tag {tag} is {material!r}; with `variables` it needs a "
                "`response`, not an `energy`."
            )
        require_positive(f"The density of the material of cell tag {tag}", material.density)
