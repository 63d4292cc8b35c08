"""Stokes's drag."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Body
from .vector import scale


@dataclass(frozen=True, eq=False)
class LinearDrag(Body):
    """A force against the velocity, in proportion to the speed.

    Parameters
    ----------
    drag : float or array_like
        N s/m.

    Raises
    ------
    ValueError
        For drag below 0.
    """

    drag: ArrayLike

    nonnegative = ("drag",)
    source = "Stokes (1851)"

    @staticmethod
    @element
    def force(v, drag):
        return scale(-drag, v)
