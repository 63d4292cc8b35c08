"""A joint of two points, which keep their relative position."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .constraint import Constraint, Equation


@dataclass(frozen=True, eq=False)
class PointJoint(Constraint):
    """A ball joint between two points, which keep the difference x1 - x0 of the start.

    Formula: x1 - x0 = x1 - x0 at the start. It has a reaction for each dimension: the components of the force on x1, N.

    Notes
    -----
    Other codes: MuJoCo ``equality/connect``; exudyn ``SphericalJoint``; OpenSees ``equalDOF`` on the translations;
    Modelica ``Joints.Spherical``. Here the constraint holds to round-off.

    Not included: friction and play in the joint.
    """

    needs = ()
    source = "phi = x1 - x0 - (x1 - x0 at the start)"

    def equations(self, points: list[np.ndarray], values: dict[str, Any]) -> list[Equation]:
        way, axes = (np.array([-1.0, 1.0]), np.zeros(len(points[0]))), np.eye(len(points[0]))
        return [Equation(way, (np.zeros(2), axis), 1.0, float(axis @ (points[1] - points[0]))) for axis in axes]
