"""The effects of scenes, one per file, and the base classes for effects of your own."""

from ..scene.cell import Cell
from ..scene.constraint import Constraint
from ..scene.effect import Body, Link, Motion
from ..scene.grain_contact import Rough
from ..scene.weld import Weld
from .actuator import Actuator
from .angle import Angle
from .bending import Bending
from .breaking_string import BreakingString
from .cable import Cable
from .coulomb import Coulomb
from .coulomb_friction import CoulombFriction
from .dihedral import Dihedral
from .gravity import Gravity
from .hardening_spring import HardeningSpring
from .harmonic_angle import HarmonicAngle
from .harmonic_force import HarmonicForce
from .hertz_mindlin import HertzMindlin
from .hinge_bending import HingeBending
from .lennard_jones import LennardJones
from .linear_damper import LinearDamper
from .linear_spring import LinearSpring
from .mass_contact import MassContact
from .mass_impact import MassImpact
from .morse import Morse
from .motor import Motor
from .neo_hookean import NeoHookean
from .plane_contact import PlaneContact
from .quadratic_drag import QuadraticDrag
from .rigid_stop import RigidStop
from .rod import Rod
from .rotating_frame import RotatingFrame
from .ryckaert_bellemans import RyckaertBellemans
from .sampled_acceleration import SampledAcceleration
from .sampled_motion import SampledMotion
from .slider import Slider
from .softening_spring import SofteningSpring
from .st_venant_kirchhoff import StVenantKirchhoff
from .st_venant_kirchhoff_triangle import StVenantKirchhoffTriangle
from .support_motion import SupportMotion
from .tetrahedron import Tetrahedron
from .torque import Torque
from .triangle import Triangle
from .wind_pressure import WindPressure

__all__ = [
    "Actuator",
    "Angle",
    "Bending",
    "Body",
    "BreakingString",
    "Cable",
    "Cell",
    "Constraint",
    "Coulomb",
    "CoulombFriction",
    "Dihedral",
    "Gravity",
    "HardeningSpring",
    "HarmonicAngle",
    "HarmonicForce",
    "HertzMindlin",
    "HingeBending",
    "LennardJones",
    "LinearDamper",
    "LinearSpring",
    "Link",
    "MassContact",
    "MassImpact",
    "Morse",
    "Motion",
    "Motor",
    "NeoHookean",
    "PlaneContact",
    "QuadraticDrag",
    "RigidStop",
    "Rod",
    "RotatingFrame",
    "Rough",
    "RyckaertBellemans",
    "SampledAcceleration",
    "SampledMotion",
    "Slider",
    "SofteningSpring",
    "StVenantKirchhoff",
    "StVenantKirchhoffTriangle",
    "SupportMotion",
    "Tetrahedron",
    "Torque",
    "Triangle",
    "Weld",
    "WindPressure",
]
