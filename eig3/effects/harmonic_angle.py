"""A spring of an angle."""

from __future__ import annotations

import math
from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from .angle import Angle


@dataclass(frozen=True, eq=False)
class HarmonicAngle(Angle):
    """A linear spring of the angle of three points, such as that between two bonds of a molecule.

    Parameters
    ----------
    stiffness : float or array_like
        N m/rad.
    angle : float or array_like
        The angle without a torque, rad.

    Raises
    ------
    ValueError
        For stiffness or angle below 0, or an angle above pi.
    """

    stiffness: ArrayLike
    angle: ArrayLike

    nonnegative = ("stiffness", "angle")
    source = "Hooke; angle bending of molecular mechanics"

    def __post_init__(self):
        super().__post_init__()
        self.require(self._reals("angle") <= math.pi, "angle must not be above pi")

    @staticmethod
    @element
    def torque(theta, stiffness, angle):
        return stiffness * (theta - angle)

    @staticmethod
    @element
    def potential(theta, stiffness, angle):
        return stiffness / 2 * (theta - angle) ** 2
