"""Drag in a fluid at rest."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Body
from .vector import norm, scale


@dataclass(frozen=True, eq=False)
class QuadraticDrag(Body):
    """Drag in a fluid at rest, in proportion to the square of the speed.

    Formula: force = -drag |v| v.

    Parameters
    ----------
    drag : float or array_like
        Half the product of the fluid's density, the area and the drag coefficient, kg/m.

    Raises
    ------
    ValueError
        For drag below 0.

    Notes
    -----
    Other codes: Modelica ``Translational.Sources.QuadraticSpeedDependentForce`` in one dimension. LAMMPS ``fix
    viscous`` is linear in v.

    Not included: motion of the fluid, lift, and added mass.
    """

    drag: ArrayLike

    nonnegative = ("drag",)
    source = "Newton; Rayleigh's drag equation"

    @staticmethod
    @element
    def force(v, drag):
        return scale(-drag * norm(v), v)
