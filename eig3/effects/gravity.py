"""A uniform field of gravity."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Body
from .vector import dot


@dataclass(frozen=True, eq=False)
class Gravity(Body):
    """Uniform gravity: the same acceleration for every mass.

    Parameters
    ----------
    field : array_like, shape (dimension,)
        The acceleration, m/s^2, such as ``(0, -9.81)``.
    """

    field: ArrayLike

    vectors = ("field",)
    source = "Newton"
    picture = "weight"

    @staticmethod
    @element
    def acceleration(field):
        return field

    @staticmethod
    @element
    def potential(x, m, field):
        return -m * dot(field, x)
