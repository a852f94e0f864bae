# SPDX-License-Identifier: LGPL-3.0-or-later
"""Misuses of what stands beside scenes and runs: meshes, grains, friction, studies, figures."""

from __future__ import annotations

import sys
import zipfile
from functools import cache
from pathlib import Path

import h5py
import numpy as np
import scipy.sparse as sp
from dolfinx.mesh import meshtags
from misuse import INF, NAN, RIGHT, Misuse, bad_numbers
from misused_runs import _made, _text, folder, recorded, recorder, run_of
from misused_scenes import of_block, of_plate
from scenes import mesh_of

import xper_fx as xf


@cache
def square():
    """A mesh of four quadrilaterals cut into sixteen triangles."""
    return mesh_of((1, 1), (2, 2))


def everywhere(x):
    """A predicate that fits every point."""
    return np.ones(x.shape[1], bool)


def meshes() -> list[Misuse]:
    """Of meshes, tags, bodies and partitions."""
    rectangle, explode = xf.crossed_rectangle, xf.explode
    count = 16

    def cell_tags(values, mesh=None):
        mesh = square() if mesh is None else mesh
        return meshtags(
            mesh, 2, np.arange(len(values), dtype=np.int32), np.array(values, dtype=np.int32)
        )

    out = []
    for bad in (
        None,
        1.0,
        (1.0,),
        (NAN, 1.0),
        (INF, 1.0),
        ("a", "b"),
        (1.0, 1.0, 1.0),
        (0.0, 1.0),
        "ab",
    ):
        out.append(
            Misuse(
                f"crossed_rectangle(upper={bad!r})",
                "upper|corner|rectangle",
                lambda b=bad: rectangle((0.0, 0.0), b, (1, 1)),
            )
        )
    for bad in (
        None,
        3,
        (1,),
        (0, 1),
        (-1, 1),
        (1.5, 1),
        ("a", 1),
        (NAN, 1),
        (True, 1),
        (1, 1, 1),
        (10**6, 10**6),
        (10**12, 1),
    ):
        out.append(
            Misuse(
                f"crossed_rectangle(cells={bad!r})",
                "cells",
                lambda b=bad: rectangle((0, 0), (1, 1), b),
            )
        )
    for bad in (
        None,
        3,
        "each",
        "EACH_CELL",
        [0],
        [0.5] * count,
        [-1] * count,
        ["a"] * count,
        [NAN] * count,
        np.zeros((count, 2), int),
        [2**40] * count,
        {},
    ):
        good = isinstance(bad, list) and bad[0] == 2**40
        out.append(
            Misuse(
                f"explode(bodies={str(bad)[:40]})",
                "bodies",
                lambda b=bad, g=good: _right_if(explode(square(), b), g),
            )
        )
    for bad in (
        3,
        [1] * count,
        "tags",
        cell_tags([1] * 5),
        cell_tags([1] * count, mesh_of((1, 1), (2, 2))),
    ):
        out.append(
            Misuse(
                f"explode(cell_tags={type(bad).__name__})",
                "cell_tags",
                lambda b=bad: explode(square(), cell_tags=b),
            )
        )
        out.append(
            Misuse(
                f"explode(facet_tags={type(bad).__name__})",
                "facet_tags",
                lambda b=bad: explode(square(), facet_tags=b),
            )
        )
    for bad in (
        1.0,
        (1.0,),
        (1.0, 1.0, 1.0),
        (NAN, 1.0),
        (0.0, 1.0),
        (-1.0, 1.0),
        (2.0, 1.0),
        "ab",
        ("a", "b"),
        [[1.0, 0.0]],
        [[1.0, 0.0], [2.0, 0.0]],
    ):
        out.append(
            Misuse(
                f"explode(lattice={bad!r})",
                "lattice|period|translate",
                lambda b=bad: _right_if(explode(square(), lattice=b), b == (-1.0, 1.0)),
            )
        )
    for bad in (None, 0, 17, -1, 2.0, "2", NAN, True, 10**9):
        out.append(
            Misuse(f"partition(count={bad!r})", "count", lambda b=bad: xf.partition(square(), b))
        )
    out += bad_numbers(
        "partition", lambda imbalance: xf.partition(square(), 3, imbalance), {"imbalance": 1.2}
    )
    for bad in (
        None,
        3,
        (0, 0, 1),
        [(0, 0, 0, 1)],
        [(1, 0, 0, 1)],
        [(NAN, 0, 1, 1)],
        "abcd",
        [("a", 0, 1, 1)],
        [(0, 0, 1, 1, 5)],
    ):
        out.append(
            Misuse(f"in_rectangles({bad!r})", "rectangle", lambda b=bad: xf.in_rectangles(b))
        )
    for name, tag in (("tag_cells", xf.tag_cells), ("tag_facets", xf.tag_facets)):
        for words, predicates in (
            ("predicates & None", None),
            ("predicates & 3", 3),
            ("predicate & function", {1: 3}),
            ("predicate & function", {1: None}),
            ("tag & one", {"one": everywhere}),
            ("tag & 1.5", {1.5: everywhere}),
            ("tag & 32 bits", {2**40: everywhere}),
            ("tag & True", {True: everywhere}),
            ("predicate & bool", {7: lambda x: x[0]}),
            ("predicate & shape", {7: lambda x: np.array([True])}),
            ("predicate & bool", {7: lambda x: None}),
            ("claim", {7: everywhere, 8: everywhere}),
            ("claims no", {7: lambda x: ~everywhere(x)}),
            ("predicates & list|mapping", [everywhere]),
            ("tag 7 & point", {7: lambda: True}),
            ("tag 7", {7: lambda x: x[5] > 0}),
        ):
            out.append(
                Misuse(
                    f"{name}({list(predicates) if isinstance(predicates, dict) else predicates})",
                    words,
                    lambda t=tag, p=predicates: t(square(), p),
                )
            )
        out.append(Misuse(f"{name} of no mesh", "mesh & None", lambda t=tag: t(None, {})))
    cases = {
        "a default tag that is no tag": (
            "tag & 1.5",
            lambda: xf.tag_cells(square(), {}, default=1.5),
        ),
        "a body of no mesh": ("mesh & NoneType", lambda: explode(None)),
        "bodies exploded twice": ("mesh & Bodies", lambda: explode(explode(square()))),
        "voids without a lattice": ("voids & lattice", lambda: explode(square(), voids=[7])),
        "voids that nothing bears": (
            "voids & 7",
            lambda: explode(square(), lattice=(1, 1), voids=[7]),
        ),
        "voids of a number": ("voids & 7", lambda: explode(square(), lattice=(1, 1), voids=7)),
        "joining nothing": ("at least one", lambda: xf.join_meshes([])),
        "joining a mesh": ("", lambda: _right_if(xf.join_meshes(square()), True)),
        "joining None": ("mesh & NoneType", lambda: xf.join_meshes([None])),
        "joining two kinds": (
            "kind",
            lambda: xf.join_meshes([square(), mesh_of((1, 1), (1, 1), "quadrilateral")]),
        ),
        "joining with a tag short": (
            "cell_tags & 1 entries",
            lambda: xf.join_meshes([square(), square()], [None]),
        ),
        "joining with tags of a number": ("cell_tags", lambda: xf.join_meshes([square()], [3])),
        "joining with tags of none": ("facet_tags", lambda: xf.join_meshes([square()], None, 3)),
        "a gmsh file that is not there": ("no file", lambda: xf.read_gmsh("nowhere.msh", 2)),
        "a gmsh file of words": (
            "Gmsh",
            lambda: xf.read_gmsh(_text("no mesh").rename(folder().with_suffix(".msh")), 2),
        ),
        "a gmsh mesh in 4D": ("dim & 4", lambda: xf.read_gmsh("nowhere.msh", 4)),
        "a gmsh mesh of None": ("model|path & None", lambda: xf.read_gmsh(None, 2)),
        "a gmsh mesh of a number": ("model|path & 3", lambda: xf.read_gmsh(3, 2)),
        "a cell of no kind": (
            "cell & heptagon",
            lambda: xf.meshes.cell_measure("heptagon", np.zeros((1, 3, 3))),
        ),
        "check of no mesh": ("mesh", lambda: xf.meshes.check_mesh(3)),
        "partition of no mesh": ("mesh", lambda: xf.partition(None, 2)),
        "a kernel that is no function": ("function & 3", lambda: xf.njit(3)),
        "a run of no function": ("function & None", lambda: xf.run_together(None)),
        "a run of what main gives": ("function & 3", lambda: xf.run_together(3)),
    }
    return out + [Misuse(name, *case) for name, case in cases.items()]


def _right_if(made, right):
    return RIGHT if right else None


def grains() -> list[Misuse]:
    """Of microstructures."""
    m = xf.microstructure

    @cache
    def tessellation():
        return m.tessellate(m.random_seeds(4, (1.0, 1.0), 1), (1.0, 1.0))

    out = []
    good = {"count": 4, "periods": (1.0, 1.0), "seed": 1, "relaxation": 2}
    for name in ("count", "seed", "relaxation"):
        for bad in (None, -1, 1.5, "1", NAN, True, [1], 10**9):
            if name == "seed" and bad == 10**9:
                continue
            out.append(
                Misuse(
                    f"random_seeds({name}={bad!r})",
                    name,
                    lambda a=good | {name: bad}: m.random_seeds(**a),
                )
            )
    for bad in (None, 1.0, (1.0,), (1.0, 0.0), (1.0, -1.0), (NAN, 1.0), ("a", "b"), (1,) * 4, "ab"):
        out.append(
            Misuse(
                f"random_seeds(periods={bad!r})",
                "periods",
                lambda a=good | {"periods": bad}: m.random_seeds(**a),
            )
        )
    for bad in (
        None,
        3,
        [],
        [(0.1, 0.2, 0.3)],
        [(NAN, 0.1)],
        [("a", "b")],
        [(0.1, 0.1)] * 2,
        [(0.1,)],
        "ab",
        [(5.0, 5.0), (0.1, 0.2)],
    ):
        right = isinstance(bad, list) and bad and bad[0] == (5.0, 5.0)
        out.append(
            Misuse(
                f"tessellate(seeds={bad!r})",
                "seed",
                lambda b=bad, r=right: _right_if(m.tessellate(b, (1.0, 1.0)), r),
            )
        )
    for bad in (3, (1.0,), (NAN,) * 4, ("a",) * 4, (1e9, 0, 0, 0)):
        out.append(
            Misuse(
                f"tessellate(weights={bad!r})",
                "weight",
                lambda b=bad: m.tessellate(tessellation().seeds, (1, 1), b),
            )
        )
    for bad in (None, 0.0, -1.0, NAN, INF, "1", [1.0], 1e-9, 1e-30, 1j):
        out.append(
            Misuse(
                f"mesh_tessellation(size={bad!r})",
                "size",
                lambda b=bad: m.mesh_tessellation(tessellation(), b),
            )
        )
    for bad in (3, (1, 2), (1.5,) * 4, ("a",) * 4, (2**40,) * 4, (NAN,) * 4):
        out.append(
            Misuse(
                f"mesh_tessellation(phase={bad!r})",
                "phase",
                lambda b=bad: m.mesh_tessellation(tessellation(), 0.3, b),
            )
        )
    for bad in (None, -1.0, NAN, INF, "1", [1.0], 10.0):
        out.append(
            Misuse(
                f"lengthen_short_edges(length={bad!r})",
                "length|edge",
                lambda b=bad: m.lengthen_short_edges(tessellation(), b),
            )
        )
    for bad in (None, -1, 1.5, "1"):
        out.append(
            Misuse(
                f"lengthen_short_edges(max_steps={bad!r})",
                "max_steps",
                lambda b=bad: m.lengthen_short_edges(tessellation(), 0.0, b),
            )
        )
    for bad in (None, 3, (0.1,), (NAN, 0.1), ("a", "b"), (0, 0, 0)):
        out.append(
            Misuse(
                f"nearest_grains(point={bad!r})",
                "point",
                lambda b=bad: m.nearest_grains(tessellation(), b, 1),
            )
        )
    for bad in (None, -1, 5, 1.5, "1", NAN):
        out.append(
            Misuse(
                f"nearest_grains(count={bad!r})",
                "count",
                lambda b=bad: m.nearest_grains(tessellation(), (0, 0), b),
            )
        )
    for name, call in (
        ("cut_by_box", lambda t: m.cut_by_box(t)),
        ("nearest_grains", lambda t: m.nearest_grains(t, (0, 0), 1)),
        ("mesh_tessellation", lambda t: m.mesh_tessellation(t, 0.3)),
        ("lengthen_short_edges", lambda t: m.lengthen_short_edges(t, 0.1)),
    ):
        out.append(
            Misuse(
                f"{name} of seeds", "Tessellation & ndarray", lambda c=call: c(tessellation().seeds)
            )
        )
    out.append(
        Misuse("grains cut twice", "already", lambda: m.cut_by_box(m.cut_by_box(tessellation())))
    )
    return out


def friction() -> list[Misuse]:
    """Of friction problems and their files."""
    problem, W, q = (
        xf.FrictionProblem,
        np.diag([1.0, 2.0, 1.0, 2.0]),
        np.array([-1.0, 0.5, -1.0, 0.5]),
    )

    def of(**changes):
        given = {"W": W, "q": q, "mu": 0.3, "dim": 2} | changes
        return problem(**given)

    def solve(dim=2, **changes):
        size = 2 * dim
        return problem(np.eye(size), np.full(size, -1.0), 0.3, dim).solve(**changes)

    out = []
    for name, values in (
        (
            "W",
            (
                None,
                3.0,
                [[1, 2]],
                np.eye(3),
                np.full((4, 4), NAN),
                np.zeros((4, 4, 4)),
                "W",
                np.eye(4, dtype=complex),
                np.triu(np.ones((4, 4))),
                -np.eye(4),
                np.eye(5),
                np.array([["a"] * 4] * 4),
                W * 1e307,
                W * 1e-320,
                sp.csr_matrix((4, 5)),
            ),
        ),
        ("q", (None, 3.0, q[:3], [NAN, 0, 0, 0], ["a"] * 4, [[1.0]] * 4, q * 1j, [INF, 0, 0, 0])),
        ("mu", (None, -0.1, NAN, [0.1] * 3, "a", [[0.1]], 1j, INF)),
        ("dim", (None, 1, 4, 2.0, "2", NAN)),
    ):
        for bad in values:
            text = " ".join(str(bad).split())[:40]
            out.append(
                Misuse(
                    f"FrictionProblem({name}={text})",
                    f"{name}|contact|float",
                    lambda a={name: bad}: of(**a).solve(),
                )
            )
    for name, values in (
        ("solver", (None, "newtn", 3, [])),
        ("local_solver", (None, "exct", 3)),
        ("tolerance", (None, 0.0, -1.0, 1.0, NAN, "a", 1j)),
        ("max_sweeps", (None, 0, -1, 1.5, "a")),
        ("relaxation", (None, 0.0, 2.0, NAN, "a")),
        ("order", (None, "sorted", 3)),
        (
            "guess",
            (3.0, np.zeros(3), np.zeros((2, 2)), [NAN] * 4, "a", ["a"] * 4, np.zeros(4) * 1j),
        ),
        ("facets", (0, -1, 1.5, "a", 10**9)),
        ("symmetric", ("no", None, 3)),
    ):
        for bad in values:
            dim, more = (3, {"local_solver": "lcp"}) if name == "facets" else (2, {})
            more |= {"solver": "nlgs"} if name in ("relaxation", "symmetric", "order") else {}
            out.append(
                Misuse(
                    f"solve({name}={bad!r})",
                    name,
                    lambda d=dim, a=more | {name: bad}: solve(d, **a),
                )
            )

    def path(suffix=".npz"):
        where = _made(folder()) / f"problem{suffix}"
        of().write(where)
        return where

    def damaged(change, suffix):
        where = path(suffix)
        change(where)
        return problem.read(where)

    def of_fclib(name, **how):
        def change(where):
            with h5py.File(where, "a") as file:
                del file[f"fclib_local/{name}"]
                file["fclib_local"].create_dataset(name, **how)

        return lambda: damaged(change, ".hdf5")

    def linked(link):
        def change(where):
            other = where.with_name("other.h5")
            with h5py.File(other, "w") as file:
                file["q"] = q
            with h5py.File(where, "a") as file:
                del file["fclib_local/vectors/q"]
                file["fclib_local/vectors/q"] = link(other)

        return lambda: damaged(change, ".hdf5")

    def huge_npz(where):
        with zipfile.ZipFile(where) as archive:
            parts = {name: archive.read(name) for name in archive.namelist()}
        parts["q.npy"] = parts["q.npy"].replace(b"(4,), } " + 8 * b" ", b"(137438953472,), } "[:16])
        with zipfile.ZipFile(where, "w") as archive:
            for name, content in parts.items():
                archive.writestr(name, content)

    cases = {
        "reading None": ("path & None", lambda: problem.read(None)),
        "reading a number": ("path & 3", lambda: problem.read(3)),
        "reading what is not there": ("nowhere.npz", lambda: problem.read("nowhere.npz")),
        "reading another suffix": (".npz", lambda: problem.read("nowhere.mat")),
        "reading a text": (
            "not a readable",
            lambda: problem.read(_text("a").rename(_made(folder()) / "a.npz")),
        ),
        "reading half a file": (
            "damaged|truncated",
            lambda: damaged(lambda p: p.write_bytes(p.read_bytes()[:100]), ".npz"),
        ),
        "reading half an HDF5 file": (
            "damaged|truncated",
            lambda: damaged(lambda p: p.write_bytes(p.read_bytes()[:900]), ".hdf5"),
        ),
        "reading a file that claims a terabyte": (
            "size|larger|declares",
            of_fclib("vectors/q", shape=(1 << 37,), dtype="f8", chunks=(1 << 16,)),
        ),
        "reading a file of compressed zeros": (
            "size|larger|declares",
            of_fclib("W/x", shape=(1 << 37,), dtype="f8", chunks=(1 << 20,), compression="gzip"),
        ),
        "reading an npz that claims a terabyte": ("q", lambda: damaged(huge_npz, ".npz")),
        "reading a file with an external link": (
            "link",
            linked(lambda p: h5py.ExternalLink(str(p), "q")),
        ),
        "reading a file with external storage": ("external", lambda: damaged(_outside, ".hdf5")),
        "writing to None": ("path & None", lambda: of().write(None)),
        "writing another suffix": (".npz", lambda: of().write(folder().with_suffix(".mat"))),
        "writing into no folder": ("No such file|folder", lambda: of().write(folder() / "a.npz")),
        "an unknown keyword": ("tol", lambda: of().solve(tol=1e-8)),
        "errors of another shape": ("reaction & shape", lambda: of().errors(np.zeros(3))),
        "errors of None": ("reaction & None", lambda: of().errors(None)),
        "errors of words": ("reaction", lambda: of().errors(["a"] * 4)),
        "a problem changed after its checks": ("read-only|setter", lambda: _changed_problem(of())),
        "a lcp with coupled blocks": ("local_solver|facets", lambda: solve(2, facets=8)),
    }
    return out + [Misuse(name, *case) for name, case in cases.items()]


def _changed_problem(problem):
    """The arrays of a problem are its own, and fixed."""
    try:
        problem.W.data[:] = 0.0
    except ValueError:
        return RIGHT


def _outside(where: Path):
    values = where.with_name("outside.bin")
    values.write_bytes(np.array([-1.0, 0.5, -1.0, 0.5]).tobytes())
    with h5py.File(where, "a") as file:
        del file["fclib_local/vectors/q"]
        file["fclib_local/vectors"].create_dataset(
            "q", shape=(4,), dtype="f8", external=[(str(values), 0, 32)]
        )


def build(cells=2, speed=0.0):
    """A scene, as a study takes one."""
    return of_block()


# as a study wants it: found again by its module's name
sys.modules.setdefault("misused_tools", sys.modules[__name__])


def studies() -> list[Misuse]:
    """Of studies and prices."""
    study, q, s = xf.Study, xf.quantities, xf.study

    def of(**changes):
        given = {
            "name": "bar",
            "build": build,
            "end_time": 1e-5,
            "quantities": {"closure": q.EnergyClosure()},
            "families": {"f": [{"cells": 2}]},
        } | changes
        return study(**given)

    out = bad_numbers("Study", of, {"end_time": 1e-5})
    for name, values in (
        ("name", (None, 3, "")),
        ("build", (None, 3, "build", lambda: None, of_block())),
        (
            "quantities",
            (
                None,
                {},
                [q.EnergyClosure()],
                {"a": 3},
                {"a": q.EnergyClosure},
                {3: q.EnergyClosure()},
            ),
        ),
        (
            "families",
            (None, {}, [{"cells": 2}], {"f": []}, {"f": [3]}, {"f": {"cells": 2}}, {"f": None}),
        ),
        ("reference", (3, "finest", {"celles": 2})),
        ("check", (3, {"celles": 2})),
        ("default", (3, {"celles": 2})),
        ("known", (None, 3, {"other": 1.0}, {"closure": NAN})),
    ):
        for bad in values:
            out.append(
                Misuse(
                    f"Study({name}={str(bad)[:50]})",
                    f"{name}|celles|at least one|top level|none",
                    lambda a={name: bad}: of(**a),
                )
            )
    cases = {
        "a parameter that is none": ("celles & cells", lambda: of(families={"f": [{"celles": 2}]})),
        "a parameter of a list": ("cells & number", lambda: of(families={"f": [{"cells": [2]}]})),
        "a parameter that is NaN": ("speed & nan", lambda: of(families={"f": [{"speed": NAN}]})),
        "a step and a courant number": (
            "courant & step",
            lambda: of(families={"f": [{"courant": 0.5, "step": 0.1}]}),
        ),
        "a courant number of a word": (
            "courant & fast",
            lambda: of(families={"f": [{"courant": "fast"}]}),
        ),
        "a courant number of -1": ("courant & -1", lambda: of(families={"f": [{"courant": -1.0}]})),
        "fields of -1": ("fields & -1", lambda: of(families={"f": [{"fields": -1}]})),
        "fields of a word": ("fields & x", lambda: of(families={"f": [{"fields": "x"}]})),
        "no reference": ("reference", lambda: of(quantities={"u": q.DisplacementL2()})),
        "a run of no study": ("Study & None", lambda: s.run_study(None, folder())),
        "a run into None": ("folder & None", lambda: s.run_study(of(), None)),
        "a run with a time of days": (
            "time & seconds & days",
            lambda: s.run_study(of(), folder(), time="days"),
        ),
        "a run without patience": (
            "patience & 0",
            lambda: s.run_study(of(), folder(), patience=0.0, quiet=True),
        ),
        "a run with the patience of a word": (
            "patience & none",
            lambda: s.run_study(of(), folder(), patience="none", quiet=True),
        ),
        "varying into a number": ("values & 3", lambda: s.vary({"a": 1}, "a", 3)),
        "varying a number": ("default & 3", lambda: s.vary(3, "a", [1])),
        "varying into a word": ("values & abc", lambda: s.vary({"a": 1}, "a", "abc")),
        "a product of numbers": ("b & 3", lambda: s.product({"a": 1}, b=3)),
        "an effect of an unknown parameter": (
            "damping",
            lambda: xf.effect_prices.effects_study(
                "e",
                build,
                1.0,
                {"closure": q.EnergyClosure()},
                {"cells": 2},
                {"d": {"damping": 1.0}},
            ),
        ),
        "effects of a list": (
            "effects & mapping",
            lambda: xf.effect_prices.effects_study(
                "e", build, 1.0, {"closure": q.EnergyClosure()}, {"cells": 2}, ["d"]
            ),
        ),
        "prices of no results": ("StudyResults", lambda: xf.effect_prices.prices(None, ["d"])),
        "relative to zero": ("zero", lambda: q.relative(1.0, 0.0)),
    }
    return out + [Misuse(name, *case) for name, case in cases.items()]


def figures() -> list[Misuse]:
    """Of figures and frames."""
    p, o = xf.plotting, xf.output
    x, t = [(0, 0), (1, 0), (0, 1)], [(0, 1, 2)]
    none = np.zeros((0, 2, 2))

    def panel(**changes):
        given = {
            "points": x,
            "triangles": t,
            "material": [1],
            "displacement": np.zeros((3, 2)),
            "crack_segments": none,
            "crack_kind": [],
        } | changes
        return p.plot_cracks([p.CrackPanel(**given)])

    def energies(**changes):
        columns = xf.read_history(recorded().folder / "history.csv")
        return p.plot_energies(**({"history": columns, "against": "time"} | changes))

    def film(**changes):
        given = {
            "path": _made(folder()) / "a.gif", "simulation": run_of(), "every": 1.0,
        } | changes  # fmt: skip
        return o.Animation(**given)

    def frames(**changes):
        taken = [o.take_frame(run_of(of_plate()), np.zeros(16), "now")]
        given = {"frames": taken, "window": (0.0, 1.0, 0.0, 1.0)} | changes
        return o.plot_frames(**given)

    out = []
    for name, values in (
        ("points", (None, [], [(0,)], [(NAN, 0)] * 3, [("a", "b")] * 3)),
        (
            "triangles",
            (None, [], [(0, 1)], [(0, 1, 9)], [(0, 1, -5)], [(0.5, 1, 2)], [("a", "b", "c")]),
        ),
        ("material", (None, [], [1, 2], [NAN], ["steel"])),
        ("precrack_segments", (3, [(0, 0)], [[("a", "b"), ("c", "d")]])),
        ("length_unit", (None, "mm", ("mm", 0.0), ("mm", NAN), ("mm",), ("mm", "1"))),
    ):
        good = {"points": x, "triangles": t, "material": [1], "precrack_segments": none}
        words = {"precrack_segments": "segments", "length_unit": "unit"}.get(name, name)
        for bad in values:
            out.append(
                Misuse(
                    f"plot_microstructure({name}={bad!r})",
                    f"{words}|triangles",
                    lambda a=good | {name: bad}: p.plot_microstructure(**a),
                )
            )
    for name, values in (
        ("displacement", (None, np.zeros((2, 2)), np.full((3, 2), NAN), "a")),
        ("crack_segments", (3, np.zeros((1, 2, 2)), [[(9, 9), (8, 8)]])),
        ("crack_kind", ([5], [NAN], 3)),
    ):
        for bad in values:
            out.append(
                Misuse(
                    f"CrackPanel({name}={str(bad)[:30]!r})",
                    "displacement|segment|kind",
                    lambda a={name: bad}: panel(**a),
                )
            )
    ramp = np.linspace(0.0, 1.0, 5)
    cases = {
        "cracks of no panel": ("at least one panel", lambda: p.plot_cracks([])),
        "cracks of None": ("panel & None", lambda: p.plot_cracks(None)),
        "cracks of a list of words": ("panel & CrackPanel", lambda: p.plot_cracks(["a"])),
        "cracks magnified by NaN": (
            "magnification & nan",
            lambda: p.plot_cracks(p.CrackPanel(x, t, [1], np.zeros((3, 2)), none, []), NAN),
        ),
        "tiles of a lattice of numbers": (
            "lattice",
            lambda: p.CrackPanel(x, t, [1], np.zeros((3, 2)), none, []).tiled(1.0, np.eye(2)),
        ),
        "tiles of -1 copies": (
            "copies & -1",
            lambda: p.CrackPanel(x, t, [1], np.zeros((3, 2)), none, []).tiled(
                np.eye(2), np.eye(2), -1
            ),
        ),
        "no fragments": ("fragments", lambda: p.plot_fragments({})),
        "fragments of a list": ("sizes & mapping", lambda: p.plot_fragments([ramp, ramp])),
        "fragments without masses": ("mass & a", lambda: p.plot_fragments({"a": ramp})),
        "fragments of no size": ("diameter & 0", lambda: p.plot_fragments({"a": ([0.0], [1.0])})),
        "fragments with fewer masses": (
            "mass & shapes",
            lambda: p.plot_fragments({"a": ([1.0, 2.0], [1.0])}),
        ),
        "no curves": ("curve", lambda: p.plot_curves([])),
        "curves of None": ("curve & None", lambda: p.plot_curves(None)),
        "a curve without stress": ("curve & label", lambda: p.plot_curves([("a", ramp)])),
        "a curve of words": ("curve & numbers", lambda: p.plot_curves([("a", ["x"] * 5, ramp)])),
        "a curve of another length": ("as many", lambda: p.plot_curves([("a", ramp, ramp[:3])])),
        "a curve with a unit of zero": (
            "unit & 0",
            lambda: p.plot_curves([("a", ramp, ramp)], stress_unit=("MPa", 0.0)),
        ),
        "energies of nothing": ("lacks", lambda: p.plot_energies({})),
        "energies of a path": (
            "history & mapping|read_history",
            lambda: p.plot_energies("history.csv"),
        ),
        "energies of None": ("history & None", lambda: p.plot_energies(None)),
        "energies against a word": ("against & strain & time & x", lambda: energies(against="x")),
        "energies against None": ("against & strain & time", lambda: energies(against=None)),
        "energies of a run without steps": (
            "step",
            lambda: p.plot_energies(xf.read_history(recorded(0).folder / "history.csv")),
        ),
        "energies of an empty folder": (
            "history.csv",
            lambda: p.plot_energies(xf.read_history(_made(folder()) / "history.csv")),
        ),
        "a law of nothing": ("opening|traction", lambda: p.plot_law([], [])),
        "a law of a law": ("traction|opening", lambda: p.plot_law(ramp, xf.laws.PerfectBond())),
        "a law of words": ("opening", lambda: p.plot_law(["a"], ["b"])),
        "a law of another length": ("as many", lambda: p.plot_law(ramp, ramp[:3])),
        "a law into a file that is a folder": (
            "",
            lambda: p.plot_law(ramp, ramp, path=_made(folder()) / "a" / "b.png"),
        ),
        "a law into another format": (
            "format|suffix & xyz",
            lambda: p.plot_law(ramp, ramp, path=folder().with_suffix(".xyz")),
        ),
        "a law into a number": ("path & 3", lambda: p.plot_law(ramp, ramp, path=3)),
        "a profile of nothing": ("rows|profile", lambda: p.plot_profile([])),
        "a profile of None": ("rows|profile", lambda: p.plot_profile(None)),
        "grains of another shape": ("shape", lambda: p.plot_grains(x, t, [1, 2], [True])),
        "hard grains of another shape": (
            "hard & shape",
            lambda: p.plot_grains(x, t, [1], [True] * 3),
        ),
        "no frames": ("no frames", lambda: frames(frames=[])),
        "frames of words": ("frame & Frame", lambda: frames(frames=["a"])),
        "frames in no columns": ("columns & 0", lambda: frames(columns=0)),
        "a window of two numbers": ("window", lambda: frames(window=(0.0, 1.0))),
        "a window without width": ("window", lambda: frames(window=(1.0, 1.0, 0.0, 1.0))),
        "a window of NaN": ("window", lambda: frames(window=(NAN, 1.0, 0.0, 1.0))),
        "limits of one number": ("limits", lambda: frames(label="x", limits=1.0)),
        "a window of an animation in the plane of six numbers": (
            "window",
            lambda: film(window=(0.0, 1.0) * 3),
        ),
        "limits the wrong way": ("limits & low", lambda: frames(label="x", limits=(1.0, 0.0))),
        "a view of one angle": ("view", lambda: frames(view=30.0)),
        "chains of a word": ("chains & yes", lambda: frames(chains="yes")),
        "a frame of a recorder": (
            "Simulation & Recorder",
            lambda: o.take_frame(recorder(), np.zeros(16), "now"),
        ),
        "an unknown colour": ("colour & speed & mass", lambda: o.take_frame(run_of(), "mass")),
        "values of another length": (
            "values & 16",
            lambda: o.take_frame(run_of(), np.zeros(3), "now"),
        ),
        "values of words": ("values", lambda: o.take_frame(run_of(), ["a"] * 16, "now")),
        "a film of nothing": ("simulation & None", lambda: film(simulation=None)),
        "a film into another format": (
            ".gif & .mp4 & .avi",
            lambda: film(path=folder().with_suffix(".avi")),
        ),
        "a film into a number": ("path & 3", lambda: film(path=3)),
        "a film of no interval": ("every & 0", lambda: film(every=0.0)),
        "a film of a rate of 0": ("rate & 0", lambda: film(rate=0.0)),
        "a film of a rate of 1000": ("rate & 100", lambda: film(rate=1000.0)),
        "a film of ten pixels": ("pixels & 10", lambda: film(pixels=10)),
        "a film of speeds without limits": ("speed & limits", lambda: film(colour="speed")),
        "a film in columns": ("window & columns", lambda: film(columns=3)),
        "a film in a folder that is not there": (
            "cannot be written",
            lambda: film(path=folder() / "a" / "b" / "c.gif"),
        ),
        "a crack panel of a simulation": (
            "Recorder & Simulation",
            lambda: o.crack_panel(run_of(), o.find_cracks(run_of(), 2), "now"),
        ),
        "a crack panel of None": ("Cracks & None", lambda: o.crack_panel(recorder(), None, "now")),
        "a summary of a number": ("", lambda: RIGHT if o.without_times(3) == 3 else None),
    }
    return out + [Misuse(name, *case) for name, case in cases.items()]
