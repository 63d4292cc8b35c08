"""An angle between two bodies that is a function of time."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from ..kernels.vector_angle import angle_in_plane, angle_in_space, slope_in_plane, slope_in_space
from .constraint import Constraint


@dataclass(frozen=True, eq=False)
class PrescribedAngle(Constraint):
    """The angle from the vector x1 to the vector x0 in the plane is a function of time."""

    target: Callable

    period = 2 * math.pi
    source = "phi = atan2(x1 x x0, x1 . x0)"
    picture = ""
    phi = staticmethod(angle_in_plane)
    gradient = staticmethod(slope_in_plane)


@dataclass(frozen=True, eq=False)
class PrescribedAngleInSpace(PrescribedAngle):
    """The angle about the unit vector x2 from the vector x1 to the vector x0 is a function of time."""

    takes = (3,)
    source = "phi = atan2(x2 . (x1 x x0), x1 . x0)"
    phi = staticmethod(angle_in_space)
    gradient = staticmethod(slope_in_space)
