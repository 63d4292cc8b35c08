"""The bending of thin sheets."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from .bending import Bending


@dataclass(frozen=True, eq=False)
class HingeBending(Bending):
    """The elastic bending of a sheet of triangles: a hinge at each edge between two triangles.

    Formula: energy = rigidity / 2 edge^2 / area (theta - rest_angle)^2 for each hinge, with the area of both triangles
    at rest.

    In a mesh of equilateral triangles this is the energy of a plate with this rigidity and the Poisson ratio 1/3, for
    small curvatures in any direction. In other meshes the rigidity of the plate differs by a factor of the order 1.

    Parameters
    ----------
    rigidity : float or array_like
        The bending rigidity of the sheet, N m: E thickness^3 / (12 (1 - nu^2)) if the sheet is homogeneous.

    Raises
    ------
    ValueError
        For rigidity below 0.

    Notes
    -----
    Other codes: LAMMPS ``dihedral_style quadratic`` on the corners of each hinge with K = rigidity edge^2 / (2 area);
    OpenMM: a ``CustomTorsionForce``. OpenSees and MuJoCo have other energies of bending.

    Not included: a Poisson ratio as a parameter, materials with a direction, and plastic bending.
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
