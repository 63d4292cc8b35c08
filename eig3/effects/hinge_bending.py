"""The bending of thin sheets."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from .bending import Bending


@dataclass(frozen=True, eq=False)
class HingeBending(Bending):
    """The elastic bending of a sheet of triangles: a hinge at each edge between two of them.

    The energy of a hinge is rigidity / 2 edge^2 / area (theta - rest_angle)^2, with the area of both triangles at rest.
    In a mesh of equilateral triangles this is the energy of a plate of this rigidity and the Poisson ratio 1/3, for
    small curvatures in any direction. In another mesh the rigidity is that of the plate up to a factor of the order 1.

    Parameters
    ----------
    rigidity : float or array_like
        The bending rigidity of the sheet, N m: E thickness^3 / (12 (1 - nu^2)) if the sheet is homogeneous.

    Raises
    ------
    ValueError
        For rigidity below 0.
    """

    rigidity: ArrayLike

    nonnegative = ("rigidity",)
    source = "discrete shells of Grinspun, Hirani, Desbrun and Schroeder (2003)"

    @staticmethod
    @element
    def torque(theta, rest_angle, aspect, rigidity):
        return rigidity * aspect * (theta - rest_angle)

    @staticmethod
    @element
    def potential(theta, rest_angle, aspect, rigidity):
        return rigidity / 2 * aspect * (theta - rest_angle) ** 2
