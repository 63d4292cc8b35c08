"""Drag in a fluid at rest."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Body
from .vector import norm, scale


@dataclass(frozen=True, eq=False)
class QuadraticDrag(Body):
    """A force against the velocity, in proportion to the square of the speed.

    Parameters
    ----------
    drag : float or array_like
        Half the product of the fluid's density, the area and the drag coefficient, kg/m.

    Raises
    ------
    ValueError
        For drag below 0.
    """

    drag: ArrayLike

    nonnegative = ("drag",)
    source = "Newton; Rayleigh's drag equation"

    @staticmethod
    @element
    def force(v, drag):
        return scale(-drag * norm(v), v)
