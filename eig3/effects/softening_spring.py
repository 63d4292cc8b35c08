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
    """A spring whose force tends to a limit.

    Formula: tension = stiffness saturation tanh(d / saturation) at the stretch d = r - rest_length. The article of
    EIG-3 calls the stiffness S and has the saturation 1.

    Parameters
    ----------
    stiffness : float or array_like
        At rest, N/m.
    saturation : float or array_like
        The stretch, m, beyond which the tension nears its limit stiffness saturation.
    rest_length : float or array_like
        m.

    Raises
    ------
    ValueError
        For stiffness or rest_length below 0, or a saturation that is not positive.

    Notes
    -----
    Other codes: none in LAMMPS, OpenSees and MuJoCo; OpenMM: a ``CustomBondForce``.

    Not included: hysteresis: the spring unloads along the same curve.
    """

    stiffness: ArrayLike
    saturation: ArrayLike = 1.0
    rest_length: ArrayLike = 0.0

    nonnegative = ("stiffness",)
    source = "EIG-3 article, section 4.3, after Xie"
    picture = "spring"

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require(self._reals("saturation") > 0, "saturation must be positive")

    @staticmethod
    @element
    def tension(r, stiffness, saturation, rest_length):
        return stiffness * saturation * tanh((r - rest_length) / saturation)

    @staticmethod
    @element
    def potential(r, stiffness, saturation, rest_length):
        d = abs(r - rest_length) / saturation
        ln_cosh = d + math.log1p(math.exp(-2 * d)) - math.log(2.0)  # without overflow
        return stiffness * saturation * saturation * ln_cosh
