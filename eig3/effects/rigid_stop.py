"""Impacts of masses on a rigid plane."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Body
from .restitution import rebound
from .vector import add, dot, scale


@dataclass(frozen=True, eq=False)
class RigidStop(Body):
    """A rigid plane normal . x = offset that a mass strikes; the normal points to the free side.

    An impact multiplies the speed along the normal by the restitution and does not change the velocity along the plane.
    It is an event: the run finds its time, and ``solution.events["rigid stop 0"]`` has the velocities before and after.
    A force of contact, which needs steps much shorter than the contact, is `PlaneContact`.

    Parameters
    ----------
    normal : array_like, shape (dimension,)
        A unit vector.
    offset : float or array_like
        m.
    restitution : float or array_like
        The speed after an impact as a part of the speed before it, from 0 to 1.
    rest_speed : float or array_like
        An impact at this speed or below loses none of it, and a faster one leaves at least this speed, m/s. A mass that
        is pressed against the stop thus keeps bouncing at this speed, which stands for its rest.

    Raises
    ------
    ValueError
        For a normal that is not a unit vector, a restitution below 0 or above 1, a rest_speed that is not positive, or
        a mass that does not start on the free side.
    """

    normal: ArrayLike
    offset: ArrayLike = 0.0
    restitution: ArrayLike = 0.5
    rest_speed: ArrayLike = 1e-2

    vectors = ("normal",)
    nonnegative = ("restitution",)
    crossing = -1
    source = "Newton's law of restitution"
    picture = "plane"

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_unit("normal")
        self.require(self._reals("restitution") <= 1, "restitution must not be above 1")
        self.require(self._reals("rest_speed") > 0, "rest_speed must be positive")

    def check_points(self, masses, positions, columns):
        super().check_points(masses, positions, columns)
        above = (columns["normal"] * positions[0]).sum(axis=-1) - columns["offset"]
        self.require(above > 0, "offset must leave each mass on the free side at the start")

    @staticmethod
    @element
    def event(x, normal, offset):
        return dot(normal, x) - offset

    @staticmethod
    @element
    def velocity_after(v, normal, restitution, rest_speed):
        rate = dot(normal, v)
        return add(v, scale(rebound(rate, restitution, rest_speed) - rate, normal))
