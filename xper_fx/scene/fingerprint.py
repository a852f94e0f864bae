# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a scene is, in plain words and numbers, so that two scenes can be told apart.

Objects are described by their type and public fields, long arrays by a digest, functions of time by
their values at given times, functions of positions by theirs at some places around the mesh, other
functions by their name. A mesh is described by sums over its
cells of a hash of each, which are the same in whatever order cells and bodies are held.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from xper_fx.bodies.function_values import is_function, named
from xper_fx.bodies.meshes import facet_cells, facet_geometry_nodes
from xper_fx.nscd.laws.parameters import Values
from xper_fx.support.compat import geometry_dofmap

if TYPE_CHECKING:
    from dolfinx.fem import Function

    from xper_fx.bodies.explode import Bodies
    from xper_fx.scene.scene import Scene
    from xper_fx.support.ranks import Ranks

# Entries up to which an array or a list is written out.
_SHORT = 16
# Places at which functions are read: so many in the box around the mesh, with steps that share no
# multiple (shares of its sides).
_PLACES, _STRIDE = 50, np.sqrt([[2.0], [3.0], [5.0]])
# Fields of a scene that are described by themselves.
_APART = ("bodies", "rigid", "rigid_bodies", "after")


class _Read(NamedTuple):
    """At which times (s) functions are read, and at which positions (m, (3, n)), if at any."""

    times: Sequence[float]
    places: np.ndarray | None
    bodies: Bodies | None
    arrays: list[dict]  # what is described of arrays over facets that this rank knows
    functions: list[tuple[dict, int]]  # likewise of DOLFINx functions, and of whose meshes


def fingerprint(scene: Scene, times: Sequence[float], **more: Any) -> dict:
    """Describe a scene.

    Args:
        scene: the scene; where its mesh is spread over ranks, all of them call it together.
        times: at which functions of time are read (s).
        more: what else to describe, by name.

    Returns:
        Nested dictionaries and lists of what JSON has.
    """
    read = _Read(times, _places(scene.bodies), scene.bodies, [], [])
    out = {f.name: _described(getattr(scene, f.name), read) for f in fields(scene)
           if f.name not in _APART}  # fmt: skip
    if scene.bodies is not None:
        out["mesh"] = _mesh(scene.bodies)
    if scene.rigid_bodies is not None:
        out["rigid bodies"] = _described(scene.rigid_bodies, read)
    out |= {name: _described(value, read) for name, value in more.items()}
    if scene.bodies is not None and scene.bodies.spread is not None:
        _add_up(read.arrays, scene.bodies.spread.ranks)
        _forget_parts(read.functions, scene.bodies.spread.ranks)
    return json.loads(json.dumps(out))


def differences(saved: Any, here: Any, where: str = "") -> list[str]:
    """Say where two descriptions differ, each as "where: the one, here the other"."""
    if isinstance(saved, dict) and isinstance(here, dict):
        out = []
        for name in saved | here:
            place = f"{where}.{name}" if where else name
            out += differences(saved.get(name), here.get(name), place)
        return out
    if isinstance(saved, list) and isinstance(here, list) and len(saved) == len(here):
        pairs = enumerate(zip(saved, here, strict=True))
        return [line for i, (a, b) in pairs for line in differences(a, b, f"{where}[{i}]")]
    return [] if saved == here else [f"{where}: {_short(saved)}, here {_short(here)}"]


def _short(value: Any) -> str:
    text = "nothing" if value is None else json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _described(value: Any, read: _Read, within: tuple[int, ...] = ()) -> Any:
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value if value == value else "nan"
    if id(value) in within:
        return "itself"
    within = (*within, id(value))
    if isinstance(value, np.ndarray):
        if value.size <= _SHORT and value.dtype != object:
            return value.tolist()
        return f"{value.shape} {_digest(np.ascontiguousarray(value).tobytes())}"
    if hasattr(value, "py_func"):
        return {"kernel": _content(value)}
    if isinstance(value, Mapping):
        return {str(key): _described(item, read, within) for key, item in value.items()}
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return _described(value._asdict(), read, within)
    if isinstance(value, Sequence):
        items = [_described(item, read, within) for item in value]
        return items if len(items) <= _SHORT else f"{len(items)} {_digest(json.dumps(items))}"
    if isinstance(value, Values) and read.bodies is not None and read.bodies.spread is not None:
        read.arrays.append({"type": "Values", "values": _share(value.values, read.bodies)})
        return read.arrays[-1]
    if is_function(value):
        return _of_dolfinx(value, read)
    own = {f.name for f in fields(value)} if is_dataclass(value) else getattr(value, "__dict__", {})
    out = {
        name: _described(getattr(value, name), read, within)
        for name in sorted(own)
        if not name.startswith("_")
    }
    if callable(value):
        return out | _function(value, read)
    return {"type": type(value).__name__, **out}


def _content(kernel: Any) -> str:
    """Digest of what a kernel computes, whether it is compiled yet or not; its name if unknown."""
    from xper_fx.cache.content import UnknownContentError, digest

    try:
        return digest(kernel)
    except UnknownContentError:
        return kernel.py_func.__qualname__


def _function(function: Callable[..., Any], read: _Read) -> dict:
    """A function of time or of positions by its values, to 12 digits; any other by its name."""
    name = {"function": getattr(function, "__qualname__", type(function).__name__)}
    given: list[Any] = []
    for arguments in (read.times, [] if read.places is None else [read.places]):
        try:
            given = [np.asarray(function(argument), float) for argument in arguments]
        except Exception:  # noqa: BLE001 - a function of something else raises whatever it likes
            continue
        if given:
            values = [np.vectorize(lambda v: f"{v:.12g}")(value).tolist() for value in given]
            return {"values": values if len(np.ravel(values)) <= _SHORT else _digest(str(values))}
    return name


def _of_dolfinx(function: Function, read: _Read) -> dict:
    """A function of DOLFINx by its values; of a mesh that is spread each rank has its own."""
    out, mesh = {"function": type(function).__name__}, function.function_space.mesh
    if mesh.comm.size == 1:
        out["values"] = _digest(function.x.array.tobytes())
        read.functions.append((out, named(mesh)))
    return out


def _forget_parts(functions: list[tuple[dict, int]], ranks: Ranks) -> None:
    """Leave out values of functions of which each rank has a part; other scenes stay others."""
    told = ranks.comm.allgather([mesh for _, mesh in functions])
    if len(set(map(len, told))) == 1:
        for (out, _), meshes in zip(functions, zip(*told, strict=True), strict=True):
            if len(set(meshes)) > 1:
                del out["values"]


def _places(bodies: Bodies | None) -> np.ndarray | None:
    """Positions at which functions are read; none where a rank has a part of the mesh."""
    if bodies is None or bodies.spread is not None:
        return None
    x = bodies.mesh.geometry.x
    low, high = x.min(axis=0)[:, None], x.max(axis=0)[:, None]
    return low + (high - low) * (_STRIDE * np.arange(_PLACES) % 1.0)


def _mesh(bodies: Bodies) -> dict:
    mesh = bodies.mesh
    nodes = geometry_dofmap(mesh)
    x = np.ascontiguousarray(mesh.geometry.x[nodes], float)
    x = x.reshape(len(nodes), np.prod(x.shape[1:]))
    cell = bodies.parent_cell
    tag = bodies.facet_tags
    cells, local = (a[tag.indices, 0] for a in facet_cells(mesh))
    corners = np.sort(bodies.parent_vertex[facet_geometry_nodes(mesh, cells, local)], axis=1)
    labels = bodies.labels[bodies.body_of_cell]
    rows = {
        "shape": (cell, x.view(np.uint64)),
        "topology": (cell, bodies.parent_vertex[nodes]),
        "body labels": (cell, labels),
        "cell tags": (cell, bodies.material_of_cell),
        "facet tags": (corners, tag.values),
    }
    if bodies.spread is None:
        sums = {name: _sum(*columns) for name, columns in rows.items()}
    else:
        ranks = bodies.spread.ranks
        own = bodies.spread.rank_of_body[bodies.body_of_cell] == ranks.rank
        sums = {
            name: _sum(*(column[own[cells] if name == "facet tags" else own] for column in columns))
            for name, columns in rows.items()
        }
        told = ranks.comm.allgather(sums)
        sums = {name: sum(one[name] for one in told) % 2**64 for name in sums}
    num_bodies, num_cells = bodies.counts
    return {
        "cell": mesh.topology.cell_name(),
        "cells": num_cells,
        "bodies": num_bodies,
        "lattice": None if bodies.lattice is None else bodies.lattice.tolist(),
        **sums,
    }


def _share(values: np.ndarray, bodies: Bodies) -> int:
    """What this rank adds to the description of an array over facing facets, as `_mesh` does."""
    facets, spread = bodies.facets, bodies.spread
    if len(values) != len(facets):
        return 0  # refused where its points are known
    own = spread.rank_of_body[facets.bodies[:, 0]] == spread.ranks.rank
    cells = np.sort(bodies.parent_cell[facets.cells[own]], axis=1)
    return _sum(cells, np.ascontiguousarray(values[own], float).view(np.uint64))


def _add_up(arrays: list[dict], ranks: Ranks) -> None:
    """Put the sums over all ranks in the place of their shares; other scenes stay others."""
    told = ranks.comm.allgather([one["values"] for one in arrays])
    if len(set(map(len, told))) == 1:
        for one, shares in zip(arrays, zip(*told, strict=True), strict=True):
            one["values"] = sum(shares) % 2**64


def _sum(*columns: np.ndarray) -> int:
    """A sum over rows of a hash of each, the mixing of SplitMix64 (Steele et al. 2014)."""
    total = np.zeros(len(columns[0]), np.uint64)
    for column in columns:
        for part in np.reshape(column, (-1, column.shape[-1])).T if column.ndim > 1 else [column]:
            total += part.astype(np.uint64) + np.uint64(0x9E3779B97F4A7C15)
            for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
                total ^= total >> np.uint64(shift)
                total *= np.uint64(factor)
            total ^= total >> np.uint64(31)
    return int(total.sum(dtype=np.uint64))


def _digest(content: bytes | str) -> str:
    content = content.encode() if isinstance(content, str) else content
    return hashlib.blake2b(content, digest_size=8).hexdigest()
