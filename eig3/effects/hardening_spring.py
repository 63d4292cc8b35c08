"""A spring with a cubic term, as in Duffing's equation."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Link


@dataclass(frozen=True, eq=False)
class HardeningSpring(Link):
    """A spring whose tension at the stretch d is S1 d (1 + S2 d^2).

    Parameters
    ----------
    S1 : float or array_like
        Stiffness at rest, N/m.
    S2 : float or array_like
        1/m^2; a negative value makes the spring soften.
    length : float or array_like
        Natural length, m.

    Raises
    ------
    ValueError
        For S1 or length below 0.
    """

    S1: ArrayLike
    S2: ArrayLike
    length: ArrayLike = 0.0

    nonnegative = ("S1", "length")
    source = "EIG-3 article, section 4.2"
    picture = "spring"

    @staticmethod
    @element
    def tension(r, S1, S2, length):
        d = r - length
        return S1 * d * (1 + S2 * d * d)

    @staticmethod
    @element
    def potential(r, S1, S2, length):
        square = (r - length) * (r - length)
        return S1 / 2 * square * (1 + S2 / 2 * square)
