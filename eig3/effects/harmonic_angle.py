"""A torsional spring of the angle of three points."""

from __future__ import annotations

import math
from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from .angle import Angle


@dataclass(frozen=True, eq=False)
class HarmonicAngle(Angle):
    """A torsional spring of the angle of three points, such as the angle between two bonds of a molecule.

    Formula: torque = stiffness (theta - angle); energy = stiffness / 2 (theta - angle)^2.

    Parameters
    ----------
    stiffness : float or array_like
        N m/rad.
    angle : float or array_like
        The angle at which the torque is 0, rad.

    Raises
    ------
    ValueError
        For stiffness or angle below 0, or an angle above pi.

    Notes
    -----
    Other codes: OpenMM ``HarmonicAngleForce`` with k = stiffness; LAMMPS ``angle_style harmonic`` with K = stiffness /
    2 and the angle in degrees.

    Not included: the Urey-Bradley term of ``angle_style charmm``. Where the three points are in line, the force is 0.
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
