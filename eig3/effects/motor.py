"""A torque on a rigid body that depends on the time."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

from ..functions.callbacks import jit
from ..scene.effect import Body
from .vector import cross, scale, vector


@dataclass(frozen=True, eq=False)
class Motor(Body):
    """A torque that is a function of time, on the axes of a rigid body: ``scene.add(Motor(torque), body.axes)``.

    Parameters
    ----------
    torque : jitted function
        ``torque(t)`` in N m: a number in the plane, and in space a tuple, in the frame of the scene.
    """

    torque: Callable

    dimensions = (2, 3)
    source = "the forces torque(t) x e / 2 on the unit vectors e of the body"

    @property
    def force(self):
        return _force(self.torque)


@functools.cache
def _force(torque):
    """Return one function for each torque, because scenes with the same functions share their code."""

    @jit
    def force(t, x):
        return scale(0.5, cross(vector(torque(t)), x))

    return force
