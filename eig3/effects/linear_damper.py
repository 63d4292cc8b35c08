"""A viscous damper between two points."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Link


@dataclass(frozen=True, eq=False)
class LinearDamper(Link):
    """A viscous damper (dashpot) between two points.

    Formula: tension = damping r', with the rate r' at which the distance of the ends grows.

    Parameters
    ----------
    damping : float or array_like
        N s/m.

    Raises
    ------
    ValueError
        For damping below 0.

    Notes
    -----
    Other codes: MuJoCo: the ``damping`` of a spatial tendon; exudyn: the ``damping`` of
    ``ObjectConnectorSpringDamper``; OpenSees: ``uniaxialMaterial Viscous`` with alpha = 1 in a truss; Modelica
    ``Forces.Damper``.

    Not included: a power of the velocity other than 1, and the stiffness in series of Maxwell's model.
    """

    damping: ArrayLike

    nonnegative = ("damping",)
    source = "the dashpot of Kelvin and Voigt"

    @staticmethod
    @element
    def tension(rate, damping):
        return damping * rate
