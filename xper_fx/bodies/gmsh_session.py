# SPDX-License-Identifier: LGPL-3.0-or-later
"""A Gmsh model of one's own that leaves a user's session as it was."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from xper_fx.support.checks import require_kind, require_number

# What a user's session or configuration might have set, and what would change a mesh.
_DEFAULTS = {
    "General.Verbosity": 0,
    "General.NumThreads": 1,
    "Geometry.Tolerance": 1e-8,
    "Mesh.Algorithm": 6,  # Frontal-Delaunay
    "Mesh.Algorithm3D": 1,  # Delaunay
    "Mesh.ElementOrder": 1,
    "Mesh.MeshSizeExtendFromBoundary": 0,
    "Mesh.MeshSizeFactor": 1,
    "Mesh.MeshSizeFromCurvature": 0,
    "Mesh.MeshSizeFromParametricPoints": 0,
    "Mesh.MeshSizeFromPoints": 1,
    "Mesh.MeshSizeMax": 1e22,
    "Mesh.MeshSizeMin": 0,
    "Mesh.MaxNumThreads1D": 1,
    "Mesh.MaxNumThreads2D": 1,
    "Mesh.MaxNumThreads3D": 1,
    "Mesh.MeshOnlyEmpty": 0,
    "Mesh.MeshOnlyVisible": 0,
    "Mesh.Optimize": 1,
    "Mesh.OptimizeThreshold": 0.3,
    "Mesh.RandomFactor": 1e-9,
    "Mesh.RandomFactor3D": 1e-12,
    "Mesh.RandomSeed": 1,
    "Mesh.RecombineAll": 0,
    "Mesh.Smoothing": 1,
    "Mesh.SubdivisionAlgorithm": 0,
}


@contextmanager
def gmsh_model(name: str, options: Mapping[str, float]) -> Iterator[Any]:
    """Give the module `gmsh` with a new current model, quiet and deterministic.

    Afterwards the model is gone; in a session that was there before, the options and the current
    model are what they were, otherwise there is no session.

    Args:
        name: of the model.
        options: numbers to set beyond the default ones.

    Raises:
        ImportError: the Python module `gmsh` is missing.
        TypeError: a name that is no text, options that are no numbers by name.
        ValueError: an option that Gmsh has not.
    """
    require_kind("name", name, str)
    require_kind("options", options, Mapping)
    for option, value in options.items():
        require_number(f"The option {option!r} of Gmsh", value)
    try:
        import gmsh
    except ImportError as error:
        raise ImportError(
            "Meshes of Gmsh need the Python module `gmsh` (pip install gmsh, or the package "
            "python3-gmsh)."
        ) from error
    foreign = bool(gmsh.isInitialized())
    if not foreign:
        # or it takes SIGINT's handler away
        gmsh.initialize(readConfigFiles=False, interruptible=False)
    current = gmsh.model.getCurrent()
    wanted, before = {**_DEFAULTS, **options}, {}
    try:
        for option in wanted:
            try:
                before[option] = gmsh.option.getNumber(option)
            except Exception:  # gmsh raises bare Exception
                raise ValueError(f"Gmsh has no option {option!r} that is a number.") from None
        for option, value in wanted.items():
            gmsh.option.setNumber(option, value)
        gmsh.model.add(name)
        try:
            yield gmsh
        finally:
            gmsh.model.remove()
    finally:
        for option, value in before.items():
            gmsh.option.setNumber(option, value)
        if foreign:
            gmsh.model.setCurrent(current)
        else:
            gmsh.finalize()
