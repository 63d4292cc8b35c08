"""An actuator: two points whose distance is a function of time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numba
import numpy as np
from numba.types import unliteral

from ..scene.constraint import Constraint, Equation
from ..scene.effect import REAL


@dataclass(frozen=True, eq=False)
class Actuator(Constraint):
    """Two points whose distance is a function of time.

    Its reaction is the force with which it pushes its ends apart, N, times the ratio of the distance to that at the
    start.

    Parameters
    ----------
    length : jitted function
        ``length(t) -> (length, rate, acceleration)`` in m, m/s and m/s^2.
    """

    length: Callable

    offers: ClassVar[dict[str, tuple[str, ...]]] = {"length": ("t",)}
    needs = ("length",)
    source = "phi = (|x1 - x0|^2 - length(t)^2) / (2 |x1 - x0| at the start)"

    def equations(self, points: list[np.ndarray], values: dict[str, Any]) -> list[Equation]:
        way = np.array([-1.0, 1.0]), np.zeros(len(points[0]))
        length = float(np.linalg.norm(points[1] - points[0]))
        return [Equation(way, way, 1 / (2 * length), length * length)]

    def check_points(
        self, masses: list[np.ndarray], positions: list[np.ndarray], columns: dict[str, np.ndarray]
    ) -> None:
        super().check_points(masses, positions, columns)
        if (positions[0] == positions[1]).all(axis=-1).any():
            raise ValueError(f"{self.title} has no direction where its ends coincide at the start: put them apart.")

    def _check_returned(self, name: str, returned: Any, dimension: int) -> None:
        parts = list(returned) if isinstance(returned, numba.types.BaseTuple) else []
        if len(parts) != 3 or not all(isinstance(unliteral(part), REAL) for part in parts):
            raise TypeError(f"{name} of {self.title} must return a tuple of 3 numbers: length, rate and acceleration.")
