# SPDX-License-Identifier: LGPL-3.0-or-later
"""Misuses of what a scene is made of: materials, laws, loads, rigid bodies, contacts, drives."""

from __future__ import annotations

import numpy as np
from misuse import INF, NAN, RIGHT, Misuse, bad_numbers

import xper_fx as xf

ELASTIC = {"young": 1e9, "poisson": 0.3, "density": 1e3}
STIFF = xf.materials.Linear(1e8)
BOND = {"normal_stiffness": 1e15, "fracture_energy": 10.0, "strength": 1e6}
AXES = {"young": (1e9, 1e9, 1e9), "poisson": (0.3, 0.3, 0.3), "shear": (4e8, 4e8, 4e8)}


def _poisson():
    return {"poisson": (0.0,)}


def materials() -> list[Misuse]:
    """Of the bulk."""
    m = xf.materials
    out = []
    for cls in (m.LinearElastic, m.NeoHookean, m.SaintVenantKirchhoff):
        out += bad_numbers(cls.__name__, cls, ELASTIC, allowed=_poisson())
    plastic = ELASTIC | {"yield_stress": 1e6}
    for cls in (m.J2SmallStrain, m.J2FiniteStrain):
        fixed = {"hardening": STIFF}
        out += bad_numbers(cls.__name__, cls, plastic, allowed=_poisson(), fixed=fixed)
        out += [
            Misuse(
                f"{cls.__name__}(hardening={bad!r})",
                "hardening",
                lambda cls=cls, bad=bad: cls(**plastic, hardening=bad),
            )
            for bad in (1e8, None, m.Linear, "linear")
        ]
    out += bad_numbers("Linear", m.Linear, {"modulus": 1e8}, allowed={"modulus": (0.0,)})
    out += bad_numbers(
        "Voce",
        m.Voce,
        {"saturation": 1e8, "rate": 10.0, "modulus": 0.0},
        allowed={"modulus": (0.0,)},
    )
    cubic = {"c11": 2e9, "c12": 1e9, "c44": 1e9, "density": 1e3, "rotation": 0.0}
    allowed = {"rotation": (0.0, -1.0), "c12": (0.0, -1.0)}
    out += bad_numbers("Cubic", m.Cubic, cubic, allowed=allowed)
    out += bad_numbers("Orthotropic", m.Orthotropic, {"density": 1e3}, fixed=AXES)
    for name in AXES:
        for bad in (1e9, (1e9, 1e9), (NAN, 1e9, 1e9), ("a", "b", "c"), None, (-1.0, 1.0, 1.0)):
            out.append(
                Misuse(
                    f"Orthotropic({name}={bad!r})",
                    name,
                    lambda a={**AXES, "density": 1e3, name: bad}: m.Orthotropic(**a),
                )
            )
    out += [
        Misuse(
            f"Cubic(rotation={bad!r})", "rotation", lambda bad=bad: m.Cubic(2e9, 1e9, 1e9, 1e3, bad)
        )
        for bad in ("45", [[1, 0], [0, 1]], np.diag([1.0, 1.0, 2.0]), np.full((3, 3), NAN))
    ]
    prony = {"prony": [(0.5, 1.0)]}
    out += bad_numbers(
        "LinearViscoelastic", m.LinearViscoelastic, ELASTIC, allowed=_poisson(), fixed=prony
    )
    for bad in (
        None,
        0.5,
        [0.5],
        [(0.5,)],
        [(NAN, 1.0)],
        [(0.5, 0.0)],
        [(0.7, 1.0), (0.7, 2.0)],
        [(-0.1, 1.0)],
        "ab",
        [("a", 1.0)],
        [],
    ):
        out.append(
            Misuse(
                f"LinearViscoelastic(prony={bad!r})",
                "prony|term|share|relaxation",
                lambda bad=bad: m.LinearViscoelastic(**ELASTIC, prony=bad),
            )
        )
    out += [
        Misuse(
            "a poisson of an incompressible solid",
            "poisson & 0.5",
            lambda: m.LinearElastic(1e9, 0.5, 1e3),
        ),
        Misuse(
            "a plane that does not exist",
            "plane & strain & stress & sprain",
            lambda: m.LinearElastic(1e9, 0.3, 1e3, plane="sprain"),
        ),
        Misuse(
            "an unknown keyword of a material",
            "yung",
            lambda: m.LinearElastic(yung=1e9, poisson=0.3, density=1.0),
        ),
        Misuse("a material without density", "density", lambda: m.LinearElastic(1e9, 0.3)),
        Misuse("a material that does not exist", "LinearElstic", lambda: m.LinearElstic),
        Misuse("a namespace that does not exist", "lawz", lambda: xf.lawz),
        Misuse(
            "a material changed after it was made",
            "young|assign",
            lambda: setattr(m.LinearElastic(1e9, 0.3, 1e3), "young", -1.0),
        ),
    ]
    return out


def laws() -> list[Misuse]:
    """Of interactions."""
    law = xf.laws
    friction = {"friction": (0.0,), "restitution": (0.0,)}
    out = bad_numbers("CohesiveZone", law.CohesiveZone, BOND)
    out += bad_numbers(
        "CohesiveZone",
        law.CohesiveZone,
        {"tangential_stiffness": 1e15, "friction": 0.1},
        allowed={"tangential_stiffness": (None,), **friction},
        fixed=BOND,
    )
    out += bad_numbers("CohesiveZone", law.CohesiveZone, {"initial_damage": 1.0}, fixed=BOND)
    viscous = {"viscosity": 1e-3}
    out += bad_numbers(
        "CohesiveZone", law.CohesiveZone, viscous, allowed={"viscosity": (0.0,)}, fixed=BOND
    )
    out += bad_numbers(
        "Adhesion",
        law.Adhesion,
        {"normal_stiffness": 1e12, "adhesion_energy": 50.0, **viscous, "friction": 0.3},
        allowed={"viscosity": (0.0,), **friction},
    )
    out += bad_numbers(
        "DuctileZone",
        law.DuctileZone,
        {"normal_stiffness": 1e16, "yield_stress": 4e8, "porosity": 2e-3, "thickness": 5e-5,
         "triaxiality": 2.0},
    )  # fmt: skip
    out += bad_numbers(
        "SignoriniCoulomb",
        law.SignoriniCoulomb,
        {"friction": 0.1, "restitution": 0.0},
        allowed=friction,
    )
    out += bad_numbers(
        "Tresca",
        law.Tresca,
        {"bound": 0.1, "restitution": 0.0},
        allowed={"bound": (0.0,), **friction},
    )
    out += [
        Misuse(
            "a fracture energy below the elastic one",
            "fracture_energy & exceed",
            lambda: law.CohesiveZone(100.0, 0.5, 10.0),
        ),
        Misuse(
            "a damage word",
            "damage & auto & later",
            lambda: law.CohesiveZone(**BOND, damage="later"),
        ),
        Misuse(
            "a contact word",
            "contact & velocity & position & penalty",
            lambda: law.SignoriniCoulomb(contact="penalty"),
        ),
        Misuse(
            "a contact word of Tresca",
            "contact & velocity & None",
            lambda: law.Tresca(1.0, contact=None),
        ),
        Misuse(
            "a restitution above one",
            "restitution & 1.5",
            lambda: law.SignoriniCoulomb(restitution=1.5),
        ),
        Misuse(
            "an initial damage above one",
            "initial_damage & 2",
            lambda: law.CohesiveZone(**BOND, initial_damage=2.0),
        ),
        Misuse(
            "a porosity at which voids have joined",
            "porosity & 0.15 & 0.3",
            lambda: law.DuctileZone(
                1e16, yield_stress=4e8, porosity=0.3, thickness=5e-5, triaxiality=2.0
            ),
        ),
        Misuse(
            "a negative viscosity of an initially rigid bond",
            "viscosity",
            lambda: law.RigidCohesiveZone(1e6, 10.0, viscosity=-1e-3),
        ),
        Misuse("an unknown keyword of a law", "mu", lambda: law.SignoriniCoulomb(mu=0.3)),
        Misuse("an argument of a law without any", "", lambda: law.PerfectBond(0.3)),
    ]
    return out


def rigid_bodies() -> list[Misuse]:
    """Rigid bodies, their shapes and walls."""
    r = xf.rigid

    def body(shape=None, position=(0.0, 0.0), group="a", **options):
        options.setdefault("density", 1e3)
        shape = r.Disc(1.0) if shape is None else shape
        given = {k: v for k, v in options.items() if v is not Ellipsis}
        return r.RigidBodies([xf.RigidBody(shape, position, group, **given)])

    out = bad_numbers("Disc", r.Disc, {"radius": 1.0})
    out += bad_numbers("Sphere", r.Sphere, {"radius": 1.0})
    out += bad_numbers("RigidBody", body, {"density": 1.0}, allowed={"density": (None,)})
    out += bad_numbers(
        "RigidBody", body, {"mass": 1.0}, fixed={"density": None}, allowed={"mass": (None,)}
    )
    out += bad_numbers(
        "RigidBody",
        body,
        {"inertia": 1.0},
        fixed={"density": None, "mass": 1.0},
        allowed={"inertia": (None,)},
    )
    anything = (0.0, -1.0, None)
    out += bad_numbers(
        "RigidBody",
        body,
        {"angle": 0.0, "spin": 0.0, "torque": 0.0},
        allowed={"angle": anything, "spin": anything, "torque": anything},
    )
    for name in ("position", "velocity", "force"):
        for bad in ((0.0, NAN), (0.0, 0.0, 0.0), 1.0, "00", ("a", "b"), (INF, 0.0), [[0.0, 0.0]]):
            out.append(Misuse(f"RigidBody({name}={bad!r})", name, lambda a={name: bad}: body(**a)))
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    for bad in (
        [],
        [(0, 0)],
        [(0, 0), (1, 0)],
        [(0, 0), (1, 0), (2, 0)],
        square[:-1] + [(NAN, 1)],
        [(0, 0, 0)] * 3,
        "abc",
        None,
        3,
        [(0, 0), (2, 0), (1, 0.2), (1, 2)],
        [*square, (0, 0)],
        [("a", "b")] * 3,
        [(0, 0), (1, 1), (1, 0), (0, 1)],
    ):
        out.append(Misuse(f"Polygon({bad!r})", "polygon|vert", lambda bad=bad: r.Polygon(bad)))
    out.append(Misuse("a polygon drawn clockwise", "clockwise|area", lambda: _clockwise(square)))
    corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    for vertices, loops, why in (
        (corners, faces[:3], "an open surface"),
        (corners, [(0, 1, 2), *faces[1:]], "a face inward"),
        (corners, [(0, 2, 9), *faces[1:]], "an unknown corner"),
        (corners[:3], faces, "a corner short"),
        (corners, [], "no faces"),
        (corners, None, "None for faces"),
        (None, faces, "no corners"),
        (corners, [(0, 2), *faces[1:]], "a face of two"),
        ([(0, 0)] * 4, faces, "corners in 2D"),
        ([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, NAN)], faces, "a corner that is NaN"),
        ([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)], faces, "a flat one"),
    ):
        out.append(
            Misuse(
                f"Polyhedron: {why}",
                "polyhedron|face|vert|corner",
                lambda v=vertices, f=loops: r.Polyhedron(v, f),
            )
        )
    out += [
        Misuse("a mass and a density", "density or a mass", lambda: body(mass=1.0)),
        Misuse("neither mass nor density", "density & mass", lambda: body(density=None)),
        Misuse("an inertia without mass", "inertia & mass", lambda: body(inertia=1.0)),
        Misuse("a group that is a number", "group & 3", lambda: body(group=3)),
        Misuse("an empty group", "group", lambda: body(group="")),
        Misuse("a shape class", "shape & Disc", lambda: body(shape=r.Disc)),
        Misuse("a radius for a shape", "shape & 1.0", lambda: body(shape=1.0)),
        Misuse("a rotation in 2D", "angle", lambda: body(rotation=(0, 0, 0, 1))),
        Misuse("an angle in 3D", "rotation", lambda: body(r.Sphere(1.0), (0, 0, 0), angle=0.1)),
        Misuse(
            "a quaternion of zero",
            "quaternion & vanish",
            lambda: body(r.Sphere(1.0), (0, 0, 0), rotation=(0, 0, 0, 0)),
        ),
        Misuse(
            "a rotation of three numbers",
            "quaternion & shape",
            lambda: body(r.Sphere(1.0), (0, 0, 0), rotation=(0, 0, 1)),
        ),
        Misuse(
            "a spin in 3D that is a number",
            "spin & shape",
            lambda: body(r.Sphere(1.0), (0, 0, 0), spin=1.0),
        ),
        Misuse("a position in 2D of a sphere", "position & shape", lambda: body(r.Sphere(1.0))),
        Misuse(
            "an inertia that is no inertia",
            "inertia & moments",
            lambda: body(
                r.Sphere(1.0), (0, 0, 0), density=None, mass=1.0, inertia=np.diag([1.0, 1.0, 5.0])
            ),
        ),
        Misuse("a prescribed list", "prescribed & mapping", lambda: body(prescribed=[0.0])),
        Misuse("a prescribed component", "prescribed & 7", lambda: body(prescribed={7: 0.0})),
        Misuse("a prescribed NaN", "prescribed & nan", lambda: body(prescribed={0: NAN})),
        Misuse(
            "a prescribed motion of nothing",
            "prescribed & None",
            lambda: body(prescribed={0: lambda t: None}),
        ),
        Misuse(
            "a force of time with one component",
            "force & shape",
            lambda: body(force=lambda t: (1.0,)),
        ),
        Misuse("no bodies", "at least one", lambda: r.RigidBodies([])),
        Misuse("a body that is none", "RigidBody & str", lambda: r.RigidBodies(["ball"])),
        Misuse(
            "bodies of two dimensions",
            "dimension",
            lambda: r.RigidBodies(
                [
                    xf.RigidBody(r.Disc(1.0), (0, 0), "a", density=1.0),
                    xf.RigidBody(r.Sphere(1.0), (0, 0, 0), "a", density=1.0),
                ]
            ),
        ),
        Misuse("a body without position", "position", lambda: body(position=None)),
        Misuse(
            "a mass beyond the range of floats", "range of floats", lambda: body(r.Disc(1e-150))
        ),
        Misuse("a wall without normal", "normal", lambda: r.wall((0, 0), (0, 0), "floor")),
        Misuse(
            "a wall with a NaN normal", "normal & nan", lambda: r.wall((0, 0), (0, NAN), "floor")
        ),
        Misuse("a wall in 1D", "wall & 2 or 3", lambda: r.wall((0,), (1,), "floor")),
        Misuse("a wall of None", "wall", lambda: r.wall(None, (0, 1), "floor")),
        Misuse(
            "a wall of two dimensions", "normal & shape", lambda: r.wall((0, 0), (0, 0, 1), "floor")
        ),
        Misuse(
            "a wall at NaN",
            "position & nan",
            lambda: r.RigidBodies([r.wall((0, NAN), (0, 1), "floor")]),
        ),
        Misuse(
            "a wall's velocity",
            "velocity & components",
            lambda: r.wall((0, 0), (0, 1), "floor", velocity=1.0),
        ),
        Misuse(
            "a wall's velocity in 3D",
            "velocity & components",
            lambda: r.wall((0, 0), (0, 1), "floor", velocity=(0, 0, 0)),
        ),
        Misuse("a wall with a mass", "mass", lambda: body(r.HalfPlane(), density=1.0)),
        Misuse(
            "gravity of a rigid motion",
            "gravity & shape",
            lambda: r.RigidMotion(body_of(r), (0, 0, -9.81)),
        ),
        Misuse(
            "outlines of no segments",
            "segments & 0",
            lambda: r.body_outlines(body_of(r), segments=0),
        ),
        Misuse(
            "outlines of 1e9 segments",
            "segments & 1000000000",
            lambda: r.body_outlines(body_of(r), segments=10**9),
        ),
        Misuse(
            "outlines of half a segment",
            "segments & 2.5",
            lambda: r.body_outlines(body_of(r), segments=2.5),
        ),
    ]
    return out


def body_of(r):
    """One disc."""
    return r.RigidBodies([xf.RigidBody(r.Disc(1.0), (0, 0), "a", density=1.0)])


def _clockwise(square):
    """A polygon drawn the other way round is the same polygon."""
    polygon = xf.rigid.Polygon(square[::-1])
    mass = polygon.mass_properties(2.0).mass
    return RIGHT if abs(mass - 2.0) < 1e-12 else mass


def small_parts() -> list[Misuse]:
    """Loads, contacts, ties, drives, gauges, quantities and options that are objects."""
    law = xf.laws.SignoriniCoulomb()
    out = bad_numbers(
        "RayleighDamping",
        xf.RayleighDamping,
        {"mass": 1.0, "stiffness": 1.0},
        allowed={"mass": (0.0,), "stiffness": (0.0,)},
    )
    out += bad_numbers(
        "Contact",
        xf.Contact,
        {"reach": 1.0},
        allowed={"reach": (None,)},
        fixed={"between": ("a", "b"), "law": law},
    )
    opened = {"growth": 0.3, "relative": 5.0, "iterations": 6, "longest": 0.05}
    out += bad_numbers("GrowthControl", xf.GrowthControl, opened)
    spent = {"energy": 1.0, "iterations": 12, "longest": 0.05}
    out += bad_numbers("DissipationControl", xf.DissipationControl, spent)
    gauge = {"low": 1, "high": 2, "component": 0, "length": 1.0, "section": 1.0}
    free = {"component": (0.0,), "low": (-1.0, 0.0), "high": (-1.0, 0.0)}
    out += bad_numbers("TensileGauge", xf.TensileGauge, gauge, allowed=free)
    q = xf.quantities
    out += bad_numbers("CrackPattern", q.CrackPattern, {"radius": 1.0})
    out += bad_numbers("DisplacementL2", q.DisplacementL2, {"samples": 10})
    out += bad_numbers("Penetration", q.Penetration, {"length": 1.0})
    out += bad_numbers(
        "DissipatedEnergy", q.DissipatedEnergy, {"until": 1.0}, allowed={"until": (None,)}
    )
    s = xf.solvers
    out += bad_numbers(
        "SolveOptions",
        s.SolveOptions,
        {"tolerance": 1e-4, "max_sweeps": 10, "relaxation": 1.0, "num_threads": 1},
        allowed={"num_threads": (None,)},
    )
    out += [
        Misuse(
            f"CellGauge({bad!r})",
            "component & " + str(bad).replace("[", r"\["),
            lambda bad=bad: xf.CellGauge(bad),
        )
        for bad in ("1", "", "00", "14", 11, None, "xx", "111", ["1", "1"])
    ]
    out += [
        Misuse(
            "a gauge between one face", "low & high", lambda: xf.TensileGauge(1, 1, 0, 1.0, 1.0)
        ),
        Misuse(
            "a gauge of component 3", "component & 3", lambda: xf.TensileGauge(1, 2, 3, 1.0, 1.0)
        ),
        Misuse("a peak stress of no gauge", "gauge", lambda: q.PeakStress(None)),
        Misuse("a peak stress of a gauge class", "gauge", lambda: q.PeakStress(xf.CellGauge)),
        Misuse(
            "unknown terms of dissipation",
            "terms & magic",
            lambda: q.DissipatedEnergy(terms=("magic",)),
        ),
        Misuse(
            "terms of dissipation as one word",
            "terms",
            lambda: q.DissipatedEnergy(terms="dissipated_cohesion"),
        ),
        Misuse("a contact between one", "two groups", lambda: xf.Contact(("a",), law)),
        Misuse("a contact between a word", "two groups", lambda: xf.Contact("ab", law)),
        Misuse("a contact between numbers", "two groups", lambda: xf.Contact((1, 2), law)),
        Misuse(
            "a contact's law that is a number", "law & 0.3", lambda: xf.Contact(("a", "b"), 0.3)
        ),
        Misuse(
            "a contact's law that is a class",
            "law & SignoriniCoulomb",
            lambda: xf.Contact(("a", "b"), xf.laws.SignoriniCoulomb),
        ),
        Misuse("a tie of one surface", "candidates & antagonists", lambda: xf.Tie(1, 1, law)),
        Misuse("a tie of no tag", "candidates & None", lambda: xf.Tie(None, 1, law)),
        Misuse(
            "a tie by a word",
            "rule & mortar & nodes & glue",
            lambda: xf.Tie(1, 2, law, rule="glue"),
        ),
        Misuse("a tie by a list", "rule", lambda: xf.Tie(1, 2, law, rule=["mortar"])),
        Misuse(
            "a tie's law that is a class",
            "law & PerfectBond",
            lambda: xf.Tie(1, 2, xf.laws.PerfectBond),
        ),
        Misuse("a tie's law that is None", "law & None", lambda: xf.Tie(1, 2, None)),
        Misuse("a drive of a component 44", "44", lambda: xf.MacroscopicDrive({"44": 1.0})),
        Misuse("a drive of a number", "component & 11", lambda: xf.MacroscopicDrive({11: 1.0})),
        Misuse("a drive of a list", "gradient & mapping", lambda: xf.MacroscopicDrive([1.0])),
        Misuse(
            "a drive twice",
            "11 & more than once",
            lambda: xf.MacroscopicDrive({"11": 1.0}, {"11": 1.0}),
        ),
        Misuse(
            "a coarse space that is a number",
            "coarse_space & 3",
            lambda: s.BondedGradients(coarse_space=3),
        ),
    ]
    return out
