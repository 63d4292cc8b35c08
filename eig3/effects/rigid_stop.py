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

    Formula: at the plane, the velocity v_n along the normal becomes -restitution v_n, and the velocity along the plane
    stays (Newton's law). An impact at rest_speed or below loses no speed, and a faster impact leaves at least
    rest_speed.

    An impact is an event: the run finds its time, and ``solution.events["rigid stop 0"]`` has the velocities before and
    after. `PlaneContact` is a contact force, which needs steps much shorter than the contact.

    Parameters
    ----------
    normal : array_like, shape (dimension,)
        A unit vector.
    offset : float or array_like
        m.
    restitution : float or array_like
        Coefficient of restitution: the speed after an impact divided by the speed before it, from 0 to 1.
    rest_speed : float or array_like
        An impact at this speed or below loses no speed, and a faster impact leaves at least this speed, m/s. A mass
        that is pressed against the stop keeps bouncing at this speed, in place of rest.

    Raises
    ------
    ValueError
        For a normal that is not a unit vector, a restitution below 0 or above 1, a rest_speed that is not positive, or
        a mass that does not start on the free side.

    Notes
    -----
    Other codes: with the restitution 1, LAMMPS ``fix wall/reflect``, which reflects atoms at the end of a step. MuJoCo,
    OpenSees and OpenMM have contact forces or soft constraints instead.

    Not included: friction in the impact, and rest in contact: a mass that rests keeps bouncing at rest_speed.
    """

    normal: ArrayLike
    offset: ArrayLike = 0.0
    restitution: ArrayLike = 0.5
    rest_speed: ArrayLike = 1e-2

    vectors = ("normal",)
    nonnegative = ("restitution",)
    crossing = -1
    at_start = "offset must leave each mass on the free side at the start"
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
        self.require(above > 0, self.at_start)

    @staticmethod
    @element
    def event(x, normal, offset):
        return dot(normal, x) - offset

    @staticmethod
    @element
    def velocity_after(v, normal, restitution, rest_speed):
        rate = dot(normal, v)
        return add(v, scale(rebound(rate, restitution, rest_speed) - rate, normal))
