"""A spring whose force tends to a limit."""

from __future__ import annotations

import math
from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..math import tanh
from ..scene.effect import Link


@dataclass(frozen=True, eq=False)
class SofteningSpring(Link):
    """A spring whose tension at the stretch d is S d_0 tanh(d / d_0).

    Parameters
    ----------
    S : float or array_like
        Stiffness at rest, N/m.
    width : float or array_like
        The stretch d_0, m. At larger stretches the force tends to its limit S d_0.
    length : float or array_like
        Natural length, m.

    Raises
    ------
    ValueError
        For S or length below 0, or a width that is not positive.
    """

    S: ArrayLike
    width: ArrayLike = 1.0
    length: ArrayLike = 0.0

    nonnegative = ("S", "length")
    source = "EIG-3 article, section 4.3, after Xie"
    picture = "spring"

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require(self._reals("width") > 0, "width must be positive")

    @staticmethod
    @element
    def tension(r, S, width, length):
        return S * width * tanh((r - length) / width)

    @staticmethod
    @element
    def potential(r, S, width, length):
        d = abs(r - length) / width
        return S * width * width * (d + math.log1p(math.exp(-2 * d)) - math.log(2.0))  # ln cosh d, without overflow
