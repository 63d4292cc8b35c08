"""A slider: a point that stays on a straight line or in a plane."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..scene.constraint import Constraint, Equation


@dataclass(frozen=True, eq=False)
class Slider(Constraint):
    """A point that stays on a line along a direction, or in a plane across a normal.

    Formula: normal . (x - x at the start) = 0. A plane has one reaction, the force along the normal, N; a line in space
    has two, along two vectors that are perpendicular to it and to each other.

    Parameters
    ----------
    direction, normal : array_like, shape (dimension,), optional
        Vectors of any length.

    Raises
    ------
    TypeError, ValueError
        If both are given or none, or a vector is zero.

    Notes
    -----
    Other codes: LAMMPS ``fix lineforce`` and ``fix planeforce``, if the velocity at the start is along the line or
    plane. The prismatic joints of MuJoCo (``slide``), exudyn and Modelica are `RigidBody.prismatic`.

    Not included: stops at the ends (`RigidStop`) and friction (`CoulombFriction`).
    """

    direction: ArrayLike | None = None
    normal: ArrayLike | None = None

    needs = ()
    takes = (1,)
    dimensions = (2, 3)
    source = "phi = normal . (x - x at the start)"
    picture = ""

    def __post_init__(self) -> None:
        if (self.direction is None) == (self.normal is None):
            raise TypeError(f"{self.title} takes the direction of a line or the normal of a plane: give one of them.")
        super().__post_init__()
        name = "normal" if self.direction is None else "direction"
        self.require(np.any(self._reals(name), axis=-1), f"{name} must not be zero")

    @property
    def vectors(self) -> tuple[str, ...]:  # type: ignore[override]
        return ("normal",) if self.direction is None else ("direction",)

    def equations(self, points: list[np.ndarray], values: dict[str, Any]) -> list[Equation]:
        if "normal" in values:
            normals = [values["normal"] / np.linalg.norm(values["normal"])]
        else:
            normals = list(np.linalg.svd(values["direction"][None])[2][1:])
        place = np.array([1.0]), np.zeros(len(points[0]))
        return [Equation(place, (np.zeros(1), normal), 1.0, float(normal @ points[0])) for normal in normals]
