"""The accelerations in a rotating frame."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Body
from .vector import add, cross, dot, scale


@dataclass(frozen=True, eq=False)
class RotatingFrame(Body):
    """Coriolis and centrifugal acceleration in a frame that rotates steadily about its origin.

    Formula: acceleration = -2 rate x v - rate x (rate x x); energy = -m / 2 |rate x x|^2.

    EIG-3, RK2 and AB2 add energy to such motions numerically, slowly if the step is short. For runs of many
    revolutions, use RK4 or central difference.

    Parameters
    ----------
    rate : array_like, shape (1,) or (3,)
        Angular velocity, rad/s: one number in a plane, a vector in space.

    Notes
    -----
    Other codes: LAMMPS, OpenMM, OpenSees and MuJoCo have none; in LAMMPS, ``fix addforce`` with atom-style variables of
    x and v gives these forces.

    Not included: an angular acceleration of the frame (Euler's force), and a moving origin.
    """

    rate: ArrayLike

    dimensions = (2, 3)
    vectors = ("rate",)
    source = "Coriolis (1835)"

    def components(self, vector: str, dimension: int) -> int:
        return 1 if dimension == 2 else 3

    @staticmethod
    @element
    def acceleration(x, v, rate):
        return scale(-1.0, add(scale(2.0, cross(rate, v)), cross(rate, cross(rate, x))))

    @staticmethod
    @element
    def potential(x, m, rate):
        across = cross(rate, x)
        return -m / 2 * dot(across, across)
