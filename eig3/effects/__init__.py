"""The effects of scenes, one per file, and the three base classes for effects of your own."""

from ..scene.effect import Body, Link, Motion
from .breaking_string import BreakingString
from .cable import Cable
from .coulomb_friction import CoulombFriction
from .gravity import Gravity
from .hardening_spring import HardeningSpring
from .harmonic_force import HarmonicForce
from .linear_damper import LinearDamper
from .linear_spring import LinearSpring
from .mass_contact import MassContact
from .mass_impact import MassImpact
from .plane_contact import PlaneContact
from .quadratic_drag import QuadraticDrag
from .rigid_stop import RigidStop
from .rotating_frame import RotatingFrame
from .sampled_acceleration import SampledAcceleration
from .sampled_motion import SampledMotion
from .softening_spring import SofteningSpring
from .support_motion import SupportMotion

__all__ = [
    "Body",
    "BreakingString",
    "Cable",
    "CoulombFriction",
    "Gravity",
    "HardeningSpring",
    "HarmonicForce",
    "LinearDamper",
    "LinearSpring",
    "Link",
    "MassContact",
    "MassImpact",
    "Motion",
    "PlaneContact",
    "QuadraticDrag",
    "RigidStop",
    "RotatingFrame",
    "SampledAcceleration",
    "SampledMotion",
    "SofteningSpring",
    "SupportMotion",
]
