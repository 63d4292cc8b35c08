"""A viscous damper between two points."""

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.jit import element
from ..scene.effect import Link


@dataclass(frozen=True, eq=False)
class LinearDamper(Link):
    """A dashpot that resists the rate at which its ends part, along the line through them.

    Parameters
    ----------
    damping : float or array_like
        N s/m.
    """

    damping: ArrayLike

    source = "Kelvin and Voigt's dashpot"

    @staticmethod
    @element
    def tension(rate, damping):
        return damping * rate
