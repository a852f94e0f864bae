# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fracture, contact and friction of multibody media by NonSmooth Contact Dynamics in FEniCSx.

`import xper_fx as xf` gives all public names, each imported when it is first asked for: scenes and
runs by name, and namespaces of what there are several of.

    xf.laws            interaction laws: CohesiveZone, CohesiveCurve, MixedMode, Adhesion,
                       PerfectBond, SignoriniCoulomb, Tresca and others; xf.laws.curves, along
                       which bonds weaken; xf.fields, parameters that differ from point to point
    xf.materials       materials of the bulk; xf.library has measured constants, xf.kinematics
                       strains in UFL for materials of one's own
    xf.loads           loads, which are public names of their own as well
    xf.rigid           rigid bodies: Disc, Polygon, Sphere, Polyhedron, wall
    xf.assemblies      walls, columns and arches of blocks, packings of grains, boxes
    xf.meshes          meshes and their tags
    xf.periodic        periodic cells: MacroscopicDrive; xf.microstructure, grains and their meshes
    xf.solvers         solvers of the interactions and their options
    xf.output          what a run leaves and what is read off it: cracks, fragments, contact forces,
                       pictures and animations of its bodies
    xf.plotting        figures of curves and meshes
    xf.study           runs of one scene with several settings; xf.quantities, what they compare;
                       xf.effect_prices, what each effect costs
"""

import os
from typing import TYPE_CHECKING

from xper_fx.support.lazy import importer
from xper_fx.support.version import __version__ as __version__

if TYPE_CHECKING:
    from xper_fx import materials as materials
    from xper_fx import output as output
    from xper_fx import periodic as periodic
    from xper_fx import plotting as plotting
    from xper_fx import study as study
    from xper_fx.bodies import meshes as meshes
    from xper_fx.bodies.explode import Bodies as Bodies
    from xper_fx.bodies.explode import explode as explode
    from xper_fx.bodies.gmsh_session import gmsh_model as gmsh_model
    from xper_fx.bodies.join import join_meshes as join_meshes
    from xper_fx.bodies.meshes import SerialOnlyError as SerialOnlyError
    from xper_fx.bodies.meshes import crossed_rectangle as crossed_rectangle
    from xper_fx.bodies.meshes import in_rectangles as in_rectangles
    from xper_fx.bodies.meshes import read_gmsh as read_gmsh
    from xper_fx.bodies.meshes import tag_cells as tag_cells
    from xper_fx.bodies.meshes import tag_facets as tag_facets
    from xper_fx.bodies.partition import partition as partition
    from xper_fx.cache import njit as njit
    from xper_fx.forms import loads as loads
    from xper_fx.forms.loads import BodyForce as BodyForce
    from xper_fx.forms.loads import Gravity as Gravity
    from xper_fx.forms.loads import InitialStress as InitialStress
    from xper_fx.forms.loads import PrescribedDisplacement as PrescribedDisplacement
    from xper_fx.forms.loads import PrescribedVelocity as PrescribedVelocity
    from xper_fx.forms.loads import RayleighDamping as RayleighDamping
    from xper_fx.forms.loads import SurfaceTraction as SurfaceTraction
    from xper_fx.materials import kinematics as kinematics
    from xper_fx.materials import library as library
    from xper_fx.nscd import FrictionProblem as FrictionProblem
    from xper_fx.nscd import laws as laws
    from xper_fx.nscd import rigid as rigid
    from xper_fx.nscd import solvers as solvers
    from xper_fx.nscd.laws import fields as fields
    from xper_fx.nscd.rigid import RigidBody as RigidBody
    from xper_fx.nscd.rigid import assemblies as assemblies
    from xper_fx.output.effects import effects_table as effects_table
    from xper_fx.output.gauges import CellGauge as CellGauge
    from xper_fx.output.gauges import TensileGauge as TensileGauge
    from xper_fx.output.history import read_history as read_history
    from xper_fx.output.output_folder import prepare_folder as prepare_folder
    from xper_fx.output.recorder import Recorder as Recorder
    from xper_fx.output.run import add_run_options as add_run_options
    from xper_fx.output.run import recorded_steps as recorded_steps
    from xper_fx.output.run_summary import add_to_summary as add_to_summary
    from xper_fx.parallel.launch import run_together as run_together
    from xper_fx.periodic import MacroscopicDrive as MacroscopicDrive
    from xper_fx.periodic import microstructure as microstructure
    from xper_fx.scene import Contact as Contact
    from xper_fx.scene import Hinge as Hinge
    from xper_fx.scene import Scene as Scene
    from xper_fx.scene import Slider as Slider
    from xper_fx.scene import Tendon as Tendon
    from xper_fx.scene import Tie as Tie
    from xper_fx.scene import Wall as Wall
    from xper_fx.scene import Weld as Weld
    from xper_fx.simulation import DissipationControl as DissipationControl
    from xper_fx.simulation import GrowthControl as GrowthControl
    from xper_fx.simulation import Simulation as Simulation
    from xper_fx.simulation import StepRecord as StepRecord
    from xper_fx.simulation.cohesive_scales import cohesive_table as cohesive_table
    from xper_fx.study import Study as Study
    from xper_fx.study import effect_prices as effect_prices
    from xper_fx.study import quantities as quantities
    from xper_fx.support.compat import geometry_dofmap as geometry_dofmap
    from xper_fx.support.errors import CheckpointError as CheckpointError
    from xper_fx.support.errors import ConvergenceError as ConvergenceError
    from xper_fx.support.errors import NotFiniteError as NotFiniteError
    from xper_fx.support.errors import SmallStrainError as SmallStrainError

# SCOTCH, by which DOLFINx partitions meshes, gives other parts each time on several threads.
os.environ.setdefault("SCOTCH_PTHREAD_NUMBER", "1")

_MODULE_OF = {
    "Bodies": "bodies.explode",
    "BodyForce": "forms.loads",
    "CellGauge": "output.gauges",
    "CheckpointError": "support.errors",
    "Contact": "scene",
    "ConvergenceError": "support.errors",
    "DissipationControl": "simulation",
    "FrictionProblem": "nscd",
    "Gravity": "forms.loads",
    "GrowthControl": "simulation",
    "Hinge": "scene",
    "InitialStress": "forms.loads",
    "MacroscopicDrive": "periodic",
    "NotFiniteError": "support.errors",
    "PrescribedDisplacement": "forms.loads",
    "PrescribedVelocity": "forms.loads",
    "RayleighDamping": "forms.loads",
    "Recorder": "output.recorder",
    "RigidBody": "nscd.rigid",
    "Scene": "scene",
    "SerialOnlyError": "bodies.meshes",
    "Simulation": "simulation",
    "Slider": "scene",
    "SmallStrainError": "support.errors",
    "StepRecord": "simulation",
    "Study": "study",
    "SurfaceTraction": "forms.loads",
    "Tendon": "scene",
    "TensileGauge": "output.gauges",
    "Tie": "scene",
    "Wall": "scene",
    "Weld": "scene",
    "add_run_options": "output.run",
    "add_to_summary": "output.run_summary",
    "cohesive_table": "simulation.cohesive_scales",
    "crossed_rectangle": "bodies.meshes",
    "effects_table": "output.effects",
    "explode": "bodies.explode",
    "geometry_dofmap": "support.compat",
    "gmsh_model": "bodies.gmsh_session",
    "in_rectangles": "bodies.meshes",
    "join_meshes": "bodies.join",
    "njit": "cache",
    "partition": "bodies.partition",
    "prepare_folder": "output.output_folder",
    "read_gmsh": "bodies.meshes",
    "read_history": "output.history",
    "recorded_steps": "output.run",
    "run_together": "parallel.launch",
    "tag_cells": "bodies.meshes",
    "tag_facets": "bodies.meshes",
}
_NAMESPACES = {
    "assemblies": "nscd.rigid.assemblies",
    "effect_prices": "study.effect_prices",
    "fields": "nscd.laws.fields",
    "kinematics": "materials.kinematics",
    "laws": "nscd.laws",
    "library": "materials.library",
    "loads": "forms.loads",
    "materials": "materials",
    "meshes": "bodies.meshes",
    "microstructure": "periodic.microstructure",
    "output": "output",
    "periodic": "periodic",
    "plotting": "plotting",
    "quantities": "study.quantities",
    "rigid": "nscd.rigid",
    "solvers": "nscd.solvers",
    "study": "study",
}

__all__ = ["__version__", *_MODULE_OF, *_NAMESPACES]
__getattr__ = importer(__name__, _MODULE_OF, _NAMESPACES)
