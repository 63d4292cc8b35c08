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

    They strike each other where their distance is `reach`. An impact multiplies the speed along the line through them
    by the restitution and keeps their momentum. It is an event: the run finds its time, and
    ``solution.events["mass impact 0"]`` has the velocities before and after. Each pair has an event of its own, which
    is looked at in every step: for contacts between thousands of pairs take `MassContact`.

    Parameters
    ----------
    reach : float or array_like
        The distance at which they touch, the sum of the two radii, m; positive in two and three dimensions.
    restitution : float or array_like
        The speed after an impact as a part of the speed before it, from 0 to 1.
    slow : float or array_like
        The speed from which on an impact loses no more, m/s, as for `RigidStop`.

    Raises
    ------
    ValueError
        For a reach or restitution below 0, a restitution above 1, a slow that is not positive, a reach of 0 in two or
        three dimensions, or points that are not further apart than the reach at the start.
    """

    reach: ArrayLike = 0.0
    restitution: ArrayLike = 0.5
    slow: ArrayLike = 1e-2

    nonnegative = ("reach", "restitution")
    crossing = -1
    source = "Newton's law of restitution"
    picture = "discs"

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require(self._reals("restitution") <= 1, "restitution must not be above 1")
        self.require(self._reals("slow") > 0, "slow must be positive")

    def check(self, dimension):
        super().check(dimension)
        if dimension > 1:
            self.require(self._reals("reach") > 0, "reach must be positive in a scene of two or three dimensions")

    def check_points(self, masses, positions, columns):
        super().check_points(masses, positions, columns)
        self.require(distance(positions) > columns["reach"], "reach must be below the distance at the start")

    @staticmethod
    @element
    def event(r, reach):
        return r - reach

    @staticmethod
    @element
    def rate_after(rate, restitution, slow):
        return rebound(rate, restitution, slow)
