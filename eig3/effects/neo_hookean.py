"""An elastic solid of large strain, such as rubber."""

from __future__ import annotations

import math
from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from .isotropic import Isotropic, lame
from .vector import add, dot, scale, turn


@dataclass(frozen=True, eq=False)
class NeoHookean(Isotropic):
    """A tetrahedron of a compressible neo-Hookean solid, such as rubber at large strain.

    Formula: energy per volume = mu / 2 (tr F^T F - 3) - mu ln J + lambda / 2 (ln J)^2, with J = det F and Lame's
    constants lambda and mu of E and nu. The stress is its derivative with respect to F.

    The energy grows without bound where a cell is pressed to nothing. If a step nevertheless inverts a cell, so that J
    is not positive, its stress is NaN and the run ends with the status DIVERGED: take a shorter step.

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
    Other codes: FEBio ``neo-Hookean``. LAMMPS, OpenMM and OpenSees have no such element.

    Not included: viscosity, plasticity, and nearly incompressible elements: constant-strain tetrahedra are too stiff
    (they lock) for nu near 0.5.
    """

    E: ArrayLike
    nu: ArrayLike

    source = "Bonet and Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, section 6.4.3"

    @staticmethod
    @element
    def stress(F, E, nu):
        first, shear = lame(E, nu)
        f, g, h = F
        normal = turn(g, h)
        J = dot(f, normal)
        s = (first * math.log(J) - shear) / J if J > 0 else math.nan
        return (
            add(scale(shear, f), scale(s, normal)),
            add(scale(shear, g), scale(s, turn(h, f))),
            add(scale(shear, h), scale(s, turn(f, g))),
        )

    @staticmethod
    @element
    def potential(F, E, nu):
        first, shear = lame(E, nu)
        f, g, h = F
        J = dot(f, turn(g, h))
        log = math.log(J) if J > 0 else math.nan
        return shear / 2 * (dot(f, f) + dot(g, g) + dot(h, h) - 3) + (first / 2 * log - shear) * log
