"""The effects of scenes, one per file, and the base classes for effects of your own."""

from ..scene.cell import Cell
from ..scene.constraint import Constraint
from ..scene.effect import Body, Link, Motion
from ..scene.frictional_contact import FrictionalContact
from ..scene.point_joint import PointJoint
from ..scene.weld import Weld
from .angle import Angle
from .bending import Bending
from .bouc_wen import BoucWen
from .breaking import Breaking
from .breaking_string import BreakingString
from .cable import Cable
from .coulomb import Coulomb
from .coulomb_friction import CoulombFriction
from .dihedral import Dihedral
from .elastic_plastic import ElasticPlastic
from .ewald import Ewald
from .friction_pendulum import FrictionPendulum
from .gap import Gap
from .giuffre_menegotto_pinto import GiuffreMenegottoPinto
from .gravity import Gravity
from .hardening_spring import HardeningSpring
from .harmonic_angle import HarmonicAngle
from .harmonic_force import HarmonicForce
from .hertz_contact import HertzContact
from .hertz_mindlin import HertzMindlin
from .hinge_bending import HingeBending
from .lead_rubber import LeadRubber
from .lennard_jones import LennardJones
from .linear_damper import LinearDamper
from .linear_spring import LinearSpring
from .mass_impact import MassImpact
from .maxwell import Maxwell
from .morse import Morse
from .motor import Motor
from .multilinear import Multilinear
from .neo_hookean import NeoHookean
from .plane_contact import PlaneContact
from .prescribed_distance import PrescribedDistance
from .quadratic_drag import QuadraticDrag
from .rigid_stop import RigidStop
from .rod import Rod
from .rotating_frame import RotatingFrame
from .ryckaert_bellemans import RyckaertBellemans
from .sampled_acceleration import SampledAcceleration
from .sampled_motion import SampledMotion
from .slider import Slider
from .softening_spring import SofteningSpring
from .st_venant_kirchhoff_membrane import StVenantKirchhoffMembrane
from .st_venant_kirchhoff_solid import StVenantKirchhoffSolid
from .support_motion import SupportMotion
from .tetrahedron import Tetrahedron
from .torque import Torque
from .triangle import Triangle
from .wind_pressure import WindPressure

__all__ = [
    "Angle",
    "Bending",
    "Body",
    "BoucWen",
    "Breaking",
    "BreakingString",
    "Cable",
    "Cell",
    "Constraint",
    "Coulomb",
    "CoulombFriction",
    "Dihedral",
    "ElasticPlastic",
    "Ewald",
    "FrictionPendulum",
    "FrictionalContact",
    "Gap",
    "GiuffreMenegottoPinto",
    "Gravity",
    "HardeningSpring",
    "HarmonicAngle",
    "HarmonicForce",
    "HertzContact",
    "HertzMindlin",
    "HingeBending",
    "LeadRubber",
    "LennardJones",
    "LinearDamper",
    "LinearSpring",
    "Link",
    "MassImpact",
    "Maxwell",
    "Morse",
    "Motion",
    "Motor",
    "Multilinear",
    "NeoHookean",
    "PlaneContact",
    "PointJoint",
    "PrescribedDistance",
    "QuadraticDrag",
    "RigidStop",
    "Rod",
    "RotatingFrame",
    "RyckaertBellemans",
    "SampledAcceleration",
    "SampledMotion",
    "Slider",
    "SofteningSpring",
    "StVenantKirchhoffMembrane",
    "StVenantKirchhoffSolid",
    "SupportMotion",
    "Tetrahedron",
    "Torque",
    "Triangle",
    "Weld",
    "WindPressure",
]
