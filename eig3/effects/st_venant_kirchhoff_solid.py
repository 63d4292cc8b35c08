"""An elastic solid of small strain and large rotation."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from .isotropic import Isotropic, lame
from .tetrahedron import combined
from .vector import dot


@element
def strain(F):
    """Return the components 11, 22, 33, 12, 23 and 13 of Green's strain."""
    f, g, h = F
    return (
        (dot(f, f) - 1) / 2,
        (dot(g, g) - 1) / 2,
        (dot(h, h) - 1) / 2,
        dot(f, g) / 2,
        dot(g, h) / 2,
        dot(f, h) / 2,
    )


@dataclass(frozen=True, eq=False)
class StVenantKirchhoffSolid(Isotropic):
    """A tetrahedron of an isotropic elastic solid, for large rotations and small strain.

    Formula: S = lambda tr(e) I + 2 mu e with Green's strain e = (F^T F - I) / 2 and Lame's constants of E and nu; the
    stress is F S.

    A cell that is pressed to 58 % of its length gets softer, and a cell that inverts has finite forces.

    Parameters
    ----------
    E : float or array_like
        Young's modulus for small strain, Pa.
    nu : float or array_like
        Poisson's ratio for small strain.

    Raises
    ------
    ValueError
        For E below 0, or nu not between -1 and 0.5.

    Notes
    -----
    Other codes: for small displacements, OpenSees ``element FourNodeTetrahedron`` with ``nDMaterial ElasticIsotropic``.
    LAMMPS and OpenMM have no such element.

    Not included: large strain (`NeoHookean`), viscosity, plasticity, and nearly incompressible elements.
    """

    E: ArrayLike
    nu: ArrayLike

    source = "constant-strain tetrahedron of St Venant-Kirchhoff's material"

    @staticmethod
    @element
    def stress(F, E, nu):
        first, shear = lame(E, nu)
        e11, e22, e33, e12, e23, e13 = strain(F)
        pressure = first * (e11 + e22 + e33)
        s12, s23, s13 = 2 * shear * e12, 2 * shear * e23, 2 * shear * e13
        return (
            combined((pressure + 2 * shear * e11, s12, s13), F[0], F[1], F[2]),
            combined((s12, pressure + 2 * shear * e22, s23), F[0], F[1], F[2]),
            combined((s13, s23, pressure + 2 * shear * e33), F[0], F[1], F[2]),
        )

    @staticmethod
    @element
    def potential(F, E, nu):
        first, shear = lame(E, nu)
        e11, e22, e33, e12, e23, e13 = strain(F)
        squares = e11 * e11 + e22 * e22 + e33 * e33 + 2 * (e12 * e12 + e23 * e23 + e13 * e13)
        return first / 2 * (e11 + e22 + e33) ** 2 + shear * squares
