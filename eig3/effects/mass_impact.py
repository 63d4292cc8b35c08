"""Impacts between two rigid masses."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Link, distance
from .restitution import rebound


@dataclass(frozen=True, eq=False)
class MassImpact(Link):
    """Impacts between two masses, or between a mass and a support, which may move.

    Formula: where r = contact_distance, the rate r' of the distance becomes -restitution r', and the momentum stays
    (Newton's law). An impact at rest_speed or below loses no speed, and a faster impact leaves at least rest_speed.

    An impact is an event: the run finds its time, and ``solution.events["mass impact 0"]`` has the velocities before
    and after. Each pair has an event, which every step tests: for contacts between thousands of pairs take
    `HertzContact`.

    Parameters
    ----------
    contact_distance : float or array_like
        The distance at which they touch, the sum of the two radii, m; positive in two and three dimensions.
    restitution : float or array_like
        Coefficient of restitution: the speed after an impact divided by the speed before it, from 0 to 1.
    rest_speed : float or array_like
        The speed below which an impact loses no speed, m/s, as for `RigidStop`.

    Raises
    ------
    ValueError
        For a contact_distance or restitution below 0, a restitution above 1, a rest_speed that is not positive, a
        contact_distance of 0 in two or three dimensions, or points that are at contact_distance or nearer at the start.

    Notes
    -----
    Other codes: the hard spheres of event-driven molecular dynamics. LAMMPS, OpenMM, OpenSees and MuJoCo have contact
    forces or soft constraints instead.

    Not included: friction and spin in the impact, and rest in contact: a mass that rests keeps bouncing at rest_speed.
    """

    contact_distance: ArrayLike = 0.0
    restitution: ArrayLike = 0.5
    rest_speed: ArrayLike = 1e-2

    nonnegative = ("contact_distance", "restitution")
    crossing = -1
    cutoff_field = "contact_distance"
    at_start = "contact_distance must be below the distance at the start"
    source = "Newton's law of restitution"
    picture = "discs"

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require(self._reals("restitution") <= 1, "restitution must not be above 1")
        self.require(self._reals("rest_speed") > 0, "rest_speed must be positive")

    def check(self, dimension):
        super().check(dimension)
        if dimension > 1:
            self.require(
                self._reals("contact_distance") > 0,
                "contact_distance must be positive in a scene of two or three dimensions",
            )

    def check_points(self, masses, positions, columns):
        super().check_points(masses, positions, columns)
        self.require(distance(positions) > columns["contact_distance"], self.at_start)

    @staticmethod
    @element
    def event(r, contact_distance):
        return r - contact_distance

    @staticmethod
    @element
    def rate_after(rate, restitution, rest_speed):
        return rebound(rate, restitution, rest_speed)
