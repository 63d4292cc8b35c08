"""A chemical bond that can break."""

from __future__ import annotations

import math
from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Link


@dataclass(frozen=True, eq=False)
class Morse(Link):
    """The bond of two atoms: a spring near its natural length, which gets soft and lets go where it is long.

    The potential is depth (1 - exp(-(r - length) / width))^2: 0 at the natural length and depth far away. The stiffness
    at the natural length is 2 depth / width^2.

    Parameters
    ----------
    depth : float or array_like
        The energy that breaks the bond, J.
    width : float or array_like
        m.
    length : float or array_like
        Natural length, m.

    Raises
    ------
    ValueError
        For depth or length below 0, or a width that is not positive.
    """

    depth: ArrayLike
    width: ArrayLike
    length: ArrayLike

    nonnegative = ("depth", "length")
    source = "Morse (1929)"

    def __post_init__(self):
        super().__post_init__()
        self.require(self._reals("width") > 0, "width must be positive")

    @staticmethod
    @element
    def tension(r, depth, width, length):
        near = math.exp((length - r) / width)
        return 2 * depth / width * near * (1 - near)

    @staticmethod
    @element
    def potential(r, depth, width, length):
        return depth * (1 - math.exp((length - r) / width)) ** 2
