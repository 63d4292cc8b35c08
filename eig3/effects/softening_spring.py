"""A spring whose force levels off."""

import math
from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.jit import element
from ..scene.effect import Link


@dataclass(frozen=True, eq=False)
class SofteningSpring(Link):
    """A spring that pulls with S d_0 tanh(d / d_0) where it is stretched by d.

    Parameters
    ----------
    S : float or array_like
        Stiffness at rest, N/m.
    width : float or array_like
        The stretch d_0 beyond which the force levels off, m.
    length : float or array_like
        Natural length, m.
    """

    S: ArrayLike
    width: ArrayLike = 1.0
    length: ArrayLike = 0.0

    source = "EIG-3 article, section 4.3, after Xie"

    @staticmethod
    @element
    def tension(r, S, width, length):
        return S * width * math.tanh((r - length) / width)

    @staticmethod
    @element
    def potential(r, S, width, length):
        d = abs(r - length) / width
        return S * width * width * (d + math.log1p(math.exp(-2 * d)) - math.log(2.0))  # ln cosh d, without overflow
