"""A torque on a rigid body that depends on the time, or on how the body turns."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

from numba.types import BaseTuple, unliteral

from ..functions.callbacks import jit
from ..scene.body_torque import BodyTorque
from ..scene.effect import REAL, Body, Effect, arguments
from ..scene.hinge_motor import HingeMotor
from ..scene.joint_law import HingeLaw
from .vector import cross, scale, vector


@dataclass(frozen=True, eq=False)
class Motor(BodyTorque):
    """A torque on a rigid body that is a function of time, or also of the angle and its rate.

    Formula: torque(t), or torque(t, angle, rate), on the axes of one body: ``scene.add(Motor(torque), body.axes)``. The
    body reacts on the ground.

    In the plane, a torque can depend on the angle by which the body has turned since the start and on its rate, such as
    the torque of a controller. `RigidBody.motor` is a motor between two bodies, and about an axis in space.

    Parameters
    ----------
    torque : jitted function
        ``torque(t)`` in N m: a number in the plane, and in space a tuple, in the frame of the scene. Or
        ``torque(t, angle, rate)`` with the angle from -pi to pi, rad, and rad/s.

    Raises
    ------
    TypeError
        If the torque is no such function, and by `Scene.add` for other points than the axes of one body.

    Notes
    -----
    Other codes: MuJoCo ``actuator/motor`` with a control that a callback sets; exudyn ``LoadTorqueVector`` with a user
    function; Modelica ``Forces.WorldTorque``.

    Not included: limits of torque and speed, a gear ratio, and the inertia of a rotor: write them into the function or
    the body.
    """

    torque: Callable

    offers: ClassVar[dict[str, tuple[str, ...]]] = {"torque": ("t",), **Body.offers}

    def __post_init__(self) -> None:
        if not callable(self.torque):
            raise TypeError("torque of Motor must be a jitted function of t; for a constant torque, take a Torque.")
        super().__post_init__()

    @property
    def force(self) -> Any:
        return _force(self.torque)

    def resolved(self, points: tuple[Any, ...]) -> tuple[Effect, tuple[Any, ...]]:
        """Return the motor against the ground that a torque with an angle stands for."""
        reads_angle = hasattr(self.torque, "py_func") and len(arguments(self.torque)) > 1
        if not reads_angle or [hasattr(axes, "across") for axes in points] != [True]:
            return self, points
        (axes,) = points
        if axes.scene.dimension == 3:
            raise TypeError("torque of Motor has an angle, which needs an axis in space: take body.motor(None, ...).")
        return HingeLaw(HingeMotor(self.torque)), axes.across()

    def _check_returned(self, name: str, returned: Any, dimension: int) -> None:
        if name == "torque":
            parts = list(returned) if isinstance(returned, BaseTuple) else [returned]
            if len(parts) != (1 if dimension == 2 else 3) or not all(isinstance(unliteral(x), REAL) for x in parts):
                raise TypeError("torque of Motor must return a number in the plane, and in space a tuple of 3 numbers.")
        else:
            super()._check_returned(name, returned, dimension)


@functools.cache
def _force(torque: Any) -> Any:
    """Return one function for each torque, because scenes with the same functions share their code."""

    @jit
    def force(t, x):
        return scale(0.5, cross(vector(torque(t)), x))

    return force
