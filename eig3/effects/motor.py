"""A torque on a rigid body that depends on the time."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

from numba.types import BaseTuple, unliteral

from ..functions.callbacks import jit
from ..scene.body_torque import BodyTorque
from ..scene.effect import REAL, Body
from .vector import cross, scale, vector


@dataclass(frozen=True, eq=False)
class Motor(BodyTorque):
    """A torque that is a function of time, on the axes of a rigid body: ``scene.add(Motor(torque), body.axes)``.

    Parameters
    ----------
    torque : jitted function
        ``torque(t)`` in N m: a number in the plane, and in space a tuple, in the frame of the scene.

    Raises
    ------
    TypeError
        If the torque is no such function, and by `Scene.add` for other points than the axes of one body.
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
