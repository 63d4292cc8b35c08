"""A weld: two rigid bodies that keep their relative position and orientation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .constraint import Constraint, Equation


@dataclass(frozen=True, eq=False)
class Weld(Constraint):
    """Two rigid bodies that move as one: ``scene.add(Weld(), body, other)``, or ``body.weld(other)``.

    Formula: the relative position and orientation stay as at the start. A single body is welded to the ground. The
    reactions act on the first body: the components of the force at its centre, N, and the torques, N m: one in the
    plane, and in space three, about its principal axes.

    Notes
    -----
    Other codes: MuJoCo ``equality/weld``; OpenSees ``rigidLink beam``; LAMMPS ``fix rigid``; Modelica
    ``Parts.FixedTranslation``. Here the constraint holds to round-off.

    Not included: elasticity of the weld: for that join points by springs.
    """

    needs = ()
    takes = (6, 8)
    dimensions = (2, 3)
    picture = ""
    source = "phi = x1 - x0, and the products e_i . f_j of axes of both bodies, which are at right angles at the start"

    def resolved(self, points: tuple[Any, ...]) -> tuple[Weld, tuple[Any, ...]]:
        if not (0 < len(points) < 3 and all(hasattr(body, "principal") for body in points)):
            raise TypeError("Weld joins two rigid bodies, or one with the ground: scene.add(Weld(), body, other).")
        body, other = (*points, None)[:2]
        return self, body._points_of_weld(other)

    def equations(self, points: list[np.ndarray], values: dict[str, Any]) -> list[Equation]:
        """Return the conditions on a point of one body and the centre of the other, and on the axes of both."""
        d, count = len(points[0]), len(points)
        zero, unit = np.zeros(d), np.eye(count)
        way = unit[1] - unit[0], zero
        conditions = [Equation(way, (np.zeros(count), axis), 1.0, 0.0) for axis in np.eye(d)]
        pairs = [(2, 1), (0, 2), (1, 0)] if d == 3 else [(1, 0)]
        return conditions + [Equation((unit[2 + i], zero), (unit[2 + d + j], zero), 1.0, 0.0, "N m") for i, j in pairs]
