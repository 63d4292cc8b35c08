"""Friction in the hinge between two bodies."""

from __future__ import annotations

import math
from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from .effect import Link
from .hinge_motor import HingeMotor


@dataclass(frozen=True, eq=False)
class HingeFriction(Link):
    """The law of a torque against the rate of the angle, for a `HingeLaw`.

    Raises
    ------
    ValueError
        For a limit or damping below 0, or a regularization_speed that is not positive.
    """

    limit: ArrayLike
    damping: ArrayLike
    regularization_speed: ArrayLike

    offers = HingeMotor.offers
    needs = HingeMotor.needs
    nonnegative = ("limit", "damping")
    source = "Coulomb (1785), regularised, and viscous friction"

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require(self._reals("regularization_speed") > 0, "regularization_speed must be positive")

    @staticmethod
    @element
    def torque(rate, limit, damping, regularization_speed):  # type: ignore[no-untyped-def]
        return -(limit / math.sqrt(rate * rate + regularization_speed * regularization_speed) + damping) * rate
