"""The base class of constraints: conditions on positions that hold exactly, enforced by reactions."""

from __future__ import annotations

import dataclasses
from typing import Any, ClassVar, NamedTuple

import numba
import numpy as np
from numba.types import unliteral

from .effect import REAL, Arrays, Columns, Effect, arguments

#: The imaginary part for the complex-step derivative of phi: its square is negligible relative to 1.
TINY = 1e-100

_POINTS = ("x0", "x1", "x2", "x3")


class Equation(NamedTuple):
    """A condition scale (D . E - target) = 0 on the points of a constraint.

    Attributes
    ----------
    first, second : (sequence of float, ndarray)
        D and E: a factor for each point, and a constant vector. For D = E, `second` is `first`.
    scale, target : float
    unit : str
        The unit of the reaction: "N" for a condition on a length, "N m" for a condition without a unit.
    """

    first: tuple[Any, np.ndarray]
    second: tuple[Any, np.ndarray]
    scale: float = 1.0
    target: float = 0.0
    unit: str = "N"


class Constraint(Effect):
    """A condition on the positions of points.

    A class has ``phi``; the condition is phi = 0. Its arguments can be the positions of the points, x0, x1, x2 and x3
    as tuples, and fields. A class may have ``gradient``, a tuple with the derivatives of phi with respect to the
    components of x0, then of x1, and so on. Without it, the derivatives are computed by the complex-step method, exact
    to round-off: phi then must not take absolute values, or compare numbers. The force on a point is the gradient times
    the Lagrange multiplier of the constraint, which is its reaction::

        @dataclass(frozen=True, eq=False)
        class OnCircle(eig3.effects.Constraint):
            radius: ArrayLike

            takes = (1,)

            @staticmethod
            @eig3.jit
            def phi(x0, radius):
                return (x0[0] * x0[0] + x0[1] * x0[1]) / (2 * radius) - radius / 2

    Scale phi to a dimensionless gradient of size near 1: its value is then a length, and its reaction a force.

    A class may also have ``target``, a function of t that returns a value with its rate and acceleration: the
    condition is then phi = target. It may be a field.

    Attributes
    ----------
    takes : tuple of int
        A tuple with the number of points, from 1 to 4.
    period : float
        The period of phi if it is an angle, such as 2 pi for ``atan2``; 0 if phi has no period.
    """

    offers: ClassVar[dict[str, tuple[str, ...]]] = {
        "phi": _POINTS,
        "gradient": _POINTS,
        "target": ("t",),
    }
    period: ClassVar[float] = 0.0
    needs: ClassVar[tuple[str, ...]] = ("phi",)
    takes: ClassVar[tuple[int, ...]] = (2,)
    picture: ClassVar[str] = "line"

    def equations(self, points: list[np.ndarray], values: dict[str, Any]) -> list[Equation]:
        """Return the conditions on one member, for a constraint that has no `phi`.

        Parameters
        ----------
        points : list of ndarray, shape (dimension,)
            The positions of its points at the start.
        values : dict of str to float or ndarray
            The fields of this member.
        """
        raise NotImplementedError

    def reads_velocity(self) -> bool:
        return True

    def check_points(self, masses: Arrays, positions: Arrays, columns: Columns) -> None:
        if np.all([m == 0 for m in masses], axis=0).any():
            raise ValueError(f"{self.title} joins fixed points only, which do not move.")

    def _read(self) -> list[str]:
        known = [field.name for field in dataclasses.fields(self)]  # type: ignore[arg-type]
        return [name for name in known if not callable(getattr(self, name, None)) and getattr(self, name) is not None]

    def _argument_types(self, name: str, dimension: int) -> dict[str, Any]:
        given = super()._argument_types(name, dimension)
        return given | dict.fromkeys(_POINTS, numba.types.UniTuple(numba.float64, dimension))

    def _check_returned(self, name: str, returned: Any, dimension: int) -> None:
        counts = {"gradient": self.takes[0] * dimension, "target": 3, "distance": 3}
        if name not in counts:
            super()._check_returned(name, returned, dimension)
            return
        parts = list(returned) if isinstance(returned, numba.types.BaseTuple) else []
        if len(parts) != counts[name] or not all(isinstance(unliteral(part), REAL) for part in parts):
            what = "" if name == "gradient" else ", a value with its rate and acceleration"
            raise TypeError(f"{name} of {self.title} must return a tuple of {counts[name]} numbers here{what}.")

    def check(self, dimension: int) -> None:
        super().check(dimension)
        for function in self.functions().values():
            for name in _POINTS[self.takes[0] :]:
                if name in arguments(function):
                    raise TypeError(f"{self.title} takes {self.takes[0]} points, and none with the name {name}.")
