"""An elastic membrane."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from .triangle import Triangle
from .vector import add, dot, scale


@element
def strain(F):
    """Return the components 11, 22 and 12 of Green's strain."""
    return (dot(F[0], F[0]) - 1) / 2, (dot(F[1], F[1]) - 1) / 2, dot(F[0], F[1]) / 2


@dataclass(frozen=True, eq=False)
class StVenantKirchhoffMembrane(Triangle):
    """A triangle of an isotropic elastic membrane or plate in plane stress, for large rotations and small strain.

    Formula: S = E / (1 - nu^2) ((1 - nu) e + nu tr(e) I) with Green's strain e = (F^T F - I) / 2; the stress is F S,
    and the energy is the integral of tr(S e) / 2 over the area times the thickness.

    A triangle that is pressed to 58 % of its length gets softer, and a triangle that inverts has finite forces. For
    plane strain, pass E / (1 - nu^2) as E and nu / (1 - nu) as nu.

    Parameters
    ----------
    E : float or array_like
        Young's modulus, Pa.
    nu : float or array_like
        Poisson's ratio.
    thickness : float or array_like
        m; in a scene of two dimensions, its depth.

    Raises
    ------
    ValueError
        For E below 0, nu not between -1 and 1, or a thickness that is not positive.

    Notes
    -----
    Other codes: for small displacements, OpenSees ``element Tri31`` with ``PlaneStress``. LAMMPS and OpenMM have no
    such element.

    Not included: bending (`HingeBending`), wrinkling, and large strain.
    """

    E: ArrayLike
    nu: ArrayLike
    thickness: ArrayLike

    nonnegative = ("E",)
    source = "constant-strain triangle of St Venant-Kirchhoff's material in plane stress"

    def __post_init__(self):
        super().__post_init__()
        self.require(abs(self._reals("nu")) < 1, "nu must be between -1 and 1")

    @staticmethod
    @element
    def stress(F, E, nu):
        e11, e22, e12 = strain(F)
        plane = E / (1 - nu * nu)
        s11, s22, s12 = plane * (e11 + nu * e22), plane * (e22 + nu * e11), E / (1 + nu) * e12
        return add(scale(s11, F[0]), scale(s12, F[1])), add(scale(s12, F[0]), scale(s22, F[1]))

    @staticmethod
    @element
    def potential(F, E, nu):
        e11, e22, e12 = strain(F)
        plane = E / (1 - nu * nu)
        return plane / 2 * (e11 * e11 + e22 * e22 + 2 * nu * e11 * e22) + E / (1 + nu) * e12 * e12
