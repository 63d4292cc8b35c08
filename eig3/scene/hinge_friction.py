"""Friction in the hinge between two bodies."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.friction import friction_in_plane, friction_in_space
from .cell import Cell


@dataclass(frozen=True, eq=False)
class HingeFriction(Cell):
    """A torque against the relative rotation of two bodies, which have the vectors x0 and x1 in the plane.

    Raises
    ------
    ValueError
        For a limit or damping below 0, or a regularization_speed that is not positive.
    """

    limit: ArrayLike
    damping: ArrayLike
    regularization_speed: ArrayLike

    takes = (2,)
    dimensions = (2,)
    nonnegative = ("limit", "damping")
    source = "Coulomb (1785), regularised, and viscous friction"
    forces = staticmethod(friction_in_plane)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require(self._reals("regularization_speed") > 0, "regularization_speed must be positive")


@dataclass(frozen=True, eq=False)
class HingeFrictionInSpace(HingeFriction):
    """Hinge friction about the unit vector x2 of the second body, which is perpendicular to x0 and x1."""

    takes = (3,)
    dimensions = (3,)
    needs_hinge = True
    forces = staticmethod(friction_in_space)
