"""The torsion of chains of hydrocarbons."""

from __future__ import annotations

import math
from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from .dihedral import Dihedral


@dataclass(frozen=True, eq=False)
class RyckaertBellemans(Dihedral):
    """A torsion whose energy is a polynomial of the cosine of the dihedral angle.

    Formula: energy = c0 + c1 cos psi + ... + c5 cos^5 psi, with psi = phi - pi, which is 0 in trans.

    Parameters
    ----------
    coefficients : array_like, shape (6,) or (..., 6)
        c0 to c5, J.

    Notes
    -----
    Other codes: OpenMM ``RBTorsionForce`` with the same coefficients; LAMMPS ``dihedral_style nharmonic`` with n = 6
    and the coefficients (-1)^k c_k, because it has the cosine of phi.

    Not included: scaled interactions of the first and the fourth point (1-4): see ``exclude_bonded`` of `Scene.add`.
    """

    coefficients: ArrayLike

    vectors = ("coefficients",)
    source = "Ryckaert and Bellemans (1975)"

    def components(self, vector, dimension):
        return 6

    @staticmethod
    @element
    def torque(phi, coefficients):
        c, x = coefficients, -math.cos(phi)
        slope = c[1] + x * (2 * c[2] + x * (3 * c[3] + x * (4 * c[4] + x * 5 * c[5])))
        return math.sin(phi) * slope

    @staticmethod
    @element
    def potential(phi, coefficients):
        c, x = coefficients, -math.cos(phi)
        return c[0] + x * (c[1] + x * (c[2] + x * (c[3] + x * (c[4] + x * c[5]))))
