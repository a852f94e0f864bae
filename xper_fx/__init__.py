# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fracture, contact and friction of multibody media by NonSmooth Contact Dynamics in FEniCSx.

`import xper_fx as xf` gives all public names, each imported when it is first asked for: scenes and
runs by name, and namespaces of what there are several of.

    xf.laws                  interaction laws: CohesiveZone, SignoriniCoulomb, Tresca, PerfectBond
    xf.materials             materials of the bulk; xf.library has measured constants
    xf.loads                 loads, which are public names of their own as well
    xf.rigid                 rigid bodies: Disc, Polygon, Sphere, Polyhedron, wall
    xf.meshes                meshes and their tags
    xf.microstructure        grains: periodic tessellations and their meshes
    xf.kinematics            strains, in UFL, for materials of one's own
    xf.results               what is read off a run: cracks, fragments, contact forces
    xf.plotting              figures
    xf.study                 runs of one scene with several settings; xf.quantities, what they
                             compare; xf.effect_prices, what each effect costs
    xf.domain_decomposition  the solver of perfect bonds
"""

from typing import TYPE_CHECKING

from xper_fx.lazy import importer
from xper_fx.version import __version__ as __version__

if TYPE_CHECKING:
    from xper_fx import effects_price as effect_prices  # noqa: F401
    from xper_fx import materials as materials
    from xper_fx import meshes as meshes
    from xper_fx import plotting as plotting
    from xper_fx import quantities as quantities
    from xper_fx import results as results
    from xper_fx import study as study
    from xper_fx.bodies import Bodies as Bodies
    from xper_fx.bodies import explode as explode
    from xper_fx.cache import njit as njit
    from xper_fx.compat import geometry_dofmap as geometry_dofmap
    from xper_fx.contacts import Contact as Contact
    from xper_fx.effects import effects_table as effects_table
    from xper_fx.errors import CheckpointError as CheckpointError
    from xper_fx.errors import ConvergenceError as ConvergenceError
    from xper_fx.errors import NotFiniteError as NotFiniteError
    from xper_fx.forms import kinematics as kinematics
    from xper_fx.forms import loads as loads
    from xper_fx.forms.loads import BodyForce as BodyForce
    from xper_fx.forms.loads import Gravity as Gravity
    from xper_fx.forms.loads import PrescribedDisplacement as PrescribedDisplacement
    from xper_fx.forms.loads import PrescribedVelocity as PrescribedVelocity
    from xper_fx.forms.loads import RayleighDamping as RayleighDamping
    from xper_fx.forms.loads import SurfaceTraction as SurfaceTraction
    from xper_fx.joined_meshes import join_meshes as join_meshes
    from xper_fx.materials import library as library
    from xper_fx.meshes import SerialOnlyError as SerialOnlyError
    from xper_fx.meshes import crossed_rectangle as crossed_rectangle
    from xper_fx.meshes import in_rectangles as in_rectangles
    from xper_fx.meshes import read_gmsh as read_gmsh
    from xper_fx.meshes import tag_cells as tag_cells
    from xper_fx.meshes import tag_facets as tag_facets
    from xper_fx.nscd import FrictionProblem as FrictionProblem
    from xper_fx.nscd import laws as laws
    from xper_fx.nscd import rigid as rigid
    from xper_fx.nscd import subdomains as domain_decomposition  # noqa: F401
    from xper_fx.nscd.rigid import RigidBody as RigidBody
    from xper_fx.output import prepare_folder as prepare_folder
    from xper_fx.output import read_history as read_history
    from xper_fx.parallel.launch import run_together as run_together
    from xper_fx.periodic import microstructure as microstructure
    from xper_fx.periodic.drive import MacroscopicDrive as MacroscopicDrive
    from xper_fx.periodic.microstructure.gmsh_session import gmsh_model as gmsh_model
    from xper_fx.recorder import CellGauge as CellGauge
    from xper_fx.recorder import Recorder as Recorder
    from xper_fx.recorder import TensileGauge as TensileGauge
    from xper_fx.recorder import add_to_summary as add_to_summary
    from xper_fx.runner import add_run_options as add_run_options
    from xper_fx.runner import recorded_steps as recorded_steps
    from xper_fx.scales import cohesive_table as cohesive_table
    from xper_fx.scene import Scene as Scene
    from xper_fx.scene import Wall as Wall
    from xper_fx.simulation import Simulation as Simulation
    from xper_fx.simulation import StepRecord as StepRecord
    from xper_fx.study import Study as Study
    from xper_fx.subdomains import partition as partition
    from xper_fx.ties import Tie as Tie

_MODULE_OF = {
    "Bodies": "bodies",
    "BodyForce": "forms.loads",
    "CellGauge": "recorder",
    "CheckpointError": "errors",
    "Contact": "contacts",
    "ConvergenceError": "errors",
    "FrictionProblem": "nscd",
    "Gravity": "forms.loads",
    "MacroscopicDrive": "periodic.drive",
    "NotFiniteError": "errors",
    "PrescribedDisplacement": "forms.loads",
    "PrescribedVelocity": "forms.loads",
    "RayleighDamping": "forms.loads",
    "Recorder": "recorder",
    "RigidBody": "nscd.rigid",
    "Scene": "scene",
    "SerialOnlyError": "meshes",
    "Simulation": "simulation",
    "StepRecord": "simulation",
    "Study": "study",
    "SurfaceTraction": "forms.loads",
    "TensileGauge": "recorder",
    "Tie": "ties",
    "Wall": "scene",
    "add_run_options": "runner",
    "add_to_summary": "recorder",
    "cohesive_table": "scales",
    "crossed_rectangle": "meshes",
    "effects_table": "effects",
    "explode": "bodies",
    "geometry_dofmap": "compat",
    "gmsh_model": "periodic.microstructure.gmsh_session",
    "in_rectangles": "meshes",
    "join_meshes": "joined_meshes",
    "njit": "cache",
    "partition": "subdomains",
    "prepare_folder": "output",
    "read_gmsh": "meshes",
    "read_history": "output",
    "recorded_steps": "runner",
    "run_together": "parallel.launch",
    "tag_cells": "meshes",
    "tag_facets": "meshes",
}
_NAMESPACES = {
    "domain_decomposition": "nscd.subdomains",
    "effect_prices": "effects_price",
    "kinematics": "forms.kinematics",
    "laws": "nscd.laws",
    "library": "materials.library",
    "loads": "forms.loads",
    "materials": "materials",
    "meshes": "meshes",
    "microstructure": "periodic.microstructure",
    "plotting": "plotting",
    "quantities": "quantities",
    "results": "results",
    "rigid": "nscd.rigid",
    "study": "study",
}

__all__ = ["__version__", *_MODULE_OF, *_NAMESPACES]
__getattr__ = importer(__name__, _MODULE_OF, _NAMESPACES)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
