"""A joint of two points, which keep their relative position."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .constraint import Constraint, Equation


@dataclass(frozen=True, eq=False)
class PointJoint(Constraint):
    """Two points whose difference x1 - x0 stays as at the start, such as coincident points of two bodies in a joint.

    The reactions are the components of the force on x1, N.
    """

    needs = ()
    source = "phi = x1 - x0 - (x1 - x0 at the start)"

    def equations(self, points: list[np.ndarray], values: dict[str, Any]) -> list[Equation]:
        way, axes = (np.array([-1.0, 1.0]), np.zeros(len(points[0]))), np.eye(len(points[0]))
        return [Equation(way, (np.zeros(2), axis), 1.0, float(axis @ (points[1] - points[0]))) for axis in axes]
