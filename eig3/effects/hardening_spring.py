"""A spring with a cubic term, as in Duffing's equation."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Link


@dataclass(frozen=True, eq=False)
class HardeningSpring(Link):
    """A spring with a cubic term, as in Duffing's equation.

    Formula: tension = stiffness d (1 + cubic d^2) at the stretch d = r - rest_length; energy = stiffness / 2 d^2 (1 +
    cubic / 2 d^2). The article of EIG-3 calls the stiffness S1 and the cubic coefficient S2.

    Parameters
    ----------
    stiffness : float or array_like
        At rest, N/m.
    cubic : float or array_like
        1/m^2; a negative value makes the spring soften.
    rest_length : float or array_like
        m.

    Raises
    ------
    ValueError
        For stiffness or rest_length below 0.

    Notes
    -----
    Other codes: LAMMPS ``bond_style class2`` with K2 = stiffness / 2, K3 = 0 and K4 = stiffness cubic / 4; OpenMM: a
    ``CustomBondForce``.

    Not included: damping: add a `LinearDamper`.
    """

    stiffness: ArrayLike
    cubic: ArrayLike
    rest_length: ArrayLike = 0.0

    nonnegative = ("stiffness",)
    source = "EIG-3 article, section 4.2"
    picture = "spring"

    @staticmethod
    @element
    def tension(r, stiffness, cubic, rest_length):
        d = r - rest_length
        return stiffness * d * (1 + cubic * d * d)

    @staticmethod
    @element
    def potential(r, stiffness, cubic, rest_length):
        square = (r - rest_length) * (r - rest_length)
        return stiffness / 2 * square * (1 + cubic / 2 * square)
