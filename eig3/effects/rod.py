"""A rod: two points at a constant distance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..scene.constraint import Constraint, Equation
from ..scene.effect import Arrays, Columns


class OfDistance(Constraint):
    """Two points at a given distance."""

    def equations(self, points: list[np.ndarray], values: dict[str, Any]) -> list[Equation]:
        way = np.array([-1.0, 1.0]), np.zeros(len(points[0]))
        length = float(values.get("length", np.linalg.norm(points[1] - points[0])))
        return [Equation(way, way, 1 / (2 * length), length * length)]

    def check_points(self, masses: Arrays, positions: Arrays, columns: Columns) -> None:
        super().check_points(masses, positions, columns)
        if (positions[0] == positions[1]).all(axis=-1).any():
            raise ValueError(f"{self.title} has no direction where its ends coincide: take a PointJoint, or one point.")


@dataclass(frozen=True, eq=False)
class Rod(OfDistance):
    """A rigid rod without mass: two points whose distance stays constant.

    Formula: |x1 - x0| = length. The reaction is the force with which the rod pushes its ends apart, N: its tension is
    minus the reaction.

    Parameters
    ----------
    length : float or array_like, optional
        m. By default the distance at the start.

    Raises
    ------
    ValueError
        If a length is not positive.

    Notes
    -----
    Other codes: exudyn ``ObjectConnectorDistance``; Modelica ``Joints.SphericalSpherical``; OpenMM
    ``System.addConstraint``; LAMMPS ``fix rattle``. Here the constraint holds to round-off in positions and velocities.

    Not included: the mass of the rod: take a rigid body with two joints.
    """

    length: ArrayLike | None = None

    needs: ClassVar[tuple[str, ...]] = ()
    source = "phi = (|x1 - x0|^2 - length^2) / (2 length)"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.length is not None:
            self.require(self._reals("length") > 0, "length must be positive")
