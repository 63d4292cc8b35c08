"""A motor in the hinge between two bodies, whose torque depends on the time, the angle and its rate."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

from ..functions.callbacks import jit
from ..kernels.friction import couple_in_plane, couple_in_space, rate_in_plane, rate_in_space
from ..kernels.vector_angle import angle_in_plane, angle_in_space
from .cell import Cell
from .effect import Effect, arguments


@dataclass(frozen=True, eq=False)
class HingeMotor(Cell):
    """A torque between two bodies, which have the vectors x0 and x1 in the plane."""

    torque: Callable

    takes = (2,)
    dimensions = (2,)
    offers: ClassVar[dict[str, tuple[str, ...]]] = {"torque": ("t", "angle", "rate"), **Cell.offers}
    source = "prescribed by the user"

    @property
    def title(self) -> str:
        return "Motor"

    @property
    def forces(self) -> Any:
        return _in_plane(self.torque, len(arguments(self.torque)))

    def check(self, dimension: int) -> None:
        if not hasattr(self.torque, "py_func") or arguments(self.torque) not in (("t",), ("t", "angle", "rate")):
            raise TypeError("torque of Motor must be a jitted function of t, or of t, angle and rate.")
        super().check(dimension)

    def _check_returned(self, name: str, returned: Any, dimension: int) -> None:
        check = Effect._check_returned if name == "torque" else Cell._check_returned
        check(self, name, returned, dimension)


@dataclass(frozen=True, eq=False)
class HingeMotorInSpace(HingeMotor):
    """A torque about the unit vector x2 of the second body, which is perpendicular to x0 and x1."""

    takes = (3,)
    dimensions = (3,)

    @property
    def forces(self) -> Any:
        return _in_space(self.torque, len(arguments(self.torque)))


@functools.cache
def _in_plane(torque: Any, count: int) -> Any:
    """Return the same function for the same torque: scenes with the same functions share their code."""

    @jit
    def of_time(t, x):  # type: ignore[no-untyped-def]
        return couple_in_plane(x, torque(t))

    @jit
    def of_angle(t, x, v):  # type: ignore[no-untyped-def]
        return couple_in_plane(x, torque(t, angle_in_plane(x[0], x[1]), rate_in_plane(x, v)))

    return of_time if count == 1 else of_angle


@functools.cache
def _in_space(torque: Any, count: int) -> Any:
    @jit
    def of_time(t, x):  # type: ignore[no-untyped-def]
        return couple_in_space(x, torque(t))

    @jit
    def of_angle(t, x, v):  # type: ignore[no-untyped-def]
        return couple_in_space(x, torque(t, angle_in_space(x[0], x[1], x[2]), rate_in_space(x, v)))

    return of_time if count == 1 else of_angle
