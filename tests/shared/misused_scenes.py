# SPDX-License-Identifier: LGPL-3.0-or-later
"""Misuses of scenes: what does not fit together, and what hardly can be meant."""

from __future__ import annotations

from functools import cache

import numpy as np
import ufl
from misuse import INF, NAN, NUMBERS, RIGHT, Misuse
from scenes import BOTTOM, LEFT, TOP, box_bodies, mesh_of
from scenes import RIGHT as RIGHT_SIDE

import xper_fx as xf

SOLID = xf.materials.LinearElastic(1e9, 0.3, 1e3)
BOND = xf.laws.PerfectBond()
TOUCH = xf.laws.SignoriniCoulomb(0.1)
NOTCH, INSIDE = 9, 10
STILL = {"11": 1.0, "12": 0.0, "21": 0.0, "22": 1.0}


@cache
def plate():
    """Each cell a body, of two materials; a tagged line of facets between bodies."""
    return box_bodies(
        (2, 2),
        (2, 2),
        material={2: lambda x: x[0] > 1.0},
        interior={NOTCH: lambda x: (np.abs(x[0] - 1) < 1e-9) & (x[1] < 1 + 1e-9)},
    )


@cache
def block():
    """One body, a tagged line of facets inside."""
    return box_bodies(
        (1, 1), (2, 2), label=0, interior={INSIDE: lambda x: np.abs(x[0] - 0.5) < 1e-9}
    )


@cache
def box():
    """A body of tetrahedra."""
    return box_bodies((1, 1, 1), (1, 1, 1), "tetrahedron", label=0)


@cache
def cell():
    """A periodic cell."""
    return xf.explode(mesh_of((1, 1), (2, 2)), lattice=(1.0, 1.0))


def of_ufl():
    """What UFL computes with, a vector."""
    return ufl.SpatialCoordinate(plate().mesh)


def of_plate(**changes):
    """A scene of `plate` that is right but for the changes."""
    given = {"materials": {1: SOLID, 2: SOLID}, "default_interaction": BOND} | changes
    return xf.Scene(plate(), **given)


def of_block(**changes):
    """A scene of `block`."""
    return xf.Scene(block(), **({"materials": {1: SOLID}} | changes))


def of_cell(drive=None, **changes):
    """A scene of `cell`."""
    given = {"materials": {1: SOLID}, "default_interaction": BOND} | changes
    drive = xf.MacroscopicDrive(gradient=STILL) if drive is None else drive
    return xf.Scene(cell(), macroscopic=drive, **given)


def disc(position=(0.0, 0.0), group="discs", **options):
    """A disc of radius 1."""
    return xf.RigidBody(xf.rigid.Disc(1.0), position, group, density=1e3, **options)


def of_discs(*bodies, pairs=(("discs", "discs"),), law=TOUCH, **changes):
    """A scene of rigid bodies."""
    contacts = [xf.Contact(pair, law) for pair in pairs]
    return xf.Scene(rigid=list(bodies), contacts=contacts, **changes)


def _two_boxes():
    """Squares of shapes of their own, in one place."""
    boxes = [
        xf.RigidBody(xf.rigid.Polygon.box((1.0, 1.0)), (0.0, 0.0), "boxes", density=1e3)
        for _ in range(2)
    ]
    return of_discs(*boxes, pairs=[("boxes", "boxes")])


def steps_of(scene, count=1, **options):
    """Some steps of a scene."""
    simulation = xf.Simulation(scene, **({"step": 1e-5, "num_threads": 1} | options))
    return list(simulation.steps(count * simulation.step_size))


def run_of_plate(**changes):
    """A simulation of `plate` before its first step."""
    return xf.Simulation(of_plate(**changes), 1e-5, num_threads=1)


def near_block(height):
    """A disc of radius 0.3 above or in `block`, which is 1 m high."""
    ball = xf.RigidBody(xf.rigid.Disc(0.3), (0.5, height), "ball", density=1e3)
    return of_block(
        surfaces={"block": (1,)}, rigid=[ball], contacts=[xf.Contact(("block", "ball"), TOUCH)]
    )


def blocks(height):
    """A block above or in another one, which is 1 m high."""
    lower, upper = mesh_of((1, 1), (2, 2)), mesh_of((1, 1), (2, 2))
    upper.geometry.x[:, :2] += (0.05, height)
    tags = [xf.tag_cells(lower, {}, 1), xf.tag_cells(upper, {}, 2)]
    joined = xf.join_meshes([lower, upper], tags)
    return xf.Scene(
        xf.explode(joined.mesh, joined.part, joined.cell_tags),
        {1: SOLID, 2: SOLID},
        surfaces={"lower": (1,), "upper": (2,)},
        contacts=[xf.Contact(("lower", "upper"), TOUCH)],
    )


class NoKernels:
    """A law that says nothing."""

    def kernels(self, dim):
        return None

    def parameters(self):
        return ()

    def initial_state(self):
        return ()


class HalfALaw(NoKernels):
    """A law whose kernels fail."""

    def kernels(self, dim):
        return (1, 2, 3)


def scenes() -> list[Misuse]:
    """Of bodies, materials, laws and tags."""

    def material(**of):
        return type("Own", (), of)()

    cases = {
        "no bodies": ("exploded mesh, rigid bodies", lambda: xf.Scene()),
        "a mesh for bodies": ("explode", lambda: xf.Scene(mesh_of((1, 1), (1, 1)), {1: SOLID})),
        "None for materials": ("materials & mapping & None", lambda: of_plate(materials=None)),
        "a material for materials": ("materials & mapping", lambda: of_plate(materials=SOLID)),
        "a tag without material": (r"\[2\] & no material", lambda: of_plate(materials={1: SOLID})),
        "a material class": (
            "tag 2 & class|instance",
            lambda: of_plate(materials={1: SOLID, 2: xf.materials.LinearElastic}),
        ),
        "a material of a word": (
            "tag 2 & steel",
            lambda: of_plate(materials={1: SOLID, 2: "steel"}),
        ),
        "a material that is None": (
            "tag 2 & None",
            lambda: of_plate(materials={1: SOLID, 2: None}),
        ),
        "a material tag that occurs nowhere": (
            r"\[5\] & nowhere",
            lambda: of_plate(materials={1: SOLID, 2: SOLID, 5: SOLID}),
        ),
        "a material tag of a word": (
            "materials & matrix",
            lambda: of_plate(materials={"matrix": SOLID, 2: SOLID}),
        ),
        "a material of one's own without density": (
            "density",
            lambda: of_plate(materials={1: SOLID, 2: material(linear=True, energy=lambda u: 0)}),
        ),
        "a material of one's own with a density of 0": (
            "density & 0",
            lambda: of_plate(
                materials={1: SOLID, 2: material(linear=True, energy=lambda u: 0, density=0.0)}
            ),
        ),
        "a material whose energy is None": (
            "tag 2 & energy & None",
            lambda: steps_of(
                of_plate(
                    materials={
                        1: SOLID,
                        2: material(linear=True, energy=lambda *a: None, density=1.0),
                    }
                )
            ),
        ),
        "a material whose energy is no energy": (
            "tag 2 & energy",
            lambda: steps_of(
                of_plate(
                    materials={
                        1: SOLID,
                        2: material(linear=True, energy=lambda *a: "E", density=1.0),
                    }
                )
            ),
        ),
        "a material whose energy cannot be called": (
            "tag 2 & energy",
            lambda: steps_of(
                of_plate(materials={1: SOLID, 2: material(linear=True, energy=3.0, density=1.0)})
            ),
        ),
        "no law": (r"\(1, 1\) & default_interaction", lambda: of_plate(default_interaction=None)),
        "a law class": (
            "PerfectBond & class|instance",
            lambda: of_plate(default_interaction=xf.laws.PerfectBond),
        ),
        "a law class with parameters": (
            "CohesiveZone & class|instance",
            lambda: of_plate(default_interaction=xf.laws.CohesiveZone),
        ),
        "a law of a word": ("glue & law", lambda: of_plate(default_interaction="glue")),
        "a law of a number": ("0.3 & law", lambda: of_plate(default_interaction=0.3)),
        "a law whose kernels are None": (
            "NoKernels & kernels & None",
            lambda: steps_of(of_plate(default_interaction=NoKernels())),
        ),
        "a law whose kernels are a tuple": (
            "HalfALaw & LawKernels",
            lambda: steps_of(of_plate(default_interaction=HalfALaw())),
        ),
        "interactions as a list": ("interactions & mapping", lambda: of_plate(interactions=[BOND])),
        "interactions of a tag": ("interactions & pairs", lambda: of_plate(interactions={1: BOND})),
        "interactions of words": (
            "interactions & pairs",
            lambda: of_plate(interactions={("a", "b"): BOND}),
        ),
        "interactions of a pair that never meets": (
            r"\(1, 7\) & nowhere",
            lambda: of_plate(interactions={(1, 7): BOND}),
        ),
        "two laws for a pair": (
            "two laws",
            lambda: of_plate(interactions={(1, 2): BOND, (2, 1): TOUCH}),
        ),
        "a law class of a pair": (
            "SignoriniCoulomb & class|instance",
            lambda: of_plate(interactions={(1, 2): xf.laws.SignoriniCoulomb}),
        ),
        "a law class of facets": (
            "SignoriniCoulomb & class|instance",
            lambda: of_plate(facet_interactions={NOTCH: xf.laws.SignoriniCoulomb}),
        ),
        "facet interactions of a tag that occurs nowhere": (
            "77",
            lambda: of_plate(facet_interactions={77: BOND}),
        ),
        "facet interactions outside": (
            f"tag {TOP}",
            lambda: of_plate(facet_interactions={TOP: BOND}),
        ),
        "facet interactions as a list": (
            "facet_interactions & mapping",
            lambda: of_plate(facet_interactions=[NOTCH]),
        ),
        "facet interactions of a word": (
            "facet_interactions & notch",
            lambda: of_plate(facet_interactions={"notch": BOND}),
        ),
        "laws of a body that faces nothing": (
            "nowhere",
            lambda: of_block(interactions={(1, 1): BOND}),
        ),
        "order 3": ("order & 3", lambda: of_plate(order=3)),
        "order None": ("order & None", lambda: of_plate(order=None)),
        "order of a word": ("order & 2", lambda: of_plate(order="2")),
        "points at lobatto": (
            "points & nodal & gauss & lobatto",
            lambda: of_plate(points="lobatto"),
        ),
        "points None": ("points & nodal & gauss & None", lambda: of_plate(points=None)),
        "an unknown keyword": ("gravity", lambda: of_plate(gravity=9.81)),
        "damping of a number": ("RayleighDamping & 0.1", lambda: of_plate(damping=0.1)),
        "damping of a class": ("RayleighDamping", lambda: of_plate(damping=xf.RayleighDamping)),
        "a velocity of a number": ("initial_velocity & 3", lambda: of_plate(initial_velocity=3.0)),
        "a velocity of a vector": (
            "initial_velocity & function",
            lambda: of_plate(initial_velocity=(1.0, 0.0)),
        ),
        "a velocity of UFL": (
            "initial_velocity & UFL & DOLFINx",
            lambda: of_plate(initial_velocity=of_ufl()),
        ),
        "a load of UFL": (
            "PrescribedVelocity & UFL & function of time",
            lambda: of_plate(loads=[xf.PrescribedVelocity(LEFT, 0, of_ufl()[0])]),
        ),
        "a component of UFL": (
            "SurfaceTraction & UFL & function of time",
            lambda: of_plate(loads=[xf.SurfaceTraction(LEFT, (0.0, of_ufl()[0]))]),
        ),
        "a load that gives a constant": (
            r"A load & UFL & float\(constant\)",
            lambda: of_plate(loads=[xf.PrescribedVelocity(LEFT, 0, lambda t: of_ufl()[0])]),
        ),
        "a drive of UFL": (
            "F11 & UFL & function of time",
            lambda: xf.MacroscopicDrive(gradient=STILL | {"11": of_ufl()[0]}).check(2),
        ),
        "a predicate of UFL": (
            "tag 3 & UFL & points",
            lambda: xf.tag_cells(plate().mesh, {3: of_ufl()[0]}),
        ),
        "an initial stress of UFL": (
            "InitialStress & UFL & positions",
            lambda: of_plate(loads=[xf.InitialStress(of_ufl())]),
        ),
        "a strength of UFL": (
            "strength & UFL",
            lambda: xf.laws.CohesiveZone(1e12, fracture_energy=10.0, strength=of_ufl()[0]),
        ),
        "a velocity of an unknown tag": (
            r"initial_velocity & \[4\]",
            lambda: of_plate(initial_velocity={4: np.sin}),
        ),
        "a velocity of three components": (
            "initial_velocity & shape",
            lambda: steps_of(of_plate(initial_velocity=lambda x: x)),
        ),
        "a velocity of None": (
            "initial_velocity & shape|None",
            lambda: steps_of(of_plate(initial_velocity=lambda x: None)),
        ),
        "a velocity of NaN": (
            "initial_velocity & finite",
            lambda: steps_of(of_plate(initial_velocity=lambda x: np.full((2, x.shape[1]), NAN))),
        ),
        "a velocity of words": (
            "initial_velocity & numbers",
            lambda: steps_of(of_plate(initial_velocity=lambda x: np.full((2, x.shape[1]), "a"))),
        ),
        "a velocity that takes no points": (
            "initial_velocity",
            lambda: steps_of(of_plate(initial_velocity=lambda: 0.0)),
        ),
        "an angle in degrees": ("angle & rad & 45", lambda: steps_of(of_discs(disc(angle=45.0)))),
        "surfaces as a list": ("surfaces & mapping", lambda: of_plate(surfaces=["a"])),
        "a surface of a number": ("surface & 1", lambda: of_plate(surfaces={"a": 1})),
        "a surface of a word": ("surface & matrix", lambda: of_plate(surfaces={"a": "matrix"})),
        "a surface of an unknown tag": (
            r"surface & \[7\]",
            lambda: of_plate(surfaces={"a": (7,)}, contacts=[xf.Contact(("a", "a"), TOUCH)]),
        ),
        "a surface of no tag": (
            r"surface & \[\]",
            lambda: of_plate(surfaces={"a": ()}, contacts=[xf.Contact(("a", "a"), TOUCH)]),
        ),
        "a surface that nothing touches": (
            "surfaces & leave",
            lambda: of_plate(surfaces={"a": (1,)}),
        ),
        "a surface whose name is a number": ("surface & 3", lambda: of_plate(surfaces={3: (1,)})),
        "contacts of one contact": (
            "contacts & list",
            lambda: of_plate(contacts=xf.Contact(("a", "a"), TOUCH)),
        ),
        "contacts of tuples": ("Contact", lambda: of_plate(contacts=[("a", "a", TOUCH)])),
        "a contact's law that is a number": ("law & 0.3", lambda: of_discs(disc(), law=0.3)),
        "a contact's law that is a class": (
            "SignoriniCoulomb & class|instance",
            lambda: of_discs(disc(), law=xf.laws.SignoriniCoulomb),
        ),
        "a contact's law that breaks": (
            "CohesiveZone|law",
            lambda: steps_of(of_discs(disc(), disc((2.0, 0)), law=xf.laws.PerfectBond)),
        ),
        "a contact of an unknown group": (
            "floor & discs",
            lambda: of_discs(disc(), pairs=[("discs", "floor")]),
        ),
        "a contact named twice": ("once", lambda: of_discs(disc(), pairs=2 * [("discs", "discs")])),
        "a group that no contact names": ("discs & None", lambda: of_discs(disc(), pairs=())),
        "rigid bodies of 3D with a plane mesh": (
            "dimension & 2 & 3",
            lambda: of_plate(
                rigid=[xf.RigidBody(xf.rigid.Sphere(1.0), (5, 0, 0), "a", density=1)],
                contacts=[xf.Contact(("a", "a"), TOUCH)],
            ),
        ),
        "one rigid body for a list": ("rigid & list", lambda: xf.Scene(rigid=disc())),
        "a rigid body of a shape": (
            "RigidBody & Disc",
            lambda: xf.Scene(rigid=[xf.rigid.Disc(1.0)]),
        ),
        "rigid bodies that overlap": ("overlap & apart", lambda: of_discs(disc(), disc((1.5, 0)))),
        "a rigid body given twice": ("overlap|twice", lambda: of_discs(*2 * [disc()])),
        "two equal bodies in one place": (
            "0 and 1 & same shape & twice",
            lambda: of_discs(disc((2.0, 1.0)), disc((2.0, 1.0))),
        ),
        "two equal boxes in one place": ("0 and 1 & same shape & twice", lambda: _two_boxes()),
        "a floor that is upside down": (
            r"body 1 & upside down & turn it round: \[0.0, 1.0\]",
            lambda: of_discs(
                disc((0.0, 1.5)),
                xf.rigid.wall((0, 0), (0, -1), "floor"),
                pairs=[("discs", "floor")],
            ),
        ),
        "a half space that is upside down": (
            r"body 1 & upside down & turn it round: \[0.0, 0.0, 1.0\]",
            lambda: xf.Scene(
                rigid=[
                    xf.RigidBody(xf.rigid.Sphere(1.0), (0, 0, 1.5), "ball", density=1.0),
                    xf.rigid.wall((0, 0, 0), (0, 0, -1), "floor"),
                ],
                contacts=[xf.Contact(("ball", "floor"), TOUCH)],
                resolve_overlaps=True,
            ),
        ),
        "a rigid wall that looks away from a block": (
            "upside down & deep",
            lambda: of_block(
                surfaces={"block": (1,)},
                rigid=[xf.rigid.wall((0.0, -0.1), (0, -1), "floor")],
                contacts=[xf.Contact(("block", "floor"), TOUCH)],
            ),
        ),
        "a rigid body given twice, of groups that do not meet": (
            "twice|same",
            lambda: of_discs(*2 * [disc()], disc((9, 0), "others"), pairs=[("discs", "others")]),
        ),
        "bodies too crowded": (
            "apart & room",
            lambda: of_discs(
                xf.rigid.wall((-1.2, 0), (1, 0), "box"),
                xf.rigid.wall((1.2, 0), (-1, 0), "box"),
                xf.rigid.wall((0, -1.2), (0, 1), "box"),
                xf.rigid.wall((0, 1.2), (0, -1), "box"),
                disc((0.1, 0)),
                disc((-0.1, 0)),
                pairs=[("discs", "discs"), ("discs", "box")],
                resolve_overlaps=True,
            ),
        ),
        "overlaps resolved by a word": (
            "resolve_overlaps & no",
            lambda: of_discs(disc(), resolve_overlaps="no"),
        ),
        "a group without contact with itself": (
            r"meet & xf\.Contact\(\('discs', 'discs'\), None\)",
            lambda: of_discs(
                disc(),
                disc((0, 3.0)),
                xf.rigid.wall((0, -1), (0, 1), "floor"),
                pairs=[("discs", "floor")],
            ),
        ),
        "two groups that nothing is said of": (
            r"meet & xf\.Contact\(\('balls', 'discs'\), None\)",
            lambda: of_discs(
                disc(),
                disc((0, 3.0), "balls"),
                xf.rigid.wall((0, -1), (0, 1), "floor"),
                pairs=[("discs", "floor"), ("balls", "floor")],
            ),
        ),
        "groups that are decided to pass": (
            "",
            lambda: _quiet(
                lambda: steps_of(
                    xf.Scene(
                        rigid=[disc(), disc((0, 3.0)), xf.rigid.wall((0, -1), (0, 1), "floor")],
                        contacts=[
                            xf.Contact(("discs", "floor"), TOUCH),
                            xf.Contact(("discs", "discs"), None),
                        ],
                    )
                )
            ),
        ),
        "a surface without contact with itself": (
            r"meet & xf\.Contact\(\('plate', 'plate'\), None\)",
            lambda: of_plate(
                interactions={(1, 2): None},
                surfaces={"plate": (1, 2)},
                rigid=[disc((1.0, 4.0), "ball")],
                contacts=[xf.Contact(("plate", "ball"), TOUCH)],
            ),
        ),
        "a disc that cuts a block": ("overlap & apart", lambda: steps_of(near_block(1.15))),
        "a disc inside of a block": ("rigid body 0 & apart", lambda: steps_of(near_block(0.5))),
        "a disc on a block": ("", lambda: _quiet(lambda: steps_of(near_block(1.3)))),
        "blocks that overlap": ("bodies 0 and 1 & apart", lambda: steps_of(blocks(0.9))),
        "blocks that touch": ("", lambda: _quiet(lambda: steps_of(blocks(1.0)))),
        "walls for a rigid scene": (
            "walls & mesh",
            lambda: of_discs(disc(), walls=[xf.Wall(1, (0, 0), (0, 1), TOUCH)]),
        ),
        "materials for a rigid scene": (
            "materials & mesh",
            lambda: of_discs(disc(), materials={1: SOLID}),
        ),
        "ties for a rigid scene": (
            "ties & mesh",
            lambda: of_discs(disc(), ties=[xf.Tie(1, 2, BOND)]),
        ),
        "order 2 of a rigid scene": ("order & mesh", lambda: of_discs(disc(), order=2)),
        "a default interaction of a rigid scene": (
            "default_interaction & mesh",
            lambda: of_discs(disc(), default_interaction=TOUCH),
        ),
        "a drive for no cell": (
            "lattice",
            lambda: of_plate(macroscopic=xf.MacroscopicDrive(gradient=STILL)),
        ),
        "a cell without drive": (
            "macroscopic",
            lambda: xf.Scene(cell(), {1: SOLID}, default_interaction=BOND),
        ),
        "a drive of a mapping": ("MacroscopicDrive", lambda: of_cell(STILL)),
        "a drive with a component short": (
            "22",
            lambda: of_cell(
                xf.MacroscopicDrive(gradient={k: STILL[k] for k in ("11", "12", "21")})
            ),
        ),
        "a drive of 3D": ("33", lambda: of_cell(xf.MacroscopicDrive(gradient=STILL | {"33": 1.0}))),
        "a drive from a strain": (
            "F11 & 1 at rest",
            lambda: of_cell(xf.MacroscopicDrive(gradient=STILL | {"11": 0.0})),
        ),
        "a drive of None": (
            "11 & None",
            lambda: of_cell(xf.MacroscopicDrive(gradient=STILL | {"11": None})),
        ),
        "a drive of NaN": (
            "11 & nan",
            lambda: of_cell(xf.MacroscopicDrive(gradient=STILL | {"11": NAN})),
        ),
        "a drive of a word": (
            "11 & fast",
            lambda: of_cell(
                xf.MacroscopicDrive(
                    gradient={k: STILL[k] for k in ("12", "21", "22")}, rate={"11": "fast"}
                )
            ),
        ),
        "a drive of nothing": (
            "11 & None",
            lambda: of_cell(xf.MacroscopicDrive(gradient=STILL | {"11": lambda t: None})),
        ),
        "loads on a cell": (
            "macroscopic & loads",
            lambda: of_cell(loads=[xf.Gravity((0.0, -9.81))]),
        ),
        "a cell squeezed to nothing": (
            "volume",
            lambda: steps_of(
                of_cell(
                    xf.MacroscopicDrive(
                        gradient={k: STILL[k] for k in ("12", "21", "22")}, rate={"11": -1e6}
                    )
                ),
                3,
                max_halvings=1,
            ),
        ),
        "cohesion softer than the bulk": (
            "stiffness & normal_stiffness",
            lambda: steps_of(of_plate(default_interaction=xf.laws.CohesiveZone(1e7, 10.0, 1e3))),
        ),
    }
    return [Misuse(name, *case) for name, case in cases.items()]


def _quiet(act):
    """Right if nothing is said."""
    from misuse import _warnings

    with _warnings() as told:
        act()
    return None if told else RIGHT


def loads() -> list[Misuse]:
    """Of loads, walls and ties."""
    velocity, displacement = xf.PrescribedVelocity, xf.PrescribedDisplacement

    def wall(point, normal, facets=BOTTOM, law=TOUCH, then=lambda scene: scene):
        return lambda: then(of_block(walls=[xf.Wall(facets, point, normal, law)]))

    def tie(candidates, antagonists, law=BOND, **changes):
        return lambda: steps_of(of_block(ties=[xf.Tie(candidates, antagonists, law)], **changes))

    out = []
    for value in NUMBERS:
        for kind in (velocity, displacement):
            if value == 0.0 or (kind is velocity and value == -1.0):
                continue
            out.append(
                Misuse(
                    f"{kind.__name__}(value={value!r})",
                    "value|displacement|finite",
                    lambda kind=kind, value=value: of_plate(loads=[kind(LEFT, 0, value)]),
                )
            )
        if value not in (0.0, -1.0):
            for kind in (xf.BodyForce, xf.Gravity, lambda v: xf.SurfaceTraction(TOP, v)):
                name = getattr(kind, "__name__", "").replace("<lambda>", "SurfaceTraction")
                out.append(
                    Misuse(
                        f"{name}(value=(0, {value!r}))",
                        "value|finite",
                        lambda k=kind, v=value: of_plate(loads=[k((0.0, v))]),
                    )
                )
    for tag in (66, "left", None, 1.5, (1, 2), [1], -1):
        for name, make in (
            ("velocity", lambda t: of_plate(loads=[velocity(t, 0, 0.0)])),
            ("traction", lambda t: of_plate(loads=[xf.SurfaceTraction(t, (0.0, 0.0))])),
            ("wall", lambda t: of_plate(walls=[xf.Wall(t, (0, 0), (0, 1), TOUCH)])),
        ):
            out.append(Misuse(f"a {name} of tag {tag!r}", "tag", lambda m=make, t=tag: m(t)))
    cases = {
        "one load for a list": ("loads & list", lambda: of_plate(loads=xf.Gravity((0, -9.81)))),
        "a load of a number": ("9.81 & load", lambda: of_plate(loads=[9.81])),
        "a load of None": ("None & load", lambda: of_plate(loads=[None])),
        "a load class": ("Gravity & load", lambda: of_plate(loads=[xf.Gravity])),
        "damping among the loads": (
            "RayleighDamping & damping",
            lambda: of_plate(loads=[xf.RayleighDamping(1.0)]),
        ),
        "gravity of a number": (
            "Gravity & 2 components",
            lambda: of_plate(loads=[xf.Gravity(9.81)]),
        ),
        "gravity of 3D": (
            "Gravity & 2 components",
            lambda: of_plate(loads=[xf.Gravity((0, 0, 1))]),
        ),
        "gravity of a word": ("Gravity & number", lambda: of_plate(loads=[xf.Gravity("xy")])),
        "gravity of words": ("Gravity & number", lambda: of_plate(loads=[xf.Gravity(("a", "b"))])),
        "gravity of a function of 3D": (
            "Gravity & 2 components",
            lambda: of_plate(loads=[xf.Gravity(lambda t: (0, 0, -9.81))]),
        ),
        "gravity of a function that gives a number": (
            "Gravity & 2 components & 9.81",
            lambda: of_discs(disc(), loads=[xf.Gravity(lambda t: -9.81)]),
        ),
        "gravity of a function that gives NaN": (
            "Gravity & nan & t = 0",
            lambda: of_discs(disc(), loads=[xf.Gravity(lambda t: (0.0, NAN))]),
        ),
        "gravity of a function of no time": (
            "takes 0|function of time",
            lambda: of_discs(disc(), loads=[xf.Gravity(lambda: (0.0, -9.81))]),
        ),
        "a body force on rigid bodies": (
            "gravity & RigidBody",
            lambda: of_discs(disc(), loads=[xf.BodyForce((0, 1))]),
        ),
        "component 2 in the plane": (
            "component 2 & 0 to 1",
            lambda: of_plate(loads=[velocity(LEFT, 2, 0.0)]),
        ),
        "component -1": (
            "component -1 & 0 to 1",
            lambda: of_plate(loads=[velocity(LEFT, -1, 0.0)]),
        ),
        "component None": ("component None", lambda: of_plate(loads=[velocity(LEFT, None, 0.0)])),
        "component x": ("component & x", lambda: of_plate(loads=[velocity(LEFT, "x", 0.0)])),
        "component 0.0": ("component 0.0", lambda: of_plate(loads=[velocity(LEFT, 0.0, 0.0)])),
        "a displacement at the start": (
            "0.001 m at the start",
            lambda: of_plate(loads=[displacement(LEFT, 0, 1e-3)]),
        ),
        "a displacement that starts elsewhere": (
            "at the start",
            lambda: of_plate(loads=[displacement(LEFT, 0, lambda t: 1.0 + t)]),
        ),
        "motions that contradict each other": (
            "same component",
            lambda: of_plate(loads=[velocity(LEFT, 0, 0.0), velocity(LEFT, 0, 1.0)]),
        ),
        "the same motion twice": (
            "",
            lambda: _quiet(lambda: of_plate(loads=2 * [velocity(LEFT, 0, 0.0)])),
        ),
        "a function that gives None": (
            "None",
            lambda: of_plate(loads=[velocity(LEFT, 0, lambda t: None)]),
        ),
        "a function that gives an array": (
            "should be a number",
            lambda: of_plate(loads=[velocity(LEFT, 0, lambda t: np.zeros(2))]),
        ),
        "a function of nothing": (
            "function & time",
            lambda: of_plate(loads=[velocity(LEFT, 0, lambda: 0.0)]),
        ),
        "a function of position": (
            "function & time",
            lambda: of_plate(loads=[velocity(LEFT, 0, lambda x: x[0])]),
        ),
        "a function that becomes NaN": (
            "nan & t =",
            lambda: steps_of(
                of_plate(loads=[velocity(LEFT, 0, lambda t: 0.0 if t < 2e-5 else NAN)]), 5
            ),
        ),
        "a traction that becomes infinite": (
            "inf",
            lambda: steps_of(
                of_plate(loads=[xf.SurfaceTraction(TOP, (0, lambda t: 0.0 if t < 2e-5 else INF))]),
                5,
            ),
        ),
        "a traction on facets inside a body": (
            "SurfaceTraction & inside|between|outer",
            lambda: of_block(loads=[xf.SurfaceTraction(INSIDE, (0.0, 1.0))]),
        ),
        "a traction on facets between bodies": (
            "SurfaceTraction & between",
            lambda: run_of_plate(loads=[xf.SurfaceTraction(NOTCH, (0.0, 1.0))]),
        ),
        "walls of one wall": (
            "walls & list",
            lambda: of_block(walls=xf.Wall(BOTTOM, (0, 0), (0, 1), TOUCH)),
        ),
        "walls of a tag": ("no Wall", lambda: of_block(walls=[BOTTOM])),
        "a wall without normal": ("normal & vanish", wall((0, 0), (0, 0))),
        "a wall with a NaN normal": ("normal & finite", wall((0, 0), (0, NAN))),
        "a wall at infinity": ("point & finite", wall((0, INF), (0, 1))),
        "a wall of 3D": ("2 components", wall((0, 0, 0), (0, 0, 1))),
        "a wall whose point is a number": ("point & 2 components", wall(0.0, (0, 1))),
        "a wall whose normal is a word": ("normal", wall((0, 0), "up")),
        "a wall whose law is None": ("None & law", wall((0, 0), (0, 1), law=None)),
        "a wall whose law is a class": (
            "SignoriniCoulomb & class|instance",
            wall((0, 0), (0, 1), law=xf.laws.SignoriniCoulomb),
        ),
        "a wall of facets inside": ("Wall & inside|between|outer", wall((0, 0), (0, 1), INSIDE)),
        "a wall upside down": ("normal & out of", wall((0, 0), (0, -1), then=steps_of)),
        "a wall half a metre inside": (
            "inside|penetrat|beyond",
            wall((0, 0.5), (0, 1), then=steps_of),
        ),
        "a tie of a surface with itself": ("candidates & antagonists", tie(TOP, TOP)),
        "a tie of unknown tags": ("tag 55", tie(55, TOP)),
        "a tie of surfaces apart": ("surface|lie|candidate|antagonist|facets", tie(TOP, BOTTOM)),
        "a tie of order 2": ("order", tie(TOP, BOTTOM, order=2)),
        "a tie of a number": ("Tie", lambda: of_block(ties=[3])),
        "a tie's law of None": ("None & law", tie(TOP, BOTTOM, None)),
        "a tie's law of a class": (
            "PerfectBond & class|instance",
            tie(TOP, BOTTOM, xf.laws.PerfectBond),
        ),
        "motions of the sides of a box in the plane": (
            "component 2",
            lambda: of_block(loads=[velocity(RIGHT_SIDE, 2, 0.0)]),
        ),
        "gravity of the plane in space": (
            "Gravity & 3 components",
            lambda: xf.Scene(box(), {1: SOLID}, loads=[xf.Gravity((0, -9.81))]),
        ),
        "a wall of the plane in space": (
            "3 components",
            lambda: xf.Scene(box(), {1: SOLID}, walls=[xf.Wall(BOTTOM, (0, 0), (0, 1), TOUCH)]),
        ),
    }
    return out + [Misuse(name, *case) for name, case in cases.items()]
