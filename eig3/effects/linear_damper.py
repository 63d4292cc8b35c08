"""A viscous damper between two points."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Link


@dataclass(frozen=True, eq=False)
class LinearDamper(Link):
    """A dashpot: the tension is the damping times the rate at which the distance of its ends grows.

    Parameters
    ----------
    damping : float or array_like
        N s/m.

    Raises
    ------
    ValueError
        For damping below 0.
    """

    damping: ArrayLike

    nonnegative = ("damping",)
    source = "the dashpot of Kelvin and Voigt"

    @staticmethod
    @element
    def tension(rate, damping):
        return damping * rate
